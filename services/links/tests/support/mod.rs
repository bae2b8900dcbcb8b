//! An arm of ideal links behind a bad radio, and the service that speaks with it.
#![allow(dead_code, unreachable_pub)] // not every test file needs all of it

use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, Queue, Runner, Time};
use fss_links::{COMMAND_QUEUE, CommandDatagram, LinksConfig, LinksService, TELEMETRY_QUEUE, TelemetryDatagram};
use fss_messages::{ArmCommand, LinksState, topic};
use fss_plant::Plant;
use fss_wire::link::{Command, Faults, Key, Mode, ReplayGuard, Telemetry, TorqueCount};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub const MS: u64 = 1_000_000;
/// The service's period.
pub const PERIOD_NS: u64 = 20 * MS;
pub const LINKS: usize = 4;

pub fn key() -> Key {
    Key::new(b"thirty-two bytes that none knows").unwrap()
}

/// A link whose servo follows at once.
pub struct Link {
    pub number: u8,
    pub q_rad: f64,
    pub qd_rad_s: f64,
    pub mode: Mode,
    pub torque: TorqueCount,
    pub faults: Faults,
    /// Device time less host time.
    pub clock_ns: u64,
    pub sequence: u64,
    pub accepted: u64,
    guard: ReplayGuard,
    last_command_ns: Option<u64>,
    next_telemetry_ns: u64,
}

impl Link {
    fn new(i: usize) -> Self {
        Self {
            number: i as u8 + 1,
            q_rad: 0.1 * i as f64,
            qd_rad_s: 0.0,
            mode: Mode::Disabled,
            torque: TorqueCount::new(1000),
            faults: Faults::default(),
            clock_ns: 3_000_000_000 * (i as u64 + 1),
            sequence: 0,
            accepted: 0,
            guard: ReplayGuard::default(),
            last_command_ns: None,
            next_telemetry_ns: 37 * MS * i as u64,
        }
    }

    fn hear(&mut self, datagram: &[u8], now_ns: u64) {
        let Ok(command) = Command::decode(datagram, &key()) else { return };
        if command.link != self.number || self.guard.admit(command.sequence).is_err() {
            return;
        }
        self.accepted = command.sequence;
        self.last_command_ns = Some(now_ns);
        self.mode = command.mode;
        self.qd_rad_s = if self.mode == Mode::Disabled { 0.0 } else { command.velocity_rad_s.into() };
        if self.mode == Mode::Position {
            self.q_rad = command.position_rad.into();
        }
    }

    fn live(&mut self, dt_ns: u64, now_ns: u64) -> Option<[u8; 60]> {
        self.q_rad += self.qd_rad_s * dt_ns as f64 * 1e-9;
        if self.last_command_ns.is_some_and(|last| now_ns - last > 1000 * MS) {
            (self.mode, self.qd_rad_s) = (Mode::Disabled, 0.0);
            self.faults = self.faults.with(Faults::COMMAND_LOST, true);
        }
        if now_ns < self.next_telemetry_ns {
            return None;
        }
        self.next_telemetry_ns = now_ns + 200 * MS;
        self.sequence += 1;
        let telemetry = Telemetry {
            link: self.number,
            sequence: self.sequence,
            time_ns: now_ns + self.clock_ns,
            mode: self.mode,
            position_rad: self.q_rad as f32,
            velocity_rad_s: self.qd_rad_s as f32,
            torque: self.torque,
            faults: self.faults,
            last_command: self.accepted,
            battery_v: 14.4,
            ..Telemetry::default()
        };
        Some(telemetry.encode())
    }
}

/// What the radio does to datagrams; chances from 0 to 1.
#[derive(Clone, Copy, Default)]
pub struct Radio {
    pub loss: f64,
    pub repeat: f64,
    pub damage: f64,
    pub delay_ns: (u64, u64),
}

impl Radio {
    pub const PERFECT: Self = Self { loss: 0.0, repeat: 0.0, damage: 0.0, delay_ns: (MS, MS) };
    /// Loses, repeats and damages, and delays so much that datagrams overtake each other.
    pub const BAD: Self = Self { loss: 0.15, repeat: 0.2, damage: 0.05, delay_ns: (2 * MS, 250 * MS) };
}

struct Flying {
    arrival_ns: u64,
    bytes: [u8; 60],
    /// The link that will hear it; `None` for telemetry.
    to: Option<usize>,
}

/// Arm, radio and service on one clock.
pub struct World {
    pub links: Vec<Link>,
    pub radio: Radio,
    pub service: Runner<LinksService>,
    pub now: Time,
    /// What the arm controller says, if it lives.
    pub command: Option<ArmCommand>,
    /// Every command datagram that the service sent.
    pub sent: Vec<(u64, CommandDatagram)>,
    /// Links that are switched off.
    pub dead: [bool; LINKS],
    telemetry: Queue<TelemetryDatagram>,
    commands: Queue<CommandDatagram>,
    state: Latest<LinksState>,
    arm: Output<ArmCommand>,
    flying: Vec<Flying>,
    random: ChaCha8Rng,
}

