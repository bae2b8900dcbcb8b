//! One game as a story.

use super::hidden::{Kind, short};
use super::play::{ENVELOPE_FILE, Played};
use super::score::VISIBLE_DOSE;
use std::path::Path;

/// Tells what was said, what was hidden, and how good that is.
pub fn tell(played: &Played, folder: &Path) {
    let Played { hidden, said, score, .. } = played;
    say!("Challenge of seed {}", hidden.seed);
    say!("  flown in {:.1} s, diagnosed in {:.1} s\n", played.flown_in_s, played.diagnosed_in_s);
    say!("The diagnosis says: {}", said.verdict.replace('_', " "));
    for cause in &said.causes {
        say!("  {:3.0} %  {}", cause.probability * 100.0, cause.record);
        for (name, value) in &cause.record.parameters {
            if let Some(std) = cause.std.get(name) {
                say!("           {name} = {} +- {}", short(*value), short(*std));
            }
        }
        for (record, probability) in &cause.alternatives {
            say!("    or {:3.0} %  {record}", probability * 100.0);
        }
    }
    say!(
        "  RMS over the noise floor on the validation run: {:.2}, with its model {:.2}\n",
        said.ratio_before,
        said.ratio_after
    );

    say!("The envelope ({}) says:", folder.join(ENVELOPE_FILE).display());
    if hidden.effects.is_empty() {
        say!("  nothing is hidden");
    }
    for effect in &hidden.effects {
        say!("  {}, dose {:.2}", effect.record, effect.dose);
    }
    say!("\n{}", verdict(played));
    if let Some(error) = score.errors.first() {
        let covered = score.covered.iter().filter(|covered| **covered).count();
        say!("  error {:.1} %, {covered} of {} values within their 90 % interval", error * 100.0, score.covered.len());
    }
}

/// The judgement, in one sentence.
pub fn verdict(played: &Played) -> String {
    let Played { hidden, score, .. } = played;
    let is_visible = hidden.effects.iter().any(|e| e.clear_dose() >= VISIBLE_DOSE);
    let wrongly = match score.named_wrongly {
        0 => String::new(),
        n => format!(" It is sure of {n} that is not there."),
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
        _ => match score.set {
            Some((true, count)) => return format!("Undecided: the cause is among its {count}.{wrongly}"),
            _ if score.named == 0 => "Seen, but not named.",
            _ => "Wrong: that is not the cause.",
        },
    };
    format!("{sentence}{wrongly}")
}
