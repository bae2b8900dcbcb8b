//! The laboratory's vehicle and the reference files.
#![allow(dead_code, clippy::unwrap_used)]

pub(crate) mod hyperdual;
pub(crate) mod random;

use fss_multibody::{Base, Coordinates, Link, Model, State};
use serde_json::Value;

/// Reference values from SPART (`dynamics.json`) and independent numpy scripts (`paper.json`).
pub(crate) fn reference(name: &str) -> Value {
    let path = format!("{}/tests/reference/{name}", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Numbers of an array of any depth, row by row.
pub(crate) fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

pub(crate) fn coordinates(value: &Value) -> Coordinates {
    State::from_slices(&numbers(value), &[]).q
}

/// The model that a reference file was made with.
pub(crate) fn model(params: &Value) -> Model {
    let number = |key: &str| params[key].as_f64().unwrap();
    let list = |key: &str| numbers(&params[key]);
    let base = Base {
        mass_kg: number("m0"),
        inertia_kg_m2: number("I0"),
        joint1_xy_m: [number("xBJ1"), number("yBJ1")],
        joint1_angle_rad: number("thBJ1_deg").to_radians(),
        ..Base::default()
    };
    let links: Vec<Link> = (0..list("a").len())
        .map(|i| Link {
            length_m: list("a")[i],
            com_to_next_joint_m: list("b")[i],
            mass_kg: list("m")[i],
            inertia_kg_m2: list("I")[i],
            joint_offset_rad: list("th0_deg")[i].to_radians(),
            ..Link::default()
        })
        .collect();
    Model::new(base, &links, [0.0; 2]).unwrap()
}

/// Largest difference relative to the largest expected magnitude (at least 1e-3, so that zeros compare absolutely).
pub(crate) fn relative_error(actual: impl IntoIterator<Item = f64>, expected: &Value) -> f64 {
    let expected = numbers(expected);
    let actual: Vec<f64> = actual.into_iter().collect();
    assert_eq!(actual.len(), expected.len(), "shapes differ");
    let scale = expected.iter().fold(1e-3_f64, |scale, x| scale.max(x.abs()));
    actual.iter().zip(&expected).map(|(a, e)| (a - e).abs() / scale).fold(0.0, f64::max)
}
