//! Valves shut when commands stop, whatever the last sample said.
#![allow(clippy::unwrap_used)]

use fss_bus::allocation::{Counting, allocations_in};
use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, Runner, Time};
use fss_messages::{ThrustersCommand, ThrustersState, topic};
use fss_thrusters::{DEAD_MAN_NS, DRIVER_QUEUE, Thrusters, VALVES_QUEUE, ValvesCommand};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

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
        self.bus.queue::<ValvesCommand>(VALVES_QUEUE, 1).unwrap().pop().unwrap().mask
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
fn a_restarted_sender_is_obeyed_and_its_predecessors_last_words_are_not() {
    let mut bench = Bench::new();
    for k in 0..100 {
        bench.send(1_000_000_000 + k * 5_000_000, 2);
    }
    assert_eq!(bench.mask_at(1_500_000_000), 0b100);
    bench.command = Output::open(&bench.bus, topic::THRUSTERS_COMMAND).unwrap();
    bench.send(1_505_000_000, 3);
    assert_eq!(bench.mask_at(1_505_000_000), 0b1000, "its sequence begins anew");
    bench.send(1_500_000_000, 2);
    assert_eq!(bench.mask_at(1_510_000_000), 0b1000, "this was published before");
}

#[test]
fn a_driver_that_does_not_answer_gets_valves_shut_until_it_does() {
    let mut bench = Bench::new();
    let reports = bench.bus.queue::<bool>(DRIVER_QUEUE, 1).unwrap();
    let mut state: Latest<ThrustersState> = InputPort::open(&bench.bus, topic::THRUSTERS_STATE).unwrap();
    let mut step = |works: bool, at_ns: u64| {
        reports.force_push(works);
        bench.send(at_ns, 2);
        let mask = bench.mask_at(at_ns);
        state.refresh();
        (mask, state.get().unwrap().mode)
    };
    assert_eq!(step(true, 1_000_000_000), (0b100, ThrustersState::ACTIVE));
    assert_eq!(step(false, 1_005_000_000), (0, ThrustersState::DRIVER_FAULT));
    assert_eq!(step(true, 1_010_000_000), (0b100, ThrustersState::ACTIVE));
}

#[test]
fn a_step_allocates_nothing() {
    let mut bench = Bench::new();
    for k in 0..100 {
        let now = Time::from_ns(1_000_000_000 + k * 5_000_000);
        if k < 50 {
            bench.send(now.ns(), 2);
        }
        assert_eq!(allocations_in(|| bench.runner.step(now)), 0, "step {k}");
        bench.runner.flush(now);
    }
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
    let mut state: Latest<ThrustersState> = InputPort::open(&bench.bus, topic::THRUSTERS_STATE).unwrap();
    for k in 0..10 {
        bench.send(k * 5_000_000, 1);
        bench.mask_at(k * 5_000_000);
    }
    state.refresh();
    assert_eq!(state.get().unwrap().open_time_ns[1], 45_000_000);
}
