//! Services in Rust, C and Python, and one that is linked into the laboratory's own program, in one stack.

use super::common::{skipped, text};
use super::{check, controller, has, kill, meter, path, process_of};
use fss_bus::{Bus, InputPort, Latest, SharedConfig};
use fss_messages::{Event, ThrustersState, text_of, topic};
use fss_records::log::Log;
use std::fs::Permissions;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A mission of 15 s in which the base has motion to take out, so that valves fire.
const MISSION: &str = "name = \"still\"\ndescription = \"The base comes to rest.\"\n[initial]\nq_deg = [-30, 60, -60, 30]\n\
    x_m = -0.6\nvx_m_s = 0.02\nomega_deg_s = 2\n[[phase]]\nname = \"still\"\nduration_s = 15\nbase = { goal = \"hold\" }\n\
    arm = { goal = \"hold\" }\n";

/// No valve may be open longer than this after the last command that opened it, ns.
const DEAD_MAN_NS: u64 = 100_000_000;

/// The services of the stack that do not come with fss: in Rust, C, Python, and linked in.
const GUESTS: [&str; 4] = ["rmeter", "pd", "pmeter", "turn_meter"];
const TOPICS: [&str; 4] = ["/rmeter/state", "/pd/state", "/pmeter/state", "/turn_meter/state"];

