//! What a campaign varies, and its folder.

use super::sweep::{Sweep, SweptValue};
use fss_launcher::files::write_silently;
use fss_launcher::stack::{LABORATORY_FILE, Stack};
use fss_service::{LAUNCH_FILE, MISSION_FILE, PLANT_FILE};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::{Path, PathBuf};

const FILE: &str = "campaign.toml";
/// The folder of the shards' tables; nothing else lies in it, so that it can be read as one table.
pub(super) const TABLES: &str = "runs";
const FORMAT: &str = "fss-campaign/1";

/// What a person asks for.
pub(super) struct Wanted<'a> {
    pub mission: &'a str,
    pub seeds: Range<u64>,
    pub sweep: &'a [Sweep],
    pub plant: Option<&'a Path>,
    pub laboratory: Option<&'a Path>,
    pub launch: Option<&'a Path>,
    pub folder: &'a Path,
}

/// `campaign.toml`.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Definition {
    format: String,
    mission: String,
    /// First seed, and the one behind the last.
    seeds: [u64; 2],
    /// As they were given.
    sweep: Vec<String>,
}

/// A campaign that lies in a folder.
pub(super) struct Campaign {
    /// Where it lies.
    pub folder: PathBuf,
    /// The stack without any value of the sweeps.
    pub stack: Stack,
    /// What varies, beside the seed.
    pub sweeps: Vec<Sweep>,
    seeds: Range<u64>,
}

impl Campaign {
    /// Whether a campaign lies in this folder.
    pub(super) fn lies_in(folder: &Path) -> bool {
        folder.join(FILE).exists()
    }

    /// The campaign in a folder.
    pub(super) fn open(folder: &Path) -> Result<Self> {
        let path = folder.join(FILE);
        let say = || format!("cannot go on with {}", path.display());
        let text = std::fs::read_to_string(&path).into_diagnostic().wrap_err_with(say)?;
        let definition: Definition = toml::from_str(&text).into_diagnostic().wrap_err_with(say)?;
        if definition.format != FORMAT {
            return Err(miette!("{}: its format is '{}', not '{FORMAT}'", path.display(), definition.format));
        }
        let file = |name: &str| folder.join(name);
        let mission = file(MISSION_FILE);
        let mut stack = Stack::load(Some(&file(LAUNCH_FILE)), Some(&file(PLANT_FILE)), &mission.to_string_lossy())?;
        stack.mission_name = definition.mission;
        let laboratory = file(LABORATORY_FILE);
        if laboratory.exists() {
            stack = stack.in_laboratory(&laboratory)?;
        }
        let sweeps: Result<_, String> = definition.sweep.iter().map(|text| text.parse()).collect();
        let sweeps = sweeps.map_err(|e| miette!("{e}")).wrap_err_with(say)?;
        let [first, end] = definition.seeds;
        Ok(Self { folder: folder.to_owned(), stack, sweeps, seeds: first..end })
    }

    /// The campaign that is asked for, in its folder; the one that lies there if it is the same.
    ///
    /// # Errors
    /// Where another lies there, or no run of this one could fly.
    pub(super) fn begin(wanted: &Wanted<'_>) -> Result<Self> {
        let mut stack = Stack::load(wanted.launch, wanted.plant, wanted.mission)?;
        if let Some(laboratory) = wanted.laboratory {
            stack = stack.in_laboratory(laboratory)?;
        }
        let folder = wanted.folder.to_owned();
        let new = Self { folder, stack, sweeps: wanted.sweep.to_vec(), seeds: wanted.seeds.clone() };
        new.check()?;
        if Self::lies_in(wanted.folder) {
            let old = Self::open(wanted.folder)?;
            return match new.difference(&old) {
                None => Ok(old),
                Some(what) => Err(miette!(
                    help = "name another folder with --out, or go on with that one by --out alone",
                    "{} holds another campaign: its {what} differs",
                    wanted.folder.display()
                )),
            };
        }
        new.write()?;
        Ok(new)
    }

    /// Refuses sweeps with which nothing can fly. A part of a sweep may be beyond what the plant can do: its runs say so.
    fn check(&self) -> Result<()> {
        if let Some(twice) =
            self.sweeps.iter().enumerate().find(|(i, s)| self.sweeps[..*i].iter().any(|o| o.key == s.key))
        {
            return Err(miette!("--sweep {} is given twice", twice.1.key));
        }
        // Each alone, so that the error is of the one that is to blame.
        for sweep in &self.sweeps {
            let stack = |value: &f64| self.swept(&[sweep.at(*value)]);
            let mut refusal = None;
            if sweep.values.iter().all(|value| stack(value).map_err(|e| refusal.get_or_insert(e)).is_err())
                && let Some(refusal) = refusal
            {
                return Err(refusal.wrap_err(format!("--sweep {}: no run can fly", sweep.text)));
            }
        }
        Ok(())
    }

