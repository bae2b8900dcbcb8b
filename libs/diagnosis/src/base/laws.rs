//! Forces on the base that depend on its velocity, such as friction.
//!
//! They act at the velocity u that all forces leave, not at the measured one: where friction holds the base, the sign of the measured
//! velocity is that of its noise. From the middle of one cell to that of the next it is an implicit Euler step of length h,
//!
//! ```text
//! u = u_free + h A law(u),   A = [1/M + s s'/I, s/I; s'/I, 1/I]
//! ```
//!
//! with u_free the velocity that the other forces leave, and A the change of velocity per impulse at the base's origin; s is what a rate
//! of the base adds to its origin's velocity beside that of the centre of mass. What else acts need not all be known: u_free is
//! drawn to the measured velocity as far as that is told from it. Within its noise the draw is slow against what friction does, so that
//! what rests stays at rest; far beyond, it takes the time over which a measured velocity is a mean.

use super::carriage::{Carriage, Path, rotated};
use crate::path::PosePath;
use fss_plant::{BaseMotion, Physics};
use nalgebra::{Matrix3, Vector3};

/// Standard deviations at which a measured velocity is told from another: smoothing blurs sudden changes by several.
const TOLD_APART: f64 = 6.0;
/// Steps of Newton's method at the most, the change of velocity at which it ends, and that of its differences (m/s, rad/s).
const ITERATIONS: usize = 20;
const STANDS_STILL: f64 = 1e-9;
const DIFFERENCE: f64 = 1e-7;

/// The base in one cell of the grid.
pub(super) struct Cell {
    /// Pose in its middle, and the measured velocity there.
    pub(super) motion: BaseMotion,
    /// Force and torque at the base's origin but for those of laws, table axes (N, N, N m).
    pub(super) wrench: [f64; 3],
    /// Centre of mass from the base's origin, table axes (m).
    pub(super) com_m: [f64; 2],
    pub(super) inertia_kg_m2: f64,
}

/// Laws that act on the base, and the momentum that all forces have left so far.
pub(super) struct Laws<'a> {
    physics: &'a Physics,
    carriage: &'a Carriage,
    measured: &'a PosePath,
    /// Velocity of the centre of mass (m/s, m/s) and angular momentum (kg m^2/s) in the middle of the cell before; `None` where no law
    /// depends on the velocity.
    momentum: Option<Vector3<f64>>,
    /// What other forces than laws change of it there per second.
    rate: Vector3<f64>,
}

impl<'a> Laws<'a> {
    /// Of a base that sets out in a cell as its measured path does where that is told from rest.
    pub(super) fn new(
        physics: &'a Physics,
        (carriage, measured, path): (&'a Carriage, &'a PosePath, &Path),
        first: usize,
    ) -> Self {
        let mut laws = Self { physics, carriage, measured, momentum: None, rate: Vector3::zeros() };
        if physics.base_laws.iter().any(|law| law.depends_on_velocity) {
            let start = laws.drawn(Vector3::zeros(), &path.velocity[first], first, f64::INFINITY);
            let com_m = rotated(path.turn[first], carriage.com_m[first]);
            let drift = laws.drift(first, path.pose[first][2]);
            let (inertia, joints) = (carriage.inertia_kg_m2[first], carriage.joint_momentum[first]);
            laws.momentum = Some(momentum(&start, com_m, drift, inertia, joints));
        }
        laws
    }

    /// What they put on the base in a cell (N, N, N m).
    pub(super) fn wrench(&mut self, k: usize, cell: &Cell) -> [f64; 3] {
        let Some(before) = self.momentum else { return self.physics.base_wrench(&cell.motion) };
        let (dt, [cx, cy]) = (self.measured.grid.step_s, cell.com_m);
        let (mass, inertia) = (self.carriage.mass_kg, cell.inertia_kg_m2);
        let drift = self.drift(k, cell.motion.pose[2]);
        let joints = self.carriage.mean_joint_momentum[k];
        let [fx, fy, torque] = cell.wrench;
        let [gx, gy] = self.physics.gravity_m_s2;
        let now = Vector3::new(fx / mass + gx, fy / mass + gy, torque - (cx * fy - cy * fx));
        let free = before + 0.5 * dt * (std::mem::replace(&mut self.rate, now) + now);
        let rate = (free.z - joints) / inertia;
        let free = Vector3::new(free.x + rate * cy - drift[0], free.y - rate * cx - drift[1], rate);
        let free = self.drawn(free, &cell.motion.velocity, k, dt);
        let lever = Vector3::new(cy, -cx, 1.0);
        let mobility = dt
            * (Matrix3::from_diagonal(&Vector3::new(1.0 / mass, 1.0 / mass, 0.0))
                + lever * lever.transpose() / inertia);
        let at = |u: &Vector3<f64>| {
            Vector3::from(self.physics.base_wrench(&BaseMotion { velocity: (*u).into(), ..cell.motion }))
        };
        let u = implicit(&free, &mobility, at);
        self.momentum = Some(momentum(&u, cell.com_m, drift, inertia, joints));
        at(&u).into()
    }

