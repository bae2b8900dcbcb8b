//! What joints, drives and motion capture would have read along the measured path.
//!
//! The path is what encoders said. Where the motors were follows by un-reading it, where the links were by what stands
//! between motor and link; torques follow from the motion of the links, currents from torques and friction.

use super::path::MeasuredPath;
use super::track::Track;
use crate::friction::direction;
use crate::memo::{are_pushed_alike, are_steady};
use fss_experiments::measured::Run;
use fss_multibody::{Coordinates, JointVector, MAX_LINKS, Model, ModelError, State};
use fss_plant::{
    BaseMotion, Effect, Grid, JointPhysics, JointSample, Physics, Plant, Rollout, Sensors, Stream, ValveHistory,
};
use nalgebra::Vector3;
use std::sync::Arc;

/// Spacing of the thrust's samples, s: valves move in hundredths of a second.
const THRUST_STEP_S: f64 = 0.005;
/// Share of the nominal torque constant that a motor keeps: a current is finite whatever the motor gives for it.
const LEAST_TORQUE_CONSTANT: f64 = 0.01;

/// Motion of the base: pose and velocity, table frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct BaseState {
    pub(super) pose: [f64; 3],
    pub(super) velocity: [f64; 3],
}

/// Motion of the arm at one time.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArmState {
    /// Links: angles, rates, accelerations.
    pub(super) q_rad: JointVector,
    pub(super) qd_rad_s: JointVector,
    pub(super) qdd_rad_s2: JointVector,
    /// Rates of the motors seen at the joints, rad/s.
    pub(super) motor_rad_s: JointVector,
}

/// What the drives carried on the measured path, under the nominal plant; N m over time.
#[derive(Clone, Debug, Default)]
pub(super) struct Loads {
    tracks: Vec<Track>,
    /// Torque below which the side of a gear's teeth that is pressed is not known, N m.
    undecided_n_m: f64,
}

/// How far links are ahead of their motors on elastic drives.
#[derive(Clone, Debug)]
pub(super) enum WindUp<'a> {
    /// By what the drives carry, without swinging.
    OfLoads(&'a Loads),
    /// As simulated, and how well that is known.
    Simulated(Arc<Vec<[Track; 2]>>),
}

/// The plant with some effects, along the measured path of a run.
pub(super) struct Mechanics<'a> {
    path: &'a MeasuredPath,
    wind_up: WindUp<'a>,
    rollout: Rollout,
    thrust: ThrustSeries,
}

/// Mean thrust on the base in even steps, base axes about the base frame's origin.
#[derive(Clone, Debug, Default)]
pub(super) struct ThrustSeries {
    start_s: f64,
    values: Arc<[[f64; 3]]>,
}

/// Thrust of a run under the nominal plant, kept for plants whose thrusters are nominal.
#[derive(Clone, Debug)]
pub(super) struct NominalThrust {
    physics: Physics,
    series: ThrustSeries,
}

impl ThrustSeries {
    fn new(rollout: &Rollout, run: &Run, path: &MeasuredPath) -> Self {
        let times: Vec<f64> = path.grid_s().collect();
        let [start_s, .., end_s] = times[..] else { return Self::default() };
        if run.thrust_levels.is_empty() && rollout.physics(start_s).thrusters.iter().all(|t| t.leak_n == 0.0) {
            return Self::default();
        }
        let grid = Grid { start_s, step_s: THRUST_STEP_S, steps: ((end_s - start_s) / THRUST_STEP_S) as usize + 1 };
        let plume = rollout.physics(end_s).thrusters.iter().any(|t| t.plume_fraction != 0.0);
        let sample = |half: usize| {
            let t_s = start_s + 0.5 * THRUST_STEP_S * half as f64;
            let angle = |i: usize| path.joints.get(i).map_or(0.0, |track| track.at(t_s)[0]);
            JointSample { q_rad: JointVector::from_fn(|i, _| angle(i)), qd_rad_s: JointVector::zeros() }
        };
        let joints: Vec<JointSample> = if plume { (0..=2 * grid.steps).map(sample).collect() } else { vec![] };
        Self { start_s, values: rollout.thrust(&ValveHistory::new(run.thrust_levels.clone()), &grid, &joints).into() }
    }

