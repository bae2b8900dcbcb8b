//! Values that no laboratory can have, found before they reach the dynamics.

use crate::error::Fault;
use crate::file::Plant;
use crate::parts::{Battery, Link, Sensors, Servo};
use crate::thruster::Thruster;

/// Links that the dynamics have room for.
pub const MAX_LINKS: usize = fss_multibody::MAX_LINKS;

type Check = Result<(), Fault>;

/// Every value of the plant but its effects.
pub(crate) fn values(plant: &Plant) -> Check {
    table(plant)?;
    base(plant)?;
    for (i, link_table) in plant.links.iter().enumerate() {
        link(&format!("link/{i}"), link_table)?;
    }
    thrusters(plant)?;
    devices(plant)?;
    servo("servo", &plant.servo)?;
    sensors(&plant.sensors)?;
    surroundings(plant)
}

fn table(plant: &Plant) -> Check {
    finite_all("table/gravity_m_s2", &plant.table.gravity_m_s2)?;
    for side in plant.table.size_m {
        positive("table/size_m", side)?;
    }
    Ok(())
}

fn base(plant: &Plant) -> Check {
    let base = &plant.base;
    finite_all("base/joint1_xy_m", &base.joint1_xy_m)?;
    finite("base/joint1_angle_rad", base.joint1_angle_rad)?;
    finite_all("base/size_m", &base.size_m)?;
    if base.clamped {
        non_negative("base/mass_kg", base.mass_kg)?;
        non_negative("base/inertia_kg_m2", base.inertia_kg_m2)?;
        if plant.links.is_empty() {
            return Err(Fault::new(
                "base/clamped",
                "a clamped base without links has nothing that can move",
                "add a [[link]], or remove clamped = true",
            ));
        }
    } else {
        positive("base/mass_kg", base.mass_kg)?;
        positive("base/inertia_kg_m2", base.inertia_kg_m2)?;
    }
    if plant.links.len() > MAX_LINKS {
        return Err(Fault::new(
            format!("link/{MAX_LINKS}"),
            format!("the dynamics have room for {MAX_LINKS} links"),
            "remove links, or raise MAX_LINKS in libs/multibody",
        ));
    }
    if let Some(thrust) = base.thrust_n {
        non_negative("base/thrust_N", thrust)?;
    }
    Ok(())
}

fn link(at: &str, link: &Link) -> Check {
    positive(&format!("{at}/length_m"), link.length_m)?;
    finite(&format!("{at}/com_to_next_joint_m"), link.com_to_next_joint_m)?;
    positive(&format!("{at}/mass_kg"), link.mass_kg)?;
    positive(&format!("{at}/inertia_kg_m2"), link.inertia_kg_m2)?;
    finite(&format!("{at}/joint_offset_rad"), link.joint_offset_rad)?;
    positive(&format!("{at}/joint_limit_rad"), link.joint_limit_rad)?;
    non_negative(&format!("{at}/coulomb_friction_N_m"), link.coulomb_friction_n_m)?;
    non_negative(&format!("{at}/viscous_friction_N_m_s_rad"), link.viscous_friction_n_m_s_rad)?;
    positive(&format!("{at}/torque_constant_N_m_A"), link.torque_constant_n_m_a)?;
    non_negative(&format!("{at}/max_torque_N_m"), link.max_torque_n_m)?;
    if let Some(own) = &link.servo {
        servo(&format!("{at}/servo"), own)?;
    }
    if let Some(own) = &link.battery {
        battery(&format!("{at}/battery"), own)?;
    }
    Ok(())
}

fn thrusters(plant: &Plant) -> Check {
    for (i, thruster) in plant.thrusters.iter().enumerate() {
        let at = format!("thruster/{i}");
        finite_all(&format!("{at}/position_m"), &thruster.position_m)?;
        finite_all(&format!("{at}/force_direction"), &thruster.force_direction)?;
        let [x, y] = thruster.force_direction;
        if x.hypot(y) < 1e-9 {
            return Err(Fault::new(
                format!("{at}/force_direction"),
                "the direction of the force has no length",
                "give the direction in which the thruster pushes the base, such as [1, 0]",
            ));
        }
        strength(&at, plant, thruster)?;
        non_negative(&format!("{at}/lag_s"), thruster.lag_s.unwrap_or(0.0))?;
    }
    Ok(())
}

