//! Mission files: those that come with fss fit its plant, and a bad one is refused with the line and what to do.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_mission::{ArmGoal, BaseGoal, Draw, Mission, MissionError, Pulse, Sine};
use fss_plant::Plant;
use std::path::Path;

const LINK: &str = "[[link]]\nlength_m = 0.38\ncom_to_next_joint_m = 0.19\nmass_kg = 2.88\ninertia_kg_m2 = 0.034\n\
    joint_limit_rad = 1.570796327\ntorque_constant_N_m_A = 0.6\nmax_torque_N_m = 1.8\n";

fn four_link_plant() -> Plant {
    let base = "[base]\nmass_kg = 10.0\ninertia_kg_m2 = 0.25\njoint1_xy_m = [0.2058, 0.0155]\n";
    let thruster = "[[thruster]]\nposition_m = [0.1, 0.1]\nforce_direction = [0, 1]\nthrust_N = 0.159\n";
    Plant::parse(&format!("{base}{}{}", thruster.repeat(8), LINK.repeat(4))).unwrap()
}

fn shipped(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/etc/missions");
    std::fs::read_to_string(folder.join(name)).unwrap()
}

#[test]
fn the_missions_that_come_with_fss_fit_a_four_link_vehicle() {
    for name in ["hold", "slew", "reach", "zero-reaction"] {
        let mission = Mission::parse_for(&shipped(&format!("{name}.toml")), &four_link_plant()).unwrap();
        assert_eq!(mission.name, name);
        assert!(!mission.description.is_empty());
    }
}

#[test]
fn the_experiments_fit_it_too_and_last_about_forty_seconds() {
    for name in ["coast", "single-joint", "excitation", "thrusters", "mixed", "validation"] {
        // With the laboratory's own thrusters: others would drive it off the table, which is refused.
        let plant = Plant::default_laboratory().unwrap();
        let mission = Mission::parse_for(&shipped(&format!("experiment-{name}.toml")), &plant).unwrap();
        assert_eq!(mission.name, format!("experiment-{name}"));
        assert!((38.0..42.0).contains(&mission.duration_s()), "{name} lasts {} s", mission.duration_s());
    }
}

#[test]
fn reach_and_zero_reaction_are_the_same_line_but_for_the_reaction() {
    let line = |name: &str| match Mission::parse(&shipped(name)).unwrap().phases.pop().unwrap() {
        phase if phase.base == BaseGoal::Free => (phase.duration_s, phase.arm),
        phase => panic!("the base has a goal: {:?}", phase.base),
    };
    let expect = |zero_reaction| ArmGoal::Line {
        length_m: 0.1,
        direction_rad: 240_f64.to_radians(),
        keep_orientation: false,
        zero_reaction,
    };
    assert_eq!(line("reach.toml"), (20.0, expect(false)));
    assert_eq!(line("zero-reaction.toml"), (20.0, expect(true)));
}

/// A mission of one phase with these goals; `base` stands on line 4 and `arm` on line 5.
fn with_goals(base: &str, arm: &str) -> Result<Mission, MissionError> {
    let text = format!("name = \"test\"\n[[phase]]\nduration_s = 10\nbase = {base}\narm = {arm}\n");
    Mission::parse_for(&text, &four_link_plant())
}

#[track_caller]
fn refused(result: Result<Mission, MissionError>, line: usize, says: &[&str]) {
    let error = result.expect_err("it should be refused");
    assert_eq!(error.line, line, "{error}");
    for part in says {
        assert!(error.to_string().contains(part), "'{part}' is not in: {error}");
    }
}

const FREE: &str = "{ goal = \"free\" }";
const HOLD: &str = "{ goal = \"hold\" }";

#[test]
fn a_misspelt_key_is_refused_where_it_stands() {
    refused(with_goals(FREE, "{ goal = \"line\", lenght_m = 0.1 }"), 5, &["lenght_m", "spelling"]);
}

#[test]
fn an_unknown_goal_is_answered_with_those_that_there_are() {
    refused(with_goals("{ goal = \"fly\" }", HOLD), 4, &["fly", "free", "hold", "goto"]);
}

#[test]
fn a_missing_key_is_named() {
    refused(with_goals(FREE, "{ goal = \"line\", length_m = 0.1 }"), 5, &["direction_deg", "add the key"]);
    refused(with_goals(FREE, "{ goal = \"joints\" }"), 5, &["q_deg", "add the key"]);
    refused(with_goals("{ goal = \"goto\", x_m = 0.5 }", HOLD), 4, &["all of x_m, y_m and theta_deg"]);
    refused(Mission::parse("name = \"empty\"\n"), 1, &["phase"]);
    refused(
        Mission::parse("name = \"a\"\n[[phase]]\nbase = { goal = \"free\" }\narm = { goal = \"hold\" }"),
        2,
        &["duration_s"],
    );
}

