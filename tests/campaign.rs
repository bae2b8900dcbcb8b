//! Campaigns: no run is lost or flown twice, shards make the whole, and any run can be flown again.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{fss, json, refused, succeed, text};
use parquet::file::reader::SerializedFileReader;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

type Row = BTreeMap<String, String>;

/// The rows of all tables of a campaign by their number, but for the time that they took.
fn rows(campaign: &str) -> BTreeMap<u64, Row> {
    let mut rows = BTreeMap::new();
    for file in fs::read_dir(Path::new(campaign).join("runs")).unwrap() {
        let file = File::open(file.unwrap().path()).unwrap();
        for row in SerializedFileReader::new(file).unwrap() {
            let row = row.unwrap();
            let mut row: Row =
                row.get_column_iter().map(|(name, value)| (name.clone(), format!("{value:?}"))).collect();
            row.remove("wall_time_s").unwrap();
            let number = row["run"].chars().filter(char::is_ascii_digit).collect::<String>();
            // "ULong(7)"
            let twice = rows.insert(number.parse().unwrap(), row);
            assert!(twice.is_none(), "run {number} stands in two tables");
        }
    }
    rows
}

/// The runs that the journals hold, in the order in which they were flown.
fn journal(campaign: &str) -> Vec<u64> {
    let path = Path::new(campaign).join("shard-1-of-1.jsonl");
    let lines = fs::read_to_string(path).unwrap_or_default();
    let whole = lines.rfind('\n').map_or("", |end| &lines[..end]);
    whole.lines().map(|l| serde_json::from_str::<serde_json::Value>(l).unwrap()["run"].as_u64().unwrap()).collect()
}

fn folder(root: &tempfile::TempDir, name: &str) -> String {
    root.path().join(name).to_str().unwrap().to_owned()
}

#[test]
fn a_campaign_that_was_killed_neither_repeats_nor_loses_a_run() {
    let root = tempfile::tempdir().unwrap();
    let (killed, whole) = (folder(&root, "killed"), folder(&root, "whole"));
    let arguments = |out| ["campaign", "reach", "--seeds", "5..13", "--quiet", "--out", out];
    let mut child =
        Command::new(env!("CARGO_BIN_EXE_fss")).args(arguments(&killed)).stdout(Stdio::null()).spawn().unwrap();
    while journal(&killed).len() < 2 && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let before = journal(&killed);
    // As if it had been killed while it wrote the line of another.
    let path = Path::new(&killed).join("shard-1-of-1.jsonl");
    let torn = fs::read_to_string(&path).unwrap() + "{\"run\":99,\"seed\":";
    fs::write(&path, torn).unwrap();

    succeed(&["campaign", "--quiet", "--out", &killed]);
    let after = journal(&killed);
    assert_eq!(after[..before.len()], before, "what was flown stays");
    let mut numbers = after;
    numbers.sort_unstable();
    assert_eq!(numbers, (1..=8).collect::<Vec<_>>());
    succeed(&arguments(&whole));
    assert_eq!(rows(&killed), rows(&whole));
    // And once more: nothing is left to fly.
    succeed(&arguments(&killed));
    assert_eq!(journal(&killed).len(), 8);
}

#[test]
fn shards_together_are_the_whole_also_as_jobs_of_slurm() {
    let root = tempfile::tempdir().unwrap();
    let (whole, shared) = (folder(&root, "whole"), folder(&root, "it's shared"));
    let sweep = ["--sweep", "laboratory.effect.table_tilt.accel_x_m_s2=0..0.001:3", "--seeds", "1..3"];
    succeed(&[&["campaign", "reach", "--quiet", "--out", &whole], &sweep[..]].concat());
    succeed(&[&["campaign", "reach", "--slurm", "2", "--out", &shared], &sweep[..]].concat());
    assert!(rows(&shared).is_empty(), "the script is written, and nothing flown");
    let script = Path::new(&shared).join("campaign.sbatch");
    for job in ["1", "2"] {
        let job = Command::new("bash").arg(&script).env("SLURM_ARRAY_TASK_ID", job).output().unwrap();
        assert!(job.status.success(), "{}", text(&job.stderr));
    }
    let (of_shards, of_whole) = (rows(&shared), rows(&whole));
    assert_eq!(of_whole.len(), 6);
    assert_eq!(of_shards, of_whole);
    // The table leans by what the row says.
    let column = |run: u64, name: &str| of_whole[&run][name].clone();
    let key = "laboratory.effect.table_tilt.accel_x_m_s2";
    assert_eq!([1, 3, 5].map(|run| column(run, key)), ["Double(0.0)", "Double(0.0005)", "Double(0.001)"]);
    assert_eq!([1, 2, 3].map(|run| column(run, "seed")), ["ULong(1)", "ULong(2)", "ULong(1)"]);
    assert_ne!(column(1, "base_rotation_end_deg"), column(3, "base_rotation_end_deg"));
}

