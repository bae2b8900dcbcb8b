//! Empirical terms for what no known effect explains: laws that name no cause, and act only where the fitted runs were.

use crate::contest::{Contest, Refined};
use crate::prediction::{Data, overall};
use crate::sensitivity::Column;
use fss_experiments::measured::{Poses, Run};
use fss_multibody::ModelError;
use fss_plant::{Effect, EffectError, Plant};
use nalgebra::DVector;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, TAU};

/// The id of a law that is none of the catalogue's.
pub(crate) const UNMODELLED: &str = "unmodelled";
/// Strength at which a law's column is taken: little enough to be in proportion, N, N m, N s/m.
const PROBE: f64 = 1e-3;
/// A period is sharper than the grid: it is narrowed down to this share of a turn between the ends of what the runs cover.
const SHARP: f64 = 0.05;
/// Share of a turn over which a frequency's column is differenced.
const FREQUENCY_STEP: f64 = 2e-3;
/// A term wins where it leaves less than this share of the mean square of runs that it was not fitted to.
const WINS: f64 = 0.75;
/// What a plant file says of its laws.
const EMPIRICAL: &str = "empirical: no known cause; it acts only where the fitted runs were";
/// A law whose strength is known to fewer deviations is left out.
const CLEAR: f64 = 2.0;
/// Samples either side between which a base's velocity is differenced.
const EITHER_SIDE: usize = 25;

/// A term, with the nuisances that go with it.
#[derive(Clone, Debug)]
pub(crate) struct Term {
    pub(crate) effects: Vec<Effect>,
    pub(crate) nuisance: DVector<f64>,
    /// By how much the sum of squares falls.
    pub(crate) gain: f64,
    /// Laws at their phases, and the strength of each: together the effects.
    probes: Vec<Effect>,
    strengths: DVector<f64>,
}

impl Term {
    fn new(probes: Vec<Effect>, strengths: DVector<f64>, nuisance: DVector<f64>, gain: f64) -> Self {
        Self { effects: laws_of(&probes, &strengths), nuisance, gain, probes, strengths }
    }

    /// The same fitted again around itself, its frequency too: what moves a vehicle far is in no proportion to its strength.
    fn sharper(&self, contest: &mut Contest, beside: &[Effect]) -> Result<Self, ModelError> {
        let Some(&[_, frequency, _, _, from, to]) = self.probes.first().map(Effect::values) else {
            return Ok(self.clone());
        };
        let all = [beside, &self.effects].concat();
        contest.centre(&all, &[])?;
        let residuals = contest.evidence.residuals(&contest.trial_with(&all), &contest.evidence.cells)?;
        let mut columns = columns(contest, &all, &residuals, &self.probes)?;
        let step = FREQUENCY_STEP / f64::max(to - from, 1e-9);
        let faster = |law: &Effect| law.clone().with(&[law.values()[0], frequency + step]);
        if frequency > 0.0 {
            let all: Vec<Effect> = beside.iter().cloned().chain(self.effects.iter().map(faster)).collect();
            let after = contest.evidence.residuals(&contest.trial_with(&all), &contest.evidence.cells)?;
            columns.push(residuals.iter().zip(after).map(|(before, after)| (before - after) / step).collect());
        }
        let reduced = contest.reduce(&residuals, &columns);
        let fit = reduced.normal.fit(&(0..columns.len()).collect::<Vec<_>>());
        let moved = fit.value.get(self.probes.len()).copied().unwrap_or(0.0);
        let at = |probe: &Effect| probe.clone().with(&[PROBE, frequency + moved]);
        let strengths = &self.strengths + fit.value.rows(0, self.probes.len());
        let nuisance = &reduced.nuisance - &reduced.by_column * &fit.value;
        Ok(Self::new(self.probes.iter().map(at).collect(), strengths, nuisance, self.gain))
    }
}

/// What a force on the base may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dependence {
    /// The clock, periodically.
    Time,
    /// The place on the table, periodically.
    Place,
    /// The heading, periodically.
    Heading,
    /// The velocity, in proportion.
    Velocity,
}

impl Dependence {
    pub(crate) const ALL: [Self; 4] = [Self::Time, Self::Place, Self::Heading, Self::Velocity];

    /// Frequencies tried first: 1/s, 1/m, 1/turn. A run covers a metre or a turn, but many periods of the clock.
    fn frequencies(self) -> Vec<f64> {
        let evenly = |each: f64| (1..=16).map(|k| f64::from(k) * each).collect();
        match self {
            Self::Time => (0..24).map(|k| 0.05 * 40.0_f64.powf(f64::from(k) / 23.0)).collect(),
            Self::Place => evenly(0.5),
            Self::Heading => evenly(0.7),
            Self::Velocity => vec![0.0],
        }
    }

