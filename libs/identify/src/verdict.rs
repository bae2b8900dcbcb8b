//! What it comes to: consistent, explained, partly or not, and which causes are asserted.

use crate::contest::{Contest, DOUBTFUL, Refined, Selection};
use fss_diagnosis::diagnosis::Verdict;
use fss_plant::{Effect, Place};

/// Mean square of the whitened residuals below which noise alone explains them.
const CONSISTENT: f64 = 1.25;
/// RMS of one channel in one run over its noise, below which nothing is said of it.
const CONSISTENT_CHANNEL: f64 = 1.6;
/// Mean square beyond which something is left that no cause explains.
pub(crate) const ALL_EXPLAINED: f64 = 1.5;
/// Share of the misfit that causes must explain then.
const MOST: f64 = 0.7;
/// Probability from which a cause, or another in its place, is asserted.
const ASSERTED: f64 = 0.9;
/// A base that is this many times lighter than its plant file says is one that was weighed.
const LIGHT: f64 = 1.4;
/// What pushes a base harder than the room's air by more than this many times what its lightness would lend the air is not air.
const LENT: f64 = 3.0;

/// What explains the runs that were fitted must explain others too: there nothing has counted for noise that is none.
pub(crate) fn after_validation(verdict: Verdict, left: f64) -> Verdict {
    match verdict {
        Verdict::Consistent if left > ALL_EXPLAINED => Verdict::Unexplained,
        Verdict::Explained if left > ALL_EXPLAINED => Verdict::PartlyExplained,
        other => other,
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

/// What a contest comes to.
pub(crate) struct Judgement {
    pub(crate) verdict: Verdict,
    /// What is asserted.
    pub(crate) causes: Vec<Cause>,
    /// What fitted best, but is not.
    pub(crate) suspects: Vec<Cause>,
}

impl Judgement {
    /// Takes every assertion back.
    pub(crate) fn assert_nothing(&mut self) {
        self.verdict = Verdict::Unexplained;
        self.suspects.append(&mut self.causes);
    }
}

/// Judges what a contest selected.
pub(crate) fn judge(contest: &Contest, selection: &Selection) -> Judgement {
    let all: Vec<Cause> = selection
        .taken
        .iter()
        .map(|t| Cause {
            effect: t.effect.clone(),
            std: t.std.clone(),
            probability: t.probability,
            gain: t.gain,
            alternatives: t
                .alternatives
                .iter()
                .map(|a| Alternative { effect: a.effect.clone(), probability: a.probability })
                .collect(),
        })
        .collect();
    let none = |verdict, suspects| Judgement { verdict, causes: Vec::new(), suspects };
    let left = selection.after.mean_square();
    let air = contest.air(&selection.after);
    if all.iter().all(|cause| cause.is_there() < ASSERTED) {
        return none(nothing_asserted(contest, &selection.before), all);
    }
    let excess = selection.before.chi2 - selection.before.freedom;
    let share = if excess > 0.0 { (selection.before.chi2 - selection.after.chi2) / excess } else { 1.0 };
    if left > DOUBTFUL && share < MOST {
        return none(Verdict::Unexplained, all);
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
    let (asserted, doubtful): (Vec<_>, Vec<_>) =
        all.into_iter().partition(|c| !is_doubtful(c) && c.is_there() >= ASSERTED);
    if asserted.is_empty() {
        return none(Verdict::Unexplained, doubtful);
    }
    let whole = !air.is_too_strong()
        && left < ALL_EXPLAINED
        && doubtful.is_empty()
        && stands_out(contest, &selection.after) < 2.0 * CONSISTENT_CHANNEL;
    let verdict = if whole { Verdict::Explained } else { Verdict::PartlyExplained };
    Judgement { verdict, causes: asserted, suspects: doubtful }
}

/// RMS over noise of the channel that stands out most from what is left.
fn stands_out(contest: &Contest, refined: &Refined) -> f64 {
    contest.worst(refined).map_or(0.0, |(_, _, rms)| rms)
}

/// The verdict where no cause is asserted and this is what is left.
pub(crate) fn nothing_asserted(contest: &Contest, left: &Refined) -> Verdict {
    let is_quiet = left.mean_square() < CONSISTENT
        && stands_out(contest, left) < CONSISTENT_CHANNEL
        && contest.shaken.is_none()
        && !contest.air(left).is_too_strong();
    if is_quiet { Verdict::Consistent } else { Verdict::Unexplained }
}
