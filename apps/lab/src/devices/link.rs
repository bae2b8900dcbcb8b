//! One arm link's electronics: relay, servo driver's supervision, encoder, current, torque sensor, battery.

use super::DeviceClock;
use crate::config::{ActiveFaults, FaultKind};
use crate::random::Random;
use fss_plant::{Instruments, JointCommand, Servo, Simulation};
use fss_wire::link::{Command, DATAGRAM_LEN, Faults, Key, LinkError, Mode, ReplayGuard, Telemetry, TorqueCount};
use std::net::SocketAddr;

/// A driver that hears no command for this long disables itself: five commands lost in a row.
pub const COMMAND_TIMEOUT_NS: u64 = 1_000_000_000;

/// A position target moves on for this long after its command, two periods of the commands.
const MOVE_ON_NS: u64 = 400_000_000;

/// Torque of the converter's largest count where the plant file gives no range (N m).
const TORQUE_RANGE_NM: f64 = 2.1;

/// Below this charge a link complains.
const LOW_CHARGE: f64 = 0.1;

/// Voltage that a link reports whose plant file gives it no battery (V).
const NOMINAL_BATTERY_V: f64 = 14.4;

/// A link.
#[derive(Debug, Clone)]
pub(crate) struct Link {
    /// From 0.
    index: usize,
    key: Key,
    clock: DeviceClock,
    guard: ReplayGuard,
    command: Command,
    received_ns: u64,
    /// Where the last accepted command came from: there telemetry goes.
    peer: Option<SocketAddr>,
    command_lost: bool,
    at_limit: bool,
    at_torque_limit: bool,
    period_ns: u64,
    next_ns: u64,
    reports: u64,
    /// What the encoder read when it got stuck.
    stuck_rad: Option<f64>,
}

impl Link {
    /// A link whose driver is off. It was switched on some time before the run, and its clock is its own.
    pub(crate) fn new(index: usize, key: Key, mut random: Random, rate_hz: f64, start_ns: u64) -> Self {
        let period_ns = (1e9 / rate_hz) as u64;
        let clock =
            DeviceClock { offset_ns: (random.uniform() * 1e12) as u64, drift: 5e-5 * (2.0 * random.uniform() - 1.0) };
        let next_ns = start_ns + (random.uniform() * period_ns as f64) as u64;
        Self {
            index,
            key,
            clock,
            guard: ReplayGuard::default(),
            command: Command::default(),
            received_ns: start_ns,
            peer: None,
            command_lost: false,
            at_limit: false,
            at_torque_limit: false,
            period_ns,
            next_ns,
            reports: 0,
            stuck_rad: None,
        }
    }

    /// Its number on the wire, from 1.
    fn number(&self) -> usize {
        self.index + 1
    }

    /// Takes a datagram, or says why not.
    pub(crate) fn receive(&mut self, now_ns: u64, from: SocketAddr, datagram: &[u8]) -> Result<(), LinkError> {
        let command = Command::decode(datagram, &self.key)?;
        if usize::from(command.link) != self.number() {
            return Err(LinkError::Link);
        }
        self.guard.admit(command.sequence)?;
        self.command = command;
        self.received_ns = now_ns;
        self.peer = Some(from);
        self.command_lost = false;
        Ok(())
    }

    /// Whether its gripper shall be closed, by the last command; it stays so when commands stop.
    pub(crate) fn closes_gripper(&self) -> bool {
        self.command.gripper
    }

    /// What the driver makes of the last command at `now_ns`.
    pub(crate) fn drive(&mut self, now_ns: u64, simulation: &Simulation, faults: ActiveFaults<'_>) -> Drive {
        let age_ns = now_ns.saturating_sub(self.received_ns);
        if self.command.mode != Mode::Disabled && age_ns > COMMAND_TIMEOUT_NS {
            self.command.mode = Mode::Disabled;
            self.command_lost = true;
        }
        let link = self.number();
        if faults.has(&FaultKind::LinkDead { link }) || faults.has(&FaultKind::DriverFault { link }) {
            self.command.mode = Mode::Disabled;
        }
        let physics = simulation.physics();
        let (Some(joint), Some(servo)) = (physics.joints.get(self.index), physics.servos.get(self.index)) else {
            return Drive::default();
        };
        let encoder_rad = simulation.encoder_rad(self.index);
        let (command, at_limit) = within_limit(&self.command, age_ns, encoder_rad, joint.limit_rad, servo);
        self.at_limit = at_limit;

        let max_torque_nm = f64::from(self.command.max_torque_nm).max(0.0);
        let by_torque_a = joint.max_torque_n_m.min(max_torque_nm) / joint.torque_constant_n_m_a;
        let most_a = servo.max_current_a.map_or(by_torque_a, |own| own.min(by_torque_a));
        let given_a = simulation.current_a(self.index);
        self.at_torque_limit = command != JointCommand::Free && given_a.abs() >= 0.999 * most_a;
        Drive { command, max_torque_nm }
    }

