//! What a plant file may say, and what happens when it says what cannot be.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_plant::{DEFAULT_PLANT, Effect, Instruments, JointCommand, Plant, Simulation, effects};
use std::io::Write as _;

const SMALL: &str = "\
[base]
mass_kg = 10.0
inertia_kg_m2 = 0.25
thrust_N = 0.159

[[thruster]]
position_m = [0.135, 0.065]
force_direction = [-1, 0]

[[link]]
length_m = 0.38
com_to_next_joint_m = 0.19
mass_kg = 2.88
inertia_kg_m2 = 0.034
joint_limit_rad = 1.57
torque_constant_N_m_A = 0.6
max_torque_N_m = 1.8
";

/// Parses `text` and returns the refused line's text, its number and the whole message.
fn refusal(text: &str) -> (String, usize, String) {
    let error = Plant::parse(text).expect_err("the plant must be refused");
    let line = text.lines().nth(error.line - 1).unwrap().to_owned();
    assert!(!error.help.is_empty());
    (line, error.line, error.to_string())
}

fn replaced(from: &str, to: &str) -> String {
    assert!(SMALL.contains(from));
    SMALL.replace(from, to)
}

#[test]
fn the_default_laboratory_is_the_papers() {
    let plant = Plant::default_laboratory().unwrap();
    assert_eq!(plant.links.len(), 4);
    assert_eq!(plant.thrusters.len(), 8);
    assert_eq!(plant.links[3].length_m, 0.3351);
    let arm_kg: f64 = plant.links.iter().map(|l| l.mass_kg).sum();
    assert!(arm_kg > plant.base.mass_kg, "the arm outweighs the base");
    assert!(plant.effects.is_empty());
}

#[test]
fn a_plant_survives_being_written_and_read() {
    let plant = Plant::default_laboratory().unwrap();
    assert_eq!(Plant::parse(&plant.to_toml().unwrap()).unwrap(), plant);
}

#[test]
fn every_effect_survives_being_written_and_read() {
    let plant = Plant::default_laboratory().unwrap();
    let all: Vec<Effect> = effects::catalogue()
        .iter()
        .map(|kind| {
            let mut effect = Effect::of(*kind).at_some_place().nominal(&plant);
            for p in kind.about().parameters {
                let value = effect.get(p.name).unwrap() + 0.5 * p.scale;
                let inside = value.clamp(p.lower, p.upper);
                effect.set(p.name, inside).unwrap();
            }
            if kind.about().id == "valve_swap" {
                effect = effect.with(&[5.0]);
            }
            effect.from_onset(3.25)
        })
        .collect();
    let extended = plant.with_effects(&all);
    let read = Plant::parse(&extended.to_toml().unwrap()).unwrap();
    assert_eq!(read.effects, all);
    assert_eq!(read, extended);
}

/// An index or channel for the kinds that take one.
trait SomePlace {
    fn at_some_place(self) -> Self;
}

impl SomePlace for Effect {
    fn at_some_place(self) -> Self {
        use fss_plant::Index;
        match self.about().index {
            Index::None => self,
            Index::Thruster | Index::Link | Index::Joint => self.at(2),
            Index::Channel => self.on("gyro"),
        }
    }
}

#[test]
fn the_catalogue_has_every_effect_of_the_design() {
    let design = "table_tilt base_linear_drag base_angular_drag base_quadratic_drag \
        base_coulomb_drag body_force tether_torsion tether_linear base_mass base_inertia base_com \
        link_mass link_com link_inertia payload joint_coulomb_friction joint_viscous_friction \
        joint_stribeck_friction joint_spring joint_flexibility joint_backlash \
        drive_kinematic_error torque_constant torque_sensor encoder_offset encoder_scale \
        thruster_gain thruster_leak thruster_misalignment thruster_delay thruster_rise_time \
        thruster_pressure_droop thruster_pressure_trend valve_swap plume_impingement \
        mocap_latency mocap_rotation marker_offset marker_yaw gyro_bias gyro_scale link_latency \
        clock_offset unmodelled";
    for id in design.split_whitespace() {
        assert!(effects::find(id).is_some(), "{id}");
    }
}

