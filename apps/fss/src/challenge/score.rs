//! How good an answer is.

use super::answer::{Answer, Said};
use super::hidden::{Envelope, HiddenEffect, Kind};
use serde::{Deserialize, Serialize};

/// A cause at least this probable is named; below, it is one of a set.
pub const NAMED: f64 = 0.9;
/// A hidden effect below this dose shows nowhere: whatever is said of it would be a guess.
pub const VISIBLE_DOSE: f64 = 0.1;
/// Half of the 90 % interval over the standard deviation.
const HALF_INTERVAL: f64 = 1.645;

/// The marks of one seed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Score {
    /// It says that something is wrong.
    pub detected: bool,
    /// Its first cause is one of the hidden ones.
    pub first_is_right: bool,
    /// Every hidden effect is among its causes.
    pub all_are_right: bool,
    /// It says that something is left that it cannot explain.
    pub says_unexplained: bool,
    /// Causes that it is sure of, and how many of these are not there.
    pub named: usize,
    /// See `named`.
    pub named_wrongly: usize,
    /// Where it is not sure: whether its set holds the truth, and how large the set is.
    pub set: Option<(bool, usize)>,
    /// Errors of the right causes' parameters, as shares of what these depart from nominal.
    pub errors: Vec<f64>,
    /// Whether each parameter of the right causes lies in its 90 % interval.
    pub covered: Vec<bool>,
    /// How sure it was of each cause and alternative, and whether that was right.
    pub claims: Vec<(f64, bool)>,
}

/// Scores what was said against what was hidden.
pub fn score(envelope: &Envelope, answer: &Answer) -> Score {
    let hidden = &envelope.effects;
    let is_hidden = |said: &Said| hidden.iter().find(|h| h.record.is_same_cause(&said.record));
    let is_outside = envelope.kind == Kind::Outside;
    let mut score = Score {
        detected: answer.verdict != "consistent",
        first_is_right: answer.causes.first().is_some_and(|first| is_hidden(first).is_some()),
        all_are_right: !hidden.is_empty()
            && hidden.iter().all(|h| answer.causes.iter().any(|said| h.record.is_same_cause(&said.record))),
        says_unexplained: matches!(answer.verdict.as_str(), "unexplained" | "partly_explained")
            || answer.causes.iter().any(|said| said.record.effect == "unmodelled"),
        ..Score::default()
    };
    for said in answer.causes.iter().filter(|said| said.record.effect != "unmodelled") {
        let truth = is_hidden(said).filter(|_| !is_outside);
        score.claims.push((said.probability, truth.is_some()));
        for (record, probability) in &said.alternatives {
            let is_right = hidden.iter().any(|h| h.record.is_same_cause(record));
            score.claims.push((*probability, is_right));
        }
        if said.probability >= NAMED {
            score.named += 1;
            score.named_wrongly += usize::from(truth.is_none());
        } else if score.set.is_none() {
            let in_set = said.alternatives.iter().any(|(r, _)| hidden.iter().any(|h| h.record.is_same_cause(r)));
            score.set = Some((truth.is_some() || in_set, 1 + said.alternatives.len()));
        }
        if let Some(truth) = truth {
            compare(truth, said, &mut score);
        }
    }
    score
}

/// Compares the parameters of a right cause. Several components of one kind count together, since one of them may be next
/// to nothing.
fn compare(truth: &HiddenEffect, said: &Said, score: &mut Score) {
    let (mut apart, mut departure) = (0.0, 0.0);
    let mut scale = None;
    for (name, value) in &truth.record.parameters {
        let (Some(found), Some(nominal)) = (said.record.parameters.get(name), truth.nominal.get(name)) else {
            continue;
        };
        // A shape (an anchor, a rest angle) has no size of its own to compare with.
        if is_shape(name) {
            continue;
        }
        // Components are comparable where they share their unit.
        let unit = name.rsplit_once('_').map(|(_, unit)| unit);
        if scale.is_some_and(|first| first != unit) {
            continue;
        }
        scale = Some(unit);
        apart += (found - value).powi(2);
        departure += (value - nominal).powi(2);
        if let Some(std) = said.std.get(name).filter(|std| **std > 0.0) {
            score.covered.push((found - value).abs() <= HALF_INTERVAL * std);
        }
    }
    if departure > 0.0 {
        score.errors.push((apart / departure).sqrt());
    }
}

/// Whether a parameter only shapes an effect, whose size is another's matter.
pub fn is_shape(name: &str) -> bool {
    matches!(name, "other_index" | "rest_rad" | "anchor_x_m" | "anchor_y_m" | "velocity_rad_s" | "cycles_per_rev")
}
