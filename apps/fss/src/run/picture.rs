//! A picture of a run, from its log: the table from above, and what happened over time.

use fss_messages::{ArmCommand, MAX_LINKS, TruthState};
use fss_multibody::{Coordinates, Model};
use fss_plant::Plant;
use std::fmt::Write;

/// Side of the view from above, and size of each strip chart, in the picture's own units.
const VIEW: f64 = 460.0;
const STRIP: [f64; 2] = [420.0, 120.0];
/// How many postures are drawn between the first and the last.
const GHOSTS: usize = 4;
/// The most points of a line.
const POINTS: usize = 400;

/// The picture as SVG; `None` where the log has no truth of a mission.
pub fn render(plant: &Plant, model: &Model, title: &str, truth: &[TruthState], arm: &[ArmCommand]) -> Option<String> {
    let (first, last) = (truth.first()?, truth.last()?);
    let mut svg = String::new();
    let title = title.replace('&', "&amp;").replace('<', "&lt;");
    let (width, height) = (VIEW + STRIP[0] + 75.0, VIEW + 40.0);
    let _ = write!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
         font-size=\"12\"><rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\
         <text x=\"20\" y=\"20\" font-size=\"15\">{title}</text>"
    );
    view_from_above(&mut svg, plant, model, truth);
    let start_ns = first.stamp_ns;
    let seconds = |ns: u64| ns.saturating_sub(start_ns) as f64 * 1e-9;
    let duration_s = seconds(last.stamp_ns);
    let turned: Vec<_> =
        truth.iter().map(|t| (seconds(t.stamp_ns), (t.theta_rad - first.theta_rad).to_degrees())).collect();
    strip(&mut svg, 0, "base rotation, deg", &turned, duration_s);
    let error: Vec<_> = arm
        .iter()
        .filter(|a| a.ee_goal != [0.0; 3] && a.stamp_ns >= start_ns)
        .filter_map(|a| {
            let t = truth.get(truth.partition_point(|t| t.stamp_ns < a.stamp_ns))?;
            let error_m = (t.ee[0] - a.ee_goal[0]).hypot(t.ee[1] - a.ee_goal[1]);
            Some((seconds(a.stamp_ns), error_m * 1e3))
        })
        .collect();
    strip(&mut svg, 1, "end-effector error, mm", &error, duration_s);
    let open: Vec<_> =
        truth.iter().map(|t| (seconds(t.stamp_ns), t.valves.iter().map(|&v| f64::from(v)).sum::<f64>())).collect();
    strip(&mut svg, 2, "open valves", &open, duration_s);
    svg.push_str("</svg>\n");
    Some(svg)
}

/// A square of the table, table frame, m.
struct Window {
    left: f64,
    top: f64,
    side: f64,
}

impl Window {
    /// The smallest that holds base and end-effector throughout, with some room.
    fn around(truth: &[TruthState]) -> Self {
        const ROOM_M: f64 = 0.35;
        let points = || truth.iter().flat_map(|t| [(t.x_m, t.y_m), (t.ee[0], t.ee[1])]);
        let range = |of: &dyn Fn((f64, f64)) -> f64| {
            points().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
        };
        let ((x0, x1), (y0, y1)) = (range(&|p| p.0), range(&|p| p.1));
        let side = (x1 - x0).max(y1 - y0) + 2.0 * ROOM_M;
        Self { left: 0.5 * (x0 + x1 - side), top: 0.5 * (y0 + y1 + side), side }
    }
}

fn view_from_above(svg: &mut String, plant: &Plant, model: &Model, truth: &[TruthState]) {
    const GRID_M: f64 = 0.5;
    let window = Window::around(truth);
    let scale = VIEW / window.side;
    let (left, top) = (window.left, window.top);
    let at = move |x: f64, y: f64| (20.0 + (x - left) * scale, 30.0 + (top - y) * scale);
    let _ = write!(
        svg,
        "<clipPath id=\"view\"><rect x=\"20\" y=\"30\" width=\"{VIEW}\" height=\"{VIEW}\"/></clipPath>\
         <g clip-path=\"url(#view)\"><rect x=\"20\" y=\"30\" width=\"{VIEW}\" height=\"{VIEW}\" fill=\"#dcd8d0\"/>"
    );
    let [w, h] = plant.table.size_m;
    let (x, y) = at(-0.5 * w, 0.5 * h);
    let _ = write!(
        svg,
        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#f6f6f4\" stroke=\"#999\"/>",
        w * scale,
        h * scale
    );
    for k in -20..=20 {
        let (x, y) = at(f64::from(k) * GRID_M, f64::from(k) * GRID_M);
        let _ = write!(svg, "<path d=\"M{x:.1} 30v{VIEW}M20 {y:.1}h{VIEW}\" stroke=\"#ddd\"/>");
    }
    let path = |of: &dyn Fn(&TruthState) -> (f64, f64)| {
        let every = truth.len().div_ceil(POINTS).max(1);
        let mut d = String::new();
        for (i, t) in truth.iter().step_by(every).enumerate() {
            let (x, y) = of(t);
            let (x, y) = at(x, y);
            let _ = write!(d, "{}{x:.2} {y:.2}", if i == 0 { "M" } else { "L" });
        }
        d
    };
    let postures = GHOSTS + 1;
    for k in 0..=postures {
        let i = (truth.len() - 1) * k / postures;
        let colour = if k == 0 { "#8aa" } else { "#223" };
        let opacity = if k == 0 || k == postures { 1.0 } else { 0.18 };
        posture(svg, plant, model, &truth[i], &at, scale, (colour, opacity));
    }
    let ee = path(&|t| (t.ee[0], t.ee[1]));
    let _ = write!(svg, "<path d=\"{ee}\" fill=\"none\" stroke=\"#c33\" stroke-width=\"2\"/>");
    let base = path(&|t| (t.x_m, t.y_m));
    let _ = write!(svg, "<path d=\"{base}\" fill=\"none\" stroke=\"#37c\" stroke-width=\"1.5\"/>");
    let _ = write!(
        svg,
        "</g><text x=\"26\" y=\"{0:.0}\" fill=\"#555\">grey: start, dark: end, red: end-effector, blue: base; 0.5 m grid</text>",
        22.0 + VIEW
    );
}

