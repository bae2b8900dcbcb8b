//! A log's timeline as a trace that ui.perfetto.dev opens.
//!
//! Each service is a track. A step lasts from its boundary to the publication of its outputs, and names the samples that it used;
//! with it go its deadline and, where health tells of one, its overrun. Events stand on their services' tracks.

use fss_bus::launch::Launch;
use fss_messages::{Event, Health, Step, text_of, topic};
use fss_records::log::Log;
use miette::{IntoDiagnostic, Result, WrapErr};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes the trace, and gives how many steps it has.
pub(super) fn write(log: &Log, path: &Path) -> Result<usize> {
    let wrong = || format!("cannot write {}", path.display());
    let mut file = BufWriter::new(File::create(path).into_diagnostic().wrap_err_with(wrong)?);
    let steps = log.samples::<Step>(topic::STEPS.name).into_diagnostic()?;
    let health = log.samples::<Health>(topic::HEALTH.name).into_diagnostic()?;
    let events = log.samples::<Event>(topic::EVENTS.name).into_diagnostic()?;
    let text = log.attachment(fss_service::LAUNCH_FILE).into_diagnostic()?.unwrap_or_default();
    let launch = Launch::of_run(&text).ok();
    let deadline_ns = |name: &str| Some(launch.as_ref()?.schedule(name)?.deadline_ns());
    let mut tracks: BTreeMap<String, usize> = BTreeMap::new();
    let mut entries = 0;
    let mut put = |entry: &Value| -> Result<()> {
        let comma = if entries == 0 { "{\"traceEvents\":[\n" } else { ",\n" };
        entries += 1;
        write!(file, "{comma}{entry}").into_diagnostic().wrap_err_with(wrong)
    };
    let mut track = |name: &str| {
        let next = tracks.len() + 1;
        *tracks.entry(name.to_owned()).or_insert(next)
    };
    for step in &steps {
        let name = text_of(&step.service).to_owned();
        let inputs: Vec<u64> = step.input.iter().copied().filter(|sequence| *sequence > 0).collect();
        let late_ns = deadline_ns(&name).map(|ns| (step.stamp_ns + ns) as f64 / 1e3);
        put(
            &json!({ "name": "step", "cat": "step", "ph": "X", "pid": 1, "tid": track(&name), "ts": us(step.stamp_ns),
            "dur": us(step.published_ns.saturating_sub(step.stamp_ns)),
            "args": { "step": step.step, "inputs": inputs, "deadline_us": late_ns } }),
        )?;
    }
    let mut told: BTreeMap<String, u64> = BTreeMap::new();
    for report in &health {
        let name = text_of(&report.service).to_owned();
        let boundary_ns = report.overrun_boundary_ns;
        if boundary_ns > 0 && told.insert(name.clone(), boundary_ns) != Some(boundary_ns) {
            put(&json!({ "name": "overrun", "cat": "overrun", "ph": "X", "pid": 1, "tid": track(&name),
                "ts": us(boundary_ns + report.overrun_end_ns.saturating_sub(report.overrun_excess_ns)),
                "dur": us(report.overrun_excess_ns), "args": { "overruns": report.overruns } }))?;
        }
        put(&json!({ "name": format!("{name} wake-up p99 us"), "ph": "C", "pid": 1, "ts": us(report.stamp_ns),
            "args": { "us": us(report.wake_p99_ns) } }))?;
    }
    for event in &events {
        let (source, words) = (text_of(&event.service), text_of(&event.text));
        put(&json!({ "name": words, "cat": "event", "ph": "i", "s": "t", "pid": 1, "tid": track(source),
            "ts": us(event.stamp_ns), "args": { "severity": event.severity } }))?;
    }
    put(&json!({ "name": "process_name", "ph": "M", "pid": 1, "args": { "name": "fss" } }))?;
    for (name, id) in &tracks {
        put(&json!({ "name": "thread_name", "ph": "M", "pid": 1, "tid": id, "args": { "name": name } }))?;
    }
    file.write_all(b"\n]}\n").and_then(|()| file.flush()).into_diagnostic().wrap_err_with(wrong)?;
    Ok(steps.len())
}

fn us(ns: u64) -> f64 {
    ns as f64 / 1e3
}