    fn at(&self, t_s: f64) -> [f64; 3] {
        let step = ((t_s - self.start_s) / THRUST_STEP_S).max(0.0) as usize;
        self.values.get(step).copied().unwrap_or_default()
    }
}

impl NominalThrust {
    /// Of a run under a plant without effects.
    ///
    /// # Errors
    /// When the plant's masses are impossible.
    pub(super) fn new(plant: &Plant, run: &Run, path: &MeasuredPath) -> Result<Self, ModelError> {
        let rollout = Rollout::with(plant, &[])?;
        let series = ThrustSeries::new(&rollout, run, path);
        Ok(Self { physics: rollout.physics(0.0).clone(), series })
    }

    fn is_of(&self, physics: &Physics) -> bool {
        are_pushed_alike(&self.physics, physics)
    }
}

impl<'a> Mechanics<'a> {
    /// The plant with exactly these effects.
    ///
    /// # Errors
    /// When effects make a mass or an inertia impossible.
    pub(super) fn new(
        plant: &Plant,
        effects: &[Effect],
        (run, path, wind_up): (&Run, &'a MeasuredPath, WindUp<'a>),
        thrust: Option<&NominalThrust>,
    ) -> Result<Self, ModelError> {
        let rollout = Rollout::with(plant, effects)?;
        // An onset changes what acts during the run: thrust is then taken as it comes.
        let known = thrust.filter(|known| are_steady(effects) && known.is_of(rollout.physics(0.0)));
        let thrust = known.map_or_else(|| ThrustSeries::new(&rollout, run, path), |known| known.series.clone());
        Ok(Self { path, wind_up, rollout, thrust })
    }

    /// What acts at `t_s`.
    pub(super) fn physics(&self, t_s: f64) -> &Physics {
        self.rollout.physics(t_s)
    }

    /// The mechanism at `t_s`.
    pub(super) fn model(&self, t_s: f64) -> &Model {
        self.rollout.model(t_s)
    }

    /// The arm at the true time `t_s`.
    pub(super) fn arm(&self, t_s: f64) -> ArmState {
        let physics = self.physics(t_s);
        let zero = JointVector::zeros();
        let mut arm = ArmState { q_rad: zero, qd_rad_s: zero, qdd_rad_s2: zero, motor_rad_s: zero };
        for (i, (joint, track)) in physics.joints.iter().zip(&self.path.joints).enumerate() {
            let [reading, rate, acceleration] = track.at(t_s + physics.sensors.link_age_s(i));
            let scale = joint.encoder_scale;
            let motor = [(reading - joint.encoder_offset_rad) / scale, rate / scale, acceleration / scale];
            let mut link = through_gear(joint, motor);
            if joint.is_elastic() {
                let stiffness = joint.stiffness_n_m_rad.unwrap_or(physics.servos[i].gear_stiffness_n_m_rad);
                let [lead, lead_rate] = match &self.wind_up {
                    WindUp::OfLoads(loads) => loads.lead(i, joint, stiffness, t_s, self.path.step_s()),
                    WindUp::Simulated(tracks) => [0, 1].map(|order| tracks[i][0].at(t_s)[order]),
                };
                link[0] += lead;
                link[1] += lead_rate;
            }
            arm.motor_rad_s[i] = motor[1];
            (arm.q_rad[i], arm.qd_rad_s[i], arm.qdd_rad_s2[i]) = (link[0], link[1], link[2]);
        }
        arm
    }

    /// Standard deviation of a link's angle where it swings on an elastic drive, rad.
    pub(super) fn swing_sd(&self, i: usize, t_s: f64) -> f64 {
        match &self.wind_up {
            WindUp::Simulated(tracks) => tracks[i][1].at(t_s)[0],
            WindUp::OfLoads(_) => 0.0,
        }
    }

