//! The FMU's inside against the simulation that the laboratory flies.
#![allow(clippy::unwrap_used)]

use fss_plant::{JointCommand, Plant, Simulation};
use fss_plant_fmu::Instance;
use fss_plant_fmu::variables::variables;

const PLANT: &str = include_str!("../../../deploy/etc/plants/fss.toml");

#[test]
fn the_same_commands_each_millisecond_give_the_same_motion() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("plant.toml"), PLANT).unwrap();
    let plant = Plant::parse(PLANT).unwrap();
    let all = variables(&plant);
    let reference = |name: &str| all.iter().position(|variable| variable.name == name).unwrap() as u32;
    let mut instance = Instance::open(folder.path()).unwrap();
    for (name, value) in [("seed", 7.0), ("start.theta_rad", 0.3), ("start.q2_rad", -0.5)] {
        assert!(instance.set(reference(name), value));
    }
    instance.begin();
    let mut simulation = Simulation::new(&plant, 7).unwrap();
    simulation.set_state([0.0, 0.0, 0.3], [0.0; 3], &[0.0, -0.5, 0.0, 0.0], &[0.0; 4]);
    for step in 0..500 {
        let (level, current_a) = (f64::from(step / 50 % 2), 0.2 * f64::from(step / 100 % 3));
        assert!(instance.set(reference("valve_3"), level) && instance.set(reference("joint_1.current_a"), current_a));
        assert!(instance.step(1e-3));
        simulation.set_level(2, level, simulation.t_s());
        (0..4).for_each(|i| {
            simulation.set_joint(i, JointCommand::Current { current_a: if i == 0 { current_a } else { 0.0 } });
        });
        simulation.step(1e-3);
    }
    let truth = simulation.truth();
    let read = |name: &str| instance.get(reference(name)).unwrap();
    assert_eq!(["base.x_m", "base.y_m", "base.theta_rad"].map(read), truth.base_pose);
    assert_eq!(read("link_1.q_rad"), simulation.encoder_rad(0));
    assert!((truth.base_pose[2] - 0.3).abs() > 1e-4, "it moves");
    assert!(!instance.set(reference("base.x_m"), 1.0), "an output is not set");
    assert!(!instance.set(reference("valve_1"), f64::NAN) && !instance.step(-1.0));
}
