//! The answer for a person at a terminal, in the order a person asks: where, what, what else, what it gains.

use fss_diagnosis::diagnosis::{Cause, ChannelMisfit, Diagnosis, Verdict};
use std::collections::BTreeMap;

/// RMS over noise beyond which a channel is shown as wrong.
pub(super) const FAR: f64 = 1.3;

/// A cause at least this probable is decided.
const DECIDED: f64 = 0.9;

/// Prints it.
pub(super) fn print(diagnosis: &Diagnosis) {
    diagnosis.remarks.iter().for_each(|remark| say!("{remark}"));
    table(diagnosis);
    say!("\n{}", headline(diagnosis));
    for cause in &diagnosis.causes {
        print_cause(cause);
    }
    if diagnosis.causes.iter().any(|cause| cause.probability < DECIDED) {
        say!("\nNot all is decided: fss next-experiment finds the maneuver that tells these causes apart best.");
    }
    if !diagnosis.suspects.is_empty() {
        say!("\nProbable, but not asserted:");
        diagnosis.suspects.iter().for_each(print_cause);
    }
    missing_pulses(diagnosis);
    discrepancies(diagnosis);
    if !diagnosis.laws.is_empty() {
        say!("\nThe extended model has laws that are no known effect's:");
        diagnosis.laws.iter().for_each(|law| say!("  {law}"));
    }
    let on = if diagnosis.validation_before.is_empty() { "the fitted runs" } else { "the validation runs" };
    say!(
        "\nRMS over the noise on {on}: {:.3} with the plant file, {:.3} with the extended model\n",
        diagnosis.gain.before,
        diagnosis.gain.after
    );
}

/// Single pulses that a thruster did not deliver.
fn missing_pulses(diagnosis: &Diagnosis) {
    if diagnosis.missing_pulses.is_empty() {
        return;
    }
    say!("\nPulses that were commanded and not delivered");
    say!("  {:<28}{:>9}{:>10}{:>10}{:>13}", "run", "thruster", "from (s)", "to (s)", "probability");
    for p in &diagnosis.missing_pulses {
        say!("  {:<28}{:>9}{:>10.2}{:>10.2}{:>13.3}", p.run, p.thruster, p.from_s, p.to_s, p.probability);
    }
}

/// Strengths of the structured discrepancy that are more than expected.
fn discrepancies(diagnosis: &Diagnosis) {
    if !diagnosis.verdict.leaves_something() || diagnosis.discrepancy.is_empty() {
        return;
    }
    say!("\nStructured discrepancy: inferred, and expected by the plant file or of a good laboratory");
    for d in &diagnosis.discrepancy {
        say!("  {:<40}{:>12.2e}{:>12.2e}", d.name, d.inferred, d.expected);
    }
}

/// The verdict as a sentence.
pub(super) fn headline(diagnosis: &Diagnosis) -> &'static str {
    match diagnosis.verdict {
        Verdict::Consistent => {
            "The simulation is consistent with the data: noise and what the plant file says is uncertain explain them."
        }
        Verdict::Explained => "The simulation is wrong, and this explains it:",
        Verdict::PartlyExplained => "The simulation is wrong, and this explains most of it:",
        Verdict::Unexplained => "The simulation is wrong, and no known effect explains it.",
    }
}

fn print_cause(cause: &Cause) {
    say!("\n  {}  (probability {:.3})", title(cause), cause.probability);
    say!("    {}", cause.effect.about().sentence);
    for (i, (p, v)) in cause.effect.about().parameters.iter().zip(cause.effect.values()).enumerate() {
        match cause.std.get(i) {
            Some(std) => {
                let (digits, space) = (digits_of(*std), if p.unit.is_empty() { "" } else { " " });
                say!("    {:<26}{v:>12.digits$} +- {std:.digits$}{space}{}", p.name, p.unit);
            }
            None => say!("    {:<26}{v:>12}", p.name),
        }
    }
    for other in &cause.alternatives {
        if other.is_equivalent {
            say!("    which these data cannot tell from {}", other.effect);
        } else {
            say!("    or {} (probability {:.3})", other.effect, other.probability);
        }
    }
    if let Some(nats) = cause.validation_nats
        && nats <= 0.0
    {
        say!("    it does not predict the validation runs better ({nats:.1} nats)");
    }
}

/// So many digits after the point show two of a standard deviation.
fn digits_of(std: f64) -> usize {
    if std > 0.0 { (1 - std.log10().floor() as i32).clamp(0, 12) as usize } else { 5 }
}

/// What a cause is and where: `thruster_gain 3 from 12.0 s`.
pub(super) fn title(cause: &Cause) -> String {
    let effect = &cause.effect;
    let index = effect.index().map_or_else(String::new, |i| format!(" {i}"));
    let channel = effect.channel().map_or_else(String::new, |c| format!(" of {c}"));
    let onset = effect.onset_s().map_or_else(String::new, |t| format!(" from {t:.2} s"));
    format!("{}{index}{channel}{onset}", effect.id())
}

/// One row a channel, one column a run: RMS error over what noise alone would give.
fn table(diagnosis: &Diagnosis) {
    let (fitted, validation) = (&diagnosis.before, &diagnosis.validation_before);
    let mut channels: Vec<&str> = Vec::new();
    for m in fitted.iter().chain(validation) {
        if !channels.contains(&m.channel.as_str()) {
            channels.push(&m.channel);
        }
    }
    let mut runs: Vec<(String, BTreeMap<&str, &ChannelMisfit>)> = Vec::new();
    for (misfits, mark) in [(fitted, ""), (validation, " (validation)")] {
        let mut by_run: BTreeMap<&str, BTreeMap<&str, &ChannelMisfit>> = BTreeMap::new();
        for m in misfits {
            by_run.entry(&m.run).or_default().insert(&m.channel, m);
        }
        runs.extend(by_run.into_iter().map(|(run, of_channels)| (format!("{run}{mark}"), of_channels)));
    }
    say!("RMS error over the noise, by channel and run (1 is what noise alone gives)\n");
    runs.iter().enumerate().for_each(|(i, (name, _))| say!("{:>3}  {name}", i + 1));
    say_part!("\n{:<16}", "");
    (1..=runs.len()).for_each(|number| say_part!("{number:>9}"));
    say!();
    for channel in channels {
        say_part!("{channel:<16}");
        for (_, of_channels) in &runs {
            match of_channels.get(channel) {
                Some(m) if m.noise > 0.0 => say_part!("{:>9.2}", m.ratio()),
                Some(m) => say_part!("{:>9}", format!("{:.1e}?", m.rms)),
                None => say_part!("{:>9}", "-"),
            }
        }
        say!();
    }
}
