//! Processes are killed and frozen at random instants, in the middle of firing: no valve stays open, every service comes
//! back, every log can be read, and nothing is left in shared memory.
//!
//! `FSS_KILLS` sets how many (30), `FSS_KILLS_SEED` the seed. The laboratory is the world and is spared.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_bus::{Batch, Bus, InputPort, SharedConfig};
use fss_messages::{Health, ThrustersCommand, TruthState, text_of, topic};
use fss_records::log::Log;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// No valve may be open longer than this after the last command that opened it.
const DEAD_MAN_NS: u64 = 100_000_000;
/// The truth is told so often: it tells of a valve so much later at most.
const TRUTH_PERIOD_NS: u64 = 10_000_000;
/// No service may be missing longer than this.
const MISSING_NS: u64 = 1_000_000_000;
/// Signs of life are so far apart while all is well.
const HEALTH_PERIOD_NS: u64 = 200_000_000;

/// A stack that slews to and fro, firing.
struct Flight {
    folder: tempfile::TempDir,
    run: Child,
    prefix: String,
}

impl Flight {
    fn start(first_port: u16) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut mission = "name = \"to and fro\"\ndescription = \"The base turns to and fro.\"\n".to_owned();
        for k in 0..400 {
            let theta_deg = if k % 2 == 0 { 15 } else { -15 };
            let (base, arm) =
                (format!("{{ goal = \"goto\", x_m = 0, y_m = 0, theta_deg = {theta_deg} }}"), "{ goal = \"hold\" }");
            writeln!(mission, "[[phase]]\nname = \"p{k}\"\nduration_s = 4\nbase = {base}\narm = {arm}").unwrap();
        }
        // A mission that died begins anew here: where it was does not matter to this flight.
        let launch = include_str!("../deploy/etc/launch/lab.toml")
            .replace("51001", &first_port.to_string())
            .replace("5110", &(first_port / 10 + 1).to_string())
            .replace("restart = false                     # a mission", "restart = true # a mission");
        let (mission_file, launch_file) =
            (folder.path().join("mission-file.toml"), folder.path().join("launch-file.toml"));
        std::fs::write(&mission_file, mission).unwrap();
        std::fs::write(&launch_file, launch).unwrap();
        let run = Command::new(env!("CARGO_BIN_EXE_fss"))
            .arg("run")
            .arg(mission_file)
            .arg("--launch")
            .arg(launch_file)
            .arg("--quiet")
            .arg("--out")
            .arg(folder.path().join("out"))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let prefix = format!("fss_{}_", run.id());
        Self { folder, run, prefix }
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    /// The process of a service.
    fn process_of(&self, service: &str) -> Option<u32> {
        let (run, words) = (self.out().display().to_string(), format!("service {service} "));
        std::fs::read_dir("/proc").unwrap().flatten().find_map(|entry| {
            let id = entry.file_name().to_string_lossy().parse().ok()?;
            let command = std::fs::read(entry.path().join("cmdline")).ok()?;
            let command = String::from_utf8_lossy(&command).replace('\0', " ");
            (command.contains(&run) && command.contains(&words)).then_some(id)
        })
    }

    fn signal(&self, service: &str, signal: &str) -> bool {
        let Some(id) = self.process_of(service) else { return false };
        Command::new("kill").args([signal, &id.to_string()]).status().unwrap().success()
    }

    /// Asks it to stop; gives what it said of errors.
    fn stop(&mut self) -> String {
        assert!(Command::new("kill").args(["-INT", &self.run.id().to_string()]).status().unwrap().success());
        let asked = Instant::now();
        while self.run.try_wait().unwrap().is_none() {
            assert!(asked.elapsed() < Duration::from_mins(1), "it does not stop");
            std::thread::sleep(Duration::from_millis(20));
        }
        self.said()
    }

    fn assert_flying(&mut self) {
        if let Some(status) = self.run.try_wait().unwrap() {
            let said = self.said();
            panic!("the run ended ({status}): {said}");
        }
    }

    fn said(&mut self) -> String {
        let mut said = String::new();
        std::io::Read::read_to_string(&mut self.run.stderr.take().unwrap(), &mut said).unwrap();
        said
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        let _ = self.run.kill();
        let _ = self.run.wait();
    }
}

/// Watches the stack from outside, through shared memory.
struct Witness {
    commands: Batch<ThrustersCommand>,
    truth: Batch<TruthState>,
    health: Batch<Health>,
    /// When each valve was last commanded open.
    commanded_ns: [u64; 16],
    /// The longest that a valve was seen open after that.
    open_after_ns: u64,
    /// How many truths had a valve open.
    seen_open: u64,
    alive_ns: BTreeMap<String, u64>,
    missing_ns: BTreeMap<String, u64>,
}

