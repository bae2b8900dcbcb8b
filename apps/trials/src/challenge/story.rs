//! One game as a story, and the misses of many.

use super::play::{ENVELOPE_FILE, Played};
use super::record::{CLEAR_EFFECT_SIZE, Kind, VISIBLE_EFFECT_SIZE, short};
use std::path::Path;

/// Tells what was said, what was hidden, and how good that is.
pub(super) fn tell(played: &Played, folder: &Path) {
    let Played { hidden, said, score, .. } = played;
    let vehicle = if hidden.is_own_vehicle { "the plant file's vehicle" } else { "a drawn vehicle" };
    say!("Challenge of seed {}: {vehicle}, {} links", hidden.seed, hidden.links);
    say!(
        "  drawn in {:.1} s, flown in {:.1} s, diagnosed in {:.1} s\n",
        played.drawn_in_s,
        played.flown_in_s,
        played.diagnosed_in_s
    );
    say!("The diagnosis says: {}", said.verdict.replace('_', " "));
    for cause in &said.causes {
        say!("  {:3.0} %  {}", cause.probability * 100.0, cause.record);
        for (name, value) in &cause.record.parameters {
            if let Some(std) = cause.std.get(name) {
                say!("           {name} = {} +- {}", short(*value), short(*std));
            }
        }
        for other in &cause.alternatives {
            let words = if other.is_equivalent { ", which the data cannot tell from it" } else { "" };
            say!("    or {:3.0} %  {}{words}", other.probability * 100.0, other.record);
        }
    }
    if let (Some(before), Some(after)) = (said.ratio_before, said.ratio_after) {
        say!("  RMS over the noise floor on the validation run: {before:.2}, with its model {after:.2}");
    }

    say!("\nThe envelope ({}) says:", folder.join(ENVELOPE_FILE).display());
    if hidden.effects.is_empty() {
        say!("  nothing is hidden");
    }
    for effect in &hidden.effects {
        let note = if effect.is_separable == Some(false) { ", not separable from every other effect" } else { "" };
        say!("  {}, dose {:.2}{note}", effect.record, effect.effect_size_beyond_tolerance);
    }
    say!("\n{}", verdict(played));
    if let Some(error) = score.errors.first() {
        let covered = score.covered.iter().filter(|covered| **covered).count();
        say!("  error {:.1} %, {covered} of {} values within their 90 % interval", error * 100.0, score.covered.len());
    }
}

/// The judgement, in one or two sentences.
fn verdict(played: &Played) -> String {
    let Played { hidden, score, .. } = played;
    let is_visible = hidden.largest_effect_size() >= VISIBLE_EFFECT_SIZE;
    let wrongly = match score.asserted_wrongly {
        0 => String::new(),
        n => format!(" It asserts {n} that is not there."),
    };
    // What hardly shows may be seen.
    let is_there = score.first_is_right || (hidden.kind == Kind::Outside && score.says_unexplained);
    let sentence = match hidden.kind {
        _ if !is_visible && !score.detected => "Right: there is nothing to see.",
        _ if !is_visible && !is_there => "Wrong: it sees what is not there.",
        _ if !score.detected => "Missed: it sees nothing.",
        Kind::Outside if score.says_unexplained => "Right: it says that no known effect explains this.",
        Kind::Outside => "Wrong: the catalogue does not have this.",
        Kind::Two if score.all_are_right => "Right: it has found both.",
        Kind::Two if score.first_is_right => "Half right: it has found one of the two.",
        _ if score.first_is_right => "Right: it has found the cause.",
        _ => match score.sets.first() {
            Some((true, count)) => return format!("Undecided: the cause is among its {count}.{wrongly}"),
            _ if score.asserted == 0 => "Seen, but not named.",
            _ => "Wrong: that is not the cause.",
        },
    };
    format!("{sentence}{wrongly}")
}

/// Whether the answer falls short of what could be asked for.
fn is_miss(played: &Played) -> bool {
    let Played { hidden, score, .. } = played;
    score.asserted_wrongly > 0
        || match hidden.kind {
            _ if hidden.largest_effect_size() < VISIBLE_EFFECT_SIZE => score.detected,
            _ if hidden.largest_effect_size() < CLEAR_EFFECT_SIZE => false,
            Kind::Outside => !score.says_unexplained,
            Kind::Two => !score.all_are_right,
            _ => !score.first_is_right,
        }
}

/// Prints the misses.
pub(super) fn misses(played: &[&Played]) {
    let misses: Vec<&&Played> = played.iter().filter(|p| is_miss(p)).collect();
    say!("\n{} misses", misses.len());
    for played in misses {
        let Played { hidden, said, .. } = played;
        let there: Vec<String> =
            hidden.effects.iter().map(|e| format!("{}, d {:.1}", e.record, e.effect_size_beyond_tolerance)).collect();
        let named: Vec<String> =
            said.causes.iter().map(|c| format!("{} {:.0} %", c.record, c.probability * 100.0)).collect();
        let or = |list: Vec<String>, none: &str| if list.is_empty() { none.to_owned() } else { list.join(" and ") };
        let vehicle = if hidden.is_own_vehicle { "own vehicle".to_owned() } else { format!("{} links", hidden.links) };
        say!("  seed {:<5} {vehicle}, hidden: {}", hidden.seed, or(there, "nothing"));
        say!("             said: {}, {}", said.verdict, or(named, "no cause"));
        say!("             {}", verdict(played));
    }
}
