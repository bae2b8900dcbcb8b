//! Sensor fusion: VICON and gyro to the navigation state.
//!
//! Every packet of the devices goes out as a sample of its own (`/mocap/...`, `/gyro`), so that a log holds all that
//! the filter consumed. Motion capture is stamped with its receipt less the nominal latency; what arrives
//! late is fused at its own time. Repeats, exact zeros, frames that go backwards and outliers are refused; a dropout is
//! survived on gyro and model, and said.

pub mod device;
pub mod filter;
mod program;

use filter::{Filter, GATE_D2, Noise, Pose};
use fss_bus::{Feed, Output, Service, Time, inputs, outputs};
use fss_messages::{Event, GyroRate, MocapPose, NavState, topic};
use fss_plant::Plant;
use std::f64::consts::TAU;

/// Queue of motion capture frames.
pub const MOCAP_QUEUE: &str = "fusion.mocap";
/// Queue of gyro readings.
pub const GYRO_QUEUE: &str = "fusion.gyro";

/// Age of motion capture from which the filter coasts, ns.
const COAST_AFTER_NS: u64 = 60_000_000;
/// Age of motion capture from which the state is not to be trusted, ns.
const LOST_AFTER_NS: u64 = 2_000_000_000;
/// Age of the gyro from which it counts as missing, ns.
const GYRO_MISSING_AFTER_NS: u64 = 100_000_000;
/// After so many refused poses in a row that agree with one another the filter starts anew from motion capture.
const RESTART_AFTER_REFUSALS: u32 = 25;
/// Refused poses agree where they are no farther apart than a fast base goes between two frames: m, m, rad.
const AGREEING: [f64; 3] = [0.02, 0.02, 0.05];
/// After so many equal readings in a row the gyro counts as frozen: a real one is never without noise.
const FROZEN_AFTER_READINGS: u32 = 20;
/// The gyro's longest interval between two readings that are one measurement after the other, ns.
const LONGEST_GYRO_INTERVAL_NS: u64 = 20_000_000;
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
        mocap: Feed<MocapPacket> = MOCAP_QUEUE,
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

/// A character at 38400 baud, 10 bits, ns, and a line of 14 of them; a negative rate has one more, its sign.
const GYRO_CHARACTER_NS: u64 = 10 * 1_000_000_000 / 38_400;
const GYRO_LINE_NS: u64 = 14 * GYRO_CHARACTER_NS;

/// What the service is told about its sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusionConfig {
    /// Time from an event to the arrival of its motion capture, ns.
    pub mocap_latency_ns: u64,
    /// Time that a gyro's line takes on the serial port where its rate is not negative, ns.
    pub gyro_latency_ns: u64,
    /// What the filter assumes.
    pub noise: Noise,
}

impl FusionConfig {
    /// For a plant's sensors. A quiet base feels its thrusters, some 0.015 m/s2 on a vehicle with its arm; the reaction of
    /// a joint that begins to swing at 0.3 rad/s shakes it with some 0.2 m/s2 and 1 rad/s2 for a fraction of a second.
    pub fn from_plant(plant: &Plant) -> Self {
        let s = &plant.sensors;
        Self {
            mocap_latency_ns: (s.mocap_latency_s * 1e9).round() as u64,
            gyro_latency_ns: GYRO_LINE_NS,
            noise: Noise {
                mocap_position_m: s.mocap_position_m.max(1e-5),
                mocap_angle_rad: s.mocap_angle_rad.max(1e-5),
                gyro_rad_s: s.gyro_rad_s.max(1e-5),
                acceleration_m_s2_rt_hz: [0.003, 0.05],
                angular_acceleration_rad_s2_rt_hz: [0.003, 0.3],
                bias_walk_rad_s_rt_s: s.gyro_bias_walk_rad_s_sqrt_s.max(1e-6),
            },
        }
    }
}

/// A gyro reading that waits for motion capture to catch up with it; its time is the middle of the interval over which the
/// unit took the mean.
#[derive(Clone, Copy)]
struct Reading {
    time: Time,
    rate_rad_s: f64,
}

/// What the gyro said last, and how often it has said the same.
#[derive(Clone, Copy, Default)]
struct GyroWatch {
    received_ns: u64,
    rate_rad_s: f64,
    repeats: u32,
}

impl GyroWatch {
    /// Takes note of a reading; returns half the interval that it is the mean of, ns, and whether the gyro is alive. The
    /// interval is measured: the unit's clock is its own.
    fn note(&mut self, packet: &GyroPacket) -> (u64, bool) {
        let interval_ns = packet.received_ns.saturating_sub(self.received_ns).min(LONGEST_GYRO_INTERVAL_NS);
        self.repeats = if packet.rate_rad_s == self.rate_rad_s { self.repeats.saturating_add(1) } else { 0 };
        (self.received_ns, self.rate_rad_s) = (packet.received_ns, packet.rate_rad_s);
        (interval_ns / 2, self.repeats < FROZEN_AFTER_READINGS)
    }
}

