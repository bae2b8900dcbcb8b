//! How much an effect does to the sensors.
//!
//! What two laboratories show along the same paths differs; a window's unknown initial state takes off what it can. The rest
//! is divided by the floor of its channel: the sensor's noise and what the room's air does to it. Its RMS over all
//! experiments, in the channel that shows most, is the *effect size*.

use super::path::{Path, STEP_S, coordinates, farthest_m};
use super::prediction::{BASE_CHANNELS, END_EFFECTOR_CHANNELS, Shown, WINDOW_STEPS, flown, shown};
use fss_multibody::Model;
use fss_plant::{Disturbance, Plant};
use miette::{IntoDiagnostic, Result};
use nalgebra::{Matrix6, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// The experiments of a vehicle as its plant file says, to measure laboratories by.
pub(super) struct Yardstick<'a> {
    paths: Vec<&'a Path>,
    nominal: Vec<Shown>,
    /// Standard deviation of noise and air by channel: motion, then drives.
    floor: Vec<f64>,
    motion_channels: usize,
}

/// What a laboratory shows beyond the plant file: channel by channel over all experiments, over the floor.
pub(super) struct Difference(Vec<Vec<f64>>);

impl Difference {
    /// All samples, channel after channel.
    pub(super) fn samples(&self) -> Vec<f64> {
        self.0.concat()
    }

    /// RMS of the channel that shows most.
    pub(super) fn effect_size(&self) -> f64 {
        self.effect_size_of(&self.samples())
    }

    /// The same where `samples` are left of this difference.
    pub(super) fn effect_size_of(&self, samples: &[f64]) -> f64 {
        let mut rest = samples;
        let mut largest = 0.0_f64;
        for channel in &self.0 {
            let (own, others) = rest.split_at(channel.len().min(rest.len()));
            largest = largest.max(rms(own));
            rest = others;
        }
        largest
    }
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

impl<'a> Yardstick<'a> {
    /// Of a vehicle and the paths of its experiments.
    ///
    /// # Errors
    /// Where the plant is no mechanism.
    pub(super) fn new(plant: &Plant, paths: Vec<&'a Path>) -> Result<Self> {
        let nominal: Vec<Shown> = paths.iter().map(|path| shown(plant, path)).collect::<Result<_>>()?;
        let s = &plant.sensors;
        let pose = [s.mocap_position_m, s.mocap_position_m, s.mocap_angle_rad];
        let mut floor = pose.to_vec();
        floor.push(s.gyro_rad_s);
        if plant.link_count() > 0 {
            floor.extend(pose);
        }
        let motion_channels = floor.len();
        floor.extend(plant.links.iter().map(|_| s.torque_n_m));
        floor.extend(plant.links.iter().map(|_| s.current_a));
        for std in &mut floor {
            *std = std.max(1e-9);
        }
        let mut own = Self { paths, nominal, floor, motion_channels };
        let air = own.air(plant)?;
        own.floor.iter_mut().zip(air).for_each(|(std, air)| *std = std.hypot(air));
        Ok(own)
    }

    /// What `laboratory` shows beyond the plant file.
    ///
    /// # Errors
    /// Where the laboratory is no mechanism.
    pub(super) fn difference(&self, laboratory: &Plant) -> Result<Difference> {
        let mut all = Difference(vec![Vec::new(); self.floor.len()]);
        for (path, nominal) in self.paths.iter().zip(&self.nominal) {
            let mut other = shown(laboratory, path)?;
            align(&nominal.motion, &mut other.motion);
            let over = |own: &[Vec<f64>], other: &[Vec<f64>], floor: &[f64]| -> Vec<Vec<f64>> {
                let channels = own.iter().zip(other).zip(floor);
                channels.map(|((a, b), std)| a.iter().zip(b).map(|(a, b)| (b - a) / std).collect()).collect()
            };
            let (of_motion, of_drives) = self.floor.split_at(self.motion_channels);
            let mut motion = over(&nominal.motion, &other.motion, of_motion);
            take_off_initial_states(&nominal.motion, of_motion, &mut motion);
            motion.extend(over(&nominal.drives, &other.drives, of_drives));
            all.0.iter_mut().zip(motion).for_each(|(channel, own)| channel.extend(own));
        }
        Ok(all)
    }

