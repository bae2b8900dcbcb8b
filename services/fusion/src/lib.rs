//! Sensor fusion: VICON and gyro to the navigation state.
//!
//! Every packet of the devices goes out as a sample of its own (`/mocap/...`, `/gyro`), so that a log holds all that
//! the filter consumed. Motion capture is stamped with its receipt less the nominal latency; what arrives
//! late is fused at its own time. Repeats, exact zeros, frames that go backwards and outliers are refused; a dropout is
//! survived on gyro and model, and said.

pub mod device;
pub mod filter;

use filter::{Filter, GATE_D2, Noise, Pose};
use fss_bus::{Feed, Output, Service, Time, inputs, outputs};
use fss_messages::{Event, GyroRate, MocapPose, NavState, topic};
use fss_plant::Plant;

/// Queue of motion capture frames.
pub const VICON_QUEUE: &str = "fusion.vicon";
/// Queue of gyro readings.
pub const GYRO_QUEUE: &str = "fusion.gyro";

/// Age of motion capture from which the filter coasts, ns.
const COAST_AFTER_NS: u64 = 60_000_000;
/// Age of motion capture from which the state is not to be trusted, ns.
const LOST_AFTER_NS: u64 = 2_000_000_000;
/// Age of the gyro from which it counts as missing, ns.
const GYRO_MISSING_AFTER_NS: u64 = 100_000_000;
/// After so many refused poses in a row the filter starts anew from motion capture.
const RESTART_AFTER_REFUSALS: u32 = 25;
/// Gyro readings that wait for motion capture at most this long, ns.
const LONGEST_WAIT_NS: u64 = 50_000_000;
/// Room for waiting gyro readings.
const WAITING_READINGS: usize = 64;

/// One motion capture frame, its objects by their role: base, end-effector, target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MocapPacket {
    /// When it arrived, ns.
    pub received_ns: u64,
    /// The tracker's frame number.
    pub frame: u32,
    /// Poses in the table frame; `None` for a body that the frame does not name, zeros for one that it does not see.
    pub poses: [Option<Pose>; 3],
}

/// One gyro reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroPacket {
    /// When it arrived, ns.
    pub received_ns: u64,
    /// Rate, rad/s.
    pub rate_rad_s: f64,
    /// Whether the unit calls it valid and it lies within the unit's linear range.
    pub valid: bool,
}

inputs! {
    /// What the service reads.
    pub struct Inputs {
        /// Motion capture.
        vicon: Feed<MocapPacket> = VICON_QUEUE,
        /// Gyro.
        gyro: Feed<GyroPacket> = GYRO_QUEUE,
    }
}

outputs! {
    /// What the service writes.
    pub struct Outputs {
        /// The base as the tracker sees it.
        mocap_base: Output<MocapPose> = topic::MOCAP_BASE,
        /// The end-effector as the tracker sees it.
        mocap_end_effector: Output<MocapPose> = topic::MOCAP_END_EFFECTOR,
        /// The target as the tracker sees it.
        mocap_target: Output<MocapPose> = topic::MOCAP_TARGET,
        /// The gyro's readings.
        gyro: Output<GyroRate> = topic::GYRO,
        /// The estimate.
        nav: Output<NavState> = topic::NAV_STATE,
        /// Changes of mode.
        events: Output<Event> = topic::EVENTS,
    }
}

/// What the service is told about its sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusionConfig {
    /// Time from an event to the arrival of its motion capture, ns.
    pub mocap_latency_ns: u64,
    /// What the filter assumes.
    pub noise: Noise,
}

