//! The start-up transient: the time until the drives hold the arm.
//!
//! Until its drives take up their commands something may fling an arm about, a spring at a joint, say. Between two reports it
//! then goes anywhere, and the base with it: no model of the base can be judged by that time.

use fss_experiments::measured::{Joints, Run};

/// Angles that reports, taken together, leave open by more than this are not known, rad: what a drive does where it takes
/// up a command stays well below.
const OPEN_RAD: f64 = 0.02;
/// Reports farther apart than this many times the usual are a pause of telemetry, which says nothing of the drives.
const PAUSE: f64 = 2.0;
/// An arm that is not in hand for longer than this is one whose model is wrong, s.
const LONGEST_S: f64 = 3.0;

/// When the drives of a run have its arm in hand, s, where that is not from the beginning on.
pub(crate) fn startup_transient_end_s(run: &Run) -> Option<f64> {
    let joints = run.joints.as_ref()?;
    let (first_s, last_s) = (*joints.t_s.first()?, *joints.t_s.last()?);
    let open = (0..joints.q_rad.len()).flat_map(|joint| open_rad(run, joints, joint));
    let open_s = open.filter(|(_, open)| *open > OPEN_RAD).map(|(t_s, _)| t_s).reduce(f64::max)?;
    (open_s - first_s < LONGEST_S.min(0.5 * (last_s - first_s))).then_some(open_s)
}

/// For each report of a joint but those after a pause, how far its way since the last one is from what their rates say, rad:
/// nothing where the acceleration is even.
fn open_rad(run: &Run, joints: &Joints, joint: usize) -> Vec<(f64, f64)> {
    let Some(rates) = joints.qd_rad_s.get(joint) else { return Vec::new() };
    let command = |t: f64| run.joint_command.as_ref().and_then(|c| Some((c.at(joint, t)?, c.rate_at(joint, t)?)));
    let reports = joints.t_s.iter().zip(&joints.q_rad[joint]).zip(rates);
    let off: Vec<(f64, f64, f64)> = reports
        .filter(|((_, q), v)| q.is_finite() && v.is_finite())
        .map(|((t, q), v)| {
            let (angle, rate) = command(*t).unwrap_or((0.0, 0.0));
            (*t, q - angle, v - rate)
        })
        .collect();
    let mut apart_s: Vec<f64> = off.windows(2).map(|w| w[1].0 - w[0].0).collect();
    apart_s.sort_by(f64::total_cmp);
    let longest_s = PAUSE * apart_s.get(apart_s.len() / 2).copied().unwrap_or(0.0);
    let together = off.windows(2).filter(|w| w[1].0 - w[0].0 <= longest_s);
    together.map(|w| (w[1].0, (w[1].1 - w[0].1 - 0.5 * (w[1].0 - w[0].0) * (w[0].2 + w[1].2)).abs())).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use fss_experiments::measured::{Many, Poses};

    /// An arm of one joint that is told to rest for 20 s, and swings with this rate until this time.
    fn swinging(rate_rad_s: f64, until_s: f64) -> Run {
        let t_s: Vec<f64> = (0..100).map(|k| 0.2 * f64::from(k)).collect();
        let swing = |t: f64| if t < until_s { 0.3 * (rate_rad_s * t).sin() } else { 0.0 };
        let rate = |t: f64| if t < until_s { 0.3 * rate_rad_s * (rate_rad_s * t).cos() } else { 0.0 };
        let joints = Joints {
            q_rad: vec![t_s.iter().map(|t| swing(*t)).collect()],
            qd_rad_s: vec![t_s.iter().map(|t| rate(*t)).collect()],
            t_s: t_s.clone(),
            ..Joints::default()
        };
        let joint_command = Many { t_s: vec![0.0, 20.0], values: vec![vec![0.0; 2]] };
        let base_pose = Poses { values: vec![[0.0; 3]; t_s.len()], t_s };
        Run { joints: Some(joints), joint_command: Some(joint_command), base_pose: Some(base_pose), ..Run::default() }
    }

    #[test]
    fn an_arm_that_is_flung_at_first_is_in_hand_once_its_reports_agree() {
        let run = swinging(9.0, 0.9);
        let from_s = startup_transient_end_s(&run).unwrap();
        assert!((0.9..1.3).contains(&from_s), "{from_s} s");
        let rest = run.measured_from(from_s);
        assert!(startup_transient_end_s(&rest).is_none());
        assert!(rest.joints.unwrap().t_s[0] >= from_s && rest.base_pose.unwrap().t_s[0] > from_s);
        assert_eq!(rest.joint_command.unwrap().t_s.len(), 2, "what it was told stays");
    }

    #[test]
    fn a_pause_of_telemetry_while_the_arm_moves_is_no_flung_arm() {
        let mut run = swinging(2.0, 20.0);
        assert_eq!(startup_transient_end_s(&run), None);
        let joints = run.joints.as_mut().unwrap();
        for values in [&mut joints.t_s, &mut joints.q_rad[0], &mut joints.qd_rad_s[0]] {
            values.drain(3..9);
        }
        assert_eq!(startup_transient_end_s(&run), None);
    }

    #[test]
    fn an_arm_that_moves_gently_or_is_never_in_hand_is_left_alone() {
        assert_eq!(startup_transient_end_s(&swinging(0.5, 20.0)), None);
        assert_eq!(startup_transient_end_s(&swinging(9.0, 20.0)), None);
    }
}