    /// Velocity of the centre of mass in the base (m/s), table axes.
    fn drift(&self, k: usize, heading: f64) -> [f64; 2] {
        let (from, to) = (self.carriage.com_m[k], self.carriage.com_m[k + 1]);
        let dt = self.measured.grid.step_s;
        rotated(heading.sin_cos(), [(to[0] - from[0]) / dt, (to[1] - from[1]) / dt])
    }

    /// A velocity drawn to the measured one within a time, as far as that is told from it.
    fn drawn(&self, mut u: Vector3<f64>, measured: &[f64; 3], k: usize, within_s: f64) -> Vector3<f64> {
        let sd = &self.measured.sd[k];
        let away = Vector3::from(*measured) - u;
        let squares = std::array::from_fn::<_, 3, _>(|i| (away[i] / sd[i][1]).powi(2));
        for (axes, apart) in [(0..2, squares[0] + squares[1]), (2..3, squares[2])] {
            let told = (apart / TOLD_APART.powi(2)).min(1.0);
            for i in axes {
                let [pose, velocity] = sd[i];
                u[i] += told * (within_s * velocity / pose).min(1.0) * away[i];
            }
        }
        u
    }
}

/// Velocity of the centre of mass and angular momentum of a base that moves so.
fn momentum(u: &Vector3<f64>, [cx, cy]: [f64; 2], drift: [f64; 2], inertia: f64, joints: f64) -> Vector3<f64> {
    Vector3::new(u.x - u.z * cy + drift[0], u.y + u.z * cx + drift[1], inertia * u.z + joints)
}

/// The velocity that obeys `u = free + mobility law(u)`: Newton's method from rest, where resistance is steepest, so that it comes to
/// the answer from one side.
fn implicit(free: &Vector3<f64>, mobility: &Matrix3<f64>, law: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Vector3<f64> {
    let mut u = Vector3::zeros();
    for _ in 0..ITERATIONS {
        let here = law(&u);
        let column = |i: usize| {
            let mut moved = u;
            moved[i] += DIFFERENCE;
            (law(&moved) - here) / DIFFERENCE
        };
        let slope = Matrix3::from_columns(&[column(0), column(1), column(2)]);
        let residual = u - free - mobility * here;
        let Some(inverse) = (Matrix3::identity() - mobility * slope).try_inverse() else { break };
        let step = inverse * residual;
        u -= step;
        if step.amax() < STANDS_STILL {
            break;
        }
    }
    u
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn friction_holds_what_it_can_and_slows_the_rest_by_its_size() {
        let mobility = Matrix3::identity() * 1e-3;
        let rubs = |u: &Vector3<f64>| -5.0 * u / (u.norm_squared() + 1e-12).sqrt();
        let held = implicit(&Vector3::new(4e-3, 0.0, 0.0), &mobility, rubs);
        assert!(held.norm() < 1e-5, "{held}");
        let slides = implicit(&Vector3::new(0.03, 0.04, 0.0), &mobility, rubs);
        assert!((slides - Vector3::new(0.027, 0.036, 0.0)).norm() < 1e-6, "{slides}");
    }

    #[test]
    fn linear_drag_is_exact_in_one_step() {
        let drags = |u: &Vector3<f64>| -2.0 * u;
        let u = implicit(&Vector3::new(1.0, -2.0, 0.5), &(Matrix3::identity() * 0.25), drags);
        assert!((u - Vector3::new(1.0, -2.0, 0.5) / 1.5).norm() < 1e-9, "{u}");
    }
}