impl Witness {
    fn new(prefix: &str) -> Self {
        let config = SharedConfig { node: "witness".to_owned(), prefix: prefix.to_owned() };
        let bus = Bus::shared(&config).unwrap();
        Self {
            commands: Batch::open(&bus, topic::THRUSTERS_COMMAND).unwrap(),
            truth: Batch::open(&bus, topic::TRUTH_STATE).unwrap(),
            health: Batch::open(&bus, topic::HEALTH).unwrap(),
            commanded_ns: [0; 16],
            open_after_ns: 0,
            seen_open: 0,
            alive_ns: BTreeMap::new(),
            missing_ns: BTreeMap::new(),
        }
    }

    fn look(&mut self) {
        // Truth first: a command that came meanwhile must not excuse an older valve.
        self.truth.refresh();
        self.commands.refresh();
        self.health.refresh();
        for command in self.commands.samples() {
            for (at, &open) in self.commanded_ns.iter_mut().zip(&command.valves) {
                *at = if open == 0 { *at } else { command.published_ns };
            }
        }
        for truth in self.truth.samples() {
            let open = truth.valves.iter().zip(&self.commanded_ns).filter(|(valve, _)| **valve != 0);
            let after = open.map(|(_, at)| truth.stamp_ns.saturating_sub(*at)).max();
            self.open_after_ns = self.open_after_ns.max(after.unwrap_or(0));
            self.seen_open += u64::from(after.is_some());
        }
        for health in self.health.samples() {
            let service = text_of(&health.service).to_owned();
            let before = self.alive_ns.insert(service.clone(), health.stamp_ns).unwrap_or(health.stamp_ns);
            let missing = self.missing_ns.entry(service).or_default();
            *missing = (*missing).max(health.stamp_ns.saturating_sub(before));
        }
    }

    fn watch_for(&mut self, time: Duration) {
        let start = Instant::now();
        while start.elapsed() < time {
            self.look();
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

fn from_environment(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

fn left_in_shared_memory(prefix: &str) -> Vec<String> {
    let names = std::fs::read_dir("/dev/shm").unwrap().flatten().map(|e| e.file_name().to_string_lossy().into_owned());
    names.filter(|name| name.starts_with(prefix)).collect()
}

fn assert_logs_are_readable(folder: &Path) {
    let mut logs = 0;
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        if entry.path().extension().is_some_and(|e| e == "mcap") {
            let (_, damage) = Log::open(&entry.path()).unwrap().survey().unwrap();
            assert_eq!(damage.places, 0, "{}", entry.path().display());
            logs += 1;
        }
    }
    assert!(logs > 0);
}

#[test]
fn whatever_dies_or_freezes_the_valves_shut_and_everything_comes_back() {
    let kills = from_environment("FSS_KILLS", 30);
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    let seed = from_environment("FSS_KILLS_SEED", now.as_millis() as u64);
    println!("{kills} kills, seed {seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut flight = Flight::start(53_010);
    let mut witness = Witness::new(&flight.prefix);
    witness.watch_for(Duration::from_secs(5)); // until it fires
    let services = ["thrusters", "base", "fusion", "links", "arm", "recorder", "mission"];
    let mut struck = 0;
    while struck < kills {
        // The valves are what matters: half of the blows fall on those who move them.
        let service =
            services[if random.random_bool(0.5) { random.random_range(0..2) } else { random.random_range(0..7) }];
        let freeze = random.random_bool(0.25);
        if flight.signal(service, if freeze { "-STOP" } else { "-KILL" }) {
            println!("{struck}: {service} {}", if freeze { "frozen" } else { "killed" });
            struck += 1;
        }
        witness.watch_for(Duration::from_millis(random.random_range(100..1500)));
        flight.assert_flying();
    }
    witness.watch_for(Duration::from_secs(2));
    let out = flight.out();
    let said = flight.stop();
    println!("valve open at most {:.1} ms after its command", witness.open_after_ns as f64 * 1e-6);
    println!(
        "signs of life apart at most, ms: {:?}",
        witness.missing_ns.iter().map(|(s, ns)| (s, ns / 1_000_000)).collect::<Vec<_>>()
    );
    assert!(witness.seen_open > 50, "it did not fire: the test would show nothing");
    assert!(witness.open_after_ns <= DEAD_MAN_NS + TRUTH_PERIOD_NS, "{} ns; {said}", witness.open_after_ns);
    for (service, missing_ns) in &witness.missing_ns {
        assert!(*missing_ns <= MISSING_NS + HEALTH_PERIOD_NS, "{service} was missing for {missing_ns} ns; {said}");
    }
    let prefix = flight.prefix.clone();
    drop(witness);
    fss_bus::remove_dead_nodes(&prefix, false).unwrap();
    assert_logs_are_readable(&out);
    // What the witness itself held goes with it; of the stack's own there must be nothing.
    let left: Vec<_> =
        left_in_shared_memory(&prefix).into_iter().filter(|name| !name.contains("global_mgmt")).collect();
    assert!(left.is_empty(), "{left:?}");
}
