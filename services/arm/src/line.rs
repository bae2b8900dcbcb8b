//! A straight line of the end-effector, and the task that it sets at each time.

use crate::ArmConfig;
use crate::estimate::{Estimate, Estimator};
use crate::inverse::{Bounds, Solution, Task};
use crate::profile::quintic;
use crate::reference::Reference;
use fss_bus::Time;
use fss_messages::MissionState;
use fss_multibody::{Coordinates, JointVector, MAX_LINKS};
use nalgebra::{SMatrix, SVector, Vector2, Vector3, Vector4};

/// A line that a phase asks for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ask {
    way: Vector2<f64>,
    duration_s: f64,
    keeps_orientation: bool,
    is_zero_reaction: bool,
    /// To the target's handle, which moves.
    pub(crate) is_capture: bool,
    pub(crate) phase_start_ns: u64,
}

impl Ask {
    pub(crate) fn of(mission: &MissionState) -> Self {
        let mode = mission.arm_mode;
        let (sin, cos) = mission.line_direction_rad.sin_cos();
        Self {
            way: Vector2::new(cos, sin) * mission.line_length_m,
            duration_s: mission.arm_duration_s,
            keeps_orientation: matches!(mode, MissionState::ARM_LINE_POSE | MissionState::ARM_ZERO_REACTION_POSE),
            is_zero_reaction: matches!(
                mode,
                MissionState::ARM_ZERO_REACTION | MissionState::ARM_ZERO_REACTION_POSE | MissionState::ARM_CAPTURE
            ),
            is_capture: mode == MissionState::ARM_CAPTURE,
            phase_start_ns: mission.phase_start_ns,
        }
    }
}

/// The target's handle now.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Handle {
    /// Where it is, table frame, m.
    at: Vector2<f64>,
    /// How fast it moves, m/s.
    rate: Vector2<f64>,
}

impl Handle {
    /// On the rim of the mission's target, `radius_m` from its centre; `None` where that is not seen.
    pub(crate) fn of(mission: &MissionState, radius_m: f64, now: Time) -> Option<Self> {
        if mission.target_seen == 0 {
            return None;
        }
        let age_s = now.age_ns(mission.stamp_ns) as f64 * 1e-9;
        let ([x, y, theta], [vx, vy, omega]) = (mission.target, mission.target_rate);
        let (sin, cos) = (theta + omega * age_s).sin_cos();
        let arm = Vector2::new(cos, sin) * radius_m;
        let at = Vector2::new(x + vx * age_s, y + vy * age_s) + arm;
        Some(Self { at, rate: Vector2::new(vx - omega * arm.y, vy + omega * arm.x) })
    }
}

/// A line under way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    ask: Ask,
    start: Vector3<f64>,
    /// Attitude that a zero-reaction maneuver keeps, rad.
    attitude_rad: f64,
    /// Time along the line, s; it runs more slowly where limits slow the line down.
    pub(crate) clock_s: f64,
    /// Where the line ends, if that moves; the way to it is then shortened with it.
    handle: Option<Handle>,
}

impl Line {
    /// The line from where the end-effector is.
    pub(crate) fn from_here(ask: &Ask, here: &Estimate) -> Self {
        Self { ask: *ask, start: here.ee, attitude_rad: here.state.q[2], clock_s: 0.0, handle: None }
    }

    /// The line from where the end-effector is to a handle that moves.
    pub(crate) fn to_handle(ask: &Ask, here: &Estimate, handle: Handle) -> Self {
        let mut line = Self::from_here(ask, here);
        line.ask.way = handle.at - here.ee.xy();
        line.handle = Some(handle);
        line
    }

    /// Where the handle is now; one that is not seen is where it was.
    pub(crate) fn see(&mut self, handle: Option<Handle>) {
        self.handle = handle.filter(|_| self.ask.is_capture).or(self.handle);
    }

    /// Share of the line that is done.
    pub(crate) fn progress(&self) -> f64 {
        quintic(self.clock_s, self.ask.duration_s).0
    }

    /// Where the end-effector shall be now: x m, y m, angle rad.
    pub(crate) fn goal(&self) -> Vector3<f64> {
        let here = match self.handle {
            None => self.start.xy() + self.ask.way * self.progress(),
            Some(handle) => handle.at - self.ask.way * (1.0 - self.progress()),
        };
        Vector3::new(here.x, here.y, self.start.z)
    }

    /// How far the end-effector is from where it shall be, m.
    pub(crate) fn deviation_m(&self, ee: &Vector3<f64>) -> f64 {
        (self.goal() - ee).xy().norm()
    }

