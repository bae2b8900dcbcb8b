//! What the rows depend on, linearized about a plant.

use super::arrivals::{self, Arrivals};
use super::linearize;
use super::mechanics::Mechanics;
use super::noise::NoiseModel;
use super::path::{MeasuredPath, Reference};
use super::rows::Row;
use super::servos;
use crate::servo_response::GainSlope;
use fss_experiments::commands::Commands;
use fss_plant::Plant;

/// The noise's model, and what a prediction along the path lacks.
pub(super) struct Linearization {
    pub(super) model: NoiseModel,
    /// Mean over a row's samples less the reading at its time, less what the path is beside the reference.
    pub(super) shift: Vec<f64>,
    /// What other gains of the servos change.
    pub(super) by_gain: Vec<GainSlope>,
}

impl Linearization {
    /// About the plant of `mechanics`, whose servos make `reference` of their commands. `model` is that of the rows but for their
    /// slopes; the torque scale is in N m. `None` where something is not finite.
    pub(super) fn new(
        plant: &Plant,
        mechanics: &Mechanics,
        (path, rows, scale): (&MeasuredPath, &[Row], &[f64]),
        model: &NoiseModel,
        (reference, commands): (Option<&Reference>, Option<&Commands>),
    ) -> Option<Self> {
        let readings = linearize::predict(mechanics, path, rows);
        let averaging = linearize::averaging(mechanics, path, rows, &readings);
        if readings.iter().chain(&averaging).any(|v| !v.is_finite()) {
            return None;
        }
        let mut slopes = linearize::slopes(plant, mechanics, path, rows, scale);
        linearize::timing(mechanics, path, rows, &mut slopes);
        if let Some(reference) = reference.filter(|_| commands.is_some()) {
            arrivals::add_timing(reference, rows, &mut slopes);
        }
        let mut model = NoiseModel { slopes, ..model.clone() };
        model.arrivals = commands.and_then(|c| Arrivals::new(plant, mechanics, c, rows));
        let beside = model.read_motion(rows, |joint, stamp_s| path.deviation(joint, stamp_s, reference));
        let shift = averaging.iter().zip(&beside).map(|(a, b)| a - b).collect();
        let by_gain = servos::gain_slopes(reference.map_or(&[], |r| &r.changes), path, rows, &model);
        Some(Self { model, shift, by_gain })
    }
}
