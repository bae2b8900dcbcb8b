//! Man pages and shell completions, for the package.

use clap::{Args, CommandFactory};
use clap_complete::{Shell, generate_to};
use miette::{IntoDiagnostic, Result, WrapErr};
use std::path::PathBuf;

/// Where to.
#[derive(Args)]
pub struct GenerateArgs {
    /// Folder for the files.
    folder: PathBuf,
}

/// Writes a man page for each command and completions for bash, zsh and fish.
pub fn run<C: CommandFactory>(args: &GenerateArgs) -> Result<()> {
    let folder = &args.folder;
    let failed = || format!("cannot write to {}", folder.display());
    std::fs::create_dir_all(folder).into_diagnostic().wrap_err_with(failed)?;
    clap_mangen::generate_to(C::command(), folder).into_diagnostic().wrap_err_with(failed)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        generate_to(shell, &mut C::command(), "fss", folder).into_diagnostic().wrap_err_with(failed)?;
    }
    Ok(())
}
