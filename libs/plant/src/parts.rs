//! The tables of the plant file, field by field.
//!
//! SI units throughout; a field's unit is in its name in the file. Poses and angles are
//! counter-clockwise positive; the base frame has its origin at the base's nominal centre of mass.

use serde::{Deserialize, Serialize};

/// `[table]`: the surface that everything floats on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Table {
    /// Known steady in-plane acceleration of every body, table frame (m/s^2).
    pub gravity_m_s2: [f64; 2],
    /// Side lengths (m); the table frame's origin is the middle.
    pub size_m: [f64; 2],
}

impl Default for Table {
    fn default() -> Self {
        Self { gravity_m_s2: [0.0; 2], size_m: [4.0; 2] }
    }
}

/// `[base]`: the vehicle that carries the arm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Base {
    /// A base that cannot move: base frame = table frame, mass and inertia play no part.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub clamped: bool,
    /// Mass with the tank as full as `[tank]` says (kg).
    #[serde(default)]
    pub mass_kg: f64,
    /// Moment of inertia about the base's centre of mass (kg m^2).
    #[serde(default)]
    pub inertia_kg_m2: f64,
    /// Position of joint 1 in the base frame (m).
    #[serde(default)]
    pub joint1_xy_m: [f64; 2],
    /// Direction of link 1 in the base frame at zero joint angle and offset (rad).
    #[serde(default)]
    pub joint1_angle_rad: f64,
    /// Thrust of every thruster that gives none of its own (N).
    #[serde(rename = "thrust_N", default, skip_serializing_if = "Option::is_none")]
    pub thrust_n: Option<f64>,
    /// Side lengths of the base's body (m); for pictures only.
    #[serde(default = "base_size")]
    pub size_m: [f64; 2],
}

fn base_size() -> [f64; 2] {
    [0.27, 0.27]
}

/// `[tank]`: compressed air, isothermal, behind a pressure regulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tank {
    /// Absolute pressure of the full tank (Pa).
    #[serde(rename = "pressure_Pa")]
    pub pressure_pa: f64,
    /// Volume (m^3).
    pub volume_m3: f64,
    /// Gas temperature (K).
    #[serde(rename = "temperature_K", default = "room_temperature")]
    pub temperature_k: f64,
    /// Specific gas constant (J/(kg K)); 287.05 is air.
    #[serde(rename = "gas_constant_J_kg_K", default = "gas_constant_of_air")]
    pub gas_constant_j_kg_k: f64,
    /// Tank pressure below which the regulator cannot hold the nozzle pressure (Pa).
    #[serde(rename = "regulator_Pa")]
    pub regulator_pa: f64,
    /// Thrust over weight flow of the nozzles (s).
    pub specific_impulse_s: f64,
}

impl Tank {
    /// Gas in the full tank (kg), from the ideal gas law.
    pub fn gas_kg(&self) -> f64 {
        self.pressure_pa * self.volume_m3 / (self.gas_constant_j_kg_k * self.temperature_k)
    }
}

fn room_temperature() -> f64 {
    293.15
}

fn gas_constant_of_air() -> f64 {
    287.05
}

/// A battery: open-circuit voltage linear in charge, internal resistance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Battery {
    /// Open-circuit voltage at half charge (V); 1.15 times this when full, 0.85 when empty.
    #[serde(rename = "nominal_V")]
    pub nominal_v: f64,
    /// Energy of a full battery (W h).
    #[serde(rename = "capacity_Wh")]
    pub capacity_wh: f64,
    /// Internal resistance (Ohm).
    #[serde(rename = "resistance_Ohm", default)]
    pub resistance_ohm: f64,
    /// What the electronics draw all the time (W).
    #[serde(rename = "idle_W", default)]
    pub idle_w: f64,
}

/// `[[link]]`: one link and the joint at its near end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// From this joint to the next, or to the end-effector (m).
    pub length_m: f64,
    /// The centre of mass lies this far before the next joint, on the line to it (m).
    pub com_to_next_joint_m: f64,
    /// Mass (kg).
    pub mass_kg: f64,
    /// Moment of inertia about the link's centre of mass (kg m^2).
    pub inertia_kg_m2: f64,
    /// Geometric angle less encoder angle (rad).
    #[serde(default)]
    pub joint_offset_rad: f64,
    /// The joint's stops are at plus and minus this angle (rad).
    pub joint_limit_rad: f64,
    /// Dry friction in the joint (N m).
    #[serde(rename = "coulomb_friction_N_m", default)]
    pub coulomb_friction_n_m: f64,
    /// Viscous friction in the joint (N m s/rad).
    #[serde(rename = "viscous_friction_N_m_s_rad", default)]
    pub viscous_friction_n_m_s_rad: f64,
    /// Motor torque at the joint over motor current (N m/A).
    #[serde(rename = "torque_constant_N_m_A")]
    pub torque_constant_n_m_a: f64,
    /// Largest motor torque at the joint (N m); 0 is a joint without a motor.
    #[serde(rename = "max_torque_N_m")]
    pub max_torque_n_m: f64,
    /// Driver, where it differs from `[servo]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub servo: Option<Servo>,
    /// The link's own battery; without it the supply never ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub battery: Option<Battery>,
}

