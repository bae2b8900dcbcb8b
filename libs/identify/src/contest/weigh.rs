//! How sure the data are of what was taken: standard deviations, probabilities among rivals, and what left-out runs keep.

use super::rules::{LATENCY_BESIDE_COMMANDS_S, unit};
use super::select::{Alternative, Taken};
use super::{Contest, Refined};
use crate::normal::Normal;
use crate::tolerance::unsaid;
use nalgebra::DVector;
use std::collections::BTreeSet;

/// Correlation of residuals that no model has: differences of sums of squares count for so many times less.
const TEMPER: f64 = 4.0;
/// Nobody is surer than this.
const SUREST: f64 = 0.99;
/// Standard deviations away from nothing at which a cause is there or not with even chances, and over which doubt falls to
/// a third: residuals of a wrong model are alike over longer times than a window, so that deviations are stated too small.
const EVEN_CHANCE: f64 = 3.0;
const DOUBT_FALLS: f64 = 2.5;
/// How many times further off than their rows say parameters are, since the model is never the laboratory: this engine has no
/// discrepancy that would say so.
const OFF_BY: f64 = 1.3;
/// What a stroke of play does hangs on how its link comes back from the teeth, which nothing tells, and strokes that are looked
/// for at a wrong time seem small. Play is known to this share at best.
const STROKE_SHARE: f64 = 0.2;
/// How a link swings hangs on its servo too, whose gains are taken as exact. Stiffness is known to this share at best.
const SWING_SHARE: f64 = 0.03;

impl Contest {
    /// Each taken cause with its standard deviations, its rivals and its probability among them.
    pub(super) fn weigh(&self, after: &Refined, without: &[Refined], rivals: &[Vec<Refined>]) -> Vec<Taken> {
        let spread = self.spread(after);
        let clearness = self.clearness(after);
        let mut taken = Vec::new();
        for (i, (h, effect)) in after.hypotheses.iter().zip(&after.effects).enumerate() {
            let mut std: Vec<f64> = after.columns_of(i).map(|k| OFF_BY * spread[k]).collect();
            if self.hypotheses[*h].is_compliance() {
                // Fitted by its inverse.
                std[0] *= effect.values()[0].powi(2);
                if self.swings(*h, effect) {
                    std[0] = std[0].hypot(SWING_SHARE * effect.values()[0]);
                }
            }
            if effect.id() == "joint_backlash" {
                std[0] = std[0].hypot(STROKE_SHARE * effect.values()[0]);
            }
            let is_timed_by_arm = matches!(effect.id(), "link_latency" | "mocap_latency" | "clock_offset");
            if is_timed_by_arm && self.tells_commands() {
                std[0] = std[0].hypot(LATENCY_BESIDE_COMMANDS_S);
            }
            let scale = 2.0 * TEMPER * unit(after).max(1.0);
            let weight = |r: &Refined| (-(Self::cost(r) - Self::cost(after)) / scale).exp();
            // At another shape it is the same cause, and as much more probable.
            let own = &self.hypotheses[*h];
            let is_own = |r: &Refined| {
                let other = &self.hypotheses[r.hypotheses[i]];
                own.is_same_cause(other) || (own.has_shape && own.is_of(&other.nominal))
            };
            let at_other_shapes = rivals[i].iter().filter(|r| is_own(r) && r.hypotheses[i] != *h);
            let here = 1.0 + at_other_shapes.map(weight).sum::<f64>();
            let others: Vec<&Refined> = rivals[i].iter().filter(|r| !is_own(r)).collect();
            let total = here + others.iter().copied().map(weight).sum::<f64>();
            let mut alternatives: Vec<Alternative> = others
                .iter()
                .map(|r| Alternative { effect: r.effects[i].clone(), probability: weight(r) / total })
                .collect();
            alternatives.sort_by(|a, b| b.probability.total_cmp(&a.probability));
            alternatives.retain(|a| a.probability > 1e-3);
            alternatives.truncate(6);
            taken.push(Taken {
                effect: effect.clone(),
                std,
                probability: (is_there(clearness[i]) * here / total).min(SUREST),
                gain: (without[i].chi2 - after.chi2) / unit(after),
                alternatives,
            });
        }
        taken.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        taken
    }

