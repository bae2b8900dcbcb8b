//! Analytic derivatives of inverse and forward dynamics.
//!
//! Differentiate `tau = ID(q, v, acc, p)` at fixed accelerations, which is cheap and exact (each body's angle turns
//! two vectors), and use that `ID` is constant along `acc = FD(q, v, tau, p)`:
//!
//! ```text
//! d acc / d tau = H^-1        d acc / d z = -H^-1 dID/dz     for z any of q, v, p
//! ```
//!
//! (J. Carpentier and N. Mansard, "Analytical derivatives of rigid body dynamics algorithms", RSS 2018.)

use nalgebra::Vector2;

use crate::chain::{Chain, absolute, by_bodies, cross, perp};
use crate::kernel::{forward_with_inverse, spin};
use crate::{Coordinates, MAX_BODIES, MassMatrix, Model, Parameter, State};

/// Forward dynamics with its derivatives. All matrices dof x dof in their leading block, rows accelerations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForwardDerivatives {
    /// The accelerations themselves.
    pub acc: Coordinates,
    /// With respect to the coordinates.
    pub by_q: MassMatrix,
    /// With respect to the velocities.
    pub by_v: MassMatrix,
    /// With respect to the generalized forces: `H^-1`, with zero rows and columns for a clamped base.
    pub by_force: MassMatrix,
}

/// Derivatives of inverse dynamics at fixed accelerations, rows forces; with respect to the accelerations it is `H`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseDerivatives {
    /// With respect to the coordinates.
    pub by_q: MassMatrix,
    /// With respect to the velocities.
    pub by_v: MassMatrix,
}

impl Model {
    /// Forward dynamics and its derivatives with respect to coordinates, velocities and forces.
    pub fn forward_dynamics_derivatives(&self, state: &State, tau: &Coordinates) -> ForwardDerivatives {
        by_bodies!(self, forward_derivatives(self, state, tau))
    }

    /// Derivative of the accelerations with respect to a parameter, where `derivatives` are those at `state`.
    pub fn forward_dynamics_by_parameter(
        &self,
        state: &State,
        derivatives: &ForwardDerivatives,
        parameter: Parameter,
    ) -> Coordinates {
        -derivatives.by_force * self.inverse_dynamics_by_parameter(state, &derivatives.acc, parameter)
    }

    /// Derivatives of [`Model::inverse_dynamics`] with respect to coordinates and velocities.
    pub fn inverse_dynamics_derivatives(&self, state: &State, acc: &Coordinates) -> InverseDerivatives {
        by_bodies!(self, inverse_at(self, state, acc))
    }

    /// Derivative of [`Model::inverse_dynamics`] with respect to a parameter; zero where the model has no such link.
    pub fn inverse_dynamics_by_parameter(&self, state: &State, acc: &Coordinates, parameter: Parameter) -> Coordinates {
        by_bodies!(self, by_parameter_at(self, state, acc, parameter))
    }
}

fn forward_derivatives<const B: usize>(model: &Model, state: &State, tau: &Coordinates) -> ForwardDerivatives {
    Linearized::<B>::at(model, state, tau).forward
}

fn inverse_at<const B: usize>(model: &Model, state: &State, acc: &Coordinates) -> InverseDerivatives {
    Motion::<B>::of(model, state, acc).by_state()
}

fn by_parameter_at<const B: usize>(
    model: &Model,
    state: &State,
    acc: &Coordinates,
    parameter: Parameter,
) -> Coordinates {
    let motion = Motion::<B>::of(model, state, acc);
    motion.by_parameter(model, acc, &motion.by_state().by_q, parameter)
}

/// All that the derivatives at one state have in common.
pub(crate) struct Linearized<const B: usize> {
    pub(crate) forward: ForwardDerivatives,
    motion: Motion<B>,
    force_by_q: MassMatrix,
}

impl<const B: usize> Linearized<B> {
    #[inline(always)]
    pub(crate) fn at(model: &Model, state: &State, tau: &Coordinates) -> Self {
        let (acc, by_force) = forward_with_inverse::<B>(model, state, tau);
        let motion = Motion::<B>::of(model, state, &acc);
        let partial = motion.by_state();
        let by_q = minus_product::<B>(&by_force, &partial.by_q);
        let by_v = minus_product::<B>(&by_force, &partial.by_v);
        Self { forward: ForwardDerivatives { acc, by_q, by_v, by_force }, motion, force_by_q: partial.by_q }
    }

    /// Derivative of the accelerations with respect to a parameter.
    #[inline(always)]
    pub(crate) fn by_parameter(&self, model: &Model, parameter: Parameter) -> Coordinates {
        let tau = self.motion.by_parameter(model, &self.forward.acc, &self.force_by_q, parameter);
        -self.by_force(&tau)
    }

    /// Accelerations that generalized forces add.
    #[inline(always)]
    pub(crate) fn by_force(&self, tau: &Coordinates) -> Coordinates {
        let mut acc = Coordinates::zeros();
        for k in 0..B + 2 {
            for i in 0..B + 2 {
                acc[i] += self.forward.by_force[(i, k)] * tau[k];
            }
        }
        acc
    }
}