/// A thruster has a thrust or a curve of thrust.
fn strength(at: &str, plant: &Plant, thruster: &Thruster) -> Check {
    let Some(curve) = &thruster.thrust_curve else {
        return match thruster.thrust_n.or(plant.base.thrust_n) {
            Some(thrust) => non_negative(&format!("{at}/thrust_N"), thrust),
            None => Err(Fault::new(
                at,
                "nothing says how strong this thruster is",
                "add thrust_N to [base] for all thrusters, or thrust_N or thrust_curve to this [[thruster]]",
            )),
        };
    };
    let place = format!("{at}/thrust_curve");
    finite_all(&place, curve)?;
    if thruster.thrust_n.is_some() {
        return Err(Fault::new(
            format!("{at}/thrust_N"),
            "this thruster has both thrust_N and thrust_curve",
            "remove thrust_N: the curve says the thrust at every level",
        ));
    }
    let whole: f64 = curve.iter().sum();
    if whole < 0.0 {
        return Err(Fault::new(
            place,
            format!("the thrust at level 1 is {whole} N, it must not be negative"),
            "turn force_direction around and give the curve the other sign",
        ));
    }
    Ok(())
}

fn devices(plant: &Plant) -> Check {
    let valves = &plant.valves;
    non_negative("valves/delay_s", valves.delay_s)?;
    non_negative("valves/rise_s", valves.rise_s)?;
    non_negative("valves/fall_s", valves.fall_s)?;
    non_negative("valves/min_on_s", valves.min_on_s)?;
    fraction("valves/droop_fraction_per_extra_valve", valves.droop_fraction_per_extra_valve)?;
    if let Some(tank) = &plant.tank {
        positive("tank/pressure_Pa", tank.pressure_pa)?;
        positive("tank/volume_m3", tank.volume_m3)?;
        positive("tank/temperature_K", tank.temperature_k)?;
        positive("tank/gas_constant_J_kg_K", tank.gas_constant_j_kg_k)?;
        positive("tank/regulator_Pa", tank.regulator_pa)?;
        positive("tank/specific_impulse_s", tank.specific_impulse_s)?;
        if !plant.base.clamped && tank.gas_kg() >= plant.base.mass_kg {
            return Err(Fault::new(
                "tank",
                format!("the full tank holds {:.3} kg of gas, more than the base weighs", tank.gas_kg()),
                "check pressure_Pa and volume_m3, or base.mass_kg, which includes the gas",
            ));
        }
    }
    if let Some(own) = &plant.battery {
        battery("battery", own)?;
    }
    Ok(())
}

fn battery(at: &str, battery: &Battery) -> Check {
    positive(&format!("{at}/nominal_V"), battery.nominal_v)?;
    positive(&format!("{at}/capacity_Wh"), battery.capacity_wh)?;
    non_negative(&format!("{at}/resistance_Ohm"), battery.resistance_ohm)?;
    non_negative(&format!("{at}/idle_W"), battery.idle_w)
}

fn servo(at: &str, servo: &Servo) -> Check {
    for (key, value) in [
        ("position_gain_1_s", servo.position_gain_1_s),
        ("velocity_gain_N_m_s_rad", servo.velocity_gain_n_m_s_rad),
        ("velocity_integral_N_m_rad", servo.velocity_integral_n_m_rad),
        ("gear_damping_ratio", servo.gear_damping_ratio),
        ("stop_damping_N_m_s_rad", servo.stop_damping_n_m_s_rad),
        ("max_current_A", servo.max_current_a.unwrap_or(0.0)),
    ] {
        non_negative(&format!("{at}/{key}"), value)?;
    }
    for (key, value) in [
        ("max_rate_rad_s", servo.max_rate_rad_s),
        ("rotor_inertia_kg_m2", servo.rotor_inertia_kg_m2),
        ("gear_stiffness_N_m_rad", servo.gear_stiffness_n_m_rad),
        ("stop_stiffness_N_m_rad", servo.stop_stiffness_n_m_rad),
    ] {
        positive(&format!("{at}/{key}"), value)?;
    }
    Ok(())
}

