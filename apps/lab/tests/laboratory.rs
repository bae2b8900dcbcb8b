//! The laboratory as a whole, on a virtual clock.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{Bench, MS, S, config, key, plant, velocity};
use fss_lab::{Fault, FaultKind, LabConfig, LabError, Laboratory, Network, Start};

/// Some of everything: valves, commands, a bad network.
fn busy_run(seed: u64) -> common::Heard {
    println!("seed {seed}");
    let bad = Network { loss: 0.1, duplicate: 0.1, corrupt: 0.1, delay_s: 0.001, jitter_s: 0.05 };
    let config = LabConfig { mocap: bad, gyro: bad, link_up: bad, link_down: bad, ..LabConfig::new(seed, key()) };
    let mut bench = Bench::new(&plant(), config);
    for period in 0..15 {
        bench.set_valves(1 << (period % 8));
        bench.command(period % 4, velocity(0.1));
        bench.wait(200 * MS);
    }
    bench.heard
}

#[test]
fn two_laboratories_with_one_seed_send_identical_bytes() {
    let (one, other, third) = (busy_run(7), busy_run(7), busy_run(8));
    assert!(one.mocap.len() > 250 && one.gyro.len() > 250 && one.links.len() > 20);
    assert!(one == other);
    assert!(one.mocap != third.mocap && one.gyro != third.gyro && one.links != third.links);
}

#[test]
fn how_often_the_laboratory_is_asked_to_step_changes_nothing() {
    let mut fine = Bench::new(&plant(), config());
    let mut coarse = Bench::new(&plant(), config());
    (0..2000).for_each(|_| fine.wait(MS));
    coarse.wait(2 * S);
    assert!(fine.heard == coarse.heard);
    assert_eq!(fine.laboratory.truth(), coarse.laboratory.truth());
}

#[test]
fn open_valves_push_the_base_and_use_gas() {
    let plant = plant();
    let mut bench = Bench::new(&plant, config());
    let full = bench.laboratory.truth();
    bench.set_valves(0b1100);
    bench.wait(2 * S);
    let pushed = bench.laboratory.truth();
    assert_eq!(pushed.valves[..4], [0, 0, 1, 1]);
    assert!((pushed.thrust_n[2] - 0.159).abs() < 1e-6 && pushed.thrust_n[0] == 0.0);
    // Thrusters 3 and 4 push along +x: two of 0.159 N for 2 s, less the valves' delay and rise; room air adds a little.
    let impulse = pushed.momentum[0];
    assert!((impulse - 2.0 * 0.159 * 2.0).abs() < 0.01, "impulse {impulse} N s");
    assert!(pushed.gas_used_kg > 0.0 && pushed.tank_pressure_pa < full.tank_pressure_pa);
    bench.set_valves(0);
    bench.wait(100 * MS);
    assert!(bench.laboratory.truth().thrust_n.iter().all(|thrust| *thrust == 0.0), "shut");
}

#[test]
fn a_valve_opens_when_it_is_told_and_not_at_the_step_before() {
    let pushed = |later_ns: u64| {
        let mut bench = Bench::new(&plant(), config());
        bench.laboratory.set_valves(0b1100, bench.laboratory.now_ns() + later_ns);
        bench.wait(S);
        bench.laboratory.truth().momentum[0]
    };
    let missing = pushed(0) - pushed(MS / 2);
    assert!((missing - 2.0 * 0.159 * 0.5e-3).abs() < 1e-6, "{missing} N s less in half a millisecond");
}

#[test]
fn a_run_starts_where_the_configuration_says() {
    let mut q_rad = [0.0; fss_plant::MAX_LINKS];
    q_rad[..4].copy_from_slice(&[-0.5, 1.0, -1.0, 0.5]);
    let start = Start { pose: [-0.6, 0.1, 0.2], q_rad, ..Start::default() };
    let laboratory = Laboratory::new(&plant(), LabConfig { start, ..config() }, 5 * S).unwrap();
    let truth = laboratory.truth();
    assert_eq!((truth.x_m, truth.y_m, truth.theta_rad, truth.stamp_ns), (-0.6, 0.1, 0.2, 5 * S));
    assert_eq!(truth.q_rad[..4], q_rad[..4]);
    assert_eq!((truth.link_count, truth.valve_count), (4, 8));
}

#[test]
fn a_configuration_that_makes_no_sense_is_refused_with_its_place() {
    let refusal = |config: LabConfig| match Laboratory::new(&plant(), config, 0) {
        Err(LabError::Config { what }) => what,
        other => panic!("{other:?}"),
    };
    let network = Network { loss: 1.5, ..Network::default() };
    assert!(refusal(LabConfig { link_up: network, ..config() }).contains("link_up"));
    let dead = Fault { from_s: 0.0, to_s: 1.0, kind: FaultKind::LinkDead { link: 5 } };
    assert!(refusal(LabConfig { faults: vec![dead], ..config() }).contains("links are 1 to 4"));
    let nobody = Fault { from_s: 0.0, to_s: 1.0, kind: FaultKind::MocapZeros { object: "bse".into() } };
    assert!(refusal(LabConfig { faults: vec![nobody], ..config() }).contains("base, end_effector, target"));
    let backwards = Fault { from_s: 2.0, to_s: 1.0, kind: FaultKind::MocapSilent };
    assert!(refusal(LabConfig { faults: vec![backwards], ..config() }).contains("2 to 1 s"));
    assert!(refusal(LabConfig { gyro_clock_error: -1.0, ..config() }).contains("gyro clock"));
}

#[test]
fn faults_are_read_from_a_mission_file() {
    #[derive(serde::Deserialize)]
    struct File {
        fault: Vec<Fault>,
        link_up: Network,
    }
    let file: File = toml::from_str(
        r#"
        link_up = { loss = 0.1, delay_s = 0.02 }
        [[fault]]
        kind = { mocap_zeros = { object = "base" } }
        from_s = 5
        to_s = 6.5
        [[fault]]
        kind = { link_dead = { link = 2 } }
        from_s = 10
        to_s = 12
        "#,
    )
    .unwrap();
    assert_eq!(file.fault[0].kind, FaultKind::MocapZeros { object: "base".into() });
    assert_eq!(file.fault[1], Fault { from_s: 10.0, to_s: 12.0, kind: FaultKind::LinkDead { link: 2 } });
    assert_eq!(file.link_up, Network { loss: 0.1, delay_s: 0.02, ..Network::default() });
    for typo in ["kind = 'mocap_silnt'", "kind = { link_dead = { lnk = 2 } }", "kind = 'gyro_silent'\nuntil_s = 3"] {
        assert!(toml::from_str::<Fault>(&format!("from_s = 1\nto_s = 2\n{typo}")).is_err(), "{typo}");
    }
}
