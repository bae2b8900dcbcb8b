//! One-way latency of a sample between two cores, by every way that there is, in turns: between two threads, or a thread and a program
//! in another language.

mod peer;
mod ways;

use super::distribution::{Distribution, Percentiles};
use fss_bus::{realtime, remove_dead_nodes};
use miette::{IntoDiagnostic, Result, miette};
use peer::{Peer, Workshop};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Stdio};
use std::sync::{Arc, Barrier};
use std::time::{Duration, Instant};
use ways::{Opener, SAMPLE_BYTES, bus_way, cache_line_way, iceoryx_way, udp_way, unix_way};

/// Each way has its turn so many times: a disturbance of the host does not meet one of them alone.
const ROUNDS: u32 = 20;
/// Round trips in a turn.
const TRIPS: u64 = 1000;
/// Round trips before a turn's first that counts.
const WARM_UP: u64 = 50;

/// Tells the other side to stop.
const LAST: u64 = u64::MAX;
/// What the benchmark found.
#[derive(Serialize)]
pub(crate) struct IpcTimes {
    format: &'static str,
    payload_bytes: usize,
    round_trips: u64,
    pinned: bool,
    /// Half of a round trip, microseconds.
    one_way_us: BTreeMap<&'static str, Percentiles>,
    /// Each over raw iceoryx2.
    over_iceoryx2: BTreeMap<&'static str, Percentiles>,
    ratio: Ratios,
    /// The programs in other languages that this computer cannot run, and why.
    skipped: BTreeMap<&'static str, String>,
}

/// Of medians.
#[derive(Serialize)]
struct Ratios {
    bus_to_iceoryx2: f64,
    bus_to_shared_memory: f64,
    udp_to_bus: f64,
    unix_to_bus: f64,
}

/// The end that sends back what comes.
enum Far {
    Here(Opener),
    /// A program on the bus, with the prefix that it is told.
    Program(Peer, String),
}

/// Opens both ends of a way, with a prefix in shared memory.
type WayOf = Box<dyn Fn(&str) -> Result<(Opener, Far)>>;

/// Measures all ways in turns.
pub(crate) fn measure() -> Result<IpcTimes> {
    let workshop = Workshop::open()?;
    let mut ways = vec![
        ("bus", between_threads(bus_way)),
        ("iceoryx2", between_threads(iceoryx_way)),
        ("shared_memory", between_threads(cache_line_way)),
        ("unix_socket", between_threads(unix_way)),
        ("udp", between_threads(udp_way)),
    ];
    let mut skipped = BTreeMap::new();
    let peers =
        [("c", workshop.c()), ("python", workshop.python()), ("python_iceoryx2", workshop.python_on_iceoryx2())];
    for (name, peer) in peers {
        match peer {
            Ok(peer) => ways.push((name, to_program(peer))),
            Err(why) => drop(skipped.insert(name, format!("{why:#}"))),
        }
    }
    let prefix = format!("fssbench_{}_", std::process::id());
    let mut all: BTreeMap<&'static str, Distribution> = BTreeMap::new();
    let pinned = std::thread::available_parallelism().is_ok_and(|cores| cores.get() > 1);
    for round in 0..ROUNDS {
        for (name, open) in &ways {
            let (near, far) = open(&format!("{prefix}{round}{name}"))?;
            let times = all.entry(name).or_insert(Distribution::new()?);
            let outcome = turn(near, far, pinned, times);
            remove_dead_nodes(&format!("{prefix}{round}{name}"), true).into_diagnostic()?;
            outcome.map_err(|e| e.wrap_err(*name))?;
        }
    }
    let one_way_us: BTreeMap<_, _> = all.iter().map(|(name, times)| (*name, times.percentiles(1e-3 / 2.0))).collect();
    let over_iceoryx2 = one_way_us.iter().map(|(name, times)| (*name, times.over(&one_way_us["iceoryx2"]))).collect();
    let ratio = |of: &str, to: &str| one_way_us[of].p50 / one_way_us[to].p50;
    let ratio = Ratios {
        bus_to_iceoryx2: ratio("bus", "iceoryx2"),
        bus_to_shared_memory: ratio("bus", "shared_memory"),
        udp_to_bus: ratio("udp", "bus"),
        unix_to_bus: ratio("unix_socket", "bus"),
    };
    Ok(IpcTimes {
        format: "fss-bench-ipc/1",
        payload_bytes: SAMPLE_BYTES,
        round_trips: u64::from(ROUNDS) * TRIPS,
        pinned,
        one_way_us,
        over_iceoryx2,
        ratio,
        skipped,
    })
}

