//! Random numbers: one seed for the laboratory, an independent stream for each device and channel, so that a fault added
//! to one of them leaves all others as they were.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Who draws; the number of a link is added where there are several.
#[derive(Debug, Clone, Copy)]
#[repr(u64)]
pub(crate) enum Stream {
    CameraChannel = 0x200,
    Gyro = 0x300,
    GyroChannel = 0x400,
    Link = 0x500,
    LinkUp = 0x600,
    LinkDown = 0x700,
}

/// A generator for one device.
#[derive(Debug, Clone)]
pub(crate) struct Random(ChaCha8Rng);

impl Random {
    pub(crate) fn new(seed: u64, stream: Stream, index: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream as u64 + index as u64);
        Self(rng)
    }

    /// Uniform between 0 and 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0.random()
    }

    /// True with this probability.
    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        // Always draw, so that a probability of zero costs the stream as much as any other.
        self.uniform() < probability
    }

    /// Below `bound`, 0 where that is 0.
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        (self.uniform() * bound as f64) as usize
    }
}
