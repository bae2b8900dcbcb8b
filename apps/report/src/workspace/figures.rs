//! The paper's Figures 6, 7 and 8 for a plant, as pictures.

use super::Look;
use super::contours::{COLOURS, Field};
use crate::drawing::plane::{Plot, picture};
use fss_multibody::{Manipulability, Model, coordinates};
use fss_plant::Plant;
use fss_plant::scene::{Posture, Scene, arc};
use fss_workspace::reach::{Ring, best_manipulability_by_place, reachable_rings};
use std::f64::consts::{PI, TAU};
use std::fmt::Write;

const WIDTH: f64 = 560.0;
const HELD: &str = "fill=\"#dfe8f1\" stroke=\"#37608f\" stroke-width=\"1.5\"";
const EDGE: &str = "stroke=\"#222\" stroke-width=\"1.2\"";
const FLOATING: &str = "fill=\"#f3c9a5\" stroke=\"#b5541c\" stroke-width=\"1.8\"";

/// Figure 6: what the end-effector reaches with the base held, and the best manipulability measure at each place.
pub(super) fn held_workspace(plant: &Plant, model: &Model, limits_rad: &[f64], best: (f64, &[f64])) -> String {
    const BEARINGS: usize = 360;
    const CELL_M: f64 = 0.02;
    let rings = reachable_rings(model, limits_rad);
    let center = model.base().joint1_xy_m;
    let reach_m = rings.last().map_or(0.5, |ring| ring.radius_m);
    let window = 1.08 * reach_m;
    let (x_m, y_m) = ([center[0] - window, center[0] + window], [center[1] - window, center[1] + window]);
    let mut plot = Plot::new("held", [0.0, 0.0], WIDTH, x_m, y_m);
    let by_place = smooth(&best_manipulability_by_place(model, limits_rad, BEARINGS));
    let ring_width_m = model.links().iter().map(|link| link.length_m).sum::<f64>() / by_place.len() as f64;
    let cells = (2.0 * reach_m / CELL_M).ceil() as usize + 1;
    let corner_m = [center[0] - reach_m, center[1] - reach_m];
    let value = |row: usize, column: usize| {
        let (x, y) = (column as f64 * CELL_M - reach_m, row as f64 * CELL_M - reach_m);
        let ring = ((x.hypot(y) / ring_width_m) as usize).min(by_place.len() - 1);
        by_place[ring][((y.atan2(x) + PI) / TAU * BEARINGS as f64) as usize % BEARINGS]
    };
    let values = (0..=cells).map(|row| (0..=cells).map(|column| value(row, column)).collect()).collect();
    let field = Field { corner_m, side_m: CELL_M, values };
    let step = nice_step(best.0 / COLOURS.len() as f64);
    let levels: Vec<f64> = (0..COLOURS.len()).map(|k| k as f64 * step).filter(|level| *level < best.0).collect();
    let outline = outline(&rings, center);
    let mut d = String::new();
    for (i, point) in outline.iter().enumerate() {
        let [x, y] = plot.at(*point);
        let _ = write!(d, "{}{x:.1} {y:.1}", if i == 0 { "M" } else { "L" });
    }
    let mut all = levels.clone();
    all[0] = -1.0;
    let bands = field.bands(&plot, &all);
    plot.clipped(&format!(
        "<clipPath id=\"reach\"><path d=\"{d}Z\"/></clipPath><g clip-path=\"url(#reach)\">{bands}</g>"
    ));
    // Where a ring goes all the way around there is no edge.
    let is_open = |ring: &Ring| ring.angles_rad[1] - ring.angles_rad[0] < TAU - 1e-9;
    for part in rings.chunk_by(|a, b| is_open(a) == is_open(b)).filter(|part| is_open(&part[0])) {
        for side in [0, 1] {
            let edge: Vec<[f64; 2]> = part.iter().map(|ring| on_ring(ring, center, ring.angles_rad[side])).collect();
            plot.line(&edge, EDGE);
        }
    }
    for ring in rings.first().into_iter().chain(rings.last()) {
        plot.line(&arc(center, ring.radius_m, ring.angles_rad[0], ring.angles_rad[1]), EDGE);
    }
    plot.scene(&Scene::of(plant, None), &Posture::of(model, [0.0; 3], best.1), 1.0);
    let size = plot.outer_size();
    let mut content = plot.finish();
    content.push_str(&legend([size[0] + 6.0, 34.0], size[1] - 80.0, &levels, step));
    picture([size[0] + 120.0, size[1]], &content)
}

