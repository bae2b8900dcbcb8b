//! One link's telemetry: order, loss, and the link's clock.

use fss_wire::link::Telemetry;

/// Telemetry is extrapolated over at most this time, s: beyond it, the joint is where it was going to be then.
const LONGEST_EXTRAPOLATION_S: f64 = 0.5;

/// Fastest that a link's clock may run away from the host's (an uncompensated crystal), ns a ns.
const CLOCK_DRIFT: f64 = 100e-6;

/// A link that starts anew counts from the beginning: so many datagrams in a row that continue each other, and not what
/// came before, are believed.
const RESTART_DATAGRAMS: u32 = 3;

/// A measurement in the host's time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Measurement {
    pub(crate) telemetry: Telemetry,
    pub(crate) measured_ns: u64,
    pub(crate) received_ns: u64,
}

impl Measurement {
    /// The joint's angle at `now_ns` if it kept its rate, rad.
    pub(crate) fn angle_at(&self, now_ns: u64) -> f64 {
        let age_s = (now_ns.saturating_sub(self.measured_ns) as f64 * 1e-9).min(LONGEST_EXTRAPOLATION_S);
        f64::from(self.telemetry.position_rad) + f64::from(self.telemetry.velocity_rad_s) * age_s
    }
}

/// Translates a device's clock into the host's.
///
/// Receipt less device time is the clocks' offset plus a transit time that is never negative, so the smallest difference
/// seen comes closest to the offset; it is let grow as fast as the clocks may drift apart.
#[derive(Clone, Copy, Debug, Default)]
struct DeviceClock {
    /// Offset ns, and the receipt at which it was last corrected ns.
    offset: Option<(f64, u64)>,
}

impl DeviceClock {
    /// Host time of `device_ns`, which was received at `received_ns`; never after that.
    fn host_ns(&mut self, device_ns: u64, received_ns: u64) -> u64 {
        let difference = received_ns as f64 - device_ns as f64;
        let offset = self.offset.map_or(difference, |(offset, since_ns)| {
            difference.min(offset + CLOCK_DRIFT * received_ns.saturating_sub(since_ns) as f64)
        });
        self.offset = Some((offset, received_ns));
        let late_ns = (difference - offset).max(0.0) as u64;
        received_ns.saturating_sub(late_ns)
    }
}

/// What became of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    Accepted,
    /// Repeated or overtaken.
    Refused,
    /// The link has started anew; this datagram is accepted.
    Restarted,
}

/// Receives the telemetry of one link.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Receiver {
    pub(crate) newest: Option<Measurement>,
    /// Last accepted torque reading that was not saturated, N m.
    pub(crate) torque_nm: f64,
    pub(crate) lost: u32,
    clock: DeviceClock,
    /// Sequence of the last refused datagram, and how many in a row continued each other.
    refused: (u64, u32),
}

impl Receiver {
    /// Takes a decoded datagram. `early_ns` is how long before its receipt it was measured at the least.
    pub(crate) fn accept(&mut self, telemetry: &Telemetry, received_ns: u64, early_ns: u64) -> Verdict {
        let mut verdict = Verdict::Accepted;
        if let Some(newest) = &self.newest {
            let last = newest.telemetry.sequence;
            if telemetry.sequence <= last {
                if !self.is_restart(telemetry.sequence) {
                    return Verdict::Refused;
                }
                self.clock = DeviceClock::default();
                verdict = Verdict::Restarted;
            } else {
                self.lost = self.lost.saturating_add((telemetry.sequence - last - 1).min(u32::MAX.into()) as u32);
            }
        }
        self.refused = (0, 0);
        let measured_ns = self.clock.host_ns(telemetry.time_ns, received_ns).saturating_sub(early_ns);
        self.newest = Some(Measurement { telemetry: *telemetry, measured_ns, received_ns });
        verdict
    }

    fn is_restart(&mut self, sequence: u64) -> bool {
        let (last, count) = self.refused;
        self.refused = (sequence, if count > 0 && sequence == last + 1 { count + 1 } else { 1 });
        self.refused.1 >= RESTART_DATAGRAMS
    }

    pub(crate) fn is_alive(&self, now_ns: u64, max_age_ns: u64) -> bool {
        self.newest.is_some_and(|newest| now_ns.saturating_sub(newest.received_ns) <= max_age_ns)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 200_000_000;

    fn telemetry(sequence: u64) -> Telemetry {
        Telemetry { link: 1, sequence, time_ns: sequence * PERIOD_NS, ..Telemetry::default() }
    }

    #[test]
    fn a_late_datagram_is_as_old_as_the_links_clock_says() {
        let mut receiver = Receiver::default();
        let boot_ns = 7_000_000_000;
        for (sequence, late_ns) in [(1, 3_000_000), (2, 90_000_000), (3, 40_000_000)] {
            let sent_ns = boot_ns + sequence * PERIOD_NS;
            receiver.accept(&telemetry(sequence), sent_ns + late_ns, 0);
            let error = receiver.newest.unwrap().measured_ns as f64 - sent_ns as f64;
            assert!((0.0..=3_100_000.0).contains(&error), "datagram {sequence} is {error} ns off");
        }
    }

    #[test]
    fn a_link_that_starts_anew_is_believed_after_three_datagrams() {
        let mut receiver = Receiver::default();
        for sequence in 500..510 {
            assert_eq!(receiver.accept(&telemetry(sequence), sequence * PERIOD_NS, 0), Verdict::Accepted);
        }
        let now = 600 * PERIOD_NS;
        assert_eq!(receiver.accept(&telemetry(1), now, 0), Verdict::Refused);
        assert_eq!(receiver.accept(&telemetry(2), now + PERIOD_NS, 0), Verdict::Refused);
        assert_eq!(receiver.accept(&telemetry(3), now + 2 * PERIOD_NS, 0), Verdict::Restarted);
        assert_eq!(receiver.newest.unwrap().measured_ns, now + 2 * PERIOD_NS, "its clock began anew as well");
    }

    #[test]
    fn repeated_old_datagrams_are_never_taken_for_a_restart() {
        let mut receiver = Receiver::default();
        receiver.accept(&telemetry(10), 10 * PERIOD_NS, 0);
        for old in [9, 9, 9, 7, 8, 10, 10, 10] {
            assert_eq!(receiver.accept(&telemetry(old), 11 * PERIOD_NS, 0), Verdict::Refused);
        }
    }
}
