//! Torques in the joints at the moments of the rows, beside those along the path.
//!
//! After each datagram servos settle: what a joint carries when it is read hangs on an acceleration that telemetry does not
//! resolve. A motor's constant and a torque sensor's scale act on all of it, not only on what the path tells. Where torque sensor and
//! current both show it, its posterior mean is part of what everything is linearized about. With another plant it would be another
//! one: of what its readings change only that part counts which no torque makes.

use super::hyper::Hyper;
use super::linearization::Linearization;
use super::linearize::reading_of_one;
use super::mechanics::Mechanics;
use super::rows::{Kind, Row, moments};

/// What torque sensor and current of a joint show together at a moment.
#[derive(Clone, Debug)]
pub(super) struct Instant {
    /// Rows of torque sensor and current.
    rows: [usize; 2],
    /// What they read more of a torque by 1 N m.
    unit: [f64; 2],
    /// Precisions of what they read beside that torque.
    precision: [f64; 2],
    /// Posterior mean of the torque beside the one along the path, N m.
    torque_n_m: f64,
}

/// What the rows show under the plant of `mechanics`, about which everything is linearized. The mean is independent of what tells a
/// constant, the difference between the two rows, where the hyper-parameters are those that the runs have.
pub(super) fn instants(
    mechanics: &Mechanics,
    rows: &[Row],
    about: &Linearization,
    noise: (&Hyper, &[f64]),
) -> Vec<Instant> {
    let (model, places) = (&about.model, about.model.places());
    let mut out = Vec::new();
    for (moment, own) in moments(rows).into_iter().enumerate() {
        for joint in 0..model.links {
            let row = |kind: Kind| own.clone().find(|k| rows[*k].kind == kind);
            let (Some(sensed), Some(driven)) = (row(Kind::Torque(joint)), row(Kind::Current(joint))) else { continue };
            let both = [sensed, driven];
            let unit = both.map(|k| reading_of_one(mechanics, rows[k].t_s, rows[k].kind));
            let variances = both.map(|k| model.variances_of_drive((&rows[k], k), moment, noise, &places));
            let precision = variances.map(|[_, own]| own.recip());
            let sum = |of: &dyn Fn(usize) -> f64| (0..2).map(|i| precision[i] * unit[i] * of(i)).sum::<f64>();
            let prior = unit[0] * unit[0] / variances[0][0];
            let torque_n_m = sum(&|i| rows[both[i]].value - about.readings[both[i]]) / (prior + sum(&|i| unit[i]));
            if torque_n_m.is_finite() {
                out.push(Instant { rows: both, unit, precision, torque_n_m });
            }
        }
    }
    out
}

impl Instant {
    /// Adds what rows read of the torque under the plant of `mechanics` but for what a torque makes of them under the plant that
    /// everything is linearized about.
    pub(super) fn add(&self, mechanics: &Mechanics, rows: &[Row], readings: &mut [f64]) {
        let unit = self.rows.map(|k| reading_of_one(mechanics, rows[k].t_s, rows[k].kind));
        let product = |a: &[f64; 2]| (0..2).map(|i| self.precision[i] * self.unit[i] * a[i]).sum::<f64>();
        let share = product(&unit) / product(&self.unit);
        for i in 0..2 {
            readings[self.rows[i]] += self.torque_n_m * (unit[i] - share * self.unit[i]);
        }
    }
}
