//! A campaign for more than one machine: an array of jobs of the Slurm workload manager.

use super::definition::Campaign;
use miette::{IntoDiagnostic, Result, miette};

/// Cores that each job asks for.
const CORES: u64 = 8;

/// Writes the script into the campaign's folder, and says how it is used.
///
/// # Errors
/// Where there is nothing to share, or the folder refuses.
pub(super) fn write(campaign: &Campaign, shards: u64) -> Result<()> {
    if !(1..=campaign.count()).contains(&shards) {
        return Err(miette!("{shards} shards cannot share {} runs", campaign.count()));
    }
    let folder = campaign.folder.canonicalize().into_diagnostic()?;
    let program = std::env::current_exe().into_diagnostic()?;
    let [folder, program] = [folder, program].map(|path| quoted(&path.to_string_lossy()));
    let script = format!(
        "#!/bin/bash
# {count} runs of {mission} in {shards} shards. A job that is killed and queued again goes on where it was.
#SBATCH --job-name=fss-{mission}
#SBATCH --array=1-{shards}
#SBATCH --cpus-per-task={CORES}
#SBATCH --mem=4G
#SBATCH --requeue
#SBATCH --open-mode=append
export RAYON_NUM_THREADS=\"${{SLURM_CPUS_PER_TASK:-{CORES}}}\"
exec {program} campaign --out {folder} --shard \"$SLURM_ARRAY_TASK_ID/{shards}\" --quiet
",
        count = campaign.count(),
        mission = campaign.stack.mission_name,
    );
    let path = campaign.folder.join("campaign.sbatch");
    fss_launcher::files::write(&path, &script)?;
    say!("submit it with `sbatch {}`, where all machines see this folder;", path.display());
    say!(
        "`fss campaign --out {}` flies what may be missing then, and tells the figures of all",
        campaign.folder.display()
    );
    Ok(())
}

/// As one word of the shell.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}