/// `[servo]`: a driver's cascade and what the drive is made of.
///
/// Position error times `position_gain` plus the commanded rate is the rate to follow; its error
/// goes through a proportional-integral controller to a torque, limited by the motor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Servo {
    /// Rate commanded per position error (1/s).
    #[serde(rename = "position_gain_1_s")]
    pub position_gain_1_s: f64,
    /// Torque per rate error (N m s/rad).
    #[serde(rename = "velocity_gain_N_m_s_rad")]
    pub velocity_gain_n_m_s_rad: f64,
    /// Torque per integral of the rate error (N m/rad).
    #[serde(rename = "velocity_integral_N_m_rad")]
    pub velocity_integral_n_m_rad: f64,
    /// Largest rate that the position loop asks for (rad/s).
    pub max_rate_rad_s: f64,
    /// Largest current (A), where it is tighter than the motor torque's limit.
    #[serde(rename = "max_current_A", default, skip_serializing_if = "Option::is_none")]
    pub max_current_a: Option<f64>,
    /// Motor and wave generator, seen from the joint (kg m^2); acts only where the joint is
    /// flexible or has backlash, a rigid joint counts it in the links.
    pub rotor_inertia_kg_m2: f64,
    /// Stiffness of the drive while engaged where a joint has backlash and no
    /// `joint_flexibility` (N m/rad).
    #[serde(rename = "gear_stiffness_N_m_rad")]
    pub gear_stiffness_n_m_rad: f64,
    /// Damping of a flexible drive as a share of critical damping of the rotor.
    pub gear_damping_ratio: f64,
    /// Stiffness of the stops (N m/rad).
    #[serde(rename = "stop_stiffness_N_m_rad")]
    pub stop_stiffness_n_m_rad: f64,
    /// Damping of the stops (N m s/rad).
    #[serde(rename = "stop_damping_N_m_s_rad")]
    pub stop_damping_n_m_s_rad: f64,
}

impl Default for Servo {
    fn default() -> Self {
        Self {
            position_gain_1_s: 8.0,
            velocity_gain_n_m_s_rad: 6.0,
            velocity_integral_n_m_rad: 20.0,
            max_rate_rad_s: 1.5,
            max_current_a: None,
            rotor_inertia_kg_m2: 0.01,
            gear_stiffness_n_m_rad: 3000.0,
            gear_damping_ratio: 0.1,
            stop_stiffness_n_m_rad: 300.0,
            stop_damping_n_m_s_rad: 3.0,
        }
    }
}

/// `[sensors]`: standard deviations of white noise and the timing of each sensor.
///
/// The defaults are those of the paper's laboratory; a channel without a sensor uses none of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sensors {
    /// Motion capture: position (m).
    pub mocap_position_m: f64,
    /// Motion capture: heading (rad).
    pub mocap_angle_rad: f64,
    /// Motion capture: samples per second (Hz).
    #[serde(rename = "mocap_rate_Hz")]
    pub mocap_rate_hz: f64,
    /// Motion capture: from the event to the sample's arrival, known and compensated (s).
    pub mocap_latency_s: f64,
    /// Motion capture: chance that a sample is missing.
    pub mocap_dropout: f64,
    /// Gyro: rate (rad/s).
    pub gyro_rad_s: f64,
    /// Gyro: samples per second (Hz).
    #[serde(rename = "gyro_rate_Hz")]
    pub gyro_rate_hz: f64,
    /// Gyro: bias at the start (rad/s).
    pub gyro_bias_rad_s: f64,
    /// Gyro: reading over truth.
    pub gyro_scale: f64,
    /// Gyro: random walk of the bias, standard deviation after 1 s (rad/s/sqrt(s)).
    pub gyro_bias_walk_rad_s_sqrt_s: f64,
    /// Links: encoder angle (rad).
    pub encoder_rad: f64,
    /// Links: encoder rate (rad/s).
    pub encoder_rate_rad_s: f64,
    /// Links: one count of the encoder (rad); 0 is continuous.
    pub encoder_step_rad: f64,
    /// Links: motor current (A).
    #[serde(rename = "current_A")]
    pub current_a: f64,
    /// Links: torque sensor (N m).
    #[serde(rename = "torque_N_m")]
    pub torque_n_m: f64,
    /// Links: the torque sensor saturates here, its 24-bit converter's full scale (N m).
    #[serde(rename = "torque_range_N_m", skip_serializing_if = "Option::is_none")]
    pub torque_range_n_m: Option<f64>,
    /// Links: telemetry samples per second (Hz).
    #[serde(rename = "link_rate_Hz")]
    pub link_rate_hz: f64,
    /// Links: from the event to the telemetry's stamp, known and compensated (s).
    pub link_latency_s: f64,
}

