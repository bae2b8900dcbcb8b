//! `fss host`: whether this computer is fit to fly, and what to do where it is not.

use crate::run::launch_of;
use clap::{Args, Subcommand};
use fss_bus::launch::Launch;
use fss_bus::realtime;
use miette::{IntoDiagnostic, Result, miette};
use serde::Serialize;
use std::path::PathBuf;

/// Commands on the host.
#[derive(Subcommand)]
pub enum HostCommand {
    /// Find what makes this computer unfit for real time, and say the fix.
    Check(CheckArgs),
}

/// What to check for.
#[derive(Args)]
pub struct CheckArgs {
    /// Launch file whose priorities and cores the host must grant; that of the laboratory where absent.
    #[arg(long, value_name = "FILE")]
    launch: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Verdict {
    Good,
    /// It flies, with less certainty about its times.
    Worse,
    /// It must not fly.
    Unfit,
}

/// One thing looked at.
#[derive(Serialize)]
struct Finding {
    what: &'static str,
    verdict: Verdict,
    found: String,
    /// What to do; empty where nothing is.
    fix: String,
}

impl Finding {
    fn new(what: &'static str, verdict: Verdict, found: impl Into<String>, fix: impl Into<String>) -> Self {
        let fix = if verdict == Verdict::Good { String::new() } else { fix.into() };
        Self { what, verdict, found: found.into(), fix }
    }
}

/// Checks and tells; an unfit host is an error.
pub fn run(command: &HostCommand) -> Result<()> {
    let HostCommand::Check(args) = command;
    let launch = launch_of(args.launch.as_deref())?;
    let findings = [
        kernel(),
        privileges(&launch),
        cores(&launch),
        isolation(&launch),
        governor(),
        throttling(),
        shared_memory(),
        clock(),
    ];
    if args.json {
        say!("{}", serde_json::to_string_pretty(&findings).into_diagnostic()?);
    } else {
        for f in &findings {
            let mark = match f.verdict {
                Verdict::Good => "good ",
                Verdict::Worse => "worse",
                Verdict::Unfit => "UNFIT",
            };
            say!("{mark}  {:<14} {}", f.what, f.found);
            if !f.fix.is_empty() {
                say!("       {:<14} -> {}", "", f.fix);
            }
        }
    }
    if findings.iter().any(|f| f.verdict == Verdict::Unfit) {
        return Err(miette!("this computer is unfit to fly; the fixes are above"));
    }
    Ok(())
}

fn read(path: &str) -> Option<String> {
    std::fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

fn kernel() -> Finding {
    let release = read("/proc/sys/kernel/osrelease").unwrap_or_default();
    let is_real_time = read("/sys/kernel/realtime").as_deref() == Some("1");
    let (verdict, kind) = if is_real_time { (Verdict::Good, "PREEMPT_RT") } else { (Verdict::Worse, "not PREEMPT_RT") };
    let fix = "install a real-time kernel: on Ubuntu `sudo pro enable realtime-kernel`, or build 6.12 or later with \
               CONFIG_PREEMPT_RT=y";
    Finding::new("kernel", verdict, format!("Linux {release}, {kind}"), fix)
}

/// Asks for what the most urgent service would ask for, on a thread that ends at once.
fn privileges(launch: &Launch) -> Finding {
    let Some(schedule) = launch.services.iter().max_by_key(|s| s.priority).cloned() else {
        return Finding::new("privileges", Verdict::Good, "the launch file starts no service", "");
    };
    let missing = std::thread::spawn(move || realtime::enter(&schedule).missing).join().unwrap_or_default();
    let fix = "run it from its systemd unit, or `sudo setcap cap_sys_nice,cap_ipc_lock+ep` on the program, or give its \
               user rtprio 99 and memlock unlimited in /etc/security/limits.d";
    if missing.is_empty() {
        return Finding::new("privileges", Verdict::Good, "SCHED_FIFO, locked memory and pinned cores are granted", "");
    }
    Finding::new("privileges", Verdict::Worse, format!("without {}", missing.join("; ")), fix)
}

fn real_time_cores(launch: &Launch) -> Vec<usize> {
    let mut cores: Vec<usize> =
        launch.services.iter().filter(|s| s.priority.is_some()).filter_map(|s| s.core).collect();
    cores.sort_unstable();
    cores.dedup();
    cores
}

fn cores(launch: &Launch) -> Finding {
    let count = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let needed = real_time_cores(launch).last().map_or(1, |last| last + 1);
    let verdict = if count >= needed { Verdict::Good } else { Verdict::Unfit };
    let fix = "give the services other cores in the launch file, or take a computer with more";
    Finding::new("cores", verdict, format!("{count}; the launch file needs {needed}"), fix)
}

fn isolation(launch: &Launch) -> Finding {
    let isolated = list(&read("/sys/devices/system/cpu/isolated").unwrap_or_default());
    let wanted = real_time_cores(launch);
    let open: Vec<String> = wanted.iter().filter(|core| !isolated.contains(core)).map(ToString::to_string).collect();
    let verdict = if open.is_empty() { Verdict::Good } else { Verdict::Worse };
    let cores = open.join(",");
    let found = if open.is_empty() {
        "the cores of the real-time services are theirs alone".to_owned()
    } else {
        format!("everybody's work runs on core {cores} too")
    };
    let fix = format!(
        "leave core {cores} to fss: add isolcpus={cores} nohz_full={cores} rcu_nocbs={cores} to the kernel's command line, and \
         keep one core for the rest"
    );
    Finding::new("isolation", verdict, found, fix)
}

/// `0-2,5` as numbers.
fn list(text: &str) -> Vec<usize> {
    let range = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        Some(first.trim().parse().ok()?..=last.trim().parse().ok()?)
    };
    text.split(',').filter_map(range).flatten().collect()
}

fn governor() -> Finding {
    let count = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let path = |core| format!("/sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor");
    let governors: Vec<String> = (0..count).filter_map(|core| read(&path(core))).collect();
    if governors.is_empty() {
        return Finding::new("governor", Verdict::Good, "the cores' frequency is not scaled", "");
    }
    let verdict = if governors.iter().all(|g| g == "performance") { Verdict::Good } else { Verdict::Worse };
    Finding::new("governor", verdict, governors.join(", "), "`sudo cpupower frequency-set -g performance`")
}

fn throttling() -> Finding {
    let number = |path| read(path).and_then(|text| text.parse::<i64>().ok());
    let runtime_us = number("/proc/sys/kernel/sched_rt_runtime_us").unwrap_or(950_000);
    let period_us = number("/proc/sys/kernel/sched_rt_period_us").unwrap_or(1_000_000);
    let enough = runtime_us < 0 || runtime_us * 10 >= period_us * 9;
    let verdict = if enough { Verdict::Good } else { Verdict::Unfit };
    let found = if runtime_us < 0 { "off".to_owned() } else { format!("{runtime_us} of {period_us} us for real time") };
    Finding::new("throttling", verdict, found, "`sudo sysctl kernel.sched_rt_runtime_us=950000`")
}

fn shared_memory() -> Finding {
    const NEEDED_MB: u64 = 64;
    let Ok(fs) = rustix::fs::statvfs("/dev/shm") else {
        let fix = "`sudo mount -t tmpfs -o mode=1777 tmpfs /dev/shm`";
        return Finding::new("shared memory", Verdict::Unfit, "there is no /dev/shm", fix);
    };
    let free_mb = fs.f_bavail * fs.f_frsize / 1_000_000;
    let verdict = if free_mb >= NEEDED_MB { Verdict::Good } else { Verdict::Unfit };
    let fix = "remove what fills /dev/shm, or `sudo mount -o remount,size=512M /dev/shm`";
    Finding::new("shared memory", verdict, format!("{free_mb} MB free in /dev/shm; a stack needs {NEEDED_MB}"), fix)
}

fn clock() -> Finding {
    let source = read("/sys/devices/system/clocksource/clocksource0/current_clocksource").unwrap_or_default();
    let is_fast = ["tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"].contains(&source.as_str());
    let resolution = rustix::time::clock_getres(rustix::time::ClockId::Monotonic);
    let is_fine = resolution.tv_sec == 0 && resolution.tv_nsec <= 1000;
    let verdict = match (is_fine, is_fast) {
        (true, true) => Verdict::Good,
        (true, false) => Verdict::Worse,
        _ => Verdict::Unfit,
    };
    let fix =
        "choose a fast clock (clocksource=tsc on the kernel's command line) and a kernel with high-resolution timers";
    Finding::new("clock", verdict, format!("{source}, resolution {} ns", resolution.tv_nsec), fix)
}
