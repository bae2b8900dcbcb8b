//! Why a person should believe that a capture succeeded: how gripper and handle met, and that momentum went nowhere.

use super::WIDTH;
use super::charts::finish;
use super::flight::Flight;
use crate::drawing::page;
use crate::drawing::strips::{COLOURS, Line, Strips};
use fss_lab::{GRIPPER_REACH_M, GRIPPER_SPEED_M_S};
use fss_launcher::figures::{CaptureFigures, StopFigures, momenta};
use fss_messages::{MissionState, TruthState};
use std::fmt::Write;

const HEIGHT: f64 = 84.0;
/// The meeting is shown from so long before the grasp, where the arm's reach began later from there, s.
const LONGEST_APPROACH_S: f64 = 25.0;
/// Momentum is shown so long before the grasp, and at most so long after it, s.
const BEFORE_S: f64 = 8.0;
const AFTER_S: f64 = 20.0;
/// And at every so many samples of the truth.
const EVERY: usize = 4;

/// What the log shows of the capture.
pub(super) fn section(html: &mut String, flight: &Flight, capture: &CaptureFigures, stop: Option<&StopFigures>) {
    let truth = flight.records.truth();
    let (Some(last), Some(grasp_s)) = (truth.last(), flight.grasp_s()) else {
        html.push_str("<p>The gripper took nothing.</p>");
        return;
    };
    let held = if last.target_held != 0 {
        format!("From {grasp_s:.2} s on the laboratory holds the handle in the gripper, until the end of the log.")
    } else {
        format!("The gripper took the handle at {grasp_s:.2} s and let it go again.")
    };
    let _ = write!(
        html,
        "<p>{held} It takes it only within {:.0} mm and at no more than {:.0} mm/s; the contact is plastic. What follows is \
         the laboratory's truth, not what the flight software believed.</p>",
        GRIPPER_REACH_M * 1e3,
        GRIPPER_SPEED_M_S * 1e3
    );
    let before = truth.partition_point(|t| t.target_held == 0 && t.grasp_ns == 0);
    at_the_grasp(html, capture, stop, before.checked_sub(1).and_then(|i| truth.get(i)), last);
    meeting(html, flight, grasp_s);
    momentum_table(html, flight, last, before.checked_sub(1).and_then(|i| truth.get(i)));
    around_the_grasp(html, flight, grasp_s);
}

fn at_the_grasp(
    html: &mut String,
    capture: &CaptureFigures,
    stop: Option<&StopFigures>,
    before: Option<&TruthState>,
    last: &TruthState,
) {
    let mut rows = vec![
        vec!["distance of gripper and handle".to_owned(), format!("{:.2} mm", last.grasp_miss_m * 1e3)],
        vec!["speed of the gripper past the handle".to_owned(), format!("{:.2} mm/s", last.grasp_speed_m_s * 1e3)],
    ];
    if let Some(t) = before {
        let facing = t.ee[2] - t.target[2] - std::f64::consts::PI;
        let facing_deg = facing.sin().atan2(facing.cos()).to_degrees();
        rows.push(vec!["angle between gripper and handle".to_owned(), format!("{facing_deg:.2} deg")]);
        let turning = t.target_rate[2].to_degrees();
        let drift = t.target_rate[0].hypot(t.target_rate[1]) * 1e3;
        rows.push(vec!["the target moved with".to_owned(), format!("{drift:.2} mm/s, {turning:.3} deg/s")]);
    }
    if let Some(turned) = capture.base_turned_deg {
        let what = "the base turned while the arm reached, at most".to_owned();
        rows.push(vec![what, format!("{turned:.2} deg")]);
    }
    let nearest = "nearest that anything came to the table's edge".to_owned();
    rows.push(vec![nearest, format!("{:.2} m", capture.room_on_table_m)]);
    if let Some(stop) = stop {
        let ([v0, v1], [w0, w1]) = (stop.speed_m_s.map(|v| v * 1e3), stop.rate_deg_s);
        rows.push(vec!["the compound before its stop".to_owned(), format!("{v0:.2} mm/s, {w0:.3} deg/s")]);
        rows.push(vec!["the compound at the end".to_owned(), format!("{v1:.2} mm/s, {w1:.3} deg/s")]);
    }
    page::table(html, "numbers", &["at the grasp, and after", ""], rows);
}

