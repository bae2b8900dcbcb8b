//! Two logs on one clock.

use super::series::{Flight, Series};
use miette::{Result, miette};

/// The largest shift that is looked for, s, and the steps of the first look.
const FARTHEST_S: f64 = 3.0;
const COARSE_S: f64 = 0.02;
/// The shift is found to this, s.
const FINE_S: f64 = 1e-5;
/// A shift counts only where at least this share of the samples is compared.
const LEAST_SHARE: f64 = 0.5;

/// Sets both logs' clocks as asked; returns by how much B's was shifted beyond that, s.
///
/// # Errors
/// Where a log lacks what they are to be aligned by.
pub(super) fn align(a: &mut Flight, b: &mut Flight, by: &str) -> Result<f64> {
    match by {
        "none" => Ok(0.0),
        "start" => {
            for flight in [a, b] {
                flight.set_zero(flight.first_ns(), 0.0);
            }
            Ok(0.0)
        }
        "mission" => {
            align_missions(a, b)?;
            Ok(0.0)
        }
        field => {
            if align_missions(a, b).is_err() {
                align(a, b, "start")?;
            }
            let named = |flight: &'_ Flight| flight.series.iter().position(|series| series.is_called(field));
            let (Some(in_a), Some(in_b)) = (named(a), named(b)) else {
                let help = "mission, start, none, or a field as /nav/state.theta_rad";
                return Err(miette!(help = help, "--align {field}: not both logs have this field"));
            };
            let shift_s = best_shift_s(&a.series[in_a], &b.series[in_b])
                .ok_or_else(|| miette!("--align {field}: it stands still or the logs have too little in common"))?;
            b.shift(shift_s);
            Ok(shift_s)
        }
    }
}

fn align_missions(a: &mut Flight, b: &mut Flight) -> Result<()> {
    let (Some(in_a), Some(in_b)) = (a.mission_ns, b.mission_ns) else {
        return Err(miette!(help = "--align start takes the first samples", "not both logs have a mission that began"));
    };
    a.set_zero(in_a, 0.0);
    b.set_zero(in_b, 0.0);
    Ok(())
}

/// The shift of B at which it differs least from A in the mean square.
fn best_shift_s(a: &Series, b: &Series) -> Option<f64> {
    let samples: Vec<(f64, f64)> = a.within([f64::NEG_INFINITY, f64::INFINITY]).collect();
    let mean = samples.iter().map(|(_, value)| value).sum::<f64>() / samples.len().max(1) as f64;
    if samples.iter().all(|(_, value)| (value - mean).abs() < f64::EPSILON) {
        return None;
    }
    let cost = |shift_s: f64| {
        let pairs = samples.iter().filter_map(|(time_s, value)| Some(a.apart(*value, b.at(time_s - shift_s)?)));
        let (count, sum) = pairs.fold((0, 0.0), |(count, sum), apart| (count + 1, sum + apart * apart));
        if f64::from(count) < LEAST_SHARE * samples.len() as f64 { f64::INFINITY } else { sum / f64::from(count) }
    };
    let steps = (FARTHEST_S / COARSE_S) as i32;
    let coarse = (-steps..=steps).map(|k| f64::from(k) * COARSE_S).min_by(|x, y| cost(*x).total_cmp(&cost(*y)))?;
    if !cost(coarse).is_finite() {
        return None;
    }
    // Between its neighbours the cost has one valley: golden section would do as well.
    let (mut low, mut high) = (coarse - COARSE_S, coarse + COARSE_S);
    while high - low > FINE_S {
        let third = (high - low) / 3.0;
        if cost(low + third) < cost(high - third) { high -= third } else { low += third }
    }
    Some(0.5 * (low + high))
}