    /// How many runs it has; they are counted from 1.
    pub(super) fn count(&self) -> u64 {
        let points: usize = self.sweeps.iter().map(|sweep| sweep.values.len()).product();
        points as u64 * (self.seeds.end - self.seeds.start)
    }

    /// The seed of a run: of one combination of swept values all seeds come first.
    pub(super) fn seed(&self, run: u64) -> u64 {
        self.seeds.start + (run - 1) % (self.seeds.end - self.seeds.start)
    }

    /// The swept values of a run; the last sweep varies fastest.
    pub(super) fn point(&self, run: u64) -> Vec<SweptValue> {
        let mut left = ((run - 1) / (self.seeds.end - self.seeds.start)) as usize;
        let mut values: Vec<SweptValue> = Vec::with_capacity(self.sweeps.len());
        for sweep in self.sweeps.iter().rev() {
            values.push(sweep.at(sweep.values[left % sweep.values.len()]));
            left /= sweep.values.len();
        }
        values.reverse();
        values
    }

    /// Seed and stack of a run.
    ///
    /// # Errors
    /// Where it has no such run, or the run's values make no sense.
    pub(super) fn stack(&self, run: u64) -> Result<(u64, Stack)> {
        if !(1..=self.count()).contains(&run) {
            return Err(miette!("there is no run {run}: the campaign has runs 1 to {}", self.count()));
        }
        self.swept(&self.point(run)).map(|stack| (self.seed(run), stack))
    }

    fn swept(&self, values: &[SweptValue]) -> Result<Stack> {
        let mut texts = self.stack.texts();
        // The laboratory differs from the plant in its own values alone, whatever the order of the sweeps.
        let (of_laboratory, others): (Vec<_>, Vec<_>) = values.iter().partition(|value| value.is_of_laboratory());
        others.into_iter().chain(of_laboratory).try_for_each(|value| value.set(&mut texts))?;
        let words: Vec<String> = values.iter().map(ToString::to_string).collect();
        self.stack.with_texts(texts, &words.join(", "))
    }

    fn definition(&self) -> Definition {
        Definition {
            format: FORMAT.to_owned(),
            mission: self.stack.mission_name.clone(),
            seeds: [self.seeds.start, self.seeds.end],
            sweep: self.sweeps.iter().map(|sweep| sweep.text.clone()).collect(),
        }
    }

    /// In what two campaigns differ.
    fn difference(&self, other: &Self) -> Option<&'static str> {
        let (a, b) = (self.definition(), other.definition());
        let (of_a, of_b) = (self.stack.texts(), other.stack.texts());
        [
            ("mission", a.mission == b.mission && of_a.mission == of_b.mission),
            ("range of seeds", a.seeds == b.seeds),
            ("sweep", a.sweep == b.sweep),
            ("plant file", of_a.plant == of_b.plant),
            ("laboratory", of_a.laboratory == of_b.laboratory),
            ("launch file", self.stack.launch_text == other.stack.launch_text),
        ]
        .into_iter()
        .find_map(|(what, is_same)| (!is_same).then_some(what))
    }

    /// Writes its files; the one that makes the folder a campaign comes last.
    fn write(&self) -> Result<()> {
        let folder = &self.folder;
        let say = || format!("cannot make {}", folder.display());
        std::fs::create_dir_all(folder.join(TABLES)).into_diagnostic().wrap_err_with(say)?;
        let texts = self.stack.texts();
        write_silently(&folder.join(LAUNCH_FILE), &self.stack.launch_text)?;
        write_silently(&folder.join(PLANT_FILE), &texts.plant)?;
        write_silently(&folder.join(MISSION_FILE), &texts.mission)?;
        if let Some(text) = &texts.laboratory {
            write_silently(&folder.join(LABORATORY_FILE), text)?;
        }
        let part = folder.join(format!("{FILE}.part"));
        write_silently(&part, &toml::to_string(&self.definition()).into_diagnostic()?)?;
        std::fs::rename(&part, folder.join(FILE)).into_diagnostic()
    }
}
