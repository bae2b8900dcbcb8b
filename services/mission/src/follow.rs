//! Goals from outside the stack, in phases that follow them.

use crate::goals::nearest_turn;
use crate::{ArmGoal, BaseGoal, Phase};
use fss_messages::{MissionGoal, MissionState};

/// What became of a goal of the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Outcome {
    /// It is one already, or none of the base.
    Same,
    /// The base goes there.
    New,
    /// It is beyond the table.
    OffTable,
}

/// Takes what `phase` follows of a goal. The base turns the shorter way from `theta_rad`, and takes the time that its thrusters
/// need; the arm's limits are the arm's.
pub(crate) fn follow(
    s: &mut MissionState,
    phase: &Phase,
    goal: &MissionGoal,
    theta_rad: f64,
    edges_m: Option<[f64; 2]>,
) -> Outcome {
    if phase.arm == ArmGoal::Follow {
        for (mine, wanted) in s.q_goal_rad.iter_mut().zip(goal.q_goal_rad).filter(|(_, wanted)| wanted.is_finite()) {
            *mine = wanted;
        }
    }
    let [x_m, y_m, theta] = goal.base_goal;
    if phase.base != BaseGoal::Follow || !goal.base_goal.iter().all(|value| value.is_finite()) {
        return Outcome::Same;
    }
    if edges_m.is_some_and(|[x, y]| x_m.abs() > x || y_m.abs() > y) {
        return Outcome::OffTable;
    }
    let wanted = [x_m, y_m, nearest_turn(theta, theta_rad)];
    let is_same = s.base_goal.iter().zip(wanted).all(|(mine, wanted)| (mine - wanted).abs() < 1e-9);
    if is_same {
        return Outcome::Same;
    }
    (s.base_goal, s.base_duration_s) = (wanted, 0.0);
    Outcome::New
}
