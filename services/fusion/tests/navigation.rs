//! The navigation state against a known motion, through noise, latency, dropouts and nonsense.
#![allow(clippy::unwrap_used)]

use fss_bus::{Bus, InputPort, Latest, Queue, Runner, Time};
use fss_fusion::{Fusion, FusionConfig, GYRO_QUEUE, GyroPacket, MocapPacket, VICON_QUEUE};
use fss_messages::{NavState, topic};
use fss_plant::Plant;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const SEED: u64 = 20_261_121;
const STEP_NS: u64 = 5_000_000;
const START_NS: u64 = 1_000_000_000_000;
const LATENCY_NS: u64 = 8_000_000;
const GYRO_BIAS_RAD_S: f64 = 3e-3;

/// A base that is shaken by its arm and turns: x, y, theta and their rates at `t` seconds.
fn truth(t: f64) -> [f64; 6] {
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

/// What may happen to a motion capture frame.
type Fault = fn(t: f64, frame: u32, pose: [f64; 3]) -> Option<[f64; 3]>;

struct Flight {
    runner: Runner<Fusion>,
    vicon: Queue<MocapPacket>,
    gyro: Queue<GyroPacket>,
    nav: Latest<NavState>,
    rng: ChaCha8Rng,
    delayed: Vec<MocapPacket>,
}

impl Flight {
    fn new() -> Self {
        println!("seed {SEED}");
        let bus = Bus::local();
        let config = FusionConfig {
            mocap_latency_ns: LATENCY_NS,
            ..FusionConfig::from_plant(&Plant::default_laboratory().unwrap())
        };
        Self {
            runner: Runner::new(Fusion::new(config), &bus).unwrap(),
            vicon: bus.queue(VICON_QUEUE, 64).unwrap(),
            gyro: bus.queue(GYRO_QUEUE, 64).unwrap(),
            nav: Latest::open(&bus, topic::NAV_STATE).unwrap(),
            rng: ChaCha8Rng::seed_from_u64(SEED),
            delayed: Vec::new(),
        }
    }

    fn noise(&mut self, sd: f64) -> f64 {
        let n: f64 = StandardNormal.sample(&mut self.rng);
        sd * n
    }

    /// Flies for `seconds`; returns each step's time, state and truth.
    fn fly(&mut self, seconds: f64, gyro_works: bool, fault: Fault) -> Vec<(f64, NavState, [f64; 6])> {
        let mut seen = Vec::new();
        for k in 0..(seconds * 200.0) as u64 {
            let now_ns = START_NS + k * STEP_NS;
            let t = k as f64 * 5e-3;
            if k % 2 == 0 {
                let m = truth(t);
                let pose = [m[0] + self.noise(2e-4), m[1] + self.noise(2e-4), m[2] + self.noise(5e-4)];
                let pose = [pose[0], pose[1], pose[2].sin().atan2(pose[2].cos())];
                if let Some(pose) = fault(t, k as u32 / 2, pose) {
                    let poses = [Some(pose), None, None];
                    self.delayed.push(MocapPacket { received_ns: now_ns + LATENCY_NS, frame: k as u32 / 2 + 1, poses });
                }
            }
            if k % 2 == 1 && gyro_works {
                let rate_rad_s = truth(t)[5] + GYRO_BIAS_RAD_S + self.noise(1e-3);
                self.gyro.force_push(GyroPacket { received_ns: now_ns, rate_rad_s, valid: true });
            }
            while self.delayed.first().is_some_and(|p| p.received_ns <= now_ns) {
                self.vicon.force_push(self.delayed.remove(0));
            }
            self.runner.step(Time::from_ns(now_ns));
            self.runner.flush(Time::from_ns(now_ns));
            self.nav.refresh();
            seen.push((t, *self.nav.get().unwrap(), truth(t)));
        }
        seen
    }
}

/// RMS position error in m and heading error in degrees from `from` seconds on.
fn rms(seen: &[(f64, NavState, [f64; 6])], from: f64, to: f64) -> (f64, f64) {
    let window: Vec<_> = seen.iter().filter(|(t, ..)| (from..to).contains(t)).collect();
    let mean = |f: &dyn Fn(&NavState, &[f64; 6]) -> f64| {
        (window.iter().map(|(_, n, m)| f(n, m).powi(2)).sum::<f64>() / window.len() as f64).sqrt()
    };
    let heading = mean(&|n, m| {
        let e = n.theta_rad - m[2];
        e.sin().atan2(e.cos())
    });
    (mean(&|n, m| (n.x_m - m[0]).hypot(n.y_m - m[1])), heading.to_degrees())
}

#[test]
fn a_moving_base_is_known_to_a_fraction_of_a_millimetre() {
    let seen = Flight::new().fly(20.0, true, |_, _, pose| Some(pose));
    let (position_m, heading_deg) = rms(&seen, 1.0, 20.0);
    assert!(position_m < 3e-4 && heading_deg < 0.03, "{position_m} m, {heading_deg} deg");
    let last = seen.last().unwrap().1;
    assert_eq!(last.mode, NavState::TRACKING);
    assert!((last.gyro_bias_rad_s - GYRO_BIAS_RAD_S).abs() < 1e-3, "bias {}", last.gyro_bias_rad_s);
    assert!(last.theta_rad > 10.0, "the heading is unwrapped");
}

#[test]
fn the_stated_uncertainty_is_honest() {
    let seen = Flight::new().fly(20.0, true, |_, _, pose| Some(pose));
    let nees: f64 = seen
        .iter()
        .filter(|(t, ..)| *t > 2.0)
        .map(|(_, n, m)| ((n.x_m - m[0]) / n.std[0]).powi(2) + ((n.y_m - m[1]) / n.std[1]).powi(2))
        .sum::<f64>()
        / (2.0 * 18.0 * 200.0);
    assert!((0.3..1.8).contains(&nees), "mean squared error is {nees} times the stated variance");
}

#[test]
fn a_second_without_motion_capture_is_survived_on_gyro_and_model() {
    let seen = Flight::new().fly(12.0, true, |t, _, pose| (!(5.0..6.0).contains(&t)).then_some(pose));
    let (_, heading_deg) = rms(&seen, 5.0, 6.0);
    assert!(heading_deg < 0.3, "the gyro carries the heading: {heading_deg} deg");
    assert!(seen.iter().any(|(_, n, _)| n.mode == NavState::COASTING));
    let (position_m, _) = rms(&seen, 6.5, 12.0);
    assert!(position_m < 3e-4, "{position_m} m afterwards");
    assert_eq!(seen.last().unwrap().1.mode, NavState::TRACKING);
}

#[test]
fn jumps_and_zeros_of_the_tracker_do_not_move_the_estimate() {
    let fault: Fault = |t, frame, pose| match frame % 20 {
        _ if t < 1.0 => Some(pose),
        3 => Some([0.0; 3]),
        11 => Some([pose[0] + 0.3, pose[1], pose[2]]),
        _ => Some(pose),
    };
    let seen = Flight::new().fly(12.0, true, fault);
    let (position_m, heading_deg) = rms(&seen, 2.0, 12.0);
    assert!(position_m < 4e-4 && heading_deg < 0.03, "{position_m} m, {heading_deg} deg");
    assert!(seen.last().unwrap().1.rejected >= 45);
}

#[test]
fn a_tracker_that_was_moved_for_good_is_followed_again() {
    let seen = Flight::new().fly(8.0, true, |t, _, p| Some(if t < 3.0 { p } else { [p[0] + 0.5, p[1], p[2]] }));
    let last = seen.last().unwrap();
    assert!((last.1.x_m - last.2[0] - 0.5).abs() < 1e-3);
    assert_eq!(last.1.mode, NavState::TRACKING);
}

#[test]
fn without_a_gyro_motion_capture_alone_holds_the_state() {
    let seen = Flight::new().fly(10.0, false, |_, _, pose| Some(pose));
    let (position_m, heading_deg) = rms(&seen, 2.0, 10.0);
    assert!(position_m < 3e-4 && heading_deg < 0.06, "{position_m} m, {heading_deg} deg");
    assert_eq!(seen.last().unwrap().1.mode, NavState::NO_GYRO);
}

#[test]
fn a_state_without_motion_capture_for_long_is_called_lost() {
    let seen = Flight::new().fly(9.0, true, |t, _, pose| (t < 5.0).then_some(pose));
    assert_eq!(seen.last().unwrap().1.mode, NavState::LOST);
}
