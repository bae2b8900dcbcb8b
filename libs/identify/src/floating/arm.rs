//! Motion of the arm under what its drives and encoders really are.
//!
//! Telemetry shows motors through encoders; the base feels links. Between them stand the encoder's scale and offset, the
//! drive's kinematic error, its wind-up and its play. Wind-up follows the torque that the drive passes on, which the motion
//! itself tells. Within its play the link goes on as it was, until the motor's teeth take it along again.

use super::drive::free_inertia;
use super::swing::Swings;
use super::telemetry::{Reading, readings};

use crate::trial::Trial;
use fss_experiments::measured::Run;
use fss_multibody::{Coordinates, JointVector, Model, State};
use fss_plant::{Grid, JointPhysics, JointSample, Rollout, Servo, ValveHistory};
use nalgebra::Vector3;

/// Share of its speed with which a link comes back from the motor's teeth. Teeth are taken for rigid, which is false: a drive's
/// stiffness and damping make the share another one at each stroke, from 0 to nearly 1. A nearly plastic stroke stands for all.
const RESTITUTION: f64 = 0.1;
/// Each round leaves a fifth of what the one before did, where an error has 30 mrad and six periods a turn.
const LEAD_ROUNDS: usize = 8;

/// The joints on a grid.
#[derive(Clone, Debug)]
pub(crate) struct ArmMotion {
    /// Link angles and rates.
    pub(crate) samples: Vec<JointSample>,
    /// Accelerations, rad/s2.
    pub(crate) acceleration: Vec<JointVector>,
    /// Variances of angles, rates and accelerations.
    pub(crate) variance: Vec<[JointVector; 3]>,
}

/// What stays the same whatever the plant is: the run's grid, and readings and torques under the plant as given.
pub(crate) struct Arm {
    grid_s: Vec<f64>,
    ages_s: Vec<f64>,
    readings: Vec<Vec<Reading>>,
    loads: Vec<Load>,
    swings: Swings,
}

/// What a drive carries where it follows its motor.
#[derive(Clone, Copy, Debug)]
struct Load {
    /// Torques that the drives pass on to move the arm, N m. What thrust adds is not in it: the servos give way to that between
    /// two reports, and who counted it would find soft drives where the servos are soft.
    torque: JointVector,
    /// Accelerations relative to its motor that each link would have, all other joints being held, if its drive let go: of
    /// what moves the arm, and of thrust, rad/s2.
    free_acceleration: JointVector,
}

impl Arm {
    pub(crate) fn new(trial: &Trial, rollout: &Rollout, run: &Run, grid_s: Vec<f64>) -> Self {
        let plant = &trial.plant;
        let physics = rollout.physics(0.0);
        let ages_s: Vec<f64> = (0..plant.link_count()).map(|i| physics.sensors.link_age_s(i)).collect();
        let readings = (0..plant.link_count())
            .map(|i| readings(run, i, &plant.sensors, &|t| rollout.physics(t).sensors.link_age_s(i), &grid_s))
            .collect();
        let swings = Swings::new(trial, ages_s.clone());
        let mut arm = Self { grid_s, ages_s, readings, loads: Vec::new(), swings };
        let motion = arm.motion(trial, rollout, run);
        if let Ok(model) = physics.model(0.0) {
            let pushes = pushes(rollout, run, &arm.grid_s, &motion);
            let moments = motion.samples.iter().zip(&motion.acceleration).zip(&pushes);
            arm.loads =
                moments.map(|((sample, acceleration), push)| load(&model, sample, acceleration, push)).collect();
        }
        arm
    }

    /// The motion of the links where `rollout` is what really acts.
    pub(crate) fn motion(&self, trial: &Trial, rollout: &Rollout, run: &Run) -> ArmMotion {
        let n = self.grid_s.len();
        let swing = self.swings.of(trial, run, &self.grid_s);
        let mut out = ArmMotion {
            samples: vec![JointSample { q_rad: JointVector::zeros(), qd_rad_s: JointVector::zeros() }; n],
            acceleration: vec![JointVector::zeros(); n],
            variance: vec![[JointVector::zeros(); 3]; n],
        };
        for joint in 0..self.ages_s.len() {
            let age = |t: f64| rollout.physics(t).sensors.link_age_s(joint);
            let moved = self.grid_s.iter().step_by(50).any(|t| (age(*t) - self.ages_s[joint]).abs() > 1e-12);
            let (told, known) =
                swing.as_ref().map_or((run, &self.readings[joint]), |s| (&s.expected, &s.readings[joint]));
            let fresh = moved.then(|| readings(told, joint, &trial.plant.sensors, &age, &self.grid_s));
            let readings = fresh.as_ref().unwrap_or(known);
            let mut beyond: Vec<f64> = Vec::with_capacity(n);
            let mut play = Play::default();
            for (k, reading) in readings.iter().enumerate() {
                let physics = rollout.physics(self.grid_s[k]);
                let drive = &physics.joints[joint];
                let motor = |i: usize| reading.value[i] / drive.encoder_scale;
                let m = motor(0) - drive.encoder_offset_rad / drive.encoder_scale;
                let load = self.loads.get(k);
                let (torque, free) = load.map_or((0.0, 0.0), |l| (l.torque[joint], l.free_acceleration[joint]));
                play.advance(self.grid_s[k] - self.grid_s[k.saturating_sub(1)], free, drive.backlash_rad);
                let swung = swing.as_ref().and_then(|s| s.ahead(joint, k, drive));
                let wound = if swung.is_some() { 0.0 } else { wind_up(drive, &physics.servos[joint], torque) };
                let ahead = kinematic_lead(drive, m) + play.ahead_rad - wound;
                beyond.push(ahead);
                let [angle, rate, acceleration] = swung.unwrap_or_default();
                out.samples[k].q_rad[joint] = m + ahead + angle;
                out.samples[k].qd_rad_s[joint] = motor(1) + rate;
                out.acceleration[k][joint] = motor(2) + acceleration;
                for i in 0..3 {
                    out.variance[k][i][joint] = reading.variance[i];
                }
            }
            self.differentiate(rollout, joint, &beyond, &mut out);
        }
        out
    }

