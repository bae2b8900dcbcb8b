//! What the rows depend on, linearized about a plant.

use super::linearize;
use super::mechanics::Mechanics;
use super::noise::NoiseModel;
use super::path::MeasuredPath;
use super::rows::Row;
use fss_plant::Plant;

/// The noise's model, and what a prediction along the path lacks.
pub(super) struct Linearization {
    pub(super) model: NoiseModel,
    /// What the rows read at their times along the path.
    pub(super) readings: Vec<f64>,
    /// Mean over a row's samples less the reading at its time, less what the path is beside the reference.
    pub(super) shift: Vec<f64>,
}

impl Linearization {
    /// About the plant of `mechanics`. `model` is that of the rows but for their slopes; the torque scale is in N m. `None` where
    /// something is not finite.
    pub(super) fn new(
        plant: &Plant,
        mechanics: &Mechanics,
        (path, rows, scale): (&MeasuredPath, &[Row], &[f64]),
        model: &NoiseModel,
    ) -> Option<Self> {
        let readings = linearize::predict(mechanics, path, rows, &linearize::loaded(mechanics, path, rows));
        let averaging = linearize::averaging(mechanics, path, rows, &readings);
        if readings.iter().chain(&averaging).any(|v| !v.is_finite()) {
            return None;
        }
        let mut slopes = linearize::slopes(plant, mechanics, path, rows, scale);
        linearize::timing(mechanics, path, rows, &mut slopes);
        let model = NoiseModel { slopes, ..model.clone() };
        let beside = model.read_motion(rows, |joint, stamp_s| path.deviation(joint, stamp_s));
        let shift = averaging.iter().zip(&beside).map(|(a, b)| a - b).collect();
        Some(Self { model, readings, shift })
    }
}