    /// Channels, each with the direction of its force (rad). A wave of a table pushes along some axis, and goes along it.
    fn laws(self, axis_rad: f64) -> Vec<(&'static str, f64)> {
        match self {
            Self::Time => vec![("base_force", 0.0), ("base_force", FRAC_PI_2), ("base_torque", 0.0)],
            Self::Place => [axis_rad, axis_rad + FRAC_PI_2].map(|along| ("base_force_by_place", along)).to_vec(),
            Self::Heading => vec![("base_torque_by_heading", 0.0)],
            Self::Velocity => {
                vec![
                    ("base_force_by_velocity", 0.0),
                    ("base_force_by_velocity", FRAC_PI_2),
                    ("base_torque_by_rate", 0.0),
                ]
            }
        }
    }

    /// Between what these runs have it, along a direction.
    fn range(self, channel: &str, direction_rad: f64, runs: &[Run]) -> [f64; 2] {
        let (sin, cos) = direction_rad.sin_cos();
        let along = |[x, y, _]: [f64; 3]| cos * x + sin * y;
        let bases = || runs.iter().filter_map(|run| run.base_pose.as_ref());
        let poses = || bases().flat_map(|poses| poses.values.iter().copied());
        match self {
            Self::Time => bounds(bases().flat_map(|poses| poses.t_s.iter().copied())),
            Self::Place => bounds(poses().map(along)),
            Self::Heading => bounds(poses().map(|pose| pose[2] / TAU)),
            Self::Velocity => {
                let all = bases().flat_map(|poses| (0..poses.t_s.len()).map(|k| velocity(poses, k)));
                bounds(all.map(|v| if channel == "base_torque_by_rate" { v[2] } else { along(v) }))
            }
        }
    }

    /// Its laws, each at the phases that make up any.
    fn probes(self, axis_rad: f64, runs: &[Run]) -> Result<Vec<Effect>, EffectError> {
        let unknown = Effect::new(UNMODELLED)?;
        let mut probes = Vec::new();
        for (channel, direction_rad) in self.laws(axis_rad) {
            let [from, to] = self.range(channel, direction_rad, runs);
            let has_phase = channel != "base_torque_by_rate";
            for phase_rad in [0.0, FRAC_PI_2].into_iter().take(if has_phase { 2 } else { 1 }) {
                let law = unknown.clone().on(channel);
                probes.push(law.with(&[PROBE, 0.0, direction_rad, phase_rad, from, to]));
            }
        }
        Ok(probes)
    }

    /// The term of these laws that fits what is left best, and its frequency. What is left pushes most along the axis.
    pub(crate) fn term(
        self,
        contest: &Contest,
        left: &Refined,
        axis_rad: f64,
        runs: &[Run],
    ) -> Result<Option<(f64, Term)>, ModelError> {
        let Ok(probes) = self.probes(axis_rad, runs) else { return Ok(None) };
        let at = |frequency: f64| -> Result<(f64, Term), ModelError> {
            let there: Vec<Effect> = probes.iter().map(|probe| probe.clone().with(&[PROBE, frequency])).collect();
            Ok((frequency, fitted(contest, left, &there)?))
        };
        let best_of = |frequencies: &[f64]| -> Result<Option<(f64, Term)>, ModelError> {
            let tried: Result<Vec<_>, ModelError> = frequencies.par_iter().map(|f| at(*f)).collect();
            Ok(tried?.into_iter().max_by(|a, b| a.1.gain.total_cmp(&b.1.gain)))
        };
        let grid = self.frequencies();
        let Some(mut best) = best_of(&grid)? else { return Ok(None) };
        let next = grid.iter().find(|f| **f > best.0).or(grid.iter().rev().nth(1)).unwrap_or(&best.0);
        let mut reach = 0.5 * (next - best.0).abs();
        let covered = probes.iter().map(|probe| probe.values()[5] - probe.values()[4]).fold(0.0, f64::max);
        while reach * covered > SHARP {
            let nearby = best_of(&[best.0 - reach, best.0 + reach])?;
            best = nearby.filter(|nearby| nearby.1.gain > best.1.gain).unwrap_or(best);
            reach *= 0.5;
        }
        Ok(Some(best))
    }
}

