//! What really acts: the plant's values with its effects built in, flat and ready to integrate.
//!
//! Built once per set of effects, so that the inner loop meets numbers and, for forces, a short
//! list of plain functions; it never looks at an effect.

use fss_multibody::{MAX_LINKS, Model, ModelError};

use crate::effect::{Effect, MAX_PARAMETERS};
use crate::file::Plant;
use crate::parts::{Sensors, Servo};

/// The base as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BasePhysics {
    /// A base that cannot move.
    pub clamped: bool,
    /// Mass with a full tank [kg].
    pub mass_kg: f64,
    /// Moment of inertia about the centre of mass [kg m^2].
    pub inertia_kg_m2: f64,
    /// Centre of mass in the base frame [m].
    pub com_m: [f64; 2],
    /// Joint 1 in the base frame [m].
    pub joint1_xy_m: [f64; 2],
    /// Direction of link 1 in the base frame at zero [rad].
    pub joint1_angle_rad: f64,
}

/// A link as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkPhysics {
    /// Joint to next joint [m].
    pub length_m: f64,
    /// Centre of mass before the next joint [m].
    pub com_to_next_joint_m: f64,
    /// Mass [kg].
    pub mass_kg: f64,
    /// About the centre of mass [kg m^2].
    pub inertia_kg_m2: f64,
    /// Geometric angle less joint angle [rad].
    pub joint_offset_rad: f64,
}

/// A joint with its drive and its sensors as they really are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointPhysics {
    /// Friction in the drive.
    pub friction: crate::friction::Friction,
    /// Stiffness between rotor and link; `None` is rigid [N m/rad].
    pub stiffness_n_m_rad: Option<f64>,
    /// Free play between rotor and link, whole width [rad].
    pub backlash_rad: f64,
    /// Link angle less motor angle is this times the sine of the turns [rad].
    pub kinematic_error_rad: f64,
    /// Periods of the kinematic error in one turn of the joint.
    pub kinematic_cycles: f64,
    /// Torque per current that the driver counts on [N m/A].
    pub torque_constant_n_m_a: f64,
    /// Real torque over nominal torque for the same current.
    pub torque_scale: f64,
    /// Largest nominal motor torque [N m].
    pub max_torque_n_m: f64,
    /// Stops at plus and minus this joint angle [rad].
    pub limit_rad: f64,
    /// Encoder reading over truth.
    pub encoder_scale: f64,
    /// Encoder reading at zero [rad].
    pub encoder_offset_rad: f64,
    /// Torque sensor reading over truth.
    pub torque_sensor_scale: f64,
    /// Torque sensor reading at zero [N m].
    pub torque_sensor_bias_n_m: f64,
}

/// A thruster as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThrusterPhysics {
    /// Command line, from 0, that opens this valve.
    pub line: usize,
    /// Where the force acts, base frame [m].
    pub position_m: [f64; 2],
    /// Direction of the force in the base frame [rad].
    pub direction_rad: f64,
    /// Thrust with one valve open and a full tank [N].
    pub thrust_n: f64,
    /// Thrust while closed [N].
    pub leak_n: f64,
    /// Command to first movement [s].
    pub delay_s: f64,
    /// Time constant of opening [s].
    pub rise_s: f64,
    /// Time constant of closing [s].
    pub fall_s: f64,
    /// Shortest opening [s].
    pub min_on_s: f64,
    /// Share of the thrust that the plume gives back to a link that it hits.
    pub plume_fraction: f64,
}

/// What all thrusters share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupplyPhysics {
    /// Share of thrust lost for each further open valve.
    pub droop_per_extra_valve: f64,
    /// Relative change of thrust with time [1/s].
    pub trend_per_s: f64,
    /// When the trend begins [s].
    pub trend_since_s: f64,
}

/// Data streams that have a clock, in the order of [`SensorPhysics::clock_offset_s`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Motion capture of the base.
    BasePose,
    /// Motion capture of the end-effector.
    EePose,
    /// Motion capture of the target.
    TargetPose,
    /// The gyro.
    Gyro,
    /// Link telemetry.
    Joints,
    /// Joint commands.
    JointCommand,
    /// Valve commands.
    Valves,
}

