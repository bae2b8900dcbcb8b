//! The devices around the vehicle: physics in, bytes of their protocols out.

pub(crate) mod camera;
pub(crate) mod gyro;
pub(crate) mod link;

/// A device's own clock: it starts anywhere and runs at its own rate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DeviceClock {
    /// Reading at the start of the run (ns).
    pub(crate) offset_ns: u64,
    /// Its rate less one.
    pub(crate) drift: f64,
}

impl DeviceClock {
    /// Reading when `elapsed_ns` have passed since the start of the run.
    pub(crate) fn read(self, elapsed_ns: u64) -> u64 {
        self.offset_ns + elapsed_ns + (elapsed_ns as f64 * self.drift) as u64
    }
}
