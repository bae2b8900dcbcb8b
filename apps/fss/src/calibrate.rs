//! `fss calibrate`: parameters of the plant from measured runs.

use crate::diagnose::runs;
use crate::files::TextFile;
use clap::{Args, Subcommand};
use fss_identify::calibrate::Estimate;
use fss_identify::calibrate::kinematic::{self, Choice};
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Quantiles of the normal distribution for intervals of 90 and 95 percent.
const QUANTILE_90: f64 = 1.6449;
const QUANTILE_95: f64 = 1.96;

/// Estimate parameters of the plant from measured runs.
#[derive(Subcommand)]
pub enum CalibrateCommand {
    /// Link lengths, joint offsets and the first joint's pose, from poses of the end-effector.
    Kinematic(KinematicArgs),
}

/// What `fss calibrate kinematic` takes.
#[derive(Args)]
pub struct KinematicArgs {
    /// Measured runs: folders in the format fss-experiment/1, or logs of `fss run`.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Plant file: the first guess.
    #[arg(long, value_name = "FILE")]
    plant: PathBuf,
    /// The calibrated plant file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write the answer as JSON here too.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
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
    }
}

fn kinematic(args: &KinematicArgs) -> Result<()> {
    let file = TextFile::read(&args.plant, "plant file")?;
    let plant = Plant::parse(&file.text).map_err(|e| file.error(e.message, e.help, Some(e.span)))?;
    let model = plant.nominal().model().into_diagnostic()?;
    let measured = runs::read(&args.runs, &plant)?;
    let observe = |moving: bool| -> Vec<_> {
        let of = |run| kinematic::observations(run, plant.link_count(), plant.base.clamped, moving);
        measured.iter().flat_map(of).collect()
    };
    let still = observe(false);
    // Each still pose gives three numbers; five more than unknowns leave something to tell the noise by. Interpolation
    // between slow telemetry adds errors in motion that the intervals do not count.
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
        if enough || args.still {
            "still poses"
        } else {
            "in motion too (the intervals leave out what interpolation between telemetry adds)"
        }
    );
    print(&estimate);
    let text = kinematic::calibrated(&plant, &estimate).to_toml().into_diagnostic()?;
    write(&args.out, &text)?;
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&answer("kinematic", &estimate)).into_diagnostic()?;
        write(path, &text)?;
    }
    Ok(())
}

fn print(estimate: &Estimate) {
    println!("\n{:<26}{:>12}{:>12}{:>28}", "parameter", "value", "std", "95 % interval");
    for p in &estimate.parameters {
        let half = estimate.half_width(p.std, QUANTILE_95);
        let interval = format!("{:.5} .. {:.5}", p.value - half, p.value + half);
        println!("{:<26}{:>12.5}{:>12.5}{interval:>28}", p.name, p.value, p.std);
    }
    println!(
        "\nresiduals     {:.3} mm, {:.4} deg RMS",
        estimate.residual_std[0] * 1e3,
        estimate.residual_std[1].to_degrees()
    );
    println!("rank          {} of {}", estimate.rank, estimate.unknowns);
    if estimate.condition.is_finite() {
        println!("condition     {:.1}", estimate.condition);
    }
    if !estimate.rejected.is_empty() {
        println!("outliers      {} observations left out", estimate.rejected.len());
    }
    if !estimate.undetermined.is_empty() {
        println!(
            "\nThis data cannot determine {}; they stay as they were:",
            estimate.undetermined_parameters.join(", ")
        );
        for line in &estimate.undetermined {
            println!("  {line}");
        }
    }
}

/// The answer for a machine.
fn answer(kind: &str, estimate: &Estimate) -> Value {
    let mut parameters = Map::new();
    for p in &estimate.parameters {
        let interval = |quantile: f64| {
            let half = estimate.half_width(p.std, quantile);
            [p.value - half, p.value + half]
        };
        let entry = json!({ "value": p.value, "std": p.std,
            "interval_90": interval(QUANTILE_90), "interval_95": interval(QUANTILE_95) });
        parameters.insert(p.name.clone(), entry);
    }
    json!({ "format": "fss-calibration/1", "kind": kind, "parameters": parameters,
        "residual_std": { "position_m": estimate.residual_std[0], "angle_rad": estimate.residual_std[1] },
        "noise": { "position_m": estimate.noise[0], "angle_rad": estimate.noise[1] },
        "rank": estimate.rank, "unknowns": estimate.unknowns,
        "condition": estimate.condition.is_finite().then_some(estimate.condition),
        "degrees_of_freedom": estimate.degrees_of_freedom, "outliers": estimate.rejected.len(),
        "undetermined": estimate.undetermined, "undetermined_parameters": estimate.undetermined_parameters })
}

fn write(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).into_diagnostic().wrap_err_with(|| format!("cannot write {}", path.display()))?;
    println!("{}", path.display());
    Ok(())
}
