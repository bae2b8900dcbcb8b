//! A service as a program of its own.

use crate::description::Description;
use crate::process::{Process, SiteArgs};
use clap::Parser;
use fss_bus::{Runner, Service, lockstep};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::de::DeserializeOwned;
use std::process::ExitCode;

/// Why a service could not be made: any error, or a text.
pub type Refusal = Box<dyn std::error::Error + Send + Sync>;

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

/// What a service may know of where it flies, before its first step.
#[derive(Clone, Debug, Default)]
pub struct Site {
    /// Steps a second, as the launch file has it.
    pub rate_hz: f64,
    /// How often the service has been started in this run; 1 for the first time.
    pub starts: u32,
    /// The vehicle's name; empty where it is alone.
    pub vehicle: String,
    /// The plant file.
    pub plant_text: String,
    /// The mission file.
    pub mission_text: String,
}

impl Site {
    /// What a service wants of the plant file: a type with the fields that it needs.
    ///
    /// ```
    /// use fss_service::Site;
    /// use serde::Deserialize;
    ///
    /// #[derive(Deserialize)]
    /// struct Plant {
    ///     base: Base,
    /// }
    /// #[derive(Deserialize)]
    /// struct Base {
    ///     mass_kg: f64,
    /// }
    ///
    /// let site = Site { plant_text: "[base]\nmass_kg = 10.1\nwidth_m = 0.3".to_owned(), ..Site::default() };
    /// let plant: Plant = site.plant()?;
    /// assert_eq!(plant.base.mass_kg, 10.1);
    /// # Ok::<(), fss_service::Refusal>(())
    /// ```
    ///
    /// # Errors
    /// Where the file does not have them.
    pub fn plant<T: DeserializeOwned>(&self) -> std::result::Result<T, Refusal> {
        toml::from_str(&self.plant_text).map_err(|e| format!("plant file: {e}").into())
    }

    /// What a service wants of the mission file.
    ///
    /// # Errors
    /// Where the file does not have it.
    pub fn mission<T: DeserializeOwned>(&self) -> std::result::Result<T, Refusal> {
        toml::from_str(&self.mission_text).map_err(|e| format!("mission file: {e}").into())
    }
}

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

/// Runs a service as the command line says; what [`main!`](crate::main) calls.
pub fn run<S: Program>() -> ExitCode {
    let cli = Cli::parse();
    let outcome = match &cli.describe {
        Some(config) => describe::<S>(config),
        None => fly::<S>(&cli),
    };
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
fn describe<S: Program>(config: &str) -> Result<()> {
    config_of::<S>(config)?;
    println!("{}", serde_json::to_string(&Description::of::<S>()).into_diagnostic()?);
    Ok(())
}

fn config_of<S: Program>(text: &str) -> Result<S::Config> {
    toml::from_str(text).map_err(|e| miette!("config of '{}': {}", S::NAME, e.message()))
}

fn fly<S: Program>(cli: &Cli) -> Result<()> {
    let process = Process::open(S::NAME, &cli.site)?;
    let config = config_of::<S>(&process.schedule(S::NAME)?.config_text())?;
    let service = S::new(config, &process.site(S::NAME)?).map_err(|e| miette!("{e}")).wrap_err(S::NAME)?;
    if cli.lockstep {
        let mut runner = Runner::new(service, &process.bus).into_diagnostic()?;
        return lockstep::follow(&mut runner, &process.bus, &process.stop).into_diagnostic();
    }
    process.fly(service, || ())?;
    Ok(())
}
