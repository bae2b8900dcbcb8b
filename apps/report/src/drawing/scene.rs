//! The table from above: the vehicle at several instants, the ways of base and end-effector, the target.

use super::plane::Plot;
use fss_messages::{ArmCommand, TruthState};
use fss_multibody::Model;
use fss_plant::scene::{COLOURS, Posture, Scene, mask};
use fss_plant::{Plant, Target};

/// The most points of a trace.
const POINTS: usize = 800;
/// Room around what moves, m.
const ROOM_M: f64 = 0.3;

/// Where everything is at an instant.
#[derive(Clone, Debug)]
pub struct Moment {
    /// When, s.
    pub t_s: f64,
    /// The end-effector, m; in the truth of another plant it is not where the posture's arm ends.
    pub end_effector_m: [f64; 2],
    /// All bodies.
    pub posture: Posture,
}

impl Moment {
    /// From the truth, with time from `zero_ns`, and what the arm was commanded; the target where the table has one.
    pub fn of_truth(truth: &TruthState, zero_ns: u64, table: &Table, arm: &[ArmCommand]) -> Self {
        let vehicle = Posture::of(table.model, [truth.x_m, truth.y_m, truth.theta_rad], &truth.q_rad);
        Self {
            t_s: truth.stamp_ns.saturating_sub(zero_ns) as f64 * 1e-9,
            end_effector_m: [truth.ee[0], truth.ee[1]],
            posture: Posture {
                target: table.target.map(|_| truth.target),
                goal: goal(arm, truth.stamp_ns),
                pushing: mask(&truth.valves),
                ..vehicle
            },
        }
    }
}

/// Where the end-effector shall be at a time, by the newest of these commands.
pub(crate) fn goal(arm: &[ArmCommand], stamp_ns: u64) -> Option<[f64; 3]> {
    let newest = arm.partition_point(|command| command.stamp_ns <= stamp_ns).checked_sub(1)?;
    Some(arm[newest].ee_goal).filter(|goal| *goal != [0.0; 3])
}

/// What is on the table.
pub struct Table<'a> {
    /// The vehicle and its laboratory.
    pub plant: &'a Plant,
    /// Its model.
    pub model: &'a Model,
    /// The disc that is to be captured.
    pub target: Option<&'a Target>,
}

/// How a picture from above is cut out.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Cut {
    /// What moves, as a square.
    Square,
    /// What moves, and no more.
    Tight,
}

/// The view as a plot of this width; the vehicle is drawn at `instants`, which count moments, the last in full.
pub(crate) fn from_above(table: &Table, moments: &[Moment], instants: &[usize], width: f64, cut: Cut) -> Plot {
    let [x_m, y_m] = window(table, moments, cut);
    let mut plot = Plot::new("above", [0.0, 0.0], width, x_m, y_m);
    let scene = Scene::of(table.plant, table.target);
    plot.beyond(&scene.table);
    for (k, moment) in instants.iter().filter_map(|i| moments.get(*i)).enumerate() {
        let last = k + 1 == instants.len();
        let opacity = if last { 1.0 } else { 0.16 + 0.3 * f64::from(k == 0) };
        plot.scene(&scene, &moment.posture, opacity);
    }
    let mut trace = |of: &dyn Fn(&Moment) -> Option<[f64; 2]>, colour: &str, width: f64| {
        let every = moments.len().div_ceil(POINTS).max(1);
        let points: Vec<[f64; 2]> = moments.iter().step_by(every).filter_map(of).collect();
        plot.line(&points, &format!("stroke=\"{colour}\" stroke-width=\"{width}\""));
    };
    trace(&|m| m.posture.target.map(|t| [t[0], t[1]]), COLOURS.target, 1.5);
    trace(&|m| Some(m.end_effector_m), COLOURS.tip, 1.8);
    trace(&|m| m.posture.base.first_chunk().copied(), COLOURS.base, 1.5);
    plot
}

/// The smallest window that holds what moves, with some room.
fn window(table: &Table, moments: &[Moment], cut: Cut) -> [[f64; 2]; 2] {
    let disc = table.target.map_or(0.0, |target| target.radius_m);
    let range = |axis: usize| {
        let of = |moment: &Moment| {
            let base = moment.posture.base[axis];
            let target = moment.posture.target.map_or([base; 2], |t| [t[axis] - disc, t[axis] + disc]);
            [base, moment.end_effector_m[axis], target[0], target[1]]
        };
        let all = moments.iter().flat_map(of);
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        [low - ROOM_M, high + ROOM_M]
    };
    let mut ranges = [range(0), range(1)];
    if cut == Cut::Square {
        let half = ranges.map(|[low, high]| 0.5 * (high - low)).into_iter().fold(0.0, f64::max);
        ranges = ranges.map(|[low, high]| [0.5 * (low + high) - half, 0.5 * (low + high) + half]);
    }
    ranges
}

/// What the colours of the traces mean, in `span` elements (of HTML) or `tspan` elements (of SVG).
pub(crate) fn legend(element: &str, has_target: bool) -> String {
    let named = [(COLOURS.base, "base"), (COLOURS.tip, "end-effector"), (COLOURS.target, "target")];
    let words = named.iter().take(2 + usize::from(has_target));
    let words =
        words.map(|(colour, name)| format!("<{element} fill=\"{colour}\" style=\"color:{colour}\">{name}</{element}>"));
    words.collect::<Vec<_>>().join(", ")
}
