//! The diagnosis: where the simulation is wrong, what causes it, the extended model, and what knowing it is worth.

use crate::contest::{Contest, Selection};
use crate::empirical::winner;
use crate::in_motion::{carried_out, masses_that_move};
use crate::inputs::{Mismatch, mismatches};
use crate::prediction::{Data, Runs, overall, predictive};
use crate::unexplained::{Unexplained, describe};
use crate::verdict::{Judgement, after_validation, judge, nothing_asserted};
use fss_diagnosis::diagnosis::{ChannelMisfit, Gain, Verdict};
use fss_diagnosis::examine::{Examined, examine};
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant};

pub use crate::verdict::{Alternative, Cause};

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
    /// What is left unexplained.
    pub unexplained: Option<Unexplained>,
    /// Laws in the extended plant that are no known effect's, where they predict the validation runs better.
    pub empirical: Vec<Effect>,
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
    progress("simulating every cause");
    let mut contest = Contest::new(plant, runs)?;
    if contest.evidence.cells.is_empty() {
        return Ok(nothing_to_say(plant, remarks));
    }
    let mut selection = contest.select(progress)?;
    let (as_read, moved) = (Runs { fitted: runs, validation }, masses_that_move(&selection.after.effects, runs));
    let anew = match &moved {
        Some(masses) => (carried_out(runs, plant, masses)?, carried_out(validation, plant, masses)?),
        None => (Vec::new(), Vec::new()),
    };
    let (runs, validation) = if moved.is_some() { (&anew.0[..], &anew.1[..]) } else { (runs, validation) };
    if moved.is_some() {
        progress("moving the arm as these masses let it");
        contest = Contest::new(plant, runs)?;
        selection = contest.select(progress)?;
    }
    let mut judged = judge(&contest, &selection);
    let mut input_mismatch = Vec::new();
    if judged.verdict.leaves_something() {
        progress("looking whether commands belong to their motion");
        input_mismatch = mismatches(&contest.trial_with(&selection.after.effects), runs)?;
        let rest: Vec<Run> =
            runs.iter().filter(|run| input_mismatch.iter().all(|m| m.run != run.name)).cloned().collect();
        if !input_mismatch.is_empty() && !rest.is_empty() {
            return Ok(without(diagnose(plant, &rest, validation, progress)?, remarks, input_mismatch));
        }
        if !input_mismatch.is_empty() {
            judged.assert_nothing();
        }
    }
    let data = Data { as_read, carried_out: Runs { fitted: runs, validation } };
    let concluded = conclude(&mut contest, &selection, judged, &data, progress)?;
    Ok(Diagnosis { remarks, input_mismatch, ..concluded })
}

/// What the contest's judgement comes to, measured on runs that it has not seen.
fn conclude(
    contest: &mut Contest,
    selection: &Selection,
    judged: Judgement,
    data: &Data,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, ModelError> {
    progress("measuring the gain");
    let Judgement { mut verdict, mut causes, mut suspects } = judged;
    causes.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let file = contest.settled(&selection.before.nuisance);
    let with_causes = contest.settled(&selection.after.nuisance);
    // What makes the prediction of new runs worse explains the old ones only.
    let kept = predictive(&file, &with_causes, &causes, data)?;
    if kept.len() < causes.len() {
        let (good, idle): (Vec<_>, Vec<_>) = causes.into_iter().enumerate().partition(|(i, _)| kept.contains(i));
        causes = good.into_iter().map(|(_, cause)| cause).collect();
        suspects.extend(idle.into_iter().map(|(_, cause)| cause));
        if causes.is_empty() {
            verdict = nothing_asserted(contest, &selection.before);
        }
    }
    let mut extended = if causes.is_empty() { file.clone() } else { with_causes };
    extended.effects.extend(causes.iter().map(|c| c.effect.clone()));
    let (before, mut after) = (data.told_as_read(&file)?, data.told(&extended)?);
    verdict = after_validation(verdict, overall(after.judged()).powi(2));
    let ranking = ranking(contest, selection);
    let (mut unexplained, mut empirical) = (None, Vec::new());
    if verdict.leaves_something() {
        progress("looking at what is left");
        let seen = match verdict {
            Verdict::Unexplained => &selection.before,
            _ => &selection.after,
        };
        let left = describe(contest, seen, data.carried_out.fitted)?;
        if let Some((with_term, laws)) = winner(&left.terms, &seen.effects, contest, &extended, data)? {
            (after, extended, empirical) = (data.told(&with_term)?, with_term, laws);
        }
        unexplained = Some(left);
    }
    let gain = Gain { before: overall(before.judged()), after: overall(after.judged()) };
    let moved = selection.after.nuisance.iter().copied();
    Ok(Diagnosis {
        remarks: Vec::new(),
        input_mismatch: Vec::new(),
        verdict,
        causes,
        suspects,
        ranking,
        unexplained,
        empirical,
        before: before.fitted,
        after: after.fitted,
        validation_before: before.validation,
        validation_after: after.validation,
        gain,
        settled: contest.uncertain.iter().zip(moved).map(|(u, z)| (u.name.clone(), z)).collect(),
        extended,
    })
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
        unexplained: None,
        empirical: Vec::new(),
        before: Vec::new(),
        after: Vec::new(),
        validation_before: Vec::new(),
        validation_after: Vec::new(),
        gain: Gain { before: 1.0, after: 1.0 },
        settled: Vec::new(),
        extended: plant.clone(),
    }
}

fn ranking(contest: &Contest, selection: &Selection) -> Vec<Ranked> {
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
    let ranked =
        |s: &&crate::contest::Screened| Ranked { effect: s.effect.clone(), share: (s.gain / excess).clamp(0.0, 1.0) };
    shown.iter().map(ranked).collect()
}
