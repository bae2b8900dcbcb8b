//! What the data cannot determine, in words.

use super::Unknown;
use nalgebra::DMatrix;

/// Shares of an undetermined direction below this are rounding.
pub(super) const SHARE: f64 = 0.02;

/// Directions that leave every observation as it is: `hidden` rows of the right singular vectors, columns in units of what is
/// plausible. They are combined so that each moves one parameter that no other moves: few names a sentence.
pub(super) fn in_words(unknowns: &[Unknown], right: &DMatrix<f64>, hidden: &[usize]) -> Vec<String> {
    let mut rows = DMatrix::from_fn(hidden.len(), unknowns.len(), |i, j| right[(hidden[i], j)]);
    // Gauss and Jordan with complete pivoting.
    for i in 0..rows.nrows() {
        let (mut pivot, mut largest) = ((i, 0), 0.0);
        for r in i..rows.nrows() {
            for c in 0..rows.ncols() {
                if rows[(r, c)].abs() > largest {
                    (pivot, largest) = ((r, c), rows[(r, c)].abs());
                }
            }
        }
        if largest == 0.0 {
            break;
        }
        rows.swap_rows(i, pivot.0);
        let row = rows.row(i) / rows[(i, pivot.1)];
        rows.set_row(i, &row);
        for other in (0..rows.nrows()).filter(|other| *other != i) {
            let less = rows.row(other) - &row * rows[(other, pivot.1)];
            rows.set_row(other, &less);
        }
    }
    (0..rows.nrows()).map(|i| sentence(unknowns, &rows, i)).collect()
}

fn sentence(unknowns: &[Unknown], rows: &DMatrix<f64>, k: usize) -> String {
    let mut parts: Vec<(f64, &Unknown)> =
        unknowns.iter().enumerate().map(|(j, u)| (rows[(k, j)] * u.plausible, u)).collect();
    parts.retain(|(step, u)| (step / u.plausible).abs() > SHARE);
    parts.sort_by(|a, b| (b.0 / b.1.plausible).abs().total_cmp(&(a.0 / a.1.plausible).abs()));
    let Some(first) = parts.first().copied() else { return "a combination of all parameters".into() };
    let others: Vec<String> =
        parts[1..].iter().map(|(step, u)| format!("{} by {:+.3}", u.name, step / first.0)).collect();
    match &parts[..] {
        [(_, only)] => format!("{} is not seen in this data", only.name),
        // Two that trade against each other: what is left unchanged is a total, and the reader can be told which.
        [(a, one), (b, other)] => {
            let share = -a / b;
            let sign = if share < 0.0 { '-' } else { '+' };
            let share = share.abs();
            let total = if (share - 1.0).abs() < 0.01 {
                format!("{} {sign} {}", one.name, other.name)
            } else {
                format!("{} {sign} {share:.3} {}", one.name, other.name)
            };
            format!("only the total {total} is seen: {} by +1 together with {} changes nothing", one.name, others[0])
        }
        _ => format!(
            "only the total of these is seen: {} by +1 together with {} changes nothing",
            first.1.name,
            others.join(", ")
        ),
    }
}
