//! How far the end-effector can go along a straight line: the paper's straight-path workspace (section 5).
//!
//! The arm has joints to spare, so many postures hold the end-effector at one point, and which of them an arm is in
//! decides how far it still gets. A planner that follows one posture, by a pseudoinverse and a preferred direction in
//! its null space, ends at the first limit or singularity that this preference leads it into. Here a *front* of
//! postures walks along the line instead: every step moves each of them on with several self-motions, and of those
//! that arrive it keeps few that are far apart and have room left. The line ends where nobody arrives.

use fss_multibody::{Coordinates, JointJacobian, JointVector, MAX_LINKS, Model, damped_pseudoinverse, singular_values};
use nalgebra::{SMatrix, Vector2};
use std::collections::BTreeMap;

/// Steps along the line, m: the usual one, and the finest that is tried where the front is stuck.
const STEP_M: f64 = 0.005;
const FINEST_STEP_M: f64 = 0.0006;
/// How much a joint may turn with the way of the end-effector, rad/m, and at most in one step, rad.
const JOINT_TRAVEL_RAD_M: f64 = 200.0;
const JOINT_TRAVEL_RAD: f64 = 0.3;
/// How much of that is for self-motion, rad/m.
const SELF_MOTION_RAD_M: f64 = 30.0;
/// Below this smallest singular value (m) a posture is singular.
const SINGULAR_M: f64 = 1e-3;
/// How far from the line the end-effector may be, m.
const ON_THE_LINE_M: f64 = 1e-6;
/// Most postures of a front, and the side of the cells (rad) of which each holds at most one.
const FRONT: usize = 96;
const CELL_RAD: f64 = 0.25;
/// The end of a line that does not end, m.
const FAR_M: f64 = 100.0;

/// The longest straight path found in one direction.
#[derive(Clone, Debug)]
pub struct StraightPath {
    /// Its length, m.
    pub length_m: f64,
    /// Postures `[x, y, theta, q_1 ..]` along it, from the start to the end, at most 5 mm apart.
    pub postures: Vec<Coordinates>,
}

/// Where a line starts and leads to.
struct Line<'a> {
    model: &'a Model,
    limits_rad: &'a [f64],
    start: Vector2<f64>,
    direction: Vector2<f64>,
    /// Centre of mass of a floating vehicle: it stays.
    center: Vector2<f64>,
}

/// A posture, and how far it is from limits and singularities.
#[derive(Clone, Copy)]
struct Walker {
    q: Coordinates,
    parent: usize,
    room: f64,
}

/// The longest straight path of the end-effector from posture `start` (`[x, y, theta, q_1 ..]`), in the table-frame
/// direction `angle_rad`, with joints within plus and minus `limits_rad`. The base floats at zero momentum, or stays
/// where it is if the model says `clamped`. Needs three or more joints to find better than the only way there is.
pub fn straight_path(model: &Model, limits_rad: &[f64], start: &Coordinates, angle_rad: f64) -> StraightPath {
    let line = Line {
        model,
        limits_rad,
        start: model.end_effector(start).xy(),
        direction: Vector2::new(angle_rad.cos(), angle_rad.sin()),
        center: model.center_of_mass(start),
    };
    let mut walkers = vec![Walker { q: *start, parent: 0, room: 0.0 }];
    let mut front = 0..1;
    let (mut along_m, mut step_m, mut turn) = (0.0, STEP_M, 0);
    while along_m < FAR_M {
        let arrived = line.advance(&walkers, front.clone(), along_m, step_m, turn);
        if arrived.is_empty() {
            step_m *= 0.5;
            if step_m < FINEST_STEP_M {
                break;
            }
            continue;
        }
        front = walkers.len()..walkers.len() + arrived.len();
        walkers.extend(arrived);
        along_m += step_m;
        turn += 1;
        step_m = (2.0 * step_m).min(STEP_M);
    }
    let mut postures = Vec::new();
    let mut at = front.start;
    while at != 0 {
        postures.push(walkers[at].q);
        at = walkers[at].parent;
    }
    postures.push(*start);
    postures.reverse();
    StraightPath { length_m: along_m, postures }
}

/// Area of the polygon of straight paths in `lengths_m.len()` directions, evenly spread over the circle, m^2.
pub fn straight_path_area_m2(lengths_m: &[f64]) -> f64 {
    let sine = (std::f64::consts::TAU / lengths_m.len() as f64).sin();
    let next = lengths_m.iter().cycle().skip(1);
    lengths_m.iter().zip(next).map(|(a, b)| 0.5 * a * b * sine).sum()
}