/// The field with gaps of the search filled and its graininess taken off: the largest of near neighbours, then means.
fn smooth(by_place: &[Vec<Option<f64>>]) -> Vec<Vec<f64>> {
    let around = |ring: usize| ring.saturating_sub(3)..(ring + 4).min(by_place.len());
    let bearings = by_place.first().map_or(0, Vec::len);
    let largest: Vec<Vec<f64>> = (0..by_place.len())
        .map(|ring| (0..bearings).map(|b| around(ring).filter_map(|r| by_place[r][b]).fold(0.0, f64::max)).collect())
        .collect();
    // Past the edge of the reach the nearest value inside goes on, so that the outline alone draws the edge.
    let filled: Vec<Vec<f64>> = largest
        .iter()
        .map(|row| {
            let at = |b: usize, turn: usize| row[(b + turn) % bearings].max(row[(b + bearings - turn) % bearings]);
            (0..bearings).map(|b| (0..=8).map(|turn| at(b, turn)).find(|value| *value > 0.0).unwrap_or(0.0)).collect()
        })
        .collect();
    (0..filled.len())
        .map(|ring| {
            let near = around(ring);
            (0..bearings).map(|b| near.clone().map(|r| filled[r][b]).sum::<f64>() / near.len() as f64).collect()
        })
        .collect()
}

fn on_ring(ring: &Ring, center: [f64; 2], angle_rad: f64) -> [f64; 2] {
    [center[0] + ring.radius_m * angle_rad.cos(), center[1] + ring.radius_m * angle_rad.sin()]
}

/// The edge of the reach, all the way around.
fn outline(rings: &[Ring], center: [f64; 2]) -> Vec<[f64; 2]> {
    let at = |ring: &Ring, angle: f64| on_ring(ring, center, angle);
    let mut points: Vec<[f64; 2]> = rings.iter().map(|ring| at(ring, ring.angles_rad[0])).collect();
    if let Some(last) = rings.last() {
        points.extend(arc(center, last.radius_m, last.angles_rad[0], last.angles_rad[1]));
    }
    points.extend(rings.iter().rev().map(|ring| at(ring, ring.angles_rad[1])));
    if let Some(first) = rings.first() {
        points.extend(arc(center, first.radius_m, first.angles_rad[1], first.angles_rad[0]));
    }
    points
}

fn nice_step(rough: f64) -> f64 {
    let power = 10_f64.powf(rough.log10().floor());
    [1.0, 2.0, 2.5, 5.0, 10.0].into_iter().map(|k| k * power).find(|step| *step >= rough).unwrap_or(rough)
}

fn legend(corner: [f64; 2], height: f64, levels: &[f64], step: f64) -> String {
    let [left, top] = corner;
    let each = height / levels.len() as f64;
    let mut svg = String::new();
    for (k, (level, colour)) in levels.iter().zip(COLOURS).enumerate() {
        let y = top + height - each * (k as f64 + 1.0);
        let _ = write!(
            svg,
            "<rect x=\"{left:.1}\" y=\"{y:.1}\" width=\"18\" height=\"{each:.1}\" fill=\"{colour}\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\">{level:.2}</text>",
            left + 24.0,
            y + each + 4.0
        );
    }
    let _ = write!(
        svg,
        "<text x=\"{0:.1}\" y=\"{1:.1}\">{2:.2}</text><rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"18\" height=\"{height:.1}\" \
         fill=\"none\" stroke=\"#444\"/><text transform=\"translate({3:.1} {4:.1}) rotate(-90)\" text-anchor=\"middle\">best \
         manipulability w, m²</text>",
        left + 24.0,
        top + 4.0,
        step * levels.len() as f64,
        left + 72.0,
        top + 0.5 * height
    );
    svg
}

/// Figure 7: how far the end-effector goes along straight lines from a posture, floating and with the base held.
pub(super) fn straight_paths(plant: &Plant, model: &Model, radius_m: Option<f64>, look: &Look) -> String {
    let q = coordinates([0.0; 3], &look.q_rad);
    let (tip, center) = (model.end_effector(&q), model.center_of_mass(&q));
    let points = |lengths_m: &[f64]| -> Vec<[f64; 2]> {
        let angle = |k: usize| TAU * k as f64 / lengths_m.len() as f64;
        let far = |(k, length_m): (usize, &f64)| [tip.x + length_m * angle(k).cos(), tip.y + length_m * angle(k).sin()];
        lengths_m.iter().enumerate().map(far).collect()
    };
    let held = points(&look.held.lengths_m);
    let circle = radius_m.map_or_else(Vec::new, |r| arc([center.x, center.y], r, 0.0, TAU));
    let of = |axis: usize| {
        let all = held.iter().chain(&circle).map(|p| p[axis]);
        let (low, high) = all.fold((-0.3_f64, 0.3_f64), |(low, high), v| (low.min(v), high.max(v)));
        [low - 0.08, high + 0.08]
    };
    let mut plot = Plot::new("paths", [0.0, 0.0], WIDTH, of(0), of(1));
    plot.polygon(&held, HELD);
    if let Some(floating) = &look.floating {
        plot.polygon(&points(&floating.lengths_m), FLOATING);
    }
    if let Some(radius_m) = radius_m {
        plot.circle(
            [center.x, center.y],
            radius_m,
            "fill=\"none\" stroke=\"#555\" stroke-width=\"1.2\" stroke-dasharray=\"7 4\"",
        );
        plot.label([center.x, center.y + radius_m - 0.07], "middle", &format!("R = {radius_m:.3} m"));
        plot.cross([center.x, center.y], "stroke=\"#555\" stroke-width=\"1.5\"");
    }
    plot.scene(&Scene::of(plant, None), &Posture::of(model, [0.0; 3], &look.q_rad), 1.0);
    let size = plot.outer_size();
    let mut content = plot.finish();
    let mut entries = vec![(HELD, format!("base held, {:.3} m²", look.held.area_m2))];
    if let Some(floating) = &look.floating {
        entries.push((FLOATING, format!("floating, {:.3} m²", floating.area_m2)));
    }
    let mut x = 62.0;
    for (style, text) in entries {
        let _ = write!(
            content,
            "<rect x=\"{x:.0}\" y=\"12\" width=\"18\" height=\"12\" {style}/><text x=\"{:.0}\" y=\"22\">{text}</text>",
            x + 25.0
        );
        x += 190.0;
    }
    if radius_m.is_some() {
        let _ = write!(
            content,
            "<path d=\"M{x:.0} 18h26\" stroke=\"#555\" stroke-dasharray=\"7 4\"/><text x=\"{:.0}\" y=\"22\">floating, any path</text>",
            x + 33.0
        );
    }
    picture(size, &content)
}

