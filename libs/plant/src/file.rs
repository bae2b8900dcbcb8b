//! The plant file's tables: one laboratory.

use serde::{Deserialize, Serialize};

use crate::effect::Effect;
use crate::parts::{Base, Battery, Disturbance, Link, Sensors, Servo, Table, Tank, Target, Uncertainty};
use crate::thruster::{Thruster, Valves};

/// One laboratory: base, links, thrusters, sensors, table, and the effects it is known to have.
///
/// Values are nominal; what really acts, effects included, is [`crate::Physics`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plant {
    /// `[table]`: the surface.
    #[serde(default)]
    pub table: Table,
    /// `[base]`: the floating base.
    pub base: Base,
    /// `[valves]`: timing that all valves share.
    #[serde(default)]
    pub valves: Valves,
    /// `[tank]`: the air that feeds the thrusters; without it the supply never ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tank: Option<Tank>,
    /// `[battery]`: the base's battery; without it the supply never ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub battery: Option<Battery>,
    /// `[servo]`: the servo drivers of all joints that have none of their own.
    #[serde(default)]
    pub servo: Servo,
    /// `[sensors]`: standard deviations and timing.
    #[serde(default)]
    pub sensors: Sensors,
    /// `[uncertainty]`: how well the values are known; without it they are exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<Uncertainty>,
    /// `[disturbance]`: what the room's air does to the base.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disturbance: Option<Disturbance>,
    /// `[target]`: a passive body on the same table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<Target>,
    /// `[[thruster]]`, in the order of the command lines.
    #[serde(rename = "thruster", default, skip_serializing_if = "Vec::is_empty")]
    pub thrusters: Vec<Thruster>,
    /// `[[link]]`, from the base outwards.
    #[serde(rename = "link", default, skip_serializing_if = "Vec::is_empty")]
    pub links: Vec<Link>,
    /// `[[effect]]`: what the plant has beyond the nominal model.
    #[serde(rename = "effect", skip_deserializing, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<Effect>,
}

impl Plant {
    /// Number of links, and of joints.
    pub fn link_count(&self) -> usize {
        self.links.len()
    }

    /// Servo driver of joint `joint` (from 0): the link's own, or the common one.
    pub fn servo(&self, joint: usize) -> &Servo {
        self.links.get(joint).and_then(|link| link.servo.as_ref()).unwrap_or(&self.servo)
    }

    /// Thrust of thruster `thruster`, from 0, at level 1 (N): that of its curve, its own, or the common one.
    pub fn thrust_n(&self, thruster: usize) -> f64 {
        self.thrust_curve_n(thruster).iter().sum()
    }

    /// Thrust of thruster `thruster`, from 0, over its level u: `c1 u + c2 u^2 + c3 u^3` (N); linear where it has no curve.
    pub fn thrust_curve_n(&self, thruster: usize) -> [f64; 3] {
        let own = self.thrusters.get(thruster);
        let linear = || [own.and_then(|t| t.thrust_n).or(self.base.thrust_n).unwrap_or(0.0), 0.0, 0.0];
        own.and_then(|t| t.thrust_curve).unwrap_or_else(linear)
    }

    /// Timing of thruster `thruster`, from 0: that of the valves, or of a proportional one its lag up and down.
    pub(crate) fn timing(&self, thruster: usize) -> Valves {
        match self.thrusters.get(thruster).filter(|t| t.is_proportional()) {
            Some(own) => {
                let lag_s = own.lag_s.unwrap_or(0.0);
                Valves { rise_s: lag_s, fall_s: lag_s, min_on_s: 0.0, ..self.valves.clone() }
            }
            None => self.valves.clone(),
        }
    }

    /// Makes `thrust_n` the thrust at level 1 of thruster `thruster`, from 0. A curve keeps its shape; one that gives nothing
    /// at level 1 stays as it is.
    pub fn set_thrust_n(&mut self, thruster: usize, thrust_n: f64) {
        let before_n = self.thrust_n(thruster);
        let Some(own) = self.thrusters.get_mut(thruster) else { return };
        match &mut own.thrust_curve {
            None => own.thrust_n = Some(thrust_n),
            Some(curve) if before_n != 0.0 => *curve = curve.map(|c| c * thrust_n / before_n),
            Some(_) => {}
        }
    }

    /// Force and torque of a thruster at level 1, an open valve, on the base, in the base frame about its origin.
    ///
    /// Returns `[fx_N, fy_N, torque_N_m]`.
    pub fn thruster_wrench(&self, thruster: usize) -> [f64; 3] {
        let Some(t) = self.thrusters.get(thruster) else {
            return [0.0; 3];
        };
        let d = t.unit_direction();
        let f = self.thrust_n(thruster);
        let torque = t.position_m[0] * d[1] - t.position_m[1] * d[0];
        [f * d[0], f * d[1], f * torque]
    }

    /// The same plant without its effects: what the laboratory believes.
    pub fn nominal(&self) -> Self {
        Self { effects: Vec::new(), ..self.clone() }
    }

    /// The same plant with `effects` added to those it has.
    pub fn with_effects(&self, effects: &[Effect]) -> Self {
        let mut plant = self.clone();
        plant.effects.extend_from_slice(effects);
        plant
    }
}
