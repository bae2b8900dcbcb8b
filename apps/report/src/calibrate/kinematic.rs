//! `fss calibrate kinematic`, and the same at the end of a flight that collected postures.

use super::answer::{self, Kind};
use super::{Files, write_calibrated};
use crate::diagnose::{log, runs};
use clap::Args;
use fss_calibrate::Estimate;
use fss_calibrate::kinematic::{self, Choice};
use fss_experiments::measured::Run;
use fss_launcher::files::read_plant;
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result, miette};
use serde_json::Value;
use std::path::Path;

/// Kinds of observation of a kinematic calibration.
const KINDS: [Kind; 2] = [Kind::meters("position_m", "end-effector"), Kind::radians("angle_rad", "its angle")];
/// More numbers than unknowns by so many leave something to tell the noise by.
const SPARE: usize = 5;

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

/// The kinematics as runs tell them.
pub struct Calibrated {
    estimate: Estimate,
    still: usize,
    moving: usize,
    standing: Vec<usize>,
}

impl Calibrated {
    fn of(plant: &Plant, measured: &[Run], choice: Choice, still_only: bool) -> Result<Self> {
        let model = plant.nominal().model().into_diagnostic()?;
        let observe = |moving: bool| -> Vec<_> {
            let of = |run| kinematic::observations(run, plant.link_count(), plant.base.clamped, moving);
            measured.iter().flat_map(of).collect()
        };
        let at_rest = observe(false);
        let enough = 3 * at_rest.len() >= kinematic::count_unknowns(&model, choice) + SPARE;
        let observations = if enough || still_only { at_rest } else { observe(true) };
        let noise = [plant.sensors.mocap_position_m.max(1e-5), plant.sensors.mocap_angle_rad.max(1e-5)];
        let estimate = kinematic::calibrate(&model, &observations, noise, choice).map_err(|e| {
            miette!(
                help = "a kinematic calibration needs joints.csv, base_pose.csv and ee_pose.csv of several postures",
                "{e}"
            )
        })?;
        let still = observations.iter().filter(|o| o.is_still()).count();
        let standing = kinematic::standing(&observations);
        Ok(Self { estimate, still, moving: observations.len() - still, standing })
    }

    /// Tells a person.
    pub fn print(&self) {
        let moving = if self.moving > 0 { format!(" and {} in motion", self.moving) } else { String::new() };
        say!("poses of the end-effector: {} at rest{moving}", self.still);
        for joint in self.standing.iter().filter(|_| self.still + self.moving > 1) {
            say!(
                "- joint {joint} stands at one angle in all of them: its offset shows only by how long the arm is there, and the offsets beside it lean on that"
            );
        }
        answer::print(&self.estimate, &KINDS);
    }

    /// Tells a machine.
    pub fn json(&self) -> Value {
        answer::json("kinematic", &self.estimate, &KINDS)
    }

    /// Writes the plant file with the estimate in it.
    pub fn write(&self, plant: &Plant, path: &Path) -> Result<()> {
        write_calibrated(path, plant, &self.estimate)
    }
}

/// Runs the command.
pub(super) fn run(args: &KinematicArgs) -> Result<()> {
    let plant = read_plant(&args.files.answer.plant)?;
    let measured = runs::read(&args.files.runs, &plant)?;
    let found = Calibrated::of(&plant, &measured, Choice { each_length: args.each_length }, args.still)?;
    found.print();
    args.files.write(&plant, &found.estimate, &found.json())
}

/// What the log of a flight with the service `calibration` tells: the same as the command says of it with `--still`.
pub fn of_log(path: &Path, plant: &Plant) -> Result<Calibrated> {
    Calibrated::of(plant, &[log::read(path, plant)?], Choice::default(), true)
}
