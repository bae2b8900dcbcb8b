//! The clock of another host.

/// Two monotonic clocks differ by a rate of at most this: quartz and what NTP adds to it, parts of a thousand.
const DRIFT_PER_MILLE: i64 = 1;

/// What brings the times of another host to the clock of this one, estimated from what comes.
///
/// Monotonic clocks count from the start of their computers and have no epoch in common. A sample that is sent at `s` there
/// and comes at `r` here gives `r - s`: the offset of the clocks and the time on the way. The smallest such difference is
/// the offset and the shortest way, which nothing that only listens can tell apart. It falls at once with a shorter way; it
/// rises no faster than two clocks drift apart, so that a network that has become slow is not taken for a clock.
#[derive(Clone, Copy, Debug, Default)]
pub struct PeerClock {
    offset_ns: Option<i64>,
    at_ns: u64,
}

impl PeerClock {
    /// Takes in that what was sent at `sent_ns` there came at `received_ns` here; returns the offset.
    pub fn observe(&mut self, sent_ns: u64, received_ns: u64) -> i64 {
        let difference_ns = received_ns.wrapping_sub(sent_ns) as i64;
        let drift_ns = (received_ns.saturating_sub(self.at_ns) / 1000) as i64 * DRIFT_PER_MILLE;
        let offset_ns =
            self.offset_ns.map_or(difference_ns, |offset_ns| difference_ns.min(offset_ns.saturating_add(drift_ns)));
        *self = Self { offset_ns: Some(offset_ns), at_ns: received_ns };
        offset_ns
    }

    /// What is added to times of that host, ns; none before anything came.
    pub fn offset_ns(&self) -> Option<i64> {
        self.offset_ns
    }
}
