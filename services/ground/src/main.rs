//! `fss-ground`: the live view of a stack as a program of its own. The launcher starts it as `fss service ground`.

use clap::Parser;
use fss_bus::Service;
use fss_ground::{Ground, GroundConfig};
use fss_plant::Plant;
use fss_service::{MISSION_FILE, PLANT_FILE, Process, SiteArgs, explain_errors};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::Deserialize;

/// Show a running stack to Foxglove, Lichtblick and PlotJuggler.
#[derive(Parser)]
#[command(name = "fss-ground", version)]
struct Cli {
    #[command(flatten)]
    site: SiteArgs,
}

/// What it needs of the mission file.
#[derive(Deserialize)]
struct Named {
    name: String,
}

/// Those who fly go before those who watch.
const NICE_TO_THE_FLIGHT: i32 = 10;

fn main() -> Result<()> {
    explain_errors();
    let site = Process::open(Ground::NAME, &Cli::parse().site)?;
    let where_to = site.launch.ground.clone().ok_or_else(|| {
        miette!(help = "[ground]\nlisten = \"127.0.0.1:8765\"", "the launch file does not say where to listen")
    })?;
    let plant = Plant::parse(&site.read(PLANT_FILE)?)
        .map_err(|e| miette!(help = e.help, "{}: {}", site.folder.join(PLANT_FILE).display(), e.message))?;
    let mission: Named = toml::from_str(&site.read(MISSION_FILE)?).into_diagnostic().wrap_err(MISSION_FILE)?;
    // Refused or not, it is no real-time process.
    let _ = rustix::process::setpriority_process(None, NICE_TO_THE_FLIGHT);
    let name = ["fss", &site.launch.vehicle, &mission.name].join(" ").replace("  ", " ");
    let config = GroundConfig { listen: where_to.listen, name, commands: where_to.commands, origins: where_to.origins };
    let ground = Ground::listen(&config, &plant, &site.bus).into_diagnostic().wrap_err("ground ([ground] listen)")?;
    site.fly(ground, || ())?.close();
    Ok(())
}