/// `-A B` of two matrices whose leading block of `B + 2` rows and columns alone is not zero.
#[inline(always)]
fn minus_product<const B: usize>(a: &MassMatrix, b: &MassMatrix) -> MassMatrix {
    let mut product = MassMatrix::zeros();
    for j in 0..B + 2 {
        let mut column = [0.0; MAX_BODIES + 2];
        for k in 0..B + 2 {
            let factor = b[(k, j)];
            for i in 0..B + 2 {
                column[i] -= a[(i, k)] * factor;
            }
        }
        for i in 0..B + 2 {
            product[(i, j)] = column[i];
        }
    }
    product
}

/// From derivatives of the moments on bodies by absolute angles to those of generalized forces by relative ones: a
/// coordinate moves all bodies beyond its joint, and its force acts on them all.
#[inline(always)]
fn accumulate<const B: usize>(matrix: &mut MassMatrix) {
    for k in (0..B).rev() {
        for i in (0..B - 1).rev() {
            matrix[(2 + i, 2 + k)] += matrix[(3 + i, 2 + k)];
        }
        if k + 1 < B {
            for i in 0..B + 2 {
                matrix[(i, 2 + k)] += matrix[(i, 3 + k)];
            }
        }
    }
}

/// The chain in motion: what one sweep outwards and one inwards know.
pub(crate) struct Motion<const B: usize> {
    pub(crate) chain: Chain<B>,
    pub(crate) rate: [f64; B],
    pub(crate) turn: [f64; B],
    /// Acceleration of the joint at body i's root (base: origin), less gravity.
    pub(crate) origin: [Vector2<f64>; B],
    /// Accelerations of the ends of `d_i` relative to their origins.
    swing: [Vector2<f64>; B],
    /// Forces that turning `s_i` takes, and their sum over the bodies beyond i.
    force: [Vector2<f64>; B],
    beyond: [Vector2<f64>; B],
}

impl<const B: usize> Motion<B> {
    #[inline(always)]
    pub(crate) fn of(model: &Model, state: &State, acc: &Coordinates) -> Self {
        let chain = Chain::<B>::at(model, &state.q);
        let rate = absolute::<B>(&state.v);
        let turn = absolute::<B>(acc);
        let zero = [Vector2::zeros(); B];
        let mut motion = Self { chain, rate, turn, origin: zero, swing: zero, force: zero, beyond: zero };
        let mut origin = Vector2::new(acc[0], acc[1]) - Vector2::from(model.gravity_m_s2());
        for i in 0..B {
            motion.origin[i] = origin;
            motion.swing[i] = spin(&chain.d[i], rate[i], turn[i]);
            motion.force[i] = spin(&chain.s[i], rate[i], turn[i]);
            origin += motion.swing[i];
        }
        for i in (0..B - 1).rev() {
            motion.beyond[i] = motion.beyond[i + 1] + motion.force[i + 1];
        }
        motion
    }

    /// Generalized forces of a force at the root of body `body` and a moment on it, at the bodies that carry it.
    #[inline(always)]
    pub(crate) fn wrench(&self, body: usize, force: &Vector2<f64>, moment: f64) -> Coordinates {
        let mut tau = Coordinates::zeros();
        let mut total = 0.0;
        for i in (0..B).rev() {
            if i == body {
                total = moment;
            } else if i < body {
                total += cross(&self.chain.d[i], force);
            }
            tau[2 + i] = total;
        }
        tau[0] = force.x;
        tau[1] = force.y;
        tau
    }
}

/// Inverse dynamics by the inertial parameters of one body, in which it is linear (columns of the regressor), and by
/// the vectors from joint to joint.
impl<const B: usize> Motion<B> {
    /// With respect to coordinates and velocities.
    #[inline(always)]
    fn by_state(&self) -> InverseDerivatives {
        let Chain { d, s, .. } = &self.chain;
        let mut by_q = MassMatrix::zeros();
        let mut by_v = MassMatrix::zeros();
        // First by the absolute angle and rate of each body k, moments on each body i ..
        for k in 0..B {
            let double_rate = -2.0 * self.rate[k];
            let (swing, force) = (&self.swing[k], &self.force[k]);
            for i in 0..k {
                by_q[(2 + i, 2 + k)] = d[i].dot(force);
                by_v[(2 + i, 2 + k)] = double_rate * cross(&d[i], &s[k]);
            }
            by_q[(2 + k, 2 + k)] = -s[k].dot(&self.origin[k]) - d[k].dot(&self.beyond[k]);
            for i in k + 1..B {
                by_q[(2 + i, 2 + k)] = s[i].dot(swing);
                by_v[(2 + i, 2 + k)] = double_rate * cross(&s[i], &d[k]);
            }
            let turned = perp(force);
            for axis in 0..2 {
                by_q[(axis, 2 + k)] = turned[axis];
                by_v[(axis, 2 + k)] = double_rate * s[k][axis];
            }
        }
        accumulate::<B>(&mut by_q);
        accumulate::<B>(&mut by_v);
        InverseDerivatives { by_q, by_v }
    }

