//! Joint rates for a task, within bounds and as near as can be to preferred ones.
//!
//! Without bounds it is `J^+ wanted + (1 - J^+ J) preferred` with the pseudoinverse damped near singularities
//! ([`damped_pseudoinverse`]). With bounds it is the saturation in the null space (Flacco, De Luca and Khatib, "Motion
//! control of redundant robots under joint constraints", ICRA 2012): the joint that exceeds its bound most is set to the
//! bound and the rest solved again; where no joints are left to do the whole task, the largest share of it is done that
//! fits.

use fss_multibody::{JointVector, MAX_LINKS, damped_pseudoinverse, damping_near_singularity, singular_values};
use nalgebra::{SMatrix, SVector};

/// `rows * rates = wanted`.
#[derive(Clone, Copy, Debug)]
pub struct Task<const R: usize> {
    /// Jacobian of the task, zero beyond the last joint.
    pub rows: SMatrix<f64, R, MAX_LINKS>,
    /// What the rows shall give.
    pub wanted: SVector<f64, R>,
    /// Rates that the joints take as far as the task leaves them free, rad/s.
    pub preferred: JointVector,
}

/// Which rates are allowed, and when the Jacobian counts as singular.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Least rates, rad/s, none above zero.
    pub low: JointVector,
    /// Largest rates, rad/s, none below zero.
    pub high: JointVector,
    /// Below this smallest singular value the rates' bounds shrink with it, so that the joints are slow where they must
    /// stop.
    pub sigma_slow: f64,
    /// Below this one the inverse is damped.
    pub sigma_damped: f64,
    /// Below this one there is no solution.
    pub sigma_singular: f64,
}

/// Joint rates for a task.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    /// Rates, rad/s.
    pub rates: JointVector,
    /// Share of the task that they do, 0 to 1.
    pub scale: f64,
    /// Smallest singular value of the task's Jacobian with all joints free.
    pub sigma_min: f64,
    /// Joints that stand at a bound.
    pub at_bound: [bool; MAX_LINKS],
}

/// Pseudoinverse of the columns of the free joints, damped where it must be, and their smallest singular value.
fn inverse_of<const R: usize>(
    rows: &SMatrix<f64, R, MAX_LINKS>,
    free: [bool; MAX_LINKS],
    sigma_damped: f64,
) -> (SMatrix<f64, MAX_LINKS, R>, f64) {
    let mobility = JointVector::from_fn(|i, _| if free[i] { 1.0 } else { 0.0 });
    let of_free = SMatrix::<f64, R, MAX_LINKS>::from_fn(|row, i| rows[(row, i)] * mobility[i]);
    let sigma_min = singular_values(&of_free).min();
    let damping = damping_near_singularity(sigma_min, sigma_damped, sigma_damped);
    damped_pseudoinverse(rows, &mobility, damping).map_or((SMatrix::zeros(), 0.0), |inverse| (inverse, sigma_min))
}

impl<const R: usize> Task<R> {
    /// The rates that do the task within `bounds`, or the largest share of it.
    pub fn solve(&self, joint_count: usize, bounds: &Bounds) -> Solution {
        let mut free = [false; MAX_LINKS];
        free[..joint_count].fill(true);
        // What the joints do beside the task: preferred rates, or their bound where they are locked.
        let mut beside = self.preferred;
        let mut bounds = *bounds;
        let mut best =
            Solution { rates: JointVector::zeros(), scale: 0.0, sigma_min: 0.0, at_bound: [false; MAX_LINKS] };
        for locked in 0..=joint_count {
            if joint_count - locked < R {
                break;
            }
            let (inverse, sigma_min) = inverse_of(&self.rows, free, bounds.sigma_damped);
            if locked == 0 {
                best.sigma_min = sigma_min;
                let ease = (sigma_min / bounds.sigma_slow).min(1.0);
                (bounds.low, bounds.high) = (bounds.low * ease, bounds.high * ease);
            }
            if sigma_min < bounds.sigma_singular {
                break;
            }
            // rates = scale * doing + keeping: what does the task, and what leaves it alone.
            let doing = inverse * self.wanted;
            let keeping = beside - inverse * (self.rows * beside);
            let (share, tightest) = largest_share(&doing, &keeping, free, &bounds);
            if share > best.scale {
                best.scale = share;
                best.rates = doing * share + keeping;
                best.at_bound = free.map(|free| !free);
                best.at_bound[joint_count..].fill(false);
            }
            let Some(joint) = tightest.filter(|_| share < 1.0) else { break };
            beside[joint] = (doing + keeping)[joint].clamp(bounds.low[joint], bounds.high[joint]);
            free[joint] = false;
            if best.scale == 0.0 {
                best.at_bound[joint] = true;
            }
        }
        best
    }
}

