//! From what is written to what is meant: values that make no sense are refused where they stand.

mod conditions;
mod excitation;
mod flight;
mod target;

use super::{ArmGoal, BaseGoal, Initial, Mission, Phase, Ranges, raw};
use crate::error::Fault;
use fss_messages::MAX_LINKS;
use fss_plant::Plant;
use std::ops::Range;
use toml::Spanned;

/// No phase lasts longer, s.
const LONGEST_PHASE_S: f64 = 3600.0;

type Checked<T> = Result<T, Fault>;
/// The plant for which the mission shall be, where it is known.
type For<'a> = Option<&'a Plant>;

pub(super) fn mission(raw: &raw::Mission, plant: For) -> Checked<Mission> {
    if raw.name.get_ref().trim().is_empty() {
        return Err(Fault::new(raw.name.span(), "the mission has no name", "give it one, such as name = \"hold\""));
    }
    if raw.phase.get_ref().is_empty() {
        return Err(Fault::new(raw.phase.span(), "the mission has no phase", "add a [[phase]]"));
    }
    let abort_names: Vec<String> = raw.abort.iter().filter_map(|phase| phase.get_ref().name.clone()).collect();
    if abort_names.len() < raw.abort.len() {
        let span = raw.abort.iter().find(|phase| phase.get_ref().name.is_none()).map_or(0..0, Spanned::span);
        return Err(Fault::new(span, "an [[abort]] phase without a name", "name it, and let on_abort name it too"));
    }
    let all = |raw: &[Spanned<raw::Phase>]| -> Checked<Vec<Phase>> {
        raw.iter().enumerate().map(|(i, raw)| phase(raw, i, &abort_names, plant)).collect()
    };
    let mission = Mission {
        initial: initial(&raw.initial, plant)?,
        phases: all(raw.phase.get_ref())?,
        aborts: all(&raw.abort)?,
        target: raw.target.as_ref().map(|target| target::body(target.get_ref(), plant)).transpose()?,
        name: raw.name.get_ref().clone(),
        description: raw.description.clone(),
    };
    flight::check(&mission, raw, plant)?;
    Ok(mission)
}

fn ranges(raw: &raw::Draw) -> Checked<Ranges> {
    let range = |range: Option<&raw::Range>, scale: f64| -> Checked<[f64; 2]> {
        let Some(range) = range else { return Ok([0.0; 2]) };
        let [low, high] = *range.get_ref();
        if low.is_finite() && high.is_finite() && low <= high {
            return Ok([low * scale, high * scale]);
        }
        Err(Fault::new(range.span(), format!("from {low} to {high} is no range"), "give the lower end first"))
    };
    let degrees = 1_f64.to_radians();
    Ok(Ranges {
        x_m: range(raw.x_m.as_ref(), 1.0)?,
        y_m: range(raw.y_m.as_ref(), 1.0)?,
        theta_rad: range(raw.theta_deg.as_ref(), degrees)?,
        drift_m_s: range(raw.drift_m_s.as_ref(), 1.0)?,
        spin_rad_s: range(raw.spin_deg_s.as_ref(), degrees)?,
    })
}

fn initial(raw: &raw::Initial, plant: For) -> Checked<Initial> {
    Ok(Initial {
        base_pose: [
            on_table(raw.x_m.as_ref(), 0, plant)?,
            on_table(raw.y_m.as_ref(), 1, plant)?,
            number_or_zero(raw.theta_deg.as_ref())?.to_radians(),
        ],
        base_rate: [
            number_or_zero(raw.vx_m_s.as_ref())?,
            number_or_zero(raw.vy_m_s.as_ref())?,
            number_or_zero(raw.omega_deg_s.as_ref())?.to_radians(),
        ],
        q_rad: raw.q_deg.as_ref().map_or(Ok(Vec::new()), |q| joint_angles(q, plant))?,
        qd_rad_s: raw.qd_deg_s.as_ref().map_or(Ok(Vec::new()), |qd| {
            one_for_each_joint(qd, plant)?;
            qd.get_ref().iter().map(|rate| Ok(number(rate)?.to_radians())).collect()
        })?,
        ranges: raw.draw.as_ref().map_or(Ok(Ranges::default()), ranges)?,
    })
}

