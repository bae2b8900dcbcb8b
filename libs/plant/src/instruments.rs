//! The sensors: what they say about the truth.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::check::MAX_LINKS;
use crate::physics::{SensorPhysics, Stream};
use crate::simulation::Simulation;
use crate::truth::Truth;

/// Steps of a 24-bit two's complement converter on each side of zero.
const CONVERTER_STEPS: f64 = 8_388_607.0;

/// What a link's telemetry says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkSample {
    /// Encoder angle (rad).
    pub q_rad: f64,
    /// Encoder rate (rad/s).
    pub qd_rad_s: f64,
    /// Motor current (A).
    pub current_a: f64,
    /// Torque sensor (N m).
    pub torque_nm: f64,
    /// The torque sensor's converter is at its end: not a reading but a fault.
    pub torque_saturated: bool,
}

/// All sensors of a laboratory and their random numbers.
///
/// Each sensor has a random stream of its own, so that reading one more often changes nothing for the others. A
/// sample's stamp is the simulation's time when it is asked for; what it shows may be older
/// ([`SensorPhysics::age_s`]). Transport that the receiver knows of is the caller's: `mocap_latency_s`.
#[derive(Debug, Clone)]
pub struct Instruments {
    base_pose: ChaCha8Rng,
    ee_pose: ChaCha8Rng,
    target_pose: ChaCha8Rng,
    gyro: ChaCha8Rng,
    links: Vec<ChaCha8Rng>,
    gyro_walk_rad_s: f64,
    gyro_last_s: Option<f64>,
}

impl Instruments {
    /// Sensors for a plant with `links` links.
    pub fn new(links: usize, seed: u64) -> Self {
        let stream = |number: u64| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            random.set_stream(number);
            random
        };
        Self {
            base_pose: stream(1),
            ee_pose: stream(2),
            target_pose: stream(3),
            gyro: stream(4),
            links: (0..links).map(|i| stream(16 + i as u64)).collect(),
            gyro_walk_rad_s: 0.0,
            gyro_last_s: None,
        }
    }

    /// Motion capture of the base: pose of its markers in the camera frame (m, m, rad); `None` is a dropout.
    pub fn mocap_base(&mut self, simulation: &Simulation) -> Option<[f64; 3]> {
        let sensors = &simulation.physics().sensors;
        let truth = seen(simulation, sensors.age_s(Stream::BasePose));
        let reading = sensors.base_reading(truth.base_pose);
        noisy(&mut self.base_pose, sensors, reading)
    }

    /// Motion capture of the end-effector.
    pub fn mocap_end_effector(&mut self, simulation: &Simulation) -> Option<[f64; 3]> {
        let sensors = &simulation.physics().sensors;
        let truth = seen(simulation, sensors.age_s(Stream::EePose));
        let reading = sensors.pose_reading(truth.ee_pose);
        noisy(&mut self.ee_pose, sensors, reading)
    }

    /// Motion capture of the target.
    pub fn mocap_target(&mut self, simulation: &Simulation) -> Option<[f64; 3]> {
        let sensors = &simulation.physics().sensors;
        let truth = seen(simulation, sensors.age_s(Stream::TargetPose));
        let reading = sensors.pose_reading(truth.target_pose);
        noisy(&mut self.target_pose, sensors, reading)
    }

    /// Gyro: scale x rate + bias, which walks, + noise (rad/s).
    pub fn gyro(&mut self, simulation: &Simulation) -> f64 {
        let sensors = &simulation.physics().sensors;
        let now = simulation.t_s();
        let since = self.gyro_last_s.map_or(0.0, |last| (now - last).max(0.0));
        self.gyro_last_s = Some(now);
        let nominal = &sensors.nominal;
        self.gyro_walk_rad_s += nominal.gyro_bias_walk_rad_s_sqrt_s * since.sqrt() * normal(&mut self.gyro);
        let rate = seen(simulation, sensors.age_s(Stream::Gyro)).base_velocity[2];
        let noise = nominal.gyro_rad_s * normal(&mut self.gyro);
        sensors.gyro_reading(rate) + self.gyro_walk_rad_s + noise
    }

    /// Telemetry of link `link` (from 0).
    pub fn link(&mut self, simulation: &Simulation, link: usize) -> LinkSample {
        let physics = simulation.physics();
        let truth = seen(simulation, physics.sensors.link_age_s(link));
        let i = link.min(MAX_LINKS - 1);
        let nominal = &physics.sensors.nominal;
        let (Some(joint), Some(random)) = (physics.joints.get(link), self.links.get_mut(link)) else {
            return LinkSample { q_rad: 0.0, qd_rad_s: 0.0, current_a: 0.0, torque_nm: 0.0, torque_saturated: false };
        };
        let angle = joint.encoder_reading(truth.motor_rad[i]);
        let q_rad = rounded(angle + nominal.encoder_rad * normal(random), nominal.encoder_step_rad);
        let rate = joint.encoder_scale * truth.motor_rad_s[i];
        let torque = joint.torque_reading(truth.torque_n_m[i]);
        let qd_rad_s = rate + nominal.encoder_rate_rad_s * normal(random);
        let current_a = truth.current_a[i] + nominal.current_a * normal(random);
        let torque = torque + nominal.torque_n_m * normal(random);
        let (torque_nm, torque_saturated) = converted(torque, nominal.torque_range_n_m);
        LinkSample { q_rad, qd_rad_s, current_a, torque_nm, torque_saturated }
    }
}

/// The truth `age_s` ago; a stream cannot show the future.
fn seen(simulation: &Simulation, age_s: f64) -> Truth {
    if age_s > 0.0 { simulation.truth_at(simulation.t_s() - age_s) } else { simulation.truth() }
}

/// A tracked pose with its noise, sometimes missing.
fn noisy(random: &mut ChaCha8Rng, sensors: &SensorPhysics, [x, y, theta]: [f64; 3]) -> Option<[f64; 3]> {
    let nominal = &sensors.nominal;
    let noise = [normal(random), normal(random), normal(random)];
    let lost = random.random::<f64>() < nominal.mocap_dropout;
    (!lost).then_some([
        x + nominal.mocap_position_m * noise[0],
        y + nominal.mocap_position_m * noise[1],
        theta + nominal.mocap_angle_rad * noise[2],
    ])
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

fn rounded(value: f64, step: f64) -> f64 {
    if step > 0.0 { (value / step).round() * step } else { value }
}

/// What the 24-bit converter makes of a torque, and whether it is at its end.
fn converted(torque: f64, range: Option<f64>) -> (f64, bool) {
    let Some(range) = range else {
        return (torque, false);
    };
    let counts = (torque / range * CONVERTER_STEPS).round();
    let kept = counts.clamp(-CONVERTER_STEPS, CONVERTER_STEPS);
    (kept / CONVERTER_STEPS * range, counts.abs() >= CONVERTER_STEPS)
}
