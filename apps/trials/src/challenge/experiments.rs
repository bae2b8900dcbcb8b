//! The experiments of a vehicle: the missions that come with the program, fitted to its joints, thrusters and mass.
//!
//! Joint angles keep their share of a joint's range, a joint beyond the fourth moves as the one four before it, somewhat faster.
//! Pulses are shortened by one factor for each experiment until the vehicle as its file says stays on the table.

use super::path::Path;
use fss_launcher::stack::MISSIONS;
use fss_mission::Mission;
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result, miette};
use std::f64::consts::FRAC_PI_2;
use toml::{Table, Value};

/// The experiments that are flown, unless fewer are asked for.
pub(super) const EXPERIMENTS: [&str; 5] = ["coast", "single-joint", "excitation", "thrusters", "mixed"];
/// One more, kept for judging the extended model.
const VALIDATION: &str = "validation";
/// Experiments in which nothing but the arm moves.
const OF_THE_ARM: [&str; 2] = ["single-joint", "excitation"];
/// Joints of the vehicle that the missions were written for, and how far each can turn.
const WRITTEN_FOR: (usize, f64) = (4, FRAC_PI_2);
/// Frequencies of a joint over those of the one four before it.
const FREQUENCY_STEP: f64 = 1.07;
/// The nominal vehicle stays within this distance of the table's middle along each axis, m, and turns no faster than this,
/// rad/s.
const SAFE_M: f64 = 1.6;
const SAFE_RAD_S: f64 = 1.0;
/// Pulses are shortened in these steps, to no less than the mission's own period, s.
const SHORTER: f64 = 0.8;
const PERIOD_S: f64 = 0.05;

/// One experiment of a vehicle.
pub(super) struct Experiment {
    /// The mission's name.
    pub name: String,
    /// The mission file.
    pub text: String,
    /// What the vehicle is told and does, as its file says.
    pub path: Path,
}

/// These experiments as the vehicle can fly them, the one for validation last. An experiment of the arm is left out where there
/// is none; where that leaves nothing the vehicle coasts.
///
/// # Errors
/// Where a mission cannot be fitted to the vehicle.
pub(super) fn of_vehicle(plant: &Plant, names: &[String]) -> Result<Vec<Experiment>> {
    let can_fly = |name: &&str| plant.link_count() > 0 || !OF_THE_ARM.contains(name);
    let mut flown: Vec<&str> = names.iter().map(String::as_str).filter(can_fly).collect();
    if flown.is_empty() {
        flown.push(EXPERIMENTS[0]);
    }
    flown.push(VALIDATION);
    flown.into_iter().map(|name| fitted(name, plant)).collect()
}

fn fitted(name: &str, plant: &Plant) -> Result<Experiment> {
    let name = format!("experiment-{name}");
    let (_, text) = MISSIONS
        .iter()
        .find(|(own, _)| *own == name)
        .ok_or_else(|| miette!("there is no mission '{name}' among those that come with the program"))?;
    let mut table: Table = toml::from_str(text).into_diagnostic()?;
    fit_joints(&mut table, plant);
    loop {
        let text = toml::to_string(&table).into_diagnostic()?;
        let mission = match Mission::parse_for(&text, plant) {
            Ok(mission) => mission,
            // A mission that leaves the table is refused.
            Err(_) if shorten(&mut table) => continue,
            Err(error) => return Err(miette!("{name} does not fit this vehicle: {}", error.message)),
        };
        let path = Path::of(&mission, plant)?;
        let is_safe = path.farthest_m() < SAFE_M && path.fastest_rad_s() < SAFE_RAD_S;
        if is_safe || !shorten(&mut table) {
            return Ok(Experiment { name, text, path });
        }
    }
}

/// Every table of `[[phase]]`.
fn phases(mission: &mut Table) -> Vec<&mut Table> {
    let phases = mission.get_mut("phase").and_then(Value::as_array_mut);
    phases.map_or_else(Vec::new, |all| all.iter_mut().filter_map(Value::as_table_mut).collect())
}