    /// The telemetry measured at `now_ns`, if some is due, and where it goes.
    pub(crate) fn sample(
        &mut self,
        now_ns: u64,
        start_ns: u64,
        simulation: &Simulation,
        instruments: &mut Instruments,
        faults: ActiveFaults<'_>,
    ) -> Option<(SocketAddr, [u8; DATAGRAM_LEN])> {
        if now_ns < self.next_ns {
            return None;
        }
        // Its own clock says when the period is over.
        self.next_ns += (self.period_ns as f64 / (1.0 + self.clock.drift)) as u64;
        let mut telemetry = self.measure(simulation, instruments, faults);
        if faults.has(&FaultKind::LinkDead { link: self.number() }) {
            return None;
        }
        self.reports += 1;
        telemetry.sequence = self.reports;
        telemetry.time_ns = self.clock.read(now_ns.saturating_sub(start_ns));
        self.peer.map(|peer| (peer, telemetry.encode()))
    }

    fn measure(
        &mut self,
        simulation: &Simulation,
        instruments: &mut Instruments,
        faults: ActiveFaults<'_>,
    ) -> Telemetry {
        let (i, link) = (self.index, self.number());
        let mut sample = instruments.link(simulation, i);
        if faults.has(&FaultKind::EncoderStuck { link }) {
            sample.q_rad = *self.stuck_rad.get_or_insert(sample.q_rad);
            sample.qd_rad_s = 0.0;
        } else {
            self.stuck_rad = None;
        }
        if sample.torque_saturated || faults.has(&FaultKind::TorqueSaturated { link }) {
            sample.torque_nm = f64::INFINITY;
        }
        let full_scale_nm = simulation.physics().sensors.nominal.torque_range_n_m.unwrap_or(TORQUE_RANGE_NM);
        let torque = TorqueCount::from_torque(sample.torque_nm, full_scale_nm);
        let charge = simulation.link_battery_charge(i).unwrap_or(1.0);
        let physics = simulation.physics();
        Telemetry {
            link: link as u8,
            mode: self.command.mode,
            position_rad: sample.q_rad as f32,
            velocity_rad_s: sample.qd_rad_s as f32,
            current_a: sample.current_a as f32,
            torque,
            faults: Faults::default()
                .with(Faults::DRIVER, faults.has(&FaultKind::DriverFault { link }))
                .with(Faults::COMMAND_LOST, self.command_lost)
                .with(Faults::TORQUE_SATURATED, torque.is_saturated())
                .with(Faults::JOINT_LIMIT, self.at_limit)
                .with(Faults::TORQUE_LIMIT, self.at_torque_limit)
                .with(Faults::BATTERY_LOW, charge < LOW_CHARGE)
                .with(Faults::GRIPPING, link == physics.joints.len() && simulation.is_grasping()),
            last_command: self.guard.last().unwrap_or(0),
            battery_v: simulation.link_battery_v(i).unwrap_or(NOMINAL_BATTERY_V) as f32,
            battery_charge: charge as f32,
            ..Telemetry::default()
        }
    }
}

/// What a driver does now.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Drive {
    /// The loop and its target.
    pub(crate) command: JointCommand,
    /// The largest torque that it may use (N m).
    pub(crate) max_torque_nm: f64,
}

/// A command that is `age_ns` old, kept from driving a joint at `encoder_rad` past its limit, and whether that changed it.
fn within_limit(asked: &Command, age_ns: u64, encoder_rad: f64, limit_rad: f64, servo: &Servo) -> (JointCommand, bool) {
    let [position, velocity, current] = [asked.position_rad, asked.velocity_rad_s, asked.current_a].map(f64::from);
    match asked.mode {
        Mode::Disabled => (JointCommand::Free, encoder_rad.abs() >= limit_rad),
        Mode::Position => {
            let target = position + velocity * (age_ns.min(MOVE_ON_NS) as f64 * 1e-9);
            let q_rad = target.clamp(-limit_rad, limit_rad);
            let follows = age_ns < MOVE_ON_NS && q_rad == target;
            let command = JointCommand::Position { q_rad, qd_rad_s: if follows { velocity } else { 0.0 } };
            (command, q_rad != target)
        }
        // The rate fades towards a limit, as if that were the target of the position loop.
        Mode::Velocity => {
            let gain = servo.position_gain_1_s;
            let (lowest, highest) = (gain * (-limit_rad - encoder_rad), gain * (limit_rad - encoder_rad));
            let qd_rad_s = velocity.max(lowest.min(0.0)).min(highest.max(0.0));
            (JointCommand::Velocity { qd_rad_s }, qd_rad_s != velocity)
        }
        Mode::Current => {
            let outwards = encoder_rad.abs() >= limit_rad && current * encoder_rad > 0.0;
            (JointCommand::Current { current_a: if outwards { 0.0 } else { current } }, outwards)
        }
    }
}
