//! Paired simulations: how much an effect does to the sensors.
//!
//! The experiments are commanded open loop, so every laboratory is told the same. Their commands are played twice without
//! noise and with the room's air at rest, with and without the effect. What the measured motion of the arm explains under the
//! nominal model is taken off each: a joint that moves otherwise because its servo does is seen by its encoder, and is no
//! effect. So are the torques of a joint at rest, which are those that happened to stick. The difference of what is left is
//! divided by the sensors' noise; a window's initial state takes off what it can. What remains, as RMS over all runs of the
//! channel that shows most of it, is the *effect size*, over the RMS of noise and of what the room's air does to the same channel.

use fss_experiments::commands::Commands;
use fss_multibody::wrapped;
use fss_multibody::{Coordinates, JointVector, Model};
use fss_plant::{Instruments, LinkSample, Plant, Simulation};
use miette::{IntoDiagnostic, Result};
use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;

/// Length of a window, s.
const WINDOW_S: f64 = 5.0;
/// Between two samples of base, end-effector and gyro, ms; and of telemetry, in those. No divisor of the commands' period:
/// a stiff drive rings for some milliseconds after each, and telemetry meets that no more often than anything else.
const SAMPLE_MS: usize = 47;
const TELEMETRY_EVERY: usize = 4;
/// Centre of mass x and y, angle of the base less what the arm turned it; gyro less the same; end-effector x, y and angle,
/// seen from the base, less where the encoders have it. Beyond them stand the drives: what friction takes of each torque.
const FAST_CHANNELS: usize = 7;
/// A joint that is slower than this is at rest, rad/s.
const AT_REST_RAD_S: f64 = 0.03;

/// The experiments, ready to be played on any laboratory of one plant.
pub(super) struct PairedSimulation {
    /// As the laboratory believes to be.
    nominal: Plant,
    model: Model,
    flights: Vec<Commands>,
    noise: Vec<f64>,
    /// RMS of noise and air in each channel, over the noise.
    floor: Vec<f64>,
}

/// What the sensors show in one flight: by channel, over time.
struct Seen {
    channels: Vec<Vec<f64>>,
    farthest_m: f64,
}

/// What one laboratory shows beyond another: by channel, over time of all runs, over noise and disturbance.
pub(super) struct Difference {
    channels: Vec<Vec<f64>>,
    farthest_m: f64,
}

impl Difference {
    /// All samples, channel after channel.
    pub(super) fn samples(&self) -> Vec<f64> {
        self.channels.concat()
    }

    /// How far from the middle of the table the base comes along an axis, m.
    pub(super) fn farthest_m(&self) -> f64 {
        self.farthest_m
    }

    /// RMS of the channel that shows most, where `samples` are what is left of this difference.
    pub(super) fn effect_size_of(&self, samples: &[f64]) -> f64 {
        let mut rest = samples;
        let mut largest = 0.0_f64;
        for channel in &self.channels {
            let (own, others) = rest.split_at(channel.len().min(rest.len()));
            largest = largest.max((own.iter().map(|d| d * d).sum::<f64>() / own.len().max(1) as f64).sqrt());
            rest = others;
        }
        largest
    }
}

/// What a laboratory shows without the effects that are asked about.
pub(super) struct Baseline(Vec<Seen>);

impl PairedSimulation {
    /// Of flights on `plant`, whose commands are given.
    ///
    /// # Errors
    /// Where the plant is no mechanism.
    pub(super) fn new(plant: &Plant, flights: Vec<Commands>) -> Result<Self> {
        let s = &plant.sensors;
        let (p, a) = (s.mocap_position_m, s.mocap_angle_rad);
        let mut noise = vec![p, p, a, s.gyro_rad_s, p, p, a];
        noise.extend(plant.links.iter().map(|link| s.torque_n_m.hypot(link.torque_constant_n_m_a * s.current_a)));
        for sd in &mut noise {
            *sd = sd.max(1e-9);
        }
        let model = plant.model().into_diagnostic()?;
        let mut paired = Self { nominal: plant.clone(), model, flights, noise, floor: Vec::new() };
        paired.floor = vec![1.0; paired.noise.len()];
        let still = paired.baseline(plant)?;
        let airy = paired.play(&quiet(plant, true))?;
        let rms = |air: &Vec<f64>| (air.iter().map(|d| d * d).sum::<f64>() / air.len().max(1) as f64).sqrt();
        paired.floor = paired.compare(&still, &airy).channels.iter().map(|air| rms(air).hypot(1.0)).collect();
        Ok(paired)
    }