#[test]
fn impossible_values_are_refused_at_their_line() {
    for (from, to, line, reason) in [
        ("mass_kg = 10.0", "mass_kg = -10.0", 2, "greater than 0"),
        ("inertia_kg_m2 = 0.25", "inertia_kg_m2 = 0.0", 3, "greater than 0"),
        ("mass_kg = 2.88", "mass_kg = nan", 13, "not a number"),
        ("force_direction = [-1, 0]", "force_direction = [0, 0]", 8, "no length"),
        ("length_m = 0.38", "length_m = inf", 11, "not a number"),
        ("max_torque_N_m = 1.8", "max_torque_N_m = -1.8", 17, "negative"),
        ("max_torque_N_m = 1.8", "max_torque_Nm = 1.8", 17, "unknown field"),
        ("mass_kg = 2.88", "mass_kg = \"2.88\"", 13, "expected f64"),
        ("mass_kg = 2.88\n", "", 10, "missing field"),
        ("thrust_N = 0.159\n", "", 5, "how strong"),
    ] {
        let text = replaced(from, to);
        let (_, number, message) = refusal(&text);
        assert_eq!(number, line, "{message}");
        assert!(message.contains(reason), "{message}");
    }
}

/// [`SMALL`] with these lines in its `[[thruster]]` in place of the base's `thrust_N`.
fn proportional(lines: &str) -> String {
    replaced("thrust_N = 0.159\n", "")
        .replace("force_direction = [-1, 0]\n", &format!("force_direction = [-1, 0]\n{lines}"))
}

#[test]
fn a_proportional_thruster_has_a_curve_and_a_lag() {
    let text = proportional("thrust_curve = [0.03, 1.05, -0.43]\nlag_s = 0.03\n");
    let plant = Plant::parse(&text).unwrap();
    let thruster = &plant.thrusters[0];
    assert_eq!((thruster.thrust_curve, thruster.lag_s), (Some([0.03, 1.05, -0.43]), Some(0.03)));
    assert!(thruster.is_proportional());
    assert!((plant.thrust_n(0) - 0.65).abs() < 1e-12, "at level 1");
    let written = plant.to_toml().unwrap();
    assert_eq!(Plant::parse(&written).unwrap(), plant);
    assert!(!written.contains("thrust_N"), "{written}");
    let valve = Plant::parse(SMALL).unwrap().to_toml().unwrap();
    assert!(!valve.contains("thrust_curve") && !valve.contains("lag_s"), "{valve}");
    let rise = effects::candidates(&plant).into_iter().find(|e| e.id() == "thruster_rise_time").unwrap();
    assert_eq!(rise.values(), [0.03], "its own lag");
    // The base's thrust is that of thrusters which have none of their own.
    let common = replaced("force_direction = [-1, 0]\n", "force_direction = [-1, 0]\nthrust_curve = [0, 1, 0]\n");
    assert_eq!(Plant::parse(&common).unwrap().thrust_n(0), 1.0);
}

#[test]
fn a_proportional_thruster_that_cannot_be_is_refused_at_its_line() {
    for (lines, line, reason) in [
        ("thrust_curve = [0.03, 1.05, -0.43]\nthrust_N = 0.2\n", 9, "both thrust_N and thrust_curve"),
        ("thrust_curve = [0.03, nan, 0.0]\n", 8, "not a number"),
        ("thrust_curve = [0.03, 1.05]\n", 8, "length"),
        ("thrust_curve = [0.1, 0.0, -0.2]\n", 8, "must not be negative"),
        ("thrust_curve = [0.1, 0.0, 0.0]\nlag_s = -0.01\n", 9, "must not be negative"),
        ("thrust_N = 0.1\nlag_s = inf\n", 9, "not a number"),
        ("lag_s = 0.1\n", 5, "how strong"),
    ] {
        let (_, number, message) = refusal(&proportional(lines));
        assert_eq!(number, line, "{message}");
        assert!(message.contains(reason), "{message}");
    }
}

#[test]
fn a_curve_that_gets_another_strength_keeps_its_shape() {
    let mut plant = Plant::parse(&proportional("thrust_curve = [0.25, 1.0, -0.25]\n")).unwrap();
    plant.set_thrust_n(0, 0.5);
    assert_eq!(plant.thrusters[0].thrust_curve, Some([0.125, 0.5, -0.125]));
    assert_eq!(plant.thrusters[0].thrust_n, None);
}

