//! One seed: draw a vehicle, seal, fly, diagnose, open.

use super::answer::{Answer, answer};
use super::experiments::{Experiment, of_vehicle};
use super::record::Envelope;
use super::score::{Score, score};
use super::{laboratory, secret, vehicle};
use fss_launcher::fast;
use fss_launcher::files::write_silently;
use fss_launcher::stack::{DEFAULT_LAUNCH, Stack};
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;
use toml::{Table, Value};

/// The sealed envelope's name in the folder of a game.
pub(super) const ENVELOPE_FILE: &str = "sealed.json";

/// A seed that was played.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Played {
    /// What was in the envelope.
    pub hidden: Envelope,
    /// What the diagnosis said without knowing it.
    pub said: Answer,
    /// How good that is.
    pub score: Score,
    /// What drawing the vehicle and its secret took, s.
    pub drawn_in_s: f64,
    /// What flying took, s.
    pub flown_in_s: f64,
    /// What diagnosing took, s.
    pub diagnosed_in_s: f64,
}

/// What all seeds share.
pub(super) struct Game {
    /// The vehicle of the plant file.
    pub plant: Plant,
    /// Whether other vehicles are drawn too.
    pub draws_vehicles: bool,
    /// Experiments to fly, without the one for validation.
    pub experiments: Vec<String>,
}

/// How a seed is played.
#[derive(Clone, Copy)]
pub(super) struct Manner<'a> {
    /// Where logs and envelope are left, or nowhere.
    pub folder: Option<&'a Path>,
    /// Whether the logs stay.
    pub keeps_logs: bool,
    /// Whether the game takes one core only, so that others can be played beside it.
    pub on_one_core: bool,
    /// Hears what is going on.
    pub say: &'a (dyn Fn(&str) + Sync),
}

impl Game {
    /// Plays a seed.
    ///
    /// # Errors
    /// Where the seed's laboratory cannot be flown or the diagnosis fails.
    pub(super) fn play(&self, seed: u64, manner: Manner<'_>) -> Result<Played> {
        (manner.say)("sealing an envelope");
        let begun = Instant::now();
        let (plant, is_own) =
            if self.draws_vehicles { vehicle::draw(seed, &self.plant) } else { (self.plant.clone(), true) };
        let experiments = of_vehicle(&plant, &self.experiments)?;
        let (_validation, fitted) = experiments.split_last().ok_or_else(|| miette!("there is no experiment to fly"))?;
        let paths = fitted.iter().map(|experiment| &experiment.path).collect();
        let secret = secret::draw(seed, &plant, is_own, paths)?;
        let room = laboratory::draw(seed, &plant)?.with_effects(&secret.effects);
        let scratch = if manner.folder.is_none() { Some(Scratch::new(&format!("seed-{seed}"))?) } else { None };
        let folder = manner.folder.or(scratch.as_ref().map(|s| s.0.as_path())).unwrap_or(Path::new("."));
        make(folder)?;
        let sealed = serde_json::to_string_pretty(&secret.envelope).into_diagnostic()?;
        write_silently(&folder.join(ENVELOPE_FILE), &sealed)?;
        write_silently(&folder.join(LABORATORY), &room.to_toml().into_diagnostic()?)?;
        let stacks = stacks(&plant, &experiments, folder)?;
        let drawn_in_s = begun.elapsed().as_secs_f64();

        (manner.say)("flying the experiments");
        let begun = Instant::now();
        let logs = fly(&stacks, &room, seed, folder, manner.on_one_core)?;
        let flown_in_s = begun.elapsed().as_secs_f64();

        (manner.say)("diagnosing the logs");
        let begun = Instant::now();
        let said = answer(&folder.join(PLANT), &logs, folder, manner.on_one_core.then_some(1));
        if !manner.keeps_logs {
            for log in &logs {
                std::fs::remove_file(log)
                    .into_diagnostic()
                    .wrap_err_with(|| format!("cannot remove {}", log.display()))?;
            }
        }
        let said = said?;
        let score = score(&secret.envelope, &said);
        let diagnosed_in_s = begun.elapsed().as_secs_f64();
        Ok(Played { hidden: secret.envelope, said, score, drawn_in_s, flown_in_s, diagnosed_in_s })
    }
}

/// The plant file in the folder of a game: what the diagnosis gets.
const PLANT: &str = "plant.toml";
/// The laboratory that flies, with what it hides: who has opened the envelope can fly it again, `fss run --laboratory`.
const LABORATORY: &str = "sealed-laboratory.toml";

/// Writes the vehicle's files into the folder and reads them as a user's: one stack for each experiment.
fn stacks(plant: &Plant, experiments: &[Experiment], folder: &Path) -> Result<Vec<Stack>> {
    let (plant_file, launch_file) = (folder.join(PLANT), folder.join("launch.toml"));
    write_silently(&plant_file, &plant.to_toml().into_diagnostic()?)?;
    write_silently(&launch_file, &launch_of(plant.link_count())?)?;
    let stack = |experiment: &Experiment| {
        let mission = folder.join(format!("{}.toml", experiment.name));
        write_silently(&mission, &experiment.text)?;
        Stack::load(Some(&launch_file), Some(&plant_file), &mission.to_string_lossy())
    };
    experiments.iter().map(stack).collect()
}

/// The program's launch file for a vehicle with so many links.
fn launch_of(links: usize) -> Result<String> {
    let mut launch: Table = toml::from_str(DEFAULT_LAUNCH).into_diagnostic()?;
    if let Some(devices) = launch.get_mut("devices").and_then(Value::as_table_mut) {
        // Nobody listens there: the laboratory flies in this process.
        let addresses = (1..=links).map(|link| Value::String(format!("127.0.0.1:{}", 51100 + link))).collect();
        devices.insert("links".to_owned(), Value::Array(addresses));
    }
    toml::to_string(&launch).into_diagnostic()
}

/// Flies the missions in a laboratory; gives their logs.
fn fly(stacks: &[Stack], laboratory: &Plant, seed: u64, folder: &Path, on_one_core: bool) -> Result<Vec<PathBuf>> {
    let flown = |(k, stack): (usize, &Stack)| {
        let folder = folder.join(&stack.mission_name);
        make(&folder)?;
        let path = folder.join("run.mcap");
        fast::fly(stack, laboratory, &path, seed.wrapping_mul(16).wrapping_add(k as u64), |_| ())?;
        Ok(path)
    };
    if on_one_core {
        stacks.iter().enumerate().map(flown).collect()
    } else {
        stacks.par_iter().enumerate().map(flown).collect()
    }
}

fn make(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).into_diagnostic().wrap_err_with(|| format!("cannot make {}", folder.display()))
}

/// What the folders of games begin with; the number of the process that plays follows.
const SCRATCH: &str = "fss-challenge-";

/// Removes the folders of games whose process was killed.
pub(super) fn sweep() {
    let Ok(entries) = std::fs::read_dir(std::env::temp_dir()) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let process = name.to_str().and_then(|name| name.strip_prefix(SCRATCH)).and_then(|rest| rest.split('-').next());
        let Some(process) = process.and_then(|number| number.parse::<u32>().ok()) else { continue };
        if !Path::new("/proc").join(process.to_string()).exists() {
            // Another user's folder stays.
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

/// A folder that is gone when it is no longer needed.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Result<Self> {
        let path = std::env::temp_dir().join(format!("{SCRATCH}{}-{name}", std::process::id()));
        make(&path)?;
        Ok(Self(path))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What cannot be removed is left to the system's own cleaning.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
