//! What keeps a stranger's or a recorded command from moving the arm: a keyed tag and increasing numbers.

use super::LinkError;
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;

/// Fewest bytes of a shared key.
pub const MIN_KEY_LEN: usize = 16;

/// Bytes of a command's tag.
pub(super) const TAG_LEN: usize = 16;

/// The secret shared by the vehicle's computer and its links.
#[derive(Clone)]
pub struct Key(Hmac<Sha256>);

impl Key {
    /// A key of at least [`MIN_KEY_LEN`] bytes; 32 random ones are best.
    pub fn new(secret: &[u8]) -> Result<Self, LinkError> {
        let too_short = LinkError::ShortKey { len: secret.len() };
        if secret.len() < MIN_KEY_LEN {
            return Err(too_short);
        }
        Hmac::new_from_slice(secret).map(Self).map_err(|_| too_short)
    }

    fn over(&self, bytes: &[u8]) -> Hmac<Sha256> {
        self.0.clone().chain_update(bytes)
    }

    pub(super) fn tag(&self, bytes: &[u8]) -> [u8; TAG_LEN] {
        let digest = self.over(bytes).finalize().into_bytes();
        let mut tag = [0; TAG_LEN];
        tag.iter_mut().zip(digest).for_each(|(to, from)| *to = from);
        tag
    }

    /// Compares in constant time.
    pub(super) fn verifies(&self, bytes: &[u8], tag: &[u8; TAG_LEN]) -> bool {
        self.over(bytes).verify_truncated_left(tag).is_ok()
    }
}

impl core::fmt::Debug for Key {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Key(secret)")
    }
}

/// Lets a sequence number pass only if it is above every one before: no duplicates, nothing overtaken, no replays.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReplayGuard {
    last: Option<u64>,
}

impl ReplayGuard {
    /// A guard that refuses everything up to `last`, for a receiver that remembers it over a restart.
    pub fn after(last: u64) -> Self {
        Self { last: Some(last) }
    }

    /// Admits `sequence` and returns how many numbers it skipped, or refuses it.
    pub fn admit(&mut self, sequence: u64) -> Result<u64, LinkError> {
        let skipped = match self.last {
            Some(last) if sequence <= last => return Err(LinkError::Replayed { sequence, last }),
            Some(last) => sequence - last - 1,
            None => 0,
        };
        self.last = Some(sequence);
        Ok(skipped)
    }

    /// The last number admitted.
    pub fn last(&self) -> Option<u64> {
        self.last
    }
}

/// First sequence number for a sender that starts at this calendar time (ns since 1970): above all numbers of a sender
/// that started earlier and sent fewer than a thousand commands a second.
pub const fn first_sequence(unix_time_ns: u64) -> u64 {
    unix_time_ns / 1_000_000
}