/// Figure 8: the manipulability ellipses of a posture, with the floating one in detail.
pub(super) fn ellipsoids(plant: &Plant, model: &Model, look: &Look) -> String {
    let q = coordinates([0.0; 3], &look.q_rad);
    let tip = model.end_effector(&q);
    let tip = [tip.x, tip.y];
    let largest = look.held_ellipse.semi_axes_m[0].max(1e-6);
    let scale = nice_step(0.55 / largest);
    let joints = model.kinematics(&q).joints;
    let of = |axis: usize| {
        let points = joints.iter().take(model.link_count() + 1).map(|p| p[axis]);
        let ellipse = [tip[axis] - scale * largest, tip[axis] + scale * largest];
        let (low, high) = points.chain(ellipse).fold((-0.2_f64, 0.2_f64), |(low, high), v| (low.min(v), high.max(v)));
        [low - 0.08, high + 0.08]
    };
    let draw = |plot: &mut Plot, ellipse: &Manipulability, scale: f64, style: &str| {
        plot.ellipse(tip, ellipse.semi_axes_m.map(|m| m * scale), ellipse.major_axis_rad, style);
    };
    let through = "fill-opacity=\"0.75\"";
    let mut whole = Plot::new("whole", [0.0, 0.0], WIDTH, of(0), of(1));
    draw(&mut whole, &look.held_ellipse, scale, &format!("{HELD} {through}"));
    if let Some(floating) = &look.floating_ellipse {
        draw(&mut whole, floating, scale, &format!("{FLOATING} {through}"));
    }
    let (scene, vehicle) = (Scene::of(plant, None), Posture::of(model, [0.0; 3], &look.q_rad));
    whole.scene(&scene, &vehicle, 1.0);
    let size = whole.outer_size();
    let Some(floating) = &look.floating_ellipse else {
        whole.heading(&format!("base held; joint rates of unit norm, 1 m/s drawn as {scale} m"));
        return picture(size, &whole.finish());
    };
    whole.heading(&format!(
        "(a) base held (blue), floating (orange); joint rates of unit norm, 1 m/s drawn as {scale} m"
    ));
    let half = 1.25 * scale * floating.semi_axes_m[0];
    let side = size[1] - 80.0;
    let mut detail = Plot::new(
        "detail",
        [size[0] + 10.0, 0.0],
        side,
        [tip[0] - half, tip[0] + half],
        [tip[1] - half, tip[1] + half],
    );
    detail.heading("(b) floating, in detail");
    draw(&mut detail, &look.held_ellipse, scale, HELD);
    detail.scene(&scene, &vehicle, 0.35);
    draw(&mut detail, floating, scale, &format!("{FLOATING} {through}"));
    axes(&mut detail, tip, floating, scale);
    let height = size[1].max(detail.outer_size()[1]);
    let width = size[0] + 10.0 + detail.outer_size()[0];
    picture([width, height], &(whole.finish() + &detail.finish()))
}

/// Both semi-axes of an ellipse with what they are worth.
fn axes(plot: &mut Plot, tip: [f64; 2], ellipse: &Manipulability, scale: f64) {
    for (length, turn) in ellipse.semi_axes_m.into_iter().zip([0.0, PI / 2.0]) {
        let angle = ellipse.major_axis_rad + turn;
        let along = |m: f64| [tip[0] + m * angle.cos(), tip[1] + m * angle.sin()];
        plot.line(&[tip, along(scale * length)], "stroke=\"#7a2f08\" stroke-width=\"1.5\"");
        plot.label(along(scale * length * 1.08), "middle", &format!("{length:.3} m/s"));
    }
}
