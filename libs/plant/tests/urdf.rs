//! The URDF is the plant: who follows its joints comes where the plant's own kinematics come.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_multibody::State;
use fss_plant::Plant;
use fss_plant::urdf::urdf;

/// The numbers of an attribute.
fn numbers<'a>(element: &'a str, attribute: &str) -> Vec<f64> {
    let from = element.find(&format!("{attribute}=\"")).expect(attribute) + attribute.len() + 2;
    let text: &'a str = element[from..].split('"').next().unwrap();
    text.split_whitespace().map(|word| word.parse().unwrap()).collect()
}

/// End-effector in the table frame by the URDF's joints alone: x m, y m, angle rad.
fn tip(urdf: &str, base: [f64; 3], q_rad: &[f64]) -> [f64; 3] {
    let [mut x, mut y, mut angle] = base;
    for (i, joint) in urdf.split("<joint ").skip(1).enumerate() {
        let joint = joint.split("</joint>").next().unwrap();
        let (xyz, rpy) = (numbers(joint, "xyz"), numbers(joint, "rpy"));
        let (sin, cos) = angle.sin_cos();
        (x, y) = (x + cos * xyz[0] - sin * xyz[1], y + sin * xyz[0] + cos * xyz[1]);
        angle += rpy[2] + q_rad.get(i).copied().unwrap_or(0.0);
    }
    [x, y, angle]
}

#[test]
fn its_joints_lead_to_the_plants_end_effector_whatever_the_number_of_links() {
    let mut plant = Plant::default_laboratory().unwrap();
    for count in (1..=4).rev() {
        plant.links.truncate(count);
        let (base, q_rad) = ([0.3, -0.2, 0.7], [0.4, -0.9, 0.2, 1.1]);
        let urdf = urdf(&plant);
        let state = State::from_slices(&[&base[..], &q_rad[..count]].concat(), &[]);
        let expected = plant.model().unwrap().end_effector(&state.q);
        let found = tip(&urdf, base, &q_rad[..count]);
        for i in 0..3 {
            assert!((found[i] - expected[i]).abs() < 1e-12, "{count} links: {found:?}, expected {expected:?}");
        }
        assert_eq!(urdf.matches("type=\"revolute\"").count(), count);
        assert_eq!((urdf.matches("<link ").count(), urdf.matches("<inertial>").count()), (count + 2, count + 1));
    }
}
