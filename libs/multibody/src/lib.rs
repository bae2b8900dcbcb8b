//! Kinematics and dynamics of a planar chain: a base, floating or clamped, that carries an arm of `n` revolute links.
//!
//! # Coordinates
//!
//! `q = [x, y, theta, q_1 .. q_n]`: position of the base frame's origin in the table frame, its angle, the joint
//! angles; `v = dq/dt`. SI units, radians, counter-clockwise positive. All vectors have the fixed capacity
//! [`MAX_DOF`]; their tail beyond `n + 3` is zero and stays zero, so nothing here allocates.
//!
//! Body 0 is the base, body `i` is link `i`. Their absolute angles are
//! `phi_0 = theta`, `phi_1 = theta + joint1_angle + q_1 + offset_1`, `phi_i = phi_{i-1} + q_i + offset_i`.
//!
//! # The equations
//!
//! Written in absolute angles the planar chain has a structure that three-dimensional engines cannot use. With
//! `R_i` the rotation by `phi_i`, `d_i` the vector from joint `i` to joint `i + 1` in body `i` (for the base: from its
//! origin to joint 1) and `c_i` that from joint `i` to the centre of mass, lump the masses once per model:
//!
//! ```text
//! s_i = m_i c_i + (m_{i+1} + .. + m_n) d_i                 first moment of all that body i carries
//! J_i = I_i + m_i |c_i|^2 + (m_{i+1} + .. + m_n) |d_i|^2   and its second moment
//! ```
//!
//! The kinetic energy is then, for every number of links,
//!
//! ```text
//! T = m/2 |r'|^2 + r' . sum_i phi_i' (R_i s_i)^perp + 1/2 sum_i J_i phi_i'^2 + sum_{i<j} phi_i' phi_j' (R_i d_i) . (R_j s_j)
//! ```
//!
//! and Lagrange's equations `H acc + h = tau` follow by inspection: `tau = [Fx, Fy, Mz about the base origin, t_1 .. t_n]`.
//! Eliminating the two translations replaces `d_i` by `e_i = d_i - s_i / m`: the momentum principle as algebra.
//!
//! With the number of bodies known to the compiler, the forward dynamics of a base and four links take about 140 ns, an
//! RK4 step 0.65 us (`fss bench dynamics` measures it on your machine).
//!
//! # Where things are
//!
//! - [`Model`]: the mechanism, and all that can be asked of it at a [`State`];
//! - kinematics: [`Model::kinematics`], [`Model::end_effector`], [`Model::jacobian`], [`Model::jacobian_derivative`];
//! - dynamics: [`Model::mass_matrix`], [`Model::bias_forces`], [`Model::inverse_dynamics`], [`Model::forward_dynamics`];
//!   with some joints' accelerations given, as servos or sticking friction do: [`Model::hybrid_dynamics`];
//! - momentum and the coupling of arm and base: [`Model::momentum`], [`Model::base_twist`],
//!   [`Model::generalized_jacobian`], [`Model::reaction_vector`];
//! - joint rates for a motion: [`Model::zero_reaction_jacobian`], [`damped_pseudoinverse`], [`Manipulability`];
//! - [`integrate`]: fixed-step methods of stated order, one of which keeps momentum to rounding.
//!
//! # Example
//!
//! The arm swings and the free base turns back:
//!
//! ```
//! use fss_multibody::{Base, Coordinates, Link, Model, State, integrate};
//!
//! let base = Base { mass_kg: 10.0, inertia_kg_m2: 0.25, joint1_xy_m: [0.2, 0.0], ..Base::default() };
//! let arm = [Link { length_m: 0.38, com_to_next_joint_m: 0.19, mass_kg: 2.9, inertia_kg_m2: 0.034, ..Link::default() }; 4];
//! let model = Model::new(base, &arm, [0.0, 0.0])?;
//!
//! let torques = |_time_s: f64, _state: &State| State::from_slices(&[0.0, 0.0, 0.0, 0.05], &[]).q;
//! let mut state = State::zero();
//! for _ in 0..1000 {
//!     state = integrate::step_rk4_momentum(&model, &state, 1e-3, torques);
//! }
//! assert!(state.q[3] > 0.05 && state.q[2] < -0.05);
//! assert!(model.momentum(&state).linear.norm() < 1e-14);
//! # Ok::<(), fss_multibody::ModelError>(())
//! ```
//!
//! # Sources
//!
//! R. Featherstone, *Rigid Body Dynamics Algorithms*, Springer 2008 (inverse, forward and hybrid dynamics; reflected
//! rotor inertia). Y. Umetani and K. Yoshida, "Resolved motion rate control of space manipulators with generalized
//! Jacobian matrix", IEEE Trans. Robotics and Automation 5(3), 1989. K. Yoshida, K. Hashizume and S. Abiko,
//! "Zero reaction maneuver", ICRA 2001 (reaction null space).

// The small kernels only become vector code once they are inside the loop that knows the number of bodies.
#![allow(clippy::inline_always)]

mod chain;
mod dynamics;
pub mod integrate;
mod kernel;
mod kinematics;
mod model;
mod momentum;
mod parameters;
mod resolve;
mod state;
mod trig;

pub use dynamics::{Hybrid, Prescribed};
pub use kinematics::Kinematics;
pub use model::{Base, Body, Link, Model, ModelError};
pub use momentum::{Momentum, Whole};
pub use parameters::Parameter;
pub use resolve::{Manipulability, damped_pseudoinverse, damping_near_singularity, singular_values};
pub use state::{Coordinates, Jacobian, JointJacobian, JointVector, MassMatrix, State, coordinates, wrapped};

/// Most links that a [`Model`] can have.
pub const MAX_LINKS: usize = 8;
/// Most degrees of freedom: the base's three and one per link.
pub const MAX_DOF: usize = 3 + MAX_LINKS;
/// Most bodies: the base and the links.
pub(crate) const MAX_BODIES: usize = 1 + MAX_LINKS;
