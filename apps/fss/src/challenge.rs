//! `fss challenge`: a game that the project plays against itself.
//!
//! A seed seals an effect in an envelope. The stack flies its experiments in a laboratory that has this effect, without
//! knowing; the diagnosis gets the logs and the plant file, nothing else. Then the envelope is opened.

mod answer;
mod gates;
mod hidden;
mod play;
mod score;
mod story;
mod survey;
pub mod twins;

use crate::files::write_silently;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use play::{EXPERIMENTS, Game, Played};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Duration;

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
    /// Folder for logs and envelope; of many seeds, one folder each. Where absent, out/challenge-S, or none for many.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Plant file: what the laboratory believes.
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

/// One seed, told as a story.
#[derive(Serialize)]
struct OneFile<'a> {
    format: &'static str,
    #[serde(flatten)]
    played: &'a Played,
}

fn one(args: &ChallengeArgs, seed: u64) -> Result<()> {
    let folder = args.out.clone().unwrap_or_else(|| Path::new("out").join(format!("challenge-{seed}")));
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(Duration::from_millis(100));
    bar.set_message("making ready");
    let game = Game::new(args.plant.as_deref(), &args.experiments)?;
    let played = game.play(seed, Some(&folder), None, &|what| bar.set_message(what.to_owned()))?;
    bar.finish_and_clear();
    story::tell(&played, &folder);
    let file = OneFile { format: "fss-challenge/1", played: &played };
    args.json.as_ref().map_or(Ok(()), |path| write_json(path, &file))
}

/// Many seeds: what was played, and the table of the gates.
#[derive(Serialize, Deserialize)]
struct ManyFile {
    format: String,
    #[serde(default = "all_experiments")]
    experiments: Vec<String>,
    seeds: Vec<Played>,
    #[serde(skip_deserializing)]
    gates: Vec<gates::Gate>,
}

/// Fewer seeds are told by their plain dose.
const WORTH_A_SURVEY: usize = 10;
const MANY_FORMAT: &str = "fss-challenge-table/1";

fn all_experiments() -> Vec<String> {
    EXPERIMENTS.map(str::to_owned).to_vec()
}

fn many(args: &ChallengeArgs, seeds: Range<u64>) -> Result<()> {
    let played = Mutex::new(if args.resume { resumed(args)? } else { BTreeMap::new() });
    let left: Vec<u64> = seeds.clone().filter(|seed| locked(&played).get(seed).is_none()).collect();
    let bar = ProgressBar::new(left.len() as u64);
    if let Ok(style) =
        ProgressStyle::with_template("[{bar:40}] {pos} of {len} seeds, {elapsed} gone, {eta} to go {msg}")
    {
        bar.set_style(style.progress_chars("=> "));
    }
    let mut game = Game::new(args.plant.as_deref(), &args.experiments)?;
    if left.len() >= WORTH_A_SURVEY {
        game = game.surveyed()?;
    }
    bar.reset();
    bar.enable_steady_tick(Duration::from_secs(1));
    let failures = Mutex::new(Vec::new());
    left.par_iter().for_each(|&seed| {
        let folder = args.out.as_ref().map(|out| out.join(format!("seed-{seed}")));
        match game.play(seed, folder.as_deref(), Some(1), &|_| ()) {
            Ok(done) => {
                let mut all = locked(&played);
                all.insert(seed, done);
                // What was played so far can be taken up again.
                if let (Some(path), 0) = (&args.json, all.len() % 10) {
                    let _ = save(path, &args.experiments, &all);
                }
            }
            Err(error) => locked(&failures).push((seed, error)),
        }
        bar.inc(1);
    });
    bar.finish_and_clear();
    let played = played.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    let failures = failures.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    let asked: Vec<&Played> = played.iter().filter(|(seed, _)| seeds.contains(seed)).map(|(_, p)| p).collect();
    gates::print(&asked);
    if let Some(path) = &args.json {
        save(path, &args.experiments, &played)?;
        say!("{}", path.display());
    }
    for (seed, error) in &failures {
        eprintln!("seed {seed} could not be played: {error:?}");
    }
    if failures.is_empty() { Ok(()) } else { Err(miette!("{} seeds could not be played", failures.len())) }
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn resumed(args: &ChallengeArgs) -> Result<BTreeMap<u64, Played>> {
    let Some(path) = args.json.as_ref().filter(|path| path.exists()) else { return Ok(BTreeMap::new()) };
    let text =
        std::fs::read_to_string(path).into_diagnostic().wrap_err_with(|| format!("cannot read {}", path.display()))?;
    let file: ManyFile = serde_json::from_str(&text)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot go on from {}", path.display()))?;
    if file.format != MANY_FORMAT {
        return Err(miette!("{}: its format is '{}', not '{MANY_FORMAT}'", path.display(), file.format));
    }
    if file.experiments != args.experiments {
        let (there, asked) = (file.experiments.join(","), args.experiments.join(","));
        return Err(miette!(
            help = "give another --json file, or --experiments {there}",
            "{}: its seeds flew {there}, not {asked}",
            path.display()
        ));
    }
    Ok(file.seeds.into_iter().map(|played| (played.hidden.seed, played)).collect())
}

fn save(path: &Path, experiments: &[String], played: &BTreeMap<u64, Played>) -> Result<()> {
    let seeds: Vec<Played> = played.values().cloned().collect();
    let gates = gates::table(&seeds.iter().collect::<Vec<_>>());
    write_json(path, &ManyFile { format: MANY_FORMAT.to_owned(), experiments: experiments.to_vec(), seeds, gates })
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    write_silently(path, &serde_json::to_string_pretty(value).into_diagnostic()?)
}
