//! `fss challenge`: a game that the project plays against itself.
//!
//! A seed draws a vehicle and seals an effect in an envelope. The stack flies its experiments in a laboratory that has this
//! effect, without knowing; the diagnosis gets the logs and the vehicle's plant file, nothing else. Then the envelope is opened.

mod answer;
mod effect_size;
mod experiments;
mod gates;
mod laboratory;
mod path;
mod play;
mod prediction;
mod record;
mod score;
mod secret;
mod separability;
mod story;
mod table;
mod vehicle;

use clap::Args;
use experiments::EXPERIMENTS;
use fss_launcher::files::{read_plant, write_silently};
use fss_plant::Plant;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, Report, Result, miette};
use play::{Game, Manner, Played};
use serde::Serialize;
use std::num::NonZero;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::available_parallelism;
use std::time::Duration;
use table::Seeds;

/// Hide an effect, fly experiments against it, diagnose their logs, and score the answer.
#[derive(Args)]
pub struct ChallengeArgs {
    /// Play this seed and tell its story.
    #[arg(long, value_name = "S", required_unless_present = "seeds", conflicts_with = "seeds")]
    seed: Option<u64>,
    /// Play the seeds from A to B, B not included, and print how often the answers were right.
    #[arg(long, value_name = "A..B", value_parser = parse_seeds)]
    seeds: Option<Range<u64>>,
    /// Fly only these experiments, and the one for validation: the fewer, the more stays undecided.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_values = EXPERIMENTS, value_parser = EXPERIMENTS)]
    experiments: Vec<String>,
    /// Folder for logs and envelope, or out/challenge-S. Of many seeds one folder each, without logs, or none.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Plant file of the vehicle that every seed flies. Where absent, a third of the seeds fly the built-in vehicle and the others
    /// draw one.
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Write the result as JSON here.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Take over the seeds that the JSON file holds already.
    #[arg(long, requires = "json", requires = "seeds")]
    resume: bool,
}

/// A range of seeds as a person writes it: `1..301`, without the last.
pub fn parse_seeds(text: &str) -> Result<Range<u64>, String> {
    let (from, to) = text.split_once("..").ok_or("write a range of seeds as 1..300")?;
    let number = |text: &str| text.trim().parse::<u64>().map_err(|e| format!("'{text}': {e}"));
    let range = number(from)?..number(to)?;
    if range.is_empty() { Err(format!("{text} holds no seed")) } else { Ok(range) }
}

/// Runs the command.
pub fn run(args: &ChallengeArgs) -> Result<()> {
    match (&args.seeds, args.seed) {
        (Some(seeds), _) => many(args, seeds.clone()),
        (None, Some(seed)) => one(args, seed),
        (None, None) => Err(miette!("give --seed or --seeds")),
    }
}

/// The file of one seed.
#[derive(Serialize)]
struct OneFile<'a> {
    format: &'static str,
    #[serde(flatten)]
    played: &'a Played,
}

fn game(args: &ChallengeArgs) -> Result<Game> {
    let plant = match &args.plant {
        Some(path) => read_plant(path)?.nominal(),
        None => Plant::default_laboratory().into_diagnostic()?,
    };
    Ok(Game { plant, draws_vehicles: args.plant.is_none(), experiments: args.experiments.clone() })
}

fn one(args: &ChallengeArgs, seed: u64) -> Result<()> {
    let folder = args.out.clone().unwrap_or_else(|| Path::new("out").join(format!("challenge-{seed}")));
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(Duration::from_millis(100));
    let say = |what: &str| bar.set_message(what.to_owned());
    let manner = Manner { folder: Some(&folder), keeps_logs: true, on_one_core: false, say: &say };
    let played = game(args)?.play(seed, manner)?;
    bar.finish_and_clear();
    story::tell(&played, &folder);
    let Some(path) = &args.json else { return Ok(()) };
    let file = OneFile { format: "fss-challenge/2", played: &played };
    write_silently(path, &serde_json::to_string_pretty(&file).into_diagnostic()?)
}

/// Plays many seeds, as many at a time as there are cores.
fn many(args: &ChallengeArgs, seeds: Range<u64>) -> Result<()> {
    let resumed = match &args.json {
        Some(path) if args.resume => table::load(path, &args.experiments)?,
        _ => Seeds::new(),
    };
    let left: Vec<u64> = seeds.clone().filter(|seed| !resumed.contains_key(seed)).collect();
    let bar = ProgressBar::new(left.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos} of {len} seeds, {elapsed} gone, {eta} to go") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_secs(1));
    let game = game(args)?;
    play::sweep();
    let (next, played, failures) = (Mutex::new(left.into_iter()), Mutex::new(resumed), Mutex::new(Vec::new()));
    let player = || {
        while let Some(seed) = { locked(&next).next() } {
            if let Err(error) = play_and_save(args, &game, seed, &played) {
                locked(&failures).push((seed, error));
            }
            bar.inc(1);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..available_parallelism().map_or(1, NonZero::get) {
            scope.spawn(player);
        }
    });
    bar.finish_and_clear();
    let played = played.into_inner().unwrap_or_else(PoisonError::into_inner);
    let failures: Vec<(u64, Report)> = failures.into_inner().unwrap_or_else(PoisonError::into_inner);
    let asked: Vec<&Played> = played.range(seeds).map(|(_, played)| played).collect();
    gates::print(&asked);
    story::misses(&asked);
    if let Some(path) = &args.json {
        table::save(path, &args.experiments, &played)?;
        say!("{}", path.display());
    }
    for (seed, error) in &failures {
        eprintln!("seed {seed} could not be played: {error:?}");
    }
    if failures.is_empty() { Ok(()) } else { Err(miette!("{} seeds could not be played", failures.len())) }
}

/// Plays one of many seeds on one core; logs are gone when it is over, and what was played is in the file.
fn play_and_save(args: &ChallengeArgs, game: &Game, seed: u64, all: &Mutex<Seeds>) -> Result<()> {
    let folder = args.out.as_ref().map(|out| out.join(format!("seed-{seed}")));
    let manner = Manner { folder: folder.as_deref(), keeps_logs: false, on_one_core: true, say: &|_| () };
    let played = game.play(seed, manner)?;
    let mut all = locked(all);
    all.insert(seed, played);
    args.json.as_ref().map_or(Ok(()), |path| table::save(path, &args.experiments, &all))
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
