//! The 24-bit converter behind a link's torque sensor.

/// One reading of the torque sensor's 24-bit converter. Its two end values mean that the sensor or the amplifier is
/// saturated: a fault, not a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TorqueCount(i32);

impl TorqueCount {
    /// Largest count, which means saturated.
    pub const MAX: i32 = (1 << 23) - 1;
    /// Smallest count, which means saturated.
    pub const MIN: i32 = -(1 << 23);

    /// A count, held within the converter's range.
    pub fn new(count: i32) -> Self {
        Self(count.clamp(Self::MIN, Self::MAX))
    }

    /// The converter's answer to a torque; `full_scale_nm` (N m) is the torque of the largest count.
    pub fn from_torque(torque_nm: f64, full_scale_nm: f64) -> Self {
        Self::new((torque_nm / full_scale_nm * f64::from(Self::MAX)).round() as i32)
    }

    /// The torque (N m), or `None` when saturated.
    pub fn torque_nm(self, full_scale_nm: f64) -> Option<f64> {
        (!self.is_saturated()).then(|| f64::from(self.0) / f64::from(Self::MAX) * full_scale_nm)
    }

    /// The raw count.
    pub const fn count(self) -> i32 {
        self.0
    }

    /// Whether the converter is at one of its ends.
    pub const fn is_saturated(self) -> bool {
        self.0 <= Self::MIN || self.0 >= Self::MAX
    }

    pub(super) fn to_bytes(self) -> [u8; 3] {
        let [b0, b1, b2, _] = self.0.to_le_bytes();
        [b0, b1, b2]
    }

    pub(super) fn from_bytes([b0, b1, b2]: [u8; 3]) -> Self {
        // Put the 24 bits on top, so that the shift down extends the sign.
        Self(i32::from_le_bytes([0, b0, b1, b2]) >> 8)
    }
}
