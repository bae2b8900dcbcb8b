//! The report as one self-contained page: verdict, causes, gain, where, what was considered, residuals before and after.

use super::summary;
use crate::drawing::page::{self, escape};
use crate::drawing::strips::{Line, Strips};
use fss_diagnosis::diagnosis::{ChannelMisfit, Diagnosis};
use fss_experiments::measured::Run;
use std::fmt::Write;

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 130.0;

/// The page.
pub(super) fn render(diagnosis: &Diagnosis, runs: &[Run]) -> String {
    let mut html = page::head("fss diagnose", "Diagnosis");
    let _ = write!(html, "<p class=\"verdict\">{}</p>", escape(summary::headline(diagnosis)));
    for remark in &diagnosis.remarks {
        let _ = write!(html, "<p>{}</p>", escape(remark));
    }
    causes(&mut html, diagnosis);
    missing_pulses(&mut html, diagnosis);
    gain(&mut html, diagnosis);
    html.push_str(
        "<h2>Where the simulation is wrong</h2><p>RMS error over what noise alone would give, the plant's uncertain values as the data \
         settle them. 1 is noise.</p>",
    );
    table(&mut html, &diagnosis.before, &diagnosis.validation_before);
    unexplained(&mut html, diagnosis);
    considered(&mut html, diagnosis);
    let _ = write!(
        html,
        "<h2>Residuals before and after</h2><p>{} runs fitted. The band is two standard deviations of the noise.</p>",
        runs.len()
    );
    for (before, after, kind) in [
        (&diagnosis.before, &diagnosis.after, ""),
        (&diagnosis.validation_before, &diagnosis.validation_after, " (validation)"),
    ] {
        residuals(&mut html, before, after, kind);
    }
    html.push_str(page::FOOT);
    html
}

/// What is asserted, and what is not.
fn causes(html: &mut String, diagnosis: &Diagnosis) {
    for (list, title) in [(&diagnosis.causes, "Causes"), (&diagnosis.suspects, "Probable, but not asserted")] {
        if list.is_empty() {
            continue;
        }
        let _ = write!(html, "<h2>{title}</h2>");
        for cause in list {
            let _ = write!(
                html,
                "<h3>{} &mdash; probability {:.3}</h3><p>{}</p><table><tr><th>parameter</th><th>value</th><th>standard deviation</th></tr>",
                escape(&summary::title(cause)),
                cause.probability,
                escape(cause.effect.about().sentence)
            );
            for (i, (p, v)) in cause.effect.about().parameters.iter().zip(cause.effect.values()).enumerate() {
                let std = cause.std.get(i).map_or("&ndash;".to_owned(), |s| format!("{s:.2e}"));
                let _ = write!(html, "<tr><td>{} ({})</td><td>{v:.6}</td><td>{std}</td></tr>", p.meaning, p.name);
            }
            html.push_str("</table>");
            if !cause.alternatives.is_empty() {
                html.push_str("<p>Or, in its place:</p><ul>");
                for other in &cause.alternatives {
                    let _ = write!(
                        html,
                        "<li>{} &mdash; probability {:.3}</li>",
                        escape(&other.effect.to_string()),
                        other.probability
                    );
                }
                html.push_str("</ul>");
            }
            let validation =
                cause.validation_nats.map_or_else(String::new, |n| format!(", of the validation runs by {n:.1}"));
            let _ = write!(
                html,
                "<p>It raises the logarithm of the predictive density of each fitted run, predicted from the others, by {:.1} nats \
                 in all{validation}.</p>",
                cause.left_out_nats
            );
        }
    }
}

