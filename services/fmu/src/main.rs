//! `fss-fmu`: an FMU as a service, `program = "fss-fmu"` in the launch file.

use fss_fmu::{NAME, Program};
use fss_service::{LAUNCH_FILE, run_raw};
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<OsString> = std::env::args_os().collect();
    run_raw(&Program::new(&config(&arguments)), arguments)
}

/// What the service is told: on the command line when it is asked what it is, else in the run's launch file.
fn config(arguments: &[OsString]) -> String {
    let after = |option: &str| arguments.iter().skip_while(|argument| *argument != option).nth(1);
    if let Some(config) = after("--describe") {
        return config.to_string_lossy().into_owned();
    }
    // Where it cannot be read, opening the run says so.
    let folder = after("--run").map_or(Path::new("."), Path::new);
    let text = std::fs::read_to_string(folder.join(LAUNCH_FILE)).unwrap_or_default();
    let launch = toml::from_str::<toml::Table>(&text).unwrap_or_default();
    let services = launch.get("service").and_then(toml::Value::as_array).map_or(&[][..], Vec::as_slice);
    let own = services.iter().find(|service| service.get("name").and_then(toml::Value::as_str) == Some(NAME));
    own.and_then(|service| service.get("config")?.as_table()).map(ToString::to_string).unwrap_or_default()
}