#[test]
fn any_run_is_that_of_fss_run_and_can_be_flown_again() {
    let root = tempfile::tempdir().unwrap();
    let (out, alone, file) = (folder(&root, "out"), folder(&root, "alone"), folder(&root, "summary.json"));
    let arguments = ["campaign", "capture", "--seeds", "2..4", "--quiet", "--out", &out, "--json", &file];
    succeed(&arguments);
    let said = succeed(&["campaign", "--out", &out, "--run", "2"]);
    assert!(said.contains("seed 3") && said.contains("as in the campaign: every figure to the last bit"), "{said}");
    assert!(Path::new(&out).join("run-2/run.mcap").exists());

    succeed(&["run", "capture", "--fast", "--quiet", "--seed", "3", "--out", &alone]);
    let summary = json(&Path::new(&alone).join("summary.json"));
    assert_eq!(summary, json(&Path::new(&out).join("run-2/summary.json")));
    let row = rows(&out).remove(&2).unwrap();
    let figures = [
        ("duration_s", &summary["duration_s"]),
        ("base_rotation_max_deg", &summary["base_rotation_deg"]["max_deg"]),
        ("navigation_position_rms_m", &summary["navigation"]["position_rms_m"]),
        ("stop_ratio", &summary["stop"]["ratio"]),
        ("capture_miss_m", &summary["capture"]["miss_m"]),
    ];
    for (name, value) in figures {
        assert_eq!(row[name], format!("Double({:?})", value.as_f64().unwrap()), "{name}");
    }
    let campaign = json(Path::new(&file));
    assert_eq!(
        (&campaign["flown"], &campaign["succeeded"], &campaign["success_rate"]),
        (&2.into(), &2.into(), &1.0.into())
    );
    let gas = &campaign["figures"]["gas_used_kg"];
    assert!(gas["count"] == 2 && gas["min"].as_f64() <= gas["p50"].as_f64(), "{gas}");
    refused(&["campaign", "--out", &out, "--run", "3"], &["there is no run 3", "runs 1 to 2"]);
}

#[test]
fn runs_that_do_not_succeed_are_listed_with_their_reason() {
    let root = tempfile::tempdir().unwrap();
    let (out, file) = (folder(&root, "out"), folder(&root, "summary.json"));
    // A metre is beyond the arm, as the flight shows; no length is below zero, as the file's reader knows.
    let sweep = "mission.phase.line.arm.length_m=0.1,1,-1";
    succeed(&["campaign", "reach", "--sweep", sweep, "--quiet", "--out", &out, "--json", &file]);
    let summary = json(Path::new(&file));
    assert_eq!((&summary["flown"], &summary["succeeded"]), (&3.into(), &1.into()), "{summary:#}");
    let failures = summary["failures"].as_array().unwrap();
    let of = |i: usize, key: &str| failures[i][key].clone();
    assert_eq!((of(0, "run"), of(0, "outcome")), (2.into(), "aborted".into()));
    assert!(of(0, "reason").as_str().unwrap().contains("the arm is blocked"), "{summary:#}");
    assert_eq!((of(1, "run"), of(1, "outcome")), (3.into(), "refused".into()));
    assert!(!of(1, "reason").as_str().unwrap().is_empty());
    assert_eq!(rows(&out).len(), 3, "a run that was refused has its row too");
}

#[test]
fn a_sweep_that_cannot_be_is_refused_with_its_name_and_what_to_do() {
    let root = tempfile::tempdir().unwrap();
    let out = folder(&root, "out");
    let refused_with = |sweep: &str, words: &[&str]| {
        refused(&["campaign", "reach", "--sweep", sweep, "--out", &out], words);
        assert!(!Path::new(&out).exists(), "it left a campaign behind");
    };
    refused_with("base.mas_kg=9..11:3", &["--sweep base.mas_kg", "unknown field `mas_kg`", "`mass_kg`"]);
    refused_with("link.7.mass_kg=2,3", &["'link' has 4 elements, and none is '7'", "count from 1"]);
    refused_with("base.mass_kg=-1", &["no run can fly", "base.mass_kg"]);
    refused_with("laboratory.effect.table_tlt.accel_x_m_s2=0,1", &["table_tlt", "did you mean table_tilt?"]);
    refused_with("base.mass_kg=heavy", &["'heavy' is no number", "base.mass_kg=9..11:5"]);
    refused(&["campaign", "--out", &out], &["nothing says what this campaign varies", "--seeds 1..101"]);

    let other = folder(&root, "other");
    succeed(&["campaign", "reach", "--seeds", "1..2", "--quiet", "--out", &other]);
    let more = ["campaign", "reach", "--seeds", "1..3", "--quiet", "--out", &other];
    refused(&more, &["holds another campaign: its range of seeds differs", "--out"]);
    assert!(fss(&["campaign", "--quiet", "--out", &other]).status.success());
}