/// Makes every pulse shorter; false where none can be.
fn shorten(mission: &mut Table) -> bool {
    let mut any = false;
    for phase in phases(mission) {
        for pulse in entries(phase, "base", "pulses") {
            let Some(for_s) = pulse.get("for_s").and_then(number) else { continue };
            // In whole periods of the mission, and by one at least.
            let periods = (for_s / PERIOD_S).round();
            let shorter = (periods * SHORTER).round().min(periods - 1.0).max(1.0) * PERIOD_S;
            any |= shorter < for_s - 1e-9;
            pulse.insert("for_s".to_owned(), Value::Float(shorter));
        }
    }
    any
}

/// Every table in the list `list` of the goal `goal` of a phase.
fn entries<'a>(phase: &'a mut Table, goal: &str, list: &str) -> Vec<&'a mut Table> {
    let goal = phase.get_mut(goal).and_then(Value::as_table_mut);
    let list = goal.and_then(|goal| goal.get_mut(list)).and_then(Value::as_array_mut);
    list.map_or_else(Vec::new, |list| list.iter_mut().filter_map(Value::as_table_mut).collect())
}

fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

fn numbers(table: &Table, key: &str) -> Vec<f64> {
    table.get(key).and_then(Value::as_array).map_or_else(Vec::new, |all| all.iter().filter_map(number).collect())
}

/// What the missions were written for, spread to the joints of a plant.
fn fit_joints(mission: &mut Table, plant: &Plant) {
    let home: Vec<f64> =
        mission.get("initial").and_then(Value::as_table).map_or_else(Vec::new, |initial| numbers(initial, "q_deg"));
    if let Some(initial) = mission.get_mut("initial").and_then(Value::as_table_mut) {
        set_angles(initial, plant, &home);
    }
    let moves_one = |phase: &Table| {
        let arm = phase.get("arm").and_then(Value::as_table)?;
        let is_joints = arm.get("goal").and_then(Value::as_str) == Some("joints");
        is_joints.then(|| numbers(arm, "q_deg"))
    };
    if let Some(all) = mission.get("phase").and_then(Value::as_array).cloned()
        && all.iter().filter_map(Value::as_table).all(|phase| moves_one(phase).is_some())
    {
        mission.insert("phase".to_owned(), Value::Array(one_after_the_other(&all, &home, plant)));
        return;
    }
    for phase in phases(mission) {
        if plant.thrusters.is_empty() {
            phase.insert("base".to_owned(), Value::Table(goal("free")));
        }
        fit_pulses(phase, plant.thrusters.len());
        let Some(arm) = phase.get_mut("arm").and_then(Value::as_table_mut) else { continue };
        if plant.links.is_empty() {
            *arm = goal("off");
        } else if arm.contains_key("q_deg") {
            let about = numbers(arm, "q_deg");
            set_angles(arm, plant, &about);
            fit_sines(arm, plant);
        }
    }
}

fn goal(name: &str) -> Table {
    Table::from_iter([("goal".to_owned(), Value::String(name.to_owned()))])
}

/// Share of the range that the missions were written for; a joint that turns further uses no more.
fn range_share(plant: &Plant, joint: usize) -> f64 {
    plant.links.get(joint).map_or(1.0, |link| (link.joint_limit_rad / WRITTEN_FOR.1).min(1.0))
}

/// One angle for each joint, from those of four.
fn spread(plant: &Plant, of_four: &[f64]) -> Vec<f64> {
    let of = |joint: usize| of_four.get(joint % WRITTEN_FOR.0).copied().unwrap_or(0.0);
    (0..plant.link_count()).map(|joint| of(joint) * range_share(plant, joint)).collect()
}

fn set_angles(table: &mut Table, plant: &Plant, of_four: &[f64]) {
    if plant.links.is_empty() {
        table.remove("q_deg");
    } else {
        let angles = spread(plant, of_four).into_iter().map(Value::Float).collect();
        table.insert("q_deg".to_owned(), Value::Array(angles));
    }
}

