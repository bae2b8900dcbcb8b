//! The service: telemetry in, state out; arm command in, link commands out.

use crate::command::Target;
use crate::receiver::{Receiver, Verdict};
use crate::{COMMAND_QUEUE, CommandDatagram, LinksConfig, TELEMETRY_QUEUE, TelemetryDatagram};
use core::fmt;
use fss_bus::{DeviceOutput, Feed, Latest, Output, Service, Time, inputs, outputs};
use fss_messages::{ArmCommand, Event, LinkDatagram, LinksState, MAX_LINKS, topic};
use fss_wire::link::{Command, Key, Mode, Telemetry};

/// A service that has just started and hears no arm controller says nothing to the links for this long, ns: if it is a
/// restart, they go on with what they do.
const SILENCE_AT_START_NS: u64 = 500_000_000;

inputs! {
    /// What the service reads.
    pub struct Inputs {
        /// Datagrams from the links.
        telemetry: Feed<TelemetryDatagram> = TELEMETRY_QUEUE,
        /// What the arm controller wants.
        arm: Latest<ArmCommand> = topic::ARM_COMMAND,
    }
}

outputs! {
    /// What the service says.
    pub struct Outputs {
        /// Datagrams to the links.
        commands: DeviceOutput<CommandDatagram> = COMMAND_QUEUE,
        /// What was received, datagram by datagram, so that a log holds all that the service consumed.
        telemetry: Output<LinkDatagram> = topic::LINKS_TELEMETRY,
        /// State of all joints.
        links: Output<LinksState> = topic::LINKS_STATE,
        /// What happened.
        events: Output<Event> = topic::EVENTS,
    }
}

/// One link as the service sees it.
#[derive(Clone, Copy, Debug, Default)]
struct Link {
    receiver: Receiver,
    /// When the next command is due; `None` before the first.
    next_command: Option<Time>,
    /// The angle to hold while the arm command is stale.
    hold_q_rad: Option<f64>,
    was_alive: bool,
    last_fault: u8,
}

/// Speaks with all links of one arm.
pub struct LinksService {
    config: LinksConfig,
    key: Key,
    links: [Link; MAX_LINKS],
    /// Sequence number of the last command to any link.
    sequence: u64,
    sent: [u64; MAX_LINKS],
    refused: u32,
    started: Option<Time>,
    holding: bool,
    /// What the arm controller last said of the gripper, which stays so when that falls silent.
    gripper: bool,
}

impl LinksService {
    /// Commands are signed with `key` and numbered from `first_sequence`, which must lie above all numbers that the links
    /// have seen: [`fss_wire::link::first_sequence`].
    pub fn new(config: LinksConfig, key: Key, first_sequence: u64) -> Self {
        Self {
            config,
            key,
            links: [Link::default(); MAX_LINKS],
            sequence: first_sequence,
            sent: [0; MAX_LINKS],
            refused: 0,
            started: None,
            holding: false,
            gripper: false,
        }
    }

    fn link_count(&self) -> usize {
        self.config.joints.len().min(MAX_LINKS)
    }

    fn receive(&mut self, now: Time, datagrams: &[TelemetryDatagram], events: &mut Output<Event>) {
        for datagram in datagrams {
            let accepted = Telemetry::decode(datagram.bytes()).ok().and_then(|telemetry| {
                let index = usize::from(telemetry.link).checked_sub(1).filter(|i| *i < self.link_count())?;
                self.accept(index, &telemetry, now, datagram.received_ns, events)
            });
            if accepted.is_none() {
                self.refused = self.refused.saturating_add(1);
            }
        }
    }

    fn accept(
        &mut self,
        i: usize,
        t: &Telemetry,
        now: Time,
        received_ns: u64,
        events: &mut Output<Event>,
    ) -> Option<()> {
        let early_ns = self.config.stamp_latency_ns + self.config.min_transit_ns;
        let link = &mut self.links[i];
        match link.receiver.accept(t, received_ns, early_ns) {
            Verdict::Refused => return None,
            Verdict::Restarted => say(events, now, Event::WARNING, format_args!("link {} has restarted", i + 1)),
            Verdict::Accepted => {}
        }
        let torque = t.torque.torque_nm(self.config.torque_range_nm);
        link.receiver.torque_nm = torque.unwrap_or(link.receiver.torque_nm);
        let fault = fault_of(t);
        for (bit, what) in FAULT_NAMES {
            if fault & bit != 0 && link.last_fault & bit == 0 {
                say(events, now, Event::WARNING, format_args!("link {}: {what}", i + 1));
            }
        }
        link.last_fault = fault;
        Some(())
    }

    /// Sends every link the command that is due.
    fn command(&mut self, now: Time, arm: &Latest<ArmCommand>, outputs: &mut Outputs) {
        let started = *self.started.get_or_insert(now);
        let fresh = arm.within(now, self.config.max_command_age_ns);
        self.gripper = fresh.map_or(self.gripper, |command| command.gripper != 0);
        if fresh.is_none() && self.links[0].next_command.is_none() && now.age_ns(started.ns()) < SILENCE_AT_START_NS {
            return;
        }
        if self.holding != fresh.is_none() {
            self.holding = fresh.is_none();
            let what = if self.holding { "no arm command: the joints hold" } else { "follows the arm controller" };
            let severity = if self.holding { Event::WARNING } else { Event::INFO };
            say(&mut outputs.events, now, severity, format_args!("{what}"));
        }
        let count = self.link_count();
        for i in 0..count {
            let period_ns = self.config.command_period_ns;
            let offset_ns = if self.config.stagger { period_ns * i as u64 / count as u64 } else { 0 };
            let due = *self.links[i].next_command.get_or_insert(now.plus_ns(offset_ns));
            if now < due {
                continue;
            }
            // A late step must not be made up by a burst.
            let next = due.plus_ns(period_ns);
            self.links[i].next_command = Some(if next > now { next } else { now.plus_ns(period_ns) });
            let target = self.target(i, now, fresh);
            self.send(i, now, target, &mut outputs.commands);
        }
    }

