//! Services written elsewhere: made in a folder outside the repository, flown beside ours on both clocks, killed, recorded, and
//! computed again; and what happens when they do wrong.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;
#[path = "framework/misuse.rs"]
mod misuse;
#[path = "framework/own_loop.rs"]
mod own_loop;
#[path = "framework/together.rs"]
mod together;

use common::{refused, skipped, succeed, text};
use fss_messages::{Sample, TruthState, topic};
use fss_records::log::Log;
use serde_json::json;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What services that are built here share: foreign crates are compiled once.
fn target() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("framework")
}

/// Runs `./check` of a service's folder.
fn check(folder: &Path) -> String {
    let output = Command::new(folder.join("check"))
        .env("FSS", env!("CARGO_BIN_EXE_fss"))
        .env("CARGO_TARGET_DIR", target())
        .env("CARGO_NET_OFFLINE", "true")
        .env("CARGO_PROFILE_DEV_DEBUG", "false")
        .output()
        .unwrap();
    let said = [text(&output.stdout), text(&output.stderr)].concat();
    assert!(output.status.success(), "./check fails:\n{said}");
    said
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The process of a service in the stack of this folder: its program's name, or the service's behind `fss service`, is among the first
/// words of its command.
fn process_of(name: &str, folder: &Path) -> Option<u32> {
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    let mut ids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    ids.find(|id| {
        let line = text(&std::fs::read(format!("/proc/{id}/cmdline")).unwrap_or_default());
        let is_it = |word: &str| Path::new(word).file_stem().is_some_and(|stem| stem == name);
        line.split('\0').take(3).any(is_it) && line.contains(path(folder))
    })
}

fn kill(id: u32) {
    assert!(Command::new("kill").args(["-9", &id.to_string()]).status().unwrap().success());
}

/// One flight in real time at a time: a host of two cores has no room for two.
fn alone() -> MutexGuard<'static, ()> {
    static REAL_TIME: Mutex<()> = Mutex::new(());
    REAL_TIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes a service in a folder of its own.
fn meter(place: &Path, name: &str, language: &str) -> PathBuf {
    let folder = place.canonicalize().unwrap().join(name);
    succeed(&["new", "service", name, language, "--out", path(&folder)]);
    folder
}

/// Makes a service in a folder outside the repository, flies it on the virtual clock, and computes it again.
fn fly_alone(place: &Path, name: &str, language: &str) {
    let folder = meter(place, name, language);
    let said = check(&folder);
    assert!(said.contains(&format!("/{name}/state is in the log at 50.00 Hz")), "{said}");

    // The same seed, the same bytes, whatever the two processes did meanwhile.
    let (launch, again) = (folder.join("launch.toml"), folder.join("again"));
    succeed(&["run", "hold", "--fast", "--quiet", "--launch", path(&launch), "--out", path(&again)]);
    let log = folder.join("out/run.mcap");
    assert!(std::fs::read(&log).unwrap() == std::fs::read(again.join("run.mcap")).unwrap(), "two fast flights differ");

    succeed(&["log", "export", path(&log), "--out", path(&folder.join("tables"))]);
    let table = std::fs::read_to_string(folder.join(format!("tables/{name}.state.csv"))).unwrap();
    assert!(table.lines().next().unwrap().contains("speed_m_s"), "{table:.200}");
    assert!(table.lines().count() > 1000);

    // What it refuses ends the flight with its own words.
    let launch = std::fs::read_to_string(launch).unwrap();
    let wrong = folder.join("wrong.toml");
    let fly = ["run", "hold", "--fast", "--quiet", "--launch", path(&wrong), "--out", path(&again)];
    std::fs::write(&wrong, launch.replace("smoothing_s = 0.5", "smoothing_s = -0.5")).unwrap();
    refused(&fly, &[name, "smoothing_s is a time of zero or more"]);
    std::fs::write(&wrong, launch.replace("smoothing_s", "smothing_s")).unwrap();
    let line = 1 + launch.lines().position(|line| line.contains("smoothing_s")).unwrap();
    refused(&fly, &[&format!("wrong.toml:{line}:"), "unknown field `smothing_s`"]);
}

/// Whether this computer has a program; a test that needs it shows nothing otherwise.
fn has(program: &str) -> bool {
    let found = Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success());
    if !found {
        skipped(&format!("there is no {program}"));
    }
    found
}

#[test]
fn a_service_in_rust_flies_on_the_virtual_clock_and_refuses_what_it_does_not_take() {
    fly_alone(tempfile::tempdir().unwrap().path(), "rmeter", "--rust");
}

#[test]
fn a_service_in_c_flies_on_the_virtual_clock_and_refuses_what_it_does_not_take() {
    if has("cc") {
        fly_alone(tempfile::tempdir().unwrap().path(), "cmeter", "--c");
    }
}

#[test]
fn a_service_in_python_flies_on_the_virtual_clock_and_refuses_what_it_does_not_take() {
    if has("python3") {
        fly_alone(tempfile::tempdir().unwrap().path(), "pmeter", "--python");
    }
}

