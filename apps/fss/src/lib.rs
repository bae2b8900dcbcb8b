//! The program `fss`: every command, and the launcher.
//!
//! A laboratory's own program is the same with its services linked in: `fss::main(Services::of_fss().with::<MyService>())`
//! (`tests/examples/laboratory.rs`). A launch file has such a service as a `[[service]]` table without `program`; it flies in real time,
//! on the virtual clock and again from a log as fss's own services do.
#![warn(clippy::print_stdout)] // what is said goes through `console`
#![allow(unreachable_pub)] // what is not re-exported here is `pub` for the other modules only

#[macro_use]
extern crate fss_launcher;

mod generate;
mod host;
mod log;
mod messages;
mod new;
mod plant;
mod run;
mod urdf;

use clap::{Parser, Subcommand};
use fss_bench as bench;
pub use fss_launcher::services::Services;
use fss_launcher::{console, replay, soak};
use fss_report::{calibrate, compare, diagnose, report, top, view, workspace};
use fss_service::explain_errors;
use fss_trials::{campaign, challenge, next_experiment};
use std::process::ExitCode;

/// Flight software, simulator and calibration for a floating spacecraft simulator with a modular arm.
#[derive(Parser)]
#[command(version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Fly a mission with the whole stack against the simulated laboratory.
    Run(run::RunArgs),
    /// Fly a mission with many seeds, or over values of its plant, and count how often it succeeds.
    Campaign(campaign::CampaignArgs),
    /// Run one service of a stack, as the launcher or systemd starts it.
    Service(run::ServiceArgs),
    /// Run the simulated laboratory alone.
    Lab(run::LabArgs),
    /// Fly for long in real time, with random faults, kills and freezes, and report what went wrong.
    Soak(soak::SoakArgs),
    /// Find what the simulation of a plant gets wrong about measured runs: where, why, and what knowing it gains.
    Diagnose(diagnose::DiagnoseArgs),
    /// Find the maneuver that decides best between causes that a diagnosis could not tell apart.
    NextExperiment(next_experiment::NextExperimentArgs),
    /// Estimate parameters of the plant from measured runs.
    #[command(subcommand)]
    Calibrate(calibrate::CalibrateCommand),
    /// Compute reach and manipulability of a plant.
    Workspace(workspace::WorkspaceArgs),
    /// Hide an effect, fly experiments against it, diagnose their logs, and score the answer.
    Challenge(challenge::ChallengeArgs),
    /// Measure how fast this build is on this machine, and how well the diagnosis is calibrated.
    #[command(subcommand)]
    Bench(bench::BenchCommand),
    /// Show a running stack, live: rates, jitter, ages, health, batteries, valves.
    Top(top::TopArgs),
    /// Look at the computer that shall fly.
    #[command(subcommand)]
    Host(host::HostCommand),
    /// Write a plant for other simulators.
    #[command(subcommand)]
    Plant(plant::PlantCommand),
    /// Print the vehicle of a plant file as a URDF.
    Urdf(urdf::UrdfArgs),
    /// Write man pages and shell completions, for the package.
    #[command(hide = true)]
    Generate(generate::GenerateArgs),
    /// Begin a service of one's own.
    #[command(subcommand)]
    New(new::NewCommand),
    /// Print messages and topics for services in C or Python.
    Messages(messages::MessagesArgs),
    /// Look into a log.
    #[command(subcommand)]
    Log(log::LogCommand),
    /// Tell where two logs differ, and by how much.
    Compare(compare::CompareArgs),
    /// Compute each service again from the inputs that a log holds, and compare bit for bit.
    Replay(replay::ReplayArgs),
    /// Write one self-contained page about a flight, for a paper's appendix.
    Report(report::ReportArgs),
    /// Show a flight in the browser: a log, or the stack that runs.
    View(view::ViewArgs),
}

/// Runs the program as its command line says, with these services linked in.
pub fn main(services: Services) -> ExitCode {
    services.link();
    explain_errors();
    run_command(Cli::parse().command).unwrap_or_else(|error| {
        eprintln!("Error: {error:?}");
        ExitCode::FAILURE
    })
}

fn run_command(command: Command) -> miette::Result<ExitCode> {
    match command {
        Command::Run(args) => run::run(&args),
        Command::Campaign(args) => campaign::run(&args),
        Command::Service(args) => run::service(&args),
        Command::Lab(args) => run::lab(&args),
        Command::Soak(args) => soak::run(&args),
        Command::NextExperiment(args) => next_experiment::run(&args),
        Command::Diagnose(args) => diagnose::run(&args),
        Command::Calibrate(command) => calibrate::run(&command),
        Command::Workspace(args) => workspace::run(&args),
        Command::Challenge(args) => challenge::run(&args),
        Command::Top(args) => top::run(&args),
        Command::Host(command) => host::run(&command),
        Command::Plant(command) => plant::run(&command),
        Command::Urdf(args) => urdf::run(&args),
        Command::Generate(args) => generate::run::<Cli>(&args),
        Command::Bench(command) => bench::run(&command),
        Command::New(command) => new::run(&command),
        Command::Messages(args) => messages::run(&args),
        Command::Log(command) => log::run(&command),
        Command::Report(args) => report::run(&args),
        Command::View(args) => view::run(&args),
        Command::Compare(args) => return Ok(compare::run(&args)),
        Command::Replay(args) => return Ok(replay::run(&args)),
    }?;
    Ok(console::exit_code())
}
