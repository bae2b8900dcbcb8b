#![allow(clippy::unwrap_used)]

use super::*;

/// A run's folder with these files beside its `run.toml`.
fn run(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("run.toml"), "format = \"fss-experiment/1\"\nname = \"x\"\n").unwrap();
    for (file, text) in files {
        std::fs::write(folder.path().join(file), text).unwrap();
    }
    folder
}

fn refused(files: &[(&str, &str)]) -> String {
    Experiment::read(run(files).path()).unwrap_err().to_string()
}

#[test]
fn levels_of_proportional_thrusters_are_read_and_may_begin_before_the_run() {
    let folder = run(&[("thrust_level.csv", "t_s,u1,u2\n-0.2,0.03,0\n0,0.5,1\n")]);
    let experiment = Experiment::read(folder.path()).unwrap();
    let table = experiment.thrust_level.unwrap();
    assert_eq!(table.t_s, [-0.2, 0.0]);
    assert_eq!(table.numbered("u", ""), [&[0.03, 0.5], &[0.0, 1.0]]);
    assert!(experiment.valves.is_none());
}

#[test]
fn a_level_that_is_none_is_refused_with_its_row_and_column() {
    let refused = |text: &str| refused(&[("thrust_level.csv", text)]);
    for (text, place) in [
        ("t_s,u1,u2\n0,0.1,0.2\n0.1,0.1,55\n", "thrust_level.csv:3: column 'u2': 55 is no level"),
        ("t_s,u1\n\n0,-0.1\n", "thrust_level.csv:3: column 'u1': -0.1 is no level"),
        ("t_s,u1\n0,full\n", "thrust_level.csv:2: column 'u1': 'full' is no number"),
        ("t_s,u1,u2\n0,1\n", "thrust_level.csv:2: column 'u2': the row ends"),
        ("t_s,u1\n0,1\n0,1\n", "thrust_level.csv:3: column 't_s': time does not increase"),
        ("t_s\n0\n", "thrust_level.csv:1: column 'u1'"),
        ("t_s,v1\n0,1\n", "thrust_level.csv:1: column 'u1'"),
        ("t_s,u1,u3\n0,1,1\n", "thrust_level.csv:1: column 'u2'"),
    ] {
        let message = refused(text);
        assert!(message.contains(place), "{message}");
    }
}

#[test]
fn valves_and_levels_in_one_run_are_refused() {
    let message = refused(&[("valves.csv", "t_s,v1\n0,1\n"), ("thrust_level.csv", "t_s,u1\n0,1\n")]);
    assert!(message.contains("thrust_level.csv") && message.contains("remove valves.csv"), "{message}");
}

#[test]
fn what_is_no_text_is_refused_where_it_stands_and_a_byte_order_mark_is_passed_over() {
    let folder = run(&[("gyro.csv", "\u{feff}t_s,rate_rad_s\n0,0.1\n")]);
    assert!(Experiment::read(folder.path()).unwrap().gyro.is_some());
    let message = |bytes: &[u8]| {
        std::fs::write(folder.path().join("gyro.csv"), bytes).unwrap();
        Experiment::read(folder.path()).unwrap_err().to_string()
    };
    let damaged = message(b"t_s,rate_rad_s\n0,0.1\n1,0.\xff2\n");
    assert!(damaged.contains("gyro.csv:3: column 'rate_rad_s'") && damaged.contains("is no number"), "{damaged}");
    let utf16 = message(b"\xff\xfet\0_\0s\0");
    assert!(utf16.contains("gyro.csv:1") && utf16.contains("UTF-8"), "{utf16}");
}
