//! `fss report`: one page about a flight, for a paper's appendix: what flew, how it went, and why to believe it.

mod capture;
mod charts;
mod flight;
mod tables;

use crate::drawing::page;
use crate::drawing::plane::picture;
use crate::drawing::scene::{Cut, from_above, legend};
use clap::Args;
pub use flight::Flight;
use fss_launcher::files::write;
use fss_records::log::Log;
use miette::{IntoDiagnostic, Result};
use std::fmt::Write;
use std::path::PathBuf;

/// Width of pictures, in their own units.
const WIDTH: f64 = 900.0;
/// How many postures the picture from above shows.
const POSTURES: usize = 7;

/// Write one self-contained HTML page about a flight.
///
/// What flew, the figures of merit, the table from above, everything over time, navigation against truth, the health of each
/// service; of a capture, why to believe it. The page refers to nothing outside itself: it can be mailed, printed, archived.
#[derive(Args)]
pub struct ReportArgs {
    /// The log of `fss run`, or its folder.
    log: PathBuf,
    /// The page to write.
    #[arg(long, value_name = "FILE.html")]
    out: PathBuf,
}

/// Writes the report.
pub fn run(args: &ReportArgs) -> Result<()> {
    let flight = Flight::read(&Log::open(&args.log).into_diagnostic()?)?;
    write(&args.out, &render(&flight))
}

fn render(flight: &Flight) -> String {
    let mission = &flight.stack.mission;
    let summary = flight.records.summary_of(&flight.stack);
    let mut html = page::head(&format!("fss report: {}", mission.name), &mission.name);
    let _ = write!(html, "<p>{}</p>", page::escape(&mission.description));
    tables::verdict(&mut html, flight, &summary);
    html.push_str("<h2>What flew</h2>");
    tables::facts(&mut html, flight, &summary);
    html.push_str("<h2>Figures of merit</h2>");
    tables::figures(&mut html, &summary);
    if let Some(capture) = &summary.capture {
        html.push_str("<h2>Why to believe the capture</h2>");
        capture::section(&mut html, flight, capture, summary.stop.as_ref());
    }
    above(&mut html, flight);
    html.push_str("<h2>Over time</h2>");
    charts::over_time(&mut html, flight);
    html.push_str("<h2>Navigation against truth</h2>");
    charts::navigation(&mut html, flight, summary.navigation.as_ref());
    html.push_str("<h2>Health of the services</h2>");
    tables::health(&mut html, flight, &summary);
    html.push_str("<h2>Events</h2>");
    tables::events(&mut html, flight);
    html.push_str("<h2>The files that flew</h2>");
    for (name, text) in flight.stack.attachments().unwrap_or_default() {
        let _ = write!(html, "<details><summary>{name}</summary><pre>{}</pre></details>", page::escape(&text));
    }
    html.push_str(page::FOOT);
    html
}

/// The table from above, and at which instants.
fn above(html: &mut String, flight: &Flight) {
    let moments = flight.moments();
    if moments.is_empty() {
        return;
    }
    html.push_str("<h2>The table from above</h2>");
    let last = moments.len() - 1;
    let mut instants: Vec<usize> = (0..POSTURES).map(|k| last * k / (POSTURES - 1)).collect();
    if let Some(grasp_s) = flight.grasp_s() {
        // The grasp itself is one of them.
        let at = moments.partition_point(|m| m.t_s < grasp_s).min(last);
        if let Some(nearest) = instants[1..POSTURES - 1].iter_mut().min_by_key(|i| i.abs_diff(at)) {
            *nearest = at;
        }
    }
    let table = flight.table();
    let plot = from_above(&table, &moments, &instants, WIDTH - 90.0, Cut::Tight);
    let size = plot.outer_size();
    html.push_str(&picture(size, &plot.finish()));
    let times: Vec<String> = instants.iter().map(|i| format!("{:.1}", moments[*i].t_s)).collect();
    let _ = write!(
        html,
        "<p class=\"caption\">The vehicle at {} s, the last in full; the ways of {}. Grey is beyond the granite. {}</p>",
        times.join(", "),
        legend("span", table.target.is_some()),
        if flight.has_truth() {
            "From the truth of the simulated laboratory."
        } else {
            "From navigation and telemetry."
        }
    );
}
