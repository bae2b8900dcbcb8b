//! What really acts: the plant's values with its effects built in, flat and ready to integrate.
//!
//! Built once per set of effects, so that the inner loop meets numbers and, for forces, a short
//! list of plain functions; it never looks at an effect.

mod laws;
mod parts;
mod sensors;

pub use laws::{BaseLaw, BaseMotion, JointLaw};
pub use parts::{BasePhysics, Grasped, JointPhysics, LinkPhysics, SupplyPhysics, ThrusterPhysics};
pub use sensors::{SensorPhysics, Stream};

use fss_multibody::{MAX_LINKS, Model, ModelError};

use crate::file::Plant;
use crate::parts::Servo;

/// The plant's values with its effects built in.
#[derive(Debug, Clone, PartialEq)]
pub struct Physics {
    /// The base.
    pub base: BasePhysics,
    /// Links, from the base outwards.
    pub links: Vec<LinkPhysics>,
    /// Joints and drives.
    pub joints: Vec<JointPhysics>,
    /// Servo drivers.
    pub servos: Vec<Servo>,
    /// A point mass at the end-effector (kg).
    pub payload_kg: f64,
    /// A body held by the last link.
    pub grasped: Option<Grasped>,
    /// Steady acceleration of every body, table frame (m/s^2).
    pub gravity_m_s2: [f64; 2],
    /// Forces on the base.
    pub base_laws: Vec<BaseLaw>,
    /// Torques at the joints beside the drives.
    pub joint_laws: Vec<JointLaw>,
    /// Thrusters.
    pub thrusters: Vec<ThrusterPhysics>,
    /// What the thrusters share.
    pub supply: SupplyPhysics,
    /// Sensors.
    pub sensors: SensorPhysics,
}

impl Physics {
    /// The plant's nominal values, without any effect.
    pub(crate) fn of_values(plant: &Plant) -> Self {
        let base = &plant.base;
        let joint_count = plant.links.len();
        Self {
            base: BasePhysics {
                clamped: base.clamped,
                mass_kg: base.mass_kg,
                inertia_kg_m2: base.inertia_kg_m2,
                com_m: [0.0; 2],
                joint1_xy_m: base.joint1_xy_m,
                joint1_angle_rad: base.joint1_angle_rad,
            },
            links: plant.links.iter().map(LinkPhysics::of).collect(),
            joints: plant.links.iter().map(JointPhysics::of).collect(),
            servos: (0..joint_count).map(|i| plant.servo(i).clone()).collect(),
            payload_kg: 0.0,
            grasped: None,
            gravity_m_s2: plant.table.gravity_m_s2,
            base_laws: Vec::new(),
            joint_laws: Vec::new(),
            thrusters: (0..plant.thrusters.len()).map(|i| ThrusterPhysics::of(plant, i)).collect(),
            supply: SupplyPhysics {
                droop_per_extra_valve: plant.valves.droop_fraction_per_extra_valve,
                trend_per_s: 0.0,
                trend_since_s: 0.0,
            },
            sensors: SensorPhysics {
                nominal: plant.sensors.clone(),
                mocap_delay_s: plant.sensors.mocap_latency_s,
                mocap_rotation_rad: 0.0,
                marker_offset_m: [0.0; 2],
                marker_yaw_rad: 0.0,
                gyro_bias_rad_s: plant.sensors.gyro_bias_rad_s,
                gyro_scale: plant.sensors.gyro_scale,
                link_delay_s: vec![plant.sensors.link_latency_s; joint_count],
                clock_offset_s: [0.0; 7],
            },
        }
    }

    /// The mechanism, its base lighter by `used_gas_kg` and its last link heavier by what it carries.
    ///
    /// # Errors
    /// When effects made a mass or an inertia impossible.
    pub fn model(&self, used_gas_kg: f64) -> Result<Model, ModelError> {
        let base = fss_multibody::Base {
            mass_kg: self.base.mass_kg - used_gas_kg,
            inertia_kg_m2: self.base.inertia_kg_m2,
            com_m: self.base.com_m,
            joint1_xy_m: self.base.joint1_xy_m,
            joint1_angle_rad: self.base.joint1_angle_rad,
            clamped: self.base.clamped,
        };
        let mut links = [fss_multibody::Link::default(); MAX_LINKS];
        let count = self.links.len().min(MAX_LINKS);
        for (out, link) in links.iter_mut().zip(&self.links) {
            *out = fss_multibody::Link {
                length_m: link.length_m,
                com_to_next_joint_m: link.com_to_next_joint_m,
                com_offset_m: 0.0,
                mass_kg: link.mass_kg,
                inertia_kg_m2: link.inertia_kg_m2,
                joint_offset_rad: link.joint_offset_rad,
                rotor_inertia_kg_m2: 0.0,
            };
        }
        if let Some(last) = links[..count].last_mut() {
            let tip = Grasped { mass_kg: self.payload_kg, inertia_kg_m2: 0.0, at_m: [last.length_m, 0.0] };
            tip.join(last);
            if let Some(grasped) = &self.grasped {
                grasped.join(last);
            }
        }
        Model::new(base, &links[..count], self.gravity_m_s2)
    }

    /// Sum of the forces that the effects put on the base, table axes, about the base frame's
    /// origin (N, N, N m).
    #[inline]
    pub fn base_wrench(&self, motion: &BaseMotion) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for law in &self.base_laws {
            let wrench = (law.law)(&law.values, motion);
            for (s, w) in sum.iter_mut().zip(wrench) {
                *s += w;
            }
        }
        sum
    }
}
