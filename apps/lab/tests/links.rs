//! The arm's links, commanded and heard through their datagrams.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{Bench, COMPUTER, MS, S, config, key, plant, position, velocity};
use fss_lab::{COMMAND_TIMEOUT_NS, Fault, FaultKind, LabConfig, Network};
use fss_wire::link::{Command, Faults, Key, Mode};

#[test]
fn a_link_answers_whoever_commands_it_five_times_a_second() {
    let mut bench = Bench::new(&plant(), config());
    bench.wait(S);
    assert!(bench.heard.links.is_empty(), "a link that nobody commanded has nobody to talk to");
    bench.drive(2, 10 * S, |_| velocity(0.05));
    let telemetry = bench.heard.telemetry(2);
    assert!(telemetry.iter().skip(5).all(|report| report.faults == Faults::default()));
    assert!((49..=51).contains(&telemetry.len()), "{} reports in 10 s", telemetry.len());
    assert!(bench.heard.links.iter().all(|(_, link, to, _)| *link == 2 && *to == COMPUTER));
    let last = telemetry.last().unwrap();
    assert_eq!((last.link, last.mode), (3, Mode::Velocity));
    assert!(bench.sequence - last.last_command <= 2, "the last command is acknowledged");
    let truth = bench.laboratory.truth().q_rad[2];
    assert!((f64::from(last.position_rad) - truth).abs() < 0.05 * 0.25, "encoder {}, joint {truth}", last.position_rad);
    assert!((truth - 0.5).abs() < 0.02, "10 s at 0.05 rad/s turned the joint to {truth}");
    assert!(telemetry.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1));
    let device_s = (last.time_ns - telemetry[0].time_ns) as f64 * 1e-9;
    assert!((device_s - 0.2 * (telemetry.len() - 1) as f64).abs() < 0.01, "the device's clock ran {device_s} s");
}

#[test]
fn targets_sent_five_times_a_second_make_a_smooth_motion() {
    let mut bench = Bench::new(&plant(), config());
    bench.drive(0, 2 * S, |t_s| position(0.1 * t_s, 0.1));
    let mut slowest = f64::INFINITY;
    let mut fastest = 0.0_f64;
    for period in 10..20 {
        bench.command(0, position(0.02 * f64::from(period), 0.1));
        for _ in 0..200 {
            bench.wait(MS);
            let rate = bench.laboratory.truth().qd_rad_s[0];
            (slowest, fastest) = (slowest.min(rate), fastest.max(rate));
        }
    }
    assert!(slowest > 0.08 && fastest < 0.12, "at 0.1 rad/s the joint went between {slowest} and {fastest} rad/s");
}

#[test]
fn a_replayed_command_is_refused_and_changes_nothing() {
    let mut bench = Bench::new(&plant(), config());
    let recorded = bench.command(0, velocity(0.1));
    bench.wait(200 * MS);
    bench.command(0, velocity(0.0));
    bench.wait(S / 2);
    let before = bench.laboratory.truth().q_rad[0];
    bench.laboratory.command_link(0, "127.0.0.9:9".parse().unwrap(), &recorded);
    bench.wait(S / 4);
    assert_eq!(bench.laboratory.traffic().refused, 1);
    assert!((bench.laboratory.truth().q_rad[0] - before).abs() < 1e-4, "the joint stands");
    assert!(bench.heard.links.iter().all(|(_, _, to, _)| *to == COMPUTER), "the replayer is told nothing");
    assert_eq!(bench.heard.telemetry(0).last().unwrap().last_command, bench.sequence);
}

#[test]
fn damaged_foreign_and_misdirected_commands_move_nothing() {
    let mut bench = Bench::new(&plant(), config());
    let stranger = Key::new(b"somebody else's key").unwrap();
    let mut damaged = Command { link: 1, sequence: 5, ..velocity(0.3) }.encode(&key());
    damaged[30] ^= 4;
    let foreign = Command { link: 1, sequence: 6, ..velocity(0.3) }.encode(&stranger);
    let misdirected = Command { link: 2, sequence: 7, ..velocity(0.3) }.encode(&key());
    for datagram in [&damaged, &foreign, &misdirected] {
        bench.laboratory.command_link(0, COMPUTER, datagram);
    }
    bench.laboratory.command_link(0, COMPUTER, b"hello");
    bench.wait(S);
    assert_eq!((bench.laboratory.traffic().commands, bench.laboratory.traffic().refused), (0, 4));
    assert!(bench.heard.links.is_empty());
    assert!(bench.laboratory.truth().q_rad[0].abs() < 1e-3, "only the room's air moves the arm");
}