    /// How many of its standard deviations each cause is away from nothing, in its clearest parameter. What goes without saying
    /// is among these deviations already where it is there from the start; of what begins later it need not be the same before.
    pub(super) fn clearness(&self, after: &Refined) -> Vec<f64> {
        let spread = self.spread(after);
        let of = |which: usize| {
            let (hypothesis, effect) = (&self.hypotheses[after.hypotheses[which]], &after.effects[which]);
            let own = after.columns_of(which);
            if own.is_empty() {
                return f64::INFINITY;
            }
            let (values, nominal) = (effect.values(), hypothesis.nominal.values());
            // The first parameter of an effect with a shape is its strength; the others are sizes themselves.
            let counted = if hypothesis.has_shape { 1 } else { own.len() };
            let unsaid = effect.onset_s().and_then(|_| unsaid(hypothesis, &self.trial.plant)).unwrap_or_default();
            let away = |k: usize| {
                let off = if hypothesis.is_compliance() { 1.0 / values[k] } else { values[k] - nominal[k] };
                let sd = spread[own.start + k].hypot(unsaid.get(k).copied().unwrap_or(0.0));
                off.abs() / sd.max(1e-300)
            };
            (0..counted).map(away).fold(0.0, f64::max)
        };
        (0..after.hypotheses.len()).map(of).collect()
    }

    /// Standard deviations of all parameters: the larger of what white rows and of what the scatter of the cells' own
    /// gradients gives (clustered by window, since residuals are correlated within one).
    pub(super) fn spread(&self, after: &Refined) -> Vec<f64> {
        let p = after.columns.len();
        let left = self.unexplained(&after.residuals, &after.nuisance);
        let mut scatter = nalgebra::DMatrix::<f64>::zeros(p, p);
        for (i, residual) in left.iter().enumerate() {
            let gradient = DVector::from_fn(p, |k, _| after.clear[k][i].dot(residual));
            scatter += &gradient * gradient.transpose();
        }
        let clustered = &after.covariance * scatter * &after.covariance;
        let floor = unit(after);
        (0..p).map(|k| (after.covariance[(k, k)] * floor).max(clustered[(k, k)]).max(0.0).sqrt()).collect()
    }

    /// Share of the gain of cause `which` that runs keep which were left out of the fit of its parameters. Where one run alone
    /// shows it, its windows by turns. What it gains by putting uncertain values back to where the plant file has them belongs
    /// to each window alike: no run can tell a weak thruster from an uncertain thrust, only how far that was thought to be off.
    pub(super) fn kept(&self, refined: &Refined, which: usize) -> f64 {
        let own: Vec<usize> = refined.columns_of(which).collect();
        if own.is_empty() {
            return 1.0; // nothing of it is fitted
        }
        let left = self.unexplained(&refined.residuals, &refined.nuisance);
        let (taken, off_file) = (refined.by_column.select_columns(&own), &refined.nuisance);
        let share = self.unit / left.len().max(1) as f64;
        let (prior_g, prior_b) = (share * taken.tr_mul(&taken), share * taken.tr_mul(off_file));
        let normals: Vec<Normal> = (0..left.len())
            .map(|i| Normal {
                g: nalgebra::DMatrix::from_fn(own.len(), own.len(), |a, b| {
                    refined.clear[own[a]][i].dot(&refined.clear[own[b]][i]) + prior_g[(a, b)]
                }),
                b: DVector::from_fn(own.len(), |a, _| refined.clear[own[a]][i].dot(&left[i]) + prior_b[a]),
                c: 0.0,
                freedom: 0.0,
            })
            .collect();
        let strength = |n: &Normal| n.g.trace();
        let runs = self.evidence.records.len();
        let of_run = |r: usize| -> f64 {
            normals.iter().zip(&self.evidence.cells).filter(|(_, c)| c.record == r).map(|(n, _)| strength(n)).sum()
        };
        let total: f64 = normals.iter().map(strength).sum();
        let by_run = (0..runs).filter(|r| of_run(*r) > 0.1 * total).count() >= 2;
        let fold = |i: usize| if by_run { self.evidence.cells[i].record } else { i % 4 };
        let folds: BTreeSet<usize> = (0..normals.len()).map(fold).collect();
        let hypothesis = &self.hypotheses[refined.hypotheses[which]];
        let nominal = hypothesis.nominal.values();
        // From the solution back to nominal, along the columns.
        let away = DVector::from_fn(own.len(), |k, _| nominal[k] - refined.effects[which].values()[k]);
        let (mut kept, mut whole) = (0.0, 0.0);
        for f in folds {
            let rest =
                Normal::sum(own.len(), normals.iter().enumerate().filter(|(i, _)| fold(*i) != f).map(|(_, n)| n));
            let out = Normal::sum(own.len(), normals.iter().enumerate().filter(|(i, _)| fold(*i) == f).map(|(_, n)| n));
            let columns: Vec<usize> = (0..own.len()).collect();
            let value = rest.fit(&columns).value;
            let nothing = out.change(&columns, &away);
            kept += nothing - out.change(&columns, &value);
            whole += nothing;
        }
        if whole > 0.0 { kept / whole } else { 0.0 }
    }
}

/// Probability that something is there which stands so many standard deviations away from nothing.
fn is_there(clearness: f64) -> f64 {
    1.0 - 0.5 * (-(clearness - EVEN_CHANCE) / DOUBT_FALLS).exp().min(2.0)
}
