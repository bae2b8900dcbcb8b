//! Variances that believe the residuals and not their model.
//!
//! A covariance from the weights takes what is wrong with one instant for independent of the next, or for shared in the same
//! way by all parameters. What is wrong with a motion between two reports is neither: it follows the motion, as the Jacobian
//! does. The sandwich `A^-1 (sum of s s') A^-1`, with `s` the score of a block of time longer than such errors last, holds
//! whatever is shared within a block (Liang and Zeger, Biometrika 73, 1986). Residuals are smaller than errors; blocks are
//! corrected for it as if errors were white (Bell and McCaffrey, Survey Methodology 28, 2002).

use super::{Row, SHORTEST_SERIES};
use fss_estimation::least_squares::Linearization;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Instants of one block: 4 s of telemetry at 5 Hz.
const BLOCK: usize = 20;
/// Fewer blocks tell no variance.
const LEAST_BLOCKS: usize = 8;
/// What a block may leave to the others, at least: one that has a direction for itself says nothing of its noise.
const LEAST_LEFT: f64 = 0.1;

/// Variances of all unknowns by the data's noise, in units of what is plausible; none where rows are no series, or too short. `weighted` are the
/// residuals over their noise.
pub(super) fn variances(linear: &Linearization, rows: &[Row], weighted: &[f64]) -> Option<Vec<f64>> {
    let mut lengths: BTreeMap<usize, usize> = BTreeMap::new();
    for row in rows {
        *lengths.entry(row.series).or_default() += 1;
    }
    if lengths.values().all(|length| *length < SHORTEST_SERIES) {
        return None;
    }
    let mut blocks: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, row) in rows.iter().enumerate() {
        blocks.entry(row.instant / BLOCK).or_default().push(i);
    }
    if blocks.len() < LEAST_BLOCKS {
        return None;
    }
    let n = linear.right.ncols();
    let mut variances = vec![0.0; n];
    for members in blocks.values() {
        let left = DMatrix::from_fn(members.len(), n, |r, c| linear.left[(members[r], c)]);
        let residual = DVector::from_fn(members.len(), |r, _| weighted[members[r]]);
        let eigen = (left.transpose() * &left).symmetric_eigen();
        let mut score = eigen.eigenvectors.transpose() * left.transpose() * residual;
        score.iter_mut().zip(&eigen.eigenvalues).for_each(|(s, share)| *s /= (1.0 - share).max(LEAST_LEFT).sqrt());
        let score = eigen.eigenvectors * score;
        for (j, variance) in variances.iter_mut().enumerate() {
            let along = |k: usize| linear.right[(k, j)] * linear.singular[k] * linear.variance(k) * score[k];
            *variance += (0..n).map(along).sum::<f64>().powi(2);
        }
    }
    let count = blocks.len() as f64;
    Some(variances.into_iter().map(|variance| variance * count / (count - 1.0)).collect())
}
