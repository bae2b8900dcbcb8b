//! `fss new service`: a service of one's own, ready to build and fly.

use clap::{Args, Subcommand};
use fss_bus::launch::Launch;
use fss_launcher::services::names;
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
    /// A C program that is linked with libfss.
    #[arg(long)]
    c: bool,
    /// A Python program on fss.service.
    #[arg(long)]
    python: bool,
}

/// A file of the folder: its path, its text, whether it is a program.
type Template = (&'static str, &'static str, bool);

/// What a language needs.
struct Starter {
    /// The file to change.
    main: &'static str,
    /// The program, as the launch file names it.
    program: &'static str,
    /// What `./check` does to build it.
    build: &'static str,
    files: &'static [Template],
}

const MESSAGE: Template = ("@NAME@_msgs/msg/@TYPE@State.msg", include_str!("new/state.msg.in"), false);

const RUST: Starter = Starter {
    main: "src/main.rs",
    program: "bin/@NAME@",
    build: include_str!("new/rust/build.in"),
    files: &[
        ("Cargo.toml", include_str!("new/rust/Cargo.toml.in"), false),
        // The versions with which fss itself was built: what meets in shared memory is one version of iceoryx2.
        ("Cargo.lock", include_str!("../../../Cargo.lock"), false),
        ("src/main.rs", include_str!("new/rust/main.rs.in"), false),
        (".gitignore", "bin\nout\ntarget\n", false),
    ],
};
const C: Starter = Starter {
    main: "main.c",
    program: "bin/@NAME@",
    build: include_str!("new/c/build.in"),
    files: &[
        ("main.c", include_str!("new/c/main.c.in"), false),
        MESSAGE,
        (".gitignore", "bin\nout\ntarget\n*_messages.h\n", false),
    ],
};
const PYTHON: Starter = Starter {
    main: "@NAME@.py",
    program: "@NAME@",
    build: include_str!("new/python/build.in"),
    files: &[
        ("@NAME@.py", include_str!("new/python/service.py.in"), false),
        ("@NAME@", include_str!("new/python/start.in"), true),
        MESSAGE,
        (".gitignore", "bin\nout\ntarget\n*_messages.py\n", false),
    ],
};

/// The table of the launch file.
const TABLE: &str = "
[[service]]
name = \"@NAME@\"                     # a service of one's own
program = \"@PROGRAM@\"              # from this file's folder
config = { smoothing_s = 0.5 }
rate_hz = 50
phase_us = 3000                     # when navigation of this period is there
";

/// Where the sources of this program lay when it was built.
const SOURCE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Runs the command.
pub fn run(command: &NewCommand) -> Result<()> {
    let NewCommand::Service(args) = command;
    let starter = match args.language {
        Language { c: true, .. } => C,
        Language { python: true, .. } => PYTHON,
        Language { .. } => RUST,
    };
    let launch = format!("{DEFAULT_LAUNCH}{TABLE}").replace("@PROGRAM@", starter.program).replace("@NAME@", &args.name);
    check_name(&args.name, &launch)?;
    let source = args.source.clone().unwrap_or_else(|| PathBuf::from(SOURCE));
    let source = source.canonicalize().ok().filter(|folder| folder.join("interfaces/service/Cargo.toml").exists());
    let source = match source {
        Some(folder) => folder,
        // The wheel has what a service in Python needs.
        None if args.language.python && args.source.is_none() => PathBuf::from(SOURCE),
        None => {
            return Err(miette!(
                help = "name their folder with --source DIR",
                "the sources of fss, on which a service builds, are not there"
            ));
        }
    };
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from(&args.name));
    if folder.exists() {
        return Err(miette!(help = "name another with --out", "{} exists", folder.display()));
    }
    let fill = |text: &str| {
        let text = text.replace("@NAME@", &args.name).replace("@TYPE@", &camel_case(&args.name));
        text.replace("@SOURCE@", &source.display().to_string())
    };
    for (name, text, is_program) in starter.files {
        write(&folder.join(fill(name)), &fill(text), *is_program)?;
    }
    let check = include_str!("new/check.in").replace("@BUILD@", starter.build.trim_end());
    write(&folder.join("check"), &fill(&check), true)?;
    write(&folder.join("launch.toml"), &launch, false)?;
    say!("{}: change {}, and run ./check", folder.display(), fill(starter.main));
    Ok(())
}

/// Whether the launch file takes a service of this name.
fn check_name(name: &str, launch: &str) -> Result<()> {
    let known = names();
    if known.contains(&name) {
        return Err(miette!(help = "take another name", "'{name}' is a service of fss"));
    }
    Launch::parse(launch, &known).map_err(|e| miette!(help = e.help, "{}", e.message))?;
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
