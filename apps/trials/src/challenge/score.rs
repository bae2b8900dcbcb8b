//! How good an answer is.

use super::answer::{Answer, Said};
use super::record::{Envelope, HiddenEffect, Kind, Record, is_shape};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Below this probability a cause with alternatives is undecided, even where none of these is equivalent.
const DECIDED: f64 = 0.9;
/// An alternative that is less probable, and not equivalent, is no member of an undecided set.
const NEGLIGIBLE: f64 = 0.01;
/// Half of the 90 % interval over the standard deviation.
const HALF_INTERVAL: f64 = 1.645;

/// The marks of one seed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Score {
    /// It says that something is wrong.
    pub detected: bool,
    /// Its first cause, or one that the data cannot tell from it, is hidden.
    pub first_is_right: bool,
    /// Every hidden effect is among its causes or the equivalents of these.
    pub all_are_right: bool,
    /// It says that something is left that it cannot explain.
    pub says_unexplained: bool,
    /// Causes that it asserts, whatever their probability.
    pub asserted: usize,
    /// How many of these, with all that is equivalent to them, are not there.
    pub asserted_wrongly: usize,
    /// Undecided sets, a cause with its alternatives: whether each holds a hidden effect, and how many members it has.
    pub sets: Vec<(bool, usize)>,
    /// Errors of the right causes' parameters, as shares of what these depart from nominal.
    pub errors: Vec<f64>,
    /// Whether each parameter of the right causes lies in its 90 % interval.
    pub covered: Vec<bool>,
    /// Probability of each cause and alternative, and whether that was right.
    pub claims: Vec<(f64, bool)>,
}

/// A hidden effect as an answer names it: values and their standard deviations.
type Named<'a> = (&'a HiddenEffect, &'a Record, &'a BTreeMap<String, f64>);

/// Scores what was said against what was hidden.
pub(super) fn score(envelope: &Envelope, answer: &Answer) -> Score {
    // What is outside the catalogue has no right name.
    let hidden: &[HiddenEffect] = if envelope.kind == Kind::Outside { &[] } else { &envelope.effects };
    let named = |said: &'_ Said| hidden.iter().any(|truth| names(said, truth).is_some());
    let causes = || answer.causes.iter().filter(|said| said.record.effect != "unmodelled");
    let mut score = Score {
        detected: answer.verdict != "consistent",
        first_is_right: causes().next().is_some_and(named),
        all_are_right: !hidden.is_empty()
            && hidden.iter().all(|truth| causes().any(|said| names(said, truth).is_some())),
        says_unexplained: matches!(answer.verdict.as_str(), "unexplained" | "partly_explained"),
        asserted: causes().count(),
        asserted_wrongly: causes().filter(|said| !named(said)).count(),
        ..Score::default()
    };
    let is_hidden = |record: &Record| hidden.iter().any(|truth| truth.record.is_same_cause(record));
    for said in causes() {
        score.claims.push((said.probability, is_hidden(&said.record)));
        for other in &said.alternatives {
            score.claims.push((other.probability, is_hidden(&other.record)));
        }
        score.sets.extend(undecided(said).map(|members| {
            let holds = members.iter().any(|member| is_hidden(member));
            (holds, members.len())
        }));
        if let Some(named) = hidden.iter().find_map(|truth| names(said, truth)) {
            compare(named, &mut score);
        }
    }
    score
}

/// The hidden effect where `said`, or one of its equivalents, is it.
fn names<'a>(said: &'a Said, truth: &'a HiddenEffect) -> Option<Named<'a>> {
    let equivalents = said.alternatives.iter().filter(|other| other.is_equivalent);
    let all = std::iter::once((&said.record, &said.std)).chain(equivalents.map(|other| (&other.record, &other.std)));
    let mut right = all.filter(|(record, _)| truth.record.is_same_cause(record));
    right.next().map(|(record, std)| (truth, record, std))
}

/// The members of an undecided set; none where the cause is decided.
fn undecided(said: &Said) -> Option<Vec<&Record>> {
    let counts = said.alternatives.iter().filter(|other| other.is_equivalent || other.probability >= NEGLIGIBLE);
    let members: Vec<&Record> = std::iter::once(&said.record).chain(counts.map(|other| &other.record)).collect();
    let shares = said.probability < DECIDED || said.alternatives.iter().any(|other| other.is_equivalent);
    (shares && members.len() > 1).then_some(members)
}

