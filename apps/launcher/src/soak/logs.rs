//! What the logs of a flight hold.

use super::Soak;
use crate::summary::Records;
use fss_messages::{Header, text_of, topic};
use fss_records::log::Log;
use miette::{IntoDiagnostic, Result};
use std::collections::BTreeMap;
use std::path::Path;

/// Sums over all flights that are not figures themselves.
#[derive(Default)]
pub(super) struct Sums {
    navigation2: f64,
    navigation_count: f64,
}

impl Sums {
    pub(super) fn navigation_rms_m(&self) -> f64 {
        (self.navigation2 / self.navigation_count.max(1.0)).sqrt()
    }
}

/// Counts what the logs of a flight hold and what is missing between their records, and compares navigation with truth.
pub(super) fn read(folder: &Path, vehicle: &str, soak: &mut Soak, sums: &mut Sums) -> Result<()> {
    let mut last = BTreeMap::<(String, String), u64>::new();
    let mut logs: Vec<(u64, Log)> = Vec::new();
    for entry in std::fs::read_dir(folder).into_diagnostic()?.flatten() {
        let path = entry.path();
        if path.extension().is_none_or(|e| e != "mcap") {
            continue;
        }
        // A recorder that was killed before it wrote the first byte leaves an empty file: nothing is lost in it.
        if entry.metadata().is_ok_and(|meta| meta.len() == 0) {
            continue;
        }
        let Ok(log) = Log::open(&path) else {
            soak.unreadable_logs += 1;
            continue;
        };
        let (topics, damage) = log.survey().into_diagnostic()?;
        soak.unreadable_logs += u32::from(damage.places > 0);
        soak.records += topics.iter().map(|t| t.count).sum::<u64>();
        logs.push((topics.iter().map(|t| t.first_ns).min().unwrap_or(u64::MAX), log));
    }
    logs.sort_by_key(|(first_ns, _)| *first_ns);
    for (_, log) in &logs {
        log.for_each(|channel, _, body| {
            let Some(header) = Header::of_sample(body) else { return };
            // A topic on which all speak names its publisher behind the header.
            let publisher = if topic::is_shared(&channel.topic) { body.get(24..40).map_or("", text_of) } else { "" };
            let key = (channel.topic.clone(), publisher.to_owned());
            let before = last.insert(key, header.sequence).unwrap_or(header.sequence);
            // A smaller sequence is a restarted publisher.
            soak.lost_records += header.sequence.saturating_sub(before).saturating_sub(1);
        })
        .into_diagnostic()?;
        let records = Records::of(log, vehicle).into_diagnostic()?;
        if let Some((rms_m, count)) = records.navigation_rms_m() {
            sums.navigation2 += rms_m * rms_m * count;
            sums.navigation_count += count;
        }
    }
    Ok(())
}
