//! What the service calls a posture: an arm at rest, however the base moves; and that it asks the heap for nothing.
#![allow(clippy::unwrap_used)]

use fss_bus::allocation::{Counting, allocations_in};
use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, Runner, Time};
use fss_calibration::{Calibration, LEAST_FRAMES, LEAST_REPORTS, MovementBand};
use fss_messages::{LinksState, MissionState, MocapPose, Posture, topic};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const START_NS: u64 = 1_000_000_000;
/// The end-effector in the base frame.
const TIP: [f64; 3] = [0.9, 0.3, 0.5];

/// A stack of two links whose base drifts and turns.
struct World {
    service: Runner<Calibration>,
    base: Output<MocapPose>,
    tip: Output<MocapPose>,
    links: Output<LinksState>,
    mission: Output<MissionState>,
    posture: Latest<Posture>,
    k: u32,
}

impl World {
    fn new() -> Self {
        let bus = Bus::local();
        Self {
            service: Runner::new(Calibration::new(2, MovementBand(0.002)), &bus).unwrap(),
            base: Output::open(&bus, topic::MOCAP_BASE).unwrap(),
            tip: Output::open(&bus, topic::MOCAP_END_EFFECTOR).unwrap(),
            links: Output::open(&bus, topic::LINKS_STATE).unwrap(),
            mission: Output::open(&bus, topic::MISSION_STATE).unwrap(),
            posture: Latest::open(&bus, topic::CALIBRATION_POSTURE).unwrap(),
            k: 0,
        }
    }

    /// Flies 10 ms with the joints at `q`, the camera off by `spike`; a report every 0.2 s.
    fn tick(&mut self, q: f64, spike: f64) {
        self.k += 1;
        let now = Time::from_ns(START_NS + u64::from(self.k) * 10_000_000);
        let t_s = f64::from(self.k) * 0.01;
        let wobble = 1e-4 * (7.0 * t_s).sin();
        let (x, y, angle) = (0.1 * t_s, -0.05 * t_s, 3.0 + 0.2 * t_s);
        let (sin, cos) = angle.sin_cos();
        let pose = |x_m: f64, y_m: f64, theta_rad: f64| MocapPose {
            stamp_ns: now.ns() - 1_000_000,
            frame: self.k,
            x_m,
            y_m,
            theta_rad,
            ..MocapPose::default()
        };
        self.base.publish(pose(x, y, angle));
        let (along, across) = (TIP[0] + wobble + spike, TIP[1] - wobble);
        self.tip.publish(pose(x + cos * along - sin * across, y + sin * along + cos * across, angle + TIP[2]));
        self.mission.publish(MissionState {
            stamp_ns: now.ns(),
            state: MissionState::RUNNING,
            phase_start_ns: START_NS,
            ..MissionState::default()
        });
        if self.k.is_multiple_of(20) {
            let mut state = LinksState { stamp_ns: now.ns(), link_count: 2, ..LinksState::default() };
            for i in 0..2 {
                state.alive[i] = 1;
                state.measured_ns[i] = now.ns() - 5_000_000;
                state.measured_q_rad[i] = q + wobble;
            }
            self.links.publish(state);
        }
        self.base.flush(now);
        self.tip.flush(now);
        self.mission.flush(now);
        self.links.flush(now);
        let allocations = allocations_in(|| self.service.step(now));
        assert_eq!(allocations, 0, "step {}", self.k);
        self.service.flush(now);
        self.posture.refresh();
    }

    fn fly(&mut self, duration_s: f64, mut q: impl FnMut(f64) -> f64) {
        for k in 0..(duration_s * 100.0) as u32 {
            self.tick(q(f64::from(k) * 0.01), 0.0);
        }
    }
}

#[test]
fn an_arm_at_rest_on_a_turning_base_is_one_posture() {
    let mut world = World::new();
    world.fly(4.0, |_| 0.7);
    let posture = *world.posture.get().unwrap();
    assert_eq!((posture.number, posture.link_count), (1, 2));
    assert!(posture.reports >= LEAST_REPORTS && posture.frames >= LEAST_FRAMES, "{posture:?}");
    for (seen, truth) in posture.tip.iter().zip(TIP) {
        assert!((seen - truth).abs() < 2e-4, "{posture:?}");
    }
    assert!((posture.q_rad[1] - 0.7).abs() < 2e-4 && posture.scatter[0] < 2e-4, "{posture:?}");
    // The next posture is another one, and what lies between is none.
    world.fly(3.0, |t_s| 0.7 + 0.1 * t_s);
    world.fly(4.0, |_| 1.0);
    let next = *world.posture.get().unwrap();
    assert_eq!(next.number, 2);
    assert!(next.since_ns > posture.since_ns && (next.q_rad[0] - 1.0).abs() < 2e-4, "{next:?}");
}

#[test]
fn an_arm_that_creeps_or_rests_briefly_is_no_posture() {
    let mut world = World::new();
    world.fly(8.0, |t_s| 0.02 * t_s);
    world.fly(1.5, |_| 0.16);
    world.fly(8.0, |t_s| 0.16 - 0.02 * t_s);
    assert!(world.posture.get().is_none(), "{:?}", world.posture.get());
}

#[test]
fn a_spike_of_motion_capture_does_not_move_the_mean() {
    let mut world = World::new();
    for k in 0..400 {
        world.tick(0.7, if k % 90 == 89 { 0.5 } else { 0.0 });
    }
    let posture = world.posture.get().unwrap();
    assert!((posture.tip[0] - TIP[0]).abs() < 2e-4, "{posture:?}");
}
