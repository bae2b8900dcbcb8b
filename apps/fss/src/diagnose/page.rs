//! The report as one self-contained page: a table of ratios and each channel's residuals over time.

use fss_identify::misfit::ChannelMisfit;
use std::fmt::Write;

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 130.0;
/// The most points that a plot draws; more are thinned to their extremes.
const POINTS: usize = 800;

/// The page.
pub fn render(fitted: &[ChannelMisfit], validation: &[ChannelMisfit]) -> String {
    let mut html = String::from(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>fss diagnose</title><style>\
         body{font:15px/1.45 system-ui,sans-serif;max-width:900px;margin:2em auto;padding:0 1em;color:#222}\
         table{border-collapse:collapse}td,th{padding:.2em .7em;text-align:right;border-bottom:1px solid #ddd}\
         td:first-child,th:first-child{text-align:left}.far{background:#fbd9d3}.near{background:#e4f3e1}\
         h3{margin:1.4em 0 .2em;font-size:1em}svg{display:block}</style>\
         <h1>Where the simulation is wrong</h1>\
         <p>RMS of measured less simulated over what noise alone would give, in windows with an initial state of their \
         own. 1 is noise; above 1.3 the simulation misses something. Causes are not named by this version.</p>",
    );
    table(&mut html, fitted, validation);
    for (misfits, kind) in [(fitted, ""), (validation, " (validation)")] {
        for m in misfits {
            let _ = write!(
                html,
                "<h3>{}{kind}: {} &mdash; RMS {:.3e}, noise {:.3e}, ratio {:.2}</h3>",
                escape(&m.run),
                escape(&m.channel),
                m.rms,
                m.noise,
                m.ratio()
            );
            plot(&mut html, m);
        }
    }
    html.push_str("</html>\n");
    html
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
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
                    let class = if m.ratio() > super::MISFIT_RATIO { "far" } else { "near" };
                    let _ = write!(html, "<td class=\"{class}\">{:.2}</td>", m.ratio());
                }
                None => html.push_str("<td>&ndash;</td>"),
            }
        }
        html.push_str("</tr>");
    }
    html.push_str("</table>");
}

/// Residuals over time with a band of two standard deviations of the noise.
fn plot(html: &mut String, m: &ChannelMisfit) {
    let (Some(first), Some(last)) = (m.residuals.first(), m.residuals.last()) else { return };
    let span_s = (last.0 - first.0).max(1e-9);
    let top = m.residuals.iter().map(|r| r.1.abs()).fold(3.0 * m.noise, f64::max).max(1e-12);
    let x = |t: f64| 60.0 + (WIDTH - 70.0) * (t - first.0) / span_s;
    let y = |v: f64| HEIGHT / 2.0 - (HEIGHT / 2.0 - 12.0) * v / top;
    let _ = write!(html, "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"100%\" role=\"img\">");
    let (band_top, band) = (y(2.0 * m.noise), y(-2.0 * m.noise) - y(2.0 * m.noise));
    let _ = write!(
        html,
        "<rect x=\"60\" y=\"{band_top:.1}\" width=\"{:.1}\" height=\"{band:.1}\" fill=\"#dbe9f6\"/>",
        WIDTH - 70.0
    );
    let _ = write!(html, "<path d=\"M60 {0:.1}H{1}\" stroke=\"#999\"/>", y(0.0), WIDTH - 10.0);
    html.push_str("<path fill=\"none\" stroke=\"#b3402a\" stroke-width=\"1\" d=\"");
    for (i, (t, v)) in thinned(&m.residuals).into_iter().enumerate() {
        let _ = write!(html, "{}{:.1} {:.1}", if i == 0 { "M" } else { "L" }, x(t), y(v));
    }
    html.push_str("\"/><g font-size=\"11\" fill=\"#555\">");
    let _ = write!(
        html,
        "<text x=\"2\" y=\"14\">{top:.2e}</text><text x=\"2\" y=\"{:.0}\">{:.2e}</text>",
        HEIGHT - 4.0,
        -top
    );
    let _ = write!(
        html,
        "<text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"end\">{:.1} s</text></g></svg>",
        WIDTH - 10.0,
        HEIGHT - 2.0,
        last.0
    );
}

/// At most about [`POINTS`] points: of each bin its smallest and its largest value, so that nothing that stands out is lost.
fn thinned(residuals: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let bin = (2 * residuals.len()).div_ceil(POINTS).max(1);
    if bin <= 2 {
        return residuals.to_vec();
    }
    let mut out = Vec::with_capacity(POINTS + 2);
    for chunk in residuals.chunks(bin) {
        let by_value = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (Some(low), Some(high)) = (chunk.iter().min_by(by_value), chunk.iter().max_by(by_value)) else { continue };
        let (a, b) = if low.0 <= high.0 { (low, high) } else { (high, low) };
        out.extend([*a, *b]);
    }
    out
}
