//! The target as two sources show it: its own word, where it is a vehicle that speaks, and motion capture.
//!
//! The word goes first. A vehicle that flies knows of its own thrusters and gyro, and motion capture need not see it; but its
//! word comes over a network. While the word is fresh it counts, and when it is stale motion capture does, whose filter has
//! followed all the time. The word's times are on the clock of the target's host: the bridge says what brings them to ours.

use crate::target::{Motion, TargetTracker};
use fss_bus::Time;
use fss_messages::{MocapPose, NavState, PeerState};
use std::f64::consts::TAU;

/// A word that is older does not count, ns.
const STALE_NS: u64 = 300_000_000;
/// Once stale, the word must have been fresh for so long before it counts again, ns.
const TRUST_AFTER_NS: u64 = 1_000_000_000;
/// A time that is so far ahead is of another clock, ns.
const AHEAD_NS: u64 = 50_000_000;

/// What the target said of itself last.
#[derive(Clone, Copy, Debug)]
struct Word {
    motion: Motion,
    /// When that was so, ns on this host's clock.
    at_ns: u64,
}

impl Word {
    /// None where it makes no sense or is stale.
    fn of(now: Time, nav: &NavState, peer: &PeerState) -> Option<Self> {
        let at_ns = nav.stamp_ns.wrapping_add_signed(peer.clock_offset_ns);
        let motion =
            Motion { pose: [nav.x_m, nav.y_m, nav.theta_rad], rate: [nav.vx_m_s, nav.vy_m_s, nav.omega_rad_s] };
        let is_good = matches!(nav.mode, NavState::TRACKING | NavState::NO_GYRO)
            && motion.pose.iter().chain(&motion.rate).all(|value| value.is_finite());
        let is_fresh = at_ns <= now.plus_ns(AHEAD_NS).ns() && now.age_ns(at_ns) <= STALE_NS;
        (is_good && is_fresh).then_some(Self { motion, at_ns })
    }
}

/// The target, whoever shows it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sight {
    tracker: TargetTracker,
    word: Option<Word>,
    /// Since when the word has been fresh.
    fresh_since: Option<Time>,
    by_word: bool,
    /// The heading that was told last: the two sources count whole turns each for itself.
    heading: f64,
}

impl Sight {
    /// Takes in what has come of a target that floats freely or is held by this vehicle; true where another source counts from now on.
    pub(crate) fn look(
        &mut self,
        now: Time,
        mocap: Option<&MocapPose>,
        is_held: bool,
        nav: Option<&NavState>,
        peer: Option<&PeerState>,
    ) -> bool {
        if let Some(mocap) = mocap {
            self.tracker.update(mocap, is_held);
        }
        self.word = nav.zip(peer).and_then(|(nav, peer)| Word::of(now, nav, peer));
        self.fresh_since = self.word.and(self.fresh_since.or(Some(now)));
        let by_word = self.by_word && self.word.is_some()
            || self.fresh_since.is_some_and(|since| now.age_ns(since.ns()) >= TRUST_AFTER_NS);
        std::mem::replace(&mut self.by_word, by_word) != by_word
    }

    /// Whether the target's own word counts.
    pub(crate) fn is_by_word(&self) -> bool {
        self.by_word
    }

    /// Whether its motion is known just now.
    pub(crate) fn is_known(&self, now: Time) -> bool {
        self.by_word || self.tracker.is_known(now)
    }

    /// Whether neither source has shown it for too long.
    pub(crate) fn is_lost(&self, now: Time) -> bool {
        !self.by_word && self.tracker.is_lost(now)
    }

    /// Where it is, and how it moves.
    pub(crate) fn motion(&self, now: Time) -> Motion {
        let mut motion = match self.word.filter(|_| self.by_word) {
            Some(Word { motion: Motion { pose, rate }, at_ns }) => {
                let since_s = now.age_ns(at_ns) as f64 * 1e-9;
                Motion { pose: std::array::from_fn(|i| pose[i] + rate[i] * since_s), rate }
            }
            None => self.tracker.motion(now),
        };
        motion.pose[2] += TAU * ((self.heading - motion.pose[2]) / TAU).round();
        motion
    }

    /// The motion as it is told to the other services.
    pub(crate) fn tell(&mut self, now: Time) -> Motion {
        let motion = self.motion(now);
        self.heading = motion.pose[2];
        motion
    }
}
