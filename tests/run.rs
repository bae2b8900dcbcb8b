//! Whole runs of the program, as a user starts them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{refused, succeed, text};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn summary(folder: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join("summary.json")).unwrap()).unwrap()
}

fn number(value: &serde_json::Value, path: &str) -> f64 {
    path.split('.').fold(value, |v, key| &v[key]).as_f64().unwrap_or_else(|| panic!("no number {path} in {value}"))
}

/// A launch file whose ports no other test uses.
fn launch_file(folder: &Path, first_port: u16) -> PathBuf {
    let text = include_str!("../deploy/etc/launch/lab.toml")
        .replace("51001", &first_port.to_string())
        .replace("5110", &(first_port / 10 + 1).to_string());
    let path = folder.join("launch-test.toml");
    std::fs::write(&path, text).unwrap();
    path
}

/// Processes whose command line names this folder.
fn processes_in(folder: &Path) -> Vec<(u32, String)> {
    let folder = folder.display().to_string();
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/proc").unwrap().flatten() {
        let Ok(id) = entry.file_name().to_string_lossy().parse() else { continue };
        let command = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
        let command = text(&command).replace('\0', " ");
        if command.contains(&folder) {
            found.push((id, command));
        }
    }
    found
}

/// What a run in this folder has left running.
fn left_behind(folder: &Path) -> Vec<String> {
    processes_in(folder).into_iter().map(|(_, command)| command).collect()
}

fn check_zero_reaction(s: &serde_json::Value) {
    assert_eq!(s["outcome"], "done");
    assert!(number(s, "base_rotation_deg.max_deg") < 0.3, "{s}");
    assert!((number(s, "end_effector.moved_m") - 0.1).abs() < 0.005, "{s}");
    assert!(number(s, "end_effector.final_error_m") < 0.005, "{s}");
    assert!(number(s, "navigation.position_rms_m") < 1e-3 && number(s, "navigation.heading_rms_deg") < 0.1, "{s}");
}

#[test]
fn a_zero_reaction_maneuver_moves_the_arm_and_not_the_heading() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    succeed(&["run", "--fast", "--quiet", "--out", out]);
    check_zero_reaction(&summary(folder.path()));
}

#[test]
fn no_run_replaces_another_unasked() {
    let folder = tempfile::tempdir().unwrap();
    for expected in ["out/reach/run.mcap", "out/reach-2/run.mcap", "out/reach-3/run.mcap"] {
        let output = Command::new(env!("CARGO_BIN_EXE_fss"))
            .args(["run", "reach", "--fast", "--quiet"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert!(folder.path().join(expected).exists(), "{expected}");
    }
}

#[test]
fn the_same_line_without_it_turns_the_base() {
    let folder = tempfile::tempdir().unwrap();
    succeed(&["run", "reach", "--fast", "--quiet", "--out", folder.path().to_str().unwrap()]);
    let s = summary(folder.path());
    assert!(number(&s, "base_rotation_deg.max_deg") > 8.0, "{s}");
    assert!(number(&s, "end_effector.final_error_m") < 0.005, "{s}");
}

#[test]
fn the_base_slews_and_holds_on_its_thrusters() {
    let folder = tempfile::tempdir().unwrap();
    succeed(&["run", "slew", "--fast", "--quiet", "--out", folder.path().to_str().unwrap()]);
    let s = summary(folder.path());
    assert!((number(&s, "base_rotation_deg.end_deg") - 20.0).abs() < 1.0, "{s}");
    succeed(&["run", "hold", "--fast", "--quiet", "--out", folder.path().to_str().unwrap()]);
    assert!(number(&summary(folder.path()), "base_rotation_deg.max_deg") < 1.0);
}

#[test]
fn two_fast_runs_with_one_seed_record_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, seed: &str| {
        let out = folder.path().join(name);
        succeed(&["run", "--fast", "--quiet", "--seed", seed, "--out", out.to_str().unwrap()]);
        std::fs::read(out.join("run.mcap")).unwrap()
    };
    let first = run("a", "7");
    assert!(first == run("b", "7"), "one seed, two logs");
    assert!(first != run("c", "8"), "the seed must matter");
}

#[test]
fn the_stack_flies_as_processes_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let launch = launch_file(folder.path(), 52_010);
    let out = folder.path().join("out");
    let (launch, out_text) = (launch.to_str().unwrap(), out.to_str().unwrap());
    succeed(&["run", "--quiet", "--launch", launch, "--out", out_text]);
    let s = summary(&out);
    check_zero_reaction(&s);
    for topic in s["topics"].as_array().unwrap() {
        assert!(topic["count"].as_u64().unwrap() > 5, "{topic}");
    }
    let services = s["services"].as_object().unwrap();
    assert!(services.values().all(|f| f["starts"] == 1 && f["dropped"] == 0), "{s}");
    assert_eq!(left_behind(folder.path()), Vec::<String>::new());
}

#[test]
fn ctrl_c_leaves_a_finished_log_and_no_process() {
    let folder = tempfile::tempdir().unwrap();
    let launch = launch_file(folder.path(), 52_030);
    let out = folder.path().join("out");
    let mut run = Command::new(env!("CARGO_BIN_EXE_fss"))
        .args(["run", "hold", "--quiet", "--launch", launch.to_str().unwrap(), "--out", out.to_str().unwrap()])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(6));
    assert!(Command::new("kill").args(["-INT", &run.id().to_string()]).status().unwrap().success());
    let asked = Instant::now();
    while run.try_wait().unwrap().is_none() {
        assert!(asked.elapsed() < Duration::from_secs(30), "it does not stop");
        std::thread::sleep(Duration::from_millis(50));
    }
    let info = succeed(&["log", "info", "--json", out.join("run.mcap").to_str().unwrap()]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(info["complete"], true);
    assert_eq!(left_behind(folder.path()), Vec::<String>::new());
}

