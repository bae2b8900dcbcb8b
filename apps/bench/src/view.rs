//! What a live page costs those who fly: the stack with and without one, in turns.

use super::browser::{self, Browser};
use super::distribution::Distribution;
use fss_bus::{Bus, remove_dead_nodes};
use fss_estimation::statistics::median;
use fss_launcher::measured::{Measured, measured_flight};
use fss_messages::{Health, text_of, topic};
use fss_records::log::Log;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::Serialize;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

/// Flights of either kind.
const TURNS: usize = 3;
/// Not of those who fly: the world, and who watches.
const NOT_IN_FLIGHT: [&str; 2] = ["lab", "launcher"];

/// What the benchmark found.
#[derive(Serialize)]
pub(crate) struct ViewTimes {
    format: &'static str,
    seconds_each: f64,
    turns: usize,
    /// Pictures that a reader of the live stream received in a second; absent where a browser showed them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pictures_a_second: Option<f64>,
    /// What the browser itself needed from its start on, percent of one core.
    #[serde(skip_serializing_if = "Option::is_none")]
    browser_core_percent: Option<f64>,
    alone: Cost,
    watched: Cost,
    ratio: Ratios,
}

/// Of the flight processes: all but the simulated laboratory and the launcher.
#[derive(Clone, Copy, Serialize)]
struct Cost {
    /// Median of the turns, percent of one core.
    core_percent: f64,
    /// Wake-up latency, median of the services' own medians, microseconds.
    wake_p50_us: f64,
    /// Wake-up latency, median of the services' own 99th percentiles, microseconds.
    wake_p99_us: f64,
}

/// Watched to alone.
#[derive(Serialize)]
struct Ratios {
    core: f64,
    wake_p50: f64,
    wake_p99: f64,
}

/// Flies in turns for `seconds` each; watched by the browser, or by a reader that draws nothing.
pub(crate) fn measure(launch: Option<&Path>, seconds: f64, browser: Option<&Path>) -> Result<ViewTimes> {
    // Said now, and not after a flight.
    browser.map_or(Ok(()), browser::check)?;
    let mut alone = Turns::new()?;
    let mut watched = Turns::new()?;
    let mut seen = Vec::new();
    for _ in 0..TURNS {
        measured_flight(launch, seconds, |_| Ok(()), |_, flight| alone.add(flight))?;
        let mut page = None;
        let open = |bus: &str| {
            page = Some(Page::open(bus, browser)?);
            Ok(())
        };
        measured_flight(launch, seconds, open, |_, flight| watched.add(flight))?;
        seen.push(page.ok_or_else(|| miette!("the flight was never watched"))?.close()?);
    }
    let (alone, watched) = (alone.cost(), watched.cost());
    Ok(ViewTimes {
        format: "fss-bench-view/1",
        seconds_each: seconds,
        turns: TURNS,
        pictures_a_second: browser.is_none().then(|| median_or_nan(seen.clone())),
        browser_core_percent: browser.map(|_| median_or_nan(seen)),
        alone,
        watched,
        ratio: Ratios {
            core: watched.core_percent / alone.core_percent,
            wake_p50: watched.wake_p50_us / alone.wake_p50_us,
            wake_p99: watched.wake_p99_us / alone.wake_p99_us,
        },
    })
}

/// `fss view` beside a stack, and who watches.
struct Page {
    process: Child,
    bus_prefix: String,
    watcher: Watcher,
}

/// Somebody who takes all that a page tells.
enum Watcher {
    /// Draws nothing; how many pictures came in how long, once the stream has ended.
    Reader(std::thread::JoinHandle<Result<(u64, f64)>>),
    Browser(Browser),
}

impl Page {
    fn open(bus_prefix: &str, browser: Option<&Path>) -> Result<Self> {
        let program = std::env::current_exe().into_diagnostic()?;
        let mut process = Command::new(program)
            .args(["view", "--port", "0", "--bus", bus_prefix])
            .stdout(Stdio::piped())
            .spawn()
            .into_diagnostic()
            .wrap_err("fss view")?;
        let stdout = process.stdout.take().ok_or_else(|| miette!("fss view says nothing"))?;
        let mut said = String::new();
        BufReader::new(stdout).read_line(&mut said).into_diagnostic()?;
        let host = said.strip_prefix("http://").and_then(|rest| rest.split('/').next()).map(str::to_owned);
        let host = host.ok_or_else(|| miette!("fss view does not say where it is: {said}"))?;
        let watcher = match browser {
            Some(program) => Watcher::Browser(Browser::open(program, &format!("http://{host}/"))?),
            None => Watcher::Reader(std::thread::spawn(move || count_pictures(&host))),
        };
        Ok(Self { process, bus_prefix: bus_prefix.to_owned(), watcher })
    }