    /// How far from the middle of the table the base of `laboratory` comes along an axis, m.
    ///
    /// # Errors
    /// Where the laboratory is no mechanism.
    pub(super) fn farthest_m(&self, laboratory: &Plant) -> Result<f64> {
        let reach = self.paths.iter().map(|path| flown(laboratory, path).map(|base| farthest_m(&base)));
        reach.collect::<Result<Vec<_>>>().map(|all| all.into_iter().fold(0.0, f64::max))
    }

    /// RMS of what the room's air does to each channel of the motion, initial states taken off: one realization.
    fn air(&self, plant: &Plant) -> Result<Vec<f64>> {
        let Some(air) = &plant.disturbance else { return Ok(Vec::new()) };
        let model = plant.model().into_diagnostic()?;
        let mut wind = Wind::new(air);
        let mut squares = vec![(0.0, 0_usize); self.motion_channels];
        let of_motion = &self.floor[..self.motion_channels];
        for (path, nominal) in self.paths.iter().zip(&self.nominal) {
            let mut moved = blown(&model, path, &nominal.motion, &mut wind);
            for (channel, std) in moved.iter_mut().zip(of_motion) {
                for value in channel {
                    *value /= std;
                }
            }
            take_off_initial_states(&nominal.motion, of_motion, &mut moved);
            for (sum, channel) in squares.iter_mut().zip(&moved) {
                *sum = (sum.0 + channel.iter().map(|d| d * d).sum::<f64>(), sum.1 + channel.len());
            }
        }
        Ok(squares.iter().zip(of_motion).map(|((sum, n), std)| std * (sum / (*n).max(1) as f64).sqrt()).collect())
    }
}

/// The room's air at every step: an Ornstein-Uhlenbeck process in force x, force y and torque.
struct Wind {
    std: [f64; 3],
    keep: f64,
    now: [f64; 3],
    random: ChaCha8Rng,
}

impl Wind {
    fn new(air: &Disturbance) -> Self {
        let keep = (-STEP_S / air.correlation_s).exp();
        let std = [air.force_std_n, air.force_std_n, air.torque_std_n_m];
        let mut wind = Self { std, keep: 0.0, now: [0.0; 3], random: ChaCha8Rng::seed_from_u64(0) };
        wind.step();
        Self { keep, ..wind }
    }

