//! What the data cannot determine, in words.

use super::Unknown;
use nalgebra::DMatrix;

/// Shares of an undetermined direction below this are rounding.
pub(super) const SHARE: f64 = 0.02;

/// A direction that leaves every observation as it is: row `k` of the right singular vectors, its columns in units of what
/// is plausible.
pub(super) fn in_words(unknowns: &[Unknown], right: &DMatrix<f64>, k: usize) -> String {
    let mut parts: Vec<(f64, &Unknown)> =
        unknowns.iter().enumerate().map(|(j, u)| (right[(k, j)] * u.plausible, u)).collect();
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
