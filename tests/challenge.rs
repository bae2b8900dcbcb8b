//! The game that the project plays against itself: hidden effects, experiments, logs, answers.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{json, refused, succeed};
use fss_messages::{MissionState, MocapPose, TruthState, topic};
use fss_records::log::Log;
use std::path::Path;

const EXPERIMENTS: [&str; 6] = ["coast", "single-joint", "excitation", "thrusters", "mixed", "validation"];

/// A seed that hides something in a drawn vehicle.
const HIDING: &str = "3";
/// A seed whose vehicle has no links.
const ARMLESS: &str = "0";

/// Flies an experiment against the laboratory of the plant file; gives its log's folder.
fn fly(name: &str, folder: &Path) -> String {
    fly_in(None, name, 1, folder)
}

/// Several, each with noise of its own.
fn fly_all(laboratory: Option<&Path>, names: &[&str], first_seed: u64, folder: &Path) -> Vec<String> {
    names.iter().zip(first_seed..).map(|(name, seed)| fly_in(laboratory, name, seed, folder)).collect()
}

/// One against a laboratory of another plant file than the stack's, with a seed.
fn fly_in(laboratory: Option<&Path>, name: &str, seed: u64, folder: &Path) -> String {
    let out = folder.join(name).to_str().unwrap().to_owned();
    let (mission, seed) = (format!("experiment-{name}"), seed.to_string());
    let mut words = vec!["run", &mission, "--fast", "--quiet", "--seed", &seed, "--out", &out];
    words.extend(laboratory.iter().flat_map(|file| ["--laboratory", file.to_str().unwrap()]));
    succeed(&words);
    out
}

#[test]
fn the_experiments_excite_the_vehicle_and_stay_on_the_table() {
    let folder = tempfile::tempdir().unwrap();
    for name in EXPERIMENTS {
        let log = Log::open(&Path::new(&fly(name, folder.path())).join("run.mcap")).unwrap();
        let last = log.samples::<MissionState>(topic::MISSION_STATE.name).unwrap().pop().unwrap();
        assert_eq!(last.state, MissionState::DONE, "{name}");
        let truth = log.samples::<TruthState>(topic::TRUTH_STATE.name).unwrap();
        let farthest = truth.iter().map(|t| t.x_m.abs().max(t.y_m.abs())).fold(0.0, f64::max);
        assert!(farthest < 2.0, "{name}: the base comes {farthest} m from the middle");
        let spread = |f: &dyn Fn(&TruthState) -> f64| {
            truth.iter().map(f).fold(f64::MIN, f64::max) - truth.iter().map(f).fold(f64::MAX, f64::min)
        };
        let moves = |i: usize| spread(&|t: &TruthState| t.q_rad[i]);
        let opens = |i: usize| truth.iter().any(|t| t.thrust_n[i] > 0.1);
        let has_arm = !matches!(name, "coast" | "thrusters");
        let has_valves = !matches!(name, "single-joint" | "excitation");
        for joint in 0..4 {
            assert_eq!(moves(joint) > 0.3, has_arm, "{name}: joint {joint} moves {} rad", moves(joint));
        }
        assert_eq!((0..8).any(opens), has_valves, "{name}");
        assert!(name != "thrusters" || (0..8).all(opens), "every thruster is tried");
        assert!(name != "coast" || spread(&|t| t.y_m) > 0.5, "the coast leads somewhere");
    }
}