impl World {
    pub fn new(radio: Radio, seed: u64) -> Self {
        Self::with(radio, seed, |_| {})
    }

    pub fn with(radio: Radio, seed: u64, adjust: impl FnOnce(&mut LinksConfig)) -> Self {
        let bus = Bus::local();
        let mut config = LinksConfig::new(&Plant::default_laboratory().unwrap());
        adjust(&mut config);
        Self {
            links: (0..LINKS).map(Link::new).collect(),
            radio,
            service: Runner::new(LinksService::new(config, key(), 1000), &bus).unwrap(),
            now: Time::from_ns(10_000 * MS),
            command: Some(ArmCommand { link_count: LINKS as u32, ..ArmCommand::default() }),
            sent: Vec::new(),
            dead: [false; LINKS],
            telemetry: bus.queue(TELEMETRY_QUEUE, 64).unwrap(),
            commands: bus.queue(COMMAND_QUEUE, 64).unwrap(),
            state: Latest::open(&bus, topic::LINKS_STATE).unwrap(),
            arm: Output::open(&bus, topic::ARM_COMMAND).unwrap(),
            flying: Vec::new(),
            random: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// The arm controller wants the angles `q` moving on at `qd`.
    pub fn want(&mut self, q: [f64; LINKS], qd: [f64; LINKS]) {
        let mut command = ArmCommand { mode: ArmCommand::POSITION, link_count: LINKS as u32, ..ArmCommand::default() };
        command.q_rad[..LINKS].copy_from_slice(&q);
        command.qd_rad_s[..LINKS].copy_from_slice(&qd);
        self.command = Some(command);
    }

    fn transmit(&mut self, bytes: [u8; 60], to: Option<usize>) {
        let copies = if self.random.random_bool(self.radio.repeat) { 2 } else { 1 };
        for _ in 0..copies {
            if self.random.random_bool(self.radio.loss) {
                continue;
            }
            let mut bytes = bytes;
            if self.random.random_bool(self.radio.damage) {
                bytes[self.random.random_range(0..60)] ^= 1 << self.random.random_range(0..8);
            }
            let (least, most) = self.radio.delay_ns;
            let delay_ns = if most > least { self.random.random_range(least..most) } else { least };
            self.flying.push(Flying { arrival_ns: self.now.ns() + delay_ns, bytes, to });
        }
    }

    fn deliver(&mut self) {
        let now_ns = self.now.ns();
        self.flying.sort_by_key(|f| f.arrival_ns);
        let arrived = self.flying.iter().take_while(|f| f.arrival_ns <= now_ns).count();
        for flying in self.flying.drain(..arrived) {
            match flying.to {
                Some(i) if !self.dead[i] => self.links[i].hear(&flying.bytes, now_ns),
                Some(_) => {}
                None => {
                    self.telemetry.force_push(TelemetryDatagram::new(flying.arrival_ns, &flying.bytes));
                }
            }
        }
    }

    /// One millisecond.
    fn tick(&mut self) {
        self.now = self.now.plus_ns(MS);
        self.deliver();
        for i in 0..LINKS {
            if self.dead[i] {
                continue;
            }
            if let Some(telemetry) = self.links[i].live(MS, self.now.ns()) {
                self.transmit(telemetry, None);
            }
        }
        if !self.now.ns().is_multiple_of(PERIOD_NS) {
            return;
        }
        if let Some(command) = &mut self.command {
            for i in 0..LINKS {
                command.q_rad[i] += command.qd_rad_s[i] * PERIOD_NS as f64 * 1e-9;
            }
            self.arm.publish(ArmCommand { stamp_ns: self.now.ns(), ..*command });
            self.arm.flush(self.now);
        }
        self.service.step(self.now);
        self.service.flush(self.now);
        while let Some(command) = self.commands.pop() {
            self.sent.push((self.now.ns(), command));
            self.transmit(command.bytes, Some(command.link));
        }
    }

    /// Lets time pass, looking at the state after each step of the service.
    pub fn watch(&mut self, seconds: f64, mut look: impl FnMut(&Self, &LinksState)) {
        for _ in 0..(seconds * 1e3) as u64 {
            self.tick();
            if self.now.ns().is_multiple_of(PERIOD_NS) {
                self.state.refresh();
                let state = *self.state.get().unwrap();
                look(self, &state);
            }
        }
    }

    /// Puts a datagram into the air right before the service.
    pub fn inject(&self, datagram: TelemetryDatagram) {
        self.telemetry.force_push(datagram);
    }

    /// Lets time pass and returns the last state.
    pub fn pass(&mut self, seconds: f64) -> LinksState {
        let mut last = LinksState::default();
        self.watch(seconds, |_, state| last = *state);
        last
    }

    /// Times at which link `i` was sent a command.
    pub fn times(&self, i: usize) -> Vec<u64> {
        self.sent.iter().filter(|(_, c)| c.link == i).map(|(at, _)| *at).collect()
    }

    /// The last command sent to link `i`.
    pub fn last_sent(&self, i: usize) -> Command {
        let (_, last) = self.sent.iter().rev().find(|(_, c)| c.link == i).unwrap();
        Command::decode(&last.bytes, &key()).unwrap()
    }
}
