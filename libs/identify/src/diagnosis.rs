//! The diagnosis: where the simulation is wrong, what causes it, the extended model, and what knowing it is worth.

use crate::contest::{Contest, Refined, Selection};
use crate::evidence::Evidence;
use crate::in_motion::{carried_out, masses_that_move};
use crate::inputs::{Mismatch, mismatches};
use crate::integrity::{Examined, examine};
use crate::measured::Run;
use crate::misfit::{ChannelMisfit, Windows, of_run};
use crate::prediction::predictive;
use crate::search::{mean_square, selected};
use crate::trial::Trial;
use crate::unexplained::{Unexplained, describe};
use fss_multibody::ModelError;
use fss_plant::{Effect, Place, Plant};
use rayon::prelude::*;

/// Mean square of the whitened residuals below which noise alone explains them.
const CONSISTENT: f64 = 1.25;
/// RMS of one channel in one run over its noise, below which nothing is said of it.
const CONSISTENT_CHANNEL: f64 = 1.6;
/// Mean square beyond which something is left that no cause explains.
pub(crate) const ALL_EXPLAINED: f64 = 1.5;
/// Mean square beyond which names are given only to what explains most of the misfit.
pub(crate) const DOUBTFUL: f64 = 2.0;
/// Share of the misfit that causes must explain then.
const MOST: f64 = 0.7;
/// A cause is asserted from even chances on that it, or another in its place, is there.
const EVEN: f64 = 0.5;
/// A base that is this many times lighter than its plant file says is one that was weighed.
const LIGHT: f64 = 1.4;
/// What pushes a base harder than the room's air by more than this many times what its lightness would lend the air is not air.
const LENT: f64 = 3.0;
/// A second or later cause is asserted only if it is this probable among its rivals.
const SURE: f64 = 0.7;

/// What the diagnosis comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Noise, room air and stated uncertainty explain the data.
    Consistent,
    /// The causes asserted explain what was wrong.
    Explained,
    /// They explain most of it.
    PartlyExplained,
    /// Something is wrong that no known effect explains.
    Unexplained,
}

impl Verdict {
    /// The word in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Consistent => "consistent",
            Self::Explained => "explained",
            Self::PartlyExplained => "partly_explained",
            Self::Unexplained => "unexplained",
        }
    }

    /// What explains the runs that were fitted must explain others too: there nothing has counted for noise that is none.
    fn after_validation(self, left: f64) -> Self {
        match self {
            Self::Consistent if left > ALL_EXPLAINED => Self::Unexplained,
            Self::Explained if left > ALL_EXPLAINED => Self::PartlyExplained,
            other => other,
        }
    }
}

/// A cause that is asserted.
#[derive(Clone, Debug)]
pub struct Cause {
    /// The effect with its values.
    pub effect: Effect,
    /// Standard deviations of its parameters, in their order; none for an exchange of wires.
    pub std: Vec<f64>,
    /// Probability that this is the cause, among all that were tried.
    pub probability: f64,
    /// Fall of the sum of squares, in units of what one degree of freedom has.
    pub gain: f64,
    /// Share of its gain that it keeps in runs left out of the fit.
    pub kept: f64,
    /// What else it could be, most probable first.
    pub alternatives: Vec<Alternative>,
}

impl Cause {
    /// Probability that this cause, or another in its place, is there.
    fn is_there(&self) -> f64 {
        let others: f64 = self.alternatives.iter().map(|other| other.probability).sum();
        self.probability / (1.0 - others.min(0.999))
    }
}

/// Another cause in the place of an asserted one.
#[derive(Clone, Debug)]
pub struct Alternative {
    /// The effect with the values that would fit best.
    pub effect: Effect,
    /// Its probability.
    pub probability: f64,
}

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
    let (mut verdict, mut causes, mut suspects) = judge(&contest, &selection);
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
            let seen = if verdict == Verdict::Unexplained { &selection.before } else { &selection.after };
            Some(describe(&contest, seen, runs)?)
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

/// Verdict, asserted causes, suspects.
fn judge(contest: &Contest, selection: &Selection) -> (Verdict, Vec<Cause>, Vec<Cause>) {
    let all: Vec<Cause> = selection
        .taken
        .iter()
        .map(|t| Cause {
            effect: t.effect.clone(),
            std: t.std.clone(),
            probability: t.probability,
            gain: t.gain,
            kept: t.kept,
            alternatives: t
                .alternatives
                .iter()
                .map(|a| Alternative { effect: a.effect.clone(), probability: a.probability })
                .collect(),
        })
        .collect();
    let left = mean_square(&selection.after);
    let air = contest.air(&selection.after);
    if all.iter().all(|cause| cause.is_there() < EVEN) {
        return (nothing_asserted(contest, &selection.before), Vec::new(), all);
    }
    let excess = selection.before.chi2 - selection.before.freedom;
    let share = if excess > 0.0 { (selection.before.chi2 - selection.after.chi2) / excess } else { 1.0 };
    if left > DOUBTFUL && share < MOST {
        return (Verdict::Unexplained, Vec::new(), all);
    }
    // Whatever still pushes the base may have lent its strength to a cause that pushes it too.
    let air_before = contest.air(&selection.before);
    let pushed = air.is_too_strong() && air.excess() > (1.0 - MOST) * air_before.excess();
    // A base that is taken to be light lets the room's air explain what really pushes it, but for so much as that lends it.
    let nominal_kg = contest.trial.plant.base.mass_kg;
    let lends = |c: &Cause| {
        let lighter = nominal_kg / c.effect.values()[0];
        c.effect.id() == "base_mass" && lighter > LIGHT && air_before.strongest().1 < LENT * lighter
    };
    let pushed = pushed || (air_before.is_too_strong() && all.iter().any(lends));
    let is_doubtful =
        |c: &Cause| pushed && matches!(c.effect.about().place, Place::Base | Place::Mass | Place::Thruster);
    let (asserted, doubtful): (Vec<_>, Vec<_>) = all
        .into_iter()
        .enumerate()
        .partition(|(i, c)| !is_doubtful(c) && c.is_there() >= EVEN && (*i == 0 || c.probability >= SURE));
    let strip = |list: Vec<(usize, Cause)>| list.into_iter().map(|(_, c)| c).collect::<Vec<_>>();
    let asserted = strip(asserted);
    if asserted.is_empty() {
        return (Verdict::Unexplained, asserted, strip(doubtful));
    }
    let whole = !air.is_too_strong()
        && left < ALL_EXPLAINED
        && doubtful.is_empty()
        && stands_out(contest, &selection.after) < 2.0 * CONSISTENT_CHANNEL;
    (if whole { Verdict::Explained } else { Verdict::PartlyExplained }, asserted, strip(doubtful))
}

/// RMS over noise of the channel that stands out most from what is left.
fn stands_out(contest: &Contest, refined: &Refined) -> f64 {
    contest.worst(refined).map_or(0.0, |(_, _, rms)| rms)
}

/// The verdict where no cause is asserted and this is what is left.
fn nothing_asserted(contest: &Contest, left: &Refined) -> Verdict {
    let is_quiet = mean_square(left) < CONSISTENT
        && stands_out(contest, left) < CONSISTENT_CHANNEL
        && contest.shaken.is_none()
        && !contest.air(left).is_too_strong();
    if is_quiet { Verdict::Consistent } else { Verdict::Unexplained }
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