impl FusionConfig {
    /// For a plant's sensors. The unknown accelerations are those of the arm's reaction and of thrusters: a joint of
    /// this arm may shake the base with some 0.1 m/s2 and 0.5 rad/s2 for a fraction of a second.
    pub fn from_plant(plant: &Plant) -> Self {
        let s = &plant.sensors;
        Self {
            mocap_latency_ns: (s.mocap_latency_s * 1e9).round() as u64,
            noise: Noise {
                mocap_position_m: s.mocap_position_m.max(1e-5),
                mocap_angle_rad: s.mocap_angle_rad.max(1e-5),
                gyro_rad_s: s.gyro_rad_s.max(1e-5),
                acceleration_m_s2_rt_hz: 0.004,
                angular_acceleration_rad_s2_rt_hz: 0.03,
                bias_walk_rad_s_rt_s: s.gyro_bias_walk_rad_s_sqrt_s.max(1e-6),
            },
        }
    }
}

/// A gyro reading that waits for motion capture to catch up with it.
#[derive(Clone, Copy)]
struct Reading {
    time: Time,
    rate_rad_s: f64,
}

/// The service.
pub struct Fusion {
    config: FusionConfig,
    filter: Option<Filter>,
    waiting: Vec<Reading>,
    last_frame: [Option<(u32, Pose)>; 3],
    last_mocap_ns: u64,
    last_gyro_ns: u64,
    refused_in_a_row: u32,
    nav: NavState,
}

impl Fusion {
    /// A filter that waits for its first pose.
    pub fn new(config: FusionConfig) -> Self {
        Self {
            config,
            filter: None,
            waiting: Vec::with_capacity(WAITING_READINGS),
            last_frame: [None; 3],
            last_mocap_ns: 0,
            last_gyro_ns: 0,
            refused_in_a_row: 0,
            nav: NavState { mode: NavState::INITIALISING, ..NavState::default() },
        }
    }

    /// What a pose of a body is worth, by the frames before it.
    fn quality(&mut self, body: usize, frame: u32, pose: Pose) -> u8 {
        let last = self.last_frame[body].replace((frame, pose));
        match last {
            _ if pose[0] == 0.0 && pose[1] == 0.0 => MocapPose::OCCLUDED,
            Some((last_frame, _)) if frame < last_frame && last_frame - frame < u32::MAX / 2 => MocapPose::OUT_OF_ORDER,
            Some((last_frame, last_pose)) if frame == last_frame || pose == last_pose => MocapPose::REPEATED,
            _ => MocapPose::VALID,
        }
    }

    fn take_mocap(&mut self, packet: &MocapPacket, outputs: &mut Outputs) {
        let stamp_ns = packet.received_ns.saturating_sub(self.config.mocap_latency_ns);
        let ports = [&mut outputs.mocap_base, &mut outputs.mocap_end_effector, &mut outputs.mocap_target];
        for (body, (port, pose)) in ports.into_iter().zip(packet.poses).enumerate() {
            let Some(pose) = pose else { continue };
            let quality = self.quality(body, packet.frame, pose);
            let [x_m, y_m, theta_rad] = pose;
            let (frame, received_ns) = (packet.frame, packet.received_ns);
            port.publish(MocapPose {
                stamp_ns,
                x_m,
                y_m,
                theta_rad,
                received_ns,
                frame,
                quality,
                ..MocapPose::default()
            });
            if body == 0 && quality == MocapPose::VALID {
                self.fuse_pose(Time::from_ns(stamp_ns), pose);
            }
        }
    }

    fn take_gyro(&mut self, packet: &GyroPacket, outputs: &mut Outputs) {
        let (omega_rad_s, received_ns) = (packet.rate_rad_s, packet.received_ns);
        let (stamp_ns, valid) = (received_ns, u8::from(packet.valid));
        outputs.gyro.publish(GyroRate { stamp_ns, omega_rad_s, received_ns, valid, ..GyroRate::default() });
        if packet.valid && self.waiting.len() < WAITING_READINGS {
            self.last_gyro_ns = received_ns;
            self.waiting.push(Reading { time: Time::from_ns(received_ns), rate_rad_s: omega_rad_s });
        }
    }