#[test]
fn a_link_whose_commands_stop_disables_its_driver_and_says_so() {
    let mut bench = Bench::new(&plant(), config());
    bench.drive(1, 2 * S, |_| velocity(0.2));
    assert!(bench.laboratory.truth().current_a[1].abs() > 0.1);
    bench.wait(COMMAND_TIMEOUT_NS + S / 2);
    assert_eq!(bench.laboratory.truth().current_a[1], 0.0);
    let last = *bench.heard.telemetry(1).last().unwrap();
    assert_eq!(last.mode, Mode::Disabled);
    assert!(last.faults.contains(Faults::COMMAND_LOST));
    bench.drive(1, S, |_| velocity(0.2));
    let last = *bench.heard.telemetry(1).last().unwrap();
    assert_eq!((last.mode, last.faults.contains(Faults::COMMAND_LOST)), (Mode::Velocity, false), "it comes back");
}

#[test]
fn no_command_drives_a_joint_past_its_limit() {
    let plant = plant();
    let limit = plant.links[3].joint_limit_rad;
    for command in [velocity(0.8), position(9.0, 0.0), position(1.5, 0.8)] {
        let mut bench = Bench::new(&plant, config());
        bench.drive(3, 8 * S, |_| command);
        let truth = bench.laboratory.truth().q_rad[3];
        // A step of the target overshoots by a little.
        assert!(truth <= limit + 0.005, "{:?} took the joint to {truth}", command.mode);
        assert!(truth > 0.9 * limit, "{:?} took the joint to {truth} only", command.mode);
        assert!(bench.heard.telemetry(3).last().unwrap().faults.contains(Faults::JOINT_LIMIT));
    }
}

#[test]
fn a_driver_uses_no_more_torque_than_its_command_allows() {
    let mut bench = Bench::new(&plant(), config());
    let torque_constant = plant().links[0].torque_constant_n_m_a;
    bench.drive(0, 2 * S, |_| Command { max_torque_nm: 0.06, ..velocity(0.5) });
    assert!(bench.heard.telemetry(0).last().unwrap().faults.contains(Faults::TORQUE_LIMIT));
    let current = bench.laboratory.truth().current_a[0];
    assert!((current * torque_constant - 0.06).abs() < 1e-6, "torque {} N m", current * torque_constant);
    bench.drive(0, 2 * S, |_| Command {
        mode: Mode::Current,
        current_a: 5.0,
        max_torque_nm: 0.06,
        ..Command::default()
    });
    let current = bench.laboratory.truth().current_a[0];
    assert!((current * torque_constant - 0.06).abs() < 1e-6, "torque {} N m", current * torque_constant);
}

#[test]
fn a_stuck_encoder_a_saturated_sensor_a_failed_driver_and_a_dead_link_look_like_it() {
    let fault = |kind| Fault { from_s: 2.0, to_s: 4.0, kind };
    let faults = vec![
        fault(FaultKind::EncoderStuck { link: 1 }),
        fault(FaultKind::TorqueSaturated { link: 2 }),
        fault(FaultKind::LinkDead { link: 3 }),
        fault(FaultKind::DriverFault { link: 4 }),
    ];
    let mut bench = Bench::new(&plant(), LabConfig { faults, ..config() });
    for _ in 0..30 {
        for link in 0..4 {
            bench.command(link, velocity(0.1));
        }
        bench.wait(200 * MS);
    }
    let telemetry = bench.heard.telemetry(0);
    let stuck = telemetry.windows(2).filter(|pair| pair[0].position_rad == pair[1].position_rad).count();
    assert!((8..=10).contains(&stuck), "{stuck} readings repeat in 2 s");
    let saturated: Vec<_> = bench.heard.telemetry(1).iter().map(|report| report.torque.is_saturated()).collect();
    assert!(
        (9..=11).contains(&saturated.iter().filter(|is| **is).count())
            && !saturated[0]
            && !saturated[saturated.len() - 1]
    );
    let failed = bench.heard.telemetry(3).into_iter().filter(|report| report.faults.contains(Faults::DRIVER));
    assert!(failed.clone().count() >= 9 && failed.clone().all(|report| report.mode == Mode::Disabled));
    let dead = bench.heard.telemetry(2).len();
    assert!((19..=21).contains(&dead), "{dead} of 30 reports of a link that is dead for a third of the time");
}

#[test]
fn a_bad_network_damages_commands_and_the_arm_still_follows_the_rest() {
    let link_up = Network { loss: 0.3, duplicate: 0.2, corrupt: 0.2, delay_s: 0.01, jitter_s: 0.3 };
    let mut bench = Bench::new(&plant(), LabConfig { link_up, ..config() });
    bench.drive(0, 20 * S, |_| velocity(0.05));
    let traffic = bench.laboratory.traffic();
    assert!(traffic.refused > 10 && traffic.commands > 20, "{traffic:?}");
    let truth = bench.laboratory.truth().q_rad[0];
    assert!((truth - 1.0).abs() < 0.1, "20 s at 0.05 rad/s turned the joint to {truth}");
}
