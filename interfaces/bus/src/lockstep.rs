//! A service that is a process of its own, on a clock that is not: it is told when to step, and answers when it has.
//!
//! The leader ([`Leader`], in the launcher) joins the bus of the run with one that it shares with the follower alone. For each
//! step it hands over what has come on the follower's inputs, says when to step, waits for the answer, and hands on what was
//! published. The follower ([`follow`]) is the same [`Run`] as in real time. So nothing in it depends on when the two processes
//! happen to run.

use crate::realtime::this_core;
use crate::{Batch, Bus, BusError, InputPort, Latest, Output, OutputPort, RawBatch, RawOutput, RawTopic, Run, Time};
use fss_messages::topic::{EVENTS, STEPS, Topic};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long a follower may take for one step, and for its start, before it counts as one that never answers.
pub const PATIENCE: Duration = Duration::from_secs(10);
/// So long either side looks without a pause, where the other runs on another core.
const BUSY: Duration = Duration::from_micros(10);
/// So long it then gives way after each look, to the other side where that waits for a core: as long as steps are short, no process
/// is put to sleep between them.
const GIVING_WAY: Duration = Duration::from_millis(1);
/// Between two looks after that.
const NAP: Duration = Duration::from_micros(50);

fss_messages::define_messages! {
    zerocopy "fss_messages::private::zerocopy";
    package fss_bus;

    /// The word to step, at stamp_ns.
    Turn {
        /// number of the step, counted from 1
        turn: u64,
        /// when what the step publishes counts as published, ns
        flush_ns: u64,
        /// the core that the leader runs on
        core: u32,
        /// 1: only take what has come
        refresh_only: u8,
        /// zero
        reserved0: [u8; 3],
    }

    /// A step has ended, and what it published was sent.
    Done {
        /// number of the step; 0 when the service is ready for the first
        turn: u64,
        /// the core that the follower runs on
        core: u32,
        /// zero
        reserved0: u32,
    }
}

const TURN: Topic<Turn> = Topic::new("/lockstep/turn");
const DONE: Topic<Done> = Topic::new("/lockstep/done");

/// Steps a service as its leader says, until `stop` is set.
///
/// # Errors
/// Where a port cannot be opened.
pub fn follow(runner: &mut impl Run, bus: &Bus, stop: &AtomicBool) -> Result<(), BusError> {
    let mut turns = Latest::open(bus, TURN)?;
    let mut done = Output::open(bus, DONE)?;
    let mut answer = |turn, now| {
        done.publish(Done { turn, core: this_core(), ..Done::default() });
        done.flush(now);
    };
    answer(0, Time::default());
    let mut leaders_core = None;
    let mut asked = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        turns.refresh();
        let Some(turn) = turns.fresh().copied() else {
            pause(asked.elapsed(), leaders_core);
            continue;
        };
        leaders_core = Some(turn.core);
        let flush = Time::from_ns(turn.flush_ns);
        if turn.refresh_only != 0 {
            runner.refresh();
        } else {
            runner.step(Time::from_ns(turn.stamp_ns));
            runner.flush(flush);
        }
        answer(turn.turn, flush);
        asked = Instant::now();
    }
    Ok(())
}

/// Waits a little. A side that looked without a pause on the core that the other needs would only keep it from answering.
fn pause(waited: Duration, others_core: Option<u32>) {
    match waited {
        _ if waited < BUSY && others_core != Some(this_core()) => std::hint::spin_loop(),
        _ if waited < GIVING_WAY => std::thread::yield_now(),
        _ => std::thread::sleep(NAP),
    }
}

/// Leads one service.
pub struct Leader {
    /// From the run's bus to the follower.
    inputs: Vec<(RawBatch, RawOutput)>,
    /// From the follower to the run's bus.
    outputs: Vec<(RawBatch, RawOutput)>,
    turns: Output<Turn>,
    done: Latest<Done>,
    turn: u64,
}

impl Leader {
    /// Joins the bus of the run with `follower`, which is shared with the service alone; to be opened before that is started.
    ///
    /// # Errors
    /// Where a bus refuses a topic.
    pub fn open(run: &Bus, follower: &Bus, inputs: &[RawTopic], outputs: &[RawTopic]) -> Result<Self, BusError> {
        let join = |from: &Bus, to: &Bus, topic: &RawTopic| {
            Ok((RawBatch::open(from, topic, Batch::<Turn>::CAPACITY)?, RawOutput::open(to, topic)?))
        };
        // What every service says beside its outputs.
        let own = [RawTopic::of(STEPS), RawTopic::of(EVENTS)];
        Ok(Self {
            inputs: inputs.iter().map(|topic| join(run, follower, topic)).collect::<Result<_, BusError>>()?,
            outputs: outputs
                .iter()
                .chain(&own)
                .map(|topic| join(follower, run, topic))
                .collect::<Result<_, BusError>>()?,
            turns: Output::open(follower, TURN)?,
            done: Latest::open(follower, DONE)?,
            turn: 0,
        })
    }

    /// Waits until the service is ready for its first step; `ended` says why it never will be, once it knows.
    ///
    /// # Errors
    /// Says why there is no answer.
    pub fn wait(&mut self, mut ended: impl FnMut() -> Option<String>) -> Result<(), String> {
        let asked = Instant::now();
        loop {
            self.done.refresh();
            if self.done.fresh().is_some_and(|done| done.turn == self.turn) {
                return Ok(());
            }
            let waited = asked.elapsed();
            if waited >= GIVING_WAY
                && let Some(reason) = ended()
            {
                return Err(reason);
            }
            if waited >= PATIENCE {
                let what = if self.turn == 0 { "its start".to_owned() } else { format!("step {}", self.turn) };
                return Err(format!("it did not answer within {} s of {what}", PATIENCE.as_secs()));
            }
            pause(waited, self.done.get().map(|done| done.core));
        }
    }

    /// One step at `now`, whose outputs count as published at `flush`.
    ///
    /// # Errors
    /// Says why there is no answer.
    pub fn step(&mut self, now: Time, flush: Time, ended: impl FnMut() -> Option<String>) -> Result<(), String> {
        self.tell(Turn { stamp_ns: now.ns(), flush_ns: flush.ns(), ..Turn::default() }, ended)
    }

    /// Lets the service take what has come, without a step: as a process does before its first.
    ///
    /// # Errors
    /// Says why there is no answer.
    pub fn refresh(&mut self, ended: impl FnMut() -> Option<String>) -> Result<(), String> {
        self.tell(Turn { refresh_only: 1, ..Turn::default() }, ended)
    }

    fn tell(&mut self, turn: Turn, ended: impl FnMut() -> Option<String>) -> Result<(), String> {
        relay(&mut self.inputs)?;
        self.turn += 1;
        let flush = Time::from_ns(turn.flush_ns);
        self.turns.publish(Turn { turn: self.turn, core: this_core(), ..turn });
        if self.turns.flush(flush) > 0 {
            return Err("shared memory does not take the word to step".to_owned());
        }
        self.wait(ended)?;
        relay(&mut self.outputs)
    }
}

/// Hands on all that has come.
fn relay(topics: &mut [(RawBatch, RawOutput)]) -> Result<(), String> {
    for (from, to) in topics {
        from.refresh();
        if from.samples().any(|sample| !to.relay(sample)) {
            return Err("shared memory does not take its samples".to_owned());
        }
    }
    Ok(())
}