/// Single pulses that a thruster did not deliver.
fn missing_pulses(html: &mut String, diagnosis: &Diagnosis) {
    if diagnosis.missing_pulses.is_empty() {
        return;
    }
    html.push_str(
        "<h2>Pulses that were commanded and not delivered</h2><table><tr><th>run</th><th>thruster</th><th>from (s)</th>\
         <th>to (s)</th><th>probability</th></tr>",
    );
    for pulse in &diagnosis.missing_pulses {
        let _ = write!(
            html,
            "<tr><td>{}</td><td>{}</td><td>{:.2}</td><td>{:.2}</td><td>{:.3}</td></tr>",
            escape(&pulse.run),
            pulse.thruster,
            pulse.from_s,
            pulse.to_s,
            pulse.probability
        );
    }
    html.push_str("</table>");
}

/// What the extension gains, by channel, as bars.
fn gain(html: &mut String, diagnosis: &Diagnosis) {
    let on_validation = !diagnosis.validation_before.is_empty();
    let (before, after) = if on_validation {
        (&diagnosis.validation_before, &diagnosis.validation_after)
    } else {
        (&diagnosis.before, &diagnosis.after)
    };
    let _ = write!(
        html,
        "<h2>What knowing it gains</h2><p>RMS over the noise on the {} runs: <b>{:.3}</b> with the plant file, <b>{:.3}</b> \
         with the extended model (extended.toml); 1 is the floor.</p>",
        if on_validation { "validation" } else { "fitted" },
        diagnosis.gain.before,
        diagnosis.gain.after
    );
    let top = before.iter().chain(after).map(ChannelMisfit::ratio).filter(|r| r.is_finite()).fold(2.0, f64::max);
    let row = 17.0;
    let height = row * before.len() as f64 + 24.0;
    let x = |ratio: f64| 230.0 + (WIDTH - 330.0) * (1.0 + ratio).ln() / (1.0 + top).ln();
    let _ = write!(html, "<svg viewBox=\"0 0 {WIDTH} {height}\" width=\"100%\" role=\"img\"><g font-size=\"11\">");
    for (i, b) in before.iter().enumerate().filter(|(_, m)| m.ratio().is_finite()) {
        let y = row * i as f64 + 4.0;
        let a = after.iter().find(|m| m.run == b.run && m.channel == b.channel).map_or(f64::NAN, ChannelMisfit::ratio);
        let _ = write!(
            html,
            "<text x=\"224\" y=\"{:.0}\" text-anchor=\"end\">{} {}</text>\
             <rect x=\"230\" y=\"{y:.0}\" width=\"{:.1}\" height=\"6\" fill=\"#d98b7a\"/>\
             <rect x=\"230\" y=\"{:.0}\" width=\"{:.1}\" height=\"6\" fill=\"#4f8f63\"/>\
             <text x=\"{:.1}\" y=\"{:.0}\">{:.2} &rarr; {a:.2}</text>",
            y + 10.0,
            escape(&b.run),
            escape(&b.channel),
            x(b.ratio()) - 230.0,
            y + 6.0,
            (x(a) - 230.0).max(0.0),
            x(b.ratio().max(a)) + 4.0,
            y + 10.0,
            b.ratio()
        );
    }
    let _ = write!(html, "<path d=\"M{0:.1} 0V{height}\" stroke=\"#555\" stroke-dasharray=\"3 3\"/></g></svg>", x(1.0));
}

/// Strengths of the structured discrepancy, and laws that are no known effect's.
fn unexplained(html: &mut String, diagnosis: &Diagnosis) {
    if diagnosis.discrepancy.is_empty() {
        return;
    }
    html.push_str(
        "<h2>Structured discrepancy</h2><p>Forces and torques beside the model that the data need, as inferred, and as the plant \
         file states them or a good laboratory has them.</p><table><tr><th></th><th>inferred</th><th>expected</th></tr>",
    );
    for d in &diagnosis.discrepancy {
        let class = if d.inferred > d.expected { "far" } else { "near" };
        let _ = write!(
            html,
            "<tr><td>{}</td><td class=\"{class}\">{:.2e}</td><td>{:.2e}</td></tr>",
            escape(&d.name),
            d.inferred,
            d.expected
        );
    }
    html.push_str("</table>");
    if !diagnosis.laws.is_empty() {
        html.push_str("<p>The extended model has laws that are no known effect's:</p><ul>");
        for law in &diagnosis.laws {
            let _ = write!(html, "<li>{}</li>", escape(&law.to_string()));
        }
        html.push_str("</ul>");
    }
}

