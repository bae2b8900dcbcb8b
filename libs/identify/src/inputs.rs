//! Whether the valve commands of a run belong to its motion.
//!
//! With commands that are not those of the run any model fits best that makes thrusters weak, since next to a wrong input
//! none is better. So a run that no cause explains is simulated once more as if no valve had opened: commands that do worse
//! than none are not those of the motion. Whose they are instead, another run's or the same at another time, is tried next.

use crate::evidence::Evidence;
use crate::trial::Trial;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use rayon::prelude::*;

/// Mean square of the whitened residuals above which a run counts as not explained.
const UNEXPLAINED: f64 = 4.0;
/// Other commands are those of the motion if they leave at most this share of what is over the noise.
const FAR_BETTER: f64 = 0.2;
/// Shifts that are tried, and between two of them, s.
const LONGEST_SHIFT_S: f64 = 3.0;
const SHIFT_STEP_S: f64 = 0.05;

/// A run whose commands are not those of its motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Mismatch {
    /// The run.
    pub run: String,
    /// Why, in a sentence.
    pub why: String,
}

impl std::fmt::Display for Mismatch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "input mismatch in {}, which tells nothing else: {}", self.run, self.why)
    }
}

/// Finds such runs among those that `trial` does not explain.
pub(crate) fn mismatches(trial: &Trial, runs: &[Run]) -> Result<Vec<Mismatch>, ModelError> {
    let of = |(i, run): (usize, &Run)| -> Result<Option<Mismatch>, ModelError> {
        let left = |levels: &[(f64, Vec<f64>)]| mean_square(trial, run, levels);
        let Some(own) = left(&run.thrust_levels)?.filter(|own| *own > UNEXPLAINED) else { return Ok(None) };
        if !run.fires_at_all() || left(&[])?.is_none_or(|coasting| coasting > own) {
            return Ok(None);
        }
        let is_better = |other: Option<f64>| other.filter(|other| *other - 1.0 < FAR_BETTER * (own - 1.0));
        let mut better: Vec<(f64, String)> = Vec::new();
        for other in runs.iter().enumerate().filter(|(k, other)| *k != i && !other.thrust_levels.is_empty()) {
            let what = || format!("those of {} do", other.1.name);
            better.extend(is_better(left(&other.1.thrust_levels)?).map(|left| (left, what())));
        }
        let steps = (LONGEST_SHIFT_S / SHIFT_STEP_S).round() as i32;
        for shift_s in (-steps..=steps).map(|k| f64::from(k) * SHIFT_STEP_S) {
            let shifted: Vec<_> =
                run.thrust_levels.iter().map(|(t_s, levels)| (t_s + shift_s, levels.clone())).collect();
            let what =
                || format!("the same {:.2} s {} do", shift_s.abs(), if shift_s < 0.0 { "earlier" } else { "later" });
            better.extend(is_better(left(&shifted)?).map(|left| (left, what())));
        }
        let best = better.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let instead = best.map_or_else(String::new, |(_, what)| format!(", {what}"));
        let why = format!("its valve commands explain its motion no better than none at all{instead}");
        Ok(Some(Mismatch { run: run.name.clone(), why }))
    };
    let found: Result<Vec<_>, ModelError> = runs.par_iter().enumerate().map(of).collect();
    Ok(found?.into_iter().flatten().collect())
}

/// What is left of a run if these were its commands; `None` where nothing can be simulated.
fn mean_square(trial: &Trial, run: &Run, thrust_levels: &[(f64, Vec<f64>)]) -> Result<Option<f64>, ModelError> {
    let run = Run { thrust_levels: thrust_levels.to_vec(), ..run.clone() };
    let cells = Evidence::gather(trial, std::slice::from_ref(&run))?.cells;
    let freedom: f64 = cells.iter().map(|cell| cell.freedom).sum();
    let left: f64 = cells.iter().map(|cell| cell.residual.norm_squared()).sum();
    Ok((freedom > 0.0).then(|| left / freedom))
}
