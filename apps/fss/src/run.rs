//! `fss run`, `fss service` and `fss lab`: flying a mission, in real time or as fast as the machine allows.

use clap::Args;
use fss_bus::launch::Launch;
use fss_lab::Faults;
use fss_launcher::files::TextFile;
use fss_launcher::link_key::make_link_key;
use fss_launcher::stack::{FAULT_EVERY_S, LOG_FILE, Stack};
use fss_launcher::{fast, launcher, member, processes};
use fss_messages::MissionState;
use fss_report::flown::conclude;
use fss_service::{SiteArgs, stop_on_signal};
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Fly a mission.
#[derive(Args)]
pub struct RunArgs {
    /// A mission that comes with fss (hold, follow, slew, reach, zero-reaction, detumble, capture, service, calibrate, experiment-*) or a
    /// mission file.
    #[arg(default_value = "zero-reaction")]
    mission: String,
    /// Launch file: rates, priorities, cores, devices.
    #[arg(long, value_name = "FILE")]
    launch: Option<PathBuf>,
    /// Plant file: the vehicle and its laboratory.
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Plant file of the simulated laboratory, where it is to be another than the one that the services believe in.
    #[arg(long, value_name = "FILE")]
    laboratory: Option<PathBuf>,
    /// Fly in one process on a virtual clock, as fast as the machine allows; the same seed gives the same bytes.
    #[arg(long)]
    fast: bool,
    /// Folder for run.mcap, summary.json and run.svg; where absent out/MISSION, or out/MISSION-2 and so on.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of everything random in the laboratory.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// File of what goes wrong in the simulated laboratory: networks, sensors, links, valves.
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// Draw faults of every kind from this seed.
    #[arg(long, value_name = "SEED", conflicts_with = "faults")]
    fault_seed: Option<u64>,
    /// Show no progress.
    #[arg(long)]
    quiet: bool,
}

/// Run one service.
#[derive(Args)]
pub struct ServiceArgs {
    /// The service: recorder, thrusters, fusion, links, arm, base, mission, calibration, ground or bridge.
    name: String,
    #[command(flatten)]
    site: SiteArgs,
}

/// Run the simulated laboratory.
#[derive(Args)]
pub struct LabArgs {
    #[command(flatten)]
    site: SiteArgs,
}

/// Flies a mission and says what happened.
pub fn run(args: &RunArgs) -> Result<()> {
    let mut stack = Stack::load(args.launch.as_deref(), args.plant.as_deref(), &args.mission)?;
    if let Some(path) = &args.faults {
        stack = stack.with_faults(&TextFile::read(path, "fault file")?)?;
    } else if let Some(seed) = args.fault_seed {
        stack.faults = Faults::random(seed, stack.mission.duration_s(), FAULT_EVERY_S, &stack.plant);
    }
    if let Some(laboratory) = &args.laboratory {
        stack = stack.in_laboratory(laboratory)?;
    }
    let folder = args.out.clone().unwrap_or_else(|| unused_folder(&stack.mission_name));
    std::fs::create_dir_all(&folder).into_diagnostic().wrap_err_with(|| format!("cannot make {}", folder.display()))?;
    let folder = folder.canonicalize().into_diagnostic()?;
    stack.write_to(&folder)?;

    let bar = progress_bar(&stack, args.quiet);
    let show = |mission: &MissionState| show_progress(&bar, &stack, mission);
    let mut ended = None;
    if args.fast {
        fast::fly(&stack, stack.laboratory(), &folder.join(LOG_FILE), args.seed, show)?;
    } else {
        let site = member::Site {
            bus_prefix: format!("fss_{}_", std::process::id()),
            folder: folder.clone(),
            seed: args.seed,
            processes: Arc::default(),
        };
        make_link_key(&stack, &folder)?;
        let stop = stop_on_signal()?;
        let flown = launcher::fly(&stack, &site, &stop, show)?;
        if flown.interrupted {
            bar.abandon_with_message("stopped");
        }
        ended = flown.mission;
    }
    bar.finish_and_clear();
    let summary = conclude(&stack, &folder, ended.as_ref())?;
    if summary.outcome == "aborted" {
        return Err(miette!("the mission was aborted; the events above and `fss log info` say why"));
    }
    Ok(())
}

/// A launch file; the laboratory's where none is named.
pub fn launch_of(path: Option<&Path>) -> Result<Launch> {
    Stack::load(path, None, "hold").map(|stack| stack.launch)
}

/// Runs one service as a process.
pub fn service(args: &ServiceArgs) -> Result<()> {
    processes::service(&args.name, &args.site)
}

/// Runs the simulated laboratory as a process.
pub fn lab(args: &LabArgs) -> Result<()> {
    processes::lab(&args.site)
}

/// `out/MISSION`, or the first of `out/MISSION-2`, `-3` and so on that holds no log yet: no run replaces another unasked.
fn unused_folder(mission: &str) -> PathBuf {
    let numbered = (2..).map(|k| format!("{mission}-{k}"));
    let mut folders = std::iter::once(mission.to_owned()).chain(numbered).map(|name| Path::new("out").join(name));
    folders.find(|folder| !folder.join(LOG_FILE).exists()).unwrap_or_else(|| Path::new("out").join(mission))
}

fn progress_bar(stack: &Stack, quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new((stack.mission.duration_s() * 10.0) as u64);
    if let Ok(style) = ProgressStyle::with_template("{prefix} [{bar:40}] {elapsed_precise} {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_prefix(stack.mission_name.clone());
    bar
}

fn show_progress(bar: &ProgressBar, stack: &Stack, mission: &MissionState) {
    match mission.state {
        MissionState::WAITING => bar.set_message("waiting for navigation and links"),
        MissionState::RUNNING => {
            let in_phase_s = mission.stamp_ns.saturating_sub(mission.phase_start_ns) as f64 * 1e-9;
            let before_s = stack
                .mission
                .phases
                .iter()
                .take(mission.phase as usize)
                .map(|p| p.duration_s + p.settle_s)
                .sum::<f64>();
            bar.set_position(((before_s + in_phase_s) * 10.0) as u64);
            bar.set_message(format!("phase {} of {}", mission.phase + 1, mission.phase_count));
        }
        _ => {}
    }
}
