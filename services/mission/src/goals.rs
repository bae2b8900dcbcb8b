//! From a phase to the goals that base and arm read.

use crate::target::Motion;
use crate::{ArmGoal, BaseGoal, Phase, Pulse, Sine};
use fss_messages::{MAX_LINKS, MAX_SINES, MAX_THRUSTERS, MissionState};
use fss_multibody::{Model, coordinates};
use std::f64::consts::{PI, TAU};

/// Base goals are published as absolute poses, so that a controller that restarts within a phase still knows them.
pub(crate) fn set_base_goal(s: &mut MissionState, phase: &Phase, here: [f64; 3]) {
    let was_controlled = s.base_mode == MissionState::BASE_HOLD;
    s.base_goal_relative = 0;
    s.base_goal_rate = [0.0; 3];
    s.base_mode = MissionState::BASE_HOLD;
    s.base_duration_s = phase.duration_s;
    s.valves = [0; MAX_THRUSTERS];
    s.carrying = 0;
    match phase.base {
        BaseGoal::Free => {
            s.base_mode = MissionState::BASE_FREE;
            s.base_goal = here;
        }
        BaseGoal::Hold | BaseGoal::Follow => {
            s.base_duration_s = 0.0;
            s.base_goal = if was_controlled { s.base_goal } else { here };
        }
        BaseGoal::Goto { pose: [x, y, theta], relative: true } => {
            s.base_goal = [here[0] + x, here[1] + y, here[2] + theta];
        }
        BaseGoal::Goto { pose: [x, y, theta], relative: false } => {
            s.base_goal = [x, y, nearest_turn(theta, here[2])];
        }
        BaseGoal::Valves(_) => {
            s.base_mode = MissionState::BASE_VALVES;
            s.base_goal = here;
        }
        BaseGoal::Stop => {
            s.base_mode = MissionState::BASE_STOP;
            s.base_goal = here;
        }
        // Set by the one who knows the target.
        BaseGoal::Meet { .. } | BaseGoal::Carry { .. } => {}
    }
}

/// The heading is unwrapped: the turn to `theta` that is the shorter one from `here`.
pub(crate) fn nearest_turn(theta: f64, here: f64) -> f64 {
    here + (theta - here + PI).rem_euclid(TAU) - PI
}

/// A target to be met.
pub(crate) struct Meeting<'a> {
    pub(crate) model: &'a Model,
    /// Encoder angles with which the arm will stand, rad.
    pub(crate) q_rad: &'a [f64],
    /// Now.
    pub(crate) target: Motion,
    /// Distance of its handle from its centre, m.
    pub(crate) radius_m: f64,
    pub(crate) standoff_m: f64,
    /// Time from now to the grasp, s.
    pub(crate) grasp_after_s: f64,
}

impl Meeting<'_> {
    /// The base's pose now that would hold the end-effector before the handle as that will stand at the grasp, and its
    /// rate: the base drifts with the target, and does not turn with it.
    pub(crate) fn goal(&self, here: [f64; 3]) -> ([f64; 3], [f64; 3]) {
        let tip = self.model.end_effector(&coordinates([0.0; 3], self.q_rad));
        let Motion { pose, rate } = self.target;
        let handle = pose[2] + rate[2] * self.grasp_after_s;
        let theta = nearest_turn(handle + PI - tip.z, here[2]);
        let (sin, cos) = theta.sin_cos();
        let from_centre = self.radius_m + self.standoff_m;
        let x = pose[0] + from_centre * handle.cos() - (cos * tip.x - sin * tip.y);
        let y = pose[1] + from_centre * handle.sin() - (sin * tip.x + cos * tip.y);
        ([x, y, theta], [rate[0], rate[1], 0.0])
    }
}

/// The base's pose that brings a held target from where it is to `goal`: both turn and move as one body.
pub(crate) fn carried(here: [f64; 3], target: [f64; 3], goal: [f64; 3]) -> [f64; 3] {
    let turn = nearest_turn(goal[2], target[2]) - target[2];
    let (sin, cos) = turn.sin_cos();
    let (dx, dy) = (here[0] - target[0], here[1] - target[1]);
    [goal[0] + cos * dx - sin * dy, goal[1] + sin * dx + cos * dy, here[2] + turn]
}

/// Which valves the pulses want open `since_ns` after the start of their phase.
pub(crate) fn open_valves(pulses: &[Pulse], since_ns: u64) -> [u8; MAX_THRUSTERS] {
    let mut valves = [0; MAX_THRUSTERS];
    // The mission steps on a raster of its own: what falls between two steps comes with the later one.
    let ns = |time_s: f64| (time_s * 1e9).round() as u64;
    for pulse in pulses.iter().filter(|p| (ns(p.at_s)..ns(p.at_s + p.for_s)).contains(&since_ns)) {
        for &thruster in &pulse.thrusters {
            if let Some(valve) = valves.get_mut(thruster) {
                *valve = 1;
            }
        }
    }
    valves
}

fn set_sines(s: &mut MissionState, sines: &[Sine]) {
    s.sine_amplitude_rad = [0.0; MAX_LINKS * MAX_SINES];
    let mut used = [0; MAX_LINKS];
    for sine in sines {
        let Some(own) = used.get_mut(sine.joint).filter(|own| **own < MAX_SINES) else { continue };
        let slot = sine.joint * MAX_SINES + *own;
        *own += 1;
        s.sine_amplitude_rad[slot] = sine.amplitude_rad;
        s.sine_frequency_hz[slot] = sine.frequency_hz;
        s.sine_phase_rad[slot] = sine.phase_rad;
    }
}

/// `q_rad` is where the joints are.
pub(crate) fn set_arm_goal(s: &mut MissionState, phase: &Phase, q_rad: [f64; MAX_LINKS]) {
    s.arm_duration_s = phase.duration_s;
    if let Some(closed) = phase.gripper_closed {
        s.gripper = u8::from(closed);
    }
    s.arm_mode = match &phase.arm {
        ArmGoal::Off => MissionState::ARM_OFF,
        ArmGoal::Hold => MissionState::ARM_HOLD,
        ArmGoal::Capture => MissionState::ARM_CAPTURE,
        ArmGoal::Follow => {
            s.q_goal_rad = q_rad;
            MissionState::ARM_FOLLOW
        }
        ArmGoal::Joints(q_rad) => {
            for (goal, q) in s.q_goal_rad.iter_mut().zip(q_rad) {
                *goal = *q;
            }
            MissionState::ARM_JOINTS
        }
        ArmGoal::Sines { about_rad, sines } => {
            for (goal, q) in s.q_goal_rad.iter_mut().zip(about_rad) {
                *goal = *q;
            }
            set_sines(s, sines);
            MissionState::ARM_SINES
        }
        ArmGoal::Line { length_m, direction_rad, keep_orientation, zero_reaction } => {
            s.line_length_m = *length_m;
            s.line_direction_rad = *direction_rad;
            match (zero_reaction, keep_orientation) {
                (false, false) => MissionState::ARM_LINE,
                (false, true) => MissionState::ARM_LINE_POSE,
                (true, false) => MissionState::ARM_ZERO_REACTION,
                (true, true) => MissionState::ARM_ZERO_REACTION_POSE,
            }
        }
    };
}
