//! Vehicles that are not the paper's: a base without an arm, seen 20 times a second, without a gyro.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod flights;

use flights::{Truth, flights, flights_with_borrowed_commands, flights_with_early_commands, plant};
use fss_diagnosis::diagnose;
use fss_diagnosis::diagnosis::Verdict;
use fss_plant::Uncertainty;

#[test]
fn a_base_without_arm_or_gyro_is_simulated_to_its_noise() {
    let found = diagnose(&plant(), &flights(Truth::default()), &[], &|_| ()).unwrap();
    assert_eq!(found.verdict, Verdict::Consistent, "{:?} {:?}", found.causes, found.remarks);
    assert!((found.gain.after - 1.0).abs() < 0.1, "{}", found.gain.after);
}

#[test]
fn its_air_drag_is_named() {
    let found = diagnose(&plant(), &flights(Truth { drag_n_s_m: 0.5, ..Truth::default() }), &[], &|_| ()).unwrap();
    let named: Vec<&str> = found.causes.iter().map(|c| c.effect.id()).collect();
    assert_eq!(named, ["base_linear_drag"]);
    let value = found.causes[0].effect.values()[0];
    // Noise leaves parts in ten thousand; forces along the measured path are right to a part in a thousand.
    assert!((value - 0.5).abs() < 5e-4, "{value} +- {}", found.causes[0].std[0]);
    assert!(found.causes[0].std[0] < 1e-3, "{}", found.causes[0].std[0]);
}

/// No plant file states how well the times of its valves are known: half as slow again is no fault of theirs.
#[test]
fn its_air_drag_is_named_alone_where_valves_are_slower_than_stated() {
    let mut plant = plant();
    (plant.valves.rise_s, plant.valves.fall_s) = (0.03, 0.03);
    plant.uncertainty = Some(Uncertainty::default());
    let found = diagnose(&plant, &flights(Truth { drag_n_s_m: 0.5, lags_s: 0.045, ..Truth::default() }), &[], &|_| ());
    let found = found.unwrap();
    let named: Vec<&str> = found.causes.iter().map(|c| c.effect.id()).collect();
    assert_eq!(named, ["base_linear_drag"]);
    let value = found.causes[0].effect.values()[0];
    assert!((value - 0.5).abs() < 1e-3, "{value} +- {}", found.causes[0].std[0]);
}

#[test]
fn friction_that_holds_the_base_after_each_pulse_is_named_alone_and_measured() {
    let rubs = [0.08, 0.004];
    let found = diagnose(&plant(), &flights(Truth { rubs, ..Truth::default() }), &[], &|_| ()).unwrap();
    let named: Vec<&str> = found.causes.iter().map(|c| c.effect.id()).collect();
    assert_eq!(named, ["base_coulomb_drag"], "{:?}", found.verdict);
    for (value, truth) in found.causes[0].effect.values().iter().zip(rubs) {
        assert!((value / truth - 1.0).abs() < 0.03, "{value} for {truth}");
    }
}

#[test]
fn a_supply_that_loses_half_its_pressure_is_named_and_measured() {
    let runs = flights(Truth { pressure_per_s: -0.016, ..Truth::default() });
    let found = diagnose(&plant(), &runs[..2], &runs[2..], &|_| {}).unwrap();
    assert_eq!(found.verdict, Verdict::Explained, "{:?}", found.causes);
    assert_eq!(found.causes.len(), 1, "{:?}", found.causes);
    let effect = &found.causes[0].effect;
    assert_eq!(effect.id(), "thruster_pressure_trend");
    assert!((effect.values()[0] / -0.016 - 1.0).abs() < 0.05, "{effect:?}");
}

/// An uncertain value takes up what it may, and no more: far beyond its deviation it is a weak thruster.
#[test]
fn a_thruster_weaker_than_its_thrust_is_uncertain_is_named_and_one_within_is_not() {
    let mut plant = plant();
    plant.uncertainty = Some(Uncertainty { thrust_n: 0.004, ..Uncertainty::default() });
    let with = |lacks| {
        let runs = flights(Truth { lacks, ..Truth::default() });
        diagnose(&plant, &runs[..2], &runs[2..], &|_| ()).unwrap()
    };
    let found = with(0.25);
    let named: Vec<_> = found.causes.iter().map(|c| (c.effect.id(), c.effect.index())).collect();
    assert_eq!(named, [("thruster_gain", Some(1))], "{:?}", found.suspects);
    let value = found.causes[0].effect.values()[0];
    assert!((value - 0.75).abs() < 3.0 * found.causes[0].std[0], "{value} +- {}", found.causes[0].std[0]);
    let found = with(0.04);
    assert_eq!((found.verdict, found.causes.len()), (Verdict::Consistent, 0), "{:?}", found.causes);
}

/// One thruster that lacks a share of its thrust lacks it in every flight.
#[test]
fn a_thruster_that_is_weak_in_one_flight_and_strong_in_another_is_no_weak_thruster() {
    let runs: Vec<_> = [0.5, -0.1, 0.3]
        .iter()
        .enumerate()
        .map(|(k, lacks)| flights(Truth { lacks: *lacks, ..Truth::default() }).swap_remove(k))
        .collect();
    let found = diagnose(&plant(), &runs, &[], &|_| ()).unwrap();
    assert_eq!((found.verdict, found.causes.len()), (Verdict::Unexplained, 0), "{:?}", found.causes);
    assert!(found.remarks.iter().any(|r| r.contains("each for another size")), "{:?}", found.remarks);
}

#[test]
fn waves_of_the_table_that_no_effect_describes_are_called_unexplained() {
    let found = diagnose(&plant(), &flights(Truth { waves_n: 0.02, ..Truth::default() }), &[], &|_| ()).unwrap();
    assert!(matches!(found.verdict, Verdict::Unexplained | Verdict::PartlyExplained), "{:?}", found.causes);
}

/// Its frequency is no multiple of any that the runs' lengths suggest. What a wrong frequency left over was once a heavier base.
#[test]
fn a_force_that_shakes_the_base_is_a_law_of_its_own_frequency_and_no_cause() {
    let [size_n, frequency_hz] = [0.05, 0.4083];
    let found =
        diagnose(&plant(), &flights(Truth { shakes: [size_n, frequency_hz], ..Truth::default() }), &[], &|_| ());
    let found = found.unwrap();
    assert_eq!((found.verdict, found.causes.len()), (Verdict::Unexplained, 0), "{:?}", found.causes);
    let along_x = found.laws.iter().find(|law| law.values()[2] == 0.0).expect("a law along x");
    assert!((along_x.values()[0] / size_n - 1.0).abs() < 0.05, "{along_x:?}");
    assert!((along_x.values()[1] - frequency_hz).abs() < 1e-3, "{along_x:?}");
    assert!((found.gain.after - 1.0).abs() < 0.1, "{}", found.gain.after);
}

#[test]
fn commands_of_another_run_are_told_from_weak_thrusters() {
    let found = diagnose(&plant(), &flights_with_borrowed_commands(), &[], &|_| ()).unwrap();
    assert!(found.causes.is_empty(), "{:?}", found.causes);
    assert_eq!(found.verdict, Verdict::Unexplained);
}

#[test]
fn commands_by_a_clock_that_is_off_are_told() {
    let found = diagnose(&plant(), &flights_with_early_commands(), &[], &|_| ()).unwrap();
    assert!(found.causes.iter().all(|c| c.effect.id() == "clock_offset"), "{:?}", found.causes);
    assert!(found.verdict != Verdict::Consistent, "{:?}", found.remarks);
}
