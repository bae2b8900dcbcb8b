//! The table from above: the vehicle at several instants, the ways of base and end-effector, the target.

use super::plane::Plot;
use fss_messages::{MAX_LINKS, TruthState};
use fss_multibody::{Coordinates, Model};
use fss_plant::{Plant, Target};

/// Colours of the traces.
pub(crate) const BASE: &str = "#3377cc";
/// Colour of the end-effector.
pub(crate) const END_EFFECTOR: &str = "#cc3333";
/// Colour of the target.
pub(crate) const TARGET: &str = "#2f7d4f";
/// The most points of a trace.
const POINTS: usize = 800;
/// Room around what moves, m.
const ROOM_M: f64 = 0.3;

/// Where everything is at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// When, s.
    pub t_s: f64,
    /// Base in the table frame: x m, y m, theta rad.
    pub base: [f64; 3],
    /// Encoder angles, rad.
    pub q_rad: [f64; MAX_LINKS],
    /// The end-effector, m.
    pub end_effector_m: [f64; 2],
    /// Target, where there is one: x m, y m, theta rad.
    pub target: Option<[f64; 3]>,
}

impl Moment {
    /// From the truth, with time from `zero_ns`; the target where the table has one.
    pub fn of_truth(truth: &TruthState, zero_ns: u64, has_target: bool) -> Self {
        Self {
            t_s: truth.stamp_ns.saturating_sub(zero_ns) as f64 * 1e-9,
            base: [truth.x_m, truth.y_m, truth.theta_rad],
            q_rad: truth.q_rad,
            end_effector_m: [truth.ee[0], truth.ee[1]],
            target: has_target.then_some(truth.target),
        }
    }

    /// Generalised coordinates for the model.
    pub fn coordinates(&self) -> Coordinates {
        let mut q = Coordinates::zeros();
        for (slot, value) in q.iter_mut().zip(self.base.iter().chain(&self.q_rad)) {
            *slot = *value;
        }
        q
    }
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
    plot.table(table.plant.table.size_m);
    for (k, moment) in instants.iter().filter_map(|i| moments.get(*i)).enumerate() {
        let last = k + 1 == instants.len();
        let opacity = if last { 1.0 } else { 0.16 + 0.3 * f64::from(k == 0) };
        if let (Some(disc), Some(pose)) = (table.target, moment.target) {
            plot.disc(pose, disc.radius_m, opacity);
        }
        plot.vehicle(table.plant, table.model, &moment.coordinates(), opacity);
    }
    let mut trace = |of: &dyn Fn(&Moment) -> Option<[f64; 2]>, colour: &str, width: f64| {
        let every = moments.len().div_ceil(POINTS).max(1);
        let points: Vec<[f64; 2]> = moments.iter().step_by(every).filter_map(of).collect();
        plot.line(&points, &format!("stroke=\"{colour}\" stroke-width=\"{width}\""));
    };
    trace(&|m| m.target.map(|t| [t[0], t[1]]), TARGET, 1.5);
    trace(&|m| Some(m.end_effector_m), END_EFFECTOR, 1.8);
    trace(&|m| Some([m.base[0], m.base[1]]), BASE, 1.5);
    plot
}

/// The smallest window that holds what moves, with some room.
fn window(table: &Table, moments: &[Moment], cut: Cut) -> [[f64; 2]; 2] {
    let disc = table.target.map_or(0.0, |target| target.radius_m);
    let range = |axis: usize| {
        let of = |moment: &Moment| {
            let target = moment.target.map_or([moment.base[axis]; 2], |t| [t[axis] - disc, t[axis] + disc]);
            [moment.base[axis], moment.end_effector_m[axis], target[0], target[1]]
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
    let named = [(BASE, "base"), (END_EFFECTOR, "end-effector"), (TARGET, "target")];
    let words = named.iter().take(2 + usize::from(has_target));
    let words =
        words.map(|(colour, name)| format!("<{element} fill=\"{colour}\" style=\"color:{colour}\">{name}</{element}>"));
    words.collect::<Vec<_>>().join(", ")
}