#[test]
fn a_clamped_base_needs_links_to_move() {
    let (_, line, message) = refusal("[base]\nclamped = true\n");
    assert_eq!(line, 2);
    assert!(message.contains("nothing that can move"), "{message}");
}

#[test]
fn a_clamped_base_needs_no_mass() {
    let text = replaced("mass_kg = 10.0\ninertia_kg_m2 = 0.25", "clamped = true");
    assert!(Plant::parse(&text).unwrap().base.clamped);
}

#[test]
fn a_base_without_arm_and_thrusters_is_a_plant() {
    let plant = Plant::parse("[base]\nmass_kg = 10\ninertia_kg_m2 = 0.2\n").unwrap();
    assert_eq!(plant.link_count(), 0);
}

#[test]
fn effects_that_cannot_be_are_refused_at_their_line() {
    for (table, at, reason) in [
        ("id = \"thruster_gian\"\nscale = 0.7", 0, "did you mean thruster_gain?"),
        ("id = \"thruster_gain\"\nindex = 2\nscale = 0.7", 1, "the plant has 1"),
        ("id = \"thruster_gain\"\nindex = 0\nscale = 0.7", 1, "from 1"),
        ("id = \"thruster_gain\"\nindex = 1\ngain = 0.7", 2, "no parameter \"gain\""),
        ("id = \"thruster_gain\"\nindex = 1\nscale = -0.7", 2, "outside of 0 to 10"),
        ("id = \"table_tilt\"\naccel_x_m_s2 = nan", 1, "finite number"),
        ("id = \"table_tilt\"\nindex = 1\naccel_x_m_s2 = 0.1", 1, "takes no index"),
        ("id = \"table_tilt\"", 0, "without any of its parameters"),
        ("id = \"clock_offset\"\nchannel = \"sundial\"\noffset_s = 1", 1, "gyro"),
        ("id = \"valve_swap\"\nindex = 1\nother_index = 1", 2, "two different"),
        ("id = \"gyro_bias\"\nbias_rad_s = 1e-3\nonset_s = -1", 2, "time in the run"),
    ] {
        let text = format!("{SMALL}\n[[effect]]\n{table}\n");
        let (line, _, message) = refusal(&text);
        assert_eq!(line, table.lines().nth(at).unwrap(), "{message}");
        assert!(message.contains(reason), "{message}");
    }
}

#[test]
fn an_error_points_into_the_text() {
    let text = DEFAULT_PLANT.replacen("mass_kg = 10.0", "mass_kg = -3.5", 1);
    let error = Plant::parse(&text).unwrap_err();
    assert_eq!(&text[error.span.clone()], "-3.5");
    assert_eq!(text.lines().nth(error.line - 1).unwrap().trim_start(), {
        let start = text.find("mass_kg = -3.5").unwrap();
        text[start..].lines().next().unwrap()
    });
}

#[test]
fn damaged_files_are_refused_or_read_but_never_crash() {
    use rand::{RngExt, SeedableRng};
    let seed = 4;
    println!("seed {seed}");
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let text = format!("{DEFAULT_PLANT}\n[[effect]]\nid = \"valve_swap\"\nindex = 1\nother_index = 2\n");
    let pieces = ["", "-", "0", "9e99", "nan", "[", "]", "\"", "=", "\n[[effect]]\n", "\u{e9}", "index", "true"];
    let mut refused = 0;
    for _ in 0..1500 {
        let mut damaged: Vec<char> = text.chars().collect();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(0..damaged.len());
            let end = (at + random.random_range(0..12)).min(damaged.len());
            let piece = pieces[random.random_range(0..pieces.len())];
            damaged.splice(at..end, piece.chars());
        }
        let damaged: String = damaged.into_iter().collect();
        if let Err(error) = Plant::parse(&damaged) {
            refused += 1;
            assert!(error.line >= 1 && error.line <= damaged.lines().count() + 1, "{error}");
            assert!(damaged.get(error.span.clone()).is_some(), "{error}");
        }
    }
    assert!(refused > 500, "{refused}");
}

