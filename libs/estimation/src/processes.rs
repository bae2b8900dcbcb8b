//! Noise processes: what a random acceleration does in a step.

/// What an Ornstein-Uhlenbeck acceleration `a' = -a / T + noise` of unit variance does in a step (R. A. Singer, "Estimating
/// optimal tracking filter performance for manned maneuvering targets", IEEE Trans. AES 6(4), 1970).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SingerStep {
    /// Position per acceleration at the start, s^2.
    pub position: f64,
    /// Velocity per acceleration at the start, s.
    pub velocity: f64,
    /// Acceleration left of that at the start.
    pub decay: f64,
    /// Covariance of position, velocity and acceleration that the step's noise adds, SI.
    pub noise: [[f64; 3]; 3],
}

/// Below this step over correlation time the closed forms lose digits, and their series serve.
const SERIES_BELOW: f64 = 0.01;

impl SingerStep {
    /// A step of `dt_s` of a process with correlation time `correlation_s`.
    pub fn new(dt_s: f64, correlation_s: f64) -> Self {
        let (d, tau) = (dt_s, correlation_s);
        let x = d / tau;
        let e = (-x).exp();
        let mut noise = [[0.0; 3]; 3];
        let (position, velocity);
        if x < SERIES_BELOW {
            velocity = d * (1.0 - x / 2.0 + x * x / 6.0);
            position = d * d / 2.0 * (1.0 - x / 3.0 + x * x / 12.0);
            let s = 2.0 / tau;
            noise[0][0] = s * d.powi(5) / 20.0 * (1.0 - 5.0 * x / 9.0);
            noise[0][1] = s * d.powi(4) / 8.0 * (1.0 - 2.0 * x / 3.0);
            noise[0][2] = s * d.powi(3) / 6.0 * (1.0 - x);
            noise[1][1] = s * d.powi(3) / 3.0 * (1.0 - 0.75 * x);
            noise[1][2] = s * d * d / 2.0 * (1.0 - x);
            noise[2][2] = s * d * (1.0 - x);
        } else {
            velocity = tau * (1.0 - e);
            position = tau * tau * (e - 1.0 + x);
            let e2 = e * e;
            noise[0][0] = (1.0 - e2 + 2.0 * x + 2.0 * x.powi(3) / 3.0 - 2.0 * x * x - 4.0 * x * e) * tau.powi(4);
            noise[0][1] = (e2 + 1.0 - 2.0 * e + 2.0 * x * e - 2.0 * x + x * x) * tau.powi(3);
            noise[0][2] = (1.0 - e2 - 2.0 * x * e) * tau * tau;
            noise[1][1] = (4.0 * e - 3.0 - e2 + 2.0 * x) * tau * tau;
            noise[1][2] = (e2 + 1.0 - 2.0 * e) * tau;
            noise[2][2] = 1.0 - e2;
        }
        (noise[1][0], noise[2][0], noise[2][1]) = (noise[0][1], noise[0][2], noise[1][2]);
        Self { position, velocity, decay: e, noise }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_steps_are_one_of_twice_the_length() {
        for (dt, tau) in [(0.01, 2.0), (0.1, 2.0), (0.5, 0.3), (0.2, 2.6)] {
            let (half, whole) = (SingerStep::new(dt, tau), SingerStep::new(2.0 * dt, tau));
            let f = [[1.0, dt, half.position], [0.0, 1.0, half.velocity], [0.0, 0.0, half.decay]];
            for i in 0..3 {
                for j in 0..3 {
                    let mut sum = half.noise[i][j];
                    for k in 0..3 {
                        for l in 0..3 {
                            sum += f[i][k] * half.noise[k][l] * f[j][l];
                        }
                    }
                    let scale = (whole.noise[i][i] * whole.noise[j][j]).sqrt();
                    assert!((sum - whole.noise[i][j]).abs() < 1e-3 * scale, "{dt} {tau} {i} {j}");
                }
            }
            let position = half.position + dt * half.velocity + half.position * half.decay;
            assert!((position - whole.position).abs() < 1e-3 * whole.position, "{dt} {tau}");
        }
    }
}