impl IpcTimes {
    /// The table for a person.
    pub(crate) fn print(&self) {
        say!("{:<16} {:>8} {:>8} {:>8}   {:<18}", "one way, us", "p50", "p99", "p99.9", "over iceoryx2 p50, p99");
        for (name, times) in &self.one_way_us {
            let Percentiles { p50, p99, p99_9, .. } = times;
            let over = &self.over_iceoryx2[name];
            say!("{name:<16} {p50:>8.3} {p99:>8.3} {p99_9:>8.3}   {:>8.2} {:>8.2}", over.p50, over.p99);
        }
        for (name, why) in &self.skipped {
            say!("{name:<16} skipped: {why}");
        }
        say!("{} B, {} round trips each way, in turns", self.payload_bytes, self.round_trips);
    }
}

fn between_threads(open: fn(&str) -> Result<(Opener, Opener)>) -> WayOf {
    Box::new(move |prefix| open(prefix).map(|(near, far)| (near, Far::Here(far))))
}

fn to_program(peer: Peer) -> WayOf {
    Box::new(move |prefix| Ok((bus_way(prefix)?.0, Far::Program(peer.clone(), prefix.to_owned()))))
}

/// Sends round trips from this computer's first core, and tells how long they took.
fn turn(near: Opener, far: Far, pinned: bool, times: &mut Distribution) -> Result<()> {
    let both_open = Arc::new(Barrier::new(2));
    let opened = both_open.clone();
    let echo = std::thread::spawn(move || -> Result<()> {
        if pinned {
            let _unpinned_where_refused = realtime::pin_to_core(1);
        }
        match far {
            Far::Here(far) => echo_here(far, &opened),
            Far::Program(peer, prefix) => echo_there(&peer, &prefix, &opened),
        }
    });
    let ping = std::thread::spawn(move || -> Result<Vec<u64>> {
        if pinned {
            let _unpinned_where_refused = realtime::pin_to_core(0);
        }
        let end = near();
        both_open.wait(); // a program joins what is there already
        both_open.wait();
        let mut end = end?;
        let mut trips = Vec::with_capacity(TRIPS as usize);
        for sequence in 1..=WARM_UP + TRIPS {
            let start = Instant::now();
            end.send(sequence);
            if end.receive() != sequence {
                return Err(miette!("a sample was lost on its way"));
            }
            if sequence > WARM_UP {
                trips.push(start.elapsed().as_nanos() as u64);
            }
        }
        end.send(LAST);
        // An end that closes at once could take the last word with it.
        std::thread::sleep(Duration::from_millis(2));
        Ok(trips)
    });
    let join = |_| miette!("a thread of the benchmark failed");
    let trips = ping.join().map_err(join)?;
    echo.join().map_err(join)??;
    for trip_ns in trips? {
        times.record(trip_ns);
    }
    Ok(())
}

/// Sends back what comes, in this thread.
fn echo_here(far: Opener, opened: &Barrier) -> Result<()> {
    let end = far();
    opened.wait();
    opened.wait();
    let mut end = end?;
    loop {
        match end.receive() {
            LAST | 0 => return Ok(()),
            sequence => end.send(sequence),
        }
    }
}

/// Lets a program send it back, on this thread's core.
fn echo_there(peer: &Peer, prefix: &str, opened: &Barrier) -> Result<()> {
    opened.wait();
    let mut command = peer.command(prefix);
    let started = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let ready = started.into_diagnostic().and_then(|mut child| {
        let mut word = String::new();
        let output = child.stdout.take().ok_or_else(|| miette!("its output is closed"))?;
        BufReader::new(output).read_line(&mut word).into_diagnostic()?;
        Ok(child)
    });
    opened.wait();
    let output = ready.and_then(|child: Child| child.wait_with_output().into_diagnostic())?;
    if output.status.success() {
        return Ok(());
    }
    Err(miette!("it ended ({}): {}", output.status, String::from_utf8_lossy(&output.stderr).trim()))
}