fn phase(raw: &Spanned<raw::Phase>, index: usize, abort_names: &[String], plant: For) -> Checked<Phase> {
    let raw = raw.get_ref();
    let duration_s = number(&raw.duration_s)?;
    if !(duration_s > 0.0 && duration_s <= LONGEST_PHASE_S) {
        let help = format!("a phase lasts more than 0 and at most {LONGEST_PHASE_S} s");
        return Err(Fault::new(raw.duration_s.span(), format!("a phase cannot last {duration_s} s"), help));
    }
    let settle_s = number_or_zero(raw.settle_s.as_ref())?;
    if !(0.0..=LONGEST_PHASE_S).contains(&settle_s) {
        let span = raw.settle_s.as_ref().map_or(0..0, Spanned::span);
        let help = format!("give 0 to {LONGEST_PHASE_S} s, or leave it out");
        return Err(Fault::new(span, format!("goals cannot be kept for {settle_s} s"), help));
    }
    let base = base_goal(&raw.base, duration_s + settle_s, plant)?;
    let arm = arm_goal(&raw.arm, plant)?;
    if matches!(arm, ArmGoal::Line { zero_reaction: true, .. }) && base != BaseGoal::Free {
        return Err(Fault::new(
            raw.base.goal.span(),
            "the arm alone keeps the base from turning in a zero-reaction maneuver, the base cannot have a goal of its own",
            "write base = { goal = \"free\" }, or let the arm's goal be \"line\"",
        ));
    }
    Ok(Phase {
        name: raw.name.clone().unwrap_or_else(|| format!("phase {}", index + 1)),
        until: conditions::until(raw, duration_s)?,
        on_abort: conditions::on_abort(raw, abort_names)?,
        gripper_closed: raw.gripper.map(|gripper| gripper == raw::Gripper::Closed),
        duration_s,
        settle_s,
        base,
        arm,
    })
}

fn base_goal(raw: &raw::Base, phase_s: f64, plant: For) -> Checked<BaseGoal> {
    let goal = *raw.goal.get_ref();
    if goal != raw::BaseGoal::Valves {
        let keys = [("pulses", raw.pulses.as_ref().map(Spanned::span))];
        refuse_all(keys.into_iter(), "only the base's goal \"valves\" takes it")?;
    }
    if goal != raw::BaseGoal::Meet {
        let keys = [("standoff_m", raw.standoff_m.as_ref().map(Spanned::span))];
        refuse_all(keys.into_iter(), "only the base's goal \"meet\" takes it")?;
    }
    if goal == raw::BaseGoal::Carry {
        return target::carry(raw, plant);
    }
    if goal == raw::BaseGoal::Goto {
        let relative = raw.relative.as_ref().is_some_and(|r| *r.get_ref());
        if raw.x_m.is_none() && raw.y_m.is_none() && raw.theta_deg.is_none() {
            let help = "give x_m, y_m, theta_deg; with relative = true what is left out is zero";
            return Err(Fault::new(raw.goal.span(), "nothing says where the base shall go", help));
        }
        if !relative && (raw.x_m.is_none() || raw.y_m.is_none() || raw.theta_deg.is_none()) {
            let help = "give all of x_m, y_m and theta_deg, or relative = true";
            return Err(Fault::new(raw.goal.span(), "an absolute pose needs all of its three numbers", help));
        }
        let on_table = |value, axis| if relative { number_or_zero(value) } else { on_table(value, axis, plant) };
        let pose = [
            on_table(raw.x_m.as_ref(), 0)?,
            on_table(raw.y_m.as_ref(), 1)?,
            number_or_zero(raw.theta_deg.as_ref())?.to_radians(),
        ];
        return Ok(BaseGoal::Goto { pose, relative });
    }
    let numbers = [("x_m", &raw.x_m), ("y_m", &raw.y_m), ("theta_deg", &raw.theta_deg)];
    let numbers = numbers.map(|(key, value)| (key, value.as_ref().map(Spanned::span)));
    let relative = ("relative", raw.relative.as_ref().map(Spanned::span));
    refuse_all(numbers.into_iter().chain([relative]), "only the base's goals \"goto\" and \"carry\" take it")?;
    Ok(match goal {
        raw::BaseGoal::Free => BaseGoal::Free,
        raw::BaseGoal::Stop => BaseGoal::Stop,
        raw::BaseGoal::Follow => BaseGoal::Follow,
        raw::BaseGoal::Meet => target::meet(raw)?,
        raw::BaseGoal::Valves => BaseGoal::Valves(excitation::pulses(raw, phase_s, plant)?),
        _ => BaseGoal::Hold,
    })
}

