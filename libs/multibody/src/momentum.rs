//! Momentum, and what it does to the coupling of arm and base.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::chain::{Chain, absolute, by_bodies, cross, perp};
use crate::{Coordinates, JointJacobian, JointVector, MAX_LINKS, Model, State};

/// Momentum of base and arm together, in table axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Momentum {
    /// Linear, kg m/s.
    pub linear: Vector2<f64>,
    /// Angular about the base frame's origin, kg m^2/s.
    pub angular_about_base: f64,
    /// Angular about the centre of mass of the whole, kg m^2/s: constant where no force acts.
    pub angular_about_com: f64,
}

impl Momentum {
    /// `[Px, Py, L]` with `L` about the base frame's origin, as [`Model::base_twist`] takes it.
    pub fn about_base(&self) -> Vector3<f64> {
        Vector3::new(self.linear.x, self.linear.y, self.angular_about_base)
    }
}

impl Model {
    /// Linear and angular momentum (reflected rotor inertia carries none: see [`crate::Link::rotor_inertia_kg_m2`]).
    pub fn momentum(&self, state: &State) -> Momentum {
        self.whole(state).momentum()
    }

    /// Generalized momentum `H v`: first the momentum about the base origin, then one entry a joint.
    pub fn generalized_momentum(&self, state: &State) -> Coordinates {
        self.whole(state).generalized_momentum
    }

    /// Moment of inertia of base and arm together about their centre of mass with all joints locked, kg m^2.
    pub fn inertia_about_com(&self, q: &Coordinates) -> f64 {
        self.whole(&State::at_rest(*q)).inertia_kg_m2
    }

    /// Momentum, centre of mass and locked inertia in one pass.
    pub fn whole(&self, state: &State) -> Whole {
        by_bodies!(self, whole(self, state))
    }

    /// Kinetic energy, J.
    pub fn kinetic_energy(&self, state: &State) -> f64 {
        0.5 * state.v.dot(&self.generalized_momentum(state))
    }

    /// Twist of a floating base, `[vx, vy, omega]` of its origin in table axes, per joint rate at zero momentum, 3 x n:
    /// `-H_b^-1 H_bm`. Zero for a clamped base.
    pub fn base_jacobian(&self, q: &Coordinates) -> JointJacobian {
        let (inverse, coupling) = self.coupling(q);
        -inverse * coupling
    }

    /// Twist of a floating base, `[vx, vy, omega]`, that joint rates (rad/s) and a momentum `[Px, Py, L about the base
    /// origin]` imply: `H_b^-1 (momentum - H_bm rates)`. Zero for a clamped base.
    pub fn base_twist(&self, q: &Coordinates, joint_rates: &JointVector, momentum: &Vector3<f64>) -> Vector3<f64> {
        if self.base().clamped {
            return Vector3::zeros();
        }
        // What the base must carry moves base and arm as one body: its centre of mass first, the turn about that next.
        let mut state = State::at_rest(*q);
        state.v.fixed_rows_mut::<MAX_LINKS>(3).copy_from(joint_rates);
        let whole = self.whole(&state);
        let linear = momentum.xy() - whole.generalized_momentum.xy();
        let angular = momentum.z - whole.generalized_momentum[2] - cross(&whole.center_m, &linear);
        let turn = angular / whole.inertia_kg_m2;
        let drift = linear * self.lumps.per_mass - turn * perp(&whole.center_m);
        Vector3::new(drift.x, drift.y, turn)
    }

    /// Generalized Jacobian, 3 x n: twist `[vx, vy, omega]` of the end-effector per joint rate when the momentum is
    /// zero and the base free, `J_m - J_b H_b^-1 H_bm` (Umetani and Yoshida 1989, equation 17).
    ///
    /// With momentum the tip moves besides with `J_b base_twist(q, 0, momentum)`: [`Model::momentum_drift`]. For a
    /// clamped base it is the manipulator Jacobian `J_m`.
    pub fn generalized_jacobian(&self, q: &Coordinates) -> JointJacobian {
        let jacobian = self.jacobian(q);
        jacobian.fixed_columns::<MAX_LINKS>(3) + jacobian.fixed_columns::<3>(0) * self.base_jacobian(q)
    }

