//! `fss new service`: a service of one's own, ready to build and fly.

use clap::{Args, Subcommand};
use fss_bus::launch::{Launch, SERVICES};
use fss_launcher::stack::DEFAULT_LAUNCH;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// Things to begin.
#[derive(Subcommand)]
pub enum NewCommand {
    /// Make the folder of a service: its program, a message and a topic of its own, a launch file, and `./check`.
    Service(NewServiceArgs),
}

/// Which service.
#[derive(Args)]
pub struct NewServiceArgs {
    /// Its name: lower-case letters, digits and underscores.
    name: String,
    #[command(flatten)]
    language: Language,
    /// The folder to make; one of the service's name where absent.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder of fss's sources, on which the service builds; those of this program where absent.
    #[arg(long, value_name = "DIR")]
    source: Option<PathBuf>,
}

/// In which language.
#[derive(Args)]
#[group(required = true, multiple = false)]
struct Language {
    /// A crate that depends on fss-service.
    #[arg(long)]
    rust: bool,
}

/// A file of the folder: its path, its text, whether it is a program.
type Template = (&'static str, &'static str, bool);

const RUST: &[Template] = &[
    ("Cargo.toml", include_str!("new/rust/Cargo.toml.in"), false),
    // The versions with which fss itself was built: what meets in shared memory is one version of iceoryx2.
    ("Cargo.lock", include_str!("../../../Cargo.lock"), false),
    ("src/main.rs", include_str!("new/rust/main.rs.in"), false),
    ("check", include_str!("new/rust/check.in"), true),
    (".gitignore", "bin\nout\ntarget\n", false),
];

/// The table of the launch file.
const TABLE: &str = "
[[service]]
name = \"@NAME@\"                     # a service of one's own
program = \"bin/@NAME@\"              # from this file's folder
config = { smoothing_s = 0.5 }
rate_hz = 50
phase_us = 3000                     # when navigation of this period is there
";

/// Where the sources of this program lay when it was built.
const SOURCE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Runs the command.
pub fn run(command: &NewCommand) -> Result<()> {
    let NewCommand::Service(args) = command;
    let launch = format!("{DEFAULT_LAUNCH}{TABLE}").replace("@NAME@", &args.name);
    check_name(&args.name, &launch)?;
    let source = args.source.clone().unwrap_or_else(|| PathBuf::from(SOURCE));
    let source = source.canonicalize().ok().filter(|folder| folder.join("interfaces/service/Cargo.toml").exists());
    let source = source.ok_or_else(|| {
        miette!(
            help = "name their folder with --source DIR",
            "the sources of fss, on which a service builds, are not there"
        )
    })?;
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from(&args.name));
    if folder.exists() {
        return Err(miette!(help = "name another with --out", "{} exists", folder.display()));
    }
    let fill = |text: &str| {
        let text = text.replace("@NAME@", &args.name).replace("@TYPE@", &camel_case(&args.name));
        text.replace("@SOURCE@", &source.display().to_string())
    };
    debug_assert!(args.language.rust);
    for (name, text, is_program) in RUST {
        write(&folder.join(name), &fill(text), *is_program)?;
    }
    write(&folder.join("launch.toml"), &launch, false)?;
    say!("{}: change src/main.rs, and run ./check", folder.display());
    Ok(())
}

/// Whether the launch file takes a service of this name.
fn check_name(name: &str, launch: &str) -> Result<()> {
    if SERVICES.contains(&name) {
        return Err(miette!(help = "take another name", "'{name}' is a service of fss"));
    }
    Launch::parse(launch, SERVICES).map_err(|e| miette!(help = e.help, "{}", e.message))?;
    Ok(())
}

/// `thrust_meter` as `ThrustMeter`.
fn camel_case(name: &str) -> String {
    let capital = |word: &str| word[..1].to_uppercase() + &word[1..];
    name.split('_').filter(|word| !word.is_empty()).map(capital).collect()
}

fn write(path: &Path, text: &str, is_program: bool) -> Result<()> {
    let failed = || format!("cannot write {}", path.display());
    path.parent().map_or(Ok(()), std::fs::create_dir_all).into_diagnostic().wrap_err_with(failed)?;
    std::fs::write(path, text).into_diagnostic().wrap_err_with(failed)?;
    if is_program {
        let mode = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(path, mode).into_diagnostic().wrap_err_with(failed)?;
    }
    Ok(())
}