#[test]
fn goals_that_contradict_each_other_are_refused() {
    let line = "{ goal = \"zero-reaction\", length_m = 0.1, direction_deg = 240 }";
    refused(with_goals(HOLD, line), 4, &["zero-reaction", "free"]);
    refused(with_goals("{ goal = \"free\", x_m = 1 }", HOLD), 4, &["x_m", "goto"]);
    refused(with_goals(FREE, "{ goal = \"hold\", length_m = 0.1 }"), 5, &["length_m", "line"]);
    refused(
        with_goals(FREE, "{ goal = \"line\", length_m = 1, direction_deg = 0, q_deg = [0, 0, 0, 0] }"),
        5,
        &["q_deg", "joints"],
    );
}

#[test]
fn goals_beyond_the_plant_are_refused() {
    refused(with_goals(FREE, "{ goal = \"joints\", q_deg = [0, 0, 91, 0] }"), 5, &["joint 3", "90"]);
    refused(with_goals(FREE, "{ goal = \"joints\", q_deg = [0, 0, 9] }"), 5, &["3 numbers", "4 joints"]);
    refused(with_goals("{ goal = \"goto\", x_m = 2.1, y_m = 0, theta_deg = 0 }", HOLD), 4, &["2.1", "table"]);
    refused(with_goals(FREE, "{ goal = \"line\", length_m = -0.1, direction_deg = 0 }"), 5, &["-0.1", "positive"]);
    refused(with_goals(FREE, "{ goal = \"line\", length_m = 9, direction_deg = 0 }"), 5, &["beyond the arm"]);
}

const PULSE: &str = "{ at_s = 1, for_s = 0.5, thrusters = [1, 8] }";
const SINE: &str = "{ joint = 2, amplitude_deg = 20, frequency_Hz = 0.1, phase_deg = 90 }";

fn valves(pulses: &str) -> String {
    format!("{{ goal = \"valves\", pulses = [{pulses}] }}")
}

fn sines(sines: &str) -> String {
    format!("{{ goal = \"sines\", q_deg = [0, 60, 0, 0], sines = [{sines}] }}")
}

#[test]
fn an_excitation_says_which_valves_open_when_and_which_joints_move_how() {
    let phase = with_goals(&valves(PULSE), &sines(SINE)).unwrap().phases.remove(0);
    assert_eq!(phase.base, BaseGoal::Valves(vec![Pulse { at_s: 1.0, for_s: 0.5, thrusters: vec![0, 7] }]));
    let ArmGoal::Sines { about_rad, sines } = phase.arm else { panic!("{:?}", phase.arm) };
    assert!((about_rad[1] - 60_f64.to_radians()).abs() < 1e-12);
    let (amplitude_rad, phase_rad) = (20_f64.to_radians(), 90_f64.to_radians());
    assert_eq!(sines, [Sine { joint: 1, amplitude_rad, frequency_hz: 0.1, phase_rad }]);
}

#[test]
fn an_excitation_that_cannot_be_flown_is_refused() {
    let pulse = |text: &str| with_goals(&valves(text), HOLD);
    refused(pulse("{ at_s = 1, for_s = 0.5, thrusters = [9] }"), 4, &["no thruster 9", "1 to 8"]);
    refused(pulse("{ at_s = 1, for_s = 0.5, thrusters = [0] }"), 4, &["no thruster 0"]);
    refused(pulse("{ at_s = 1, for_s = 0.5, thrusters = [] }"), 4, &["opens no valve"]);
    refused(pulse("{ at_s = 9.8, for_s = 0.5, thrusters = [1] }"), 4, &["10.3", "after its phase"]);
    refused(pulse("{ at_s = -1, for_s = 0.5, thrusters = [1] }"), 4, &["-1"]);
    refused(pulse("{ at_s = 1, for_s = 0, thrusters = [1] }"), 4, &["cannot last 0"]);
    refused(with_goals("{ goal = \"valves\" }", HOLD), 4, &["pulses", "add the key"]);
    refused(with_goals(&format!("{{ goal = \"free\", pulses = [{PULSE}] }}"), HOLD), 4, &["pulses", "valves"]);
    let sine = |text: &str| with_goals(FREE, &sines(text));
    refused(sine("{ joint = 5, amplitude_deg = 2, frequency_Hz = 0.1 }"), 5, &["no joint 5", "1 to 4"]);
    refused(sine("{ joint = 1, amplitude_deg = 2, frequency_Hz = 0 }"), 5, &["0 Hz", "positive"]);
    refused(sine(&format!("{SINE}, {{ joint = 2, amplitude_deg = 11, frequency_Hz = 0.1 }}")), 5, &["91.0", "stop"]);
    refused(sine("{ joint = 1, amplitude_deg = 60, frequency_Hz = 1 }"), 5, &["6.58 rad/s", "1.5 rad/s"]);
    let small = "{ joint = 1, amplitude_deg = 1, frequency_Hz = 0.1 }";
    refused(sine(&[small; 4].join(", ")), 5, &["more than 3 sines"]);
    refused(with_goals(FREE, "{ goal = \"sines\", q_deg = [0, 0, 0, 0] }"), 5, &["sines", "add the key"]);
    refused(with_goals(FREE, &format!("{{ goal = \"hold\", sines = [{SINE}] }}")), 5, &["`sines`"]);
}

