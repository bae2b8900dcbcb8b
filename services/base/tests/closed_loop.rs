//! The base under control on the simulated table: on/off valves, a locked arm that outweighs it, the room's air and a
//! navigation with its errors.
#![allow(clippy::unwrap_used)]

mod support;

use fss_plant::Plant;
use std::f64::consts::FRAC_PI_2;
use support::{RATE_HZ, START, Table};

fn laboratory() -> Plant {
    Plant::default_laboratory().unwrap()
}

#[test]
fn a_base_holds_its_pose_against_the_rooms_air_and_spares_its_gas() {
    let mut table = Table::new(&laboratory());
    table.fly(START, 0.0, 20.0);
    (table.opened, table.pulses) = (0, 0);
    for _ in 0..12 {
        table.fly_on(START, 0.0, 5.0);
        table.assert_at(START);
    }
    let open_share = table.opened as f64 / (60.0 * RATE_HZ);
    let (pulses_a_minute, gas_kg) = (table.pulses, table.simulation.gas_used_kg());
    println!("valves open {open_share:.4} of the time, {pulses_a_minute} pulses a minute, {gas_kg} kg in 80 s");
    // The room's 0.5 mN and 0.05 mN m need 0.007 of a thruster's time.
    assert!(open_share < 0.15 && pulses_a_minute < 200);
}

#[test]
fn a_base_slews_and_translates_and_settles() {
    let mut table = Table::new(&laboratory());
    let turned = [START[0], START[1], START[2] + FRAC_PI_2];
    let largest = table.fly(turned, 100.0, 110.0);
    println!("{largest:?} from the reference");
    assert!(largest[2] < 0.05 && largest[0].hypot(largest[1]) < 0.03);
    table.assert_at(turned);
    let moved = [turned[0] + 0.4, turned[1] - 0.3, turned[2]];
    let largest = table.fly(moved, 40.0, 50.0);
    println!("{largest:?} from the reference");
    assert!(largest[2] < 0.05 && largest[0].hypot(largest[1]) < 0.03);
    table.assert_at(moved);
}

#[test]
fn a_goal_beyond_the_thrusters_takes_the_time_that_it_needs() {
    let mut table = Table::new(&laboratory());
    let far = [START[0] + 0.5, START[1], START[2] + FRAC_PI_2];
    let largest = table.fly(far, 5.0, 150.0);
    println!("{largest:?} from the reference");
    assert!(largest[2] < 0.1 && largest[0].hypot(largest[1]) < 0.05, "the reference does not run away");
    table.assert_at(far);
}

#[test]
fn a_restarted_controller_goes_the_rest_of_the_way_smoothly() {
    let plant = laboratory();
    let mut table = Table::new(&plant);
    let moved = [START[0] + 0.3, START[1], START[2]];
    table.fly(moved, 40.0, 15.0);
    table.restart_controller(&plant);
    let largest = table.fly_on(moved, 40.0, 45.0);
    println!("{largest:?} from the reference");
    assert!(largest[0] < 0.05);
    table.assert_at(moved);
}

#[test]
fn whole_turns_that_navigation_forgets_do_not_spin_the_base() {
    let mut table = Table::new(&laboratory());
    table.fly(START, 0.0, 5.0);
    table.forgotten_turns = 1.0;
    table.fly_on(START, 0.0, 20.0);
    table.assert_at(START);
}

#[test]
fn a_tilted_table_is_held_against() {
    let tilt = "\n[[effect]]\nid = \"table_tilt\"\naccel_x_m_s2 = 0.002\naccel_y_m_s2 = -0.001\n";
    let mut table = Table::new(&Plant::parse(&format!("{}{tilt}", fss_plant::DEFAULT_PLANT)).unwrap());
    table.fly(START, 0.0, 130.0);
    table.assert_at(START);
}

#[test]
fn a_base_whose_navigation_falls_silent_shuts_its_thrusters() {
    let mut table = Table::new(&laboratory());
    let goal = [0.4, 0.1, 0.2];
    table.fly(goal, 0.0, 10.0);
    assert!(table.opened > 50, "far from its goal it thrusts");
    table.nav_works = false;
    table.fly_on(goal, 0.0, 0.1);
    table.opened = 0;
    table.fly_on(goal, 0.0, 2.0);
    assert_eq!(table.opened, 0);
}
