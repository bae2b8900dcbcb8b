//! Maximizing a smooth function of some variables that are of order one, from values alone.

use nalgebra::{Cholesky, DMatrix, DVector};

/// A difference is taken where the function falls by about this much.
const NOTICEABLE: f64 = 0.3;
/// Differences are taken no nearer and no farther than this.
const DIFFERENCE: [f64; 2] = [0.01, 0.5];
/// No variable moves farther in one step.
const LONGEST: f64 = 1.5;
/// Least curvature to begin with: that of what is flat or bends upwards.
const LEAST_CURVATURE: f64 = 0.1;
/// Nearer than this a variable is at its bound.
const AT_BOUND: f64 = 1e-6;
/// What a step is shortened by where it leads down, and so often at the most.
const SHORTER: f64 = 0.35;
const SHORTENED: usize = 5;

/// A maximum that was climbed to.
#[derive(Clone, Debug)]
pub struct Maximum {
    /// Where it is.
    pub at: Vec<f64>,
    /// The value there.
    pub value: f64,
    /// Curvature about it as the way there met it, the negative of the second derivatives: a good one to begin a search nearby with. Of
    /// variables that stayed it is what was known before, or 0.
    pub curvature: DMatrix<f64>,
}

/// How a maximum is sought.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// A gain below this is not sought.
    pub tolerance: f64,
    /// Evaluations at the most, but for those of a gradient that was begun.
    pub evaluations: usize,
}

/// The maximum that the quasi-Newton method of Broyden, Fletcher, Goldfarb and Shanno reaches from `start` (Nocedal and Wright,
/// *Numerical Optimization*, 2006, chapter 6). Gradients are differences of values; the curvature is at first one that is `known` of all
/// variables, where the diagonal is larger than 0 for each that moves, or else that of central differences by the `widths`, those of
/// variables that stay being 0. Within `bounds`, every value must be finite. Ends where the quadratic model promises a gain below the
/// tolerance, after a step that gained less, or after so many evaluations.
pub fn maximize(
    start: &[f64],
    widths: &[f64],
    bounds: &[[f64; 2]],
    effort: Effort,
    known: Option<&DMatrix<f64>>,
    value: impl FnMut(&[f64]) -> f64,
) -> Maximum {
    let free: Vec<usize> = (0..start.len()).filter(|i| widths[*i] != 0.0).collect();
    let (bounds, widths): (Vec<[f64; 2]>, Vec<f64>) = free.iter().map(|i| (bounds[*i], widths[*i])).unzip();
    let mut at = start.to_vec();
    free.iter().zip(&bounds).for_each(|(i, [lower, upper])| at[*i] = at[*i].clamp(*lower, *upper));
    let mut ascent = Ascent { value, at, best: 0.0, free, bounds, used: 0 };
    ascent.best = ascent.at_offset(&[]);
    let n = start.len();
    let mut curvature = known.filter(|c| c.nrows() == n).cloned().unwrap_or_else(|| DMatrix::zeros(n, n));
    if ascent.best.is_finite() && !ascent.free.is_empty() {
        let own = DMatrix::from_fn(widths.len(), widths.len(), |i, j| curvature[(ascent.free[i], ascent.free[j])]);
        let known = (0..widths.len()).all(|k| own[(k, k)] > 0.0).then_some(own);
        let found = ascent.climb(&widths, effort, known);
        for (i, j) in (0..widths.len()).flat_map(|i| (0..widths.len()).map(move |j| (i, j))) {
            curvature[(ascent.free[i], ascent.free[j])] = found[(i, j)];
        }
    }
    Maximum { at: ascent.at, value: ascent.best, curvature }
}

struct Ascent<F> {
    value: F,
    at: Vec<f64>,
    best: f64,
    /// The variables that move, and their bounds.
    free: Vec<usize>,
    bounds: Vec<[f64; 2]>,
    used: usize,
}