    /// Adds the rates at which links get ahead of their motors.
    fn differentiate(&self, rollout: &Rollout, joint: usize, beyond: &[f64], out: &mut ArmMotion) {
        for k in 1..beyond.len().saturating_sub(1) {
            let drive = &rollout.physics(self.grid_s[k]).joints[joint];
            if drive.is_elastic() || drive.kinematic_error_rad != 0.0 {
                let dt = self.grid_s[k + 1] - self.grid_s[k - 1];
                out.samples[k].qd_rad_s[joint] += (beyond[k + 1] - beyond[k - 1]) / dt;
            }
        }
    }
}

/// How far ahead of its motor the kinematic error puts a link, rad: the error is one of the link's own angle
/// ([`JointPhysics::kinematic_error_rad`]), which is found by going there.
fn kinematic_lead(drive: &JointPhysics, motor_rad: f64) -> f64 {
    if drive.kinematic_error_rad == 0.0 {
        return 0.0;
    }
    let lead = |ahead: f64| drive.kinematic_error_rad * (drive.kinematic_cycles * (motor_rad + ahead)).sin();
    (0..LEAD_ROUNDS).fold(0.0, |ahead, _| lead(ahead))
}

/// How far an elastic drive that passes on `torque` is wound up, rad.
fn wind_up(drive: &JointPhysics, servo: &Servo, torque: f64) -> f64 {
    if drive.is_elastic() { torque / drive.stiffness_n_m_rad.unwrap_or(servo.gear_stiffness_n_m_rad) } else { 0.0 }
}

/// Where a link is within its play.
#[derive(Clone, Copy, Debug, Default)]
struct Play {
    /// Ahead of its motor, rad.
    ahead_rad: f64,
    rate_rad_s: f64,
}

impl Play {
    /// Goes on for `dt_s` with the acceleration that the link has relative to its motor where nothing holds it, rad/s2.
    fn advance(&mut self, dt_s: f64, acceleration: f64, gap_rad: f64) {
        let half = 0.5 * gap_rad;
        self.rate_rad_s += dt_s * acceleration;
        self.ahead_rad += dt_s * self.rate_rad_s;
        if self.ahead_rad.abs() >= half {
            self.ahead_rad = half.copysign(self.ahead_rad);
            self.rate_rad_s *= -RESTITUTION;
        }
    }
}

/// Mean thrust around each point of the grid, base axes `[N, N, N m]`.
fn pushes(rollout: &Rollout, run: &Run, grid_s: &[f64], motion: &ArmMotion) -> Vec<Vector3<f64>> {
    let [first, second, ..] = grid_s else { return vec![Vector3::zeros(); grid_s.len()] };
    let step_s = 2.0 * (second - first);
    let grid = Grid { start_s: *first, step_s, steps: grid_s.len() / 2 };
    let thrust = rollout.thrust(&ValveHistory::new(run.thrust_levels.clone()), &grid, &motion.samples);
    (0..grid_s.len()).map(|half| thrust.get(half / 2).map_or_else(Vector3::zeros, |push| (*push).into())).collect()
}

/// What the drives carry while the base follows the arm, `push` at its base and nothing else from outside.
fn load(model: &Model, sample: &JointSample, acceleration: &JointVector, push: &Vector3<f64>) -> Load {
    let mut state = State::at_rest(Coordinates::zeros());
    state.q.fixed_rows_mut::<{ fss_multibody::MAX_LINKS }>(3).copy_from(&sample.q_rad);
    state.v.fixed_rows_mut::<{ fss_multibody::MAX_LINKS }>(3).copy_from(&sample.qd_rad_s);
    let twist = model.base_twist(&state.q, &sample.qd_rad_s, &Vector3::zeros());
    state.v.fixed_rows_mut::<3>(0).copy_from(&twist);
    let torque_with = |push: &Vector3<f64>| -> JointVector {
        let acc = model.prescribed_dynamics(&state, acceleration, push);
        model.inverse_dynamics(&state, &acc).fixed_rows::<{ fss_multibody::MAX_LINKS }>(3).into_owned()
    };
    let inertia = free_inertia(&model.mass_matrix(&state.q)).diagonal();
    let mobility = inertia.map(|own| if own > 0.0 { 1.0 / own } else { 0.0 });
    Load { torque: torque_with(&Vector3::zeros()), free_acceleration: -torque_with(push).component_mul(&mobility) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial::Trial;
    use fss_plant::{Effect, Plant};

    #[test]
    fn a_motor_is_where_the_kinematic_error_of_its_links_angle_puts_it() -> Result<(), Box<dyn std::error::Error>> {
        let plant = Plant::parse(include_str!("../../../../deploy/etc/plants/fss.toml"))?;
        let error = Effect::new("drive_kinematic_error")?.at(2).with(&[0.004, 8.0]);
        let physics = Trial::of(&plant).with(&error).rollout()?.physics(0.0).joints[1];
        for motor_rad in [-1.0, 0.0, 0.1, 0.7] {
            let link_rad = motor_rad + kinematic_lead(&physics, motor_rad);
            let back_rad = link_rad - 0.004 * (8.0 * link_rad).sin();
            assert!((back_rad - motor_rad).abs() < 1e-8, "{back_rad} rad, not {motor_rad}");
        }
        Ok(())
    }
}