/// The laboratory's own program.
fn laboratory(arguments: &[&str]) -> Command {
    let mut command = Command::new(Path::new(env!("CARGO_BIN_EXE_fss")).with_file_name("examples/laboratory"));
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[track_caller]
fn done(output: &Output) -> String {
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

/// Makes the services, and a launch file of them all, in which `pd` stands in for `base`; its folder.
fn stack(place: &Path) -> PathBuf {
    let place = place.canonicalize().unwrap();
    let (rust, python) = (meter(&place, "rmeter", "--rust"), meter(&place, "pmeter", "--python"));
    let c = controller(&place, "--c", "main.c", include_str!("../data/controllers/pd.c"));
    for folder in [&rust, &python, &c] {
        check(folder);
    }
    // The controller's launch file has the rest of the stack: the others' tables follow, at their programs' absolute paths.
    let table = |folder: &Path| {
        let launch = std::fs::read_to_string(folder.join("launch.toml")).unwrap();
        let table = launch.rsplit_once("[[service]]").unwrap().1;
        format!("[[service]]{}", table.replace("program = \"", &format!("program = \"{}/", path(folder))))
    };
    let linked = "[[service]]\nname = \"turn_meter\"\nconfig = { smoothing_s = 0.5 }\nrate_hz = 50\nphase_us = 3000\n";
    let launch = std::fs::read_to_string(c.join("launch.toml")).unwrap();
    let launch = [&launch, "\n", &table(&rust), &table(&python), linked].concat();
    std::fs::write(c.join("together.toml"), launch.replace("51001", "54401").replace("5110", "5451")).unwrap();
    std::fs::write(c.join("still.toml"), MISSION).unwrap();
    c
}

/// The arguments that fly the stack into a folder of that name.
fn flight(stack: &Path, out: &Path, fast: bool) -> Vec<String> {
    let mut arguments = vec!["run".to_owned(), path(&stack.join("still.toml")).to_owned(), "--quiet".to_owned()];
    arguments.extend(["--launch".to_owned(), path(&stack.join("together.toml")).to_owned()]);
    arguments.extend(["--out".to_owned(), path(out).to_owned()]);
    arguments.extend(fast.then(|| "--fast".to_owned()));
    arguments
}

fn fly_fast(stack: &Path, out: &Path) -> PathBuf {
    let arguments = flight(stack, out, true);
    done(&laboratory(&arguments.iter().map(String::as_str).collect::<Vec<_>>()).output().unwrap());
    out.join("run.mcap")
}

/// Steps and starts of each guest that a replay computed again; all services' must be identical.
fn replayed(log: &Path) -> [(u64, u64); 4] {
    let said = done(&laboratory(&["replay", "--json", path(log)]).output().unwrap());
    let answer: serde_json::Value = serde_json::from_str(&said).unwrap();
    let services = answer["services"].as_array().unwrap();
    GUESTS.map(|guest| {
        let verdict = services.iter().find(|verdict| verdict["service"] == guest).unwrap();
        (verdict["steps"].as_u64().unwrap(), verdict["starts"].as_u64().unwrap())
    })
}

/// Kills each guest in its turn, in a moment in which a valve is open.
fn strike_all(run: &mut Child, out: &Path) {
    let config = SharedConfig { node: "test".to_owned(), prefix: format!("fss_{}_", run.id()) };
    let asked = Instant::now();
    let patient = || assert!(asked.elapsed() < Duration::from_secs(30), "the stack does not fire");
    // Its shared memory is there when its services are.
    while GUESTS.iter().any(|guest| process_of(guest, out).is_none()) {
        patient();
        std::thread::sleep(Duration::from_millis(20));
    }
    let bus = Bus::shared(&config).unwrap();
    let mut valves = Latest::<ThrustersState>::open(&bus, topic::THRUSTERS_STATE).unwrap();
    for guest in GUESTS {
        std::thread::sleep(Duration::from_secs(1));
        loop {
            valves.refresh();
            if valves.fresh().is_some_and(|state| state.valves.contains(&1)) {
                break;
            }
            patient();
            std::thread::sleep(Duration::from_millis(1));
        }
        kill(process_of(guest, out).unwrap());
    }
}

/// Whether a process of another user is kept out of the stack.
fn keeps_out_strangers(run: &Child) {
    if std::fs::metadata("/proc/self").is_ok_and(|own| own.uid() != 0) || !has("setpriv") {
        return skipped("only root can become another user");
    }
    let prefix = format!("fss_{}_", run.id());
    let place = tempfile::tempdir().unwrap();
    let program = place.path().join("fss");
    std::fs::copy(env!("CARGO_BIN_EXE_fss"), &program).unwrap();
    for (file, mode) in [(place.path(), 0o755), (&*program, 0o755)] {
        std::fs::set_permissions(file, Permissions::from_mode(mode)).unwrap();
    }
    let stranger = Command::new("setpriv")
        .args(["--reuid", "65534", "--regid", "65534", "--clear-groups"])
        .args([path(&program), "top", "--once", "--bus", &prefix])
        .output()
        .unwrap();
    let said = [text(&stranger.stdout), text(&stranger.stderr)].concat();
    assert!(!stranger.status.success() && said.contains("cannot"), "{said}");
}

/// Whether no valve was open on an old command, in what the log holds of the valves.
fn valves_shut_in_time(log: &Path) {
    let states = Log::open(log).unwrap().samples::<ThrustersState>(topic::THRUSTERS_STATE.name).unwrap();
    let late = states.iter().filter(|state| state.valves.contains(&1) && state.command_age_ns > DEAD_MAN_NS);
    assert_eq!(late.count(), 0, "a valve was open on a command older than {DEAD_MAN_NS} ns");
    assert!(states.iter().any(|state| state.valves.contains(&1)), "no valve fired");
    let events = Log::open(log).unwrap().samples::<Event>(topic::EVENTS.name).unwrap();
    let shut = events.iter().filter(|event| text_of(&event.text).contains("all valves shut")).count();
    assert!(shut > 0, "the controller was killed, and nobody said that the valves were shut");
}

/// Whether tools that know nothing of fss find the topics of the guests, and read what we read.
fn read_by_others(log: &Path) {
    let python = std::env::var("FSS_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let is_there = Command::new(&python).args(["-c", "import rosbags, mcap"]).output();
    if !is_there.is_ok_and(|output| output.status.success()) {
        return skipped("rosbags is not there (FSS_PYTHON names a Python that has it)");
    }
    let tables = log.with_file_name("tables");
    done(&laboratory(&["log", "export", path(log), "--out", path(&tables)]).output().unwrap());
    let reader = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/read_log.py");
    let said = done(&Command::new(python).arg(reader).arg(log).arg(tables).args(TOPICS).output().unwrap());
    println!("{said}");
}

#[test]
fn services_in_three_languages_and_one_linked_in_fly_together_on_both_clocks_are_killed_and_computed_again() {
    if !has("cc") || !has("python3") {
        return;
    }
    if !laboratory(&["--version"]).output().is_ok_and(|output| output.status.success()) {
        return skipped("the example is not built: cargo build -p fss --example laboratory");
    }
    let place = tempfile::tempdir().unwrap();
    let stack = stack(place.path());

    let (first, second) = (fly_fast(&stack, &stack.join("first")), fly_fast(&stack, &stack.join("second")));
    assert!(std::fs::read(&first).unwrap() == std::fs::read(&second).unwrap(), "two fast flights differ");
    for (guest, (steps, starts)) in GUESTS.iter().zip(replayed(&first)) {
        assert!(steps > 500 && starts == 1, "{guest}: {steps} steps in {starts} starts");
    }
    // fss itself does not have the linked service, and says so.
    let without = super::common::fss(&["replay", path(&first)]);
    assert_eq!(without.status.code(), Some(2), "{}", text(&without.stderr));
    assert!(text(&without.stdout).contains("'turn_meter' is linked into another program"), "{}", text(&without.stdout));

    let out = stack.join("real-time");
    let _alone = super::alone();
    let arguments = flight(&stack, &out, false);
    let mut run = laboratory(&arguments.iter().map(String::as_str).collect::<Vec<_>>()).spawn().unwrap();
    strike_all(&mut run, &out);
    keeps_out_strangers(&run);
    done(&run.wait_with_output().unwrap());
    let log = out.join("run.mcap");
    valves_shut_in_time(&log);
    for (guest, (steps, starts)) in GUESTS.iter().zip(replayed(&log)) {
        assert!(steps > 300 && starts == 2, "{guest}: {steps} steps in {starts} starts");
    }
    let channels = Log::open(&log).unwrap().topics().unwrap();
    for name in TOPICS {
        assert!(channels.iter().any(|channel| channel.topic == name && channel.count > 300), "{name}: {channels:?}");
    }
    read_by_others(&log);
}