    /// Twist of the end-effector when the joints stand still and the momentum is `[Px, Py, L about the base origin]`:
    /// what is to be added to `generalized_jacobian * rates`.
    pub fn momentum_drift(&self, q: &Coordinates, momentum: &Vector3<f64>) -> Vector3<f64> {
        self.jacobian(q).fixed_columns::<3>(0) * self.base_twist(q, &JointVector::zeros(), momentum)
    }

    /// Angular rate of the base per joint rate at zero momentum, one entry a joint: `-h_s / H_s`. Joint rates
    /// orthogonal to it (the reaction null space, Yoshida et al. 2001) leave the base's attitude alone.
    pub fn reaction_vector(&self, q: &Coordinates) -> JointVector {
        self.base_jacobian(q).row(2).transpose()
    }

    /// Inverse of the base's inertia `H_b` and the coupling `H_bm`; both zero for a clamped base.
    fn coupling(&self, q: &Coordinates) -> (Matrix3<f64>, JointJacobian) {
        if self.base().clamped {
            return (Matrix3::zeros(), JointJacobian::zeros());
        }
        let inertia = self.mass_matrix(q);
        let base: Matrix3<f64> = inertia.fixed_view::<3, 3>(0, 0).into_owned();
        let coupling = inertia.fixed_view::<3, MAX_LINKS>(0, 3).into_owned();
        // A floating base has mass and inertia (checked in `Model::new`), so H_b is positive definite.
        (base.try_inverse().unwrap_or_else(Matrix3::zeros), coupling)
    }
}

/// Base and arm as one body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Whole {
    /// Generalized momentum `H v`: linear, angular about the base frame's origin, then one entry a joint.
    pub generalized_momentum: Coordinates,
    /// Centre of mass as seen from the base origin, table axes, m.
    pub center_m: Vector2<f64>,
    /// Moment of inertia about the centre of mass with all joints locked, kg m^2.
    pub inertia_kg_m2: f64,
}

impl Whole {
    /// Linear and angular momentum.
    pub fn momentum(&self) -> Momentum {
        let linear = Vector2::new(self.generalized_momentum[0], self.generalized_momentum[1]);
        let angular_about_base = self.generalized_momentum[2];
        let angular_about_com = angular_about_base - cross(&self.center_m, &linear);
        Momentum { linear, angular_about_base, angular_about_com }
    }
}

/// `H v` by the two sweeps of inverse dynamics with velocities in the accelerations' place.
#[inline(always)]
fn whole<const B: usize>(model: &Model, state: &State) -> Whole {
    let chain = Chain::<B>::at(model, &state.q);
    let rate = absolute::<B>(&state.v);
    let lumps = &model.lumps;
    let start = Vector2::new(state.v[0], state.v[1]);
    let mut velocity = start;
    let mut root: Vector2<f64> = Vector2::zeros();
    let mut moment = [0.0; B];
    let mut inertia = 0.0;
    for i in 0..B {
        moment[i] = lumps.j[i] * rate[i] + cross(&chain.s[i], &velocity);
        velocity += rate[i] * perp(&chain.d[i]);
        // Steiner: every body's share is seen from its root, which lies `root` away from the base origin.
        inertia += lumps.j[i] + 2.0 * chain.s[i].dot(&root);
        root += chain.d[i];
    }
    let mut momentum = Coordinates::zeros();
    let mut beyond = Vector2::zeros();
    let mut first_moment: Vector2<f64> = Vector2::zeros();
    let mut total = 0.0;
    for i in (0..B).rev() {
        total += moment[i] + cross(&chain.d[i], &beyond);
        beyond += rate[i] * perp(&chain.s[i]);
        first_moment += chain.s[i];
        momentum[2 + i] = total;
        if i > 0 {
            momentum[2 + i] += lumps.rotor[i] * state.v[2 + i];
        }
    }
    let linear = beyond + lumps.total_mass * start;
    momentum[0] = linear.x;
    momentum[1] = linear.y;
    let center = first_moment * lumps.per_mass;
    let inertia_kg_m2 = inertia - center.dot(&first_moment);
    Whole { generalized_momentum: momentum, center_m: center, inertia_kg_m2 }
}
