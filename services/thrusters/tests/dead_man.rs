//! Valves shut when commands stop, whatever the last sample said.
#![allow(clippy::unwrap_used)]

use fss_bus::{Bus, Output, OutputPort, Runner, Time};
use fss_messages::{ThrustersCommand, ThrustersState, topic};
use fss_thrusters::{DEAD_MAN_NS, Thrusters, VALVES_QUEUE};

struct Bench {
    runner: Runner<Thrusters>,
    command: Output<ThrustersCommand>,
    bus: Bus,
}

impl Bench {
    fn new() -> Self {
        let bus = Bus::local();
        let runner = Runner::new(Thrusters::new(8), &bus).unwrap();
        Self { runner, command: Output::open(&bus, topic::THRUSTERS_COMMAND).unwrap(), bus }
    }

    fn send(&mut self, published_ns: u64, open: usize) {
        let mut sample = ThrustersCommand { stamp_ns: published_ns, valve_count: 8, ..ThrustersCommand::default() };
        sample.valves[open] = 1;
        self.command.publish(sample);
        self.command.flush(Time::from_ns(published_ns));
    }

    /// The mask that the driver gets from a step at `now_ns`.
    fn mask_at(&mut self, now_ns: u64) -> u16 {
        self.runner.step(Time::from_ns(now_ns));
        self.runner.flush(Time::from_ns(now_ns));
        self.bus.queue::<u16>(VALVES_QUEUE, 1).unwrap().pop().unwrap()
    }
}

#[test]
fn no_valve_opens_before_the_first_command() {
    assert_eq!(Bench::new().mask_at(1_000_000_000), 0);
}

#[test]
fn a_commanded_valve_opens_and_shuts_when_commands_stop() {
    let mut bench = Bench::new();
    bench.send(1_000_000_000, 2);
    assert_eq!(bench.mask_at(1_005_000_000), 0b100);
    assert_eq!(bench.mask_at(1_000_000_000 + DEAD_MAN_NS), 0b100);
    assert_eq!(bench.mask_at(1_000_000_001 + DEAD_MAN_NS), 0);
    assert_eq!(bench.mask_at(5_000_000_000), 0);
    bench.send(5_001_000_000, 3);
    assert_eq!(bench.mask_at(5_005_000_000), 0b1000, "a new command is obeyed again");
}

#[test]
fn a_stamp_from_the_future_keeps_no_valve_open() {
    let mut bench = Bench::new();
    bench.send(u64::MAX, 0);
    assert_eq!(bench.mask_at(1_000_000_000), 1);
    assert_eq!(bench.mask_at(1_000_000_001 + DEAD_MAN_NS), 0);
}

#[test]
fn a_command_that_was_old_on_arrival_opens_nothing() {
    let mut bench = Bench::new();
    bench.send(1_000_000_000, 5);
    assert_eq!(bench.mask_at(2_000_000_000), 0);
}

#[test]
fn a_valve_beyond_the_vehicles_own_is_never_opened() {
    let mut bench = Bench::new();
    bench.send(1_000_000_000, 9);
    assert_eq!(bench.mask_at(1_000_000_000), 0);
}

#[test]
fn the_state_counts_open_time() {
    let mut bench = Bench::new();
    let mut state: fss_bus::Latest<ThrustersState> =
        fss_bus::InputPort::open(&bench.bus, topic::THRUSTERS_STATE).unwrap();
    for k in 0..10 {
        bench.send(k * 5_000_000, 1);
        bench.mask_at(k * 5_000_000);
    }
    fss_bus::InputPort::refresh(&mut state);
    assert_eq!(state.get().unwrap().open_time_ns[1], 45_000_000);
}
