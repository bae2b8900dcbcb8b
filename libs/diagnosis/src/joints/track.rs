//! A measured path as a function of time.

/// Value, rate and acceleration on an even grid, with quintic Hermite polynomials between.
#[derive(Clone, Debug, Default)]
pub(super) struct Track {
    start_s: f64,
    step_s: f64,
    nodes: Vec<[f64; 3]>,
}

impl Track {
    /// From its values on the grid `start_s + k step_s`.
    pub(super) fn new(start_s: f64, step_s: f64, nodes: Vec<[f64; 3]>) -> Self {
        Self { start_s, step_s, nodes }
    }

    /// Value, rate and acceleration at `t_s`; beyond its ends it goes on at its last rate. Zeros where nothing is known.
    pub(super) fn at(&self, t_s: f64) -> [f64; 3] {
        let (Some(first), Some(last)) = (self.nodes.first(), self.nodes.last()) else { return [0.0; 3] };
        let place = (t_s - self.start_s) / self.step_s;
        let before = place.floor();
        if before < 0.0 || self.nodes.len() < 2 {
            return [first[0] + (t_s - self.start_s) * first[1], first[1], 0.0];
        }
        let k = before as usize;
        let Some(b) = self.nodes.get(k + 1) else {
            let beyond = t_s - self.start_s - self.step_s * (self.nodes.len() - 1) as f64;
            return [last[0] + beyond * last[1], last[1], 0.0];
        };
        quintic(&self.nodes[k], b, self.step_s, place - before)
    }
}

/// Quintic Hermite interpolation at the share `s` of an interval of length `h`.
pub(super) fn quintic(a: &[f64; 3], b: &[f64; 3], h: f64, s: f64) -> [f64; 3] {
    // Taylor polynomial of the left end, and three more terms that meet the right end's value and derivatives.
    let (v, w) = (a[1] * h, a[2] * h * h);
    let miss = b[0] - a[0] - v - 0.5 * w;
    let miss_rate = b[1] * h - v - w;
    let miss_acceleration = b[2] * h * h - w;
    let c3 = 10.0 * miss - 4.0 * miss_rate + 0.5 * miss_acceleration;
    let c4 = -15.0 * miss + 7.0 * miss_rate - miss_acceleration;
    let c5 = 6.0 * miss - 3.0 * miss_rate + 0.5 * miss_acceleration;
    let value = a[0] + s * (v + s * (0.5 * w + s * (c3 + s * (c4 + s * c5))));
    let rate = v + s * (w + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)));
    let acceleration = w + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5));
    [value, rate / h, acceleration / (h * h)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polynomial_of_fifth_degree_is_met_exactly() {
        let f = |t: f64| [1.0 - t + t.powi(5), -1.0 + 5.0 * t.powi(4), 20.0 * t.powi(3)];
        let track = Track::new(0.5, 0.25, (0..5).map(|k| f(0.5 + 0.25 * f64::from(k))).collect());
        for t in [0.5, 0.6, 0.75, 1.1, 1.49] {
            for (got, wanted) in track.at(t).into_iter().zip(f(t)) {
                assert!((got - wanted).abs() < 1e-10, "{got} {wanted}");
            }
        }
    }

    #[test]
    fn nothing_is_known_of_an_empty_track() {
        assert_eq!(Track::default().at(3.0), [0.0; 3]);
    }
}
