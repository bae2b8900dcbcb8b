//! What each log of a run says about it.

use crate::stack::Stack;

use fss_bus::realtime;
use fss_plant::urdf::urdf;
use fss_records::log::{LogError, LogWriter};
use fss_service::PROGRAMS_FILE;
use miette::{IntoDiagnostic, Result, WrapErr};
use std::collections::BTreeMap;
use std::time::{SystemTime, UNIX_EPOCH};

/// The vehicle as viewers draw it, made from the plant file.
const URDF_FILE: &str = "vehicle.urdf";

/// What each log of a run says about it: the stack's files and the facts of the build and the host.
pub(crate) struct Description {
    files: Vec<(&'static str, String)>,
    facts: BTreeMap<String, String>,
}

impl Description {
    /// Of a stack on a clock, `real time` or `virtual`, and the seed of its simulated laboratory.
    ///
    /// # Errors
    /// Where the computer's clocks cannot be read.
    pub(crate) fn new(stack: &Stack, clock: &str, seed: u64) -> Result<Self> {
        let mut facts = BTreeMap::from([
            ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            ("clock".to_owned(), clock.to_owned()),
        ]);
        if clock == "real time" {
            let unix_ns = unix_time_ns()?;
            let monotonic_ns = realtime::now().into_diagnostic()?.ns();
            facts.insert("unix_minus_monotonic_ns".to_owned(), unix_ns.saturating_sub(monotonic_ns).to_string());
            let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
            facts.insert("host".to_owned(), host.trim().to_owned());
            let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
            facts.insert("kernel".to_owned(), kernel.trim().to_owned());
        }
        if stack.launch.schedule("lab").is_some() {
            facts.insert("seed".to_owned(), seed.to_string());
        }
        let mut files = stack.attachments()?;
        files.push((URDF_FILE, urdf(&stack.plant)));
        Ok(Self { files, facts })
    }

    /// Puts it into a log.
    ///
    /// # Errors
    /// Where the log refuses.
    pub(crate) fn write_to(&self, log: &mut LogWriter) -> Result<(), LogError> {
        for (name, text) in &self.files {
            let media_type = match *name {
                URDF_FILE => "application/xml",
                PROGRAMS_FILE => "application/json",
                _ => "application/toml",
            };
            log.attach(name, media_type, text)?;
        }
        log.metadata("fss", self.facts.clone())
    }
}

pub(crate) fn unix_time_ns() -> Result<u64> {
    let since =
        SystemTime::now().duration_since(UNIX_EPOCH).into_diagnostic().wrap_err("the calendar clock is unset")?;
    Ok(since.as_nanos() as u64)
}