#[test]
fn numbers_that_are_none_and_times_that_make_no_sense_are_refused() {
    refused(with_goals("{ goal = \"goto\", x_m = nan, y_m = 0, theta_deg = 0 }", HOLD), 4, &["finite"]);
    let lasting =
        |s: &str| Mission::parse(&format!("name = \"a\"\n[[phase]]\nduration_s = {s}\nbase = {FREE}\narm = {HOLD}"));
    refused(lasting("0"), 3, &["cannot last 0"]);
    refused(lasting("1e9"), 3, &["3600"]);
    refused(lasting("5\nsettle_s = -1"), 4, &["-1"]);
}

#[test]
fn broken_toml_is_refused_at_its_line() {
    refused(Mission::parse("name = \"a\"\n[[phase]\n"), 2, &["TOML"]);
}

#[test]
fn a_start_beyond_a_stop_is_refused() {
    let text = format!(
        "name = \"a\"\n[initial]\nq_deg = [0, 95, 0, 0]\n[[phase]]\nduration_s = 1\nbase = {FREE}\narm = {HOLD}"
    );
    refused(Mission::parse_for(&text, &four_link_plant()), 3, &["joint 2"]);
}

#[test]
fn the_missions_that_stop_and_capture_fit_the_laboratory_and_draw_their_starts_from_the_seed() {
    let plant = Plant::default_laboratory().unwrap();
    let detumble = Mission::parse_for(&shipped("detumble.toml"), &plant).unwrap();
    let capture = Mission::parse_for(&shipped("capture.toml"), &plant).unwrap();
    assert!(detumble.target.is_none() && capture.target.is_some() && capture.aborts.len() == 1);
    for seed in 0..200 {
        let [vehicle, nothing] = detumble.drawn(seed);
        assert!((4.0..=15.0).contains(&vehicle.velocity[2].abs().to_degrees()), "seed {seed}: {vehicle:?}");
        assert!(vehicle.velocity[0].hypot(vehicle.velocity[1]) <= 0.005 + 1e-12, "seed {seed}");
        assert_eq!(nothing, Draw::default(), "there is no target to draw");
        assert_eq!(capture.drawn(seed), capture.drawn(seed));
    }
    let spins = |seed: u64| detumble.drawn(seed)[0].velocity[2] > 0.0;
    assert!((0..20).any(spins) && !(0..20).all(spins), "to either side");
}

#[test]
fn what_cannot_be_waited_for_or_flown_is_refused_where_it_stands() {
    let phase = |keys: &str, base: &str| {
        let text = format!("name = \"test\"\n[[phase]]\nduration_s = 10\n{keys}\nbase = {base}\narm = {HOLD}\n");
        Mission::parse_for(&text, &four_link_plant())
    };
    refused(phase("until = { condition = \"grasped\" }", FREE), 4, &["missing field `timeout_s`"]);
    refused(phase("timeout_s = 20", FREE), 4, &["`timeout_s` contradicts"]);
    refused(phase("until = { condition = \"still\" }\ntimeout_s = 20", FREE), 4, &["missing field `speed_m_s`"]);
    refused(phase("on_abort = \"home\"", FREE), 4, &["no [[abort]] phase named 'home'"]);
    refused(phase("", "{ goal = \"meet\", standoff_m = 0.1 }"), 2, &["no target"]);
    refused(phase("", "{ goal = \"meet\" }"), 5, &["missing field `standoff_m`"]);
}
