//! `fss calibrate`: parameters of the plant from measured runs.

pub mod answer;
mod dynamic;
mod kinematic;
mod plan;

use clap::{Args, Subcommand};
use dynamic::DynamicArgs;
use fss_calibrate::{Estimate, write as plant_file};
use fss_launcher::files::{PlantAndAnswer, write};
use fss_plant::Plant;
use kinematic::KinematicArgs;
pub use kinematic::{Calibrated, of_log};
use miette::{IntoDiagnostic, Result, miette};
use plan::PlanArgs;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Estimate parameters of the plant from measured runs.
#[derive(Subcommand)]
pub enum CalibrateCommand {
    /// Link lengths, joint offsets and the first joint's pose, from poses of the end-effector.
    Kinematic(KinematicArgs),
    /// Each link's centre of mass and inertia and the base's inertia, with the kinematics, from motion without thrust.
    Dynamic(DynamicArgs),
    /// The postures that determine the kinematics best, as a mission, and how well they will.
    Plan(PlanArgs),
}

/// What every calibration of runs reads and writes.
#[derive(Args)]
struct Files {
    /// Measured runs: folders in the format fss-experiment/1, or logs of `fss run`.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    #[command(flatten)]
    answer: PlantAndAnswer,
}

impl Files {
    /// Writes the answer for a machine, and the calibrated plant file.
    fn write(&self, plant: &Plant, estimate: &Estimate, json: &Value) -> Result<()> {
        self.answer.write_json(json)?;
        write_calibrated(&self.answer.out, plant, estimate)
    }
}

/// Writes the plant file with an estimate in it, unless there is none.
fn write_calibrated(path: &Path, plant: &Plant, estimate: &Estimate) -> Result<()> {
    if estimate.parameters.is_empty() {
        return Err(miette!("this data determines no parameter: {} is not written", path.display()));
    }
    write(path, &plant_file::calibrated(plant, estimate).to_toml().into_diagnostic()?)
}

/// Runs the command.
pub fn run(command: &CalibrateCommand) -> Result<()> {
    match command {
        CalibrateCommand::Kinematic(args) => kinematic::run(args),
        CalibrateCommand::Dynamic(args) => dynamic::run(args),
        CalibrateCommand::Plan(args) => plan::run(args),
    }
}