    /// The base at the true time `t_s`; at rest at the table's origin where it is clamped or was not measured.
    pub(super) fn base(&self, t_s: f64) -> BaseState {
        let physics = self.physics(t_s);
        let Some(base) = self.path.base.as_ref().filter(|_| !physics.base.clamped) else {
            return BaseState::default();
        };
        let sensors = &physics.sensors;
        let stamp_s = t_s + sensors.age_s(Stream::BasePose);
        let [x, y, theta] = [0, 1, 2].map(|axis| base[axis].at(stamp_s));
        let (sin, cos) = (-sensors.mocap_rotation_rad).sin_cos();
        let turn = |x: f64, y: f64| [cos * x - sin * y, sin * x + cos * y];
        let (marker, marker_velocity) = (turn(x[0], y[0]), turn(x[1], y[1]));
        let heading = theta[0] - sensors.mocap_rotation_rad - sensors.marker_yaw_rad;
        let (sin, cos) = heading.sin_cos();
        let [mx, my] = sensors.marker_offset_m;
        let arm = [cos * mx - sin * my, sin * mx + cos * my];
        BaseState {
            pose: [marker[0] - arm[0], marker[1] - arm[1], heading],
            velocity: [marker_velocity[0] + theta[1] * arm[1], marker_velocity[1] - theta[1] * arm[0], theta[1]],
        }
    }

    /// Thrust at the true time `t_s` in the base's frame, N, N and N m.
    pub(super) fn thrust(&self, t_s: f64) -> [f64; 3] {
        self.thrust.at(t_s)
    }

    /// How much of the joints' torques hangs on when within `half_s` of `t_s` they are read, because thrust changes there, N m.
    pub(super) fn thrust_change(&self, t_s: f64, half_s: f64, links: usize) -> JointVector {
        let steps = (2.0 * half_s / THRUST_STEP_S).ceil().max(1.0);
        let near = (0..=steps as usize).map(|k| self.thrust.at(t_s + half_s * (2.0 * k as f64 / steps - 1.0)));
        let (mut lower, mut upper) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for thrust in near {
            (0..3).for_each(|i| (lower[i], upper[i]) = (lower[i].min(thrust[i]), upper[i].max(thrust[i])));
        }
        let mut squares = JointVector::zeros();
        let mut still = None;
        for axis in (0..3).filter(|i| upper[*i] > lower[*i]) {
            let (base, arm) = (self.base(t_s), self.arm(t_s));
            let without = *still.get_or_insert_with(|| self.torques(t_s, &base, &arm, [0.0; 3]));
            let mut change = [0.0; 3];
            change[axis] = upper[axis] - lower[axis];
            let by = self.torques(t_s, &base, &arm, change) - without;
            (0..links).for_each(|i| squares[i] += by[i] * by[i]);
        }
        squares.map(f64::sqrt)
    }

    /// Torques that the drives pass on at the true time `t_s` for the arm to move so under a thrust in the base's frame, N m.
    pub(super) fn torques(&self, t_s: f64, base: &BaseState, arm: &ArmState, thrust: [f64; 3]) -> JointVector {
        let (physics, model) = (self.physics(t_s), self.model(t_s));
        let mut state = State::at_rest(Coordinates::zeros());
        state.q.fixed_rows_mut::<3>(0).copy_from_slice(&base.pose);
        state.v.fixed_rows_mut::<3>(0).copy_from_slice(&base.velocity);
        state.q.fixed_rows_mut::<MAX_LINKS>(3).copy_from(&arm.q_rad);
        state.v.fixed_rows_mut::<MAX_LINKS>(3).copy_from(&arm.qd_rad_s);
        if !physics.base.clamped && self.path.base.is_none() {
            let twist = model.base_twist(&state.q, &arm.qd_rad_s, &Vector3::zeros());
            state.v.fixed_rows_mut::<3>(0).copy_from(&twist);
        }
        let motion = BaseMotion { t_s, pose: base.pose, velocity: base.velocity };
        let mut push = Vector3::from(physics.base_wrench(&motion));
        let [fx, fy, torque] = thrust;
        let (sin, cos) = base.pose[2].sin_cos();
        push += Vector3::new(cos * fx - sin * fy, sin * fx + cos * fy, torque);
        let acceleration = model.prescribed_dynamics(&state, &arm.qdd_rad_s2, &push);
        let mut torques = model.inverse_dynamics(&state, &acceleration).fixed_rows::<MAX_LINKS>(3).into_owned();
        for law in &physics.joint_laws {
            let i = law.joint;
            torques[i] -= (law.law)(&law.values, t_s, arm.q_rad[i], arm.qd_rad_s[i]);
        }
        torques
    }

