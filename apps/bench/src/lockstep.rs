//! `fss bench lockstep`: what a step costs of a service that is a program of its own, on a clock that nobody waits for.

use crate::LockstepArgs;
use crate::distribution::{Distribution, Percentiles};
use fss_launcher::measured::lockstep_ns;
use fss_launcher::stack::Stack;
use miette::{IntoDiagnostic, Result, miette};
use std::collections::BTreeMap;

/// A process is slower until its memory is mapped; so many of its steps in a hundred are not counted.
const WARM_UP_PERCENT: usize = 5;

pub(crate) fn run(args: &LockstepArgs) -> Result<()> {
    let stack = Stack::load(Some(&args.launch), None, "hold")?;
    let mut told = BTreeMap::<String, Percentiles>::new();
    for (service, times_ns) in lockstep_ns(&stack, args.steps)? {
        let mut distribution = Distribution::new()?;
        for ns in &times_ns[times_ns.len() * WARM_UP_PERCENT / 100..] {
            distribution.record(*ns);
        }
        told.insert(service, distribution.percentiles(1e-3));
    }
    if told.is_empty() {
        return Err(miette!("{} has no [[service]] with program = \"PATH\"", args.launch.display()));
    }
    if args.json {
        say!("{}", serde_json::to_string_pretty(&told).into_diagnostic()?);
        return Ok(());
    }
    say!("{:<16} {:>8} {:>8} {:>8} {:>8}", "a step, us", "p50", "p90", "p99", "max");
    for (service, p) in told {
        say!("{service:<16} {:>8.1} {:>8.1} {:>8.1} {:>8.1}", p.p50, p.p90, p.p99, p.max);
    }
    Ok(())
}