#[test]
fn every_measured_case_is_a_plant() {
    let cases = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/measured/cases");
    let Ok(cases) = std::fs::read_dir(cases) else {
        // Past the harness, which shows what a test prints only where it fails.
        std::io::stderr().write_all(b"skipped: no measured cases beside the repository\n").unwrap();
        return;
    };
    for case in cases.flatten() {
        let file = case.path().join("plant.toml");
        let text = std::fs::read_to_string(&file).unwrap();
        let plant = Plant::parse(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        assert_eq!(Plant::parse(&plant.to_toml().unwrap()).unwrap(), plant);
    }
}

#[test]
fn a_drawn_laboratory_is_off_by_its_uncertainty() {
    let plant = Plant::default_laboratory().unwrap();
    let draws: Vec<Plant> = (0..400).map(|seed| plant.drawn(seed)).collect();
    let spread = |value: &dyn Fn(&Plant) -> f64| {
        let nominal = value(&plant);
        (draws.iter().map(|d| (value(d) - nominal).powi(2)).sum::<f64>() / 400.0).sqrt()
    };
    let stated = plant.uncertainty.clone().unwrap();
    for (drawn, stated) in [
        (spread(&|p| p.base.mass_kg), stated.base_mass_kg),
        (spread(&|p| p.thrust_n(4)), stated.thrust_n),
        (spread(&|p| p.links[2].joint_offset_rad), stated.joint_offset_rad),
        (spread(&|p| p.links[3].coulomb_friction_n_m), stated.coulomb_friction_n_m),
    ] {
        assert!((drawn / stated - 1.0).abs() < 0.15, "{drawn} against {stated}");
    }
    assert_eq!(plant.drawn(3), plant.drawn(3));
    assert_eq!(draws[0].drawn(9), draws[0], "what is exact stays");
}

#[test]
fn every_candidate_is_one_that_the_plant_can_have() {
    let plant = Plant::default_laboratory().unwrap();
    let candidates = effects::candidates(&plant);
    for effect in &candidates {
        effect.validate(&plant).unwrap();
    }
    let count = |id: &str| candidates.iter().filter(|e| e.id() == id).count();
    assert_eq!((count("table_tilt"), count("thruster_gain"), count("encoder_offset")), (1, 8, 4));
    assert_eq!((count("valve_swap"), count("clock_offset"), count("unmodelled")), (28, effects::STREAMS.len(), 0));
    let friction = candidates.iter().find(|e| e.id() == "joint_coulomb_friction").unwrap();
    assert_eq!(friction.values(), [0.1], "the plant's own value");
}

#[test]
fn candidates_at_their_nominal_values_change_nothing() {
    let plant = Plant::default_laboratory().unwrap();
    let fly = |effects: &[Effect]| {
        let mut simulation = Simulation::new(&plant.with_effects(effects), 1).unwrap();
        simulation.set_joint(1, JointCommand::Position { q_rad: 0.5, qd_rad_s: 0.0 });
        simulation.set_valves(&[false, false, true, false, true, false, false, true]);
        simulation.step(0.4);
        let mut instruments = Instruments::new(4, 1);
        let poses = [instruments.mocap_base(&simulation), instruments.mocap_end_effector(&simulation)];
        let links = [0, 1, 2, 3].map(|i| instruments.link(&simulation, i));
        (poses, instruments.gyro(&simulation), links)
    };
    let nominal = fly(&[]);
    for effect in effects::candidates(&plant) {
        // A swap has no value that does nothing, and the stiffest drive still has a rotor of its own.
        if !["valve_swap", "joint_flexibility"].contains(&effect.id()) {
            assert_eq!(fly(std::slice::from_ref(&effect)), nominal, "{effect}");
        }
    }
}

#[test]
fn the_page_of_effects_is_current() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/effects.md");
    let page = fss_plant::effects_table_markdown();
    if std::env::var_os("FSS_BLESS").is_some() {
        std::fs::write(file, &page).unwrap();
    }
    assert_eq!(std::fs::read_to_string(file).unwrap(), page, "write it again: FSS_BLESS=1 cargo test -p fss-plant");
}
