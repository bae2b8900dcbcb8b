//! Rows of telemetry: how fast they come, in which groups they are averaged, angles without jumps.

use fss_experiments::measured::{Drive, Run};
use std::f64::consts::{PI, TAU};

/// Telemetry at least this fast tells how the known torques move the arm, Hz.
const SWING_RATE_HZ: f64 = 50.0;

/// Whether the joints' torques are known all the time, so that the motion follows from them.
pub(super) fn is_driven(run: &Run) -> bool {
    let fast = run.joints.as_ref().is_some_and(|j| interval_s(&j.t_s) * SWING_RATE_HZ <= 1.01);
    run.drive != Drive::Servo && fast
}

/// Mean time between rows, s.
pub(super) fn interval_s(t_s: &[f64]) -> f64 {
    match t_s {
        [first, .., last] => (last - first) / (t_s.len() - 1) as f64,
        _ => f64::INFINITY,
    }
}

/// Median time between rows, s; 1 where there are none.
pub(super) fn median_interval(t_s: &[f64]) -> f64 {
    let mut intervals: Vec<f64> = t_s.windows(2).map(|w| w[1] - w[0]).collect();
    intervals.sort_by(f64::total_cmp);
    intervals.get(intervals.len() / 2).copied().unwrap_or(1.0)
}

/// Angles without jumps of a turn.
pub(super) fn unwrapped(values: &[f64]) -> Vec<f64> {
    let (mut turns, mut last) = (0.0, f64::NAN);
    values
        .iter()
        .map(|v| {
            if (v - last).abs() > PI {
                turns -= TAU * ((v - last) / TAU).round();
            }
            if v.is_finite() {
                last = *v;
            }
            v + turns
        })
        .collect()
}

/// Groups of rows closer together than `width_s`: each from a row to before another.
pub(super) fn groups(t_s: &[f64], width_s: f64) -> Vec<std::ops::Range<usize>> {
    let mut out = Vec::new();
    let mut from = 0;
    for k in 1..=t_s.len() {
        // A hundredth more forgives rounded stamps.
        if k == t_s.len() || t_s[k] - t_s[from] > width_s * 0.99 {
            out.push(from..k);
            from = k;
        }
    }
    out
}

/// Mean of the numbers among some rows, and how many they are.
pub(super) fn mean(values: &[f64], rows: &std::ops::Range<usize>) -> Option<(f64, f64)> {
    let within = values.get(rows.start..rows.end.min(values.len()))?;
    let known = within.iter().filter(|v| v.is_finite());
    let (sum, count) = known.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
    (count > 0.0).then_some((sum / count, count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_counted_and_gaps_bridged() {
        let angles = unwrapped(&[3.0, f64::NAN, -3.1, -3.0, 3.1]);
        assert!((angles[2] - (TAU - 3.1)).abs() < 1e-12 && (angles[4] - 3.1).abs() < 1e-12, "{angles:?}");
    }

    #[test]
    fn close_rows_are_grouped() {
        assert_eq!(groups(&[0.0, 0.001, 0.0049, 0.005, 0.2], 0.005), vec![0..3, 3..4, 4..5]);
        assert!(groups(&[], 0.005).is_empty());
    }
}