    /// With respect to a parameter, where `by_q` is the derivative with respect to the coordinates.
    fn by_parameter(&self, model: &Model, acc: &Coordinates, by_q: &MassMatrix, parameter: Parameter) -> Coordinates {
        if parameter.link().is_some_and(|number| number == 0 || number >= B) {
            return Coordinates::zeros();
        }
        match parameter {
            Parameter::BaseMass => self.by_body_mass(model, 0),
            Parameter::BaseInertia => self.by_inertia(0),
            Parameter::BaseComX => self.by_com(model, 0, 1.0, 0.0),
            Parameter::BaseComY => self.by_com(model, 0, 0.0, 1.0),
            Parameter::Joint1X => self.by_segment(model, 0, &Vector2::x()),
            Parameter::Joint1Y => self.by_segment(model, 0, &Vector2::y()),
            Parameter::Joint1Angle if B == 1 => Coordinates::zeros(),
            Parameter::Joint1Angle => by_q.column(3).into_owned(),
            Parameter::GravityX => self.by_gravity(model, &Vector2::x()),
            Parameter::GravityY => self.by_gravity(model, &Vector2::y()),
            Parameter::LinkLength(i) => self.by_com(model, i, 1.0, 0.0) + self.by_segment(model, i, &Vector2::x()),
            Parameter::ComToNextJoint(i) => self.by_com(model, i, -1.0, 0.0),
            Parameter::ComOffset(i) => self.by_com(model, i, 0.0, 1.0),
            Parameter::LinkMass(i) => self.by_body_mass(model, i),
            Parameter::LinkInertia(i) => self.by_inertia(i),
            Parameter::JointOffset(i) => by_q.column(2 + i).into_owned(),
            Parameter::RotorInertia(i) => {
                let mut tau = Coordinates::zeros();
                tau[2 + i] = acc[2 + i];
                tau
            }
        }
    }

    /// By a body's mass, its centre of mass and the inertia about that held.
    #[inline(always)]
    fn by_body_mass(&self, model: &Model, body: usize) -> Coordinates {
        let c = &model.lumps.c[body];
        self.by_mass(body) + self.by_first_moment(body, c) + self.by_inertia(body) * c.norm_squared()
    }

    /// By a body's centre of mass along a direction fixed in it, the inertia about that held.
    #[inline(always)]
    fn by_com(&self, model: &Model, body: usize, x: f64, y: f64) -> Coordinates {
        let direction = Vector2::new(x, y);
        let inertia = 2.0 * direction.dot(&model.lumps.c[body]);
        (self.by_first_moment(body, &direction) + self.by_inertia(body) * inertia) * model.lumps.mass[body]
    }

    /// By mass at the body's root.
    #[inline(always)]
    pub(crate) fn by_mass(&self, body: usize) -> Coordinates {
        self.wrench(body, &self.origin[body], 0.0)
    }

    /// By first moment of mass about the root, along a direction fixed in the body.
    #[inline(always)]
    pub(crate) fn by_first_moment(&self, body: usize, direction: &Vector2<f64>) -> Coordinates {
        let u = self.chain.turned(body, direction);
        let force = spin(&u, self.rate[body], self.turn[body]);
        self.wrench(body, &force, cross(&u, &self.origin[body]))
    }

    /// By moment of inertia about the root.
    #[inline(always)]
    pub(crate) fn by_inertia(&self, body: usize) -> Coordinates {
        self.wrench(body, &Vector2::zeros(), self.turn[body])
    }

    /// By the vector `d` of a body, along a direction fixed in it: all that the body carries shifts.
    fn by_segment(&self, model: &Model, body: usize, direction: &Vector2<f64>) -> Coordinates {
        let lumps = &model.lumps;
        let carried = lumps.carried[body];
        let u = self.chain.turned(body, direction);
        let shift = spin(&u, self.rate[body], self.turn[body]);
        let inertia = 2.0 * carried * lumps.d[body].dot(direction);
        let moment = inertia * self.turn[body] + cross(&u, &(carried * self.origin[body] + self.beyond[body]));
        let mut tau = self.wrench(body, &(carried * shift), moment);
        let mut total = 0.0;
        for i in (body + 1..B).rev() {
            total += cross(&self.chain.s[i], &shift);
            tau[2 + i] += total;
        }
        for i in 0..=body {
            tau[2 + i] += total;
        }
        tau
    }

    fn by_gravity(&self, model: &Model, direction: &Vector2<f64>) -> Coordinates {
        let mut tau = Coordinates::zeros();
        let mut total = 0.0;
        for i in (0..B).rev() {
            total -= cross(&self.chain.s[i], direction);
            tau[2 + i] = total;
        }
        for axis in 0..2 {
            tau[axis] = -model.lumps.total_mass * direction[axis];
        }
        tau
    }
}