    /// What the laboratory shows by itself.
    ///
    /// # Errors
    /// Where the plant is no mechanism.
    pub(super) fn baseline(&self, room: &Plant) -> Result<Baseline> {
        Ok(Baseline(self.play(&quiet(room, false))?))
    }

    /// What `laboratory` shows beyond the baseline.
    ///
    /// # Errors
    /// Where the laboratory is no mechanism.
    pub(super) fn difference(&self, laboratory: &Plant, baseline: &Baseline) -> Result<Difference> {
        Ok(self.compare(baseline, &self.play(&quiet(laboratory, false))?))
    }

    fn play(&self, plant: &Plant) -> Result<Vec<Seen>> {
        self.flights.par_iter().map(|flight| self.fly(plant, flight)).collect()
    }

    fn fly(&self, plant: &Plant, flight: &Commands) -> Result<Seen> {
        let links = plant.link_count();
        let mut instruments = Instruments::new(links, 0);
        let mut seen = Seen { channels: vec![Vec::new(); FAST_CHANNELS + links], farthest_m: 0.0 };
        let (mut samples, mut last, mut turned_rad) = (0, None, 0.0);
        let see = |simulation: &Simulation| {
            let base = instruments.mocap_base(simulation).unwrap_or_default();
            let ee = instruments.mocap_end_effector(simulation).filter(|_| links > 0);
            let drives: Vec<_> = (0..links).map(|i| instruments.link(simulation, i)).collect();
            let joints = |of: fn(&LinkSample) -> f64| JointVector::from_fn(|i, _| drives.get(i).map_or(0.0, of));
            let (q_rad, qd_rad_s) = (joints(|link| link.q_rad), joints(|link| link.qd_rad_s));
            let reaction = |q_rad: &JointVector| self.model.reaction_vector(&placed([0.0; 3], q_rad));
            let before = last.replace(q_rad).unwrap_or(q_rad);
            turned_rad += reaction(&(0.5 * (before + q_rad))).dot(&(q_rad - before));
            let center = self.model.center_of_mass(&placed(base, &q_rad));
            let gyro = instruments.gyro(simulation) - reaction(&q_rad).dot(&qd_rad_s);
            let off = ee.map_or([0.0; 3], |ee| {
                let expected = self.model.end_effector(&placed(base, &q_rad));
                let (sin, cos) = base[2].sin_cos();
                let (x, y) = (ee[0] - expected.x, ee[1] - expected.y);
                [cos * x + sin * y, cos * y - sin * x, wrapped(ee[2] - expected.z)]
            });
            let fast = [center.x, center.y, base[2] - turned_rad, gyro].into_iter().chain(off);
            seen.channels.iter_mut().zip(fast).for_each(|(channel, value)| channel.push(value));
            seen.farthest_m = seen.farthest_m.max(base[0].abs()).max(base[1].abs());
            if samples % TELEMETRY_EVERY == 0 {
                let believed = &self.nominal.links;
                for ((channel, link), believed) in seen.channels[FAST_CHANNELS..].iter_mut().zip(&drives).zip(believed)
                {
                    let moves = link.qd_rad_s.abs() > AT_REST_RAD_S;
                    let lost_n_m = believed.torque_constant_n_m_a * link.current_a - link.torque_nm;
                    channel.push(if moves { lost_n_m } else { f64::NAN });
                }
            }
            samples += 1;
        };
        flight.play(plant, 1, SAMPLE_MS, see).into_diagnostic()?;
        Ok(seen)
    }

