//! Flights on the virtual clock.

use crate::error::from_report;
use crate::job;
use fss_lab::Faults;
use fss_launcher::console;
use fss_launcher::fast;
use fss_launcher::files::TextFile;
use fss_launcher::stack::{FAULT_EVERY_S, LOG_FILE, Stack, Texts};
use fss_messages::MissionState;
use fss_report::flown::conclude;
use miette::{IntoDiagnostic, Result, WrapErr};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

/// What goes wrong in the laboratory.
enum Trouble {
    File(PathBuf),
    Seed(u64),
    AsTheMissionSays,
}

/// Flies a mission into a folder; texts are of plant files. Gives what the program would have said, and how the mission ended.
#[pyfunction]
#[pyo3(signature = (mission, out, seed, plant=None, laboratory=None, launch=None, faults=None, fault_seed=None, progress=None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn fly(
    py: Python<'_>,
    mission: String,
    out: PathBuf,
    seed: u64,
    plant: Option<String>,
    laboratory: Option<String>,
    launch: Option<PathBuf>,
    faults: Option<PathBuf>,
    fault_seed: Option<u64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String)> {
    let trouble = match (faults, fault_seed) {
        (Some(path), _) => Trouble::File(path),
        (None, Some(seed)) => Trouble::Seed(seed),
        (None, None) => Trouble::AsTheMissionSays,
    };
    let stack = py.detach(|| stack(&mission, (plant, laboratory), launch.as_deref(), trouble));
    let stack = stack.map_err(|report| from_report(&report))?;
    job::run(py, progress, move |teller| {
        std::fs::create_dir_all(&out).into_diagnostic().wrap_err_with(|| format!("cannot make {}", out.display()))?;
        stack.write_to(&out)?;
        let duration_s = stack.mission.duration_s();
        let mut last = (u8::MAX, u32::MAX, 0);
        let show = |mission: &MissionState| {
            let flown_s = mission.stamp_ns as f64 * 1e-9;
            let now = (mission.state, mission.phase, flown_s as u64);
            if now != last {
                last = now;
                teller.say(Some((flown_s / duration_s).min(1.0)), &stack.phase_name(mission));
            }
        };
        fast::fly(&stack, stack.laboratory(), &out.join(LOG_FILE), seed, show)?;
        let (summary, words) = console::collecting(|| conclude(&stack, &out, None));
        Ok((words, summary?.outcome.to_owned()))
    })
}

fn stack(
    mission: &str,
    (plant, laboratory): (Option<String>, Option<String>),
    launch: Option<&Path>,
    trouble: Trouble,
) -> Result<Stack> {
    let mut stack = Stack::load(launch, None, mission)?;
    if plant.is_some() || laboratory.is_some() {
        let texts = stack.texts();
        let plant = plant.unwrap_or(texts.plant);
        stack = stack.with_texts(Texts { plant, mission: texts.mission, laboratory }, "the plant given")?;
    }
    Ok(match trouble {
        Trouble::File(path) => stack.with_faults(&TextFile::read(&path, "fault file")?)?,
        Trouble::Seed(seed) => {
            stack.faults = Faults::random(seed, stack.mission.duration_s(), FAULT_EVERY_S, &stack.plant);
            stack
        }
        Trouble::AsTheMissionSays => stack,
    })
}
