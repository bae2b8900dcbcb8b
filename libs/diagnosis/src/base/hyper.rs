//! Strengths of what disturbs the base and of its sensors' noise, by name, with their priors.

use crate::block::{HyperParameter, Strength};
use fss_plant::Plant;

/// Correlation times of a disturbance that make sense: shorter is white, longer is steady (s).
const CORRELATION_S: [f64; 2] = [0.1, 10.0];
/// Errors of a thruster from pulse to pulse, as a share of its thrust: what valves and propellers of a good laboratory have.
pub(super) const THRUST_ERROR_SHARE: f64 = 0.02;
pub(super) const THRUST_ERROR: &str = "error of each thruster, share of its thrust";
/// A pulse's length (s): so long one error lasts, but for a factor of two or so.
const PULSE_S: f64 = 0.1;

/// The hyper-parameters by name.
pub(super) struct Hyper {
    pub(super) force: f64,
    pub(super) torque: f64,
    pub(super) correlation: f64,
    pub(super) white_force: f64,
    pub(super) white_torque: f64,
    pub(super) noise_position: f64,
    pub(super) noise_angle: f64,
    pub(super) noise_gyro: f64,
    pub(super) arm: f64,
    pub(super) thrust: f64,
    pub(super) thrust_correlation: f64,
}

impl Hyper {
    pub(super) fn of(values: &[f64]) -> Self {
        Self {
            force: values[0],
            torque: values[1],
            correlation: values[2],
            white_force: values[3],
            white_torque: values[4],
            noise_position: values[5],
            noise_angle: values[6],
            noise_gyro: values[7],
            arm: values[8],
            thrust: values[9],
            thrust_correlation: values[10],
        }
    }
}

/// Priors. A room's stated air is believed within a factor of two or so; without a statement, nothing is known but the order of
/// magnitude: a ten-thousandth of the vehicle's weight per unit of acceleration. Servos that give way under thrust turn the base
/// whatever the air does: with an arm, white torque is as without a statement, over the inertia of the whole. Stated noise is
/// right within 15 %.
pub(super) fn hyper_parameters(plant: &Plant, whole_kg_m2: f64) -> Vec<HyperParameter> {
    let (mass, inertia) = (plant.total_mass_kg(), plant.base.inertia_kg_m2);
    let air = plant.disturbance.as_ref();
    let strength = |name, stated: Option<f64>, natural: f64, log_sd: [f64; 2], of| HyperParameter {
        name,
        median: stated.filter(|s| *s > 0.0).unwrap_or(natural),
        log_sd: if stated.is_some_and(|s| s > 0.0) { log_sd[0] } else { log_sd[1] },
        bounds: [1e-8 * natural, 1e6 * natural],
        strength_of: Some(of),
    };
    let plain = |name, median, log_sd, bounds| HyperParameter { name, median, log_sd, bounds, strength_of: None };
    let (force, torque) = (1e-4 * mass, 5e-4 * inertia);
    let servos = if plant.link_count() > 0 { 5e-4 * whole_kg_m2 } else { 0.0 };
    let white_torque = air.map(|a| servos.hypot(0.1 * a.torque_std_n_m));
    vec![
        strength("coloured force (N)", air.map(|a| a.force_std_n), force, [0.8, 3.0], Strength::Force),
        strength("coloured torque (N m)", air.map(|a| a.torque_std_n_m), torque, [0.8, 3.0], Strength::Torque),
        plain(
            "correlation time (s)",
            air.map_or(1.5, |a| a.correlation_s).clamp(CORRELATION_S[0], CORRELATION_S[1]),
            if air.is_some() { 0.4 } else { 0.8 },
            CORRELATION_S,
        ),
        strength("white force (N s^0.5)", air.map(|a| 0.1 * a.force_std_n), force, [2.5, 3.0], Strength::Force),
        strength("white torque (N m s^0.5)", white_torque, torque, [2.5, 3.0], Strength::Torque),
        plain("pose noise over stated, place", 1.0, 0.15, [0.3, 3.0]),
        plain("pose noise over stated, heading", 1.0, 0.15, [0.3, 3.0]),
        plain("gyro noise over stated", 1.0, 0.15, [0.3, 3.0]),
        plain("error of the joints' path over its smoother's", 1.0, 0.7, [0.01, 100.0]),
        HyperParameter {
            name: THRUST_ERROR,
            median: THRUST_ERROR_SHARE,
            log_sd: 2.5,
            bounds: [1e-4 * THRUST_ERROR_SHARE, 1.0],
            strength_of: Some(Strength::Force),
        },
        plain("correlation of a thruster's errors (s)", PULSE_S, 0.8, [0.01, 10.0]),
    ]
}

/// Roots of the spectral densities at low frequency of force and torque, coloured and white together, and the thrusters' errors:
/// each as inferred and as expected.
pub(super) fn discrepancies(parameters: &[HyperParameter], hyper: &[f64]) -> Vec<(String, f64, f64)> {
    let expected: Vec<f64> = parameters.iter().map(|h| h.median).collect();
    let density =
        |h: &Hyper, strength: f64, white: f64| (2.0 * strength.powi(2) * h.correlation + white.powi(2)).sqrt();
    let both = |pick: fn(&Hyper) -> (f64, f64)| {
        let of = |values: &[f64]| {
            let h = Hyper::of(values);
            let (strength, white) = pick(&h);
            density(&h, strength, white)
        };
        (of(hyper), of(&expected))
    };
    let (force, torque) = (both(|h| (h.force, h.white_force)), both(|h| (h.torque, h.white_torque)));
    vec![
        ("force on the base (N s^0.5)".to_owned(), force.0, force.1),
        ("torque on the base (N m s^0.5)".to_owned(), torque.0, torque.1),
        (THRUST_ERROR.to_owned(), Hyper::of(hyper).thrust, THRUST_ERROR_SHARE),
    ]
}