    /// Ends it; the pictures a second that a reader took, or what the browser needed, percent of one core.
    fn close(mut self) -> Result<f64> {
        let _it_may_have_ended_with_the_stack = self.process.kill();
        self.process.wait().into_diagnostic()?;
        remove_dead_nodes(&self.bus_prefix, true).into_diagnostic()?;
        match self.watcher {
            Watcher::Reader(reader) => {
                let (pictures, seconds) = reader.join().map_err(|_| miette!("the page's reader failed"))??;
                Ok(pictures as f64 / seconds)
            }
            Watcher::Browser(mut browser) => browser.core_percent(),
        }
    }
}

/// Reads the live stream to its end; how many pictures came from the first to the last, and how long that took, s.
fn count_pictures(host: &str) -> Result<(u64, f64)> {
    let mut connection = TcpStream::connect(host).into_diagnostic()?;
    write!(connection, "GET /live HTTP/1.1\r\nHost: {host}\r\n\r\n").into_diagnostic()?;
    let (mut pictures, mut first, mut last) = (0, None, Instant::now());
    for line in BufReader::new(connection).lines() {
        // A server that is stopped may cut the last line.
        let Ok(line) = line else { break };
        if line == "event: frame" {
            last = Instant::now();
            pictures += u64::from(first.replace(first.unwrap_or(last)).is_some());
        }
    }
    let begun = first.ok_or_else(|| miette!("the live stream shows no picture"))?;
    Ok((pictures, (last - begun).as_secs_f64()))
}

/// What flights of one kind have cost.
struct Turns {
    core_percent: Vec<f64>,
    wake_p50: Distribution,
    wake_p99: Distribution,
}

impl Turns {
    fn new() -> Result<Self> {
        Ok(Self { core_percent: Vec::new(), wake_p50: Distribution::new()?, wake_p99: Distribution::new()? })
    }

    fn add(&mut self, flight: &Measured) -> Result<()> {
        let of_flight = |name: &str| !NOT_IN_FLIGHT.contains(&name);
        let own = flight.cpu_ns.iter().filter(|(name, _)| of_flight(name));
        self.core_percent.push(own.map(|(_, ns)| *ns as f64).sum::<f64>() * 1e-7 / flight.seconds);
        let topic = Bus::local().for_vehicle(&flight.vehicle).full_name(topic::HEALTH.name);
        let reports = Log::open(&flight.log).and_then(|log| log.samples::<Health>(&topic)).into_diagnostic()?;
        for report in reports.iter().filter(|report| report.real_time == 1 && of_flight(text_of(&report.service))) {
            self.wake_p50.record(report.wake_p50_ns);
            self.wake_p99.record(report.wake_p99_ns);
        }
        Ok(())
    }

    fn cost(self) -> Cost {
        let half_of = |times: &Distribution| times.percentiles(1e-3).p50;
        let (wake_p50_us, wake_p99_us) = (half_of(&self.wake_p50), half_of(&self.wake_p99));
        Cost { core_percent: median_or_nan(self.core_percent), wake_p50_us, wake_p99_us }
    }
}

fn median_or_nan(mut values: Vec<f64>) -> f64 {
    median(&mut values).unwrap_or(f64::NAN)
}

impl ViewTimes {
    /// The table for a person.
    pub(crate) fn print(&self) {
        say!("{:<16} {:>10} {:>12} {:>12}", "flight processes", "core, %", "late p50, us", "late p99, us");
        for (name, cost) in [("alone", self.alone), ("watched", self.watched)] {
            say!("{name:<16} {:>10.2} {:>12.1} {:>12.1}", cost.core_percent, cost.wake_p50_us, cost.wake_p99_us);
        }
        let Ratios { core, wake_p50, wake_p99 } = self.ratio;
        say!("{:<16} {core:>10.2} {wake_p50:>12.2} {wake_p99:>12.2}", "ratio");
        if let Some(rate) = self.pictures_a_second {
            say_part!("{rate:.1} pictures a second");
        }
        if let Some(percent) = self.browser_core_percent {
            say_part!("the browser needs {percent:.0} % of a core");
        }
        say!("; {} turns of {} s each", self.turns, self.seconds_each);
    }
}