fn sensors(sensors: &Sensors) -> Check {
    for (key, value) in [
        ("mocap_position_m", sensors.mocap_position_m),
        ("mocap_angle_rad", sensors.mocap_angle_rad),
        ("mocap_latency_s", sensors.mocap_latency_s),
        ("gyro_rad_s", sensors.gyro_rad_s),
        ("gyro_bias_walk_rad_s_sqrt_s", sensors.gyro_bias_walk_rad_s_sqrt_s),
        ("encoder_rad", sensors.encoder_rad),
        ("encoder_rate_rad_s", sensors.encoder_rate_rad_s),
        ("encoder_step_rad", sensors.encoder_step_rad),
        ("current_A", sensors.current_a),
        ("torque_N_m", sensors.torque_n_m),
        ("link_latency_s", sensors.link_latency_s),
    ] {
        non_negative(&format!("sensors/{key}"), value)?;
    }
    for (key, value) in [
        ("mocap_rate_Hz", sensors.mocap_rate_hz),
        ("gyro_rate_Hz", sensors.gyro_rate_hz),
        ("link_rate_Hz", sensors.link_rate_hz),
        ("torque_range_N_m", sensors.torque_range_n_m.unwrap_or(1.0)),
    ] {
        positive(&format!("sensors/{key}"), value)?;
    }
    fraction("sensors/mocap_dropout", sensors.mocap_dropout)?;
    finite("sensors/gyro_bias_rad_s", sensors.gyro_bias_rad_s)?;
    finite("sensors/gyro_scale", sensors.gyro_scale)
}

fn surroundings(plant: &Plant) -> Check {
    if let Some(u) = &plant.uncertainty {
        for (key, value) in [
            ("base_mass_kg", u.base_mass_kg),
            ("base_inertia_kg_m2", u.base_inertia_kg_m2),
            ("joint1_xy_m", u.joint1_xy_m),
            ("joint1_angle_rad", u.joint1_angle_rad),
            ("link_length_m", u.link_length_m),
            ("com_to_next_joint_m", u.com_to_next_joint_m),
            ("link_mass_kg", u.link_mass_kg),
            ("link_inertia_kg_m2", u.link_inertia_kg_m2),
            ("joint_offset_rad", u.joint_offset_rad),
            ("coulomb_friction_N_m", u.coulomb_friction_n_m),
            ("viscous_friction_N_m_s_rad", u.viscous_friction_n_m_s_rad),
            ("torque_constant_N_m_A", u.torque_constant_n_m_a),
            ("thrust_N", u.thrust_n),
            ("link_stamp_s", u.link_stamp_s),
        ] {
            non_negative(&format!("uncertainty/{key}"), value)?;
        }
    }
    if let Some(d) = &plant.disturbance {
        non_negative("disturbance/force_std_N", d.force_std_n)?;
        non_negative("disturbance/torque_std_N_m", d.torque_std_n_m)?;
        positive("disturbance/correlation_s", d.correlation_s)?;
        if let Some(second) = &d.second {
            fraction("disturbance/second/variance_share", second.variance_share)?;
            positive("disturbance/second/correlation_s", second.correlation_s)?;
        }
    }
    if let Some(target) = &plant.target {
        positive("target/mass_kg", target.mass_kg)?;
        positive("target/inertia_kg_m2", target.inertia_kg_m2)?;
        positive("target/radius_m", target.radius_m)?;
        fraction("target/restitution", target.restitution)?;
        finite_all("target/pose", &target.pose)?;
        finite_all("target/velocity", &target.velocity)?;
    }
    Ok(())
}

fn finite(path: &str, value: f64) -> Check {
    if value.is_finite() {
        Ok(())
    } else {
        Err(Fault::new(
            path,
            format!("{} is {value}, which is not a number to compute with", key(path)),
            "give a finite number",
        ))
    }
}

fn finite_all(path: &str, values: &[f64]) -> Check {
    values.iter().try_for_each(|v| finite(path, *v))
}

fn positive(path: &str, value: f64) -> Check {
    finite(path, value)?;
    if value > 0.0 {
        Ok(())
    } else {
        Err(Fault::new(
            path,
            format!("{} is {value}, it must be greater than 0", key(path)),
            "give the value in the unit that its name ends with",
        ))
    }
}

fn non_negative(path: &str, value: f64) -> Check {
    finite(path, value)?;
    if value >= 0.0 {
        Ok(())
    } else {
        Err(Fault::new(
            path,
            format!("{} is {value}, it must not be negative", key(path)),
            "give the value in the unit that its name ends with",
        ))
    }
}

fn fraction(path: &str, value: f64) -> Check {
    non_negative(path, value)?;
    if value <= 1.0 {
        Ok(())
    } else {
        Err(Fault::new(
            path,
            format!("{} is {value}, it must lie between 0 and 1", key(path)),
            "give a fraction, not a percentage",
        ))
    }
}

fn key(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}