/// The model with the term that predicts runs best that were kept out of the fit, if one wins there, and its laws. The terms were
/// fitted beside these effects.
pub(crate) fn winner(
    terms: &[Term],
    beside: &[Effect],
    contest: &mut Contest,
    extended: &Plant,
    data: &Data,
) -> Result<Option<(Plant, Vec<Effect>)>, ModelError> {
    if data.carried_out.validation.is_empty() {
        return Ok(None);
    }
    let left = |plant: &Plant| -> Result<f64, ModelError> { Ok(overall(&data.predicted(plant)?).powi(2)) };
    let with = |contest: &Contest, term: &Term| {
        let mut plant = contest.settled(&term.nuisance);
        plant.effects.clone_from(&extended.effects);
        let laws: Vec<Effect> = term.effects.iter().map(|law| law.clone().described(EMPIRICAL)).collect();
        plant.effects.extend(laws.iter().cloned());
        (plant, laws)
    };
    let mut best = None;
    let mut least = WINS * left(extended)?;
    for term in terms.iter().filter(|term| !term.effects.is_empty()) {
        let now = left(&with(contest, term).0)?;
        if now < least {
            (best, least) = (Some(term), now);
        }
    }
    let Some(term) = best else { return Ok(None) };
    let found = with(contest, term);
    let sharper = term.sharper(contest, beside)?;
    let sharper = with(contest, &sharper);
    Ok(Some(if left(&sharper.0)? < least { sharper } else { found }))
}

/// Velocity of the base about sample `k`: m/s, m/s, rad/s.
pub(crate) fn velocity(poses: &Poses, k: usize) -> [f64; 3] {
    let (a, b) = (k.saturating_sub(EITHER_SIDE), (k + EITHER_SIDE).min(poses.t_s.len() - 1));
    let dt_s = (poses.t_s[b] - poses.t_s[a]).max(1e-6);
    [0, 1, 2].map(|i| (poses.values[b][i] - poses.values[a][i]) / dt_s)
}

/// How laws would show beside these effects, which leave these residuals: each of strength 1.
pub(crate) fn columns(
    contest: &Contest,
    beside: &[Effect],
    residuals: &[DVector<f64>],
    probes: &[Effect],
) -> Result<Vec<Column>, ModelError> {
    let column = |probe: &Effect| -> Result<Column, ModelError> {
        let with_probe = contest.trial_with(&[beside, std::slice::from_ref(probe)].concat());
        let after = contest.evidence.residuals(&with_probe, &contest.evidence.cells)?;
        Ok(residuals.iter().zip(after).map(|(before, after)| (before - after) / probe.values()[0]).collect())
    };
    probes.iter().map(column).collect()
}

/// The term of these laws that fits best; pairs a quarter of a turn apart are one law each.
fn fitted(contest: &Contest, left: &Refined, probes: &[Effect]) -> Result<Term, ModelError> {
    let columns = columns(contest, &left.effects, &left.residuals, probes)?;
    let reduced = contest.reduce(&left.residuals, &columns);
    let all: Vec<usize> = (0..probes.len()).collect();
    let first = reduced.normal.fit(&all);
    let noise = (reduced.normal.c - first.gain).max(0.0) / reduced.normal.freedom.max(1.0);
    let is_clear = |law: &&[usize]| {
        let size: f64 = law.iter().map(|i| first.value[*i].powi(2)).sum();
        let variance: f64 = law.iter().map(|i| first.covariance[(*i, *i)]).sum();
        size > CLEAR.powi(2) * noise.max(1.0) * variance
    };
    let laws = all.chunk_by(|a, b| is_same_law(&probes[*a], &probes[*b])).filter(is_clear);
    let kept: Vec<usize> = laws.flatten().copied().collect();
    let fit = reduced.normal.fit(&kept);
    let nuisance = &reduced.nuisance - reduced.by_column.select_columns(&kept) * &fit.value;
    let kept = kept.iter().map(|i| probes[*i].clone()).collect();
    Ok(Term::new(kept, fit.value, nuisance, fit.gain))
}

/// Laws of these strengths, two probes of one law at their phase between.
fn laws_of(probes: &[Effect], strengths: &DVector<f64>) -> Vec<Effect> {
    let all: Vec<usize> = (0..probes.len()).collect();
    let one = |law: &[usize]| {
        let probe = probes[law[0]].clone();
        let Some(second) = law.get(1) else { return probe.with(&[strengths[law[0]]]) };
        let (sine, cosine) = (strengths[law[0]], strengths[*second]);
        let [_, frequency, direction_rad] = [0, 1, 2].map(|i| probe.values()[i]);
        probe.with(&[sine.hypot(cosine), frequency, direction_rad, cosine.atan2(sine)])
    };
    all.chunk_by(|a, b| is_same_law(&probes[*a], &probes[*b])).map(one).collect()
}

/// Whether two probes are one law at two phases.
fn is_same_law(a: &Effect, b: &Effect) -> bool {
    a.channel() == b.channel() && a.get("direction_rad") == b.get("direction_rad")
}

fn bounds(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let known = values.filter(|v| v.is_finite());
    known.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}