/// The service.
pub struct Fusion {
    config: FusionConfig,
    filter: Option<Filter>,
    waiting: Vec<Reading>,
    last_frame: [Option<(u32, Pose)>; 3],
    last_mocap_ns: u64,
    /// Of the last reading that was used, 0 before the first.
    last_gyro_ns: u64,
    /// Motion capture's first pose, 0 before it.
    began_ns: u64,
    gyro_watch: GyroWatch,
    /// The last pose that was refused, and how many before it agree with it.
    refused: Option<(Pose, u32)>,
    restarted: bool,
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
            began_ns: 0,
            gyro_watch: GyroWatch::default(),
            refused: None,
            restarted: false,
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
        let sign_ns = if omega_rad_s < 0.0 { GYRO_CHARACTER_NS } else { 0 };
        let stamp_ns = received_ns.saturating_sub(self.config.gyro_latency_ns + sign_ns);
        let valid = u8::from(packet.valid);
        outputs.gyro.publish(GyroRate { stamp_ns, omega_rad_s, received_ns, valid, ..GyroRate::default() });
        let (half_interval_ns, alive) = self.gyro_watch.note(packet);
        if packet.valid && alive && self.waiting.len() < WAITING_READINGS {
            let time = Time::from_ns(stamp_ns.saturating_sub(half_interval_ns));
            self.waiting.push(Reading { time, rate_rad_s: omega_rad_s });
        }
    }

    /// Brings the horizon to `time`, with the gyro readings up to it.
    fn advance(&mut self, time: Time) {
        let due = self.waiting.partition_point(|r| r.time <= time);
        if let Some(filter) = &mut self.filter {
            fuse_rates(filter, &self.waiting[..due], &mut self.last_gyro_ns);
            filter.predict_to(time);
        }
        self.waiting.drain(..due);
    }

    fn fuse_pose(&mut self, time: Time, pose: Pose) {
        self.advance(time);
        let Some(filter) = &mut self.filter else { return self.start(time, pose) };
        let innovation = filter.innovation(pose);
        self.nav.innovation = innovation.pose;
        self.nav.innovation_d2 = innovation.d2;
        if innovation.d2 <= GATE_D2 {
            filter.update_pose(&innovation);
            self.refused = None;
            self.last_mocap_ns = time.ns();
            return;
        }
        self.nav.rejected += 1;
        let agrees = |last: Pose| pose.iter().zip(last).zip(AGREEING).all(|((a, b), most)| (a - b).abs() < most);
        let times = match self.refused {
            Some((last, times)) if agrees(last) => times + 1,
            _ => 1,
        };
        self.refused = Some((pose, times));
        if times >= RESTART_AFTER_REFUSALS {
            self.start(time, pose);
            self.restarted = true;
        }
    }

    /// Starts the filter at a pose. The heading stays unwrapped across a restart.
    fn start(&mut self, time: Time, [x, y, heading]: Pose) {
        let turns = ((self.nav.theta_rad - heading) / TAU).round();
        if self.began_ns == 0 {
            self.began_ns = time.ns();
        }
        self.filter = Some(Filter::start(time, [x, y, heading + TAU * turns], self.config.noise));
        self.refused = None;
        self.last_mocap_ns = time.ns();
    }

    /// The filter's estimate at `now`.
    fn predicted(&mut self, now: Time) -> Option<Filter> {
        let mut filter = self.filter?;
        fuse_rates(&mut filter, &self.waiting, &mut self.last_gyro_ns);
        filter.predict_to(now);
        Some(filter)
    }

    fn mode(&self, now: Time) -> u8 {
        // One of the two devices is always the first to be heard.
        let is_early = self.last_gyro_ns == 0 && now.age_ns(self.began_ns) < GYRO_MISSING_AFTER_NS;
        match (self.nav.mocap_age_ns, self.nav.gyro_age_ns) {
            _ if self.filter.is_none() || is_early => NavState::INITIALISING,
            (LOST_AFTER_NS.., _) => NavState::LOST,
            (COAST_AFTER_NS.., _) => NavState::COASTING,
            (_, GYRO_MISSING_AFTER_NS..) => NavState::NO_GYRO,
            _ => NavState::TRACKING,
        }
    }
}

/// Takes the filter through these readings; `used_ns` becomes the time of the last one that was not refused.
fn fuse_rates(filter: &mut Filter, readings: &[Reading], used_ns: &mut u64) {
    for reading in readings {
        filter.predict_to(reading.time);
        if filter.update_rate(reading.rate_rad_s) {
            *used_ns = reading.time.ns().max(*used_ns);
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
        for packet in inputs.mocap.messages() {
            self.take_mocap(packet, outputs);
        }
        self.advance(Time::from_ns(now.ns().saturating_sub(LONGEST_WAIT_NS)));

        self.nav.stamp_ns = now.ns();
        if let Some(filter) = self.predicted(now) {
            let [x, y, theta, vx, vy, omega, bias] = filter.state();
            let n = &mut self.nav;
            (n.x_m, n.y_m, n.theta_rad) = (x, y, theta);
            (n.vx_m_s, n.vy_m_s, n.omega_rad_s, n.gyro_bias_rad_s) = (vx, vy, omega, bias);
            n.std = filter.standard_deviations();
        }
        self.nav.mocap_age_ns = now.age_ns(self.last_mocap_ns);
        self.nav.gyro_age_ns = now.age_ns(self.last_gyro_ns);
        if std::mem::take(&mut self.restarted) {
            let message = format_args!("motion capture stays elsewhere: the filter starts anew from there");
            outputs.events.publish(Event::new(now.ns(), Self::NAME, Event::WARNING, message));
        }
        let mode = self.mode(now);
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
