//! Drives so soft that their links swing: at which stiffness each would explain a shaken base best.
//!
//! How a link swings has a time of its own, and nothing of it is a matter of proportion: from a stiffness a quarter off no
//! slope leads to the right one. So each drive is tried at many, on the run that is shaken most.

use super::Contest;
use super::refine::Point;
use crate::evidence::Cell;
use crate::floating::Record;
use crate::floating::swing::{STIFF_N_M_RAD, around, at_place};
use crate::hypothesis::{Hypothesis, swinging};
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::Effect;
use nalgebra::DVector;
use rayon::prelude::*;

/// Of the stiffnesses at which drives are simulated, the places of the softest and the stiffest that are tried, and how far apart
/// they lie: 22 to 990 N m/rad, each 1.22 times the one before.
const SOFTEST: i32 = -22;
const STIFFEST: i32 = 16;
const APART: usize = 2;
/// Steps that a drive walks at most.
const STEPS: usize = 12;

impl Contest {
    /// For each drive, the stiffness at which it would explain best what the record shows; none where no log tells what
    /// drivers were told.
    pub(super) fn swinging(&self, runs: &[Run], record: usize) -> Result<Vec<Hypothesis>, ModelError> {
        let drives = swinging(&self.trial.plant, runs);
        let cells: Vec<Cell> = self.evidence.cells.iter().filter(|c| c.record == record).cloned().collect();
        let left = |drive: &Hypothesis, place: i32| -> Result<(f64, i32), ModelError> {
            let soft = drive.with(&[at_place(f64::from(place))]);
            let mut fresh = self.evidence.residuals(&self.trial.with(&soft), &cells)?.into_iter();
            let after =
                |c: &Cell| if c.record == record { fresh.next() } else { None }.unwrap_or_else(|| c.residual.clone());
            let residuals: Vec<DVector<f64>> = self.evidence.cells.iter().map(after).collect();
            // What uncertain masses do is more than any swing.
            Ok((self.reduce(&residuals, &[]).normal.c, place))
        };
        let best = |drive: &Hypothesis| -> Result<Option<Hypothesis>, ModelError> {
            let tried: Vec<i32> = (SOFTEST..=STIFFEST).step_by(APART).collect();
            let mut all = tried.into_par_iter().map(|place| left(drive, place)).collect::<Result<Vec<_>, _>>()?;
            let Some((_, coarse)) = all.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(None) };
            for place in [coarse - 1, coarse + 1] {
                all.push(left(drive, place)?);
            }
            let least = all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
            Ok(least.map(|(_, place)| drive.probed_at(&[at_place(f64::from(place))])))
        };
        let all: Result<Vec<_>, ModelError> = drives.iter().map(best).collect();
        Ok(all?.into_iter().flatten().collect())
    }

    /// Whether an effect is a drive so soft that it is simulated.
    pub(super) fn is_simulated(&self, hypothesis: usize, effect: &Effect) -> bool {
        let is_soft = self.hypotheses[hypothesis].is_compliance() && effect.values()[0] < STIFF_N_M_RAD;
        is_soft && self.tells_commands()
    }

    /// Whether a log tells what drivers were told, so that drives can be simulated.
    pub(super) fn tells_commands(&self) -> bool {
        self.evidence.records.iter().any(Record::tells_commands)
    }

    /// Whether an effect is a drive on which a link swings, and it is simulated so.
    pub(super) fn swings(&self, hypothesis: usize, effect: &Effect) -> bool {
        self.is_simulated(hypothesis, effect) && self.hypotheses.iter().any(Hypothesis::is_swing)
    }

    /// Drives whose links swing, of the causes from `first` on, moved to the best of the stiffnesses nearby at which they are
    /// simulated.
    pub(super) fn walk(&self, hypotheses: &[usize], start: Point, first: usize) -> Result<Point, ModelError> {
        let mut now = start;
        for which in first..hypotheses.len() {
            if !self.swings(hypotheses[which], &now.effects[which]) {
                continue;
            }
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