    /// Brings the horizon to `time`, with the gyro readings up to it.
    fn advance(&mut self, time: Time) {
        let Some(filter) = &mut self.filter else {
            self.waiting.retain(|r| r.time > time);
            return;
        };
        let due = self.waiting.partition_point(|r| r.time <= time);
        for reading in self.waiting.drain(..due) {
            filter.predict_to(reading.time);
            filter.update_rate(reading.rate_rad_s);
        }
        filter.predict_to(time);
    }

    fn fuse_pose(&mut self, time: Time, pose: Pose) {
        self.advance(time);
        let restart = self.refused_in_a_row >= RESTART_AFTER_REFUSALS;
        let filter = match &mut self.filter {
            Some(filter) if !restart => filter,
            slot => {
                // The heading stays unwrapped across a restart.
                let turn = self.nav.theta_rad - pose[2];
                let pose = [pose[0], pose[1], pose[2] + std::f64::consts::TAU * (turn / std::f64::consts::TAU).round()];
                *slot = Some(Filter::start(time, pose, self.config.noise));
                self.refused_in_a_row = 0;
                self.last_mocap_ns = time.ns();
                return;
            }
        };
        let innovation = filter.innovation(pose);
        self.nav.innovation = innovation.pose;
        self.nav.innovation_d2 = innovation.d2;
        if innovation.d2 > GATE_D2 {
            self.refused_in_a_row += 1;
            self.nav.rejected += 1;
        } else {
            filter.update_pose(&innovation);
            self.refused_in_a_row = 0;
            self.last_mocap_ns = time.ns();
        }
    }

    /// The filter's estimate at `now`.
    fn predicted(&self, now: Time) -> Option<Filter> {
        let mut filter = self.filter?;
        for reading in &self.waiting {
            filter.predict_to(reading.time);
            filter.update_rate(reading.rate_rad_s);
        }
        filter.predict_to(now);
        Some(filter)
    }

    fn mode(&self) -> u8 {
        match (self.nav.mocap_age_ns, self.nav.gyro_age_ns) {
            _ if self.filter.is_none() => NavState::INITIALISING,
            (LOST_AFTER_NS.., _) => NavState::LOST,
            (COAST_AFTER_NS.., _) => NavState::COASTING,
            (_, GYRO_MISSING_AFTER_NS..) => NavState::NO_GYRO,
            _ => NavState::TRACKING,
        }
    }
}

impl Service for Fusion {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "fusion";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        for packet in inputs.gyro.messages() {
            self.take_gyro(packet, outputs);
        }
        for packet in inputs.vicon.messages() {
            self.take_mocap(packet, outputs);
        }
        self.advance(Time::from_ns(now.ns().saturating_sub(LONGEST_WAIT_NS)));

        self.nav.stamp_ns = now.ns();
        self.nav.mocap_age_ns = now.age_ns(self.last_mocap_ns);
        self.nav.gyro_age_ns = now.age_ns(self.last_gyro_ns);
        if let Some(filter) = self.predicted(now) {
            let [x, y, theta, vx, vy, omega, bias] = filter.state();
            let n = &mut self.nav;
            (n.x_m, n.y_m, n.theta_rad) = (x, y, theta);
            (n.vx_m_s, n.vy_m_s, n.omega_rad_s, n.gyro_bias_rad_s) = (vx, vy, omega, bias);
            n.std = filter.standard_deviations();
        }
        let mode = self.mode();
        if mode != self.nav.mode {
            let (severity, word) = match mode {
                NavState::TRACKING => (Event::INFO, "tracks with gyro and motion capture"),
                NavState::COASTING => (Event::WARNING, "motion capture is missing: coasts on gyro and model"),
                NavState::LOST => {
                    (Event::ERROR, "motion capture is missing for too long: the state is not to be trusted")
                }
                NavState::NO_GYRO => (Event::WARNING, "the gyro is missing or faulty: motion capture alone"),
                _ => (Event::INFO, "waits for motion capture"),
            };
            outputs.events.publish(Event::new(now.ns(), Self::NAME, severity, format_args!("{word}")));
            self.nav.mode = mode;
        }
        outputs.nav.publish(self.nav);
    }
}
