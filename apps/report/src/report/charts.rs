//! Everything over time.

use super::WIDTH;
use super::flight::Flight;
use crate::drawing::plane::picture;
use crate::drawing::strips::{COLOURS, Line, Mark, Strips};
use fss_launcher::summary::{Navigation, navigation_error};
use fss_messages::{Event, LinksState, NavState, text_of};
use std::fmt::Write;

/// Height of a strip, in the picture's own units.
const HEIGHT: f64 = 78.0;
/// While the filter settles or coasts its bound is far out: it is cut off at so many times the largest error.
const BOUND_CUT: f64 = 3.0;

/// Strips over the whole flight, with the phases through them.
pub(super) fn strips(flight: &Flight, span_s: [f64; 2]) -> Strips {
    let mut strips = Strips::new([0.0, 0.0], WIDTH, span_s);
    strips.through(flight.phases().iter().map(|phase| phase.during_s[0]));
    strips
}

/// The strips as a picture.
pub(super) fn finish(html: &mut String, strips: Strips) {
    let (svg, bottom) = strips.finish();
    html.push_str(&picture([WIDTH, bottom], &svg));
}

/// Pose, rates, joints, torques, valves, gas, with phases and events.
pub(super) fn over_time(html: &mut String, flight: &Flight) {
    let mut strips = strips(flight, flight.span_s());
    strips.band("phase", &flight.phases());
    strips.marks("events", &marks(flight));
    motion(&mut strips, flight);
    joints(&mut strips, flight);
    strips.raster("valves open, thruster by thruster", &flight.openings());
    let truth = flight.records.truth();
    if flight.has_truth() {
        let gas = flight.series(truth, |t| t.gas_used_kg * 1e3);
        strips.lines("gas used, g", 0.6 * HEIGHT, 0.1, &[Line { name: "", colour: COLOURS[0], points: gas }]);
    }
    finish(html, strips);
    let source = if flight.has_truth() { "the truth of the simulated laboratory" } else { "navigation" };
    let _ = write!(
        html,
        "<p class=\"caption\">Pose and rates of the base from {source}, joints and torques from the links' telemetry, valves \
         from their driver. Dashed: where a phase begins. Point at a mark to read its event.</p>"
    );
}

fn motion(strips: &mut Strips, flight: &Flight) {
    let (truth, nav) = (flight.records.truth(), flight.records.nav());
    let line = |name, k: usize, points| Line { name, colour: COLOURS[k], points };
    macro_rules! field {
        ($name:ident) => {
            if flight.has_truth() { flight.series(truth, |s| s.$name) } else { flight.series(nav, |s| s.$name) }
        };
    }
    strips.lines("base position, m", HEIGHT, 0.02, &[line("x", 0, field!(x_m)), line("y", 1, field!(y_m))]);
    let degrees = |points: Vec<(f64, f64)>| points.into_iter().map(|(t, v)| (t, v.to_degrees())).collect::<Vec<_>>();
    let milli = |points: Vec<(f64, f64)>| points.into_iter().map(|(t, v)| (t, v * 1e3)).collect::<Vec<_>>();
    strips.lines("base heading, deg", HEIGHT, 0.5, &[line("", 0, degrees(field!(theta_rad)))]);
    let velocity = [line("vx", 0, milli(field!(vx_m_s))), line("vy", 1, milli(field!(vy_m_s)))];
    strips.lines("base velocity, mm/s", HEIGHT, 2.0, &velocity);
    strips.lines("base rate, deg/s", HEIGHT, 0.1, &[line("", 0, degrees(field!(omega_rad_s)))]);
}

fn joints(strips: &mut Strips, flight: &Flight) {
    let names: Vec<String> = (1..=flight.stack.plant.link_count()).map(|k| format!("joint {k}")).collect();
    let each = |of: &dyn Fn(&LinksState, usize) -> f64| -> Vec<Line<'_>> {
        let line = |(k, name)| {
            let points = flight.series(&flight.links, |l| if l.alive[k] == 0 { f64::NAN } else { of(l, k) });
            Line { name, colour: COLOURS[k % COLOURS.len()], points }
        };
        names.iter().map(String::as_str).enumerate().map(line).collect()
    };
    strips.lines("joint angles, deg", HEIGHT, 1.0, &each(&|l, k| l.q_rad[k].to_degrees()));
    strips.lines("joint rates, deg/s", HEIGHT, 0.5, &each(&|l, k| l.qd_rad_s[k].to_degrees()));
    strips.lines("joint torques, N m", HEIGHT, 0.1, &each(&|l, k| l.torque_nm[k]));
}

fn marks(flight: &Flight) -> Vec<Mark> {
    let colour = |severity| match severity {
        0..=Event::INFO => "#8a8a86",
        Event::WARNING => "#d98b00",
        _ => "#b3402a",
    };
    let events = flight.records.events().iter().filter(|event| event.severity >= Event::INFO);
    let mark = |event: &Event| Mark {
        at_s: flight.seconds(event.stamp_ns),
        colour: colour(event.severity),
        text: format!("{}: {}", text_of(&event.service), text_of(&event.text)),
    };
    events.map(mark).collect()
}

/// Error of the estimate with what the filter says of it.
pub(super) fn navigation(html: &mut String, flight: &Flight, figures: Option<&Navigation>) {
    let Some(figures) = figures else {
        html.push_str("<p>The log holds no truth to compare with.</p>");
        return;
    };
    let truth = flight.records.truth();
    let mut errors: [Vec<(f64, f64)>; 3] = Default::default();
    let mut bounds: [Vec<(f64, f64)>; 3] = Default::default();
    for nav in flight.records.nav().iter().filter(|nav| nav.mode != NavState::INITIALISING) {
        let Some(error) = navigation_error(nav, truth) else { continue };
        let scale = [1e3, 1e3, 1_f64.to_degrees()];
        for i in 0..3 {
            let t_s = flight.seconds(nav.stamp_ns);
            errors[i].push((t_s, error[i] * scale[i]));
            bounds[i].push((t_s, 3.0 * nav.std[i] * scale[i]));
        }
    }
    let _ = write!(
        html,
        "<p>Root mean square: {:.3} mm in position ({:.3} mm at most), {:.4} deg in heading.</p>",
        figures.position_rms_m * 1e3,
        figures.position_max_m * 1e3,
        figures.heading_rms_deg
    );
    let mut strips = strips(flight, flight.span_s());
    for ((title, error), bound) in
        ["error in x, mm", "error in y, mm", "error in heading, deg"].into_iter().zip(errors).zip(bounds)
    {
        let cut = BOUND_CUT * error.iter().map(|(_, v)| v.abs()).fold(1e-9, f64::max);
        let bound: Vec<_> = bound.into_iter().map(|(t, v)| (t, v.min(cut))).collect();
        let below = bound.iter().map(|(t, v)| (*t, -v)).collect();
        let lines = [
            Line { name: "three standard deviations of the filter", colour: "#8aa9c4", points: bound },
            Line { name: "", colour: "#8aa9c4", points: below },
            Line { name: "estimate less truth", colour: COLOURS[1], points: error },
        ];
        strips.lines(title, HEIGHT, 1e-3, &lines);
    }
    finish(html, strips);
}
