//! One seed: seal, fly, diagnose, open.

use super::answer::{Answer, answer};
use super::hidden::{Envelope, draw};
use super::score::{Score, score};
use super::survey::Survey;
use super::twins::Twins;
use crate::diagnose::log;
use crate::files::write_silently;
use crate::run::fast;
use crate::run::stack::Stack;
use fss_lab::Network;
use fss_plant::Plant;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, Result, WrapErr};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The experiments that are flown, unless fewer are asked for.
pub const EXPERIMENTS: [&str; 5] = ["coast", "single-joint", "excitation", "thrusters", "mixed"];
/// One more, kept for judging the extended model.
const VALIDATION: &str = "validation";
/// The sealed envelope's name in the folder of a game.
pub const ENVELOPE_FILE: &str = "sealed.json";

/// A seed that was played.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Played {
    /// What was in the envelope.
    pub hidden: Envelope,
    /// What the diagnosis said without knowing it.
    pub said: Answer,
    /// How good that is.
    pub score: Score,
    /// What flying and diagnosing took, s.
    pub flown_in_s: f64,
    /// See `flown_in_s`.
    pub diagnosed_in_s: f64,
}

/// What all seeds share.
pub struct Game {
    plant: Plant,
    stacks: Vec<Stack>,
    twins: Twins,
    survey: Option<Survey>,
}

impl Game {
    /// Makes ready: flies these experiments once on the plant as its file says, to know what they command.
    ///
    /// # Errors
    /// Where the plant file is refused or the experiments cannot be flown with it.
    pub fn new(plant: Option<&Path>, experiments: &[String]) -> Result<Self> {
        // Experiments are flown in a quiet radio band: when a command reaches its link cannot be told from a log, and what
        // the joints do in that time shakes the base.
        let quiet = Network { delay_s: 0.0045, jitter_s: 0.001, ..Network::default() };
        let stack = |name: &str| {
            let mut stack = Stack::load(None, plant, &format!("experiment-{name}"))?;
            stack.faults.network.link_up = Some(quiet);
            Ok(stack)
        };
        let names = experiments.iter().map(String::as_str).chain([VALIDATION]);
        let stacks: Vec<Stack> = names.map(stack).collect::<Result<_>>()?;
        let plant = stacks[0].plant.nominal();
        let folder = Scratch::new("rehearsal")?;
        let logs = fly(&stacks[..experiments.len()], &plant, 0, &folder.0)?;
        let flights = logs.iter().map(|path| log::commands(path, &plant)).collect::<Result<_>>()?;
        let twins = Twins::new(&plant, flights)?;
        Ok(Self { plant, stacks, twins, survey: None })
    }

    /// The same with a survey of what the experiments can tell apart, which takes about a minute.
    ///
    /// # Errors
    /// Where the plant is no mechanism.
    pub fn surveyed(mut self) -> Result<Self> {
        let bar = ProgressBar::new(Survey::size(&self.plant) as u64);
        if let Ok(style) =
            ProgressStyle::with_template("[{bar:40}] {pos} of {len} twin flights to survey the experiments")
        {
            bar.set_style(style.progress_chars("=> "));
        }
        self.survey = Some(Survey::new(&self.plant, &self.twins, &|| bar.inc(1))?);
        bar.finish_and_clear();
        Ok(self)
    }

    /// Plays a seed; logs and envelope are left in `folder`, or nowhere. The diagnosis takes `threads`, or all that there
    /// are. `say` hears what is going on.
    ///
    /// # Errors
    /// Where the seed's laboratory cannot be flown or the diagnosis fails.
    pub fn play(
        &self,
        seed: u64,
        folder: Option<&Path>,
        threads: Option<usize>,
        say: &(dyn Fn(&str) + Sync),
    ) -> Result<Played> {
        say("sealing an envelope");
        let secret = draw(seed, &self.plant, &self.twins, self.survey.as_ref())?;
        let scratch = if folder.is_none() { Some(Scratch::new(&format!("seed-{seed}"))?) } else { None };
        let folder = folder.or(scratch.as_ref().map(|s| s.0.as_path())).unwrap_or(Path::new("."));
        make(folder)?;
        let sealed = serde_json::to_string_pretty(&secret.envelope).into_diagnostic()?;
        write_silently(&folder.join(ENVELOPE_FILE), &sealed)?;
        let plant = folder.join("plant.toml");
        write_silently(&plant, &self.stacks[0].plant_text)?;

        say("flying the experiments");
        let begun = Instant::now();
        let logs = fly(&self.stacks, &secret.laboratory, seed, folder)?;
        let flown_in_s = begun.elapsed().as_secs_f64();

        say("diagnosing the logs");
        let begun = Instant::now();
        let said = answer(&plant, &logs, folder, threads)?;
        let score = score(&secret.envelope, &said);
        Ok(Played { hidden: secret.envelope, said, score, flown_in_s, diagnosed_in_s: begun.elapsed().as_secs_f64() })
    }
}

/// Flies the missions in a laboratory; gives their logs.
fn fly(stacks: &[Stack], laboratory: &Plant, seed: u64, folder: &Path) -> Result<Vec<PathBuf>> {
    let flown = |(k, stack): (usize, &Stack)| {
        let folder = folder.join(&stack.mission_name);
        make(&folder)?;
        let path = folder.join("run.mcap");
        fast::fly(stack, laboratory, &path, seed.wrapping_mul(16).wrapping_add(k as u64), |_| ())?;
        Ok(path)
    };
    stacks.par_iter().enumerate().map(flown).collect()
}

fn make(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).into_diagnostic().wrap_err_with(|| format!("cannot make {}", folder.display()))
}

/// A folder that is gone when it is no longer needed.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Result<Self> {
        let path = std::env::temp_dir().join(format!("fss-challenge-{}-{name}", std::process::id()));
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
