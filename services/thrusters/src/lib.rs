//! Owns the valves: applies commands, shuts them when commands stop.
//!
//! The dead-man: whatever happened to the sender, all valves shut when the last command is older than [`DEAD_MAN_NS`].
//! Which command counts:
//!
//! - only one that is new to this process: a sample that stays in its buffer is no command;
//! - its age runs from its publication or from its arrival, whichever is earlier: a stamp from the future keeps no valve
//!   open, and a command that was old on arrival opens none;
//! - one that was published before the last one is ignored: a dying sender's words do not undo its successor's;
//! - its sequence number is not asked: a restarted sender begins anew.
//!
//! Before the first command ([`ThrustersState::IDLE`]) and while the driver does not answer
//! ([`ThrustersState::DRIVER_FAULT`]) every mask is zero.

pub mod device;
mod program;

use fss_bus::{DeviceOutput, Feed, Latest, Output, Service, Time, inputs, outputs};
use fss_messages::{Event, MAX_THRUSTERS, ThrustersCommand, ThrustersState, topic};

/// Age of the last command at which all valves shut, ns. Should this process freeze just before, the valve box shuts
/// them 35 ms after the last word from it: either way within 100 ms of the command.
pub const DEAD_MAN_NS: u64 = 45_000_000;
/// What the valve driver is to set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ValvesCommand {
    /// Which valves are open; bit 0 is thruster 1.
    pub mask: u16,
    /// When the service said so, ns.
    pub at_ns: u64,
}

/// Queue to the valve driver: a [`ValvesCommand`] each step.
pub const VALVES_QUEUE: &str = "thrusters.valves";
/// Queue from the valve driver: whether it could set the last mask.
pub const DRIVER_QUEUE: &str = "thrusters.driver";

inputs! {
    /// What the service reads.
    pub struct Inputs {
        /// Which valves shall be open.
        command: Latest<ThrustersCommand> = topic::THRUSTERS_COMMAND,
        /// Whether the valve driver works; one that says nothing counts as working.
        driver: Feed<bool> = DRIVER_QUEUE,
    }
}

outputs! {
    /// What the service writes.
    pub struct Outputs {
        /// Masks to the driver, one each step.
        valves: DeviceOutput<ValvesCommand> = VALVES_QUEUE,
        /// What is commanded.
        state: Output<ThrustersState> = topic::THRUSTERS_STATE,
        /// The dead-man's word.
        events: Output<Event> = topic::EVENTS,
    }
}

/// The service.
pub struct Thrusters {
    valve_count: usize,
    state: ThrustersState,
    last_command: Option<Time>,
    last_step: Option<Time>,
    driver_works: bool,
}

impl Thrusters {
    /// For a vehicle with this many valves, at most [`MAX_THRUSTERS`].
    pub fn new(valve_count: usize) -> Self {
        let valve_count = valve_count.min(MAX_THRUSTERS);
        let state = ThrustersState { valve_count: valve_count as u32, ..ThrustersState::default() };
        Self { valve_count, state, last_command: None, last_step: None, driver_works: true }
    }

    fn count_open_time(&mut self, now: Time) {
        let since_ns = self.last_step.map_or(0, |last| now.age_ns(last.ns()));
        for (time_ns, &open) in self.state.open_time_ns.iter_mut().zip(&self.state.valves) {
            *time_ns += since_ns * u64::from(open);
        }
        self.last_step = Some(now);
    }

    fn take(&mut self, now: Time, command: &ThrustersCommand) {
        let published = Time::from_ns(command.published_ns.min(now.ns()));
        if self.last_command.is_some_and(|last| published < last) {
            return;
        }
        self.last_command = Some(published);
        self.state.command_stamp_ns = command.stamp_ns;
        for (i, valve) in self.state.valves.iter_mut().enumerate() {
            *valve = u8::from(i < self.valve_count && command.valves[i] != 0);
        }
    }
}

impl Service for Thrusters {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "thrusters";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        self.count_open_time(now);
        if let Some(command) = inputs.command.fresh() {
            self.take(now, command);
        }
        let age_ns = self.last_command.map_or(u64::MAX, |last| now.age_ns(last.ns()));
        self.driver_works = inputs.driver.messages().last().copied().unwrap_or(self.driver_works);
        let mode = match age_ns {
            _ if !self.driver_works => ThrustersState::DRIVER_FAULT,
            u64::MAX => ThrustersState::IDLE,
            0..=DEAD_MAN_NS => ThrustersState::ACTIVE,
            _ => ThrustersState::DEAD_MAN,
        };
        if mode != ThrustersState::ACTIVE {
            self.state.valves = [0; MAX_THRUSTERS];
        }
        if mode != self.state.mode {
            let (severity, message) = match mode {
                ThrustersState::DEAD_MAN => (Event::WARNING, format_args!("commands stopped: all valves shut")),
                ThrustersState::DRIVER_FAULT => {
                    (Event::ERROR, format_args!("the valve driver does not answer: all valves count as shut"))
                }
                ThrustersState::IDLE => (Event::INFO, format_args!("waits for commands")),
                _ => (Event::INFO, format_args!("commands arrive")),
            };
            outputs.events.publish(Event::new(now.ns(), Self::NAME, severity, message));
        }
        self.state.mode = mode;
        self.state.stamp_ns = now.ns();
        self.state.command_age_ns = age_ns;
        self.state.driver_works = u8::from(self.driver_works);
        outputs.state.publish(self.state);
        outputs.valves.send(ValvesCommand { mask: mask(&self.state.valves), at_ns: now.ns() });
    }
}

/// Bit 0 is the first valve.
fn mask(valves: &[u8; MAX_THRUSTERS]) -> u16 {
    valves.iter().enumerate().fold(0, |mask, (i, &open)| mask | (u16::from(open) << i))
}
