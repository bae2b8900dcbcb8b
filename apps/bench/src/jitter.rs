//! Wake-up jitter of the loop that runs every service, against a bare `clock_nanosleep` loop, in turns.
//!
//! Each turn has percentiles of its own. A ratio is the median of what it is in the turns, one loop's beside the other's that ran
//! next to it: hosts have calmer and busier seconds, and where they stall a few times in a run, it is chance which loop's turn
//! that hits. What a loop does itself, it does in every turn.

use super::distribution::{Distribution, Percentiles};
use fss_bus::launch::{Launch, Schedule};
use fss_bus::{Bus, Runner, Service, SharedConfig, Time, inputs, outputs, process, realtime, remove_dead_nodes};
use miette::{IntoDiagnostic, Result, miette};
use serde::Serialize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A turn of either loop, s.
const TURN_S: f64 = 1.0;
/// So long a turn runs before it counts, s: our loop opens its ports anew in each, whose memory is touched for the first time then.
const WARM_UP_S: f64 = 0.2;

/// What the benchmark found.
#[derive(Serialize)]
pub(crate) struct JitterTimes {
    format: &'static str,
    rate_hz: f64,
    real_time: bool,
    missing: Vec<String>,
    turns: usize,
    /// How late the service's step begins: the medians of the turns' percentiles, and the largest of all, microseconds.
    ours_us: Percentiles,
    /// How late the bare loop wakes, the same way, microseconds.
    bare_us: Percentiles,
    /// Ours over the bare loop's: the medians of the turns' ratios.
    ratio: Ratios,
    cycles: Cycles,
}

#[derive(Serialize)]
struct Ratios {
    p50: f64,
    p90: f64,
    p99: f64,
    p99_9: f64,
}

/// Steps that began, and boundaries at which none did.
#[derive(Default, Serialize)]
struct Cycles {
    ours: u64,
    bare: u64,
    ours_missed: u64,
    bare_missed: u64,
}

inputs! {
    /// None.
    struct NoInputs {}
}

outputs! {
    /// None.
    struct NoOutputs {}
}

/// A service that does nothing but look at the clock.
struct Clock {
    /// Of the turn that runs.
    times: Distribution,
    turns_us: Vec<Percentiles>,
    count: u64,
    last: Option<Time>,
    period_ns: u64,
    missed: u64,
    /// Steps until the turn counts, and until it is over.
    warming: u64,
    left: u64,
    stop: Arc<AtomicBool>,
}

impl Clock {
    fn begin_turn(&mut self, rate_hz: f64) {
        (self.warming, self.left) = ((rate_hz * WARM_UP_S) as u64, (rate_hz * TURN_S) as u64);
        self.last = None;
        self.stop.store(false, Ordering::Relaxed);
    }

    fn end_turn(&mut self) {
        self.turns_us.push(self.times.percentiles(1e-3));
        self.times.clear();
    }

