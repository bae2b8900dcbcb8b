//! The page about a flight, read as text: what it promises is on it, with the figures of the summary.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{json, refused, succeed};
use fss_records::log::Log;
use serde_json::Value;
use std::borrow::Cow;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// Flies fast and writes the report; gives the page and the summary.
fn reported(folder: &Path, arguments: &[&str]) -> (String, Value) {
    let (out, page) = (folder.join("out"), folder.join("report.html"));
    succeed(&[&["run", "--fast", "--quiet", "--out", out.to_str().unwrap()], arguments].concat());
    succeed(&["report", out.join("run.mcap").to_str().unwrap(), "--out", page.to_str().unwrap()]);
    (std::fs::read_to_string(page).unwrap(), json(&out.join("summary.json")))
}

fn number(value: &Value, path: &str) -> f64 {
    path.split('.').fold(value, |v, key| &v[key]).as_f64().unwrap_or_else(|| panic!("no number {path} in {value}"))
}

#[track_caller]
fn says(page: &str, words: &[&str]) {
    for word in words {
        assert!(page.contains(word), "the page should say '{word}'");
    }
}

/// Nothing is loaded from anywhere.
#[track_caller]
fn is_self_contained(page: &str) {
    let without_names = page.replace("http://www.w3.org/2000/svg", "");
    for reference in ["http://", "https://", "<script", "<link", "<img", " src=", "@import", "url(//"] {
        assert!(!without_names.contains(reference), "the page refers to something outside: {reference}");
    }
    assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
    assert!(!page.contains("NaN") && !page.contains("inf\""), "a number is none");
}

#[test]
fn a_report_holds_what_flew_and_the_figures_of_the_summary() {
    let folder = tempfile::tempdir().unwrap();
    let (page, s) = reported(folder.path(), &["--seed", "11"]);
    is_self_contained(&page);
    says(
        &page,
        &["zero-reaction", "flew all its phases", "<td>seed</td><td>11</td>", "virtual", "4 links", "8 thrusters"],
    );
    let rotation = format!("{:.3} deg at the end", number(&s, "base_rotation_deg.end_deg"));
    let tip = format!("{:.2} mm at the end", number(&s, "end_effector.final_error_m") * 1e3);
    let nav = format!(
        "{:.3} mm and {:.4} deg RMS",
        number(&s, "navigation.position_rms_m") * 1e3,
        number(&s, "navigation.heading_rms_deg")
    );
    says(&page, &[&rotation, &tip, &nav]);
    says(&page, &["joint angles, deg", "joint torques, N m", "valves open", "gas used, g", "error in heading, deg"]);
    says(&page, &["The recorder lost nothing", "/truth/state", "[[thruster]]", "[[phase]]"]);
    assert!(!page.contains("believe the capture"), "there was none");
}

#[test]
fn the_report_of_a_capture_shows_why_to_believe_it() {
    let folder = tempfile::tempdir().unwrap();
    let (page, s) = reported(folder.path(), &["capture", "--seed", "2"]);
    is_self_contained(&page);
    let c = &s["capture"];
    let miss = format!("{:.2} mm", number(c, "miss_m") * 1e3);
    let speed = format!("{:.2} mm/s", number(c, "contact_speed_m_s") * 1e3);
    says(&page, &["The target was captured", &miss, &speed, "speed of the gripper relative to the handle"]);
    for momentum in [&c["momentum_before"], &c["momentum_after"]] {
        for axis in momentum.as_array().unwrap() {
            says(&page, &[&format!("{:+.6}", axis.as_f64().unwrap())]);
        }
    }
    let at_rest = format!("{:.2} mm/s", s["stop"]["speed_m_s"][1].as_f64().unwrap() * 1e3);
    says(&page, &["the compound at the end", &at_rest, "look", "meet", "reach", "stop"]);
    // What vehicle and target carry apart, by the page's own arithmetic, is what the laboratory says of both.
    let row = page.split("<td>x, kg m/s</td>").nth(1).unwrap().split("</tr>").next().unwrap();
    let cells: Vec<f64> = row.split("<td>").skip(1).map(|c| c.trim_end_matches("</td>").parse().unwrap()).collect();
    assert!((cells[0] + cells[1] - cells[2]).abs() < 1e-4, "{cells:?}");
    let picture = std::fs::read_to_string(folder.path().join("out/run.svg")).unwrap();
    assert!(picture.contains("target"), "the run's own picture has the target too");
}

/// The log as a real laboratory would have left it.
fn without_truth(from: &Path, to: &Path) {
    let (log, bytes) = (Log::open(from).unwrap(), std::fs::read(from).unwrap());
    let mut writer = mcap::Writer::new(BufWriter::new(File::create(to).unwrap())).unwrap();
    for name in ["plant.toml", "launch.toml", "mission.toml"] {
        let text = log.attachment(name).unwrap().unwrap();
        let (data, media_type) = (Cow::Owned(text.into_bytes()), "application/toml".to_owned());
        writer
            .attach(&mcap::Attachment { log_time: 0, create_time: 0, name: name.to_owned(), media_type, data })
            .unwrap();
    }
    for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        if message.channel.topic != "/truth/state" {
            writer.write(&message).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn a_log_of_a_real_laboratory_has_a_report_too_and_claims_no_truth() {
    let folder = tempfile::tempdir().unwrap();
    let (told, _) = reported(folder.path(), &["slew"]);
    let (blind, page) = (folder.path().join("blind.mcap"), folder.path().join("blind.html"));
    without_truth(&folder.path().join("out/run.mcap"), &blind);
    succeed(&["report", blind.to_str().unwrap(), "--out", page.to_str().unwrap()]);
    let page = std::fs::read_to_string(page).unwrap();
    is_self_contained(&page);
    says(
        &page,
        &["flew all its phases", "From navigation and telemetry", "no truth to compare with", "base heading, deg"],
    );
    assert!(!page.contains("gas used, g") && told.contains("gas used, g"), "gas is the laboratory's knowledge");
}

#[test]
fn a_log_without_the_stacks_files_is_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let nothing = folder.path().join("none.mcap");
    std::fs::write(&nothing, "no log").unwrap();
    let out = folder.path().join("r.html");
    refused(&["report", nothing.to_str().unwrap(), "--out", out.to_str().unwrap()], &["none.mcap"]);
    assert!(!out.exists());
}