/// Inclusion probabilities.
fn considered(html: &mut String, diagnosis: &Diagnosis) {
    let _ = write!(
        html,
        "<h2>What was considered</h2><p>Posterior probability of each cause; of no cause at all: {:.3}.</p><table><tr><th>cause</th>\
         <th>probability</th></tr>",
        diagnosis.probability_of_none
    );
    for (effect, probability) in &diagnosis.inclusion {
        let _ = write!(html, "<tr><td>{}</td><td>{probability:.3}</td></tr>", escape(&effect.to_string()));
    }
    html.push_str("</table>");
}

/// Residuals of each run, those furthest from their noise open, the others folded.
fn residuals(html: &mut String, before: &[ChannelMisfit], after: &[ChannelMisfit], kind: &str) {
    for b in before {
        let Some(a) = after.iter().find(|m| m.run == b.run && m.channel == b.channel) else { continue };
        let open = if b.ratio() > super::summary::FAR { " open" } else { "" };
        let _ = write!(
            html,
            "<details{open}><summary>{}{kind}: {} &mdash; noise {:.2e}, RMS {:.2e} before, {:.2e} after</summary>",
            escape(&b.run),
            escape(&b.channel),
            b.noise,
            b.rms,
            a.rms
        );
        plot(html, b, a);
        html.push_str("</details>");
    }
}

fn table(html: &mut String, fitted: &[ChannelMisfit], validation: &[ChannelMisfit]) {
    let mut channels: Vec<&str> = Vec::new();
    let mut runs: Vec<(&str, &str)> = Vec::new();
    for (misfits, kind) in [(fitted, ""), (validation, " (validation)")] {
        for m in misfits {
            if !channels.contains(&m.channel.as_str()) {
                channels.push(&m.channel);
            }
            if !runs.contains(&(m.run.as_str(), kind)) {
                runs.push((&m.run, kind));
            }
        }
    }
    html.push_str("<table><tr><th>run</th>");
    for channel in &channels {
        let _ = write!(html, "<th>{}</th>", escape(channel));
    }
    html.push_str("</tr>");
    for (run, kind) in runs {
        let _ = write!(html, "<tr><td>{}{kind}</td>", escape(run));
        let of = if kind.is_empty() { fitted } else { validation };
        for channel in &channels {
            match of.iter().find(|m| m.run == run && m.channel == *channel) {
                Some(m) => {
                    let class = if m.ratio() > super::summary::FAR { "far" } else { "near" };
                    let _ = write!(html, "<td class=\"{class}\">{:.2}</td>", m.ratio());
                }
                None => html.push_str("<td>&ndash;</td>"),
            }
        }
        html.push_str("</tr>");
    }
    html.push_str("</table>");
}

/// Residuals over time before and after, with a band of two standard deviations of the noise.
fn plot(html: &mut String, before: &ChannelMisfit, after: &ChannelMisfit) {
    let (Some(first), Some(last)) = (before.residuals.first(), before.residuals.last()) else { return };
    let mut strips = Strips::new([0.0, 0.0], WIDTH, [first.0, last.0]);
    let line = |name, misfit: &ChannelMisfit, colour| Line { name, colour, points: misfit.residuals.clone() };
    let lines = [line("before", before, "#b3402a"), line("after", after, "#2f7d4f")];
    strips.lines_in_band("", HEIGHT, 6.0 * before.noise, &lines, Some(2.0 * before.noise));
    let (svg, height) = strips.finish();
    let _ = write!(html, "<svg viewBox=\"0 0 {WIDTH} {height}\" width=\"100%\" role=\"img\">{svg}</svg>");
}
