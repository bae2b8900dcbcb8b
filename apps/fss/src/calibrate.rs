//! `fss calibrate`: parameters of the plant from measured runs.

pub mod answer;
mod dynamic;
mod plan;

use crate::diagnose::runs;
use crate::files::TextFile;
use answer::{Kind, write};
use clap::{Args, Subcommand};
use dynamic::DynamicArgs;
use fss_identify::calibrate::kinematic::{self, Choice};
use fss_identify::calibrate::write as plant_file;
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result, miette};
use plan::PlanArgs;
use std::path::{Path, PathBuf};

/// Kinds of observation of a kinematic calibration.
const KINEMATIC: [Kind; 2] = [Kind::meters("position_m", "end-effector"), Kind::radians("angle_rad", "its angle")];

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

/// What every calibration reads and writes.
#[derive(Args)]
struct Files {
    /// Measured runs: folders in the format fss-experiment/1, or logs of `fss run`.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Plant file: the first guess, and whatever is not estimated.
    #[arg(long, value_name = "FILE")]
    plant: PathBuf,
    /// The calibrated plant file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write the answer as JSON here too.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What `fss calibrate kinematic` takes.
#[derive(Args)]
pub struct KinematicArgs {
    #[command(flatten)]
    files: Files,
    /// A length of its own for each link; otherwise all but the last share one.
    #[arg(long)]
    each_length: bool,
    /// Use only still poses; otherwise telemetry in motion too, where there are fewer still poses than needed.
    #[arg(long)]
    still: bool,
}

/// Runs the command.
pub fn run(command: &CalibrateCommand) -> Result<()> {
    match command {
        CalibrateCommand::Kinematic(args) => kinematic(args),
        CalibrateCommand::Dynamic(args) => dynamic::run(args),
        CalibrateCommand::Plan(args) => plan::run(args),
    }
}

fn read_plant(path: &Path) -> Result<Plant> {
    let file = TextFile::read(path, "plant file")?;
    Plant::parse(&file.text).map_err(|e| file.error(e.message, e.help, Some(e.span)))
}

fn kinematic(args: &KinematicArgs) -> Result<()> {
    let plant = read_plant(&args.files.plant)?;
    let model = plant.nominal().model().into_diagnostic()?;
    let measured = runs::read(&args.files.runs, &plant)?;
    let observe = |moving: bool| -> Vec<_> {
        let of = |run| kinematic::observations(run, plant.link_count(), plant.base.clamped, moving);
        measured.iter().flat_map(of).collect()
    };
    let still = observe(false);
    // Each still pose gives three numbers; five more than unknowns leave something to tell the noise by.
    let unknowns = if args.each_length { 2 * plant.link_count() + 2 } else { plant.link_count() + 4 };
    let enough = 3 * still.len() >= unknowns + 5;
    let observations = if enough || args.still { still } else { observe(true) };
    let noise = [plant.sensors.mocap_position_m.max(1e-5), plant.sensors.mocap_angle_rad.max(1e-5)];
    let choice = Choice { each_length: args.each_length };
    let estimate = kinematic::calibrate(&model, &observations, noise, choice).map_err(|e| {
        miette!(
            help = "a kinematic calibration needs joints.csv, base_pose.csv and ee_pose.csv of several postures",
            "{e}"
        )
    })?;
    println!(
        "{} observations of the end-effector, {}",
        observations.len(),
        if enough || args.still { "still poses" } else { "in motion too" }
    );
    answer::print(&estimate, &KINEMATIC);
    let text = plant_file::calibrated(&plant, &estimate).to_toml().into_diagnostic()?;
    write(&args.files.out, &text)?;
    if let Some(path) = &args.files.json {
        let text = serde_json::to_string_pretty(&answer::json("kinematic", &estimate, &KINEMATIC)).into_diagnostic()?;
        write(path, &text)?;
    }
    Ok(())
}
