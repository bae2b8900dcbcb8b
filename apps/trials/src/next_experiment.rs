//! `fss next-experiment`: the maneuver that decides best between causes that a diagnosis could not tell apart.
//!
//! Every candidate maneuver is flown once with the plant as its file says, to know what it commands. Its commands are then
//! played on one simulated laboratory for each cause that is still possible, without noise. What two of them show
//! differently, over noise and disturbance and with the windows' initial states taken off, is how well that maneuver
//! separates their causes; the pair that it separates worst counts.

mod paired_simulation;

use clap::Args;
use fss_launcher::fast;
use fss_launcher::files::{PlantAndAnswer, write, write_silently};
use fss_launcher::stack::{MISSIONS, Stack};
use fss_plant::{Effect, Plant};
use fss_report::diagnose::answer::{Alternative, Answer, Cause};
use fss_report::diagnose::log;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use paired_simulation::{Difference, PairedSimulation};
use rayon::prelude::*;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// An alternative less probable than this is decided already.
const STILL_POSSIBLE: f64 = 0.02;
/// Causes that are compared at most: the first and its most probable alternatives.
const MOST_CAUSES: usize = 4;
/// A maneuver that shows less, RMS over noise and disturbance, hardly decides: its thousands of samples tell about a tenth.
const WORTH_FLYING: f64 = 0.1;
/// How far from the middle of the table the base may come along an axis, m.
const SAFE_M: f64 = 1.75;
/// The built-in missions that are candidates, each at the headings below beside its own.
const PREFIX: &str = "experiment-";
const TURNS_DEG: [f64; 3] = [0.0, 90.0, 180.0];

/// Find the maneuver that decides best between causes that a diagnosis could not tell apart.
///
/// Reads DIR/diagnosis.json of `fss diagnose` and writes a mission file that `fss run` flies.
#[derive(Args)]
pub struct NextExperimentArgs {
    /// Folder of a diagnosis.
    #[arg(value_name = "DIR")]
    diagnosis: PathBuf,
    #[command(flatten)]
    files: PlantAndAnswer,
}

/// What one maneuver would show.
#[derive(Serialize)]
struct Candidate {
    mission: String,
    theta_deg: f64,
    /// Smallest RMS by which two causes differ in the channel that shows most of it, over noise and disturbance.
    separation: f64,
    duration_s: f64,
    gas_kg: f64,
    farthest_m: f64,
    #[serde(skip)]
    text: String,
}

/// Runs the command.
pub fn run(args: &NextExperimentArgs) -> Result<()> {
    let diagnosis = Answer::read(&args.diagnosis.join("diagnosis.json"))?;
    let (settled, rivals) = undecided(&diagnosis)?;
    if rivals.len() < 2 {
        say!("Nothing is undecided: no cause has an alternative with a probability of {STILL_POSSIBLE} or more.");
        return Ok(());
    }
    say!("Undecided between:");
    for rival in &rivals {
        say!("  {rival}");
    }
    let mut candidates = candidates(&args.files.plant, &settled, &rivals)?;
    candidates.retain(|c| c.farthest_m < SAFE_M);
    candidates.sort_by(|a, b| b.separation.total_cmp(&a.separation));
    let best = candidates.first().ok_or_else(|| miette!("no candidate maneuver stays on the table"))?;
    say!("\n{:<28}{:>8}{:>12}{:>8}{:>10}", "maneuver", "theta", "separation", "s", "gas kg");
    for c in &candidates {
        say!("{:<28}{:>8.0}{:>12.2}{:>8.0}{:>10.4}", c.mission, c.theta_deg, c.separation, c.duration_s, c.gas_kg);
    }
    let header = format!(
        "# Made by fss next-experiment to decide between {}.\n# Expected separation {:.2} times noise and disturbance, {:.0} s, {:.4} kg of gas.\n",
        rivals.iter().map(ToString::to_string).collect::<Vec<_>>().join(" and "),
        best.separation,
        best.duration_s,
        best.gas_kg
    );
    write(&args.files.out, &format!("{header}{}", best.text))?;
    if best.separation < WORTH_FLYING {
        say!(
            "None separates them well: each differs by less than {WORTH_FLYING} of noise and disturbance. A longer flight would help."
        );
    }
    args.files.write_json(&candidates)
}