/// An upgrade puts another file in the program's place, or takes it away, while a vehicle flies.
#[test]
fn a_service_comes_back_though_the_programs_file_is_gone() {
    let folder = tempfile::tempdir().unwrap();
    let launch = launch_file(folder.path(), 52_130);
    let (program, out) = (folder.path().join("upgraded"), folder.path().join("out"));
    std::fs::copy(env!("CARGO_BIN_EXE_fss"), &program).unwrap();
    let mut run = Command::new(&program)
        .args(["run", "hold", "--quiet", "--launch", launch.to_str().unwrap(), "--out", out.to_str().unwrap()])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let arm = || processes_in(folder.path()).into_iter().find(|(_, command)| command.contains("service arm"));
    let begun = Instant::now();
    let one_that_is_not = |other: u32| loop {
        match arm() {
            Some((id, _)) if id != other => return id,
            _ => std::thread::sleep(Duration::from_millis(50)),
        }
        assert!(begun.elapsed() < Duration::from_secs(50), "the arm's service is missing");
    };
    let first = one_that_is_not(0);
    std::thread::sleep(Duration::from_secs(2));
    std::fs::remove_file(&program).unwrap();
    assert!(Command::new("kill").args(["-KILL", &first.to_string()]).status().unwrap().success());
    one_that_is_not(first);
    assert!(run.try_wait().unwrap().is_none(), "the flight has ended");
    assert!(Command::new("kill").args(["-INT", &run.id().to_string()]).status().unwrap().success());
    let output = run.wait_with_output().unwrap();
    assert_eq!(left_behind(folder.path()), Vec::<String>::new(), "{}", text(&output.stderr));
}

#[test]
fn a_dead_laboratory_ends_the_run_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let launch = launch_file(folder.path(), 52_090);
    let out = folder.path().join("out");
    let run = Command::new(env!("CARGO_BIN_EXE_fss"))
        .args(["run", "hold", "--quiet", "--launch", launch.to_str().unwrap(), "--out", out.to_str().unwrap()])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(4));
    let lab = processes_in(folder.path()).into_iter().find(|(_, command)| command.contains("fss lab")).unwrap().0;
    assert!(Command::new("kill").args(["-KILL", &lab.to_string()]).status().unwrap().success());
    let output = run.wait_with_output().unwrap();
    let said = text(&output.stderr);
    assert!(!output.status.success() && said.contains("service 'lab' ended"), "{said}");
    assert_eq!(left_behind(folder.path()), Vec::<String>::new());
    succeed(&["log", "info", out.join("run.mcap").to_str().unwrap()]);
}

#[test]
fn a_busy_port_is_named_and_nothing_is_left_running() {
    let folder = tempfile::tempdir().unwrap();
    let launch = launch_file(folder.path(), 52_050);
    let out = folder.path().join("out");
    let _taken = std::net::UdpSocket::bind("127.0.0.1:52050").unwrap();
    let (launch, out) = (launch.to_str().unwrap(), out.to_str().unwrap());
    refused(&["run", "--quiet", "--launch", launch, "--out", out], &["fusion", "127.0.0.1:52050", "[devices] mocap"]);
    assert_eq!(left_behind(folder.path()), Vec::<String>::new());
}

#[test]
fn wrong_files_are_refused_with_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let out = folder.path().join("out");
    let out = out.to_str().unwrap();
    refused(&["run", "fly-to-the-moon", "--out", out], &["no mission 'fly-to-the-moon'", "zero-reaction"]);
    refused(&["run", "--plant", "no-such.toml", "--out", out], &["no-such.toml", "cannot read the plant file"]);
    let plant = write("heavy.toml", "[base]\nmass_kg = -10.0\ninertia_kg_m2 = 0.25\n");
    refused(&["run", "--plant", &plant, "--out", out], &["heavy.toml:2", "mass_kg"]);
    let lab = include_str!("../deploy/etc/launch/lab.toml");
    let launch = write("launch.toml", &lab.replace("name = \"arm\"", "name = \"leg\""));
    refused(&["run", "--launch", &launch, "--out", out], &["launch.toml:", "there is no service 'leg'"]);
    let launch = write("links.toml", &lab.replace("\"127.0.0.1:51101\", ", ""));
    refused(&["run", "--launch", &launch, "--out", out], &["3 link addresses", "4 links"]);
    let mission = write(
        "m.toml",
        "name = \"m\"\ndescription = \"d\"\n[[phase]]\nname = \"p\"\nduration_s = -1\nbase = { goal = \"free\" }\narm = { goal = \"hold\" }\n",
    );
    refused(&["run", &mission, "--out", out], &["m.toml:5", "duration_s"]);
    assert!(!Path::new(out).exists(), "a refused run writes nothing");
}

#[test]
fn a_service_alone_names_the_device_it_misses() {
    let folder = tempfile::tempdir().unwrap();
    let launch = launch_file(folder.path(), 52_070);
    let out = folder.path().join("out");
    succeed(&[
        "run",
        "hold",
        "--fast",
        "--quiet",
        "--launch",
        launch.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ]);
    let bus = format!("fsstest{}_", std::process::id());
    let run = out.to_str().unwrap();
    refused(&["service", "fusion", "--run", run, "--bus", &bus], &["gyro", "gyro.tty", "[devices] gyro"]);
    refused(&["service", "thrusters", "--run", run, "--bus", &bus], &["valves", "valves.sock", "[devices] valves"]);
    for file in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        if file.file_name().to_string_lossy().starts_with(&bus) {
            std::fs::remove_file(file.path()).unwrap();
        }
    }
}
