//! `fss diagnose`: where the simulation is wrong.

pub mod commands;
pub mod log;
mod page;
pub mod runs;

use crate::files::TextFile;
use clap::Args;
use fss_identify::measured::Run;
use fss_identify::misfit::{ChannelMisfit, Windows, of_run};
use fss_plant::Plant;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A channel whose RMS is beyond this many times the noise is called misfit.
const MISFIT_RATIO: f64 = 1.3;

/// Show where the simulation of a plant differs from measured runs, as ratios to the noise.
#[derive(Args)]
pub struct DiagnoseArgs {
    /// Measured runs: folders in the format fss-experiment/1, or logs of `fss run`.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Runs kept for measuring the gain only.
    #[arg(long, num_args = 1.., value_name = "RUN")]
    validate: Vec<PathBuf>,
    /// Plant file: what the laboratory believes.
    #[arg(long, value_name = "FILE")]
    plant: PathBuf,
    /// Folder for the report.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write the answer as JSON here too.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The answer for a machine, `fss-diagnosis/1`.
#[derive(Serialize)]
struct Diagnosis {
    format: &'static str,
    verdict: &'static str,
    causes: [(); 0],
    misfit: Vec<Misfit>,
    gain: Gain,
    extended_model: Option<String>,
    note: &'static str,
}

#[derive(Serialize)]
struct Misfit {
    channel: String,
    run: String,
    rms: f64,
    noise: f64,
    ratio: f64,
}

#[derive(Serialize)]
struct Gain {
    ratio_before: f64,
    ratio_after: f64,
    noise_floor: f64,
}

const NOTE: &str = "causes cannot be named yet: this version shows where the simulation is wrong, not why";

/// Runs the command.
pub fn run(args: &DiagnoseArgs) -> Result<()> {
    let file = TextFile::read(&args.plant, "plant file")?;
    let plant = Plant::parse(&file.text).map_err(|e| file.error(e.message, e.help, Some(e.span)))?;
    let fitted = runs::read(&args.runs, &plant)?;
    let validation = runs::read(&args.validate, &plant)?;
    let windows = Windows::suited_to(&plant, &fitted);

    let bar = progress(fitted.len() + validation.len());
    let misfits = |runs: &[Run]| -> Result<Vec<ChannelMisfit>> {
        let mut all = Vec::new();
        for run in runs {
            bar.set_message(run.name.clone());
            all.extend(of_run(&plant, run, windows).into_diagnostic()?);
            bar.inc(1);
        }
        Ok(all)
    };
    let (fitted, validation) = (misfits(&fitted)?, misfits(&validation)?);
    bar.finish_and_clear();
    if fitted.is_empty() && validation.is_empty() {
        return Err(miette!(
            help =
                "a floating base needs base_pose.csv; a clamped arm needs angles and rates of all joints in joints.csv",
            "none of the runs has a channel that can be simulated"
        ));
    }
    report(args, &fitted, &validation)
}

fn report(args: &DiagnoseArgs, fitted: &[ChannelMisfit], validation: &[ChannelMisfit]) -> Result<()> {
    let all = || fitted.iter().chain(validation);
    // A channel whose noise the plant file does not give (a ratio without bound) decides nothing.
    let wrong = all().any(|m| m.ratio().is_finite() && m.ratio() > MISFIT_RATIO);
    let before = overall(if validation.is_empty() { fitted } else { validation });
    let diagnosis = Diagnosis {
        format: "fss-diagnosis/1",
        verdict: if wrong { "unexplained" } else { "consistent" },
        causes: [],
        misfit: all()
            .map(|m| Misfit {
                channel: m.channel.clone(),
                run: m.run.clone(),
                rms: m.rms,
                noise: m.noise,
                ratio: m.ratio(),
            })
            .collect(),
        gain: Gain { ratio_before: before, ratio_after: before, noise_floor: 1.0 },
        extended_model: None,
        note: NOTE,
    };
    print_table(fitted, validation);
    println!(
        "\n{}",
        if wrong {
            "The simulation is wrong where a ratio stands above 1.3."
        } else {
            "The simulation is consistent with the data."
        }
    );
    println!("{NOTE}.");

    std::fs::create_dir_all(&args.out)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot make {}", args.out.display()))?;
    let json = serde_json::to_string_pretty(&diagnosis).into_diagnostic()?;
    let html = page::render(fitted, validation);
    let mut files = vec![(args.out.join("diagnosis.json"), &json), (args.out.join("diagnosis.html"), &html)];
    files.extend(args.json.iter().map(|path| (path.clone(), &json)));
    for (path, text) in files {
        std::fs::write(&path, text).into_diagnostic().wrap_err_with(|| format!("cannot write {}", path.display()))?;
        println!("{}", path.display());
    }
    Ok(())
}

/// RMS of the ratios of all channels.
fn overall(misfits: &[ChannelMisfit]) -> f64 {
    let ratios: Vec<f64> = misfits.iter().map(ChannelMisfit::ratio).filter(|r| r.is_finite()).collect();
    (ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len().max(1) as f64).sqrt()
}

/// One row a run, one column a channel: RMS error over what noise alone would give.
fn print_table(fitted: &[ChannelMisfit], validation: &[ChannelMisfit]) {
    let mut channels: Vec<&str> = Vec::new();
    for m in fitted.iter().chain(validation) {
        if !channels.contains(&m.channel.as_str()) {
            channels.push(&m.channel);
        }
    }
    println!("RMS error over the noise, by run and channel (1 is what noise alone gives)\n");
    print!("{:<24}", "run");
    for channel in &channels {
        print!("{channel:>12}");
    }
    println!();
    for (runs, mark) in [(fitted, ""), (validation, " (validation)")] {
        let mut rows: BTreeMap<&str, BTreeMap<&str, &ChannelMisfit>> = BTreeMap::new();
        for m in runs {
            rows.entry(&m.run).or_default().insert(&m.channel, m);
        }
        for (run, row) in rows {
            print!("{:<24}", format!("{run}{mark}"));
            for channel in &channels {
                match row.get(channel) {
                    Some(m) if m.noise > 0.0 => print!("{:>12.2}", m.ratio()),
                    Some(m) => print!("{:>12}", format!("{:.2e}?", m.rms)),
                    None => print!("{:>12}", "-"),
                }
            }
            println!();
        }
    }
    println!("\nRMS error in SI units over all runs of a kind");
    for (runs, kind) in [(fitted, "fitted"), (validation, "validation")] {
        for channel in &channels {
            let of: Vec<f64> = runs.iter().filter(|m| m.channel == *channel).map(|m| m.rms).collect();
            if !of.is_empty() {
                let rms = (of.iter().map(|r| r * r).sum::<f64>() / of.len() as f64).sqrt();
                println!("  {kind:<12}{channel:<12}{rms:.4e}");
            }
        }
    }
}

fn progress(runs: usize) -> ProgressBar {
    let bar = ProgressBar::new(runs as u64);
    if let Ok(style) = ProgressStyle::with_template("simulating [{bar:30}] {pos}/{len} {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}