    /// Torque that joint `i`'s motor gives for its drive to pass on `torque`, N m, and for a rotor that moves on its own to move along; the
    /// direction of sliding is as certain as the rate, of standard deviation `rate_sd`.
    pub(super) fn motor_torque(&self, t_s: f64, i: usize, torque: f64, arm: &ArmState, rate_sd: f64) -> f64 {
        let joint = &self.physics(t_s).joints[i];
        let rate = arm.motor_rad_s[i];
        let ratio = joint.gear_ratio(arm.q_rad[i]);
        let friction = joint.friction.sliding_n_m(direction(rate, rate_sd), rate);
        let rotor = self.own_rotor_kg_m2(t_s, i).map_or(0.0, |inertia| inertia * arm.qdd_rad_s2[i]);
        (torque + friction + rotor) / ratio
    }

    /// Inertia of a rotor that moves on its own, on an elastic drive, kg m2; a rigid drive's is counted in the links.
    pub(super) fn own_rotor_kg_m2(&self, t_s: f64, i: usize) -> Option<f64> {
        let physics = self.physics(t_s);
        physics.joints[i].is_elastic().then(|| physics.servos[i].rotor_inertia_kg_m2)
    }

    /// The current that a motor takes for a torque, A.
    pub(super) fn current(&self, t_s: f64, i: usize, motor_torque: f64) -> f64 {
        let joint = &self.physics(t_s).joints[i];
        let scale = joint.torque_scale.max(LEAST_TORQUE_CONSTANT);
        motor_torque / (joint.torque_constant_n_m_a * scale)
    }

    /// Accelerations that the encoders would show at the true time `t_s` where the motors gave the torques `motor`: what the
    /// equation of motion makes of them.
    pub(super) fn accelerations(&self, t_s: f64, arm: &ArmState, motor: &JointVector, rate_sd: &[f64]) -> JointVector {
        let (physics, model, base) = (self.physics(t_s), self.model(t_s), self.base(t_s));
        let mut state = State::at_rest(Coordinates::zeros());
        state.q.fixed_rows_mut::<3>(0).copy_from_slice(&base.pose);
        state.v.fixed_rows_mut::<3>(0).copy_from_slice(&base.velocity);
        state.q.fixed_rows_mut::<MAX_LINKS>(3).copy_from(&arm.q_rad);
        state.v.fixed_rows_mut::<MAX_LINKS>(3).copy_from(&arm.qd_rad_s);
        let motion = BaseMotion { t_s, pose: base.pose, velocity: base.velocity };
        let wrench = physics.base_wrench(&motion);
        let [fx, fy, torque] = self.thrust.at(t_s);
        let (sin, cos) = base.pose[2].sin_cos();
        let mut force = Coordinates::zeros();
        force[0] = wrench[0] + cos * fx - sin * fy;
        force[1] = wrench[1] + sin * fx + cos * fy;
        force[2] = wrench[2] + torque;
        for (i, joint) in physics.joints.iter().enumerate() {
            let rate = arm.motor_rad_s[i];
            let friction = joint.friction.sliding_n_m(direction(rate, rate_sd[i]), rate);
            force[3 + i] = motor[i] * joint.gear_ratio(arm.q_rad[i]) - friction;
        }
        for law in &physics.joint_laws {
            let i = law.joint;
            force[3 + i] += (law.law)(&law.values, t_s, arm.q_rad[i], arm.qd_rad_s[i]);
        }
        let acceleration = model.forward_dynamics(&state, &force);
        let shown = |i: usize| {
            physics.joints.get(i).map_or(0.0, |joint| {
                let (amplitude, cycles) = (joint.kinematic_error_rad, joint.kinematic_cycles);
                let curvature = amplitude * cycles * cycles * (cycles * arm.q_rad[i]).sin() * arm.qd_rad_s[i].powi(2);
                joint.encoder_scale * (joint.gear_ratio(arm.q_rad[i]) * acceleration[3 + i] + curvature)
            })
        };
        JointVector::from_fn(|i, _| shown(i))
    }

    /// Torque that a current gives, N m.
    pub(super) fn given(&self, t_s: f64, i: usize, current_a: f64) -> f64 {
        let joint = &self.physics(t_s).joints[i];
        joint.torque_constant_n_m_a * joint.torque_scale * current_a
    }

