//! Dynamics and momentum linear in the inertial parameters.
//!
//! Of each body: mass `m`, first moments `m c_x`, `m c_y` and moment of inertia `I_o`, about the origin of the body's own
//! frame (link: its joint, x towards the next; base: its frame). Lengths and angles are taken as known.

use nalgebra::{SMatrix, SVector, Vector2};

use crate::chain::{Chain, absolute, cross, perp};
use crate::derivatives::Motion;
use crate::{Coordinates, MAX_BODIES, MAX_DOF, Model, ModelError, State};

/// Inertial parameters of one body about the origin of its own frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Inertial {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Mass times centre of mass, kg m.
    pub first_moment_kg_m: [f64; 2],
    /// Moment of inertia about the origin, kg m^2.
    pub inertia_about_origin_kg_m2: f64,
}

/// `[m, m c_x, m c_y, I_o]` of base, link 1, link 2 .., zero beyond the last link.
pub type InertialVector = SVector<f64, { 4 * MAX_BODIES }>;
/// Generalized forces per entry of an [`InertialVector`].
pub type Regressor = SMatrix<f64, MAX_DOF, { 4 * MAX_BODIES }>;
/// `[Px, Py, L about the base origin]` per entry of an [`InertialVector`].
pub type MomentumRegressor = SMatrix<f64, 3, { 4 * MAX_BODIES }>;

impl Model {
    /// The inertial parameters of body `body` (0 the base, `i` link `i`); zero for a body that is not there.
    pub fn inertial(&self, body: usize) -> Inertial {
        if body > self.link_count() {
            return Inertial::default();
        }
        let (mass, c) = (self.lumps.mass[body], self.lumps.c[body]);
        Inertial {
            mass_kg: mass,
            first_moment_kg_m: [mass * c.x, mass * c.y],
            inertia_about_origin_kg_m2: self.lumps.inertia[body] + mass * c.norm_squared(),
        }
    }

    /// The inertial parameters of all bodies.
    pub fn inertial_vector(&self) -> InertialVector {
        let mut all = InertialVector::zeros();
        for body in 0..=self.link_count() {
            let inertial = self.inertial(body);
            let [x, y] = inertial.first_moment_kg_m;
            let four = [inertial.mass_kg, x, y, inertial.inertia_about_origin_kg_m2];
            all.fixed_rows_mut::<4>(4 * body).copy_from_slice(&four);
        }
        all
    }

    /// The mechanism with these inertial parameters, its geometry and rotors as they are. The centre of mass of a body
    /// without mass stays where it is.
    ///
    /// # Errors
    /// [`ModelError`] where no mechanism has them: negative mass, or less inertia than the first moments need.
    pub fn with_inertial_vector(&self, all: &InertialVector) -> Result<Self, ModelError> {
        let mut base = *self.base();
        let own = Own::from(&all.fixed_rows::<4>(0).into_owned(), self.lumps.c[0]);
        base.mass_kg = own.mass;
        base.com_m = own.c.into();
        base.inertia_kg_m2 = own.inertia;
        let mut links = self.links;
        for (i, link) in links.iter_mut().enumerate().take(self.link_count()) {
            let own = Own::from(&all.fixed_rows::<4>(4 * (i + 1)).into_owned(), self.lumps.c[i + 1]);
            link.mass_kg = own.mass;
            link.com_to_next_joint_m = link.length_m - own.c.x;
            link.com_offset_m = own.c.y;
            link.inertia_kg_m2 = own.inertia;
        }
        Self::new(base, &links[..self.link_count()], self.gravity_m_s2())
    }

    /// Regressor `Y`: `inverse_dynamics = Y pi + (rotor inertia times joint acceleration)` for every vector `pi` of
    /// inertial parameters, gravity included.
    pub fn inverse_dynamics_regressor(&self, state: &State, acc: &Coordinates) -> Regressor {
        let motion = Motion::<MAX_BODIES>::of(self, state, acc);
        let mut regressor = Regressor::zeros();
        for body in 0..=self.link_count() {
            let columns = [
                motion.by_mass(body),
                motion.by_first_moment(body, &Vector2::x()),
                motion.by_first_moment(body, &Vector2::y()),
                motion.by_inertia(body),
            ];
            for (k, column) in columns.iter().enumerate() {
                regressor.set_column(4 * body + k, column);
            }
        }
        regressor
    }

    /// Regressor of the momentum: `[Px, Py, L about the base origin] = Y pi`.
    pub fn momentum_regressor(&self, state: &State) -> MomentumRegressor {
        let chain = Chain::<MAX_BODIES>::at(self, &state.q);
        let rate = absolute::<MAX_BODIES>(&state.v);
        let mut regressor = MomentumRegressor::zeros();
        let mut root = Vector2::zeros();
        let mut velocity = Vector2::new(state.v[0], state.v[1]);
        for body in 0..=self.link_count() {
            let mut set = |k: usize, linear: Vector2<f64>, angular: f64| {
                regressor.set_column(4 * body + k, &nalgebra::Vector3::new(linear.x, linear.y, angular));
            };
            set(0, velocity, cross(&root, &velocity));
            for (k, direction) in [Vector2::x(), Vector2::y()].iter().enumerate() {
                let u = chain.turned(body, direction);
                let turning = rate[body] * perp(&u);
                set(1 + k, turning, cross(&root, &turning) + cross(&u, &velocity));
            }
            set(3, Vector2::zeros(), rate[body]);
            root += chain.d[body];
            velocity += rate[body] * perp(&chain.d[body]);
        }
        regressor
    }
}

/// Mass, centre of mass and inertia about it.
struct Own {
    mass: f64,
    c: Vector2<f64>,
    inertia: f64,
}

impl Own {
    fn from(four: &SVector<f64, 4>, c_without_mass: Vector2<f64>) -> Self {
        let mass = four[0];
        let c = if mass == 0.0 { c_without_mass } else { Vector2::new(four[1], four[2]) / mass };
        Self { mass, c, inertia: four[3] - mass * c.norm_squared() }
    }
}