impl Default for Sensors {
    fn default() -> Self {
        Self {
            mocap_position_m: 2e-4,
            mocap_angle_rad: 5e-4,
            mocap_rate_hz: 100.0,
            mocap_latency_s: 0.0,
            mocap_dropout: 0.0,
            gyro_rad_s: 1e-3,
            gyro_rate_hz: 100.0,
            gyro_bias_rad_s: 0.0,
            gyro_scale: 1.0,
            gyro_bias_walk_rad_s_sqrt_s: 0.0,
            encoder_rad: 2e-4,
            encoder_rate_rad_s: 2e-3,
            encoder_step_rad: 0.0,
            current_a: 0.01,
            torque_n_m: 0.01,
            torque_range_n_m: None,
            link_rate_hz: 5.0,
            link_latency_s: 0.0,
        }
    }
}

impl Sensors {
    /// Standard deviations of the white noise of one sample: motion capture's position (m) and heading (rad), the gyro's
    /// rate (rad/s), a link's encoder angle (rad), encoder rate (rad/s), current (A) and torque (N m).
    pub fn noises_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        [
            &mut self.mocap_position_m,
            &mut self.mocap_angle_rad,
            &mut self.gyro_rad_s,
            &mut self.encoder_rad,
            &mut self.encoder_rate_rad_s,
            &mut self.current_a,
            &mut self.torque_n_m,
        ]
        .into_iter()
    }
}

/// `[uncertainty]`: standard deviations of the values elsewhere in the file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Uncertainty {
    /// Of `base.mass_kg`.
    pub base_mass_kg: f64,
    /// Of `base.inertia_kg_m2`.
    pub base_inertia_kg_m2: f64,
    /// Of each component of `base.joint1_xy_m`.
    pub joint1_xy_m: f64,
    /// Of `base.joint1_angle_rad`.
    pub joint1_angle_rad: f64,
    /// Of each `link.length_m`.
    pub link_length_m: f64,
    /// Of each `link.com_to_next_joint_m`.
    pub com_to_next_joint_m: f64,
    /// Of each `link.mass_kg`.
    pub link_mass_kg: f64,
    /// Of each `link.inertia_kg_m2`.
    pub link_inertia_kg_m2: f64,
    /// Of each `link.joint_offset_rad`.
    pub joint_offset_rad: f64,
    /// Of each `link.coulomb_friction_N_m`.
    #[serde(rename = "coulomb_friction_N_m")]
    pub coulomb_friction_n_m: f64,
    /// Of each `link.viscous_friction_N_m_s_rad`.
    #[serde(rename = "viscous_friction_N_m_s_rad")]
    pub viscous_friction_n_m_s_rad: f64,
    /// Of each `link.torque_constant_N_m_A`.
    #[serde(rename = "torque_constant_N_m_A")]
    pub torque_constant_n_m_a: f64,
    /// Of each thruster's thrust.
    #[serde(rename = "thrust_N")]
    pub thrust_n: f64,
    /// Of the stamps of link telemetry, all alike, and of when datagrams reach their links (s): a link's clock is known from its shortest
    /// transit.
    pub link_stamp_s: f64,
}

/// `[disturbance]`: room air on the base, an Ornstein-Uhlenbeck process in each component, or the sum of two.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Disturbance {
    /// Standard deviation of each force component, table frame (N).
    #[serde(rename = "force_std_N", default)]
    pub force_std_n: f64,
    /// Standard deviation of the torque (N m).
    #[serde(rename = "torque_std_N_m", default)]
    pub torque_std_n_m: f64,
    /// Correlation time (s).
    pub correlation_s: f64,
    /// `[disturbance.second]`: a share of the variance that has another correlation time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second: Option<SecondProcess>,
}

/// `[disturbance.second]`: a second Ornstein-Uhlenbeck process, independent of the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SecondProcess {
    /// Its share of the variance of force and torque, 0 to 1; the first process has the rest.
    pub variance_share: f64,
    /// Its correlation time (s).
    pub correlation_s: f64,
}

/// `[target]`: a passive disc that floats on the same table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Moment of inertia about its centre (kg m^2).
    pub inertia_kg_m2: f64,
    /// Centre and heading at the start, table frame (m, m, rad).
    #[serde(default)]
    pub pose: [f64; 3],
    /// Velocity at the start (m/s, m/s, rad/s).
    #[serde(default)]
    pub velocity: [f64; 3],
    /// Radius of the disc that the tip can touch (m).
    #[serde(default = "target_radius")]
    pub radius_m: f64,
    /// Speed of separation over speed of approach of a contact, 0 to 1.
    #[serde(default)]
    pub restitution: f64,
}

fn target_radius() -> f64 {
    0.15
}