fn posture(
    svg: &mut String,
    plant: &Plant,
    model: &Model,
    truth: &TruthState,
    at: &impl Fn(f64, f64) -> (f64, f64),
    scale: f64,
    (colour, opacity): (&str, f64),
) {
    let mut q = Coordinates::zeros();
    (q[0], q[1], q[2]) = (truth.x_m, truth.y_m, truth.theta_rad);
    q.fixed_rows_mut::<MAX_LINKS>(3).copy_from_slice(&truth.q_rad);
    let [w, h] = plant.base.size_m.map(|m| m * scale);
    let (x, y) = at(truth.x_m, truth.y_m);
    let turn = -truth.theta_rad.to_degrees();
    let _ = write!(
        svg,
        "<g stroke=\"{colour}\" fill=\"none\" opacity=\"{opacity}\"><rect x=\"{:.1}\" y=\"{:.1}\" width=\"{w:.1}\" \
         height=\"{h:.1}\" transform=\"rotate({turn:.2} {x:.1} {y:.1})\" stroke-width=\"2\"/>",
        x - 0.5 * w,
        y - 0.5 * h
    );
    let joints = model.kinematics(&q).joints;
    let mut line = String::new();
    for (i, joint) in joints.iter().take(model.link_count() + 1).enumerate() {
        let (x, y) = at(joint.x, joint.y);
        let _ = write!(line, "{}{x:.1} {y:.1}", if i == 0 { "M" } else { "L" });
        let _ = write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{colour}\"/>");
    }
    let _ = write!(svg, "<path d=\"{line}\" stroke-width=\"4\" stroke-linejoin=\"round\"/></g>");
}

/// The `row`-th strip chart: one line over time, with its range written at the axis.
fn strip(svg: &mut String, row: usize, title: &str, points: &[(f64, f64)], duration_s: f64) {
    let (left, top) = (VIEW + 60.0, 40.0 + row as f64 * (STRIP[1] + 36.0));
    let [width, height] = STRIP;
    let _ = write!(
        svg,
        "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"#fafafa\" stroke=\"#bbb\"/>\
         <text x=\"{left}\" y=\"{:.0}\">{title}</text>",
        top - 5.0
    );
    if points.is_empty() {
        let _ = write!(svg, "<text x=\"{:.0}\" y=\"{:.0}\" fill=\"#777\">none</text>", left + 8.0, top + 20.0);
        return;
    }
    let low = points.iter().map(|p| p.1).fold(0.0, f64::min);
    let high = points.iter().map(|p| p.1).fold(low + 1e-3, f64::max);
    let x = |t: f64| left + width * t / duration_s.max(1e-9);
    let y = |v: f64| top + height - 6.0 - (height - 12.0) * (v - low) / (high - low);
    let every = points.len().div_ceil(POINTS).max(1);
    svg.push_str("<path fill=\"none\" stroke=\"#c33\" d=\"");
    for (i, (t, v)) in points.iter().step_by(every).enumerate() {
        let _ = write!(svg, "{}{:.1} {:.1}", if i == 0 { "M" } else { "L" }, x(*t), y(*v));
    }
    let _ = write!(
        svg,
        "\"/><g fill=\"#555\" font-size=\"10\" text-anchor=\"end\"><text x=\"{0:.0}\" y=\"{1:.0}\">{high:.2}</text>\
         <text x=\"{0:.0}\" y=\"{2:.0}\">{low:.2}</text><text x=\"{3:.0}\" y=\"{4:.0}\">{duration_s:.0} s</text></g>",
        left - 4.0,
        top + 10.0,
        top + height,
        left + width,
        top + height + 12.0
    );
}
