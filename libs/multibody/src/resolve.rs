//! From motions of the end-effector to joint rates, and how well an arm can make them.

use nalgebra::{Matrix2, SMatrix, SVector};

use crate::{Coordinates, JointJacobian, JointVector, MAX_LINKS, Model};

/// Sweeps of rotations; convergence is quadratic and takes about five.
const MAX_SWEEPS: usize = 30;

/// Weighted, damped pseudoinverse of a task's Jacobian, `rows` x [`MAX_LINKS`] (zero columns beyond the last joint):
///
/// ```text
/// J+ = M J' (J M J' + damping^2 1)^-1
/// ```
///
/// with `mobility` the diagonal of `M`: 1 for a free joint, less for one that is to move less, 0 for one that is locked.
/// Undamped, `J+ x` is the solution of `J rates = x` of least `rates' M^-1 rates`. Damped it stays bounded near
/// singularities (Y. Nakamura and H. Hanafusa, J. Dynamic Systems, Measurement and Control 108, 1986).
///
/// None where the free joints cannot make all motions and there is no damping, or a number is not finite.
pub fn damped_pseudoinverse<const R: usize>(
    jacobian: &SMatrix<f64, R, MAX_LINKS>,
    mobility: &JointVector,
    damping: f64,
) -> Option<SMatrix<f64, MAX_LINKS, R>> {
    let weighted = SMatrix::<f64, MAX_LINKS, R>::from_fn(|i, j| mobility[i] * jacobian[(j, i)]);
    let square = jacobian * weighted;
    let damped = square + SMatrix::<f64, R, R>::identity() * (damping * damping);
    // Rounding can make a singular matrix look regular: what is left of the largest entry tells.
    let factors = damped.cholesky()?;
    let smallest = (0..R).map(|i| factors.l_dirty()[(i, i)]).fold(f64::INFINITY, f64::min);
    let enough = smallest * smallest > 1e-14 * damped.amax();
    enough.then(|| weighted * factors.inverse())
}

/// Damping that starts at `threshold` of the Jacobian's smallest singular value and grows to `largest` at zero:
/// `damping^2 = largest^2 (1 - (sigma / threshold)^2)` (Nakamura and Hanafusa 1986).
pub fn damping_near_singularity(smallest_singular_value: f64, threshold: f64, largest: f64) -> f64 {
    let ratio = smallest_singular_value / threshold;
    if ratio < 1.0 { largest * (1.0 - ratio * ratio).sqrt() } else { 0.0 }
}

/// Singular values of a task's Jacobian, largest first, small ones to full relative accuracy: rotations in planes of
/// two rows until all rows are orthogonal (one-sided Jacobi: M. R. Hestenes, SIAM J. 6(1), 1958).
pub fn singular_values<const R: usize>(jacobian: &SMatrix<f64, R, MAX_LINKS>) -> SVector<f64, R> {
    let mut rows = *jacobian;
    for _ in 0..MAX_SWEEPS {
        let mut settled = true;
        for i in 0..R {
            for j in i + 1..R {
                let (a, b) = (rows.row(i).into_owned(), rows.row(j).into_owned());
                let (aa, bb, ab) = (a.norm_squared(), b.norm_squared(), a.dot(&b));
                if ab.abs() <= f64::EPSILON * (aa * bb).sqrt() {
                    continue;
                }
                settled = false;
                let ratio = (bb - aa) / (2.0 * ab);
                let tangent = ratio.signum() / (ratio.abs() + ratio.hypot(1.0));
                let cos = 1.0 / tangent.hypot(1.0);
                let sin = tangent * cos;
                rows.set_row(i, &(a * cos - b * sin));
                rows.set_row(j, &(a * sin + b * cos));
            }
        }
        if settled {
            break;
        }
    }
    let mut values = SVector::<f64, R>::from_fn(|i, _| rows.row(i).norm());
    values.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
    values
}

/// How far joint rates of unit norm move the end-effector's position: an ellipse (T. Yoshikawa, "Manipulability of
/// robotic mechanisms", Int. J. Robotics Research 4(2), 1985).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Manipulability {
    /// Semi-axes, the larger first: singular values of the two position rows, m.
    pub semi_axes_m: [f64; 2],
    /// Direction of the larger in the table frame, -pi/2 to pi/2 rad.
    pub major_axis_rad: f64,
}

impl Manipulability {
    /// Of the position rows of a Jacobian, [`Model::generalized_jacobian`] of a floating or a clamped base.
    pub fn of(jacobian: &JointJacobian) -> Self {
        let rows = jacobian.fixed_rows::<2>(0);
        let square: Matrix2<f64> = rows * rows.transpose();
        let (mean, half) = (0.5 * square.trace(), 0.5 * (square.m11 - square.m22));
        let spread = half.hypot(square.m12);
        let larger = (mean + spread).sqrt();
        // The smaller from the product: no cancellation near a singularity.
        let determinant = (square.m11 * square.m22 - square.m12 * square.m12).max(0.0);
        let smaller = if larger > 0.0 { determinant.sqrt() / larger } else { 0.0 };
        Self { semi_axes_m: [larger, smaller], major_axis_rad: 0.5 * square.m12.atan2(half) }
    }

    /// Yoshikawa's measure `w = sqrt(det(J J'))`, m^2; the ellipse's area is pi times it.
    pub fn measure_m2(&self) -> f64 {
        self.semi_axes_m[0] * self.semi_axes_m[1]
    }
}

impl Model {
    /// Task of a zero-reaction maneuver, 4 x n: the generalized Jacobian, and below it the base's angular rate, which
    /// is to be zero ([`Model::reaction_vector`]; K. Yoshida et al. 2001). Without its third row for a position alone.
    pub fn zero_reaction_jacobian(&self, q: &Coordinates) -> SMatrix<f64, 4, MAX_LINKS> {
        let mut task = SMatrix::<f64, 4, MAX_LINKS>::zeros();
        task.fixed_rows_mut::<3>(0).copy_from(&self.generalized_jacobian(q));
        task.set_row(3, &self.reaction_vector(q).transpose());
        task
    }
}