/// The sensors as they really are; white noise is the nominal [`Sensors`].
#[derive(Debug, Clone, PartialEq)]
pub struct SensorPhysics {
    /// Noise and rates.
    pub nominal: Sensors,
    /// Motion capture: event to arrival [s].
    pub mocap_delay_s: f64,
    /// Motion capture: turn of the camera frame about the table's origin [rad].
    pub mocap_rotation_rad: f64,
    /// The tracked point in the base frame [m].
    pub marker_offset_m: [f64; 2],
    /// Tracked heading less heading of the base [rad].
    pub marker_yaw_rad: f64,
    /// Gyro reading at rest, to which the random walk adds [rad/s].
    pub gyro_bias_rad_s: f64,
    /// Gyro reading over truth.
    pub gyro_scale: f64,
    /// Link telemetry: event to stamp, by link [s].
    pub link_delay_s: Vec<f64>,
    /// Stamp less true time, by [`Stream`] [s].
    pub clock_offset_s: [f64; 7],
}

impl SensorPhysics {
    /// How much older a sample is than its stamp says, once the nominal latency is taken off [s].
    pub fn age_s(&self, stream: Stream) -> f64 {
        let latency = match stream {
            Stream::BasePose | Stream::EePose | Stream::TargetPose => self.mocap_delay_s - self.nominal.mocap_latency_s,
            _ => 0.0,
        };
        latency + self.clock_offset_s[stream as usize]
    }

    /// [`SensorPhysics::age_s`] of link `link`'s telemetry [s].
    pub fn link_age_s(&self, link: usize) -> f64 {
        let delay = self.link_delay_s.get(link).copied();
        delay.unwrap_or(0.0) - self.nominal.link_latency_s + self.clock_offset_s[Stream::Joints as usize]
    }
}

/// What a force on the base may depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseMotion {
    /// Time since the start of the run [s].
    pub t_s: f64,
    /// Base frame in the table frame [m, m, rad].
    pub pose: [f64; 3],
    /// Its velocity, table axes [m/s, m/s, rad/s].
    pub velocity: [f64; 3],
}

/// A force on the base: table axes, about the base frame's origin [N, N, N m].
#[derive(Debug, Clone, Copy)]
pub struct BaseLaw {
    /// The law, from the effect's file.
    pub law: fn(&[f64; MAX_PARAMETERS], &BaseMotion) -> [f64; 3],
    /// The effect's parameters.
    pub values: [f64; MAX_PARAMETERS],
}

/// A smooth torque on a link at its joint, beside the drive [N m].
#[derive(Debug, Clone, Copy)]
pub struct JointLaw {
    /// Which joint, from 0.
    pub joint: usize,
    /// The law of time, joint angle and rate, from the effect's file.
    pub law: fn(&[f64; MAX_PARAMETERS], f64, f64, f64) -> f64,
    /// The effect's parameters.
    pub values: [f64; MAX_PARAMETERS],
}

/// A body held by the last link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grasped {
    /// Mass [kg].
    pub mass_kg: f64,
    /// About its own centre of mass [kg m^2].
    pub inertia_kg_m2: f64,
    /// Centre of mass in the link's frame: from its joint, x towards the tip [m].
    pub at_m: [f64; 2],
}

/// The plant's values with its effects built in.
#[derive(Debug, Clone)]
pub struct Physics {
    /// The base.
    pub base: BasePhysics,
    /// Links, from the base outwards.
    pub links: Vec<LinkPhysics>,
    /// Joints and drives.
    pub joints: Vec<JointPhysics>,
    /// Servo drivers.
    pub servos: Vec<Servo>,
    /// A point mass at the end-effector [kg].
    pub payload_kg: f64,
    /// A body held by the last link.
    pub grasped: Option<Grasped>,
    /// Steady acceleration of every body, table frame [m/s^2].
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
    /// The plant with all of its effects that act at `t_s`.
    pub fn at(plant: &Plant, t_s: f64) -> Self {
        Self::with(plant, plant.effects.iter().filter(|e| e.is_active(t_s)))
    }

