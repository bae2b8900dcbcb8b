//! The time law: from rest to rest with continuous acceleration.

/// Largest rate of the quintic, at its middle, times its duration.
pub(crate) const PEAK_RATE: f64 = 1.875;

/// Share of the way done, and its rate (1/s), at `t_s` of a quintic that takes `duration_s`.
pub(crate) fn quintic(t_s: f64, duration_s: f64) -> (f64, f64) {
    if t_s <= 0.0 {
        return (0.0, 0.0);
    }
    if t_s >= duration_s {
        return (1.0, 0.0);
    }
    let u = t_s / duration_s;
    let rate = 30.0 * u * u * (1.0 - u) * (1.0 - u) / duration_s;
    (u * u * u * (10.0 + u * (-15.0 + 6.0 * u)), rate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quintic_starts_and_ends_at_rest_and_its_rate_is_its_derivative() {
        assert_eq!(quintic(-1.0, 20.0), (0.0, 0.0));
        assert_eq!(quintic(21.0, 20.0), (1.0, 0.0));
        let step = 1e-5;
        for t in [0.001, 3.0, 10.0, 17.0, 19.999] {
            let (after, before) = (quintic(t + step, 20.0).0, quintic(t - step, 20.0).0);
            assert!(((after - before) / (2.0 * step) - quintic(t, 20.0).1).abs() < 1e-8);
        }
        assert!((quintic(10.0, 20.0).1 * 20.0 - PEAK_RATE).abs() < 1e-12);
    }
}
