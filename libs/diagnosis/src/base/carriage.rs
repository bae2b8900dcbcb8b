//! Base and arm as one body along the measured path.

use crate::path::EncoderPath;
use fss_multibody::{Coordinates, JointVector, MAX_DOF, Model, ModelError, State};
use fss_plant::{JointSample, Physics};

/// Base and arm as one body at the edges of the grid, base axes.
pub(super) struct Carriage {
    pub(super) mass_kg: f64,
    /// Centre of mass (m).
    pub(super) com_m: Vec<[f64; 2]>,
    /// Locked inertia about it (kg m^2).
    pub(super) inertia_kg_m2: Vec<f64>,
    /// Angular momentum of the joint rates about it (kg m^2/s).
    pub(super) joint_momentum: Vec<f64>,
    /// Its mean over each cell: of what the joints turn by within it, for a servo's rate jumps there.
    pub(super) mean_joint_momentum: Vec<f64>,
    pub(super) samples: Vec<JointSample>,
}

/// Poses and velocities at the edges of the grid.
pub(super) struct Path {
    pub(super) pose: Vec<[f64; 3]>,
    pub(super) velocity: Vec<[f64; 3]>,
    /// Sine and cosine of the heading at each edge, and of the mean heading of each cell.
    pub(super) turn: Vec<(f64, f64)>,
    pub(super) mean_turn: Vec<(f64, f64)>,
}

impl Path {
    pub(super) fn new(pose: Vec<[f64; 3]>, velocity: Vec<[f64; 3]>) -> Self {
        let turn = pose.iter().map(|p| p[2].sin_cos()).collect();
        let mean_turn = pose.windows(2).map(|ends| (0.5 * (ends[0][2] + ends[1][2])).sin_cos()).collect();
        Self { pose, velocity, turn, mean_turn }
    }
}

impl Carriage {
    /// With these encoders, at the edges of their grid.
    pub(super) fn new(physics: &Physics, encoders: &EncoderPath, step_s: f64) -> Result<Self, ModelError> {
        let model = physics.model(0.0)?;
        let (angle, rate) = encoders.unread(physics);
        let moves = !physics.links.is_empty();
        let mut out = Self {
            mass_kg: model.total_mass_kg(),
            com_m: Vec::with_capacity(angle.len()),
            inertia_kg_m2: Vec::with_capacity(angle.len()),
            joint_momentum: Vec::with_capacity(angle.len()),
            mean_joint_momentum: if moves { mean_momentum(&model, &angle, step_s) } else { vec![0.0; angle.len()] },
            samples: Vec::with_capacity(angle.len()),
        };
        let at_rest = model.whole(&State::at_rest(Coordinates::zeros()));
        for (q_rad, qd_rad_s) in angle.into_iter().zip(rate) {
            out.samples.push(JointSample { q_rad, qd_rad_s });
            let state = || State { q: joints_only(&q_rad), v: joints_only(&qd_rad_s) };
            let whole = if moves { model.whole(&state()) } else { at_rest };
            out.com_m.push([whole.center_m.x, whole.center_m.y]);
            out.inertia_kg_m2.push(whole.inertia_kg_m2);
            out.joint_momentum.push(whole.momentum().angular_about_com);
        }
        Ok(out)
    }
}

/// Mean angular momentum of the joints' rates about the centre of mass over each cell (kg m^2/s).
fn mean_momentum(model: &Model, angle: &[JointVector], step_s: f64) -> Vec<f64> {
    let of_cell = |ends: &[JointVector]| {
        let (from, to) = (ends[0], ends[1]);
        let state = State { q: joints_only(&(0.5 * (from + to))), v: joints_only(&((to - from) / step_s)) };
        model.momentum(&state).angular_about_com
    };
    angle.windows(2).map(of_cell).collect()
}

pub(super) fn rotated((sin, cos): (f64, f64), [x, y]: [f64; 2]) -> [f64; 2] {
    [cos * x - sin * y, sin * x + cos * y]
}

pub(super) fn joints_only(joints: &JointVector) -> Coordinates {
    let mut q = Coordinates::zeros();
    q.fixed_rows_mut::<{ MAX_DOF - 3 }>(3).copy_from(joints);
    q
}
