//! The diagnosis: where the simulation is wrong, what causes it, the extended model, and what knowing it is worth.

use crate::contest::{Contest, Selection};
use crate::evidence::Evidence;
use crate::hypothesis::OUTSIDE;
use crate::in_motion::{carried_out, masses_that_move};
use crate::inputs::{Mismatch, mismatches};
use crate::integrity::{Examined, examine};
use crate::measured::Run;
use crate::misfit::{ChannelMisfit, Windows, of_run};
use crate::prediction::predictive;
use crate::search::selected;
use crate::trial::Trial;
use crate::unexplained::{Unexplained, describe};
use crate::verdict::{judge, nothing_asserted};
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant};
use rayon::prelude::*;

pub use crate::verdict::{Alternative, Cause, Verdict};

/// RMS over the noise of all channels of the validation runs (of the fitted ones where there are none).
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    /// With the plant as given, its uncertain values settled.
    pub before: f64,
    /// With the extended model.
    pub after: f64,
}

/// A cause as a linear fit sees it, for the ranking of the report.
#[derive(Clone, Debug)]
pub struct Ranked {
    /// The effect at the linear estimate.
    pub effect: Effect,
    /// Share of the misfit that it alone would explain.
    pub share: f64,
}

/// The answer.
pub struct Diagnosis {
    /// What there was to say of the records, before anything was concluded from them.
    pub remarks: Vec<String>,
    /// Runs that were left out, because their commands are not those of their motion.
    pub input_mismatch: Vec<Mismatch>,
    /// What it comes to.
    pub verdict: Verdict,
    /// What is asserted, strongest first.
    pub causes: Vec<Cause>,
    /// Causes that fitted best where nothing is asserted.
    pub suspects: Vec<Cause>,
    /// The first ranking of all causes, best first.
    pub ranking: Vec<Ranked>,
    /// Cosines between the first few of the ranking: 1 where these data cannot tell two apart.
    pub confusability: Vec<Vec<f64>>,
    /// What is left unexplained.
    pub unexplained: Option<Unexplained>,
    /// Misfit of the runs with the plant as given, uncertain values settled.
    pub before: Vec<ChannelMisfit>,
    /// Misfit of the runs with the extended model.
    pub after: Vec<ChannelMisfit>,
    /// The same of the validation runs.
    pub validation_before: Vec<ChannelMisfit>,
    /// The same of the validation runs with the extended model.
    pub validation_after: Vec<ChannelMisfit>,
    /// What the extension gains.
    pub gain: Gain,
    /// Uncertain values that the data have moved: name, by how many standard deviations.
    pub settled: Vec<(String, f64)>,
    /// The plant with its uncertain values settled and the asserted effects.
    pub extended: Plant,
}

