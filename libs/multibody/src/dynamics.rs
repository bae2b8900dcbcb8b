//! Generalized inertia, bias forces, inverse and forward dynamics, energies.

use nalgebra::{Vector2, Vector3};

use crate::chain::by_bodies;
use crate::kernel::{forward, hybrid, inertia, inverse, inverse_inertia};
use crate::{Coordinates, JointVector, MAX_LINKS, MassMatrix, Model, State};

/// Accelerations, rad/s^2, of the joints that have no choice ([`Model::hybrid_dynamics`]).
pub type Prescribed = [Option<f64>; MAX_LINKS];

impl Model {
    /// Generalized inertia `H(q)`, symmetric positive definite in its leading dof x dof block: `T = v' H v / 2`.
    pub fn mass_matrix(&self, q: &Coordinates) -> MassMatrix {
        by_bodies!(self, inertia(self, q))
    }

    /// Bias forces `h(q, v)`: centrifugal, Coriolis and gravity, in `H acc + h = tau`.
    pub fn bias_forces(&self, state: &State) -> Coordinates {
        self.inverse_dynamics(state, &Coordinates::zeros())
    }

    /// Generalized forces `tau = H acc + h` that give the accelerations `acc`. Linear cost in the number of links.
    ///
    /// For a clamped base the first three are the force and moment that the clamp must supply.
    pub fn inverse_dynamics(&self, state: &State, acc: &Coordinates) -> Coordinates {
        by_bodies!(self, inverse(self, state, acc))
    }

    /// Accelerations `acc = H^-1 (tau - h)` under the generalized forces `tau = [Fx, Fy, Mz about the base origin,
    /// t_1 .. t_n]`, table axes, N and N m. A clamped base has none.
    ///
    /// The two translations are eliminated by hand (crate documentation), what is left is factored as `L D L'` with
    /// the number of bodies known to the compiler.
    pub fn forward_dynamics(&self, state: &State, tau: &Coordinates) -> Coordinates {
        by_bodies!(self, forward(self, state, tau))
    }

    /// Accelerations and torques where some joints follow a prescribed acceleration whatever it takes and the others
    /// have the torque given: hybrid dynamics (Featherstone 2008, section 9.2).
    ///
    /// `prescribed[i]`, rad/s^2, rules joint `i + 1`; for such a joint `tau` is ignored.
    pub fn hybrid_dynamics(&self, state: &State, tau: &Coordinates, prescribed: &Prescribed) -> Hybrid {
        let acc = self.hybrid_accelerations(state, tau, prescribed);
        let needed = self.inverse_dynamics(state, &acc);
        let mut torques = *tau;
        for (i, joint) in prescribed.iter().enumerate().take(self.link_count()) {
            if joint.is_some() {
                torques[3 + i] = needed[3 + i];
            }
        }
        Hybrid { acc, tau: torques }
    }

    /// The accelerations of [`Model::hybrid_dynamics`] alone, for half its price.
    pub fn hybrid_accelerations(&self, state: &State, tau: &Coordinates, prescribed: &Prescribed) -> Coordinates {
        by_bodies!(self, hybrid(self, state, tau, prescribed))
    }

    /// Accelerations when all joint accelerations are given (rad/s^2, one a joint) and `[Fx, Fy, Mz]` acts on the
    /// base: what a base does under an arm that follows its servos. [`Model::inverse_dynamics`] then gives the torques.
    pub fn prescribed_dynamics(
        &self,
        state: &State,
        joint_acc: &JointVector,
        base_force: &Vector3<f64>,
    ) -> Coordinates {
        let tau = Coordinates::from_fn(|i, _| if i < 3 { base_force[i] } else { 0.0 });
        let prescribed = std::array::from_fn(|i| Some(joint_acc[i]));
        by_bodies!(self, hybrid(self, state, &tau, &prescribed))
    }

    /// `H^-1`, the accelerations per generalized force: symmetric; for a clamped base its first three rows and columns
    /// are zero. Zero outside the leading dof x dof block.
    pub fn mass_matrix_inverse(&self, q: &Coordinates) -> MassMatrix {
        by_bodies!(self, inverse_inertia(self, q))
    }

    /// Potential energy in the model's gravity, J; zero with the centre of mass at the table's origin.
    pub fn potential_energy(&self, q: &Coordinates) -> f64 {
        -self.lumps.total_mass * self.center_of_mass(q).dot(&Vector2::from(self.gravity_m_s2()))
    }
}

/// Accelerations and generalized forces that belong together ([`Model::hybrid_dynamics`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hybrid {
    /// Generalized accelerations.
    pub acc: Coordinates,
    /// Generalized forces: as given, and at the prescribed joints the torques that it takes.
    pub tau: Coordinates,
}
