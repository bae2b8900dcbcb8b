//! `fss urdf`: the vehicle of a plant file, for viewers.

use clap::Args;
use fss_launcher::files::read_plant;
use miette::Result;
use std::path::PathBuf;

/// Print the vehicle of a plant file as a URDF, for three-dimensional viewers.
#[derive(Args)]
pub struct UrdfArgs {
    /// The plant file.
    plant: PathBuf,
}

/// Prints it.
pub fn run(args: &UrdfArgs) -> Result<()> {
    let urdf = fss_plant::urdf::urdf(&read_plant(&args.plant)?);
    say_part!("{urdf}");
    Ok(())
}