fn arm_goal(raw: &Spanned<raw::Arm>, plant: For) -> Checked<ArmGoal> {
    let (table, raw) = (raw.span(), raw.get_ref());
    let is_line = matches!(raw.goal.get_ref(), raw::ArmGoal::Line | raw::ArmGoal::ZeroReaction);
    if !is_line {
        let keys = [
            ("length_m", raw.length_m.as_ref().map(Spanned::span)),
            ("direction_deg", raw.direction_deg.as_ref().map(Spanned::span)),
            ("keep_orientation", raw.keep_orientation.as_ref().map(Spanned::span)),
        ];
        refuse_all(keys.into_iter(), "only the arm's goals \"line\" and \"zero-reaction\" take it")?;
    }
    if *raw.goal.get_ref() != raw::ArmGoal::Sines {
        let keys = [("sines", raw.sines.as_ref().map(Spanned::span))];
        refuse_all(keys.into_iter(), "only the arm's goal \"sines\" takes it")?;
    }
    if !matches!(raw.goal.get_ref(), raw::ArmGoal::Joints | raw::ArmGoal::Sines) {
        let keys = [("q_deg", raw.q_deg.as_ref().map(Spanned::span))];
        refuse_all(keys.into_iter(), "only the arm's goals \"joints\" and \"sines\" take it")?;
    }
    let missing = |key: &str| Fault::new(table.clone(), format!("missing field `{key}`"), "add the key to this table");
    match raw.goal.get_ref() {
        raw::ArmGoal::Off => Ok(ArmGoal::Off),
        raw::ArmGoal::Hold => Ok(ArmGoal::Hold),
        raw::ArmGoal::Capture => Ok(ArmGoal::Capture),
        raw::ArmGoal::Follow => Ok(ArmGoal::Follow),
        raw::ArmGoal::Joints => {
            let q_deg = raw.q_deg.as_ref().ok_or_else(|| missing("q_deg"))?;
            joint_angles(q_deg, plant).map(ArmGoal::Joints)
        }
        raw::ArmGoal::Sines => {
            let q_deg = raw.q_deg.as_ref().ok_or_else(|| missing("q_deg"))?;
            let about_rad = joint_angles(q_deg, plant)?;
            let sines = raw.sines.as_ref().ok_or_else(|| missing("sines"))?;
            Ok(ArmGoal::Sines { sines: excitation::sines(sines, &about_rad, plant)?, about_rad })
        }
        goal => {
            let length = raw.length_m.as_ref().ok_or_else(|| missing("length_m"))?;
            let direction = raw.direction_deg.as_ref().ok_or_else(|| missing("direction_deg"))?;
            Ok(ArmGoal::Line {
                length_m: line_length(length, plant)?,
                direction_rad: number(direction)?.to_radians(),
                keep_orientation: raw.keep_orientation.as_ref().is_some_and(|keep| *keep.get_ref()),
                zero_reaction: *goal == raw::ArmGoal::ZeroReaction,
            })
        }
    }
}

fn refuse_all(keys: impl Iterator<Item = (&'static str, Option<Range<usize>>)>, why: &str) -> Checked<()> {
    for (key, span) in keys {
        if let Some(span) = span {
            return Err(Fault::new(
                span,
                format!("`{key}` contradicts the goal"),
                format!("{why}; remove one of the two"),
            ));
        }
    }
    Ok(())
}

fn number(value: &raw::Number) -> Checked<f64> {
    let number = *value.get_ref();
    if number.is_finite() {
        return Ok(number);
    }
    Err(Fault::new(value.span(), format!("{number} is not a number to work with"), "give a finite number"))
}

fn number_or_zero(value: Option<&raw::Number>) -> Checked<f64> {
    value.map_or(Ok(0.0), number)
}

/// A coordinate of the base, which must stand on the table.
fn on_table(value: Option<&raw::Number>, axis: usize, plant: For) -> Checked<f64> {
    let Some(value) = value else { return Ok(0.0) };
    let coordinate = number(value)?;
    if let Some(plant) = plant {
        let half = plant.table.size_m[axis] / 2.0;
        if coordinate.abs() > half {
            let message = format!("{coordinate} m is beyond the table");
            return Err(Fault::new(value.span(), message, format!("the table ends at -{half} and {half} m")));
        }
    }
    Ok(coordinate)
}

fn line_length(value: &raw::Number, plant: For) -> Checked<f64> {
    let length = number(value)?;
    if length <= 0.0 {
        let help = "give a positive length; the direction turns with direction_deg";
        return Err(Fault::new(value.span(), format!("a line cannot be {length} m long"), help));
    }
    if let Some(plant) = plant {
        let reach: f64 = plant.links.iter().map(|link| link.length_m).sum();
        if length > 2.0 * reach {
            let message = format!("a line of {length} m is beyond the arm");
            return Err(Fault::new(value.span(), message, format!("the arm's links together are {reach:.3} m long")));
        }
    }
    Ok(length)
}

fn one_for_each_joint(values: &Spanned<Vec<raw::Number>>, plant: For) -> Checked<()> {
    let count = values.get_ref().len();
    let (fits, wanted) = plant.map_or_else(
        || ((1..=MAX_LINKS).contains(&count), format!("1 to {MAX_LINKS} joints")),
        |plant| (count == plant.links.len(), format!("{} joints", plant.links.len())),
    );
    if fits {
        return Ok(());
    }
    let help = format!("give one number for each of the arm's {wanted}");
    Err(Fault::new(values.span(), format!("there are {count} numbers for the joints"), help))
}

fn joint_angles(values: &Spanned<Vec<raw::Number>>, plant: For) -> Checked<Vec<f64>> {
    one_for_each_joint(values, plant)?;
    let angle = |(i, value): (usize, &raw::Number)| {
        let degrees = number(value)?;
        let limit = plant.and_then(|plant| plant.links.get(i)).map(|link| link.joint_limit_rad.to_degrees());
        if let Some(limit) = limit.filter(|limit| degrees.abs() > *limit) {
            let message = format!("{degrees} degrees are beyond the stop of joint {}", i + 1);
            return Err(Fault::new(value.span(), message, format!("stay between -{limit:.1} and {limit:.1} degrees")));
        }
        Ok(degrees.to_radians())
    };
    values.get_ref().iter().enumerate().map(angle).collect()
}
