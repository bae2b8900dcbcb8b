//! Fusion with the devices' queues in a test's hand, and a motion that is known.
#![allow(dead_code, unreachable_pub)]

use fss_bus::{Bus, InputPort, Latest, Queue, Runner, Time};
use fss_fusion::{Fusion, FusionConfig, GYRO_QUEUE, GyroPacket, MOCAP_QUEUE, MocapPacket};
use fss_messages::{NavState, topic};
use fss_plant::Plant;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub const SEED: u64 = 20_261_121;
const STEP_NS: u64 = 5_000_000;
const START_NS: u64 = 1_000_000_000_000;
const LATENCY_NS: u64 = 8_000_000;
pub const GYRO_BIAS_RAD_S: f64 = 3e-3;

/// x, y, theta and their rates, m, rad, s.
pub type Motion = [f64; 6];

/// A base that is shaken by its arm and turns, at `t` seconds.
pub fn shaken(t: f64) -> Motion {
    let (w, v) = (0.5, 0.3);
    [
        0.3 * (w * t).sin() + 0.05 * t,
        0.2 * (v * t).cos(),
        3.0 + 0.4 * t + 0.2 * (w * t).sin(),
        0.3 * w * (w * t).cos() + 0.05,
        -0.2 * v * (v * t).sin(),
        0.4 + 0.2 * w * (w * t).cos(),
    ]
}

/// A base that stands still.
pub fn still(_: f64) -> Motion {
    [0.4, -0.3, 1.0, 0.0, 0.0, 0.0]
}

/// What may happen to the devices; by default nothing.
pub struct Faults {
    /// What the tracker sends instead of this pose.
    pub mocap: fn(t: f64, frame: u32, pose: [f64; 3]) -> Option<[f64; 3]>,
    /// What the gyro sends instead of this rate.
    pub gyro: fn(t: f64, rate_rad_s: f64) -> Option<f64>,
}

pub const NONE: Faults = Faults { mocap: |_, _, pose| Some(pose), gyro: |_, rate| Some(rate) };

/// One step: its time, the navigation state and the truth.
pub type Seen = (f64, NavState, Motion);

pub struct Flight {
    runner: Runner<Fusion>,
    mocap: Queue<MocapPacket>,
    gyro: Queue<GyroPacket>,
    nav: Latest<NavState>,
    rng: ChaCha8Rng,
    delayed: Vec<MocapPacket>,
}

impl Flight {
    pub fn new(seed: u64) -> Self {
        println!("seed {seed}");
        let bus = Bus::local();
        let config = FusionConfig {
            mocap_latency_ns: LATENCY_NS,
            gyro_latency_ns: 0,
            ..FusionConfig::from_plant(&Plant::default_laboratory().unwrap())
        };
        Self {
            runner: Runner::new(Fusion::new(config), &bus).unwrap(),
            mocap: bus.queue(MOCAP_QUEUE, 64).unwrap(),
            gyro: bus.queue(GYRO_QUEUE, 64).unwrap(),
            nav: Latest::open(&bus, topic::NAV_STATE).unwrap(),
            rng: ChaCha8Rng::seed_from_u64(seed),
            delayed: Vec::new(),
        }
    }

    fn noise(&mut self, sd: f64) -> f64 {
        let n: f64 = StandardNormal.sample(&mut self.rng);
        sd * n
    }

    /// Flies a motion for `seconds`; returns each step.
    pub fn fly(&mut self, seconds: f64, mut motion: impl FnMut(f64) -> Motion, faults: &Faults) -> Vec<Seen> {
        let mut seen = Vec::new();
        let mut last_heading = motion(0.0)[2];
        for k in 0..(seconds * 200.0) as u64 {
            let now_ns = START_NS + k * STEP_NS;
            let t = k as f64 * 5e-3;
            let m = motion(t);
            if k % 2 == 0 {
                let pose = [m[0] + self.noise(2e-4), m[1] + self.noise(2e-4), m[2] + self.noise(5e-4)];
                let pose = [pose[0], pose[1], pose[2].sin().atan2(pose[2].cos())];
                if let Some(pose) = (faults.mocap)(t, k as u32 / 2, pose) {
                    let poses = [Some(pose), None, None];
                    self.delayed.push(MocapPacket { received_ns: now_ns + LATENCY_NS, frame: k as u32 / 2 + 1, poses });
                }
            } else {
                // The mean since the last line.
                let rate_rad_s = (m[2] - last_heading) / 0.01 + GYRO_BIAS_RAD_S + self.noise(1e-3);
                last_heading = m[2];
                if let Some(rate_rad_s) = (faults.gyro)(t, rate_rad_s) {
                    self.gyro.force_push(GyroPacket { received_ns: now_ns, rate_rad_s, valid: true });
                }
            }
            while self.delayed.first().is_some_and(|p| p.received_ns <= now_ns) {
                self.mocap.force_push(self.delayed.remove(0));
            }
            self.runner.step(Time::from_ns(now_ns));
            self.runner.flush(Time::from_ns(now_ns));
            self.nav.refresh();
            seen.push((t, *self.nav.get().unwrap(), m));
        }
        seen
    }
}

/// RMS errors: position m, heading degrees, velocity m/s, rate rad/s.
#[derive(Debug)]
pub struct Rms {
    pub position_m: f64,
    pub heading_deg: f64,
    pub velocity_m_s: f64,
    pub rate_rad_s: f64,
}

/// Errors from `from` to `to` seconds.
pub fn rms(seen: &[Seen], from: f64, to: f64) -> Rms {
    let window: Vec<_> = seen.iter().filter(|(t, ..)| (from..to).contains(t)).collect();
    let mean = |f: &dyn Fn(&NavState, &Motion) -> f64| {
        (window.iter().map(|(_, n, m)| f(n, m).powi(2)).sum::<f64>() / window.len() as f64).sqrt()
    };
    let heading = |n: &NavState, m: &Motion| {
        let e = n.theta_rad - m[2];
        e.sin().atan2(e.cos()).to_degrees()
    };
    let rms = Rms {
        position_m: mean(&|n, m| (n.x_m - m[0]).hypot(n.y_m - m[1])),
        heading_deg: mean(&heading),
        velocity_m_s: mean(&|n, m| (n.vx_m_s - m[3]).hypot(n.vy_m_s - m[4])),
        rate_rad_s: mean(&|n, m| n.omega_rad_s - m[5]),
    };
    println!("{rms:?}");
    rms
}
