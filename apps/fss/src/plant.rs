//! `fss plant`: a plant for other simulators.

use clap::{Args, Subcommand};
use fss_launcher::files::{TextFile, read_plant};
use fss_plant_fmu::description::{IDENTIFIER, xml};
use fss_plant_fmu::variables::variables;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::io::Write;
use std::path::PathBuf;
use zip::write::SimpleFileOptions;

/// The shared library, beside this program.
const LIBRARY: &str = "libfss_plant_fmu.so";

/// What to do with a plant.
#[derive(Subcommand)]
pub enum PlantCommand {
    /// Write a plant with its effects as an FMU for co-simulation.
    ExportFmu(ExportArgs),
}

/// Which plant, and where to.
#[derive(Args)]
pub struct ExportArgs {
    /// The plant file.
    plant: PathBuf,
    /// The FMU.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Version of the standard, 2 or 3.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=3))]
    fmi: u8,
}

/// Does it.
pub fn run(command: &PlantCommand) -> Result<()> {
    match command {
        PlantCommand::ExportFmu(args) => export(args),
    }
}

fn export(args: &ExportArgs) -> Result<()> {
    let plant = read_plant(&args.plant)?;
    let text = TextFile::read(&args.plant, "plant file")?.text;
    let name = args.plant.file_stem().map_or_else(|| "plant".into(), |stem| stem.to_string_lossy());
    let program = std::env::current_exe().into_diagnostic()?;
    let places = [program.with_file_name(LIBRARY), program.with_file_name("../lib").join(LIBRARY)];
    let library = places.iter().find_map(|place| std::fs::read(place).ok()).ok_or_else(|| {
        let help = "`cargo build --release -p fss-plant-fmu` makes it, beside fss; the package has it in /usr/lib";
        miette!(help = help, "the FMU's shared library {} is not there", places[0].display())
    })?;
    let is_fmi2 = args.fmi == 2;
    let platform = if is_fmi2 { "linux64".to_owned() } else { format!("{}-linux", std::env::consts::ARCH) };
    let description = xml(is_fmi2, &name, &variables(&plant));
    let entries = [
        ("modelDescription.xml".to_owned(), description.as_bytes()),
        (format!("binaries/{platform}/{IDENTIFIER}.so"), library.as_slice()),
        ("resources/plant.toml".to_owned(), text.as_bytes()),
    ];
    let wrong = || format!("cannot write {}", args.out.display());
    let file = std::fs::File::create(&args.out).into_diagnostic().wrap_err_with(wrong)?;
    let mut archive = zip::ZipWriter::new(file);
    for (entry, bytes) in entries {
        archive.start_file(entry, SimpleFileOptions::default()).into_diagnostic().wrap_err_with(wrong)?;
        archive.write_all(bytes).into_diagnostic().wrap_err_with(wrong)?;
    }
    archive.finish().into_diagnostic().wrap_err_with(wrong)?;
    say!("{}", args.out.display());
    Ok(())
}