impl<F: FnMut(&[f64]) -> f64> Ascent<F> {
    /// Returns the curvature in the end.
    fn climb(
        &mut self,
        widths: &[f64],
        Effort { tolerance, evaluations }: Effort,
        known: Option<DMatrix<f64>>,
    ) -> DMatrix<f64> {
        let mut is_fresh = known.is_none();
        let (mut gradient, mut curvature) = match known {
            Some(known) => (self.forward(&known), known),
            None => self.central(widths),
        };
        while self.used < evaluations {
            let Some((step, promised)) = self.step(&gradient, &curvature) else { break };
            if promised < tolerance {
                break;
            }
            let before = self.best;
            let Some(step) = self.advance(&step) else {
                if is_fresh {
                    break;
                }
                let nearer: Vec<f64> = (0..widths.len()).map(|k| difference(&curvature, k)).collect();
                (gradient, curvature) = self.central(&nearer);
                is_fresh = true;
                continue;
            };
            if self.best - before < tolerance {
                break;
            }
            let there = self.forward(&curvature);
            update(&mut curvature, &step, &(&gradient - &there));
            (gradient, is_fresh) = (there, false);
        }
        curvature
    }

    /// The value at a place moved by some amounts of some free variables.
    fn at_offset(&mut self, moved: &[(usize, f64)]) -> f64 {
        let mut there = self.at.clone();
        for (k, by) in moved {
            there[self.free[*k]] += by;
        }
        self.used += 1;
        (self.value)(&there)
    }

    /// Gradient and curvature, the negative of the second derivatives, by central differences.
    fn central(&mut self, widths: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
        let (mut gradient, mut curvature) = (DVector::zeros(widths.len()), DMatrix::zeros(widths.len(), widths.len()));
        for (k, width) in widths.iter().enumerate() {
            let [up, down] = [*width, -width].map(|by| self.is_within(k, by).then(|| self.at_offset(&[(k, by)])));
            (gradient[k], curvature[(k, k)]) = match (up, down) {
                (Some(up), Some(down)) => {
                    ((up - down) / (2.0 * width), (2.0 * self.best - up - down).abs() / (width * width))
                }
                (Some(up), None) => ((up - self.best) / width, 0.0),
                (None, Some(down)) => ((self.best - down) / width, 0.0),
                (None, None) => (0.0, 0.0),
            };
            curvature[(k, k)] = curvature[(k, k)].max(LEAST_CURVATURE);
        }
        (gradient, curvature)
    }

    /// The gradient by one difference in each variable, less what the curvature adds to it.
    fn forward(&mut self, curvature: &DMatrix<f64>) -> DVector<f64> {
        let mut gradient = DVector::zeros(self.free.len());
        for (k, slope) in gradient.iter_mut().enumerate() {
            let width = difference(curvature, k);
            let width = if self.is_within(k, width) { width } else { -width };
            *slope = (self.at_offset(&[(k, width)]) - self.best) / width + 0.5 * curvature[(k, k)] * width;
        }
        gradient
    }

    fn is_within(&self, k: usize, by: f64) -> bool {
        let there = self.at[self.free[k]] + by;
        self.bounds[k][0] <= there && there <= self.bounds[k][1]
    }

    /// The step to the top of the quadratic model, no longer in any variable than is believed, and the gain that it promises. What a
    /// bound holds stays.
    fn step(&self, gradient: &DVector<f64>, curvature: &DMatrix<f64>) -> Option<(DVector<f64>, f64)> {
        let (mut gradient, mut model) = (gradient.clone(), curvature.clone());
        for k in 0..self.free.len() {
            let [lower, upper] = self.bounds[k].map(|bound| bound - self.at[self.free[k]]);
            if (gradient[k] > 0.0 && upper < AT_BOUND) || (gradient[k] < 0.0 && lower > -AT_BOUND) {
                gradient[k] = 0.0;
                model.row_mut(k).fill(0.0);
                model.column_mut(k).fill(0.0);
                model[(k, k)] = 1.0;
            }
        }
        let mut step = Cholesky::new(model)?.solve(&gradient);
        let promised = 0.5 * gradient.dot(&step);
        for k in 0..self.free.len() {
            let [lower, upper] = self.bounds[k].map(|bound| bound - self.at[self.free[k]]);
            step[k] = step[k].clamp(-LONGEST, LONGEST).clamp(lower.min(0.0), upper.max(0.0));
        }
        Some((step, promised))
    }

