//! How the sensors' noise enters the residuals of one instant.
//!
//! The angle of the base is off by the same amount for the centre of mass, for the base's turn and for the end-effector seen
//! from the base; so are a joint's angle and the base's position. Residuals of one instant therefore share errors, and count
//! for less than their number. Those of the end-effector, which nothing but noise disturbs, are made independent by the
//! Cholesky factor of their covariance; from the others, which drift, what they say of the noise is taken off.

use fss_experiments::measured::{Poses, Run};
use fss_multibody::{Coordinates, Model};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Residuals of one instant: centre of mass x and y, angle, end-effector x, y and angle.
const ROWS: usize = 6;

/// Standard deviations of single samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise {
    pub(super) position_m: f64,
    pub(super) angle_rad: f64,
    pub(super) encoder_rad: f64,
}

impl Noise {
    /// What fast motion capture says of its own noise: third differences of the samples, in which motion vanishes; `guess`
    /// where samples are too rare.
    pub(super) fn of(runs: &[Run], guess: [f64; 3]) -> Self {
        let found = |component: fn(&[f64; 3]) -> f64| {
            let mut sizes: Vec<f64> = runs
                .iter()
                .flat_map(|run| [&run.base_pose, &run.ee_pose])
                .flatten()
                .filter(|poses| is_fast(poses))
                .flat_map(|poses| poses.values.windows(4).map(|w| third(w, component).abs()))
                .collect();
            sizes.sort_by(f64::total_cmp);
            // The variance of 1, -3, 3, -1; the median of a normal variable's size.
            sizes.get(sizes.len() / 2).map(|median| 1.4826 * median / 20_f64.sqrt()).filter(|sd| *sd > 0.0)
        };
        Self {
            position_m: found(|pose| pose[0]).unwrap_or(guess[0]),
            angle_rad: found(|pose| pose[2]).unwrap_or(guess[1]),
            encoder_rad: guess[2],
        }
    }
}

fn is_fast(poses: &Poses) -> bool {
    poses.t_s.len() > 100
        && poses.t_s.last().zip(poses.t_s.first()).is_some_and(|(b, a)| (b - a) / (poses.t_s.len() as f64) < 0.03)
}

fn third(w: &[[f64; 3]], component: fn(&[f64; 3]) -> f64) -> f64 {
    let v = |k: usize| component(&w[k]);
    v(3) - 3.0 * v(2) + 3.0 * v(1) - v(0)
}

/// The noise of one instant: that of the end-effector, and what is left of the others once the end-effector's is known.
#[derive(Clone, Debug)]
pub(super) struct Mixing {
    /// Covariance of centre of mass and angle, given the end-effector's residuals: m^2, rad^2.
    pub(super) rest: Matrix3<f64>,
    /// What the end-effector's residuals say of them.
    from_tip: Matrix3<f64>,
    /// Inverse of the Cholesky factor of the end-effector's covariance.
    whiten_tip: Matrix3<f64>,
}

impl Mixing {
    /// At a configuration; `share` is the variance of the averaged poses over that of one sample.
    pub(super) fn new(model: &Model, q: &Coordinates, tip: Option<[f64; 3]>, noise: Noise, share: f64) -> Self {
        let n = model.link_count();
        let mut covariance = SMatrix::<f64, ROWS, ROWS>::zeros();
        let mut add = |column: [f64; ROWS], variance: f64| {
            let column = SVector::<f64, ROWS>::from(column);
            covariance += column * column.transpose() * variance;
        };
        let (sin, cos) = q[2].sin_cos();
        let (p, a) = (share * noise.position_m.powi(2), share * noise.angle_rad.powi(2));
        let arm = model.center_of_mass(q) - q.fixed_rows::<2>(0);
        let [tx, ty, _] = tip.unwrap_or_default();
        add([1.0, 0.0, 0.0, -cos, sin, 0.0], p);
        add([0.0, 1.0, 0.0, -sin, -cos, 0.0], p);
        add([-arm.y, arm.x, 1.0, ty, -tx, -1.0], a);
        add([0.0, 0.0, 0.0, 1.0, 0.0, 0.0], p);
        add([0.0, 0.0, 0.0, 0.0, 1.0, 0.0], p);
        add([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], a);
        let reaction = model.reaction_vector(q);
        for i in 0..n {
            let mut moved = *q;
            moved[3 + i] += 1e-5;
            let center = (model.center_of_mass(&moved) - model.center_of_mass(q)) / 1e-5;
            moved.fixed_rows_mut::<3>(0).fill(0.0);
            let mut held = *q;
            held.fixed_rows_mut::<3>(0).fill(0.0);
            let tip = (model.end_effector(&moved) - model.end_effector(&held)) / 1e-5;
            add([center.x, center.y, -reaction[i], -tip.x, -tip.y, -tip.z], noise.encoder_rad.powi(2));
        }
        let block = |r: usize, c: usize| Matrix3::from_fn(|i, j| covariance[(r + i, c + j)]);
        let (own, cross, of_tip) = (block(0, 0), block(0, 3), block(3, 3));
        let factor = of_tip.cholesky().filter(|_| tip.is_some());
        let Some(factor) = factor else {
            return Self { rest: own, from_tip: Matrix3::zeros(), whiten_tip: Matrix3::identity() };
        };
        let from_tip = cross * factor.inverse();
        let whiten_tip = factor.l().try_inverse().unwrap_or_else(Matrix3::identity);
        Self { rest: own - from_tip * cross.transpose(), from_tip, whiten_tip }
    }

    /// Centre of mass and angle less what the end-effector's residuals say of their noise.
    pub(super) fn less_tip(&self, residuals: [f64; 3], tip: Option<[f64; 3]>) -> Vector3<f64> {
        Vector3::from(residuals) - tip.map_or_else(Vector3::zeros, |tip| self.from_tip * Vector3::from(tip))
    }

    /// The end-effector's residuals, of variance one and without correlation.
    pub(super) fn tip_apart(&self, tip: [f64; 3]) -> [f64; 3] {
        (self.whiten_tip * Vector3::from(tip)).into()
    }
}