/// Gripper and handle from the arm's reach to the grasp, in the target's axes.
fn meeting(html: &mut String, flight: &Flight, grasp_s: f64) {
    let truth = flight.records.truth();
    let states = flight.records.states();
    let reach = states.iter().find(|s| s.arm_mode == MissionState::ARM_CAPTURE);
    let reach_s = reach.map_or(0.0, |s| flight.seconds(s.stamp_ns));
    let from_s = reach_s.max(grasp_s - LONGEST_APPROACH_S);
    let Some(disc) = flight.table().target else { return };
    let approach: Vec<(f64, [f64; 2])> = truth
        .iter()
        .filter(|t| t.target_held == 0 && t.grasp_ns == 0)
        .map(|t| (flight.seconds(t.stamp_ns), in_target_axes(t, disc.radius_m)))
        .filter(|(t_s, _)| *t_s >= from_s)
        .collect();
    let along = |k: usize| approach.iter().map(|(t_s, apart)| (*t_s, apart[k] * 1e3)).collect::<Vec<(f64, f64)>>();
    let speed = approach.windows(2).map(|pair| {
        let ([(t0, a), (t1, b)], per_s) = ([pair[0], pair[1]], 1e3 / (pair[1].0 - pair[0].0).max(1e-9));
        (0.5 * (t0 + t1), (b[0] - a[0]).hypot(b[1] - a[1]) * per_s)
    });
    let mut strips = Strips::new([0.0, 0.0], WIDTH, [from_s, grasp_s + 0.02 * (grasp_s - from_s)]);
    let lines = [
        Line { name: "outwards from the handle", colour: COLOURS[0], points: along(0) },
        Line { name: "across", colour: COLOURS[1], points: along(1) },
    ];
    strips.lines("gripper from handle, mm", HEIGHT, 1.0, &lines);
    let speed = [Line { name: "", colour: COLOURS[0], points: speed.collect() }];
    strips.lines("speed of the gripper relative to the handle, mm/s", HEIGHT, 1.0, &speed);
    html.push_str("<h3>Gripper and handle meet</h3>");
    finish(html, strips);
    html.push_str(
        "<p class=\"caption\">In axes that turn with the target, so that both are zero where gripper and handle are one \
         and at rest with each other.</p>",
    );
}

/// The end-effector from the handle, in the target's axes: outwards, across, m.
fn in_target_axes(t: &TruthState, radius_m: f64) -> [f64; 2] {
    let (sin, cos) = t.target[2].sin_cos();
    let (dx, dy) = (t.ee[0] - t.target[0], t.ee[1] - t.target[1]);
    [cos * dx + sin * dy - radius_m, cos * dy - sin * dx]
}

/// Momentum just before and just after, as the laboratory computed it in the step of the grasp.
fn momentum_table(html: &mut String, flight: &Flight, last: &TruthState, before: Option<&TruthState>) {
    html.push_str("<h3>Momentum goes nowhere</h3>");
    let parts = before.and_then(|t| momenta(flight.stack.laboratory(), t));
    let told = |p: Option<[f64; 3]>, axis: usize| p.map_or_else(|| "-".to_owned(), |p| format!("{:+.6}", p[axis]));
    let rows =
        ["x, kg m/s", "y, kg m/s", "about the table's middle, kg m²/s"].into_iter().enumerate().map(|(i, name)| {
            let (was, is) = (last.grasp_momentum_before[i], last.grasp_momentum_after[i]);
            vec![
                name.to_owned(),
                told(parts.map(|p| p.0), i),
                told(parts.and_then(|p| p.1), i),
                format!("{was:+.6}"),
                format!("{is:+.6}"),
                format!("{:.1e}", (is - was).abs()),
            ]
        });
    let header =
        ["momentum", "vehicle before", "target before", "both just before", "compound just after", "difference"];
    page::table(html, "numbers", &header, rows);
}

/// The same over some seconds, vehicle and target apart and together.
fn around_the_grasp(html: &mut String, flight: &Flight, grasp_s: f64) {
    let plant = flight.stack.laboratory();
    let span_s = [grasp_s - BEFORE_S, flight.span_s()[1].min(grasp_s + AFTER_S)];
    let mut sums: [Vec<(f64, f64)>; 3] = Default::default();
    let mut vehicle = sums.clone();
    let mut target = sums.clone();
    for t in flight.records.truth().iter().step_by(EVERY) {
        let t_s = flight.seconds(t.stamp_ns);
        if t_s < span_s[0] || t_s > span_s[1] {
            continue;
        }
        let Some((of_vehicle, of_target)) = momenta(plant, t) else { continue };
        for i in 0..3 {
            sums[i].push((t_s, of_vehicle[i] + of_target.map_or(0.0, |p| p[i])));
            vehicle[i].push((t_s, if of_target.is_some() { of_vehicle[i] } else { f64::NAN }));
            target[i].push((t_s, of_target.map_or(f64::NAN, |p| p[i])));
        }
    }
    let mut strips = Strips::new([0.0, 0.0], WIDTH, span_s);
    strips.through([grasp_s]);
    let titles = ["momentum along x, kg m/s", "along y, kg m/s", "about the table's middle, kg m²/s"];
    for (((title, sums), vehicle), target) in titles.into_iter().zip(sums).zip(vehicle).zip(target) {
        let lines = [
            Line { name: "vehicle", colour: COLOURS[0], points: vehicle },
            Line { name: "target", colour: COLOURS[2], points: target },
            Line { name: "both", colour: "#222", points: sums },
        ];
        strips.lines(title, HEIGHT, 1e-3, &lines);
    }
    finish(html, strips);
    html.push_str(
        "<p class=\"caption\">Dashed: the grasp. Up to it no thruster fires in the phase of the reach, so that the sum may \
         change by no more than the room's air gives; after it the stop brings the compound to rest.</p>",
    );
}
