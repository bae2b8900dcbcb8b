//! What docs/developer.md promises of its example; tests/tutorials.rs compiles this beside the page's code.
#![allow(clippy::unwrap_used)]

mod common;

use common::{bare_base, close};
use fss_plant::{DEFAULT_PLANT, Plant, Simulation, effects};

#[test]
fn a_plant_file_takes_the_page_s_effect_and_the_base_slows_with_the_cube_of_its_speed() {
    let written = "[[effect]]\nid = \"base_cubic_drag\"\ncoefficient_N_s3_m3 = 400.0\n";
    let file = Plant::parse(&format!("{DEFAULT_PLANT}\n{written}")).unwrap();
    let base = bare_base();
    let mut simulation = Simulation::new(&base.with_effects(&file.effects), 1).unwrap();
    simulation.set_state([0.0; 3], [0.08, 0.06, 0.0], &[], &[]);
    simulation.step(10.0);
    // 1/v^2 grows by 2 c/m a second; the speed is 0.1 m/s at first.
    let expected = (1.0 / 0.01 + 2.0 * 400.0 / base.base.mass_kg * 10.0_f64).sqrt().recip();
    let velocity = simulation.truth().base_velocity;
    close(velocity[0].hypot(velocity[1]), expected, 1e-9);
}

#[test]
fn the_diagnosis_searches_the_page_s_effect() {
    let candidates = effects::candidates(&bare_base());
    assert!(candidates.iter().any(|effect| effect.id() == "base_cubic_drag"));
}