    fn target(&mut self, i: usize, now: Time, arm: Option<&ArmCommand>) -> Target {
        let limits = self.config.joints[i];
        let alive = self.links[i].receiver.is_alive(now.ns(), self.config.max_telemetry_age_ns);
        let measured = self.links[i].receiver.newest.filter(|_| alive);
        let q_now = measured.map(|newest| newest.angle_at(now.ns()));
        let wanted = arm.filter(|command| i < command.link_count as usize).and_then(|command| {
            let age_s = now.age_ns(command.stamp_ns) as f64 * 1e-9;
            Target::of(command, i, age_s)
        });
        let link = &mut self.links[i];
        let target = if let Some(target) = wanted {
            link.hold_q_rad = None;
            target
        } else {
            // A driver that is off stays off; one that is on holds where the command left it.
            let is_on = measured.is_some_and(|newest| newest.telemetry.mode != Mode::Disabled);
            link.hold_q_rad = link.hold_q_rad.or(q_now.filter(|_| is_on));
            Target::hold(link.hold_q_rad)
        };
        target.within(&limits, q_now)
    }

    fn send(&mut self, i: usize, now: Time, target: Target, commands: &mut DeviceOutput<CommandDatagram>) {
        self.sequence += 1;
        self.sent[i] = self.sequence;
        let command = Command {
            link: i as u8 + 1,
            sequence: self.sequence,
            time_ns: now.ns(),
            mode: target.mode,
            position_rad: target.q_rad as f32,
            velocity_rad_s: target.qd_rad_s as f32,
            current_a: target.current_a as f32,
            max_torque_nm: self.config.joints[i].torque_nm as f32,
            gripper: self.gripper && i + 1 == self.link_count(),
        };
        commands.send(CommandDatagram { link: i, bytes: command.encode(&self.key) });
    }

    fn state(&mut self, now: Time, events: &mut Output<Event>) -> LinksState {
        let count = self.link_count();
        let mut state = LinksState {
            stamp_ns: now.ns(),
            link_count: count as u32,
            refused: self.refused,
            command_sequence: self.sent,
            ..LinksState::default()
        };
        for i in 0..count {
            let link = &mut self.links[i];
            let alive = link.receiver.is_alive(now.ns(), self.config.max_telemetry_age_ns);
            if alive != link.was_alive {
                link.was_alive = alive;
                let (severity, what) = if alive { (Event::INFO, "answers") } else { (Event::ERROR, "is silent") };
                say(events, now, severity, format_args!("link {} {what}", i + 1));
            }
            state.alive[i] = u8::from(alive);
            state.lost[i] = link.receiver.lost;
            state.torque_nm[i] = link.receiver.torque_nm;
            let Some(newest) = &link.receiver.newest else { continue };
            let t = &newest.telemetry;
            state.q_rad[i] = newest.angle_at(now.ns());
            state.qd_rad_s[i] = t.velocity_rad_s.into();
            state.current_a[i] = t.current_a.into();
            state.measured_q_rad[i] = t.position_rad.into();
            state.measured_ns[i] = newest.measured_ns;
            state.age_ns[i] = now.age_ns(newest.measured_ns);
            state.battery_v[i] = t.battery_v.into();
            state.telemetry_sequence[i] = t.sequence;
            state.acknowledged_sequence[i] = t.last_command;
            // The wire and the sample number modes alike; a test holds them to it.
            state.driver_mode[i] = t.mode as u8;
            state.fault[i] = link.last_fault;
        }
        state
    }
}

/// Fault bits of a datagram, as the sample numbers them; the wire's are the same.
fn fault_of(t: &Telemetry) -> u8 {
    t.faults.0 | if t.torque.is_saturated() { LinksState::FAULT_TORQUE_SENSOR } else { 0 }
}

const FAULT_NAMES: [(u8, &str); 5] = [
    (LinksState::FAULT_DRIVER, "driver fault"),
    (LinksState::FAULT_TORQUE_SENSOR, "torque sensor saturated"),
    (LinksState::FAULT_JOINT_LIMIT, "joint at its limit"),
    (LinksState::FAULT_COMMAND_TIMEOUT, "commands stopped, driver shut off"),
    (LinksState::FAULT_BATTERY_LOW, "battery low"),
];

fn say(events: &mut Output<Event>, now: Time, severity: u8, message: fmt::Arguments<'_>) {
    events.publish(Event::new(now.ns(), LinksService::NAME, severity, message));
}

impl Service for LinksService {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "links";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        for datagram in inputs.telemetry.messages() {
            outputs.telemetry.publish(datagram.into());
        }
        self.receive(now, inputs.telemetry.messages(), &mut outputs.events);
        let state = self.state(now, &mut outputs.events);
        outputs.links.publish(state);
        self.command(now, &inputs.arm, outputs);
    }
}