    /// Motion capture's end-effector in the base's frame, as motion capture saw both at the stamp `t_s`.
    pub(super) fn end_effector(&self, t_s: f64) -> [f64; 3] {
        let physics = self.physics(t_s);
        let true_s = t_s - physics.sensors.age_s(Stream::EePose);
        let base = self.base(true_s);
        let mut q = Coordinates::zeros();
        q.fixed_rows_mut::<3>(0).copy_from_slice(&base.pose);
        q.fixed_rows_mut::<MAX_LINKS>(3).copy_from(&self.arm(true_s).q_rad);
        let tip = physics.sensors.pose_reading(self.model(true_s).end_effector(&q).into());
        let seen = match &self.path.base {
            Some(tracks) if !physics.base.clamped => [0, 1, 2].map(|axis| tracks[axis].at(t_s)[0]),
            _ => [0.0; 3],
        };
        relative(tip, seen)
    }

    /// What the drives carry along the path without thrust, which their servos give way to.
    pub(super) fn loads(&self, sensors: &Sensors, scale_n_m: &[f64]) -> Loads {
        let links = self.path.joints.len();
        let mut nodes = vec![Vec::new(); links];
        for t_s in self.path.grid_s() {
            let torques = self.torques(t_s, &self.base(t_s), &self.arm(t_s), [0.0; 3]);
            nodes.iter_mut().enumerate().for_each(|(i, own)| own.push([torques[i], 0.0, 0.0]));
        }
        let rated = |own: Vec<[f64; 3]>| {
            let value = |k: usize| own[k.min(own.len() - 1)][0];
            let slope = |k: usize| (value(k + 1) - value(k.saturating_sub(1))) / (2.0 * self.path.step_s());
            (0..own.len()).map(|k| [value(k), slope(k), 0.0]).collect::<Vec<_>>()
        };
        let least = scale_n_m.iter().copied().fold(0.0, f64::max) * 1e-3;
        Loads {
            tracks: nodes.into_iter().map(|own| self.path.track(rated(own))).collect(),
            undecided_n_m: sensors.torque_n_m.max(least).max(1e-9),
        }
    }
}

impl Loads {
    /// How far ahead of its motor an elastic drive's link is, and how fast that grows: wound up by its load, and on the side
    /// of its play that the load presses it to. Where torques move the arm no loads are known: the encoder is taken to sit on the link.
    fn lead(&self, i: usize, joint: &JointPhysics, stiffness_n_m_rad: f64, t_s: f64, step_s: f64) -> [f64; 2] {
        let Some(track) = self.tracks.get(i) else { return [0.0; 2] };
        let lead = |t: f64| {
            let torque = track.at(t)[0];
            -torque / stiffness_n_m_rad - 0.5 * joint.backlash_rad * (torque / self.undecided_n_m).tanh()
        };
        [lead(t_s), (lead(t_s + step_s) - lead(t_s - step_s)) / (2.0 * step_s)]
    }
}

/// Angle, rate and acceleration of a link whose motor has these, through a gear with a kinematic error.
fn through_gear(joint: &JointPhysics, [motor, rate, acceleration]: [f64; 3]) -> [f64; 3] {
    if joint.kinematic_error_rad == 0.0 {
        return [motor, rate, acceleration];
    }
    let (amplitude, cycles) = (joint.kinematic_error_rad, joint.kinematic_cycles);
    // The error is one of the link's own angle. Each round leaves a fifth of the rest at 30 mrad and six periods a turn.
    let link = (0..8).fold(motor, |link, _| motor + amplitude * (cycles * link).sin());
    let ratio = joint.gear_ratio(link);
    let link_rate = rate / ratio;
    let curvature = amplitude * cycles * cycles * (cycles * link).sin();
    [link, link_rate, (acceleration - curvature * link_rate * link_rate) / ratio]
}

/// A pose in the frame of another.
pub(super) fn relative(pose: [f64; 3], frame: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = frame[2].sin_cos();
    let (dx, dy) = (pose[0] - frame[0], pose[1] - frame[1]);
    [cos * dx + sin * dy, cos * dy - sin * dx, pose[2] - frame[2]]
}
