//! The reference of the base: a smooth way from a pose to a goal.

/// Position, velocity and acceleration of one coordinate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reference {
    /// Position, m or rad.
    pub position: f64,
    /// Velocity, m/s or rad/s.
    pub velocity: f64,
    /// Acceleration, m/s2 or rad/s2.
    pub acceleration: f64,
}

/// The fifth-order polynomial from rest at `from` to rest at `to` within `duration_s`, at `t_s` after its start.
pub fn quintic(from: f64, to: f64, duration_s: f64, t_s: f64) -> Reference {
    if duration_s <= 0.0 || t_s >= duration_s {
        return Reference { position: to, ..Reference::default() };
    }
    let s = (t_s / duration_s).max(0.0);
    let way = to - from;
    Reference {
        position: from + way * s * s * s * (10.0 + s * (6.0 * s - 15.0)),
        velocity: way / duration_s * 30.0 * s * s * (1.0 - s) * (1.0 - s),
        acceleration: way / (duration_s * duration_s) * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    }
}
