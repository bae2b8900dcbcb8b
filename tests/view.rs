//! The page on the loopback: what it serves, whom it refuses, and what a browser makes of it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{json, refused, succeed, text};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// `fss view`, stopped at the end of a test.
struct View {
    process: Child,
    port: u16,
}

impl View {
    fn start(arguments: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_fss"))
            .args([&["view", "--port", "0"], arguments].concat())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let port = line.strip_prefix("http://127.0.0.1:").unwrap_or_else(|| panic!("it said '{line}'"));
        let port = port.split('/').next().unwrap().parse().unwrap();
        Self { process, port }
    }

    fn connect(&self) -> TcpStream {
        let connection = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        connection.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        connection
    }

    /// What it answers to these bytes.
    fn answer(&self, request: &str) -> String {
        let mut connection = self.connect();
        connection.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        // Who is refused before all was read may be cut off.
        let _ = connection.read_to_end(&mut answer);
        text(&answer)
    }

    /// Stops it; what it complained of.
    fn stop(mut self) -> String {
        self.process.kill().unwrap();
        let mut said = String::new();
        self.process.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        said
    }

    /// The body at a path.
    fn get(&self, path: &str) -> String {
        let answer = self.answer(&format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", self.port));
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        assert!(head.starts_with("HTTP/1.1 200 OK"), "{path}: {head}");
        body.to_owned()
    }
}

impl Drop for View {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn flown(folder: &Path, mission: &str, seed: &str) -> String {
    let out = folder.join("out");
    succeed(&["run", mission, "--fast", "--quiet", "--seed", seed, "--out", out.to_str().unwrap()]);
    out.join("run.mcap").to_str().unwrap().to_owned()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

#[test]
fn a_log_is_shown_as_it_was_flown_by_a_page_that_needs_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let log = flown(folder.path(), "slew", "3");
    let view = View::start(&[&log]);

    let page = view.get("/");
    for reference in ["http://", "https://", "//cdn", "<script>", "onclick"] {
        assert!(
            !page.contains(reference),
            "the page refers to something outside, or runs words of its own: {reference}"
        );
    }
    for file in ["/view.css", "/view.js", "/above.js", "/strips.js"] {
        assert!(!view.get(file).contains("http"), "{file}");
    }
    let scene: Value = serde_json::from_str(&view.get("/scene.json")).unwrap();
    assert_eq!((&scene["live"], &scene["title"]), (&false.into(), &"slew".into()));
    assert_eq!(["links", "plumes", "target"].map(|of| scene[of].as_array().unwrap().len()), [4, 8, 0]);
    assert_eq!(scene["table"]["corners_m"], serde_json::json!([[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]]));

