//! A browser without a window, which shows a page as one with a window does.

use fss_launcher::measured::time_of_process_ns;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use rustix::process::{Pid, Signal, geteuid, kill_process_group};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Instant;

/// Draws the page as large as on a laptop, keeps to itself, and stays until it is stopped.
const FLAGS: [&str; 9] = [
    "--headless",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--window-size=1400,1000",
    "--remote-debugging-port=0",
];

/// One that runs; it and what it wrote go with this.
pub(super) struct Browser {
    process: Child,
    profile: PathBuf,
    opened: Instant,
}

/// Whether there is such a browser.
pub(super) fn check(program: &Path) -> Result<()> {
    let version = Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    let version = version.into_diagnostic().wrap_err_with(|| format!("{} --version", program.display()))?;
    if version.success() { Ok(()) } else { Err(miette!("{} --version: {version}", program.display())) }
}

impl Browser {
    pub(super) fn open(program: &Path, page: &str) -> Result<Self> {
        let profile = std::env::temp_dir().join(format!("fss-bench-browser-{}", std::process::id()));
        // Chromium does not run as root with its sandbox; the only page that it shows is ours.
        let sandbox = geteuid().is_root().then_some("--no-sandbox");
        let process = Command::new(program)
            .args(FLAGS)
            .args(sandbox)
            .arg(format!("--user-data-dir={}", profile.display()))
            .arg(page)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0)
            .spawn()
            .into_diagnostic()
            .wrap_err_with(|| program.display().to_string())?;
        Ok(Self { process, profile, opened: Instant::now() })
    }

    /// Processor time of all its processes since it was opened, percent of one core.
    pub(super) fn core_percent(&mut self) -> Result<f64> {
        if let Some(status) = self.process.try_wait().into_diagnostic()? {
            return Err(miette!("the browser ended by itself: {status}"));
        }
        let group = self.process.id();
        let processes = std::fs::read_dir("/proc").into_diagnostic()?.flatten();
        let ids = processes.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        let spent_ns: u64 = ids.filter(|id| group_of(*id) == Some(group)).map(time_of_process_ns).sum();
        Ok(spent_ns as f64 * 1e-7 / self.opened.elapsed().as_secs_f64())
    }
}

fn group_of(process: u32) -> Option<u32> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The name, which may have any character in it, stands in brackets; then come state, parent and group.
    stat.rsplit_once(')')?.1.split_whitespace().nth(2)?.parse().ok()
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _it_may_be_gone = kill_process_group(Pid::from_child(&self.process), Signal::KILL);
        let _ = self.process.wait();
        let _best_effort = std::fs::remove_dir_all(&self.profile);
    }
}