/// The largest share up to 1 of `doing` that fits within the bounds with `keeping`, and the joint that bounds it.
fn largest_share(
    doing: &JointVector,
    keeping: &JointVector,
    free: [bool; MAX_LINKS],
    bounds: &Bounds,
) -> (f64, Option<usize>) {
    let (mut most, mut least, mut tightest) = (1.0, 0.0, None);
    for i in (0..MAX_LINKS).filter(|i| free[*i]) {
        let (room_down, room_up) = (bounds.low[i] - keeping[i], bounds.high[i] - keeping[i]);
        let (lowest, highest) = if doing[i].abs() < 1e-12 {
            // The share does not matter to this joint, only whether it is within its bounds at all.
            if room_down <= 0.0 && room_up >= 0.0 { (0.0, 1.0) } else { (1.0, 0.0) }
        } else if doing[i] > 0.0 {
            (room_down / doing[i], room_up / doing[i])
        } else {
            (room_up / doing[i], room_down / doing[i])
        };
        if highest < most {
            (most, tightest) = (highest, Some(i));
        }
        least = f64::max(least, lowest);
    }
    // Where keeping alone breaks a bound that only a larger share would mend, there is no share.
    (if most >= least { most.max(0.0) } else { 0.0 }, tightest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(rate: f64) -> Bounds {
        let high = JointVector::repeat(rate);
        Bounds { low: -high, high, sigma_slow: 0.03, sigma_damped: 0.01, sigma_singular: 1e-3 }
    }

    /// Two rows, three joints.
    fn task() -> Task<2> {
        let mut task = Task { rows: SMatrix::zeros(), wanted: SVector::zeros(), preferred: JointVector::zeros() };
        task.rows.fixed_view_mut::<2, 3>(0, 0).copy_from_slice(&[1.0, 0.2, 0.7, 0.5, 0.3, 1.0]);
        task.wanted[0] = 0.1;
        task.wanted[1] = 0.05;
        task
    }

    fn error(task: &Task<2>, solution: &Solution) -> f64 {
        (task.rows * solution.rates - task.wanted * solution.scale).norm()
    }

    #[test]
    fn without_bounds_the_task_is_done_by_the_least_rates() {
        let task = task();
        let solution = task.solve(3, &bounds(10.0));
        assert!(error(&task, &solution) < 1e-12 && solution.scale == 1.0);
        // The null space of the rows, by the cross product: least rates have no part in it.
        let (a, b) = (task.rows.row(0), task.rows.row(1));
        let null = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let part: f64 = null.iter().zip(solution.rates.iter()).map(|(n, r)| n * r).sum();
        assert!(part.abs() < 1e-12);
    }

    #[test]
    fn preferred_rates_leave_the_task_alone() {
        let mut task = task();
        let least = task.solve(3, &bounds(10.0)).rates;
        task.preferred[1] = 0.3;
        let solution = task.solve(3, &bounds(10.0));
        assert!(error(&task, &solution) < 1e-12);
        assert!(solution.rates[1] > least[1] + 0.01);
    }

    #[test]
    fn a_locked_joint_is_made_good_for_by_the_others() {
        let task = task();
        let mut bounds = bounds(10.0);
        bounds.high[0] = 0.0;
        let solution = task.solve(3, &bounds);
        assert!(error(&task, &solution) < 1e-12 && solution.scale == 1.0);
        assert_eq!((solution.rates[0], solution.at_bound[0]), (0.0, true));
    }

    #[test]
    fn what_does_not_fit_is_done_more_slowly_in_the_same_direction() {
        let task = task();
        let full = task.solve(3, &bounds(10.0)).rates.amax();
        let solution = task.solve(3, &bounds(full / 4.0));
        assert!(error(&task, &solution) < 1e-12);
        assert!(solution.scale >= 0.25 && solution.scale < 1.0, "share {}", solution.scale);
        assert!(solution.rates.amax() <= full / 4.0 + 1e-12);
    }

    #[test]
    fn with_too_many_joints_at_their_limits_nothing_moves() {
        let task = task();
        let free = task.solve(3, &bounds(10.0)).rates;
        let mut bounds = bounds(10.0);
        for i in 0..3 {
            if free[i] > 0.0 { bounds.high[i] = 0.0 } else { bounds.low[i] = 0.0 }
        }
        let solution = task.solve(3, &bounds);
        assert!(solution.scale < 1e-9 && solution.rates.amax() < 1e-9);
    }

    #[test]
    fn a_singular_task_has_no_solution() {
        let mut task = task();
        let row = task.rows.row(0).into_owned();
        task.rows.set_row(1, &(row * 2.0));
        let solution = task.solve(3, &bounds(10.0));
        assert!(solution.sigma_min < 1e-3 && solution.scale == 0.0 && solution.rates.amax() == 0.0);
    }

    #[test]
    fn more_rows_than_joints_have_no_solution() {
        assert_eq!(task().solve(1, &bounds(10.0)).scale, 0.0);
    }
}
