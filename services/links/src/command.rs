//! From what the arm controller wants to what a link may be told.

use crate::JointLimits;
use fss_messages::ArmCommand;
use fss_wire::link::Mode;

/// A command must stay within the limits for this long without a successor, s: two periods, one datagram lost.
const LOOK_AHEAD_S: f64 = 0.4;

/// What one link is told.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Target {
    pub(crate) mode: Mode,
    pub(crate) q_rad: f64,
    pub(crate) qd_rad_s: f64,
    pub(crate) current_a: f64,
}

impl Target {
    /// Stay at this angle; without an angle the driver can only be shut off.
    pub(crate) fn hold(q_rad: Option<f64>) -> Self {
        q_rad.map_or_else(Self::default, |q_rad| Self { mode: Mode::Position, q_rad, ..Self::default() })
    }

    /// What `command` wants of joint `i`, `age_s` after it was computed; `None` where it makes no sense.
    pub(crate) fn of(command: &ArmCommand, i: usize, age_s: f64) -> Option<Self> {
        let (q, qd, current) = (command.q_rad[i], command.qd_rad_s[i], command.current_a[i]);
        let (mode, values) = match command.mode {
            ArmCommand::OFF => (Mode::Disabled, [0.0; 3]),
            ArmCommand::POSITION => (Mode::Position, [q + qd * age_s, qd, 0.0]),
            ArmCommand::VELOCITY => (Mode::Velocity, [0.0, qd, 0.0]),
            ArmCommand::CURRENT => (Mode::Current, [0.0, 0.0, current]),
            _ => return None,
        };
        let [q_rad, qd_rad_s, current_a] = values;
        values.iter().all(|value| value.is_finite()).then_some(Self { mode, q_rad, qd_rad_s, current_a })
    }

    /// The nearest target within the joint's limits; `q_rad` is the joint's angle now, where it is known.
    pub(crate) fn within(self, limits: &JointLimits, q_rad: Option<f64>) -> Self {
        let stop = limits.angle_rad;
        let within_rate = |q: f64, qd: f64| {
            // Whatever has passed the stop may only come back.
            let outward = ((stop - q) / LOOK_AHEAD_S).max(0.0).min(limits.rate_rad_s);
            let inward = ((-stop - q) / LOOK_AHEAD_S).min(0.0).max(-limits.rate_rad_s);
            qd.clamp(inward, outward)
        };
        match (self.mode, q_rad) {
            (Mode::Disabled, _) => Self::default(),
            (Mode::Position, _) => {
                let q_rad = self.q_rad.clamp(-stop, stop);
                Self { q_rad, qd_rad_s: within_rate(q_rad, self.qd_rad_s), ..self }
            }
            (Mode::Velocity, Some(q)) => Self { qd_rad_s: within_rate(q, self.qd_rad_s), ..self },
            (Mode::Current, Some(q)) => {
                let current_a = self.current_a.clamp(-limits.current_a, limits.current_a);
                let pushes_outward = q.abs() >= stop && current_a * q > 0.0;
                Self { current_a: if pushes_outward { 0.0 } else { current_a }, ..self }
            }
            // Where the joint's angle is unknown, nothing may move it.
            (Mode::Velocity | Mode::Current, None) => Self { qd_rad_s: 0.0, current_a: 0.0, ..self },
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const LIMITS: JointLimits = JointLimits { angle_rad: 1.5, rate_rad_s: 1.0, torque_nm: 1.8, current_a: 3.0 };

    fn told(mode: u8, q: f64, qd: f64, current: f64, measured: Option<f64>) -> Option<Target> {
        let mut command = ArmCommand { mode, ..ArmCommand::default() };
        (command.q_rad[2], command.qd_rad_s[2], command.current_a[2]) = (q, qd, current);
        Target::of(&command, 2, 0.0).map(|target| target.within(&LIMITS, measured))
    }

    #[test]
    fn an_angle_beyond_the_stop_becomes_the_stop() {
        let target = told(ArmCommand::POSITION, 2.0, 0.5, 0.0, Some(0.0)).unwrap();
        assert_eq!((target.q_rad, target.qd_rad_s), (1.5, 0.0));
    }

    #[test]
    fn a_moving_target_does_not_run_past_the_stop_when_a_command_is_lost() {
        let target = told(ArmCommand::POSITION, 1.46, 0.5, 0.0, None).unwrap();
        assert!((target.q_rad + LOOK_AHEAD_S * target.qd_rad_s - 1.5).abs() < 1e-12);
        let back = told(ArmCommand::POSITION, 1.46, -0.5, 0.0, None).unwrap();
        assert_eq!(back.qd_rad_s, -0.5, "the way back is free");
    }

    #[test]
    fn a_rate_slows_before_the_stop_and_may_only_come_back_from_beyond() {
        assert_eq!(told(ArmCommand::VELOCITY, 0.0, 9.0, 0.0, Some(0.0)).unwrap().qd_rad_s, 1.0);
        assert!((told(ArmCommand::VELOCITY, 0.0, 9.0, 0.0, Some(1.3)).unwrap().qd_rad_s - 0.5).abs() < 1e-12);
        assert_eq!(told(ArmCommand::VELOCITY, 0.0, 0.1, 0.0, Some(1.6)).unwrap().qd_rad_s, 0.0);
        assert_eq!(told(ArmCommand::VELOCITY, 0.0, -0.1, 0.0, Some(1.6)).unwrap().qd_rad_s, -0.1);
    }

    #[test]
    fn a_current_is_limited_and_does_not_push_into_the_stop() {
        assert_eq!(told(ArmCommand::CURRENT, 0.0, 0.0, -9.0, Some(1.6)).unwrap().current_a, -3.0);
        assert_eq!(told(ArmCommand::CURRENT, 0.0, 0.0, 2.0, Some(1.6)).unwrap().current_a, 0.0);
    }

    #[test]
    fn what_would_move_a_joint_of_unknown_angle_does_not() {
        assert_eq!(told(ArmCommand::VELOCITY, 0.0, 0.5, 0.0, None).unwrap().qd_rad_s, 0.0);
        assert_eq!(told(ArmCommand::CURRENT, 0.0, 0.0, 1.0, None).unwrap().current_a, 0.0);
    }

    #[test]
    fn a_command_that_is_no_number_or_no_mode_is_none() {
        assert_eq!(told(ArmCommand::POSITION, f64::NAN, 0.0, 0.0, Some(0.0)), None);
        assert_eq!(told(ArmCommand::POSITION, 0.0, f64::INFINITY, 0.0, Some(0.0)), None);
        assert_eq!(told(9, 0.0, 0.0, 0.0, Some(0.0)), None);
    }
}