/// Root mean square of how far the base was from where it began, m, and turned, rad.
fn strayed(log: &Path) -> [f64; 2] {
    let truth = Log::open(log).unwrap().samples::<TruthState>(topic::TRUTH_STATE.name).unwrap();
    let (first, count) = (truth[0], truth.len() as f64);
    let mean_square = |error: &dyn Fn(&TruthState) -> f64| truth.iter().map(|t| error(t).powi(2)).sum::<f64>() / count;
    [mean_square(&|t| (t.x_m - first.x_m).hypot(t.y_m - first.y_m)), mean_square(&|t| t.theta_rad - first.theta_rad)]
        .map(f64::sqrt)
}

/// Makes a controller that flies in place of `base`.
fn controller(place: &Path, language: &str, source: &str, text: &str) -> PathBuf {
    let folder = meter(place, "pd", language);
    std::fs::write(folder.join(source), text).unwrap();
    let launch = std::fs::read_to_string(folder.join("launch.toml")).unwrap();
    let tables: Vec<&str> = launch.split("[[service]]").filter(|table| !table.contains("name = \"base\"")).collect();
    let launch = tables.join("[[service]]").replace("smoothing_s = 0.5", "bandwidth_rad_s = 0.5");
    let (ours, own) = launch.split_at(launch.find("name = \"pd\"").unwrap());
    let own = own.replace("rate_hz = 50", "rate_hz = 100").replace("phase_us = 3000", "phase_us = 1500");
    std::fs::write(folder.join("launch.toml"), [ours, &own].concat()).unwrap();
    folder
}

/// Flies `hold` with it on the virtual clock, as `./check` does, and gives the log.
fn hold_with_a_controller(place: &Path, language: &str, source: &str, text: &str) -> PathBuf {
    let folder = controller(place, language, source, text);
    let said = check(&folder);
    assert!(said.contains("/pd/state is in the log at 100.00 Hz"), "{said}");
    folder.join("out/run.mcap")
}

#[test]
fn a_controller_in_each_language_holds_the_base_in_place_of_ours() {
    let place = tempfile::tempdir().unwrap();
    let ours = place.path().join("ours");
    succeed(&["run", "hold", "--fast", "--quiet", "--out", path(&ours)]);
    let ours = strayed(&ours.join("run.mcap"));
    let languages = [
        ("--rust", "src/main.rs", include_str!("data/controllers/pd.rs")),
        ("--c", "main.c", include_str!("data/controllers/pd.c")),
        ("--python", "pd.py", include_str!("data/controllers/pd.py")),
    ];
    let is_there = |language: &&(&str, &str, &str)| match language.0 {
        "--c" => has("cc"),
        "--python" => has("python3"),
        _ => true,
    };
    for (language, source, text) in languages.iter().filter(is_there) {
        let place = tempfile::tempdir().unwrap();
        let theirs = strayed(&hold_with_a_controller(place.path(), language, source, text));
        println!("{language}: {theirs:?} m and rad, ours {ours:?}");
        assert!(theirs[0] < 1.2 * ours[0] && theirs[1] < 1.2 * ours[1], "{language}: {theirs:?}, ours {ours:?}");
    }
}

#[test]
fn a_service_in_c_or_python_takes_every_sample_and_texts_and_tables_of_its_config() {
    let languages = [
        ("--c", "cc", "main.c", include_str!("data/takers/taker.c")),
        ("--python", "python3", "taker.py", include_str!("data/takers/taker.py")),
    ];
    for (language, _, source, text) in languages.iter().filter(|(_, needs, _, _)| has(needs)) {
        let place = tempfile::tempdir().unwrap();
        let folder = meter(place.path(), "taker", language);
        std::fs::write(folder.join(source), text).unwrap();
        let launch = std::fs::read_to_string(folder.join("launch.toml")).unwrap();
        let launch = launch.replace("smoothing_s = 0.5", "frame = \"table\", gains = { kp = [1, 2.5] }");
        let (ours, own) = launch.split_at(launch.find("name = \"taker\"").unwrap());
        let own = own.replace("rate_hz = 50", "rate_hz = 20");
        std::fs::write(folder.join("launch.toml"), [ours, &own].concat()).unwrap();
        // Flies, and is computed again from the samples that each of its steps took.
        check(&folder);
        succeed(&["log", "export", path(&folder.join("out/run.mcap")), "--out", path(&folder.join("tables"))]);
        let table = std::fs::read_to_string(folder.join("tables/taker.state.csv")).unwrap();
        let rows: Vec<Vec<f64>> =
            table.lines().skip(1).map(|row| row.split(',').map(|value| value.parse().unwrap()).collect()).collect();
        // Navigation has 200 Hz, the service 20 Hz: once it is there, ten at a time, none twice and none lost.
        let flying = rows.iter().skip_while(|row| row[3] == 0.0).skip(1);
        assert!(
            flying.clone().count() > 500 && flying.clone().all(|row| row[3..] == [10.0, 1.0]),
            "{language}: {table}"
        );
    }
}