#[test]
fn a_log_of_the_nominal_laboratory_and_what_the_plant_file_says_agree() {
    let folder = tempfile::tempdir().unwrap();
    let runs = fly_all(None, &["coast", "thrusters"], 1, folder.path());
    let plant = folder.path().join("coast/plant.toml");
    let out = folder.path().join("out");
    // One by its folder, one by its file.
    let log = format!("{}/run.mcap", runs[1]);
    succeed(&["diagnose", &runs[0], &log, "--plant", plant.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    let answer = json(&out.join("diagnosis.json"));
    assert_eq!(answer["verdict"], "consistent", "{answer}");
    assert_eq!(answer["causes"].as_array().unwrap().len(), 0);
}

#[test]
fn datagrams_that_arrive_early_or_late_are_no_torque_on_the_base() {
    let folder = tempfile::tempdir().unwrap();
    let run = fly("excitation", folder.path());
    let (plant, out) = (folder.path().join("excitation/plant.toml"), folder.path().join("out"));
    succeed(&["diagnose", &run, "--plant", plant.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    let answer = json(&out.join("diagnosis.json"));
    let of_base = |d: &&serde_json::Value| d["name"].as_str().unwrap().starts_with("torque on the base");
    let torque = answer["discrepancy"].as_array().unwrap().iter().find(of_base).unwrap();
    let [inferred, expected] = ["inferred", "expected"].map(|key| torque[key].as_f64().unwrap());
    assert!(inferred < expected, "{torque}");
    assert_eq!(answer["causes"].as_array().unwrap().len(), 0, "{answer}");
}

#[test]
fn where_nothing_is_hidden_nothing_is_named() {
    // Vehicles without links, with one and with four, in laboratories that differ from their plant files.
    nothing_is_named("0", &[]);
    nothing_is_named("6", &[]);
    nothing_is_named("20", &["--experiments", "excitation"]);
}

fn nothing_is_named(seed: &str, options: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let (out, file) = (folder.path().join(seed), folder.path().join("answer.json"));
    let words = ["challenge", "--seed", seed, "--out", out.to_str().unwrap(), "--json", file.to_str().unwrap()];
    succeed(&[&words, options].concat());
    let answer = json(&file);
    assert_eq!(answer["hidden"]["effects"].as_array().unwrap().len(), 0, "seed {seed}");
    // The air differs from what the plant file states: that may be said, but no cause may be named for it.
    assert_eq!(answer["said"]["causes"].as_array().unwrap().len(), 0, "seed {seed}: {}", answer["said"]);
}

#[test]
fn what_moves_the_vehicle_far_is_named_for_what_it_is() {
    // Half the base's mass, once thought to be a push; exchanged valves, once not seen.
    for (effect, values) in [("base_mass", "mass_kg = 5.0"), ("valve_swap", "index = 2\nother_index = 7")] {
        let flown = Flown::with(&format!("id = \"{effect}\"\n{values}"), &["coast", "thrusters"]);
        let answer = flown.diagnosed("plant.toml", "out");
        let causes = answer["causes"].as_array().unwrap();
        assert_eq!(causes.len(), 1, "{answer}");
        assert_eq!(causes[0]["effect"], effect, "{answer}");
    }
}

#[test]
fn what_is_far_from_proportional_is_one_cause_and_not_several() {
    // Telemetry later than the arm moves evenly, and a gyro that reads deviations of the motion too small.
    let late = Flown::with("id = \"link_latency\"\nindex = 2\ndelay_s = 0.15", &["excitation"]);
    let scaled = Flown::with("id = \"gyro_scale\"\nscale = 0.83", &["coast"]);
    for (flown, effect, value) in [(late, "link_latency", 0.15), (scaled, "gyro_scale", 0.83)] {
        let answer = flown.diagnosed("plant.toml", "out");
        let causes = answer["causes"].as_array().unwrap();
        assert_eq!((causes.len(), &causes[0]["effect"]), (1, &effect.into()), "{answer}");
        let parameters = causes[0]["parameters"].as_object().unwrap();
        let found = parameters.values().next().unwrap()["value"].as_f64().unwrap();
        assert!((found / value - 1.0).abs() < 0.01, "{effect}: {found} for {value}");
    }
    // What two clocks together would do, one delay does.
    let all = Flown::with("id = \"mocap_latency\"\ndelay_s = 0.12", &["excitation", "thrusters"]);
    let answer = all.diagnosed("plant.toml", "out");
    let named = |effect: &str| answer["causes"].as_array().unwrap().iter().filter(|c| c["effect"] == effect).count();
    assert_eq!((named("mocap_latency"), named("clock_offset")), (1, 0), "{answer}");
    // As long as the interval says: the clocks that links and gyro are stamped by are known to parts of a millisecond.
    let late = &answer["causes"][0]["parameters"]["delay_s"];
    let [value_s, std_s] = ["value", "std"].map(|key| late[key].as_f64().unwrap());
    assert!((value_s / 0.12 - 1.0).abs() < 0.01, "{answer}");
    assert!((value_s - 0.12).abs() < 3.0 * std_s && std_s < 1e-3, "{answer}");
}

/// Experiments flown in a laboratory that has an effect which the plant file lacks.
struct Flown {
    folder: tempfile::TempDir,
    runs: Vec<String>,
}

impl Flown {
    fn with(effect: &str, experiments: &[&str]) -> Self {
        Self::with_seeds_from(1, effect, experiments)
    }

    fn with_seeds_from(first: u64, effect: &str, experiments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let laboratory = folder.path().join("laboratory.toml");
        let nominal = include_str!("../deploy/etc/plants/fss.toml");
        std::fs::write(folder.path().join("plant.toml"), nominal).unwrap();
        std::fs::write(&laboratory, format!("{nominal}\n[[effect]]\n{effect}\n")).unwrap();
        let runs = fly_all(Some(&laboratory), experiments, first, folder.path());
        Self { folder, runs }
    }

    /// Diagnoses them with a plant file; the answer is in a folder beside.
    fn diagnosed(&self, plant: &str, out: &str) -> serde_json::Value {
        self.diagnosed_and(&[], plant, out)
    }

    /// The same with runs that are kept out of the fit.
    fn diagnosed_and(&self, validation: &[String], plant: &str, out: &str) -> serde_json::Value {
        let (plant, out) = (self.folder.path().join(plant), self.folder.path().join(out));
        let mut words = vec!["diagnose"];
        words.extend(self.runs.iter().map(String::as_str));
        words.extend(validation.iter().flat_map(|run| ["--validate", run]));
        words.extend(["--plant", plant.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        succeed(&words);
        json(&out.join("diagnosis.json"))
    }
}

#[test]
fn a_joint_with_play_is_named_and_measured() {
    let play = "id = \"joint_backlash\"\nindex = 2\ngap_rad = 0.004";
    let answer = Flown::with(play, &["excitation"]).diagnosed("plant.toml", "out");
    assert_eq!(answer["causes"].as_array().unwrap().len(), 1, "{answer}");
    let cause = &answer["causes"][0];
    assert_eq!((&cause["effect"], &cause["index"]), (&"joint_backlash".into(), &2.into()), "{cause}");
    let gap_rad = cause["parameters"]["gap_rad"]["value"].as_f64().unwrap();
    assert!((gap_rad / 0.004 - 1.0).abs() < 0.2, "{cause}");
}

/// So soft that its link goes on swinging after each command: once called play, or a weak motor.
#[test]
fn a_drive_on_which_a_link_swings_is_named_and_nothing_is_left_to_name() {
    let soft = "id = \"joint_flexibility\"\nindex = 2\nstiffness_N_m_rad = 150";
    let flown = Flown::with(soft, &["excitation"]);
    let answer = flown.diagnosed("plant.toml", "out");
    let causes = answer["causes"].as_array().unwrap();
    assert_eq!(causes.len(), 1, "{answer}");
    assert_eq!((&causes[0]["effect"], &causes[0]["index"]), (&"joint_flexibility".into(), &2.into()));
    let stiffness = &causes[0]["parameters"]["stiffness_N_m_rad"];
    let (value, std) = (stiffness["value"].as_f64().unwrap(), stiffness["std"].as_f64().unwrap());
    assert!((value / 150.0 - 1.0).abs() < 0.1 && std < 15.0, "{value} +- {std}");
    let again = flown.diagnosed("out/extended.toml", "again");
    assert_eq!(again["verdict"], "consistent", "a plant file that knows the drive: {again}");
}

/// Its arm does otherwise what it is told: once that was called a drive of 563 N m/rad, at 99 %.
#[test]
fn a_heavier_base_alone_is_named_where_the_arm_moves_as_that_lets_it() {
    let flown = Flown::with_seeds_from(2, "id = \"base_inertia\"\ninertia_kg_m2 = 0.5", &["coast", "validation"]);
    let answer = flown.diagnosed("plant.toml", "out");
    let causes = answer["causes"].as_array().unwrap();
    assert_eq!(causes.len(), 1, "{answer}");
    assert_eq!(causes[0]["effect"], "base_inertia");
    let inertia_kg_m2 = causes[0]["parameters"]["inertia_kg_m2"]["value"].as_f64().unwrap();
    assert!((inertia_kg_m2 / 0.5 - 1.0).abs() < 0.02, "{inertia_kg_m2} kg m2");
}

/// Its mass is there for a part of a run: once that was called a base and two links of other masses, at 99 %.
#[test]
fn what_is_grasped_in_a_run_is_a_payload_from_then_on() {
    let flown = Flown::with("id = \"payload\"\nmass_kg = 1.5\nonset_s = 17.3", &["mixed"]);
    let answer = flown.diagnosed("plant.toml", "out");
    let causes = answer["causes"].as_array().unwrap();
    assert_eq!((causes.len(), &causes[0]["effect"]), (1, &"payload".into()), "{answer}");
    for (name, truth, within) in [("mass_kg", 1.5, 0.05), ("onset_s", 17.3, 0.2)] {
        let value = causes[0]["parameters"][name]["value"].as_f64().unwrap();
        assert!((value - truth).abs() < within, "{name} {value}");
    }
    let again = flown.diagnosed("out/extended.toml", "again");
    assert_eq!(again["causes"].as_array().unwrap().len(), 0, "a plant file that knows when it is grasped: {again}");
}

/// The joints are told to rest, and no servo answers to anything: once a torque there was taken for what servos do as they settle.
#[test]
fn a_resting_joint_that_the_clock_shakes_is_told_as_what_no_effect_explains() {
    let shaken =
        "id = \"unmodelled\"\nchannel = \"joint_torque_2\"\nfrequency_Hz = 0.45\nstrength = 0.15\nphase_rad = 0.5";
    let answer = Flown::with(shaken, &["coast"]).diagnosed("plant.toml", "out");
    assert_eq!((&answer["verdict"], &answer["causes"]), (&"unexplained".into(), &serde_json::json!([])), "{answer}");
}

/// Friction holds the joint, whatever its motor gives: once that was called a motor without torque, at 99 %.
#[test]
fn of_a_joint_that_rests_nothing_is_said_of_its_motor() {
    let flown = Flown::with("id = \"joint_coulomb_friction\"\nindex = 2\ntorque_N_m = 0.85", &["coast"]);
    let answer = flown.diagnosed("plant.toml", "out");
    assert_eq!(answer["causes"].as_array().unwrap().len(), 0, "{answer}");
    let remarks = answer["remarks"].to_string();
    assert!(remarks.contains("joints that hardly move in any run: 1, 2, 3, 4"), "{remarks}");
}

/// Nothing of the catalogue turns a base to and fro with the clock: a law without a name does, and other runs judge it.
#[test]
fn an_empirical_law_predicts_other_runs() {
    let shaken = "id = \"unmodelled\"\nchannel = \"base_torque\"\nfrequency_Hz = 0.3\nstrength = 0.1\nphase_rad = 0.5";
    let flown = Flown::with(shaken, &["coast"]);
    let other = Flown::with_seeds_from(2, shaken, &["thrusters"]);
    let answer = flown.diagnosed_and(&other.runs, "plant.toml", "out");
    assert_eq!((&answer["verdict"], &answer["causes"]), (&"unexplained".into(), &serde_json::json!([])), "{answer}");
    let laws = answer["empirical"].as_array().expect("a law");
    let torque = laws.iter().find(|law| law["channel"] == "base_torque").expect("a torque");
    let frequency_hz = torque["frequency_Hz"].as_f64().unwrap();
    assert!((frequency_hz / 0.3 - 1.0).abs() < 0.005, "{torque}");
    let [before, after] = ["ratio_before", "ratio_after"].map(|when| answer["gain"][when].as_f64().unwrap());
    assert!(after < 0.5 * before, "{}", answer["gain"]);
    // The extended model is a plant like another.
    let extended = flown.folder.path().join("out/extended.toml");
    assert!(std::fs::read_to_string(&extended).unwrap().contains("what is called unmodelled is empirical"));
    fly_in(Some(&extended), "coast", 3, other.folder.path());
}

#[test]
fn a_file_that_is_no_log_of_a_run_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let plant = write("plant.toml", include_bytes!("../deploy/etc/plants/fss.toml"));
    let out = folder.path().join("out");
    let diagnose = |run: &str, plant: &str, words: &[&str]| {
        refused(&["diagnose", run, "--plant", plant, "--out", out.to_str().unwrap()], words);
    };
    diagnose(&write("notes.txt", b"no log at all"), &plant, &["notes.txt"]);
    diagnose(folder.path().join("nowhere").to_str().unwrap(), &plant, &["nowhere", "neither a folder nor a log"]);
    let run = fly("coast", folder.path());
    let whole = include_str!("../deploy/etc/plants/fss.toml");
    let first_link = whole.find("# Links, from the base outwards.").unwrap();
    let bare = write("bare.toml", &whole.as_bytes()[..first_link]);
    diagnose(&run, &bare, &["run.mcap", "/links/state has 4 links", "0 [[link]] tables"]);
}

#[test]
fn a_log_without_motion_capture_is_refused_with_the_topics_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.mcap");
    fss_records::log::LogWriter::create(&path).unwrap().finish().unwrap();
    let plant = folder.path().join("plant.toml");
    std::fs::write(&plant, include_str!("../deploy/etc/plants/fss.toml")).unwrap();
    let out = folder.path().join("out");
    let args = ["diagnose", path.to_str().unwrap(), "--plant", plant.to_str().unwrap(), "--out", out.to_str().unwrap()];
    refused(&args, &["empty.mcap", topic::MOCAP_BASE.name]);
}

#[test]
fn one_seed_is_one_game_and_its_logs_do_not_tell_the_secret() {
    let folder = tempfile::tempdir().unwrap();
    let play = |name: &str| {
        let (out, file) = (folder.path().join(name), folder.path().join(format!("{name}.json")));
        let story = succeed(&[
            "challenge",
            "--seed",
            HIDING,
            "--experiments",
            "coast",
            "--out",
            out.to_str().unwrap(),
            "--json",
            file.to_str().unwrap(),
        ]);
        assert!(story.contains("The diagnosis says") && story.contains("The envelope"), "{story}");
        json(&file)
    };
    let (first, second) = (play("a"), play("b"));
    assert_eq!(first["format"], "fss-challenge/2");
    assert_eq!(first["hidden"], second["hidden"]);
    assert_eq!(first["said"]["verdict"], second["said"]["verdict"]);
    assert_eq!(json(&folder.path().join("a/sealed.json")), first["hidden"], "sealed before it was opened");
    assert_eq!(first["hidden"]["is_own_vehicle"], false, "{first}");
    let hidden = first["hidden"]["effects"][0]["effect"].as_str().expect("the seed hides something");
    let given = std::fs::read_to_string(folder.path().join("a/plant.toml")).unwrap();
    let vehicle = fss_plant::Plant::parse(&given).unwrap();
    let flown = EXPERIMENTS.iter().map(|name| folder.path().join(format!("a/experiment-{name}/run.mcap")));
    for path in flown.filter(|path| path.exists()) {
        let log = Log::open(&path).unwrap();
        let plant = log.attachment("plant.toml").unwrap().expect("the plant file");
        assert_eq!(plant, given, "the stack believes what the diagnosis gets");
        assert!(!plant.contains("[[effect]]"), "{} tells of {hidden}", path.display());
        assert!(log.attachment("laboratory.toml").unwrap().is_none(), "{} tells of the laboratory", path.display());
        let poses = log.samples::<MocapPose>(topic::MOCAP_BASE.name).unwrap();
        let rate_hz = poses.len() as f64 / (poses.last().unwrap().stamp_ns - poses[0].stamp_ns) as f64 * 1e9;
        assert!((rate_hz / vehicle.sensors.mocap_rate_hz - 1.0).abs() < 0.07, "{rate_hz} Hz");
        let last = log.samples::<MissionState>(topic::MISSION_STATE.name).unwrap().pop().unwrap();
        assert_eq!(last.state, MissionState::DONE, "{}", path.display());
    }
}

#[test]
fn a_vehicle_without_an_arm_flies_what_needs_none() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let story = succeed(&["challenge", "--seed", ARMLESS, "--out", out]);
    assert!(story.contains("a drawn vehicle, 0 links"), "{story}");
    for (name, is_flown) in [("coast", true), ("thrusters", true), ("single-joint", false), ("excitation", false)] {
        assert_eq!(folder.path().join(format!("experiment-{name}/run.mcap")).exists(), is_flown, "{name}");
    }
}

#[test]
fn many_seeds_make_a_table_that_can_be_taken_up_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("table.json");
    let (file, out) = (file.to_str().unwrap(), folder.path().join("games"));
    let played = ["challenge", "--seeds", "3..5", "--experiments", "coast", "--json", file];
    let table = succeed(&[&played[..], &["--out", out.to_str().unwrap()]].concat());
    assert!(table.contains("2 seeds") && table.contains("false alarms where nothing is hidden"), "{table}");
    assert!(table.contains("too few: "), "two seeds pass no gate: {table}");
    let first = json(Path::new(file));
    assert_eq!(first["format"], "fss-challenge-table/2");
    assert_eq!(first["seeds"].as_array().unwrap().len(), 2);
    assert_eq!(first["gates"].as_array().unwrap().len(), 12);
    for seed in ["seed-3", "seed-4"] {
        assert!(out.join(seed).join("sealed.json").exists());
        assert!(!out.join(seed).join("experiment-coast/run.mcap").exists(), "logs are gone");
    }
    succeed(&[&played[..], &["--resume"]].concat());
    assert_eq!(json(Path::new(file))["seeds"], first["seeds"], "nothing is played twice");
    let others = ["challenge", "--seeds", "3..5", "--experiments", "thrusters", "--json", file, "--resume"];
    refused(&others, &["table.json", "flew coast", "not thrusters"]);
    std::fs::write(file, "{ \"format\": \"fss-challenge-table/1\", \"seeds\": [] }").unwrap();
    refused(&["challenge", "--seeds", "3..5", "--json", file, "--resume"], &["table.json", "fss-challenge-table/1"]);
    refused(&["challenge", "--seeds", "5..5"], &["holds no seed"]);
    refused(&["challenge", "--seeds", "five"], &["1..300"]);
}
