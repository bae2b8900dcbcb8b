//! `fss bench`: how fast this build is on this machine, and how well the diagnosis is calibrated.

#![warn(clippy::print_stdout)] // what is said goes through `console`

#[macro_use]
extern crate fss_launcher;

mod browser;
mod calibration;
mod distribution;
mod ipc;
mod jitter;
mod lockstep;
mod recorder;
mod stack;
mod view;

use clap::{Args, Subcommand};
use fss_multibody::{Coordinates, Model, State, integrate};
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result};
use serde::Serialize;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

use fss_launcher::files::TextFile;

/// What can be measured.
#[derive(Subcommand)]
pub enum BenchCommand {
    /// Forward dynamics, an RK4 step, and a step with its state-transition matrix: medians of several runs.
    Dynamics(DynamicsArgs),
    /// Simulation-based calibration of the diagnosis: causes drawn from its priors, ranks of true values, probabilities.
    Calibration(CalibrationArgs),
    /// One-way latency of a sample over the bus, raw iceoryx2, bare shared memory, UDP and Unix sockets, in turns.
    Ipc(JsonArgs),
    /// How late a service's step begins, against a bare `clock_nanosleep` loop, in turns.
    Jitter(JitterArgs),
    /// What recording costs a byte, against the bare MCAP writer, in turns.
    Recorder(RecorderArgs),
    /// What the whole stack costs at its launch rates, and how old a measurement is when its valve command leaves.
    Stack(StackArgs),
    /// What a step in lockstep costs of each program of a launch file.
    Lockstep(LockstepArgs),
    /// What a live page at 30 pictures a second costs those who fly: the stack with and without `fss view`, in turns.
    View(ViewArgs),
}

/// Which cases to draw.
#[derive(Args)]
pub struct CalibrationArgs {
    /// How many cases.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u64).range(1..))]
    cases: u64,
    /// Seed of all that is drawn.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How to tell.
#[derive(Args)]
pub struct JsonArgs {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How to run the loops.
#[derive(Args)]
pub struct JitterArgs {
    /// Steps a second.
    #[arg(long, default_value_t = 1000.0)]
    rate_hz: f64,
    /// SCHED_FIFO priority, where the host grants it.
    #[arg(long, default_value_t = 80)]
    priority: u8,
    /// The core to run on.
    #[arg(long, default_value_t = 0)]
    core: usize,
    /// Time for each of the two loops, s.
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How to fly.
#[derive(Args)]
pub struct StackArgs {
    /// Launch file; the laboratory's where absent.
    #[arg(long, value_name = "FILE")]
    launch: Option<PathBuf>,
    /// How long to measure each flight, s.
    #[arg(long, default_value_t = 30.0)]
    seconds: f64,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Which programs to step.
#[derive(Args)]
pub struct LockstepArgs {
    /// The launch file, with the programs.
    launch: PathBuf,
    /// Steps of each.
    #[arg(long, default_value_t = 20_000, value_parser = clap::value_parser!(u64).range(1..))]
    steps: u64,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How to fly, and who looks.
#[derive(Args)]
pub struct ViewArgs {
    #[command(flatten)]
    flight: StackArgs,
    /// A browser of the Chromium family that shows the page, without a window, in place of a reader that draws nothing: with it
    /// the flight shares the processor as on a computer where somebody watches.
    #[arg(long, value_name = "PROGRAM")]
    browser: Option<PathBuf>,
}

/// Where to record.
#[derive(Args)]
pub struct RecorderArgs {
    /// Folder on the disk in question; the system's temporary folder where absent.
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What to time.
#[derive(Args)]
pub struct DynamicsArgs {
    /// Plant file; the paper's laboratory where absent.
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Median times of one evaluation.
#[derive(Serialize)]
struct DynamicsTimes {
    links: usize,
    forward_dynamics_ns: f64,
    rk4_step_ns: f64,
    runs: usize,
}

/// Runs a benchmark.
pub fn run(command: &BenchCommand) -> Result<()> {
    match command {
        BenchCommand::Dynamics(args) => dynamics(args),
        BenchCommand::Calibration(args) => {
            let found = calibration::measure(args.cases, args.seed)?;
            tell(args.json, &found, || found.print())
        }
        BenchCommand::Ipc(args) => {
            let times = ipc::measure()?;
            tell(args.json, &times, || times.print())
        }
        BenchCommand::Lockstep(args) => lockstep::run(args),
        BenchCommand::Jitter(args) => {
            let times = jitter::measure(args.rate_hz, args.priority, args.core, args.seconds)?;
            tell(args.json, &times, || times.print())
        }
        BenchCommand::Recorder(args) => {
            let times = recorder::measure(&args.folder.clone().unwrap_or_else(std::env::temp_dir))?;
            tell(args.json, &times, || times.print())
        }
        BenchCommand::Stack(args) => {
            let times = stack::measure(args.launch.as_deref(), args.seconds)?;
            tell(args.json, &times, || times.print())
        }
        BenchCommand::View(args) => {
            let StackArgs { launch, seconds, json } = &args.flight;
            let times = view::measure(launch.as_deref(), *seconds, args.browser.as_deref())?;
            tell(*json, &times, || times.print())
        }
    }
}

fn tell(json: bool, times: &impl Serialize, print: impl FnOnce()) -> Result<()> {
    if json {
        say!("{}", serde_json::to_string_pretty(times).into_diagnostic()?);
    } else {
        print();
    }
    Ok(())
}

fn dynamics(args: &DynamicsArgs) -> Result<()> {
    let plant = match &args.plant {
        Some(path) => {
            let file = TextFile::read(path, "plant file")?;
            Plant::parse(&file.text).map_err(|e| file.error(e.message, e.help, Some(e.span)))?
        }
        None => Plant::default_laboratory().into_diagnostic()?,
    };
    let times = time_dynamics(&plant.model().into_diagnostic()?);
    if args.json {
        say!("{}", serde_json::to_string_pretty(&times).into_diagnostic()?);
    } else {
        say!("links                   {}", times.links);
        say!("forward dynamics        {:.0} ns", times.forward_dynamics_ns);
        say!("RK4 step                {:.0} ns", times.rk4_step_ns);
        say!("medians of {} runs", times.runs);
    }
    Ok(())
}

/// How many runs, and how many evaluations a run has.
const RUNS: usize = 31;
const EVALUATIONS: u32 = 4_000;

fn time_dynamics(model: &Model) -> DynamicsTimes {
    let n = model.dof();
    let moving = |scale: f64| Coordinates::from_fn(|i, _| if i < n { scale * (i as f64 - 2.5) } else { 0.0 });
    let mut state = State { q: moving(0.2), v: moving(0.1) };
    if model.base().clamped {
        for i in 0..3 {
            (state.q[i], state.v[i]) = (0.0, 0.0);
        }
    }
    let tau = moving(0.02);
    let forward_dynamics_ns = median_ns(|| {
        black_box(model.forward_dynamics(black_box(&state), black_box(&tau)));
    });
    // Steps so short that the state stays where the timing is typical; each starts from the one before it.
    let mut flying = state;
    let rk4_step_ns = median_ns(|| flying = integrate::step_rk4(model, &flying, 1e-6, |_, _| tau));
    black_box(flying);
    DynamicsTimes { links: model.link_count(), forward_dynamics_ns, rk4_step_ns, runs: RUNS }
}

fn median_ns(mut evaluate: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            for _ in 0..EVALUATIONS {
                evaluate();
            }
            start.elapsed().as_secs_f64() * 1e9 / f64::from(EVALUATIONS)
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[RUNS / 2]
}