    fn step(&mut self) -> [f64; 3] {
        let fresh = (1.0 - self.keep * self.keep).sqrt();
        for (own, std) in self.now.iter_mut().zip(self.std) {
            let normal: f64 = StandardNormal.sample(&mut self.random);
            *own = self.keep * *own + fresh * std * normal;
        }
        self.now
    }
}

/// How the air moves the channels of a path: the vehicle is a rigid body as it stands at each time.
fn blown(model: &Model, path: &Path, nominal: &[Vec<f64>], wind: &mut Wind) -> Vec<Vec<f64>> {
    let mut moved = vec![Vec::new(); nominal.len()];
    let (mut way, mut speed) = ([0.0; 3], [0.0; 3]);
    for (k, base) in path.base[..path.steps()].iter().enumerate() {
        let q = coordinates(base.pose, &path.q_rad[2 * k]);
        let center = model.center_of_mass(&q);
        let [fx, fy, torque] = wind.step();
        let lever = [base.pose[0] - center.x, base.pose[1] - center.y];
        let about_center = torque + lever[0] * fy - lever[1] * fx;
        let mass_kg = model.total_mass_kg();
        let accelerations = [fx / mass_kg, fy / mass_kg, about_center / model.inertia_about_com(&q)];
        for i in 0..3 {
            speed[i] += accelerations[i] * STEP_S;
            way[i] += speed[i] * STEP_S;
        }
        let [x, y, turn] = way;
        let at = |i: usize| {
            let [lx, ly] = [nominal[i][k] - center.x, nominal[i + 1][k] - center.y];
            [x - ly * turn, y + lx * turn, turn]
        };
        let mut values = at(0).to_vec();
        values.push(speed[2]);
        if nominal.len() > BASE_CHANNELS {
            values.extend(at(BASE_CHANNELS));
        }
        moved.iter_mut().zip(values).for_each(|(channel, value)| channel.push(value));
    }
    moved
}

/// Turns each window of another motion about the start of the nominal one by what its base heads elsewhere on average: what is
/// left of an unknown heading is small enough to be linear.
fn align(nominal: &[Vec<f64>], other: &mut [Vec<f64>]) {
    let count = nominal[0].len();
    let bodies = if nominal.len() > BASE_CHANNELS { vec![0, BASE_CHANNELS] } else { vec![0] };
    for from in (0..count).step_by(WINDOW_STEPS) {
        let window = from..(from + WINDOW_STEPS).min(count);
        let turned: f64 = window.clone().map(|k| other[2][k] - nominal[2][k]).sum();
        let turn_rad = turned / window.len() as f64;
        let (sin, cos) = turn_rad.sin_cos();
        let start = [nominal[0][from], nominal[1][from]];
        for (first, k) in bodies.iter().flat_map(|first| window.clone().map(move |k| (*first, k))) {
            let [x, y] = [other[first][k] - start[0], other[first + 1][k] - start[1]];
            other[first][k] = start[0] + cos * x + sin * y;
            other[first + 1][k] = start[1] + cos * y - sin * x;
            other[first + 2][k] -= turn_rad;
        }
    }
}

/// Fits a rigid shift, turn and drift to each window of the motion, and takes it off.
fn take_off_initial_states(nominal: &[Vec<f64>], floor: &[f64], differences: &mut [Vec<f64>]) {
    let count = differences[0].len();
    for from in (0..count).step_by(WINDOW_STEPS) {
        let window = from..(from + WINDOW_STEPS).min(count);
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for k in window.clone() {
            for (channel, row) in rows(nominal, floor, from, k).enumerate() {
                normal += row * row.transpose();
                right += row * differences[channel][k];
            }
        }
        let Some(cholesky) = (normal + Matrix6::identity() * 1e-9).cholesky() else { continue };
        let state = cholesky.solve(&right);
        for k in window {
            for (channel, row) in rows(nominal, floor, from, k).enumerate() {
                differences[channel][k] -= row.dot(&state);
            }
        }
    }
}

/// What another initial state does to the motion at sample `k`, over the floor: a shift x, y, a turn of all about where the base
/// was, and their rates.
fn rows<'a>(
    nominal: &'a [Vec<f64>],
    floor: &'a [f64],
    from: usize,
    k: usize,
) -> impl Iterator<Item = Vector6<f64>> + use<'a> {
    let t_s = (k - from) as f64 * STEP_S;
    let row = move |x: f64, y: f64, turn: f64| Vector6::new(x, y, turn, x * t_s, y * t_s, turn * t_s);
    let body = move |first: usize| {
        let way = [nominal[first][k] - nominal[0][from], nominal[first + 1][k] - nominal[1][from]];
        [row(1.0, 0.0, -way[1]), row(0.0, 1.0, way[0]), row(0.0, 0.0, 1.0)]
    };
    let gyro = Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let has_arm = nominal.len() >= BASE_CHANNELS + END_EFFECTOR_CHANNELS;
    let arm = if has_arm { Some(body(BASE_CHANNELS)) } else { None };
    let all = body(0).into_iter().chain([gyro]).chain(arm.into_iter().flatten());
    all.zip(floor).map(|(row, std)| row / *std)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::experiments::of_vehicle;
    use super::*;
    use fss_plant::Effect;

    #[test]
    fn twice_the_effect_is_twice_the_effect_size_and_a_turn_of_the_whole_camera_frame_is_none() {
        let plant = Plant::default_laboratory().unwrap();
        let experiments = of_vehicle(&plant, &["coast".to_owned(), "excitation".to_owned()]).unwrap();
        let yardstick = Yardstick::new(&plant, experiments.iter().map(|e| &e.path).collect()).unwrap();
        let size = |effect: Effect| yardstick.difference(&plant.with_effects(&[effect])).unwrap().effect_size();
        for (id, once) in [("table_tilt", [5e-5, 0.0]), ("body_force", [2e-4, 1e-4])] {
            let effect = Effect::new(id).unwrap();
            let ratio = size(effect.clone().with(&once.map(|v| 2.0 * v))) / size(effect.with(&once));
            assert!((ratio - 2.0).abs() < 0.05, "{id}: {ratio}");
        }
        let friction = Effect::new("joint_viscous_friction").unwrap().at(2).with(&[0.4]);
        assert!(size(friction) > 1.0, "friction shows in the currents");
        assert!(size(Effect::new("mocap_rotation").unwrap().with(&[0.2])) < 0.05);
        assert!(size(Effect::new("marker_yaw").unwrap().with(&[0.01])) > 1.0, "seen against the end-effector");
    }
}
