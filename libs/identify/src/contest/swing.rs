//! Drives so soft that their links swing: at which stiffness each would explain a shaken base best.
//!
//! How a link swings has a time of its own, and nothing of it is a matter of proportion: from a stiffness a quarter off no
//! slope leads to the right one. So each drive is tried at many, on the run that is shaken most.

use super::Contest;
use super::refine::Point;
use crate::evidence::Cell;
use crate::floating::swing::around;
use crate::hypothesis::{Hypothesis, swinging};
use crate::measured::Run;
use fss_multibody::ModelError;
use nalgebra::DVector;
use rayon::prelude::*;

/// Stiffnesses at which every drive is tried, N m/rad: so many, from the softest on, each so many times the one before. These are
/// stiffnesses at which drives are simulated.
const SOFTEST_N_M_RAD: f64 = 200.0 / 9.0;
const TRIED: usize = 20;
const TIMES: f64 = 1.221_063_945_4; // 3^(2/11)
/// Steps that a drive walks at most.
const STEPS: usize = 12;

impl Contest {
    /// For each drive, the stiffness at which it would explain best what the record shows; none where no log tells what
    /// drivers were told.
    pub(super) fn swinging(&self, runs: &[Run], record: usize) -> Result<Vec<Hypothesis>, ModelError> {
        let drives = swinging(&self.trial.plant, runs);
        let cells: Vec<Cell> = self.evidence.cells.iter().filter(|c| c.record == record).cloned().collect();
        let left = |drive: &Hypothesis, stiffness: f64| -> Result<(f64, Hypothesis), ModelError> {
            let drive = drive.probed_at(&[stiffness]);
            let mut fresh = self.evidence.residuals(&self.trial.with(&drive.probe), &cells)?.into_iter();
            let after =
                |c: &Cell| if c.record == record { fresh.next() } else { None }.unwrap_or_else(|| c.residual.clone());
            let residuals: Vec<DVector<f64>> = self.evidence.cells.iter().map(after).collect();
            // What uncertain masses do is more than any swing.
            Ok((self.reduce(&residuals, &[]).normal.c, drive))
        };
        let least = |all: Vec<(f64, Hypothesis)>| all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let best = |drive: &Hypothesis| -> Result<Option<Hypothesis>, ModelError> {
            let steps = (0..TRIED).into_par_iter();
            let coarse = steps.map(|k| left(drive, SOFTEST_N_M_RAD * TIMES.powi(k as i32)));
            let Some(best) = least(coarse.collect::<Result<_, _>>()?) else { return Ok(None) };
            let near = [1.0 / TIMES.sqrt(), TIMES.sqrt()].map(|by| best.1.probe.values()[0] * by);
            let mut all = near.into_par_iter().map(|k| left(drive, k)).collect::<Result<Vec<_>, _>>()?;
            all.push(best);
            Ok(least(all).map(|(_, drive)| drive))
        };
        let all: Result<Vec<_>, ModelError> = drives.iter().map(best).collect();
        Ok(all?.into_iter().flatten().collect())
    }

    /// Drives whose links swing, moved to the best of the stiffnesses nearby at which they are simulated.
    pub(super) fn walk(&self, hypotheses: &[usize], start: Point) -> Result<Point, ModelError> {
        let mut now = start;
        let swings = (0..hypotheses.len()).filter(|i| self.hypotheses[hypotheses[*i]].is_swing());
        for which in swings {
            let mut least = self.reduce(&now.residuals, &[]).normal.c;
            for _ in 0..STEPS {
                let there = |stiffness: f64| -> Result<(f64, Point), ModelError> {
                    let mut effects = now.effects.clone();
                    effects[which] = effects[which].clone().with(&[stiffness]);
                    let point = self.point(&effects)?;
                    Ok((self.reduce(&point.residuals, &[]).normal.c, point))
                };
                let near = around(now.effects[which].values()[0]).into_iter().map(there);
                let near = near.collect::<Result<Vec<_>, _>>()?;
                let Some((cost, best)) = near.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
                if cost >= least {
                    break;
                }
                (least, now) = (cost, best);
            }
        }
        Ok(now)
    }
}