    let flight: Value = serde_json::from_str(&view.get("/flight.json")).unwrap();
    let summary = json(&folder.path().join("out/summary.json"));
    let frames = flight["frames"].as_array().unwrap();
    let (first, last) = (&frames[0], &frames[frames.len() - 1]);
    let rate_hz = (frames.len() - 1) as f64 / (number(&last["t"]) - number(&first["t"]));
    assert!((29.0..31.0).contains(&rate_hz), "{rate_hz} frames a second");
    let turned_deg = (number(&last["base"][2]) - number(&first["base"][2])).to_degrees();
    assert!((turned_deg - number(&summary["base_rotation_deg"]["end_deg"])).abs() < 0.05, "{turned_deg}");
    let used = number(&last["gas"]) - number(&summary["gas_used_kg"]);
    assert!(used.abs() < 1e-5, "gas differs by {used} kg");
    // Whatever opened for however short a time is seen in some frame.
    let fired = frames.iter().fold(0, |all, frame| all | frame["pushing"].as_u64().unwrap());
    assert!(fired.count_ones() >= 4, "a slew needs two pairs of thrusters: {fired:#b}");
    assert!(frames.iter().any(|frame| frame["phase"] == "turn" || frame["phase"] == "slew"), "phases have their names");
}

#[test]
fn a_log_is_served_to_this_computer_alone() {
    let folder = tempfile::tempdir().unwrap();
    let log = flown(folder.path(), "slew", "3");
    let view = View::start(&[&log]);
    let refused = |request: String, status: &str| {
        let answer = view.answer(&request);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{}: {answer}", &request[..request.len().min(60)]);
    };
    let host = format!("Host: 127.0.0.1:{}\r\n", view.port);
    refused(format!("GET / HTTP/1.1\r\nHost: evil.example:{}\r\n\r\n", view.port), "403");
    refused("GET / HTTP/1.1\r\n\r\n".to_owned(), "403");
    refused(format!("GET / HTTP/1.1\r\n{host}Host: evil.example\r\n\r\n"), "403");
    for origin in ["https://evil.example", "null", "http://localhost.evil.example", "http://localhost:1", "file://"] {
        refused(format!("GET /scene.json HTTP/1.1\r\n{host}Origin: {origin}\r\n\r\n"), "403");
    }
    let own = format!("Origin: http://127.0.0.1:{}\r\n", view.port);
    refused(format!("GET /scene.json HTTP/1.1\r\n{host}{own}Origin: https://evil.example\r\n\r\n"), "403");
    assert!(
        view.answer(&format!("GET /scene.json HTTP/1.1\r\n{host}{own}\r\n")).starts_with("HTTP/1.1 200"),
        "its own page"
    );
    refused(format!("POST / HTTP/1.1\r\n{host}\r\n"), "405");
    refused(format!("GET /../../etc/passwd HTTP/1.1\r\n{host}\r\n"), "404");
    refused(format!("GET / HTTP/1.1\r\n{host}X: {}\r\n\r\n", "a".repeat(9000)), "431");
    refused(format!("GET / HTTP/1.1\r\n{host}{}\r\n", "X: y\r\n".repeat(100)), "431");
    refused("\0\u{1}nonsense\r\n\r\n".to_owned(), "400");
    assert!(view.get("/").contains("fss view"), "it still serves");
    // Of all addresses it listens on the loopback's alone.
    let port = format!(":{:04X} ", view.port);
    let listening = |file: &str| -> Vec<String> {
        let table = std::fs::read_to_string(file).unwrap_or_default();
        table.lines().filter(|l| l.contains(&port) && l.contains(" 0A ")).map(str::to_owned).collect()
    };
    assert_eq!(listening("/proc/net/tcp").len(), 1);
    assert!(listening("/proc/net/tcp")[0].contains("0100007F"), "127.0.0.1");
    assert!(listening("/proc/net/tcp6").is_empty());
    assert!(view.stop().contains("refused a page of https://evil.example"));
}

#[test]
fn a_running_stack_is_shown_as_it_flies() {
    let folder = tempfile::tempdir().unwrap();
    let launch = folder.path().join("launch-test.toml");
    let lab = include_str!("../deploy/etc/launch/lab.toml");
    std::fs::write(&launch, lab.replace("51001", "52210").replace("5110", "5222")).unwrap();
    let out = folder.path().join("out");
    let mut run = Command::new(env!("CARGO_BIN_EXE_fss"))
        .args(["run", "hold", "--quiet", "--launch", launch.to_str().unwrap(), "--out", out.to_str().unwrap()])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let bus = format!("fss_{}_", run.id());
    std::thread::sleep(Duration::from_secs(3));
    let view = View::start(&["--bus", &bus]);
    let scene: Value = serde_json::from_str(&view.get("/scene.json")).unwrap();
    assert_eq!((&scene["live"], &scene["title"]), (&true.into(), &"hold".into()));

    let mut connection = view.connect();
    write!(connection, "GET /live HTTP/1.1\r\nHost: localhost:{}\r\n\r\n", view.port).unwrap();
    let (mut frames, mut health, mut name) = (Vec::<Value>::new(), 0, String::new());
    let asked = Instant::now();
    for line in BufReader::new(connection).lines() {
        let line = line.unwrap();
        if let Some(event) = line.strip_prefix("event: ") {
            event.clone_into(&mut name);
        } else if let Some(data) = line.strip_prefix("data: ") {
            let data = serde_json::from_str(data).unwrap();
            if name == "frame" { frames.push(data) } else { health += u32::from(name == "health") }
        }
        if (frames.len() >= 60 && health >= 5) || asked.elapsed() > Duration::from_secs(15) {
            break;
        }
    }
    let stopped = Command::new("kill").args(["-INT", &run.id().to_string()]).status().unwrap();
    assert!(stopped.success() && run.wait().unwrap().success());
    assert!(frames.len() >= 60 && health >= 5, "{} frames, {health} reports", frames.len());
    let times: Vec<f64> = frames.iter().map(|frame| number(&frame["t"])).collect();
    assert!(times.windows(2).all(|pair| pair[1] > pair[0]), "time goes forwards: {times:?}");
    let apart = |frame: &Value, i: usize| number(&frame["base"][i]) - number(&frame["believed"][i]);
    let last = &frames[frames.len() - 1];
    assert!(apart(last, 0).hypot(apart(last, 1)) < 0.01, "truth and estimate are shown together: {last}");
    assert_eq!(last["arm"].as_array().unwrap().len(), 5);
    drop(view);
    // The view was one reader more: nobody was restarted for it, and nothing was lost.
    let summary = json(&out.join("summary.json"));
    let services = summary["services"].as_object().unwrap();
    assert!(services.values().all(|f| f["starts"] == 1 && f["dropped"] == 0), "{summary}");
}

#[test]
fn a_benchmark_with_a_browser_that_is_not_there_is_refused_before_anybody_flies() {
    let begun = Instant::now();
    refused(&["bench", "view", "--browser", "/no/such/browser"], &["/no/such/browser --version"]);
    assert!(begun.elapsed() < Duration::from_secs(4), "a flight takes longer");
}

/// The browser, where this computer has one.
fn chromium() -> Option<&'static str> {
    ["chromium", "chromium-browser", "google-chrome"].into_iter().find(|name| {
        let version = Command::new(name).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        version.is_ok_and(|status| status.success())
    })
}

#[test]
fn a_browser_draws_the_page() {
    let Some(browser) = chromium() else {
        common::skipped("there is no chromium on this computer (sudo apt-get install chromium)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let log = flown(folder.path(), "capture", "2");
    let view = View::start(&[&log]);
    let (picture, profile) = (folder.path().join("view.png"), folder.path().join("profile"));
    // A browser on a busy computer may take the picture before the page is whole: it gets another try with more time.
    let words = ["capture - fss view", "data-frames=\"27", "target held", ">stop<", "86.00 of 90", "phase 4: stop"];
    let mut page = String::new();
    for budget_ms in [4_000, 10_000, 30_000, 60_000] {
        let output = Command::new(browser)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
            .arg(format!("--user-data-dir={}-{budget_ms}", profile.display()))
            .args(["--window-size=1400,1000", "--dump-dom"])
            .arg(format!("--virtual-time-budget={budget_ms}"))
            .arg(format!("--screenshot={}", picture.display()))
            .arg(format!("http://127.0.0.1:{}/#t=86", view.port))
            .output()
            .unwrap();
        page = text(&output.stdout);
        if words.iter().all(|words| page.contains(words)) {
            break;
        }
    }
    assert!(!page.contains("data-error"), "{page}");
    for words in words {
        assert!(page.contains(words), "the page should say '{words}', 90 s are 2700 frames: {page}");
    }
    let bytes = std::fs::read(&picture).unwrap();
    assert!(bytes.starts_with(b"\x89PNG") && bytes.len() > 60_000, "a picture of {} bytes", bytes.len());
    if let Ok(keep) = std::env::var("FSS_KEEP_PICTURES") {
        std::fs::copy(&picture, Path::new(&keep).join("view.png")).unwrap();
    }
}
