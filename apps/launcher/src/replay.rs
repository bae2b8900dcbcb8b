//! `fss replay`: every service computed again from the inputs that a log holds, and compared bit for bit.

pub(crate) mod player;
mod programs;
pub(crate) mod tape;

use crate::services::Services;
use crate::stack::Stack;
use clap::Args;
use fss_records::log::Log;
use miette::{IntoDiagnostic, Result, miette};
use player::Verdict;
use serde::Serialize;
use std::path::PathBuf;
use std::process::ExitCode;
use tape::Tape;

/// What no log can give again, by name.
const NOT_REPLAYED: &[(&str, &str)] = &[
    ("lab", "it is the world, not a service"),
    ("recorder", "the log is what it made"),
    ("ground", "it only shows what others said"),
    ("bridge", "what it passes on is another vehicle's, and in the log"),
    ("commands to the links and masks to the valves", "they leave for the devices and are not recorded as sent"),
    ("/health and the events of starting", "they come from the clock of the process, not from a step"),
];
/// Differences that are shown of each service.
const SHOWN: usize = 5;

/// Compute each service again from its recorded inputs.
#[derive(Args)]
pub struct ReplayArgs {
    /// The log, an MCAP file; where the recorder began a new one in flight (`rotate_mb`), all parts.
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Answer {
    format: &'static str,
    identical: bool,
    services: Vec<Verdict>,
    not_replayed: Vec<String>,
}

/// Runs the command: 0 where all is identical, 1 where something differs, 2 where something could not be replayed.
pub fn run(args: &ReplayArgs) -> ExitCode {
    match replay(args) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("{error:?}");
            ExitCode::from(2)
        }
    }
}

fn replay(args: &ReplayArgs) -> Result<ExitCode> {
    let logs = args.logs.iter().map(|path| Log::open(path)).collect::<Result<Vec<_>, _>>().into_diagnostic()?;
    let stack = Stack::of_log(&logs[0])?;
    let linked: Vec<_> = Services::linked().iter().filter(|service| is_linked(&stack, service.name())).collect();
    let tape = linked.iter().fold(Tape::new(&stack.launch), |tape, service| service.with_ports(tape));
    let tape = tape.read(&logs).into_diagnostic()?;
    if tape.steps.is_empty() {
        return Err(miette!(
            help = "fly again with this version: it records each step on /steps",
            "{} says nothing of the services' steps, so they cannot be computed again",
            logs[0].path().display()
        ));
    }
    let mut services = linked.iter().map(|service| service.replay(&stack, &tape)).collect::<Result<Vec<_>>>()?;
    services.extend(programs::replay_all(&stack, &tape, &logs, |name| {
        linked.iter().any(|service| service.name() == name)
    })?);
    let differ = services.iter().any(|verdict| verdict.difference_count > 0);
    let incomplete = services.iter().any(|verdict| !verdict.gaps.is_empty());
    let not_replayed: Vec<String> = NOT_REPLAYED.iter().map(|(name, why)| format!("{name}: {why}")).collect();
    if args.json {
        let answer = Answer { format: "fss-replay/1", identical: !differ && !incomplete, services, not_replayed };
        say!("{}", serde_json::to_string_pretty(&answer).into_diagnostic()?);
    } else {
        print(&services, &not_replayed);
    }
    Ok(ExitCode::from(if differ {
        1
    } else if incomplete {
        2
    } else {
        0
    }))
}

/// Whether the stack flew this service without a program of its own.
fn is_linked(stack: &Stack, service: &str) -> bool {
    stack.launch.schedule(service).is_some_and(|schedule| schedule.program.is_none())
}

fn print(services: &[Verdict], not_replayed: &[String]) {
    say!("{:<12} {:>9} {:>9} {:>9} {:>12}", "service", "starts", "steps", "samples", "differences");
    for v in services {
        let (service, count) = (&v.service, v.difference_count);
        say!("{service:<12} {:>9} {:>9} {:>9} {count:>12}", v.starts, v.steps, v.samples);
    }
    for v in services {
        for d in v.differences.iter().take(SHOWN) {
            say!("{}, start {}, step {} at {:.3} s: {d}", v.service, d.start, d.step, d.time_s);
        }
        if v.difference_count > v.differences.len().min(SHOWN) as u64 {
            say!("{}: and {} more", v.service, v.difference_count - v.differences.len().min(SHOWN) as u64);
        }
        for gap in &v.gaps {
            say!("{}: not replayed: {gap}", v.service);
        }
    }
    for line in not_replayed {
        say!("not replayed: {line}");
    }
}