    /// Joint rates that follow the line and correct what is off.
    pub(crate) fn resolve(
        &self,
        config: &ArmConfig,
        reference: &Reference,
        estimator: &Estimator,
        here: &Estimate,
    ) -> Solution {
        // The Jacobians are taken at the reference: the joints are there but for the servos' lag, and it has no noise.
        let mut q: Coordinates = here.state.q;
        q.fixed_rows_mut::<MAX_LINKS>(3).copy_from(&reference.q_rad);
        let momentum = estimator.momentum_about_base(&config.model, &q);
        let rows = config.model.zero_reaction_jacobian(&q);
        let twist = self.twist(config, here) - config.model.momentum_drift(&q, &momentum);
        let turning = self.turning(config, here) - config.model.base_twist(&q, &JointVector::zeros(), &momentum).z;
        let wanted = Vector4::new(twist.x, twist.y, twist.z, turning);

        let solve = Solve { config, reference, preferred: self.centring(config, &reference.q_rad) };
        let is_zero_reaction = self.ask.is_zero_reaction && !config.model.base().clamped;
        match (self.ask.keeps_orientation, is_zero_reaction) {
            (false, false) => solve.rows(&rows, &wanted, [0, 1]),
            (true, false) => solve.rows(&rows, &wanted, [0, 1, 2]),
            (false, true) => solve.rows(&rows, &wanted, [0, 1, 3]),
            (true, true) => solve.rows(&rows, &wanted, [0, 1, 2, 3]),
        }
    }

    /// Twist of the end-effector: along the line, and back to it.
    fn twist(&self, config: &ArmConfig, here: &Estimate) -> Vector3<f64> {
        let (_, rate) = quintic(self.clock_s, self.ask.duration_s);
        let mut error = self.goal() - here.ee;
        let distance_m = error.xy().norm();
        let share = beyond(distance_m, config.quiet_m) / distance_m.max(f64::MIN_POSITIVE);
        (error.x, error.y, error.z) = (error.x * share, error.y * share, beyond(error.z, config.quiet_rad));
        let along = self.ask.way * rate + self.handle.map_or(Vector2::zeros(), |handle| handle.rate);
        Vector3::new(along.x, along.y, 0.0) + error * config.line_gain_1_s
    }

    /// Angular rate of the base: back to the attitude that it shall keep.
    fn turning(&self, config: &ArmConfig, here: &Estimate) -> f64 {
        -config.attitude_gain_1_s * beyond(here.state.q[2] - self.attitude_rad, config.quiet_rad)
    }

    /// Rates towards the middle of the joints' range, the gradient of `1/2 sum (q / limit)^2`: they use what freedom the
    /// task leaves to keep the joints from their limits. They begin and end gently, and with the line.
    fn centring(&self, config: &ArmConfig, q_rad: &JointVector) -> JointVector {
        let ramp_s = config.centring_ramp_s.min(self.ask.duration_s / 2.0);
        let (begun, _) = quintic(self.clock_s, ramp_s);
        let (ended, _) = quintic(self.clock_s - (self.ask.duration_s - ramp_s), ramp_s);
        let gain = config.centring_gain_rad2_s * if ramp_s > 0.0 { begun - ended } else { 1.0 - ended };
        let mut rates = JointVector::zeros();
        for i in 0..config.model.link_count() {
            rates[i] = -gain * q_rad[i] / config.limit_rad[i].powi(2);
        }
        rates
    }
}

/// What every task of a line is solved with.
struct Solve<'a> {
    config: &'a ArmConfig,
    reference: &'a Reference,
    preferred: JointVector,
}

impl Solve<'_> {
    /// Solves for some of the rows vx, vy and angle of the end-effector, and the base's rate.
    fn rows<const R: usize>(
        &self,
        rows: &SMatrix<f64, 4, MAX_LINKS>,
        wanted: &Vector4<f64>,
        which: [usize; R],
    ) -> Solution {
        let (config, (low, high)) = (self.config, self.reference.rate_bounds(self.config));
        let task = Task {
            rows: SMatrix::<f64, R, MAX_LINKS>::from_fn(|row, i| rows[(which[row], i)]),
            wanted: SVector::<f64, R>::from_fn(|row, _| wanted[which[row]]),
            preferred: self.preferred,
        };
        let (sigma_slow, sigma_damped, sigma_singular) =
            (config.sigma_slow, config.sigma_damped, config.sigma_singular);
        task.solve(config.model.link_count(), &Bounds { low, high, sigma_slow, sigma_damped, sigma_singular })
    }
}

/// What of `error` lies beyond the quiet zone: noise within it would only make the joints stick and slip.
fn beyond(error: f64, quiet: f64) -> f64 {
    error - error.clamp(-quiet, quiet)
}