    /// The plant without any effect.
    pub fn nominal(plant: &Plant) -> Self {
        Self::with(plant, [])
    }

    /// The plant's nominal values with exactly these effects.
    pub fn with<'a>(plant: &Plant, effects: impl IntoIterator<Item = &'a Effect>) -> Self {
        let mut physics = Self::of_values(plant);
        for effect in effects {
            effect.kind().act(effect, &mut physics);
        }
        physics
    }

    /// The plant's nominal values with `effects`, between the onsets of these: each with the time from which it holds.
    pub fn stages(plant: &Plant, effects: &[Effect]) -> Vec<(f64, Self)> {
        let mut starts: Vec<f64> = effects.iter().filter_map(Effect::onset_s).collect();
        starts.push(0.0);
        starts.sort_by(f64::total_cmp);
        starts.dedup();
        let active = |t: f64| Self::with(plant, effects.iter().filter(move |e| e.is_active(t)));
        starts.into_iter().map(|t| (t, active(t))).collect()
    }

    fn of_values(plant: &Plant) -> Self {
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
    /// origin [N, N, N m].
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

impl Grasped {
    /// Makes this body a part of `link`: common centre of mass, parallel-axis theorem.
    fn join(&self, link: &mut fss_multibody::Link) {
        let total = link.mass_kg + self.mass_kg;
        if self.mass_kg <= 0.0 {
            return;
        }
        let own = [link.length_m - link.com_to_next_joint_m, link.com_offset_m];
        let apart = [self.at_m[0] - own[0], self.at_m[1] - own[1]];
        let share = self.mass_kg / total;
        link.inertia_kg_m2 += self.inertia_kg_m2 + link.mass_kg * share * (apart[0] * apart[0] + apart[1] * apart[1]);
        link.com_to_next_joint_m -= share * apart[0];
        link.com_offset_m += share * apart[1];
        link.mass_kg = total;
    }
}

impl LinkPhysics {
    fn of(link: &crate::parts::Link) -> Self {
        Self {
            length_m: link.length_m,
            com_to_next_joint_m: link.com_to_next_joint_m,
            mass_kg: link.mass_kg,
            inertia_kg_m2: link.inertia_kg_m2,
            joint_offset_rad: link.joint_offset_rad,
        }
    }
}

impl JointPhysics {
    fn of(link: &crate::parts::Link) -> Self {
        Self {
            friction: crate::friction::Friction {
                coulomb_n_m: link.coulomb_friction_n_m,
                viscous_n_m_s_rad: link.viscous_friction_n_m_s_rad,
                stribeck_n_m: 0.0,
                stribeck_rad_s: 0.05,
            },
            stiffness_n_m_rad: None,
            backlash_rad: 0.0,
            kinematic_error_rad: 0.0,
            kinematic_cycles: 1.0,
            torque_constant_n_m_a: link.torque_constant_n_m_a,
            torque_scale: 1.0,
            max_torque_n_m: link.max_torque_n_m,
            limit_rad: link.joint_limit_rad,
            encoder_scale: 1.0,
            encoder_offset_rad: 0.0,
            torque_sensor_scale: 1.0,
            torque_sensor_bias_n_m: 0.0,
        }
    }
}

impl ThrusterPhysics {
    fn of(plant: &Plant, line: usize) -> Self {
        let thruster = &plant.thrusters[line];
        let [x, y] = thruster.force_direction;
        Self {
            line,
            position_m: thruster.position_m,
            direction_rad: y.atan2(x),
            thrust_n: plant.thrust_n(line),
            leak_n: 0.0,
            delay_s: plant.valves.delay_s,
            rise_s: plant.valves.rise_s,
            fall_s: plant.valves.fall_s,
            min_on_s: plant.valves.min_on_s,
            plume_fraction: 0.0,
        }
    }
}
