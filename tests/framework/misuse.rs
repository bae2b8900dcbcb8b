//! What a program can do wrong while the stack flies in real time: it gets one clear error or is started again, the others fly on,
//! and nothing is left in shared memory.

use super::common::text;
use super::own_loop::libfss;
use super::{OWN, alone, description, has, meter, path, script, stand_in};
use fss_messages::{Event, Health, NavState, Sample, ThrustersState, text_of, topic};
use fss_records::log::Log;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A mission of some seconds.
const MISSION: &str = "name = \"still\"\ndescription = \"The base holds its pose.\"\n[initial]\nq_deg = [-30, 60, -60, 30]\n[[phase]]\n\
    name = \"still\"\nduration_s = 10\nbase = { goal = \"hold\" }\narm = { goal = \"hold\" }\n";

/// Flies in real time, with ports of its own, and sees that nothing of the stack is left in shared memory.
fn fly(folder: &Path, launch: &Path) -> Output {
    let (mission, own) = (folder.join("still.toml"), folder.join("ports.toml"));
    std::fs::write(&mission, MISSION).unwrap();
    let text = std::fs::read_to_string(launch).unwrap();
    std::fs::write(&own, text.replace("51001", "54501").replace("5110", "5461")).unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_fss"))
        .args(["run", path(&mission), "--quiet", "--launch", path(&own), "--out", path(&folder.join("out"))])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let prefix = format!("fss_{}_", run.id());
    let output = run.wait_with_output().unwrap();
    for place in ["/dev/shm", "/tmp/iceoryx2/nodes", "/tmp/iceoryx2/services"] {
        let files = std::fs::read_dir(place).into_iter().flatten().flatten().map(|file| file.file_name());
        let left: Vec<_> = files.filter(|name| name.to_string_lossy().starts_with(&prefix)).collect();
        assert!(left.is_empty(), "{place}: {left:?}");
    }
    output
}

fn samples<T: Sample>(folder: &Path, name: &str) -> Vec<T> {
    Log::open(&folder.join("out/run.mcap")).unwrap().samples(name).unwrap()
}

/// What the launcher said of a service, in one text.
fn said_of(folder: &Path, service: &str) -> String {
    let events = samples::<Event>(folder, topic::EVENTS.name);
    let launchers = events.iter().filter(|event| text_of(&event.service) == "launcher");
    let of_it: Vec<&str> = launchers.map(|event| text_of(&event.text)).filter(|text| text.contains(service)).collect();
    of_it.join("\n")
}

/// All services but the one have started once, navigation has no gap, and valves obeyed.
fn others_are_undisturbed(folder: &Path, but: &str) {
    let health = samples::<Health>(folder, topic::HEALTH.name);
    let restarted = health.iter().filter(|health| health.starts > 1).map(|health| text_of(&health.service));
    assert!(restarted.clone().all(|name| name == but), "{:?}", restarted.collect::<Vec<_>>());
    let navigation = samples::<NavState>(folder, topic::NAV_STATE.name);
    let valves = samples::<ThrustersState>(folder, topic::THRUSTERS_STATE.name);
    let is_whole = |numbers: Vec<u64>| numbers.len() > 100 && numbers.windows(2).all(|pair| pair[1] == pair[0] + 1);
    assert!(is_whole(navigation.iter().map(|state| state.sequence).collect()), "navigation has a gap");
    assert!(is_whole(valves.iter().map(|state| state.sequence).collect()), "the valves' states have a gap");
}

#[test]
fn a_program_that_fails_to_start_then_freezes_then_floods_with_garbage_comes_back_and_disturbs_nobody() {
    if !has("python3") {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let folder = meter(place.path(), "odd", "--python");
    std::fs::write(folder.join("odd.py"), include_str!("../data/takers/odd.py")).unwrap();
    std::fs::create_dir(folder.join("bin")).unwrap();
    std::fs::copy(libfss().join("libfss.so"), folder.join("bin/libfss.so")).unwrap();
    let messages = super::common::succeed(&["messages", "--python"]);
    std::fs::write(folder.join("fss_messages.py"), messages).unwrap();
    let own = super::common::succeed(&["messages", "--python", path(&folder.join("odd_msgs/msg/OddState.msg"))]);
    std::fs::write(folder.join("odd_messages.py"), own).unwrap();

    let _alone = alone();
    let output = fly(&folder, &folder.join("launch.toml"));
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = said_of(&folder, "odd");
    assert!(said.contains("odd could not start") && said.contains("restart in 10 ms"), "{said}");
    assert_eq!(said.matches("gave no sign of life").count(), 1, "{said}");
    let health = samples::<Health>(&folder, topic::HEALTH.name);
    assert!(health.iter().any(|health| text_of(&health.service) == "odd" && health.starts == 3), "{said}");
    others_are_undisturbed(&folder, "odd");

    // Its garbage is in the log, under the numbers that its port gave each sample.
    super::common::succeed(&[
        "log",
        "export",
        path(&folder.join("out/run.mcap")),
        "--out",
        path(&folder.join("tables")),
    ]);
    let table = std::fs::read_to_string(folder.join("tables/odd.state.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|row| row.split(',').collect()).collect();
    let numbers: Vec<u64> = rows.iter().map(|row| row[0].parse().unwrap()).collect();
    assert!(rows.iter().any(|row| row[3] == "NaN") && numbers.len() > 3000, "{} rows", rows.len());
    assert!(numbers.windows(2).all(|pair| pair[1] > pair[0] || pair[1] == 1), "numbers of its own");
}

/// Flies with a shell script for the program `odd`; what `fss run` says of it, without the frame that breaks its lines.
fn fly_stand_in(then: &str) -> (tempfile::TempDir, String) {
    let place = tempfile::tempdir().unwrap();
    let own = description("/odd/state", "odd_msgs/msg/OddState", OWN);
    let launch = stand_in(place.path(), &script(&own, then));
    let _alone = alone();
    let output = fly(place.path(), &launch);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let said = text(&output.stderr).replace(['│', '\n'], " ");
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(!said.contains("panicked"), "{said}");
    (place, said)
}

#[test]
fn a_program_that_never_starts_ends_the_flight_with_its_reason() {
    let (place, said) = fly_stand_in("echo no luck today >&2; exit 3");
    assert!(said.contains("service 'odd' could not start") && said.contains("no luck today"), "{said}");
    assert_eq!(said.matches("no luck today").count(), 1, "one error: {said}");
    others_are_undisturbed_so_far(place.path());
}

#[test]
fn a_program_that_is_struck_down_at_each_start_ends_the_flight_in_safe_mode_with_its_name() {
    let (place, said) = fly_stand_in("kill -SEGV $$");
    assert!(said.contains("'odd' ended 8 times in a row") && said.contains("safe mode"), "{said}");
    let told = said_of(place.path(), "odd");
    for pause_ms in [10, 20, 40, 80] {
        assert!(told.contains(&format!("restart in {pause_ms} ms")), "{told}");
    }
    others_are_undisturbed_so_far(place.path());
}

/// No other service had to be started again before the flight was given up.
fn others_are_undisturbed_so_far(folder: &Path) {
    let health = samples::<Health>(folder, topic::HEALTH.name);
    assert!(health.iter().all(|health| health.starts == 1), "another service was started again");
}
