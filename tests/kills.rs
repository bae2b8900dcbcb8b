//! Processes are killed and frozen at random instants, in the middle of firing: no valve stays open, every service comes
//! back, every log can be read, and nothing is left in shared memory.
//!
//! `FSS_KILLS` sets how many (30), `FSS_KILLS_SEED` the seed, `FSS_KILLS_PAUSE_MS` the longest time between two (800); a new
//! stack flies every hundred. The laboratory is the world and is spared; the launcher dies at the end of every second flight.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_lab::TRUTH_PERIOD_NS;
use fss_messages::{Event, MissionState, text_of};
use fss_records::log::Log;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use witness::Witness;

#[allow(dead_code, unreachable_pub)] // the program asks more of it
#[path = "../apps/launcher/src/witness.rs"]
mod witness;

mod common;

/// No valve may be open longer than this after the last command that opened it.
const DEAD_MAN_NS: u64 = 100_000_000;
/// No service may be missing longer than this after it was struck.
const MISSING_NS: u64 = 1_000_000_000;
/// Signs of life are so far apart while all is well.
const HEALTH_PERIOD_NS: u64 = 200_000_000;
/// A stack takes so many before the next one flies.
const KILLS_A_FLIGHT: u64 = 100;
/// Turns of 4 s that a stack flies at most: what its tank lasts for.
const PHASES: usize = 70;
/// After so many there is a rest, in which shared memory must be as it was at first.
const KILLS_A_ROUND: u64 = 25;
const SERVICES: [&str; 7] = ["thrusters", "base", "fusion", "links", "arm", "recorder", "mission"];

/// A stack that slews to and fro, firing.
struct Flight {
    folder: tempfile::TempDir,
    run: Child,
    prefix: String,
}

/// Turns to and fro, 4 s each, the last one to the left.
fn turns(phases: usize) -> String {
    let mut mission = "name = \"to and fro\"\ndescription = \"The base turns to and fro.\"\n".to_owned();
    for k in 0..phases {
        let theta_deg = if (phases - k) % 2 == 1 { 15 } else { -15 };
        let (base, arm) =
            (format!("{{ goal = \"goto\", x_m = 0, y_m = 0, theta_deg = {theta_deg} }}"), "{ goal = \"hold\" }");
        writeln!(mission, "[[phase]]\nname = \"p{k}\"\nduration_s = 4\nbase = {base}\narm = {arm}").unwrap();
    }
    mission
}

