//! Values of several joints over time.

/// Several values over time, all at the same times.
#[derive(Clone, Debug, Default)]
pub struct Many {
    /// Times, s, increasing.
    pub t_s: Vec<f64>,
    /// One series a joint.
    pub values: Vec<Vec<f64>>,
}

impl Many {
    /// How many rows are not later than `t_s`. Most rows are as far apart as all others: there a guess finds it.
    fn rows_until(&self, t_s: f64) -> usize {
        let times = &self.t_s;
        let is_between = |rows: usize| {
            let goes_before = times.get(rows).is_none_or(|next| *next > t_s);
            goes_before && rows.checked_sub(1).and_then(|last| times.get(last)).is_none_or(|last| *last <= t_s)
        };
        let guessed = match times[..] {
            [first, .., last] => ((t_s - first) / (last - first) * (times.len() - 1) as f64) as usize,
            _ => 0,
        };
        let guessed = guessed.min(times.len());
        let mut near = [guessed + 1, guessed, guessed + 2].into_iter().filter(|rows| *rows <= times.len());
        near.find(|rows| is_between(*rows)).unwrap_or_else(|| times.partition_point(|t| *t <= t_s))
    }

    /// A joint's value at `t_s`, linear between rows and constant outside; `None` without that joint.
    pub fn at(&self, joint: usize, t_s: f64) -> Option<f64> {
        let values = self.values.get(joint)?;
        let after = self.rows_until(t_s);
        let before = after.checked_sub(1)?;
        let (Some(t1), Some(v1)) = (self.t_s.get(after), values.get(after)) else { return values.last().copied() };
        let (t0, v0) = (self.t_s[before], values[before]);
        Some(v0 + (v1 - v0) * (t_s - t0) / (t1 - t0))
    }

    /// A joint's rate at `t_s`: a parabola through the three rows around it, zero outside.
    pub fn rate_at(&self, joint: usize, t_s: f64) -> Option<f64> {
        let values = self.values.get(joint)?;
        let n = self.t_s.len();
        if n < 3 || t_s < self.t_s[0] || t_s > self.t_s[n - 1] {
            return Some(0.0);
        }
        let slope = |i: usize| (values[i + 1] - values[i]) / (self.t_s[i + 1] - self.t_s[i]);
        let middle = |i: usize| 0.5 * (self.t_s[i] + self.t_s[i + 1]);
        // Slopes stand at the middles of the intervals; between two middles they are interpolated.
        let i = self.rows_until(t_s).saturating_sub(1).min(n - 2);
        let (a, b) = if t_s < middle(i) { (i.saturating_sub(1), i) } else { (i, (i + 1).min(n - 2)) };
        if a == b {
            return Some(slope(a));
        }
        Some(slope(a) + (slope(b) - slope(a)) * (t_s - middle(a)) / (middle(b) - middle(a)))
    }

    /// A joint's acceleration at `t_s`: the second difference of the three rows around it, zero outside.
    pub fn acceleration_at(&self, joint: usize, t_s: f64) -> Option<f64> {
        let values = self.values.get(joint)?;
        let n = self.t_s.len();
        if n < 3 || t_s < self.t_s[0] || t_s > self.t_s[n - 1] {
            return Some(0.0);
        }
        let slope = |i: usize| (values[i + 1] - values[i]) / (self.t_s[i + 1] - self.t_s[i]);
        let second = |i: usize| (slope(i) - slope(i - 1)) / (0.5 * (self.t_s[i + 1] - self.t_s[i - 1]));
        let before = self.rows_until(t_s).saturating_sub(1).clamp(1, n - 2);
        let after = (before + 1).min(n - 2);
        if after == before {
            return Some(second(before));
        }
        let share = ((t_s - self.t_s[before]) / (self.t_s[after] - self.t_s[before])).clamp(0.0, 1.0);
        Some(second(before) + share * (second(after) - second(before)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn rows_are_found_at_once_or_by_search_the_same() {
        let seed = 16;
        println!("seed {seed}");
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        for case in 0..200 {
            // Even rows, rows of a shaky clock, and rows with gaps and repeats.
            let count = rng.random_range(0..60);
            let mut now = rng.random_range(-5.0..5.0);
            let mut next = || {
                now += match case % 3 {
                    0 => 0.005,
                    1 => 0.01 + rng.random_range(-0.004..0.004),
                    _ => [0.0, 0.01, 3.0][rng.random_range(0..3)],
                };
                now
            };
            let t_s: Vec<f64> = (0..count).map(|_| next()).collect();
            let asked = t_s.iter().flat_map(|t| [*t, t - 1e-9, t + 0.004]).chain([f64::MIN, -6.0, 1e9, f64::NAN]);
            for t in asked.collect::<Vec<_>>() {
                let many = Many { t_s: t_s.clone(), values: Vec::new() };
                assert_eq!(many.rows_until(t), t_s.partition_point(|row| *row <= t), "{t} in {t_s:?}");
            }
        }
    }
}