    /// Goes as much of a step as leads up; returns what it went.
    fn advance(&mut self, step: &DVector<f64>) -> Option<DVector<f64>> {
        let mut step = step.clone();
        for _ in 0..SHORTENED {
            let moved: Vec<(usize, f64)> = step.iter().copied().enumerate().collect();
            let found = self.at_offset(&moved);
            if found > self.best {
                self.best = found;
                for (k, by) in moved {
                    self.at[self.free[k]] += by;
                }
                return Some(step);
            }
            step *= SHORTER;
        }
        None
    }
}

/// Where a difference in a variable is taken.
fn difference(curvature: &DMatrix<f64>, k: usize) -> f64 {
    (2.0 * NOTICEABLE / curvature[(k, k)]).sqrt().clamp(DIFFERENCE[0], DIFFERENCE[1])
}

/// The BFGS formula: the curvature that a step met.
fn update(curvature: &mut DMatrix<f64>, step: &DVector<f64>, met: &DVector<f64>) {
    let (along, expected) = (met.dot(step), &*curvature * step);
    let before = expected.dot(step);
    // Powell's damping keeps it positive definite where the function bends upwards.
    let share = if along >= 0.2 * before { 1.0 } else { 0.8 * before / (before - along) };
    let met = share * met + (1.0 - share) * &expected;
    *curvature += &met * met.transpose() / met.dot(step) - &expected * expected.transpose() / before;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilted_paraboloid_is_climbed() {
        let f = |x: &[f64]| -((x[0] - 2.0).powi(2) + 3.0 * (x[1] + 1.0).powi(2) + (x[0] - 2.0) * (x[1] + 1.0));
        let effort = Effort { tolerance: 1e-4, evaluations: 1000 };
        let Maximum { at, value: best, .. } = maximize(&[0.0, 0.0], &[0.5, 0.5], &[[-9.0, 9.0]; 2], effort, None, f);
        assert!((at[0] - 2.0).abs() < 2e-2 && (at[1] + 1.0).abs() < 2e-2 && best > -1e-3, "{at:?}");
    }

    #[test]
    fn steep_and_flat_directions_that_hang_together_take_few_evaluations() {
        // As of a noise that thousands of samples tell, of a strength that few do, and of two strengths of which one does for the other.
        let f = |x: &[f64]| {
            let valley = 300.0 * (x[1] + x[2] - 0.7).powi(2) + 2.0 * (x[1] - x[2] - 0.1).powi(2);
            -(2000.0 * (x[0] - 0.13 - 0.1 * x[1]).powi(2) + valley + x[3].exp() - x[3])
        };
        let mut used = 0;
        let start = [0.0, 2.0, -1.0, 1.0, 7.0];
        let effort = Effort { tolerance: 0.02, evaluations: 300 };
        let mut climb = |start: &[f64], known: Option<&DMatrix<f64>>| {
            used = 0;
            let widths = [0.5, 0.5, 0.5, 0.5, 0.0];
            let found = maximize(start, &widths, &[[-9.0, 9.0]; 5], effort, known, |x| {
                used += 1;
                f(x)
            });
            (found, used)
        };
        let (Maximum { at, value, curvature }, used) = climb(&start, None);
        assert!(value > -1.1 && used < 100, "{value} at {at:?} after {used}");
        assert!((at[4] - 7.0).abs() < 1e-12, "without a width it stays");
        // With the curvature that was met, another search nearby takes a part of them.
        let nearby = [at[0] + 0.02, at[1] - 0.1, at[2] + 0.2, at[3] + 0.3, at[4]];
        let (again, used_again) = climb(&nearby, Some(&curvature));
        assert!(again.value > -1.1 && 2 * used_again < used, "{} after {used_again}, {used} before", again.value);
    }

    #[test]
    fn a_maximum_at_a_bound_is_reached() {
        let f = |x: &[f64]| x[0] - (x[1] - x[0]).powi(2);
        let effort = Effort { tolerance: 1e-4, evaluations: 100 };
        let at = maximize(&[0.0, 0.0], &[0.5, 0.5], &[[-1.0, 0.4], [-1.0, 2.0]], effort, None, f).at;
        assert!((at[0] - 0.4).abs() < 1e-6 && (at[1] - 0.4).abs() < 0.03, "{at:?}");
    }
}
