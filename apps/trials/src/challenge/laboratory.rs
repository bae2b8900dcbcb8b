//! The laboratory of a seed where nothing is wrong.
//!
//! It differs from the plant file as real laboratories do: its values lie within their uncertainty, its servos are tuned
//! otherwise, its sensors are noisier or less noisy and run at rates of their own, its valves open with another shape, its
//! friction has a Stribeck part, its air another spectrum. None of this is a fault.

use fss_plant::{Disturbance, Effect, Plant, SecondProcess, Servo};
use miette::{IntoDiagnostic, Result};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Servo gains lie within this factor, evenly in their logarithm.
const SERVO_FACTOR: f64 = 1.3;
/// Standard deviations of the sensors differ by up to this share.
const NOISE_SHARE: f64 = 0.2;
/// Rates of motion capture and telemetry differ by up to this share.
const RATE_SHARE: f64 = 0.05;
/// Time constants of opening and closing lie within this factor.
const VALVE_FACTOR: f64 = 1.5;
/// Static friction above dry friction, in standard deviations of what is known of dry friction, up to this.
const STRIBECK_STD: f64 = 1.0;
/// Rates at which it fades, rad/s.
const STRIBECK_RAD_S: [f64; 2] = [0.01, 0.1];
/// The random stream of a seed that draws its laboratory.
const STREAM: u64 = 2;

/// Draws the laboratory of a seed.
///
/// # Errors
/// None but where the catalogue has lost Stribeck friction.
pub(super) fn draw(seed: u64, plant: &Plant) -> Result<Plant> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(STREAM);
    let dice = &mut random;
    let mut room = plant.drawn(dice.random());
    for joint in 0..room.link_count() {
        let mut servo = plant.servo(joint).clone();
        retune(&mut servo, dice);
        room.links[joint].servo = Some(servo);
    }
    sensors(&mut room, dice);
    // Both times change by the same factor: where they are equal, a pulse keeps its impulse.
    let slower = within(VALVE_FACTOR, dice);
    room.valves.rise_s *= slower;
    room.valves.fall_s *= slower;
    let stated = plant.uncertainty.as_ref().map_or(0.0, |u| u.coulomb_friction_n_m);
    for joint in 1..=plant.link_count() {
        let static_n_m = STRIBECK_STD * stated * dice.random::<f64>();
        let [slowest, fastest] = STRIBECK_RAD_S;
        let fades_rad_s = slowest * (fastest / slowest).powf(dice.random());
        let sticks = Effect::new("joint_stribeck_friction").into_diagnostic()?.at(joint);
        room.effects.push(sticks.with(&[static_n_m, fades_rad_s]));
    }
    room.disturbance = room.disturbance.map(|air| of_another_spectrum(&air, dice));
    Ok(room)
}

/// A factor between `1 / largest` and `largest`, evenly in its logarithm.
fn within(largest: f64, dice: &mut ChaCha8Rng) -> f64 {
    largest.powf(dice.random_range(-1.0..1.0))
}

fn retune(servo: &mut Servo, dice: &mut ChaCha8Rng) {
    servo.position_gain_1_s *= within(SERVO_FACTOR, dice);
    servo.velocity_gain_n_m_s_rad *= within(SERVO_FACTOR, dice);
    servo.velocity_integral_n_m_rad *= within(SERVO_FACTOR, dice);
}

fn sensors(room: &mut Plant, dice: &mut ChaCha8Rng) {
    for std in room.sensors.noises_mut() {
        *std *= 1.0 + dice.random_range(-NOISE_SHARE..NOISE_SHARE);
    }
    let s = &mut room.sensors;
    for rate_hz in [&mut s.mocap_rate_hz, &mut s.link_rate_hz] {
        *rate_hz *= 1.0 + dice.random_range(-RATE_SHARE..RATE_SHARE);
    }
}

/// The same air as the sum of a faster and a slower process. Its variance and its spectral density at rest, which is
/// variance times mean correlation time, stay what they are.
fn of_another_spectrum(air: &Disturbance, dice: &mut ChaCha8Rng) -> Disturbance {
    let (share, faster) = (dice.random_range(0.2..0.7), dice.random_range(0.1..0.8));
    let slower = (1.0 - share * faster) / (1.0 - share);
    let second = SecondProcess { variance_share: share, correlation_s: faster * air.correlation_s };
    Disturbance { correlation_s: slower * air.correlation_s, second: Some(second), ..air.clone() }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_laboratory_is_as_strong_as_stated_and_never_quite_as_stated() {
        let plant = Plant::default_laboratory().unwrap();
        for seed in 0..50 {
            let room = draw(seed, &plant).unwrap();
            assert_eq!(draw(seed, &plant).unwrap(), room, "one seed is one laboratory");
            assert_eq!(Plant::parse(&room.to_toml().unwrap()).unwrap(), room);
            let (stated, air) = (plant.disturbance.as_ref().unwrap(), room.disturbance.as_ref().unwrap());
            let second = air.second.as_ref().unwrap();
            let mean_s =
                (1.0 - second.variance_share) * air.correlation_s + second.variance_share * second.correlation_s;
            assert!((mean_s - stated.correlation_s).abs() < 1e-9);
            assert_eq!((air.force_std_n, air.torque_std_n_m), (stated.force_std_n, stated.torque_std_n_m));
            for joint in 0..4 {
                let gain = room.servo(joint).velocity_gain_n_m_s_rad / plant.servo(joint).velocity_gain_n_m_s_rad;
                assert!((1.0 / SERVO_FACTOR..=SERVO_FACTOR).contains(&gain));
            }
            let noise = room.sensors.gyro_rad_s / plant.sensors.gyro_rad_s;
            assert!((0.8..=1.2).contains(&noise) && noise != 1.0);
        }
    }
}