/// Out and back of each joint, from phases that do so with four.
fn one_after_the_other(phases: &[Value], home: &[f64], plant: &Plant) -> Vec<Value> {
    let mut all = Vec::new();
    for joint in 0..plant.link_count() {
        let of_four = joint % WRITTEN_FOR.0;
        for (phase, way) in phases.iter().skip(2 * of_four).take(2).zip(["out", "back"]) {
            let mut phase = phase.clone();
            let Some(table) = phase.as_table_mut() else { continue };
            table.insert("name".to_owned(), Value::String(format!("joint {} {way}", joint + 1)));
            if let Some(arm) = table.get_mut("arm").and_then(Value::as_table_mut) {
                let moved = numbers(arm, "q_deg");
                let mut angles = spread(plant, home);
                angles[joint] = moved.get(of_four).copied().unwrap_or(0.0) * range_share(plant, joint);
                arm.insert("q_deg".to_owned(), Value::Array(angles.into_iter().map(Value::Float).collect()));
            }
            all.push(phase);
        }
    }
    all
}

/// Leaves out thrusters that the vehicle does not have, and pulses of none.
fn fit_pulses(phase: &mut Table, count: usize) {
    let base = phase.get_mut("base").and_then(Value::as_table_mut);
    let Some(pulses) = base.and_then(|base| base.get_mut("pulses")).and_then(Value::as_array_mut) else { return };
    pulses.retain_mut(|pulse| {
        let thrusters = pulse.get_mut("thrusters").and_then(Value::as_array_mut);
        thrusters.is_some_and(|thrusters| {
            thrusters.retain(|thruster| number(thruster).is_some_and(|number| number <= count as f64));
            !thrusters.is_empty()
        })
    });
}

fn fit_sines(arm: &mut Table, plant: &Plant) {
    let Some(sines) = arm.get_mut("sines").and_then(Value::as_array_mut) else { return };
    let written: Vec<Table> = sines.iter().filter_map(Value::as_table).cloned().collect();
    sines.clear();
    for joint in 0..plant.link_count() {
        let (round, of_four) = (joint / WRITTEN_FOR.0, joint % WRITTEN_FOR.0 + 1);
        for sine in written.iter().filter(|sine| sine.get("joint").and_then(number) == Some(of_four as f64)) {
            let mut sine = sine.clone();
            let mut scale = |key: &str, factor: f64| {
                if let Some(value) = sine.get(key).and_then(number) {
                    sine.insert(key.to_owned(), Value::Float(value * factor));
                }
            };
            scale("amplitude_deg", range_share(plant, joint));
            scale("frequency_Hz", FREQUENCY_STEP.powi(round as i32));
            sine.insert("joint".to_owned(), Value::Integer(joint as i64 + 1));
            sines.push(Value::Table(sine));
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::vehicle;
    use super::*;

    #[test]
    fn every_vehicle_can_fly_its_experiments_and_stays_on_the_table() {
        let own = Plant::default_laboratory().unwrap();
        let names = EXPERIMENTS.map(str::to_owned);
        for seed in 0..30 {
            let (plant, _) = vehicle::draw(seed, &own);
            let experiments = of_vehicle(&plant, &names).unwrap();
            let arm = if plant.link_count() > 0 { 0 } else { OF_THE_ARM.len() };
            assert_eq!(experiments.len() + arm, EXPERIMENTS.len() + 1, "seed {seed}");
            for Experiment { name, path, .. } in &experiments {
                let (farthest_m, fastest_rad_s) = (path.farthest_m(), path.fastest_rad_s());
                assert!(farthest_m < SAFE_M, "seed {seed}, {name}: {farthest_m} m");
                assert!(fastest_rad_s < SAFE_RAD_S, "seed {seed}, {name}: {fastest_rad_s} rad/s");
            }
        }
    }

    #[test]
    fn more_than_four_joints_move_too() {
        let mut plant = Plant::default_laboratory().unwrap();
        plant.links.extend_from_within(2..);
        let experiments = of_vehicle(&plant, &["single-joint".to_owned(), "excitation".to_owned()]).unwrap();
        for experiment in &experiments {
            for joint in 0..6 {
                let angles = experiment.path.q_rad.iter().map(|q| q[joint]);
                let spread = angles.clone().fold(f64::MIN, f64::max) - angles.fold(f64::MAX, f64::min);
                assert!(spread > 0.3, "{}: joint {} moves {spread} rad", experiment.name, joint + 1);
            }
        }
    }
}