/// Diagnoses measured runs of a plant.
///
/// # Errors
/// Where the plant's effects make a mass or an inertia impossible.
pub fn diagnose(
    plant: &Plant,
    runs: &[Run],
    validation: &[Run],
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, ModelError> {
    let Examined { plant, runs, remarks } = examine(plant, runs);
    let validation = examine(&plant, validation).runs;
    let (plant, runs, validation) = (&plant, &runs[..], &validation[..]);
    let windows = Windows::suited_to(plant, runs);
    progress("simulating every cause");
    let mut contest = Contest::new(plant, runs, windows)?;
    if contest.evidence.cells.is_empty() {
        return Ok(nothing_to_say(plant, remarks));
    }
    let mut selection = selected(&mut contest, plant, runs, progress)?;
    let (runs_as_read, validation_as_read, moved) =
        (runs, validation, masses_that_move(&selection.after.effects, runs));
    let anew = match &moved {
        Some(masses) => (carried_out(runs, plant, masses)?, carried_out(validation, plant, masses)?),
        None => (Vec::new(), Vec::new()),
    };
    let (runs, validation) = if moved.is_some() { (&anew.0[..], &anew.1[..]) } else { (runs, validation) };
    if moved.is_some() {
        progress("moving the arm as these masses let it");
        contest = Contest::new(plant, runs, windows)?;
        selection = selected(&mut contest, plant, runs, progress)?;
    }
    let (mut verdict, mut causes, suspects) = judge(&contest, &selection);
    let (outside, mut suspects): (Vec<Cause>, Vec<Cause>) = suspects.into_iter().partition(Cause::is_outside);
    let mut input_mismatch = Vec::new();
    if matches!(verdict, Verdict::Unexplained | Verdict::PartlyExplained) {
        progress("looking whether commands belong to their motion");
        input_mismatch = mismatches(&contest.trial_with(&selection.after.effects), runs, windows)?;
        let rest: Vec<Run> =
            runs.iter().filter(|run| input_mismatch.iter().all(|m| m.run != run.name)).cloned().collect();
        if !input_mismatch.is_empty() && !rest.is_empty() {
            return Ok(without(diagnose(plant, &rest, validation, progress)?, remarks, input_mismatch));
        }
        if !input_mismatch.is_empty() {
            verdict = Verdict::Unexplained;
            suspects.append(&mut causes);
        }
    }
    causes.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    progress("measuring the gain");
    let misfit = |plant: &Plant, runs: &[Run]| misfit(plant, runs, windows);
    // What makes the prediction of new runs worse explains the old ones only.
    let file = contest.settled(&selection.before.nuisance);
    let kept = predictive(&file, &contest.settled(&selection.after.nuisance), &causes, &|p| misfit(p, validation))?;
    if kept.len() < causes.len() {
        let (good, idle): (Vec<_>, Vec<_>) = causes.into_iter().enumerate().partition(|(i, _)| kept.contains(i));
        causes = good.into_iter().map(|(_, cause)| cause).collect();
        suspects.extend(idle.into_iter().map(|(_, cause)| cause));
        if causes.is_empty() {
            verdict = nothing_asserted(&contest, &selection.before);
        }
    }
    let asserted: Vec<Effect> = causes.iter().map(|c| c.effect.clone()).collect();
    let settled = file;
    let extended = if asserted.is_empty() {
        settled.clone()
    } else {
        let mut extended = contest.settled(&selection.after.nuisance);
        extended.effects.extend(asserted);
        extended
    };
    let (before, after) = (misfit(&settled, runs_as_read)?, misfit(&extended, runs)?);
    let (validation_before, validation_after) = (misfit(&settled, validation_as_read)?, misfit(&extended, validation)?);
    let judged = if validation_before.is_empty() { [&before, &after] } else { [&validation_before, &validation_after] };
    let gain = Gain { before: overall(judged[0]), after: overall(judged[1]) };
    let judged = if validation.is_empty() { runs } else { validation };
    let fitted = fitted_left(&extended, judged, windows)?.unwrap_or(f64::INFINITY);
    let verdict = verdict.after_validation(fitted.min(gain.after.powi(2)));
    let unexplained = match verdict {
        Verdict::Unexplained | Verdict::PartlyExplained => {
            progress("looking at what is left");
            let seen = match verdict {
                Verdict::Unexplained => &selection.before,
                _ if outside.is_empty() => &selection.after,
                _ => &contest.only(&selection.after, |_, effect| effect.id() != OUTSIDE)?,
            };
            Some(describe(&contest, seen, &outside, runs)?)
        }
        _ => None,
    };
    let (ranking, confusability) = ranking(&contest, &selection);
    let settled = contest
        .uncertain
        .iter()
        .zip(contest.off_file(&selection.after.nuisance))
        .map(|(u, z)| (u.name.clone(), z))
        .collect();
    Ok(Diagnosis {
        remarks,
        input_mismatch,
        verdict,
        causes,
        suspects,
        ranking,
        confusability,
        unexplained,
        before,
        after,
        validation_before,
        validation_after,
        gain,
        settled,
        extended,
    })
}

/// Mean square that a plant leaves of a clamped arm's runs, each window's first state fitted: a few swings begun where they were
/// measured tell more of that noise than of the plant.
fn fitted_left(plant: &Plant, runs: &[Run], windows: Windows) -> Result<Option<f64>, ModelError> {
    if !plant.base.clamped {
        return Ok(None);
    }
    let cells = Evidence::gather(&Trial::of(plant), runs, windows)?.cells;
    let freedom: f64 = cells.iter().map(|cell| cell.freedom).sum();
    Ok((freedom > 0.0).then(|| cells.iter().map(|cell| cell.residual.norm_squared()).sum::<f64>() / freedom))
}

/// How far runs are from a plant, channel by channel.
fn misfit(plant: &Plant, runs: &[Run], windows: Windows) -> Result<Vec<ChannelMisfit>, ModelError> {
    let all: Result<Vec<_>, _> = runs.par_iter().map(|run| of_run(plant, run, windows)).collect();
    Ok(all?.into_iter().flatten().collect())
}

/// The diagnosis of the other runs, where some were left out: not everything is explained then.
fn without(mut rest: Diagnosis, remarks: Vec<String>, left_out: Vec<Mismatch>) -> Diagnosis {
    rest.remarks = remarks;
    rest.input_mismatch.extend(left_out);
    rest.verdict = if rest.causes.is_empty() { Verdict::Unexplained } else { Verdict::PartlyExplained };
    rest
}

fn nothing_to_say(plant: &Plant, remarks: Vec<String>) -> Diagnosis {
    Diagnosis {
        remarks,
        input_mismatch: Vec::new(),
        verdict: Verdict::Consistent,
        causes: Vec::new(),
        suspects: Vec::new(),
        ranking: Vec::new(),
        confusability: Vec::new(),
        unexplained: None,
        before: Vec::new(),
        after: Vec::new(),
        validation_before: Vec::new(),
        validation_after: Vec::new(),
        gain: Gain { before: 1.0, after: 1.0 },
        settled: Vec::new(),
        extended: plant.clone(),
    }
}

fn ranking(contest: &Contest, selection: &Selection) -> (Vec<Ranked>, Vec<Vec<f64>>) {
    const SHOWN: usize = 10;
    // Where the whole is no more than noise would be, what one cause explains can still be more than noise.
    let most = selection.screened.iter().map(|s| s.gain).fold(1.0, f64::max);
    let excess = (selection.before.chi2 - selection.before.freedom).max(most);
    let mut shown = Vec::new();
    for s in &selection.screened {
        let twin = |o: &&crate::contest::Screened| {
            contest.hypotheses[o.hypothesis].nominal == contest.hypotheses[s.hypothesis].nominal
        };
        if shown.len() < SHOWN && !shown.iter().any(twin) {
            shown.push(s);
        }
    }
    let causes: Vec<usize> = shown.iter().map(|s| s.hypothesis).collect();
    let cosines = contest.confusability(&causes);
    let rows = (0..causes.len()).map(|i| (0..causes.len()).map(|j| cosines[(i, j)]).collect()).collect();
    let ranked = shown.iter().map(|s| Ranked { effect: s.effect.clone(), share: (s.gain / excess).clamp(0.0, 1.0) });
    (ranked.collect(), rows)
}

/// RMS of the ratios of all channels; those of unknown noise decide nothing.
pub(crate) fn overall(misfits: &[ChannelMisfit]) -> f64 {
    let ratios: Vec<f64> = misfits.iter().map(ChannelMisfit::ratio).filter(|r| r.is_finite()).collect();
    (ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len().max(1) as f64).sqrt()
}