    /// The difference in each channel over noise and disturbance, initial states taken off.
    fn compare(&self, baseline: &Baseline, seen: &[Seen]) -> Difference {
        let mut all = Difference {
            channels: vec![Vec::new(); self.noise.len()],
            farthest_m: seen.iter().map(|seen| seen.farthest_m).fold(0.0, f64::max),
        };
        for (without, with) in baseline.0.iter().zip(seen) {
            // What was not there in both is no difference.
            let over = |a: f64, b: f64, sd: f64| Some((b - a) / sd).filter(|d| d.is_finite()).unwrap_or(0.0);
            let mut differences: Vec<Vec<f64>> = (without.channels.iter().zip(&with.channels).zip(&self.noise))
                .map(|((a, b), sd)| a.iter().zip(b).map(|(a, b)| over(*a, *b, *sd)).collect())
                .collect();
            self.take_off_initial_states(&without.channels, &mut differences);
            for ((channel, difference), floor) in all.channels.iter_mut().zip(&differences).zip(&self.floor) {
                channel.extend(difference.iter().map(|d| d / floor));
            }
        }
        all
    }

    /// Fits a rigid shift, turn and drift to each window of the vehicle's motion, and takes it off.
    fn take_off_initial_states(&self, seen: &[Vec<f64>], differences: &mut [Vec<f64>]) {
        let length = (WINDOW_S * 1e3) as usize / SAMPLE_MS;
        let count = differences[0].len();
        for from in (0..count).step_by(length) {
            let window = from..(from + length).min(count);
            let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
            for k in window.clone() {
                for (channel, row) in self.rows(seen, from, k).iter().enumerate() {
                    normal += row * row.transpose();
                    right += row * differences[channel][k];
                }
            }
            let Some(cholesky) = (normal + Matrix6::identity() * 1e-9).cholesky() else { continue };
            let state = cholesky.solve(&right);
            for k in window {
                for (channel, row) in self.rows(seen, from, k).iter().enumerate() {
                    differences[channel][k] -= row.dot(&state);
                }
            }
        }
    }

    /// What another initial state does to the first channels at sample `k`, over the noise: a shift x, y, a turn of all that
    /// follows about where the centre of mass was, and their rates.
    fn rows(&self, seen: &[Vec<f64>], from: usize, k: usize) -> [Vector6<f64>; 4] {
        let t_s = (k - from) as f64 * SAMPLE_MS as f64 * 1e-3;
        let (way_x, way_y) = (seen[0][k] - seen[0][from], seen[1][k] - seen[1][from]);
        let row = |x: f64, y: f64, turn: f64, sd: f64| Vector6::new(x, y, turn, x * t_s, y * t_s, turn * t_s) / sd;
        let n = &self.noise;
        [
            row(1.0, 0.0, -way_y, n[0]),
            row(0.0, 1.0, way_x, n[1]),
            row(0.0, 0.0, 1.0, n[2]),
            Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 1.0) / n[3],
        ]
    }
}

/// The arm at these joint angles on a base at this pose.
fn placed(base: [f64; 3], q_rad: &JointVector) -> Coordinates {
    let mut q = Coordinates::zeros();
    q.as_mut_slice()[..3].copy_from_slice(&base);
    q.as_mut_slice()[3..].copy_from_slice(q_rad.as_slice());
    q
}

/// The plant with perfect sensors, its air at rest unless asked for.
fn quiet(plant: &Plant, airy: bool) -> Plant {
    let mut plant = plant.clone();
    plant.disturbance = plant.disturbance.filter(|_| airy);
    let s = &mut plant.sensors;
    s.noises_mut().for_each(|std| *std = 0.0);
    for imperfection in [&mut s.mocap_dropout, &mut s.gyro_bias_walk_rad_s_sqrt_s, &mut s.encoder_step_rad] {
        *imperfection = 0.0;
    }
    plant
}
