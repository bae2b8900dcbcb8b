//! A laboratory in a few lines: an arm that follows sines on a base that floats, exactly, and sensors with white noise.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::large_types_passed_by_value)]

use fss_experiments::measured::{Drive, Joints, Many, Poses, Run};
use fss_multibody::{Coordinates, JointVector, Model, State};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

/// Standard deviations of the sensors.
#[derive(Clone, Copy)]
pub struct Noise {
    pub position_m: f64,
    pub angle_rad: f64,
    pub encoder_rad: f64,
    pub rate_rad_s: f64,
    pub torque_n_m: f64,
}

/// Sines of one joint: amplitude rad, frequency Hz, phase rad.
pub type Sines = Vec<(f64, f64, f64)>;

pub struct Lab {
    pub model: Model,
    pub noise: Noise,
    pub rng: ChaCha8Rng,
}

/// Of the base, then of the joints.
fn coordinates(base: Vector3<f64>, joints: &JointVector) -> Coordinates {
    let mut all = Coordinates::zeros();
    all.as_mut_slice()[..3].copy_from_slice(base.as_slice());
    all.as_mut_slice()[3..].copy_from_slice(joints.as_slice());
    all
}

impl Lab {
    pub fn new(model: Model, noise: Noise, seed: u64) -> Self {
        Self { model, noise, rng: ChaCha8Rng::seed_from_u64(seed) }
    }

    pub fn gauss(&mut self, sd: f64) -> f64 {
        sd * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut self.rng)
    }

    /// Two or three sines a joint within its stops.
    pub fn sines(&mut self) -> Vec<Sines> {
        let n = self.model.link_count();
        let mut joint = || -> Sines {
            [(0.7, 0.05..0.10), (0.25, 0.10..0.25)]
                .map(|(amplitude, band)| (amplitude, self.rng.random_range(band), self.rng.random_range(0.0..TAU)))
                .to_vec()
        };
        (0..n).map(|_| joint()).collect()
    }

    /// A run: joints in sines about `about_rad`.
    pub fn run(&mut self, about_rad: &[f64], sines: &[Sines], duration_s: f64, momentum: [f64; 3]) -> Run {
        let angle = |i: usize, t: f64| -> [f64; 3] {
            let mut out = [about_rad[i], 0.0, 0.0];
            for (a, f, p) in &sines[i] {
                let w = TAU * f;
                out[0] += a * ((w * t + p).sin() - p.sin());
                out[1] += a * w * (w * t + p).cos();
                out[2] -= a * w * w * (w * t + p).sin();
            }
            out
        };
        self.along(angle, duration_s, momentum)
    }

    /// A run in which joints move one after another, each by an angle in 3 s between rests of 3 s.
    pub fn steps(&mut self, steps: &[(usize, f64)], from_rad: &[f64]) -> Run {
        let angle = |i: usize, t: f64| -> [f64; 3] {
            let mut out = [from_rad[i], 0.0, 0.0];
            for (k, (_, by)) in steps.iter().enumerate().filter(|(_, (joint, _))| *joint == i) {
                // A quintic from rest to rest.
                let s = ((t - 3.0 - 6.0 * k as f64) / 3.0).clamp(0.0, 1.0);
                out[0] += by * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s);
                out[1] += by * 30.0 * (s * (1.0 - s)).powi(2) / 3.0;
                out[2] += by * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / 9.0;
            }
            out
        };
        self.along(angle, 3.0 + 6.0 * steps.len() as f64, [0.0; 3])
    }

    /// A run along angles, rates and accelerations of each joint: reports 5 times a second, motion capture 100 times.
    fn along(&mut self, angle: impl Fn(usize, f64) -> [f64; 3], duration_s: f64, momentum: [f64; 3]) -> Run {
        let n = self.model.link_count();
        let joints = |t: f64| {
            let mut out = [JointVector::zeros(); 3];
            for i in 0..n {
                for (k, v) in angle(i, t).into_iter().enumerate() {
                    out[k][i] = v;
                }
            }
            out
        };
        let model = self.model;
        let [px, py, spin] = momentum;
        // The angular momentum about the centre of mass stays; about the base's origin it does not.
        let twist = |base: Vector3<f64>, t: f64| {
            let [q, qd, _] = joints(t);
            let c = coordinates(base, &q);
            let arm = model.center_of_mass(&c) - base.xy();
            model.base_twist(&c, &qd, &Vector3::new(px, py, spin + arm.x * py - arm.y * px))
        };
        let (mut base, h) = (Vector3::new(0.1, -0.2, 0.3), 0.01);
        let mut run = Run { drive: Drive::Servo, ..Run::default() };
        let (mut bases, mut tips) = (Poses::default(), Poses::default());
        let (mut reports, mut command) = (Joints::default(), Many::default());
        for list in [&mut reports.q_rad, &mut reports.qd_rad_s, &mut reports.torque_nm, &mut command.values] {
            *list = vec![Vec::new(); n];
        }
        for k in 0..=(duration_s / h).round() as usize {
            let t = h * k as f64;
            let [q, qd, qdd] = joints(t);
            bases.t_s.push(t);
            bases.values.push(self.captured(base));
            tips.t_s.push(t);
            tips.values.push(self.captured(model.end_effector(&coordinates(base, &q))));
            if k % 5 == 0 {
                command.t_s.push(t);
                (0..n).for_each(|i| command.values[i].push(q[i]));
            }
            if k % 20 == 0 {
                let state = State { q: coordinates(base, &q), v: coordinates(twist(base, t), &qd) };
                let acc = model.prescribed_dynamics(&state, &qdd, &Vector3::zeros());
                let tau = model.inverse_dynamics(&state, &acc);
                reports.t_s.push(t);
                (0..n).for_each(|i| self.report(&mut reports, i, [q[i], qd[i], tau[3 + i]]));
            }
            // Runge and Kutta.
            let k1 = twist(base, t);
            let k2 = twist(base + 0.5 * h * k1, t + 0.5 * h);
            let k3 = twist(base + 0.5 * h * k2, t + 0.5 * h);
            let k4 = twist(base + h * k3, t + h);
            base += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
        (run.base_pose, run.ee_pose, run.joints, run.joint_command) =
            (Some(bases), Some(tips), Some(reports), Some(command));
        run
    }

    /// A pose as motion capture sees it.
    fn captured(&mut self, p: Vector3<f64>) -> [f64; 3] {
        let noise = self.noise;
        [p.x + self.gauss(noise.position_m), p.y + self.gauss(noise.position_m), p.z + self.gauss(noise.angle_rad)]
    }

    /// Adds angle, rate and torque of a joint as its sensors tell them.
    fn report(&mut self, reports: &mut Joints, joint: usize, [q, qd, tau]: [f64; 3]) {
        let noise = self.noise;
        reports.q_rad[joint].push(q + self.gauss(noise.encoder_rad));
        reports.qd_rad_s[joint].push(qd + self.gauss(noise.rate_rad_s));
        reports.torque_nm[joint].push(tau + self.gauss(noise.torque_n_m));
    }

    /// Six runs of 40 s.
    pub fn six_runs(&mut self) -> Vec<Run> {
        (0..6)
            .map(|_| {
                let about: Vec<f64> = (0..self.model.link_count()).map(|_| self.rng.random_range(-0.4..0.4)).collect();
                let sines = self.sines();
                let momentum = [self.gauss(0.02), self.gauss(0.02), self.gauss(0.005)];
                self.run(&about, &sines, 40.0, momentum)
            })
            .collect()
    }
}
