//! A torque sensor stands between the current and the motion. Its own fault shows on both sides alike.
//!
//! Each side is known only so well, and an uncertain quantity regressed on always looks too small: a healthy sensor of small
//! torques would seem to have a wrong scale on one side or the other. So both have to say the same.

use super::{Contest, Refined};
use crate::normal::Normal;
use nalgebra::{DMatrix, DVector};

/// The sides agree if what they say of the scale differs by less than this share of the fault.
const AGREEMENT: f64 = 0.5;

impl Contest {
    /// Whether both sides of the sensor show its fault; true of every other cause.
    pub(super) fn sides_agree(&self, refined: &Refined, which: usize) -> bool {
        let effect = &refined.effects[which];
        let (Some(joint), true) = (effect.index(), effect.id() == "torque_sensor") else { return true };
        let first = refined.columns_of(which).start;
        let left = self.unexplained(&refined.residuals, &refined.nuisance);
        let fault = [effect.values()[0], effect.values()[1] - 1.0];
        // In the units of what each does to the sensor at a typical torque of a tenth of a newton metre.
        let main = usize::from(fault[1].abs() * 0.1 > fault[0].abs());
        let seen_by = |side: &str| -> Option<f64> {
            let name = format!("{side}{joint}");
            let mut normal = Normal::zero(2);
            for (i, cell) in self.evidence.cells.iter().enumerate() {
                let record = &self.evidence.records[cell.record];
                for (row, white) in record.spans()[cell.window].whitening.iter().enumerate() {
                    if record.channels()[white.channel] == name {
                        let j = [refined.columns[first][i][row], refined.columns[first + 1][i][row]];
                        normal.g += DMatrix::from_fn(2, 2, |a, b| j[a] * j[b]);
                        normal.b += DVector::from_fn(2, |a, _| j[a] * left[i][row]);
                    }
                }
            }
            (normal.g[(main, main)] > 0.0).then(|| fault[main] + normal.fit(&[0, 1]).value[main])
        };
        let (Some(motion), Some(current)) = (seen_by("torque"), seen_by("current")) else { return false };
        (motion - current).abs() < AGREEMENT * fault[main].abs()
    }
}
