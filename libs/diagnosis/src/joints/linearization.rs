//! What the rows depend on, linearized about a plant.

use super::arrivals::{self, Arrivals};
use super::linearize;
use super::mechanics::Mechanics;
use super::noise::NoiseModel;
use super::path::{MeasuredPath, Reference};
use super::rows::{Kind, Row, moments};
use crate::servo_response::ClosedLoop;
use fss_experiments::commands::Commands;
use fss_plant::Plant;

/// The noise's model, and what a prediction along the path lacks.
pub(super) struct Linearization {
    pub(super) model: NoiseModel,
    /// Mean over a row's samples less the reading at its time, less what the path is beside the reference.
    pub(super) shift: Vec<f64>,
    /// The drives that make the reference, where datagrams command them.
    pub(super) drives: Option<(ClosedLoop, Reference)>,
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
        let own = reference.filter(|r| r.response.is_some());
        let drives = own.and_then(|r| Some((mechanics.closed_loop()?, r.clone())));
        Some(Self { model, shift, drives })
    }

    /// What the rows change by where the servos of other mechanics make another motion of their datagrams; `None` where they do not.
    pub(super) fn answer(&self, mechanics: &Mechanics, path: &MeasuredPath, rows: &[Row]) -> Option<Vec<f64>> {
        let (own, reference) = self.drives.as_ref()?;
        if own.is_of(mechanics.physics(0.0)) {
            return None;
        }
        let other = mechanics.closed_loop()?;
        let change = own.change(&other, reference.response.as_ref()?, path.step_s())?;
        let beside = |joint: usize, stamp_s: f64| path.between(&change[joint], stamp_s);
        let mut out = self.model.read_motion(rows, beside);
        for moment in moments(rows) {
            let t_s = rows[moment.start].t_s;
            let torques = other.torques(path.node(t_s), path.step_s(), |joint| beside(joint, t_s));
            for k in moment {
                match rows[k].kind {
                    Kind::Torque(i) => out[k] = torques[i][0],
                    Kind::Current(i) => out[k] = torques[i][1] / mechanics.physics(t_s).joints[i].torque_constant_n_m_a,
                    _ => {}
                }
            }
        }
        Some(out)
    }
}
