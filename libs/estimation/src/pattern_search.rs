//! Maximizing a function of a few variables that are of order one, without derivatives.

/// The maximum that a pattern search reaches from `start`: each coordinate is moved by its step; what is better is kept and
/// the step grows, what is not shortens it; and after each round all that it moved is tried once more as one (Hooke and Jeeves,
/// 1961). Ends where all steps are below `tolerance`, or after
/// `evaluations`. Returns the place and the value there.
pub fn maximize(
    start: &[f64],
    steps: &[f64],
    tolerance: f64,
    evaluations: usize,
    mut value: impl FnMut(&[f64]) -> f64,
) -> (Vec<f64>, f64) {
    let (mut at, mut steps) = (start.to_vec(), steps.to_vec());
    let mut best = value(&at);
    let mut used = 1;
    while used < evaluations && steps.iter().any(|s| s.abs() >= tolerance) {
        let before = at.clone();
        for i in 0..at.len() {
            if steps[i].abs() < tolerance {
                continue;
            }
            let here = at[i];
            let mut moved = false;
            for step in [steps[i], -steps[i]] {
                at[i] = here + step;
                let found = value(&at);
                used += 1;
                if found > best {
                    best = found;
                    steps[i] = 1.5 * step;
                    moved = true;
                    break;
                }
                at[i] = here;
            }
            if !moved {
                steps[i] *= 0.4;
            }
        }
        if at != before {
            let further: Vec<f64> = at.iter().zip(&before).map(|(now, before)| 2.0 * now - before).collect();
            let found = value(&further);
            used += 1;
            if found > best {
                (best, at) = (found, further);
            }
        }
    }
    (at, best)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_tilted_paraboloid_is_climbed() {
        let f = |x: &[f64]| -((x[0] - 2.0).powi(2) + 3.0 * (x[1] + 1.0).powi(2) + (x[0] - 2.0) * (x[1] + 1.0));
        let (at, best) = super::maximize(&[0.0, 0.0], &[0.5, 0.5], 1e-3, 1000, f);
        assert!((at[0] - 2.0).abs() < 1e-2 && (at[1] + 1.0).abs() < 1e-2 && best > -1e-3, "{at:?}");
    }
}