impl Line<'_> {
    /// The front one step further: of all that arrive, the roomiest of each cell.
    fn advance(
        &self,
        walkers: &[Walker],
        front: std::ops::Range<usize>,
        along_m: f64,
        step_m: f64,
        turn: usize,
    ) -> Vec<Walker> {
        let target = self.start + self.direction * (along_m + step_m);
        let mut cells: BTreeMap<[i8; 1 + MAX_LINKS], Walker> = BTreeMap::new();
        let joint = turn % self.model.link_count().max(1);
        for parent in front {
            for sign in [0.0, 1.0, -1.0] {
                let mut preferred = JointVector::zeros();
                preferred[joint] = sign * SELF_MOTION_RAD_M * step_m;
                let Some((q, room)) = self.step(&walkers[parent].q, &target, &preferred, step_m) else { continue };
                // A cell of joint angles and of the base's attitude, which has a memory of its own.
                let cell = std::array::from_fn(|i| (q[2 + i] / CELL_RAD).floor() as i8);
                let walker = Walker { q, parent, room };
                let kept = cells.entry(cell).or_insert(walker);
                if room > kept.room {
                    *kept = walker;
                }
            }
        }
        let mut arrived: Vec<Walker> = cells.into_values().collect();
        arrived.sort_by(|a, b| b.room.total_cmp(&a.room));
        arrived.truncate(FRONT);
        arrived
    }

    /// A posture with the end-effector at `target`, near `from`, moved by `preferred` as far as the target leaves that
    /// free; and its room. None where joint limits, singularity or the joints' travel forbid it.
    fn step(
        &self,
        from: &Coordinates,
        target: &Vector2<f64>,
        preferred: &JointVector,
        step_m: f64,
    ) -> Option<(Coordinates, f64)> {
        let mut q = *from;
        let mut mobility = JointVector::from_fn(|i, _| if i < self.limits_rad.len() { 1.0 } else { 0.0 });
        let mut beside = *preferred;
        for _ in 0..8 {
            let missing = target - self.model.end_effector(&q).xy();
            let rows = position_rows(&self.model.generalized_jacobian(&q));
            let move_by = self.within_limits(&q, &rows, &missing, &mut mobility, beside)?;
            q = self.moved(&q, &move_by);
            beside.fill(0.0);
            let travel_rad = (q - from).rows(3, MAX_LINKS).amax();
            if travel_rad > (JOINT_TRAVEL_RAD_M * step_m).min(JOINT_TRAVEL_RAD) {
                return None;
            }
            if (target - self.model.end_effector(&q).xy()).norm() < ON_THE_LINE_M {
                let (smallest_m, room) = self.room(&q);
                return (smallest_m > SINGULAR_M).then_some((q, room));
            }
        }
        None
    }

    /// Least joint motion beside `beside` that makes the end-effector move by `missing`; joints that would pass a limit
    /// are locked there, and stay so for this step.
    fn within_limits(
        &self,
        q: &Coordinates,
        rows: &SMatrix<f64, 2, MAX_LINKS>,
        missing: &Vector2<f64>,
        mobility: &mut JointVector,
        mut beside: JointVector,
    ) -> Option<JointVector> {
        loop {
            let inverse = damped_pseudoinverse(rows, mobility, 0.0)?;
            let move_by = inverse * (missing - rows * beside) + beside;
            let past = |i: usize| (q[3 + i] + move_by[i]).abs() - self.limits_rad[i];
            let free = (0..self.limits_rad.len()).filter(|i| mobility[*i] > 0.0);
            let Some(worst) = free.max_by(|a, b| past(*a).total_cmp(&past(*b))).filter(|i| past(*i) > 0.0) else {
                return Some(move_by);
            };
            mobility[worst] = 0.0;
            beside[worst] = self.limits_rad[worst].copysign(q[3 + worst]) - q[3 + worst];
        }
    }

    /// The posture after a joint motion at zero momentum: the base turns as at its middle, the centre of mass stays.
    fn moved(&self, q: &Coordinates, move_by: &JointVector) -> Coordinates {
        let with = |share: f64| {
            let mut q = *q;
            q.fixed_rows_mut::<MAX_LINKS>(3).axpy(share, move_by, 1.0);
            q
        };
        if self.model.base().clamped {
            return with(1.0);
        }
        let mut middle = with(0.5);
        middle[2] += 0.5 * self.model.reaction_vector(q).dot(move_by);
        let mut q = with(1.0);
        q[2] += self.model.reaction_vector(&middle).dot(move_by);
        let drift = self.center - self.model.center_of_mass(&q);
        q[0] += drift.x;
        q[1] += drift.y;
        q
    }

    /// Smallest singular value of the Jacobian (m), and of the Jacobian with joints that count less near their limits.
    fn room(&self, q: &Coordinates) -> (f64, f64) {
        let rows = position_rows(&self.model.generalized_jacobian(q));
        let mut weighted = rows;
        for (i, limit_rad) in self.limits_rad.iter().enumerate() {
            let share = q[3 + i] / limit_rad;
            weighted.column_mut(i).scale_mut((1.0 - share * share).max(0.0).sqrt());
        }
        (singular_values(&rows).min(), singular_values(&weighted).min())
    }
}

fn position_rows(jacobian: &JointJacobian) -> SMatrix<f64, 2, MAX_LINKS> {
    jacobian.fixed_rows::<2>(0).into_owned()
}
