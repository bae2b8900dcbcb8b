//! A picture of a run, from its log: the table from above, and what happened over time.

use crate::drawing::page::escape;
use crate::drawing::plane::picture;
use crate::drawing::scene::{Cut, Moment, Table, from_above, legend};
use crate::drawing::strips::{COLOURS, Line, Strips};
use fss_messages::{ArmCommand, TruthState};

/// Width of the view from above and of the strips, in the picture's own units.
const VIEW: f64 = 440.0;
const STRIPS: f64 = 480.0;
const STRIP_HEIGHT: f64 = 128.0;
/// How many postures are drawn, the first and the last included.
const POSTURES: usize = 6;

/// The picture as SVG; `None` where the log has no truth of a mission.
pub(crate) fn render(table: &Table, title: &str, truth: &[TruthState], arm: &[ArmCommand]) -> Option<String> {
    let (first, last) = (truth.first()?, truth.last()?);
    let start_ns = first.stamp_ns;
    let moments: Vec<_> = truth.iter().map(|t| Moment::of_truth(t, start_ns, table, arm)).collect();
    let instants: Vec<_> = (0..POSTURES).map(|k| (truth.len() - 1) * k / (POSTURES - 1)).collect();
    let above = from_above(table, &moments, &instants, VIEW, Cut::Square);
    let size = above.outer_size();
    let seconds = |ns: u64| ns.saturating_sub(start_ns) as f64 * 1e-9;
    let mut strips = Strips::new([size[0], 22.0], STRIPS, [0.0, seconds(last.stamp_ns)]);
    let mut line = |title: &str, least: f64, points: Vec<(f64, f64)>| {
        strips.lines(title, STRIP_HEIGHT, least, &[Line { name: "", colour: COLOURS[1], points }]);
    };
    let turned = truth.iter().map(|t| (seconds(t.stamp_ns), (t.theta_rad - first.theta_rad).to_degrees()));
    line("base rotation, deg", 0.01, turned.collect());
    let errors = arm.iter().filter(|a| a.ee_goal != [0.0; 3] && a.stamp_ns >= start_ns).filter_map(|a| {
        let t = truth.get(truth.partition_point(|t| t.stamp_ns < a.stamp_ns))?;
        let error_m = (t.ee[0] - a.ee_goal[0]).hypot(t.ee[1] - a.ee_goal[1]);
        Some((seconds(a.stamp_ns), error_m * 1e3))
    });
    line("end-effector error, mm", 0.01, errors.collect());
    let open = truth.iter().map(|t| (seconds(t.stamp_ns), t.valves.iter().map(|&v| f64::from(v)).sum::<f64>()));
    line("open valves", 1.0, open.collect());
    let (strips, bottom) = strips.finish();
    let content = format!(
        "<text x=\"18\" y=\"20\" font-size=\"15\">{}</text>{}{strips}\
         <text x=\"62\" y=\"{:.0}\" fill=\"#555\">{}; pale: on the way</text>",
        escape(title),
        above.finish(),
        size[1] + 6.0,
        legend("tspan", table.target.is_some())
    );
    Some(picture([size[0] + STRIPS, size[1].max(bottom) + 14.0], &content))
}
