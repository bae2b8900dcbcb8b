//! Steps of the joints' motion and of what disturbs it.

/// A transition and a covariance, 3 x 3: angle, rate, acceleration.
pub(super) type Step3 = ([[f64; 3]; 3], [[f64; 3]; 3]);

/// Nodes and weights of Gauss-Legendre quadrature over 0 to 1, exact to the seventh degree.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_9, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// Acceleration as an Ornstein-Uhlenbeck process of variance 1 and correlation time `time_s` (Singer, 1970).
pub(super) fn singer(dt_s: f64, time_s: f64) -> Step3 {
    let doublings = (dt_s / (0.5 * time_s)).log2().ceil().clamp(0.0, 30.0) as u32;
    let short_s = dt_s / f64::from(2u32.pow(doublings.min(30)));
    let mut noise = [[0.0; 3]; 3];
    for (node, weight) in GAUSS {
        let column = after_push(node * short_s, time_s);
        for i in 0..3 {
            for j in 0..3 {
                noise[i][j] += 2.0 / time_s * weight * short_s * column[i] * column[j];
            }
        }
    }
    let mut now_s = short_s;
    for _ in 0..doublings {
        let f = transition(now_s, time_s);
        let moved = sandwich(&f, &noise);
        noise = std::array::from_fn(|i| std::array::from_fn(|j| noise[i][j] + moved[i][j]));
        now_s *= 2.0;
    }
    (transition(dt_s, time_s), noise)
}

/// Angle, rate and acceleration a time after an acceleration of 1.
fn after_push(dt_s: f64, time_s: f64) -> [f64; 3] {
    let x = dt_s / time_s;
    let decayed = -(-x).exp_m1();
    // x - 1 + exp(-x) loses its digits where x is small.
    let angle = if x < 1e-3 { 0.5 * x * x * (1.0 - x / 3.0) } else { x - decayed };
    [time_s * time_s * angle, time_s * decayed, 1.0 - decayed]
}

fn transition(dt_s: f64, time_s: f64) -> [[f64; 3]; 3] {
    let [a, b, c] = after_push(dt_s, time_s);
    [[1.0, dt_s, a], [0.0, 1.0, b], [0.0, 0.0, c]]
}

fn sandwich(f: &[[f64; 3]; 3], p: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let half: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| f[i][k] * p[k][j]).sum()));
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| half[i][k] * f[j][k]).sum()))
}

/// What angle and rate gain in a step of `dt_s` by accelerations that a parabola joins: of the step before, `before_s` long, of its
/// beginning and of its end (the Adams-Moulton formula of third order). Rows: of the angle, of the rate.
pub(super) fn by_accelerations(dt_s: f64, before_s: f64) -> [[f64; 3]; 2] {
    let (h, h0) = (dt_s, before_s);
    let all = h + h0;
    let (before, end) = (-h.powi(4) / (12.0 * h0 * all), h * h * (h / 12.0 + h0 / 6.0) / all);
    let angle = [before, 0.5 * h * h - before - end, end];
    let (before, end) = (-h.powi(3) / (6.0 * h0 * all), h * (h / 3.0 + h0 / 2.0) / all);
    [angle, [before, h - before - end, end]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_of_accelerations_is_integrated_exactly() {
        let (h, h0) = (0.7, 0.4);
        let acceleration = |t: f64| 1.0 - 2.0 * t + 3.0 * t * t;
        let at = [acceleration(-h0), acceleration(0.0), acceleration(h)];
        let [angle, rate] = by_accelerations(h, h0).map(|w| w.iter().zip(at).map(|(w, a)| w * a).sum::<f64>());
        assert!((rate - (h - h * h + h.powi(3))).abs() < 1e-12, "{rate}");
        assert!((angle - (h * h / 2.0 - h.powi(3) / 3.0 + h.powi(4) / 4.0)).abs() < 1e-12, "{angle}");
    }

    #[test]
    fn two_steps_are_as_good_as_one() {
        let (time_s, total_s) = (0.2, 1.7);
        let (whole, noise) = singer(total_s, time_s);
        let (f1, q1) = singer(0.6, time_s);
        let (f2, q2) = singer(1.1, time_s);
        let moved = sandwich(&f2, &q1);
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| f2[i][k] * f1[k][j]).sum();
                assert!((product - whole[i][j]).abs() < 1e-12);
                assert!((moved[i][j] + q2[i][j] - noise[i][j]).abs() < 1e-9, "{i} {j}");
            }
        }
        assert!((noise[2][2] - 1.0).abs() < 1e-6, "the acceleration is stationary");
    }
}