    fn tick(&mut self, boundary: Time) {
        let Ok(now) = realtime::now() else { return };
        if self.warming > 0 {
            self.warming -= 1;
            return;
        }
        self.times.record(now.age_ns(boundary.ns()).max(1));
        let passed_ns = self.last.map_or(self.period_ns, |last| boundary.age_ns(last.ns()));
        self.missed += (passed_ns / self.period_ns).saturating_sub(1);
        self.last = Some(boundary);
        self.count += 1;
        self.left = self.left.saturating_sub(1);
        if self.left == 0 {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

impl Service for Clock {
    type Inputs = NoInputs;
    type Outputs = NoOutputs;
    const NAME: &'static str = "jitter";

    fn step(&mut self, now: Time, _inputs: &NoInputs, _outputs: &mut NoOutputs) {
        self.tick(now);
    }
}

/// Runs both loops for `seconds` each.
pub(crate) fn measure(rate_hz: f64, priority: u8, core: usize, seconds: f64) -> Result<JitterTimes> {
    let schedule = schedule(rate_hz, priority, core)?;
    let prefix = format!("fssbench_{}_", std::process::id());
    // On a thread of its own: the priority goes with it.
    let turns = (seconds / TURN_S).ceil().max(1.0) as u64;
    let times = std::thread::spawn(move || {
        let outcome = both(&schedule, &prefix, turns);
        let _nothing_left = remove_dead_nodes(&prefix, true);
        outcome
    });
    times.join().map_err(|_| miette!("the benchmark's thread failed"))?
}

fn both(schedule: &Schedule, prefix: &str, turns: u64) -> Result<JitterTimes> {
    let rate_hz = *schedule.rate_hz.get_ref();
    let clock = || -> Result<Clock> {
        let (period_ns, stop) = (schedule.period_ns(), Arc::default());
        let (times, turns_us) = (Distribution::new()?, Vec::new());
        Ok(Clock { times, turns_us, count: 0, last: None, period_ns, missed: 0, warming: 0, left: 0, stop })
    };
    let granted = realtime::enter(schedule);
    let bus = Bus::shared(&SharedConfig { node: "bench".to_owned(), prefix: prefix.to_owned() }).into_diagnostic()?;
    let mut ours = Runner::new(clock()?, &bus).into_diagnostic()?;
    let mut bare = clock()?;
    for turn in 0..turns {
        for clock in [&mut ours.service, &mut bare] {
            clock.begin_turn(rate_hz);
        }
        let stop = ours.service.stop.clone();
        // Each is first as often as second.
        if turn % 2 == 0 {
            run_bare(&mut bare)?;
        }
        process::run(&mut ours, &bus, schedule, 1, &stop, || ()).into_diagnostic()?;
        if turn % 2 == 1 {
            run_bare(&mut bare)?;
        }
        for clock in [&mut ours.service, &mut bare] {
            clock.end_turn();
        }
    }
    let (ours, bare) = (ours.service, bare);
    let (ours_us, bare_us) = (Percentiles::median(&ours.turns_us), Percentiles::median(&bare.turns_us));
    let ratios: Vec<Percentiles> =
        ours.turns_us.iter().zip(&bare.turns_us).map(|(ours, bare)| ours.over(bare)).collect();
    let Percentiles { p50, p90, p99, p99_9, .. } = Percentiles::median(&ratios);
    Ok(JitterTimes {
        format: "fss-bench-jitter/1",
        rate_hz,
        real_time: granted.real_time,
        missing: granted.missing,
        turns: ours.turns_us.len(),
        ratio: Ratios { p50, p90, p99, p99_9 },
        ours_us,
        bare_us,
        cycles: Cycles { ours: ours.count, bare: bare.count, ours_missed: ours.missed, bare_missed: bare.missed },
    })
}

/// What cyclictest does: sleep until an absolute time, look how late it is. It sleeps until the same boundaries as our loop, the
/// multiples of the period: what else wakes there, the kernel's tick first of all, disturbs both.
fn run_bare(clock: &mut Clock) -> Result<()> {
    let period_ns = clock.period_ns;
    while !clock.stop.load(Ordering::Relaxed) {
        let now = realtime::now().into_diagnostic()?;
        let boundary = Time::from_ns((now.ns() / period_ns + 1) * period_ns);
        realtime::sleep_until(boundary);
        clock.tick(boundary);
    }
    Ok(())
}

/// A schedule as a launch file gives it.
fn schedule(rate_hz: f64, priority: u8, core: usize) -> Result<Schedule> {
    let text = format!(
        "[devices]\nvicon = '127.0.0.1:1'\ngyro = '-'\nvalves = '-'\nlinks_local = '127.0.0.1:1'\nlinks = []\n\
         [[service]]\nname = 'jitter'\nrate_hz = {rate_hz:?}\npriority = {priority}\ncore = {core}\n"
    );
    let launch = Launch::parse(&text, &["jitter"]).into_diagnostic()?;
    launch.schedule("jitter").cloned().ok_or_else(|| miette!("the schedule is empty"))
}

impl JitterTimes {
    /// The table for a person.
    pub(crate) fn print(&self) {
        say!("{:<16} {:>8} {:>8} {:>8} {:>8}   late, us, at {} Hz", "", "p50", "p90", "p99", "p99.9", self.rate_hz);
        for (name, t) in [("our loop", self.ours_us), ("clock_nanosleep", self.bare_us)] {
            say!("{name:<16} {:>8.1} {:>8.1} {:>8.1} {:>8.1}", t.p50, t.p90, t.p99, t.p99_9);
        }
        let r = &self.ratio;
        say!("{:<16} {:>8.2} {:>8.2} {:>8.2} {:>8.2}", "ratio", r.p50, r.p90, r.p99, r.p99_9);
        let c = &self.cycles;
        say!(
            "{} and {} cycles, {} and {} missed, at most {:.0} and {:.0} us late; percentiles and ratios are medians over {} turns",
            c.ours,
            c.bare,
            c.ours_missed,
            c.bare_missed,
            self.ours_us.max,
            self.bare_us.max,
            self.turns
        );
        for missing in &self.missing {
            say!("without {missing}");
        }
    }
}