/// Compares the parameters of a right cause. Several components of one kind count together, since one of them may be next
/// to nothing.
fn compare((truth, said, std): Named<'_>, score: &mut Score) {
    let (mut apart, mut departure) = (0.0, 0.0);
    let mut scale = None;
    for (name, value) in &truth.record.parameters {
        let (Some(found), Some(nominal)) = (said.parameters.get(name), truth.nominal.get(name)) else {
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
        if let Some(std) = std.get(name).filter(|std| **std > 0.0) {
            score.covered.push((found - value).abs() <= HALF_INTERVAL * std);
        }
    }
    if departure > 0.0 {
        score.errors.push((apart / departure).sqrt());
    }
}

#[cfg(test)]
mod tests {
    use super::super::answer::Alternative;
    use super::*;

    fn record(effect: &str, index: usize, value: f64) -> Record {
        let parameters = BTreeMap::from([("scale".to_owned(), value)]);
        Record { effect: effect.to_owned(), index: Some(index), channel: None, onset_s: None, parameters }
    }

    fn hiding(kind: Kind, effects: &[(&str, usize)]) -> Envelope {
        let effects = effects.iter().map(|(effect, index)| HiddenEffect {
            record: record(effect, *index, 0.7),
            nominal: BTreeMap::from([("scale".to_owned(), 1.0)]),
            effect_size: 5.0,
            effect_size_beyond_tolerance: 5.0,
            is_separable: None,
        });
        let (format, effects) = (String::new(), effects.collect());
        Envelope { format, seed: 1, is_own_vehicle: true, links: 4, kind, effects }
    }

    fn said(effect: &str, index: usize, probability: f64, others: &[(&str, usize, f64, bool)]) -> Said {
        let std = BTreeMap::from([("scale".to_owned(), 0.01)]);
        let alternatives = others.iter().map(|(effect, index, probability, is_equivalent)| Alternative {
            record: record(effect, *index, 0.7),
            std: std.clone(),
            probability: *probability,
            is_equivalent: *is_equivalent,
        });
        Said { record: record(effect, index, 0.71), alternatives: alternatives.collect(), std, probability }
    }

    fn scored(envelope: &Envelope, verdict: &str, causes: Vec<Said>) -> Score {
        let answer = Answer { verdict: verdict.to_owned(), causes, ratio_before: None, ratio_after: None };
        score(envelope, &answer)
    }

    #[test]
    fn a_wrong_name_counts_whatever_its_probability() {
        let hidden = hiding(Kind::One, &[("thruster_gain", 3)]);
        let causes = vec![said("thruster_gain", 3, 0.99, &[]), said("thruster_gain", 4, 0.55, &[])];
        let score = scored(&hidden, "explained", causes);
        assert!(score.first_is_right && score.all_are_right);
        assert_eq!((score.asserted, score.asserted_wrongly), (2, 1));
        assert!(score.sets.is_empty(), "a cause without alternatives is no set");
        assert_eq!(score.covered, [true]);
        assert!((score.errors[0] - 0.01 / 0.3).abs() < 1e-9);
    }

    #[test]
    fn an_equivalent_of_a_cause_is_as_right_and_another_alternative_is_not() {
        let hidden = hiding(Kind::One, &[("torque_constant", 2)]);
        let equivalent = scored(
            &hidden,
            "explained",
            vec![said("torque_sensor", 2, 0.5, &[("torque_constant", 2, 0.49, true), ("payload", 1, 1e-4, false)])],
        );
        assert!(equivalent.first_is_right && equivalent.all_are_right);
        assert_eq!((equivalent.asserted_wrongly, equivalent.sets.as_slice()), (0, [(true, 2)].as_slice()));
        let likely = vec![said("torque_sensor", 2, 0.6, &[("torque_constant", 2, 0.4, false)])];
        let other = scored(&hidden, "explained", likely);
        assert!(!other.first_is_right);
        assert_eq!((other.asserted_wrongly, other.sets.as_slice()), (1, [(true, 2)].as_slice()));
        assert_eq!(other.claims, [(0.6, false), (0.4, true)]);
    }

    #[test]
    fn outside_the_catalogue_every_name_is_wrong_and_saying_so_is_right() {
        let hidden = hiding(Kind::Outside, &[("unmodelled", 1)]);
        let score =
            scored(&hidden, "partly_explained", vec![said("unmodelled", 1, 0.9, &[]), said("payload", 1, 0.9, &[])]);
        assert!(score.says_unexplained && !score.first_is_right);
        assert_eq!((score.asserted, score.asserted_wrongly), (1, 1));
    }
}