#[test]
fn a_service_that_floods_and_writes_garbage_disturbs_nothing_else() {
    if !has("python3") {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let folder = meter(place.path(), "wild", "--python");
    std::fs::write(folder.join("wild.py"), include_str!("data/takers/wild.py")).unwrap();
    // It flies, its topic is in the log at its rate, and its garbage is the same again.
    check(&folder);
    let (wild, without) = (folder.join("out/run.mcap"), folder.join("without"));
    succeed(&["run", "hold", "--fast", "--quiet", "--out", path(&without)]);
    // The vehicle moved as it does without such a service, to the last bit.
    succeed(&["compare", path(&wild), path(&without.join("run.mcap")), "--only", "/truth/state"]);
}

/// What a stand-in says of itself: the service `odd`, which publishes one topic.
fn description(topic: &str, schema: &str, definition: &str) -> String {
    let output = json!({ "topic": topic, "schema": schema, "definition": definition });
    json!({ "format": "fss-service/1", "service": "odd", "inputs": [], "outputs": [output] }).to_string()
}

/// Makes a shell script stand in for a program, and a launch file with it.
fn stand_in(place: &Path, script: &str) -> PathBuf {
    let (program, launch) = (place.join("odd"), place.join("launch.toml"));
    std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let table = "\n[[service]]\nname = \"odd\"\nprogram = \"odd\"\nrate_hz = 50\n";
    std::fs::write(&launch, [include_str!("../deploy/etc/launch/lab.toml"), table].concat()).unwrap();
    launch
}

/// Flies with a shell script for a program, on the virtual clock, which must be refused with all of `words`.
#[track_caller]
fn refuse_stand_in(script: &str, words: &[&str]) {
    refuse_stand_in_on("--fast", script, words);
}

/// The same on the clock that an argument says.
#[track_caller]
fn refuse_stand_in_on(clock: &str, script: &str, words: &[&str]) {
    let place = tempfile::tempdir().unwrap();
    let (launch, out) = (stand_in(place.path(), script), place.path().join("out"));
    refused(&["run", "hold", clock, "--quiet", "--launch", path(&launch), "--out", path(&out)], words);
}

/// A script that describes itself so, and does `then` when it is to fly.
fn script(description: &str, then: &str) -> String {
    format!("if [ \"$1\" = --describe ]; then\ncat <<'END'\n{description}\nEND\nelse\n{then}\nfi")
}

const OWN: &str = "uint64 sequence\nuint64 stamp_ns\nuint64 published_ns\nfloat64 x_m\n";

#[test]
fn a_program_that_does_not_go_with_the_others_is_refused_at_its_line() {
    let definition = fss_messages::BaseCommand::definition();
    let claims = description(topic::BASE_COMMAND.name, "fss_msgs/msg/BaseCommand", &definition);
    let other = description("/events", "fss_msgs/msg/Event", OWN);
    // Whichever clock: on seed 1, as without it, in real time.
    for clock in ["--fast", "--seed=1"] {
        let claimed = ["launch.toml:", "/base/command", "'base' publishes already", "remove one"];
        refuse_stand_in_on(clock, &script(&claims, ":"), &claimed);
        let carried = ["launch.toml:", "/events carries fss_msgs/Event@", "same definition"];
        refuse_stand_in_on(clock, &script(&other, ":"), &carried);
    }
    let padded = description("/odd/state", "odd_msgs/msg/OddState", &format!("{OWN}uint8 a\nfloat64 b"));
    refuse_stand_in(&script(&padded, ":"), &["/odd/state", "line 6", "order the fields by size"]);
    let name = description("/Odd State", "odd_msgs/msg/OddState", OWN);
    refuse_stand_in(&script(&name, ":"), &["'/Odd State' is no name of a topic"]);
    refuse_stand_in("echo hello", &["launch.toml:", "odd", "describes itself with --describe"]);
    refuse_stand_in("sleep 60", &["did not describe itself within 5 s"]);
}

#[test]
fn a_program_that_ends_or_never_answers_ends_the_flight_on_the_virtual_clock_with_its_name() {
    let own = description("/odd/state", "odd_msgs/msg/OddState", OWN);
    refuse_stand_in(&script(&own, "echo no luck today >&2; exit 3"), &["service 'odd'", "no luck today"]);
    refuse_stand_in(&script(&own, "exec sleep 60"), &["service 'odd'", "did not answer within 10 s"]);
    let left = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let left: Vec<_> = left.filter(|file| file.file_name().to_string_lossy().starts_with("fssstep")).collect();
    let is_ours =
        |file: &std::fs::DirEntry| file.file_name().to_string_lossy().contains(&std::process::id().to_string());
    assert!(!left.iter().any(is_ours), "{left:?}");
}
