//! What pictures draw lies where the mechanics have it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_multibody::{Coordinates, coordinates};
use fss_plant::Plant;
use fss_plant::scene::{Posture, Scene, Shape, mask};

fn vehicle() -> (Plant, Scene, Posture, Coordinates) {
    let plant = Plant::default_laboratory().unwrap();
    let model = plant.nominal().model().unwrap();
    let (base, q_rad) = ([0.4, -0.7, 1.1], [0.3, -0.8, 0.5, 0.9]);
    let (scene, posture) = (Scene::of(&plant, plant.target.as_ref()), Posture::of(&model, base, &q_rad));
    (plant, scene, posture, coordinates(base, &q_rad))
}

fn middle(shape: &Shape, pose: [f64; 3]) -> [f64; 2] {
    let corners = shape.at(pose);
    [0, 1].map(|axis| corners.iter().map(|corner| corner[axis]).sum::<f64>() / corners.len() as f64)
}

fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[test]
fn each_link_reaches_from_its_joint_to_the_next_and_the_last_to_the_end_effector() {
    let (plant, scene, posture, q) = vehicle();
    let tip = plant.nominal().model().unwrap().end_effector(&q);
    assert_eq!((scene.links.len(), posture.arm.len()), (4, 5));
    for (i, (shapes, pair)) in scene.links.iter().zip(posture.arm.windows(2)).enumerate() {
        let halfway = [0.5 * (pair[0][0] + pair[1][0]), 0.5 * (pair[0][1] + pair[1][1])];
        assert!(apart(middle(&shapes[0], pair[0]), halfway) < 1e-9, "link {}", i + 1);
    }
    let end = posture.arm[4];
    assert!(apart([end[0], end[1]], [tip.x, tip.y]) < 1e-12 && (end[2] - tip.z).abs() < 1e-12);
}

#[test]
fn gas_leaves_open_valves_alone_and_against_their_force() {
    let (plant, scene, mut posture, _) = vehicle();
    posture.pushing = mask(&[0, 0, 1, 0, 0, 0, 1, 0]);
    let bodies = scene.placed(&Posture { pushing: 0, ..posture.clone() }).count();
    assert_eq!(scene.placed(&posture).count(), bodies + 2);
    for (thruster, plume) in plant.thrusters.iter().zip(&scene.plumes) {
        let ([x, y], [ux, uy]) = (thruster.position_m, thruster.unit_direction());
        let [px, py] = middle(plume, [0.0; 3]);
        let along = (px - x) * ux + (py - y) * uy;
        let across = (px - x) * uy - (py - y) * ux;
        assert!(along < -0.05 && across.abs() < 1e-9, "{along} m along the force, {across} m beside it");
    }
    let pushing: Vec<_> = scene.pushing(posture.pushing).collect();
    assert_eq!(pushing, [&scene.plumes[2], &scene.plumes[6]]);
}

#[test]
fn the_target_has_its_handle_on_the_rim_where_its_heading_points() {
    let plant = Plant::default_laboratory().unwrap();
    let target = fss_plant::Target {
        mass_kg: 2.0,
        inertia_kg_m2: 0.02,
        pose: [0.0; 3],
        velocity: [0.0; 3],
        radius_m: 0.2,
        restitution: 0.0,
    };
    let scene = Scene::of(&plant, Some(&target));
    let pose = [1.0, -0.5, std::f64::consts::FRAC_PI_2];
    let rim = |corner: &[f64; 2]| apart(*corner, [1.0, -0.5]);
    assert!(scene.target[0].at(pose).iter().all(|corner| (rim(corner) - 0.2).abs() < 1e-9));
    let handle = scene.target.last().unwrap().at(pose);
    assert!(handle.iter().all(|[x, y]| (x - 1.0).abs() < 0.02 && *y > -0.5 + 0.15), "{handle:?}");
    let bare = Posture { target: None, ..Posture::default() };
    assert!(scene.placed(&bare).all(|(shape, _)| !scene.target.contains(shape)), "none where it was not seen");
}