/// What is taken for settled, and the causes that are still possible in the place of the first undecided one.
fn undecided(diagnosis: &Answer) -> Result<(Vec<Effect>, Vec<Effect>)> {
    let all = if diagnosis.causes.is_empty() { &diagnosis.suspects } else { &diagnosis.causes };
    let open = |said: &&Cause| said.alternatives.iter().any(|a| a.probability >= STILL_POSSIBLE);
    let Some(first) = all.iter().find(open) else { return Ok((Vec::new(), Vec::new())) };
    let settled = all.iter().filter(|said| !std::ptr::eq(*said, first)).map(Cause::effect).collect::<Result<_>>()?;
    let possible = first.alternatives.iter().filter(|a| a.probability >= STILL_POSSIBLE);
    let rivals = std::iter::once(first.effect()).chain(possible.map(Alternative::effect));
    let rivals = rivals.take(MOST_CAUSES).collect::<Result<_>>()?;
    Ok((settled, rivals))
}

/// Every candidate maneuver with what it would show.
fn candidates(plant: &Path, settled: &[Effect], rivals: &[Effect]) -> Result<Vec<Candidate>> {
    let scratch = std::env::temp_dir().join(format!("fss-next-experiment-{}", std::process::id()));
    std::fs::create_dir_all(&scratch)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot make {}", scratch.display()))?;
    let missions: Vec<(&str, f64, String)> = MISSIONS
        .iter()
        .filter(|(name, _)| name.starts_with(PREFIX))
        .flat_map(|(name, text)| TURNS_DEG.iter().filter_map(move |turn| turned(name, text, *turn)))
        .collect();
    let all: Result<Vec<Option<Candidate>>> = missions
        .par_iter()
        .enumerate()
        .map(|(k, (name, theta_deg, text))| {
            candidate(plant, &scratch.join(k.to_string()), (name, *theta_deg, text), settled, rivals)
        })
        .collect();
    // What is left of the scratch folder harms nobody.
    let _ = std::fs::remove_dir_all(&scratch);
    Ok(all?.into_iter().flatten().collect())
}

/// A mission at another heading.
fn turned(name: &'static str, text: &str, turn_deg: f64) -> Option<(&'static str, f64, String)> {
    const KEY: &str = "theta_deg = ";
    let line = text.lines().find(|line| line.starts_with(KEY))?;
    let theta_deg = line[KEY.len()..].trim().parse::<f64>().ok()? + turn_deg;
    let theta_deg = if theta_deg > 180.0 { theta_deg - 360.0 } else { theta_deg };
    Some((name, theta_deg, text.replacen(line, &format!("{KEY}{theta_deg}"), 1)))
}

/// What one maneuver shows; `None` where the plant cannot fly it.
fn candidate(
    plant: &Path,
    folder: &Path,
    (name, theta_deg, text): (&str, f64, &str),
    settled: &[Effect],
    rivals: &[Effect],
) -> Result<Option<Candidate>> {
    std::fs::create_dir_all(folder).into_diagnostic().wrap_err_with(|| format!("cannot make {}", folder.display()))?;
    let file = folder.join("mission.toml");
    write_silently(&file, text)?;
    let mission = file.to_string_lossy().into_owned();
    // A plant with fewer valves or joints than the maneuver asks for has nothing to learn from it.
    let Ok(stack) = Stack::load(None, Some(plant), &mission) else { return Ok(None) };
    let believed = stack.plant.nominal();
    let path = folder.join("run.mcap");
    fast::fly(&stack, &believed, &path, 0, |_| ())?;
    let commands = log::commands(&path, &believed)?;
    let mut gas_kg = 0.0;
    commands.play(&believed, 0, 1000, |simulation| gas_kg = simulation.gas_used_kg()).into_diagnostic()?;
    let paired = PairedSimulation::new(&believed, vec![commands])?;
    let with = |rival: &Effect| -> Plant {
        let mut effects = settled.to_vec();
        effects.push(rival.clone());
        believed.with_effects(&effects)
    };
    let (mut separation, mut farthest_m) = (f64::INFINITY, 0.0_f64);
    for (i, a) in rivals.iter().enumerate() {
        let baseline = paired.baseline(&with(a))?;
        for b in &rivals[i + 1..] {
            let difference: Difference = paired.difference(&with(b), &baseline)?;
            separation = separation.min(difference.effect_size_of(&difference.samples()));
            farthest_m = farthest_m.max(difference.farthest_m());
        }
    }
    let duration_s = stack.mission.duration_s();
    Ok(Some(Candidate {
        mission: name.to_owned(),
        theta_deg,
        separation,
        duration_s,
        gas_kg,
        farthest_m,
        text: text.to_owned(),
    }))
}
