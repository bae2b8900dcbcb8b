//! `[[thruster]]` and `[valves]` of the plant file.

use serde::{Deserialize, Serialize};

/// `[[thruster]]`: a valve and its nozzle, or a proportional thruster such as a propeller, fixed to the base.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thruster {
    /// Where the force acts, base frame (m).
    pub position_m: [f64; 2],
    /// Direction of the force on the base, base frame; any length but zero.
    pub force_direction: [f64; 2],
    /// Thrust, where it differs from the base's `thrust_N` (N); not beside a [`Thruster::thrust_curve`].
    #[serde(rename = "thrust_N", default, skip_serializing_if = "Option::is_none")]
    pub thrust_n: Option<f64>,
    /// Thrust of a proportional thruster at level u, 0 to 1: `c1 u + c2 u^2 + c3 u^3` (N).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thrust_curve: Option<[f64; 3]>,
    /// Of a proportional thruster: the level follows its command with a first-order lag of this time constant, before
    /// the curve (s). It stands in place of the rise and fall times and of the minimum on time of `[valves]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lag_s: Option<f64>,
}

impl Thruster {
    /// [`Thruster::force_direction`] scaled to length one.
    pub fn unit_direction(&self) -> [f64; 2] {
        let [x, y] = self.force_direction;
        let length = x.hypot(y);
        [x / length, y / length]
    }

    /// Whether it has a curve or a lag of its own: then it is no valve and follows levels between 0 and 1.
    pub fn is_proportional(&self) -> bool {
        self.thrust_curve.is_some() || self.lag_s.is_some()
    }
}

/// `[valves]`: timing that all valves share. The default is an ideal valve.
///
/// Delay and droop are those of proportional thrusters too.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Valves {
    /// From command to the first movement of thrust (s).
    pub delay_s: f64,
    /// Time constant of the rise of thrust (s).
    pub rise_s: f64,
    /// Time constant of the fall of thrust (s).
    pub fall_s: f64,
    /// A valve that has opened stays open this long (s).
    pub min_on_s: f64,
    /// Share of thrust lost by every open valve for each further valve that is open.
    pub droop_fraction_per_extra_valve: f64,
}

impl Default for Valves {
    fn default() -> Self {
        Self { delay_s: 0.0, rise_s: 0.0, fall_s: 0.0, min_on_s: 0.0, droop_fraction_per_extra_valve: 0.0 }
    }
}
