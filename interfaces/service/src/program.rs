//! A service as a program of its own.

use crate::description::Description;
use crate::process::{Process, SiteArgs};
use crate::site::{Refusal, Site};
use clap::Parser;
use fss_bus::{RawRunner, RawService, Run, Runner, Service, lockstep};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::ffi::OsString;
use std::process::ExitCode;

/// A service that a program makes: [`main!`](crate::main) runs it.
pub trait Program: Service + Sized {
    /// What `config = { ... }` of its table in the launch file says. With `#[serde(deny_unknown_fields)]` a key that it does not know is
    /// an error at its line of the launch file.
    type Config: DeserializeOwned;

    /// Makes the service, before its first step.
    ///
    /// # Errors
    /// Where it cannot fly so; the launcher shows the reason.
    fn new(config: Self::Config, site: &Site) -> std::result::Result<Self, Refusal>;
}

/// The config of a service that takes none.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoConfig {}

/// A service of a stack, started by its launcher.
#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    site: SiteArgs,
    /// Step when the launcher says so, on its clock.
    #[arg(long, hide = true)]
    lockstep: bool,
    /// Say which topics the service reads and writes, and whether it takes this config.
    #[arg(long, value_name = "TOML", hide = true)]
    describe: Option<String>,
}

/// A service whose step is written in another language, as its binding makes it.
pub trait RawProgram {
    /// Its step.
    type Service: RawService;

    /// What it is.
    fn description(&self) -> &Description;

    /// Whether it takes this config, TOML.
    ///
    /// # Errors
    /// Says what is wrong with it.
    fn check(&self, config: &str) -> std::result::Result<(), Refusal>;

    /// Makes the service, before its first step.
    ///
    /// # Errors
    /// Where it cannot fly so.
    fn make(&self, config: &str, site: &Site) -> std::result::Result<Self::Service, Refusal>;
}

/// Runs a service as the command line says; what [`main!`](crate::main) calls.
pub fn run<S: Program>() -> ExitCode {
    let cli = Cli::parse();
    conclude(match &cli.describe {
        Some(config) => config_of::<S>(config).and_then(|_| describe(&Description::of::<S>())),
        None => fly::<S>(&cli),
    })
}

/// Runs a service of another language as these arguments say, of which the first is the program's name.
pub fn run_raw(program: &impl RawProgram, arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = Cli::parse_from(arguments);
    conclude(match &cli.describe {
        Some(config) => check_raw(program, config).and_then(|()| describe(program.description())),
        None => fly_raw(program, &cli),
    })
}

fn conclude(outcome: Result<()>) -> ExitCode {
    outcome.map_or_else(
        |error| {
            // One line for the launcher, which shows it in its own way.
            let reasons: Vec<String> = error.chain().map(ToString::to_string).collect();
            eprintln!("{}", reasons.join(": "));
            ExitCode::FAILURE
        },
        |()| ExitCode::SUCCESS,
    )
}

#[expect(clippy::print_stdout, reason = "the description is what the command is asked for")]
fn describe(description: &Description) -> Result<()> {
    println!("{}", serde_json::to_string(description).into_diagnostic()?);
    Ok(())
}

/// What a service's `config` in the launch file says.
///
/// # Errors
/// Where the service does not take it.
pub fn config_of<S: Program>(text: &str) -> Result<S::Config> {
    toml::from_str(text).map_err(|e| miette!("config of '{}': {}", S::NAME, e.message()))
}

fn check_raw(program: &impl RawProgram, config: &str) -> Result<()> {
    program.check(config).map_err(|e| miette!("config of '{}': {e}", program.description().service))
}

fn fly<S: Program>(cli: &Cli) -> Result<()> {
    let process = Process::open(S::NAME, &cli.site)?;
    let config = config_of::<S>(&process.schedule(S::NAME)?.config_text())?;
    let service = S::new(config, &process.site(S::NAME)?).map_err(|e| miette!("{e}")).wrap_err(S::NAME)?;
    run_on(cli, &process, &mut Runner::new(service, &process.bus).into_diagnostic()?)
}

fn fly_raw(program: &impl RawProgram, cli: &Cli) -> Result<()> {
    let description = program.description();
    let name = &description.service;
    let process = Process::open(name, &cli.site)?;
    let config = process.schedule(name)?.config_text();
    check_raw(program, &config)?;
    let service = program.make(&config, &process.site(name)?).map_err(|e| miette!("{e}")).wrap_err(name.clone())?;
    let (inputs, outputs) = (description.input_topics()?, description.output_topics()?);
    let mut runner = RawRunner::new(service, name, &inputs, &outputs, &process.bus).into_diagnostic()?;
    run_on(cli, &process, &mut runner)
}

/// Runs on the clock that the command line says.
fn run_on(cli: &Cli, process: &Process, runner: &mut impl Run) -> Result<()> {
    if cli.lockstep {
        return lockstep::follow(runner, &process.bus, &process.stop).into_diagnostic();
    }
    let schedule = process.schedule(runner.name())?;
    fss_bus::process::run(runner, &process.bus, &schedule, process.starts, &process.stop, || ()).into_diagnostic()?;
    Ok(())
}
