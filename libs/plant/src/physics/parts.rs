//! Base, links, joints and thrusters as they really are.

use crate::file::Plant;
use crate::friction::Friction;
use crate::parts::Link;

/// The base as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BasePhysics {
    /// A base that cannot move.
    pub clamped: bool,
    /// Mass with a full tank (kg).
    pub mass_kg: f64,
    /// Moment of inertia about the centre of mass (kg m^2).
    pub inertia_kg_m2: f64,
    /// Centre of mass in the base frame (m).
    pub com_m: [f64; 2],
    /// Joint 1 in the base frame (m).
    pub joint1_xy_m: [f64; 2],
    /// Direction of link 1 in the base frame at zero (rad).
    pub joint1_angle_rad: f64,
}

/// A link as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkPhysics {
    /// Joint to next joint (m).
    pub length_m: f64,
    /// Centre of mass before the next joint (m).
    pub com_to_next_joint_m: f64,
    /// Mass (kg).
    pub mass_kg: f64,
    /// About the centre of mass (kg m^2).
    pub inertia_kg_m2: f64,
    /// Geometric angle less joint angle (rad).
    pub joint_offset_rad: f64,
}

/// A joint with its drive and its sensors as they really are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointPhysics {
    /// Friction in the drive.
    pub friction: Friction,
    /// Stiffness between rotor and link; `None` is rigid (N m/rad).
    pub stiffness_n_m_rad: Option<f64>,
    /// Free play between rotor and link, whole width (rad).
    pub backlash_rad: f64,
    /// Link angle less motor angle is this times the sine of the turns (rad).
    pub kinematic_error_rad: f64,
    /// Periods of the kinematic error in one turn of the joint.
    pub kinematic_cycles: f64,
    /// Torque per current that the driver counts on (N m/A).
    pub torque_constant_n_m_a: f64,
    /// Real torque over nominal torque for the same current.
    pub torque_scale: f64,
    /// Largest nominal motor torque (N m).
    pub max_torque_n_m: f64,
    /// Stops at plus and minus this joint angle (rad).
    pub limit_rad: f64,
    /// Encoder reading over truth.
    pub encoder_scale: f64,
    /// Encoder reading at zero (rad).
    pub encoder_offset_rad: f64,
    /// Torque sensor reading over truth.
    pub torque_sensor_scale: f64,
    /// Torque sensor reading at zero (N m).
    pub torque_sensor_bias_n_m: f64,
}

/// A thruster as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThrusterPhysics {
    /// Command line, from 0, that this thruster follows.
    pub line: usize,
    /// Whether it follows levels between 0 and 1 with one lag up and down; else it is a valve.
    pub is_proportional: bool,
    /// Where the force acts, base frame (m).
    pub position_m: [f64; 2],
    /// Direction of the force in the base frame (rad).
    pub direction_rad: f64,
    /// Thrust at level u with all others shut and a full tank: `c1 u + c2 u^2 + c3 u^3` (N). Of a valve it is linear.
    pub curve_n: [f64; 3],
    /// Thrust while closed, at level 0 (N).
    pub leak_n: f64,
    /// Command to first movement (s).
    pub delay_s: f64,
    /// Time constant of opening (s); of a proportional thruster its lag.
    pub rise_s: f64,
    /// Time constant of closing (s); of a proportional thruster its lag.
    pub fall_s: f64,
    /// Shortest opening (s).
    pub min_on_s: f64,
    /// Share of the thrust that the plume gives back to a link that it hits.
    pub plume_fraction: f64,
}

/// What all thrusters share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupplyPhysics {
    /// Share of thrust lost for each further open valve.
    pub droop_per_extra_valve: f64,
    /// Relative change of thrust with time (1/s).
    pub trend_per_s: f64,
    /// When the trend begins (s).
    pub trend_since_s: f64,
}

/// A body held by the last link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grasped {
    /// Mass (kg).
    pub mass_kg: f64,
    /// About its own centre of mass (kg m^2).
    pub inertia_kg_m2: f64,
    /// Centre of mass in the link's frame: from its joint, x towards the tip (m).
    pub at_m: [f64; 2],
}

impl Grasped {
    /// Makes this body a part of `link`: common centre of mass, parallel-axis theorem.
    pub(super) fn join(&self, link: &mut fss_multibody::Link) {
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
    pub(super) fn of(link: &Link) -> Self {
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
    pub(super) fn of(link: &Link) -> Self {
        Self {
            friction: Friction {
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
    pub(super) fn of(plant: &Plant, line: usize) -> Self {
        let thruster = &plant.thrusters[line];
        let [x, y] = thruster.force_direction;
        let valves = plant.timing(line);
        Self {
            line,
            is_proportional: thruster.is_proportional(),
            position_m: thruster.position_m,
            direction_rad: y.atan2(x),
            curve_n: plant.thrust_curve_n(line),
            leak_n: 0.0,
            delay_s: valves.delay_s,
            rise_s: valves.rise_s,
            fall_s: valves.fall_s,
            min_on_s: valves.min_on_s,
            plume_fraction: 0.0,
        }
    }
}
