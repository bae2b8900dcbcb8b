//! A lossy, slow, disorderly way for bytes between a device and the computer.

use crate::random::Random;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a network or a line does to what goes over it; the default does nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Network {
    /// Share of messages that vanish.
    pub loss: f64,
    /// Share of messages that arrive twice.
    pub duplicate: f64,
    /// Share of messages of which one bit is turned.
    pub corrupt: f64,
    /// Time on the way (s).
    pub delay_s: f64,
    /// Further time on the way, uniform between 0 and this (s); more than the period of the messages reorders them.
    pub jitter_s: f64,
}

impl Network {
    /// Which value makes no sense, if any.
    pub(crate) fn fault(&self) -> Option<&'static str> {
        let shares = [self.loss, self.duplicate, self.corrupt];
        if !shares.iter().all(|share| (0.0..=1.0).contains(share)) {
            return Some("loss, duplicate and corrupt are shares between 0 and 1");
        }
        let times = [self.delay_s, self.jitter_s];
        (!times.iter().all(|time| (0.0..=60.0).contains(time))).then_some("delay_s and jitter_s lie between 0 and 60 s")
    }
}

/// Messages on their way, with what the sender noted on each.
#[derive(Debug, Clone)]
pub(crate) struct Channel<T> {
    network: Network,
    random: Random,
    /// By time of arrival, and then by order of sending.
    waiting: BTreeMap<(u64, u64), (T, Vec<u8>)>,
    sent: u64,
}

impl<T: Copy> Channel<T> {
    pub(crate) fn new(network: Network, random: Random) -> Self {
        Self { network, random, waiting: BTreeMap::new(), sent: 0 }
    }

    /// Puts a message on its way at `now_ns`; it is `device_delay_ns` late before the network has touched it.
    pub(crate) fn send(&mut self, now_ns: u64, device_delay_ns: u64, note: T, bytes: &[u8]) {
        let copies = if self.random.chance(self.network.duplicate) { 2 } else { 1 };
        for _ in 0..copies {
            let lost = self.random.chance(self.network.loss);
            let delay_s = self.network.delay_s + self.network.jitter_s * self.random.uniform();
            let corrupt = self.random.chance(self.network.corrupt);
            let bit = self.random.below(8 * bytes.len());
            if lost {
                continue;
            }
            let mut bytes = bytes.to_vec();
            if let (true, Some(byte)) = (corrupt, bytes.get_mut(bit / 8)) {
                *byte ^= 1 << (bit % 8);
            }
            self.sent += 1;
            let due_ns = now_ns.saturating_add(device_delay_ns).saturating_add((delay_s * 1e9) as u64);
            self.waiting.insert((due_ns, self.sent), (note, bytes));
        }
    }

    /// The next message that has arrived by `now_ns`: its time of arrival, the sender's note and the bytes.
    pub(crate) fn arrived(&mut self, now_ns: u64) -> Option<(u64, T, Vec<u8>)> {
        let next = self.waiting.first_entry()?;
        let due_ns = next.key().0;
        if due_ns > now_ns {
            return None;
        }
        let (note, bytes) = next.remove();
        Some((due_ns, note, bytes))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;
    use crate::random::Stream;

    fn arrivals(network: Network) -> Vec<(u64, u8)> {
        let seed = 5;
        println!("seed {seed}");
        let mut channel = Channel::new(network, Random::new(seed, Stream::LinkUp, 0));
        for number in 0..200_u8 {
            channel.send(u64::from(number) * 1_000_000, 0, (), &[number]);
        }
        std::iter::from_fn(|| channel.arrived(u64::MAX).map(|(at_ns, (), bytes)| (at_ns, bytes[0]))).collect()
    }

    #[test]
    fn a_clean_line_carries_everything_at_once_and_in_order() {
        let expected: Vec<_> = (0..200_u8).map(|number| (u64::from(number) * 1_000_000, number)).collect();
        assert_eq!(arrivals(Network::default()), expected);
    }

    #[test]
    fn a_bad_line_loses_doubles_delays_and_reorders() {
        let lossy = arrivals(Network { loss: 0.3, ..Network::default() }).len();
        assert!((110..170).contains(&lossy), "{lossy} of 200 arrived");
        let doubled = arrivals(Network { duplicate: 0.3, ..Network::default() }).len();
        assert!((230..290).contains(&doubled), "{doubled} of 200 arrived");
        let late = arrivals(Network { delay_s: 0.25, ..Network::default() });
        assert_eq!(late[0], (250_000_000, 0));
        let reordered = arrivals(Network { jitter_s: 0.02, ..Network::default() });
        assert_eq!(reordered.len(), 200);
        assert!(reordered.windows(2).any(|pair| pair[0].1 > pair[1].1));
        let damaged = arrivals(Network { corrupt: 1.0, ..Network::default() });
        assert!(damaged.iter().enumerate().all(|(sent, (_, got))| (sent as u8 ^ got).is_power_of_two()));
    }
}
