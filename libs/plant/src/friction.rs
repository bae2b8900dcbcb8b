//! Friction inside a joint: dry, viscous and Stribeck.

/// Friction in a drive.
///
/// While it slides at rate v the torque is
/// `(coulomb + stribeck exp(-(v / v_s)^2)) sign(v) + viscous v` (Armstrong-Helouvry, Dupont and
/// Canudas de Wit, 1994); at rest it takes whatever is needed up to `coulomb + stribeck`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    /// Dry friction (N m).
    pub coulomb_n_m: f64,
    /// Viscous friction (N m s/rad).
    pub viscous_n_m_s_rad: f64,
    /// Static friction above dry friction (N m).
    pub stribeck_n_m: f64,
    /// Rate at which the static part has faded (rad/s).
    pub stribeck_rad_s: f64,
}

impl Friction {
    /// Torque that sets a resting joint going (N m).
    #[inline]
    pub fn breakaway_n_m(&self) -> f64 {
        self.coulomb_n_m + self.stribeck_n_m
    }

    /// Whether a joint can stick at all.
    #[inline]
    pub fn is_dry(&self) -> bool {
        self.breakaway_n_m() > 0.0
    }

    /// Torque that opposes sliding in `direction` (-1, 0 or 1) at `rate_rad_s` (N m).
    ///
    /// The direction is given apart from the rate so that the law stays smooth while a step
    /// carries the rate a little past zero.
    #[inline]
    pub fn sliding_n_m(&self, direction: f64, rate_rad_s: f64) -> f64 {
        let mut dry = self.coulomb_n_m;
        if self.stribeck_n_m > 0.0 {
            let ratio = rate_rad_s / self.stribeck_rad_s;
            dry += self.stribeck_n_m * (-ratio * ratio).exp();
        }
        dry * direction + self.viscous_n_m_s_rad * rate_rad_s
    }
}
