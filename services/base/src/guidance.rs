//! The reference of the base: a smooth way from a pose to a goal.

use fss_bus::Time;

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

/// From where to where the base goes: x m, y m, theta rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// When it begins.
    pub start: Time,
    /// Where it begins.
    pub from: [f64; 3],
    /// Where it ends.
    pub to: [f64; 3],
    /// How long it takes, s.
    pub duration_s: f64,
    /// How fast `to` itself moves from the start on, and for ever: m/s, m/s, rad/s.
    pub drift: [f64; 3],
}

/// Shares of a leg's duration at which it is hardest: the acceleration, the speed and the deceleration of the quintic are
/// largest there.
const HARDEST: [f64; 3] = [0.211_325, 0.5, 0.788_675];
/// A leg that is too fast is tried again with so much more time.
const STRETCH: f64 = 1.1;
/// No leg is stretched beyond this, s.
const LONGEST_S: f64 = 600.0;

impl Leg {
    /// The reference at a time.
    pub fn at(&self, now: Time) -> [Reference; 3] {
        self.after(now.seconds_since(self.start))
    }

    /// The reference at `t_s` after the start.
    fn after(&self, t_s: f64) -> [Reference; 3] {
        std::array::from_fn(|i| {
            let mut reference = quintic(self.from[i], self.to[i], self.duration_s, t_s);
            // What drifts is joined as smoothly: its rate grows with the same polynomial.
            let share = quintic(0.0, 1.0, self.duration_s, t_s);
            let way = self.drift[i] * t_s.max(0.0);
            reference.position += way * share.position;
            reference.velocity += self.drift[i] * share.position + way * share.velocity;
            reference.acceleration += 2.0 * self.drift[i] * share.velocity + way * share.acceleration;
            reference
        })
    }

    /// The same leg with as much time as the vehicle needs: `is_able` says whether it can follow a reference.
    pub fn stretched(mut self, mut is_able: impl FnMut(&[Reference; 3]) -> bool) -> Self {
        let is_there = self.from == self.to && self.drift == [0.0; 3];
        self.duration_s = if is_there { self.duration_s } else { self.duration_s.max(1.0) };
        while !is_there
            && self.duration_s < LONGEST_S
            && !HARDEST.iter().all(|share| is_able(&self.after(share * self.duration_s)))
        {
            self.duration_s *= STRETCH;
        }
        self
    }
}
