//! What a stack holds in memory, and whether that grows.

use super::SETTLED;
use crate::member::Site;
use std::collections::{BTreeMap, VecDeque};
use std::sync::PoisonError;
use std::time::Instant;

/// Memory of a stack's processes, and what it holds in shared memory.
#[derive(Default)]
pub(super) struct Memory {
    settled: BTreeMap<u32, (Instant, Option<u64>)>,
    pub(super) rss_growth_bytes: u64,
    shm_settled: Option<u64>,
    /// The last weighings: a process that is just dying or coming is no leak.
    shm_last: VecDeque<u64>,
    started: Option<Instant>,
}

impl Memory {
    /// Takes note of what they hold now.
    pub(super) fn weigh(&mut self, site: &Site) {
        let ids: Vec<u32> = site
            .processes
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .values()
            .copied()
            .chain([std::process::id()])
            .collect();
        for id in ids {
            let Some(bytes) = resident_bytes(id) else { continue };
            let (since, settled) = self.settled.entry(id).or_insert((Instant::now(), None));
            if since.elapsed() >= SETTLED {
                let growth = bytes.saturating_sub(*settled.get_or_insert(bytes));
                self.rss_growth_bytes = self.rss_growth_bytes.max(growth);
            }
        }
        let shm_bytes = shared_memory_bytes(&site.bus_prefix);
        self.shm_last.push_back(shm_bytes);
        if self.shm_last.len() > 8 {
            self.shm_last.pop_front();
        }
        if self.started.get_or_insert_with(Instant::now).elapsed() >= SETTLED {
            self.shm_settled.get_or_insert(shm_bytes);
        }
    }

    /// What the stack holds in shared memory more than when it had settled, bytes.
    pub(super) fn shm_growth(&self) -> u64 {
        let last = self.shm_last.iter().min().copied().unwrap_or(0);
        self.shm_settled.map_or(0, |settled| last.saturating_sub(settled))
    }
}

fn resident_bytes(id: u32) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{id}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// What segments whose names begin so hold, bytes.
pub(super) fn shared_memory_bytes(prefix: &str) -> u64 {
    let Ok(entries) = std::fs::read_dir("/dev/shm") else { return 0 };
    let own = entries.flatten().filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    own.filter_map(|entry| entry.metadata().ok()).map(|meta| meta.len()).sum()
}