impl Flight {
    fn start(first_port: u16, mission: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let launch = include_str!("../deploy/etc/launch/lab.toml")
            .replace("51001", &first_port.to_string())
            .replace("5110", &(first_port / 10 + 1).to_string());
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

    /// The processes of the stack, by the words of their commands behind the program.
    fn processes(&self) -> BTreeMap<String, i32> {
        let run = self.out().display().to_string();
        let command_of = |id: i32| std::fs::read(format!("/proc/{id}/cmdline")).ok();
        let ids = std::fs::read_dir("/proc").unwrap().flatten().filter_map(|e| e.file_name().to_str()?.parse().ok());
        ids.filter(|id| *id != self.run.id() as i32)
            .filter_map(|id| Some((String::from_utf8_lossy(&command_of(id)?).replace('\0', " "), id)))
            .filter(|(command, _)| command.contains(&run))
            .map(|(command, id)| (command.split_once(' ').unwrap().1.to_owned(), id))
            .collect()
    }

    fn strike(&self, service: &str, signal: Signal) -> bool {
        let words = format!("service {service} ");
        let processes = self.processes();
        let victim = processes.iter().find(|(command, _)| command.starts_with(&words));
        victim.is_some_and(|(_, id)| kill_process(Pid::from_raw(*id).unwrap(), signal).is_ok())
    }

    /// What it said of errors, if it has ended.
    fn ended(&mut self) -> Option<String> {
        self.run.try_wait().unwrap()?;
        let mut said = String::new();
        std::io::Read::read_to_string(&mut self.run.stderr.take().unwrap(), &mut said).unwrap();
        Some(said)
    }

    /// Asks it to stop, or kills the launcher; in both cases every process goes.
    fn stop(&mut self, signal: Signal) {
        kill_process(Pid::from_raw(self.run.id() as i32).unwrap(), signal).unwrap();
        let asked = Instant::now();
        loop {
            assert!(asked.elapsed() < Duration::from_mins(1), "it does not stop: {:?}", self.processes());
            if self.ended().is_some() {
                while !self.processes().is_empty() && asked.elapsed() < Duration::from_mins(1) {
                    std::thread::sleep(Duration::from_millis(20));
                }
                assert!(self.processes().is_empty(), "it leaves processes: {:?}", self.processes());
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        let _ = self.run.kill();
        let _ = self.run.wait();
    }
}

fn watch_for(witness: &mut Witness, time: Duration) {
    let start = Instant::now();
    while start.elapsed() < time {
        witness.look().unwrap();
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn from_environment(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// The files of a prefix where iceoryx2 keeps them.
fn files_of(prefix: &str) -> BTreeSet<PathBuf> {
    fn collect(folder: &Path, prefix: &str, found: &mut BTreeSet<PathBuf>) {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                collect(&entry.path(), prefix, found);
            } else if entry.file_name().to_string_lossy().starts_with(prefix) {
                found.insert(entry.path());
            }
        }
    }
    let mut found = BTreeSet::new();
    collect(Path::new("/dev/shm"), prefix, &mut found);
    collect(Path::new("/tmp/iceoryx2"), prefix, &mut found);
    found
}

/// How many logs there are; all of them can be read.
fn readable_logs(folder: &Path) -> u64 {
    let mut logs = 0;
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        // A recorder that was killed before its first byte has lost nothing.
        let is_log = entry.path().extension().is_some_and(|e| e == "mcap");
        if is_log && entry.metadata().unwrap().len() > 0 {
            let (_, damage) = Log::open(&entry.path()).unwrap().survey().unwrap();
            assert_eq!(damage.places, 0, "{}", entry.path().display());
            logs += 1;
        }
    }
    logs
}

/// What all flights have shown.
#[derive(Debug, Default)]
struct Shown {
    struck: BTreeMap<&'static str, u64>,
    last_blow_ns: BTreeMap<&'static str, u64>,
    freezes: u64,
    while_firing: u64,
    flights: u64,
    /// Flights that their mission ended, since navigation or the links were away for too long.
    aborted: u64,
    logs: u64,
    open_after_ns: u64,
    open_while_running_ns: u64,
    world_stood_still_ns: u64,
    missing_ns: BTreeMap<String, u64>,
    /// The most files above those at first, in a rest.
    more_files: usize,
}

impl Shown {
    fn kills(&self) -> u64 {
        self.struck.values().sum()
    }

    /// Flies one stack and strikes it until it has its share.
    fn fly(&mut self, kills: u64, random: &mut ChaCha8Rng) {
        let mut flight = Flight::start(53_010 + 20 * (self.flights % 40) as u16, &turns(PHASES));
        self.flights += 1;
        self.last_blow_ns.clear();
        let mut witness = Witness::join(&flight.prefix, "").unwrap();
        watch_for(&mut witness, Duration::from_secs(5)); // until it fires
        let files_at_first = files_of(&flight.prefix).len();
        let share = (self.kills() + KILLS_A_FLIGHT).min(kills);
        let aborted = loop {
            if let Some(said) = flight.ended() {
                assert!(said.contains("the mission was aborted"), "{said}");
                break true;
            }
            if self.kills() == share {
                watch_for(&mut witness, Duration::from_secs(2));
                break false;
            }
            self.strike(&flight, &mut witness, random);
            let pause_ms = random.random_range(20..from_environment("FSS_KILLS_PAUSE_MS", 800));
            watch_for(&mut witness, Duration::from_millis(pause_ms));
            if self.kills().is_multiple_of(KILLS_A_ROUND) {
                watch_for(&mut witness, Duration::from_secs(2));
                let more = files_of(&flight.prefix).len().saturating_sub(files_at_first);
                self.more_files = self.more_files.max(more);
            }
        };
        self.aborted += u64::from(aborted);
        if aborted || self.flights.is_multiple_of(2) {
            self.take(&witness);
            drop(witness);
            if !aborted {
                flight.stop(Signal::INT);
            }
        } else {
            flight.stop(Signal::KILL);
            witness.look().unwrap(); // its buffers hold seconds
            self.take(&witness);
            drop(witness);
            // Nobody was left to tidy up: the next start does.
            fss_bus::remove_stale_stacks().unwrap();
        }
        assert_eq!(files_of(&flight.prefix), BTreeSet::new());
        self.logs += readable_logs(&flight.out());
    }

    fn strike(&mut self, flight: &Flight, witness: &mut Witness, random: &mut ChaCha8Rng) {
        let service = SERVICES[random.random_range(0..SERVICES.len())];
        // What freezes before its first sign of life is given 5 s to show one: that is not what is tried here.
        let last_blow_ns = self.last_blow_ns.get(service).copied().unwrap_or(0);
        let is_up = witness.alive_ns.get(service).is_some_and(|at| *at > last_blow_ns);
        let freeze = random.random_bool(0.2) && is_up;
        if flight.strike(service, if freeze { Signal::STOP } else { Signal::KILL }) {
            self.last_blow_ns.insert(service, witness.note_blow(service).unwrap());
            let firing = witness.seen.open;
            println!(
                "{}: {service} {}{}",
                self.kills(),
                if freeze { "frozen" } else { "killed" },
                if firing { ", firing" } else { "" }
            );
            *self.struck.entry(service).or_default() += 1;
            self.freezes += u64::from(freeze);
            self.while_firing += u64::from(firing);
        }
    }

    fn take(&mut self, witness: &Witness) {
        self.open_after_ns = self.open_after_ns.max(witness.seen.open_after_ns);
        self.open_while_running_ns = self.open_while_running_ns.max(witness.seen.open_while_running_ns);
        self.world_stood_still_ns = self.world_stood_still_ns.max(witness.seen.world_stood_still_ns);
        for (service, missing_ns) in &witness.seen.silent_ns {
            let longest = self.missing_ns.entry(service.clone()).or_default();
            *longest = *missing_ns.max(longest);
        }
    }
}

#[test]
fn whatever_dies_or_freezes_the_valves_shut_and_everything_comes_back() {
    let kills = from_environment("FSS_KILLS", 30);
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    let seed = from_environment("FSS_KILLS_SEED", now.as_millis() as u64);
    println!("{kills} kills, seed {seed}");
    let start = Instant::now();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut shown = Shown::default();
    while shown.kills() < kills {
        shown.fly(kills, &mut random);
    }
    println!("{shown:#?}\nin {:.0} s", start.elapsed().as_secs_f64());
    // A host that does not run the laboratory stops its valves and its witness too: that long nobody can be on time.
    let host_ns = shown.world_stood_still_ns;
    let open_ns = shown.open_while_running_ns;
    assert!(open_ns <= DEAD_MAN_NS + TRUTH_PERIOD_NS, "a valve was open for {open_ns} ns of a running world");
    for (service, missing_ns) in &shown.missing_ns {
        let most_ns = MISSING_NS + HEALTH_PERIOD_NS + host_ns;
        assert!(*missing_ns <= most_ns, "{service} was missing for {missing_ns} ns");
    }
    assert!(shown.while_firing > kills / 40, "it hardly fired: the test would show nothing");
    assert!(shown.aborted <= 1 + kills / 50, "blows ended {} flights", shown.aborted);
    // What is killed while it joins leaves files that only the end of the stack removes: fewer than one a blow.
    let most = kills.min(KILLS_A_FLIGHT) as usize;
    assert!(shown.more_files < most, "shared memory grew by {} files in {most} kills", shown.more_files);
}

#[test]
fn a_mission_that_is_killed_five_times_goes_on_in_its_phase_and_reaches_its_goal() {
    let mut flight = Flight::start(53_900, &turns(4));
    let mut witness = Witness::join(&flight.prefix, "").unwrap();
    watch_for(&mut witness, Duration::from_secs(4));
    for _ in 0..5 {
        assert!(flight.strike("mission", Signal::KILL), "there is a mission to kill");
        watch_for(&mut witness, Duration::from_secs(2));
    }
    drop(witness);
    let said = loop {
        if let Some(said) = flight.ended() {
            break said;
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let out = flight.out();
    let summary = common::json(&out.join("summary.json"));
    assert_eq!(summary["outcome"], "done", "{said}");
    assert_eq!(summary["services"]["mission"]["starts"], 6);
    let path = out.join("run.mcap");
    let log = Log::open(&path).unwrap();
    let events = log.samples::<Event>("/events").unwrap();
    let count = |words: &str| events.iter().filter(|event| text_of(&event.text) == words).count();
    for words in ["mission to and fro begins", "phase 1: p0", "phase 2: p1", "phase 3: p2", "phase 4: p3"] {
        assert_eq!(count(words), 1, "'{words}' once");
    }
    // Each phase has the clock that it began with.
    let states = log.samples::<MissionState>("/mission/state").unwrap();
    let running = states.iter().filter(|state| state.state == MissionState::RUNNING);
    let begun: BTreeSet<u64> = running.map(|state| state.phase_start_ns).collect();
    let begun: Vec<u64> = begun.into_iter().collect();
    assert!(begun.windows(2).all(|pair| pair[1] - pair[0] == 4_000_000_000), "{begun:?}");
    assert_eq!(begun.len(), 4);
    common::succeed(&["replay", &path.display().to_string()]);
}
