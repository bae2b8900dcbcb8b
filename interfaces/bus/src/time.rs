//! Time on the monotonic clock that all processes of a host share.

/// A time on the monotonic clock; on the virtual clock of a fast run, counted from its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Time(u64);

impl Time {
    /// From nanoseconds.
    pub const fn from_ns(ns: u64) -> Self {
        Self(ns)
    }

    /// In nanoseconds.
    pub const fn ns(self) -> u64 {
        self.0
    }

    /// Nanoseconds since `stamp_ns`; zero where that is later.
    pub const fn age_ns(self, stamp_ns: u64) -> u64 {
        self.0.saturating_sub(stamp_ns)
    }

    /// Seconds since `earlier`, negative where that is later.
    pub fn seconds_since(self, earlier: Self) -> f64 {
        if self.0 >= earlier.0 { (self.0 - earlier.0) as f64 * 1e-9 } else { (earlier.0 - self.0) as f64 * -1e-9 }
    }

    /// This many nanoseconds later.
    pub const fn plus_ns(self, ns: u64) -> Self {
        Self(self.0.saturating_add(ns))
    }
}
