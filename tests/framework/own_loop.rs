//! Programs with a loop of their own, in C and in Python, which join shared memory and are started by nobody.

use super::common::{succeed, text};
use super::{has, path, target};
use fss_bus::{Batch, Bus, InputPort, Output, OutputPort, SharedConfig, Time, remove_dead_nodes};
use fss_messages::topic::{self, Topic};
use fss_messages::{BaseCommand, Event, NavState, text_of};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const SOURCES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
const PING: Topic<NavState> = Topic::new("/ping");
const PONG: Topic<NavState> = Topic::new("/pong");

/// Builds libfss; its folder.
pub(crate) fn libfss() -> PathBuf {
    let cargo = Command::new("cargo")
        .args(["build", "--quiet", "--offline", "-p", "fss-c", "--manifest-path", &format!("{SOURCES}/Cargo.toml")])
        .env("CARGO_TARGET_DIR", target())
        .env("CARGO_PROFILE_DEV_DEBUG", "false")
        .output()
        .unwrap();
    assert!(cargo.status.success(), "{}", text(&cargo.stderr));
    target().join("debug")
}

/// The echo of `fss bench ipc` in C.
fn in_c(place: &Path) -> Command {
    let (library, program) = (libfss(), place.join("echo"));
    std::fs::write(place.join("fss_messages.h"), succeed(&["messages", "--c"])).unwrap();
    let compiler = Command::new("cc")
        .args([
            "-std=c11",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-I",
            path(place),
            "-I",
            &format!("{SOURCES}/interfaces/c/include"),
        ])
        .args([&format!("{SOURCES}/apps/bench/src/ipc/echo.c"), "-o", path(&program), "-L", path(&library), "-lfss"])
        .arg(format!("-Wl,--disable-new-dtags,-rpath,{}", path(&library)))
        .output()
        .unwrap();
    assert!(compiler.status.success(), "{}", text(&compiler.stderr));
    Command::new(program)
}

/// The same in Python.
fn in_python(place: &Path) -> Command {
    std::fs::write(place.join("fss_messages.py"), succeed(&["messages", "--python"])).unwrap();
    let mut command = Command::new("python3");
    command.arg(format!("{SOURCES}/apps/bench/src/ipc/echo.py"));
    command.env("PYTHONPATH", format!("{}:{SOURCES}/interfaces/python", path(place)));
    command.env("FSS_LIBRARY", libfss().join("libfss.so")).env("PYTHONDONTWRITEBYTECODE", "1");
    command
}

fn join(prefix: &str) -> Bus {
    Bus::shared(&SharedConfig { node: "test".to_owned(), prefix: prefix.to_owned() }).unwrap()
}

/// Sends samples to the program, which must send each back, say so in an event, and leave nothing.
fn answers(program: &mut Command, prefix: &str) {
    let bus = join(prefix);
    let (mut ping, mut pong) = (Output::open(&bus, PING).unwrap(), Batch::open(&bus, PONG).unwrap());
    let mut events = Batch::<Event>::open(&bus, topic::EVENTS).unwrap();
    let mut child = program.arg(prefix).stdout(Stdio::piped()).stderr(Stdio::inherit()).spawn().unwrap();
    let mut ready = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut ready).unwrap();
    assert_eq!(ready, "ready\n");
    for number in 1..=3_u64 {
        ping.publish(NavState { stamp_ns: number, x_m: 0.5 * number as f64, ..NavState::default() });
        ping.flush(Time::from_ns(number));
        let asked = Instant::now();
        while pong.samples().is_empty() {
            assert!(asked.elapsed() < Duration::from_secs(1), "no answer to sample {number}");
            pong.refresh();
        }
        let answer = pong.samples()[0];
        assert_eq!((answer.sequence, answer.stamp_ns, answer.x_m), (number, number, 0.5 * number as f64));
        // It was sent on the clock that all processes share.
        assert!(answer.published_ns > 1_000_000, "{}", answer.published_ns);
        pong.refresh();
        assert!(pong.samples().is_empty(), "it came once");
    }
    events.refresh();
    let said = events.samples().iter().find(|event| text_of(&event.service) == "echo").expect("its event");
    assert_eq!(text_of(&said.text), "sends back what comes");
    ping.publish(NavState { stamp_ns: u64::MAX, ..NavState::default() });
    ping.flush(Time::from_ns(4));
    assert!(child.wait().unwrap().success());
    drop((ping, pong, events, bus));
    assert_eq!(remove_dead_nodes(prefix, true).unwrap(), 0, "it left shared memory");
}

/// What the program says where it cannot join.
fn refuses(program: &mut Command, prefix: &str) -> String {
    let output = program.arg(prefix).output().unwrap();
    assert!(!output.status.success(), "it should be refused");
    text(&output.stderr)
}

#[test]
fn a_program_with_a_loop_of_its_own_takes_and_publishes_and_is_told_why_it_cannot() {
    for (language, compiler, make) in [("c", "cc", in_c as fn(&Path) -> Command), ("python", "python3", in_python)] {
        if !has(compiler) {
            continue;
        }
        let place = tempfile::tempdir().unwrap();
        let prefix = format!("fsstestown{language}_{}_", std::process::id());
        answers(&mut make(place.path()), &prefix);

        let said = refuses(&mut make(place.path()), "no/prefix");
        assert!(said.contains("no/prefix"), "{language}: {said}");
        let said = refuses(&mut make(place.path()), &prefix);
        assert!(said.contains("no stack runs") && said.contains(&prefix), "{language}: {said}");
        // Another has the topic with another layout.
        let bus = join(&prefix);
        let other = Output::<BaseCommand>::open(&bus, Topic::new("/ping")).unwrap();
        let said = refuses(&mut make(place.path()), &prefix);
        assert!(said.contains("/ping") && said.contains("fss_msgs/NavState@"), "{language}: {said}");
        drop((other, bus));
        remove_dead_nodes(&prefix, true).unwrap();
    }
}
