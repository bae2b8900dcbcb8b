//! A smooth motion through scattered angles and rates, and how far it is known.
//!
//! The motion is taken for a process with white jerk (state: angle, rate, acceleration) that angles and rates measure, filtered
//! forward and smoothed backward (Bryson and Frazier, 1963; Bierman, 1973). The jerk's density is the one with the
//! largest likelihood of the innovations, so that a resting joint is smoothed hard and a shaking one hardly; or a Markov chain that the
//! innovations tell, where a motion comes and goes.
//!
//! What it takes for one series of readings serves every other with the same times and variances: [`Smoother::path`] is linear.

use nalgebra::{Matrix3, Vector3};

/// What was measured at one time; what was not is `None`.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Time, s.
    pub t_s: f64,
    /// Angle (rad) or length (m), and the variance of its noise.
    pub angle: Option<(f64, f64)>,
    /// Its rate, and the variance of its noise.
    pub rate: Option<(f64, f64)>,
}

/// Standard deviations before the first reading: rad, rad/s, rad/s2 (those of a pendulum that is let go).
const START_SD: [f64; 3] = [5.0, 30.0, 300.0];
/// Densities of white jerk that are tried, rad/s3 per root Hz (or m): from a resting joint to a pendulum that turns over.
const JERKS: [f64; 16] = [1e-5, 1e-4, 1e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4];
/// How long a density of jerk lasts on average, s: a manoeuvre, or a rest between two.
const STEADY_S: f64 = 2.0;

/// One measured component: which of the state it shows, the variance of its innovation, its gain.
#[derive(Clone, Copy, Debug)]
struct Update {
    component: usize,
    variance: f64,
    gain: Vector3<f64>,
}

/// The filter at one time, after what was measured then.
#[derive(Clone, Debug)]
struct Step {
    /// Since the step before, s.
    dt_s: f64,
    covariance: Matrix3<f64>,
    updates: [Option<Update>; 2],
    /// Which reading this is; `None` for a time of the grid.
    reading: Option<usize>,
}

/// Gains and covariances at the times of all readings and of a grid.
#[derive(Clone, Debug)]
pub struct Smoother {
    steps: Vec<Step>,
}

/// For each density of jerk that is tried, the logarithm of the likelihood of each reading given those before.
fn log_likelihoods_by_jerk(readings: &[Reading]) -> impl Iterator<Item = Vec<f64>> {
    let of = |jerk| Smoother::with_jerk(readings, &vec![jerk; readings.len()], &[]).log_likelihoods(readings);
    JERKS.into_iter().map(of)
}

/// The density of jerk with the largest likelihood, rad/s3 per root Hz.
fn likeliest_jerk(readings: &[Reading]) -> f64 {
    let each = JERKS.into_iter().zip(log_likelihoods_by_jerk(readings).map(|each| each.iter().sum::<f64>()));
    each.reduce(|best, other| if other.1 > best.1 { other } else { best }).map_or(JERKS[0], |best| best.0)
}

/// The density of jerk up to each reading: its mean over a hidden Markov chain of the densities that are tried, for the variance of a
/// smoothed rate is in proportion to it.
fn intermittent_jerk(readings: &[Reading]) -> Vec<f64> {
    let mut likelihoods = vec![[0.0; JERKS.len()]; readings.len()];
    for (level, each) in log_likelihoods_by_jerk(readings).enumerate() {
        likelihoods.iter_mut().zip(each).for_each(|(own, likelihood)| own[level] = likelihood);
    }
    let times: Vec<f64> = readings.iter().map(|r| r.t_s).collect();
    let mean = |p: [f64; JERKS.len()]| p.iter().zip(JERKS).map(|(p, jerk)| p * jerk).sum::<f64>();
    occupancy(&times, &likelihoods).into_iter().map(mean).collect()
}

/// Probability of each level at each time, from the logarithms of what each level predicts: forward and backward over a chain that
/// stays for [`STEADY_S`] on average, and then takes any level.
fn occupancy<const N: usize>(times_s: &[f64], log_likelihoods: &[[f64; N]]) -> Vec<[f64; N]> {
    let normal = |p: [f64; N]| {
        let sum: f64 = p.iter().sum();
        p.map(|p| p / sum)
    };
    let seen = |p: [f64; N], log: &[f64; N]| {
        let most = log.iter().fold(f64::MIN, |a, b| a.max(*b));
        normal(std::array::from_fn(|i| p[i] * (log[i] - most).exp().max(f64::MIN_POSITIVE)))
    };
    let later = |p: [f64; N], dt_s: f64| {
        let stays = (-dt_s / STEADY_S).exp();
        p.map(|p| stays * p + (1.0 - stays) / N as f64)
    };
    let even = [1.0 / N as f64; N];
    let interval = |k: usize| times_s[k + 1] - times_s[k];
    let mut forward: Vec<[f64; N]> = Vec::with_capacity(times_s.len());
    for (k, log) in log_likelihoods.iter().enumerate() {
        let before = forward.last().map_or(even, |p| later(*p, interval(k - 1)));
        forward.push(seen(before, log));
    }
    let mut after = even;
    for k in (0..forward.len()).rev() {
        if k + 1 < forward.len() {
            after = later(seen(after, &log_likelihoods[k + 1]), interval(k));
        }
        forward[k] = normal(std::array::from_fn(|i| forward[k][i] * after[i]));
    }
    forward
}

fn transition(dt: f64) -> Matrix3<f64> {
    Matrix3::new(1.0, dt, 0.5 * dt * dt, 0.0, 1.0, dt, 0.0, 0.0, 1.0)
}

fn process(dt: f64, jerk: f64) -> Matrix3<f64> {
    let (a, b, c) = (dt.powi(5) / 20.0, dt.powi(4) / 8.0, dt.powi(3) / 6.0);
    let (d, e) = (dt.powi(3) / 3.0, dt * dt / 2.0);
    Matrix3::new(a, b, c, b, d, e, c, e, dt) * (jerk * jerk)
}

impl Step {
    fn ahead(&self, dt_s: f64, jerk: f64) -> Self {
        let f = transition(dt_s);
        let covariance = f * self.covariance * f.transpose() + process(dt_s, jerk);
        Self { dt_s, covariance, updates: [None; 2], reading: None }
    }

    fn measure(&mut self, component: usize, noise: f64) {
        let column: Vector3<f64> = self.covariance.column(component).into_owned();
        let variance = column[component] + noise;
        let gain = column / variance;
        self.covariance -= gain * column.transpose();
        self.covariance = 0.5 * (self.covariance + self.covariance.transpose());
        self.updates[component] = Some(Update { component, variance, gain });
    }
}

impl Smoother {
    /// For readings in the order of time, at the times `grid_s` (increasing).
    pub fn new(readings: &[Reading], grid_s: &[f64]) -> Self {
        Self::with_jerk(readings, &vec![likeliest_jerk(readings); readings.len()], grid_s)
    }

    /// The same for a motion that comes and goes, as what a servo does beside what it is expected to.
    pub fn of_intermittent(readings: &[Reading], grid_s: &[f64]) -> Self {
        Self::with_jerk(readings, &intermittent_jerk(readings), grid_s)
    }

    /// With this density of jerk up to each reading, rad/s3 per root Hz.
    fn with_jerk(readings: &[Reading], jerks: &[f64], grid_s: &[f64]) -> Self {
        let first = readings.first().map_or(0.0, |m| m.t_s).min(grid_s.first().copied().unwrap_or(f64::INFINITY));
        let sd = Vector3::from(START_SD);
        let covariance = Matrix3::from_diagonal(&sd.component_mul(&sd));
        let mut now = Step { dt_s: 0.0, covariance, updates: [None; 2], reading: None };
        let mut now_s = first;
        let mut steps: Vec<Step> = Vec::with_capacity(readings.len() + grid_s.len());
        let mut grid = grid_s.iter().copied().peekable();
        for (k, (reading, jerk)) in readings.iter().zip(jerks.iter().copied()).enumerate() {
            while let Some(t_s) = grid.next_if(|t| *t < reading.t_s) {
                now = now.ahead(t_s - now_s, jerk);
                now_s = t_s;
                steps.push(now.clone());
            }
            now = Step { reading: Some(k), ..now.ahead(reading.t_s - now_s, jerk) };
            now_s = reading.t_s;
            for (component, measured) in [reading.angle, reading.rate].into_iter().enumerate() {
                if let Some((_, noise)) = measured {
                    now.measure(component, noise);
                }
            }
            steps.push(now.clone());
        }
        let jerk = jerks.last().copied().unwrap_or(JERKS[0]);
        for t_s in grid {
            now = now.ahead(t_s - now_s, jerk);
            now_s = t_s;
            steps.push(now.clone());
        }
        Self { steps }
    }

    /// Runs the filter's means through readings; `see` gets each step, its mean and the innovations of its updates.
    fn forward(&self, readings: &[Reading], mut see: impl FnMut(&Step, &Vector3<f64>, [f64; 2])) {
        let mut mean = Vector3::zeros();
        for step in &self.steps {
            mean = transition(step.dt_s) * mean;
            let mut innovations = [0.0; 2];
            let reading = step.reading.map(|k| &readings[k]);
            for update in step.updates.iter().flatten() {
                let value = reading.and_then(|r| if update.component == 0 { r.angle } else { r.rate });
                let innovation = value.map_or(0.0, |(v, _)| v - mean[update.component]);
                innovations[update.component] = innovation;
                mean += update.gain * innovation;
            }
            see(step, &mean, innovations);
        }
    }

    /// Logarithm of the likelihood of each reading, given those before.
    fn log_likelihoods(&self, readings: &[Reading]) -> Vec<f64> {
        let mut out = Vec::with_capacity(readings.len());
        self.forward(readings, |step, _, innovations| {
            let of = |update: &Update| innovations[update.component].powi(2) / update.variance + update.variance.ln();
            out.extend(step.reading.map(|_| -0.5 * step.updates.iter().flatten().map(of).sum::<f64>()));
        });
        out
    }

    /// Angle, rate and acceleration at the grid's times, for readings of the times and variances that this was made for. Modified
    /// Bryson-Frazier smoother: the adjoint of the innovations runs back through the filter, and no covariance, which a weak
    /// process leaves near singular, has to be inverted.
    pub fn path(&self, readings: &[Reading]) -> Vec<[f64; 3]> {
        let mut forward = Vec::with_capacity(self.steps.len());
        self.forward(readings, |_, mean, innovations| forward.push((*mean, innovations)));
        let mut out = Vec::with_capacity(self.steps.len());
        let mut adjoint = Vector3::<f64>::zeros();
        for (step, (mean, innovations)) in self.steps.iter().zip(forward).rev() {
            if step.reading.is_none() {
                out.push((mean - step.covariance * adjoint).into());
            }
            for update in step.updates.iter().rev().flatten() {
                let c = update.component;
                adjoint[c] -= update.gain.dot(&adjoint) + innovations[c] / update.variance;
            }
            adjoint = transition(step.dt_s).transpose() * adjoint;
        }
        out.reverse();
        out
    }

    /// Variances of angle, rate and acceleration at the grid's times.
    pub fn variances(&self) -> Vec<[f64; 3]> {
        let mut out = Vec::with_capacity(self.steps.len());
        let mut information = Matrix3::zeros();
        for step in self.steps.iter().rev() {
            if step.reading.is_none() {
                let covariance = step.covariance - step.covariance * information * step.covariance;
                out.push(std::array::from_fn(|i| covariance[(i, i)].max(0.0)));
            }
            for update in step.updates.iter().rev().flatten() {
                let mut row = Vector3::zeros();
                row[update.component] = 1.0;
                let keep = Matrix3::identity() - update.gain * row.transpose();
                information = keep.transpose() * information * keep + row * row.transpose() / update.variance;
            }
            let f = transition(step.dt_s);
            information = f.transpose() * information * f;
        }
        out.reverse();
        out
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Draws of noise of a standard deviation.
    fn noise(seed: u64) -> impl FnMut(f64) -> f64 {
        println!("seed {seed}");
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        move |sd| sd * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng)
    }

    fn smooth(readings: &[Reading], grid_s: &[f64]) -> Vec<[f64; 3]> {
        Smoother::new(readings, grid_s).path(readings)
    }

    #[test]
    fn a_swinging_joint_is_known_between_its_telemetry() {
        let mut noise = noise(11);
        let w = 4.0;
        let readings: Vec<_> = (0..200)
            .map(|k| {
                let t_s = 0.2 * f64::from(k);
                let angle = Some((0.03 * (w * t_s).sin() + noise(2e-4), 4e-8));
                Reading { t_s, angle, rate: Some((0.03 * w * (w * t_s).cos() + noise(2e-3), 4e-6)) }
            })
            .collect();
        let grid: Vec<f64> = (0..3900).map(|k| 0.01 * f64::from(k)).collect();
        let out = smooth(&readings, &grid);
        let rms = |f: &dyn Fn(usize) -> f64| ((0..grid.len()).map(|i| f(i).powi(2)).sum::<f64>() / 3900.0).sqrt();
        let angle = rms(&|i| out[i][0] - 0.03 * (w * grid[i]).sin());
        let rate = rms(&|i| out[i][1] - 0.03 * w * (w * grid[i]).cos());
        assert!(angle < 2.5e-4 && rate < 2.5e-3, "{angle} rad, {rate} rad/s");
        // As far as it says that it knows.
        let smoother = Smoother::new(&readings, &grid);
        let said = smoother.variances().iter().map(|v| v[0]).sum::<f64>() / 3900.0;
        assert!((0.5..2.0).contains(&(angle * angle / said)), "{angle} rad against {}", said.sqrt());
    }

    #[test]
    fn a_joint_that_rests_and_creeps_once_is_known_as_far_as_it_is_said_to_be() {
        let mut noise = noise(12);
        let (height_rad, w) = (4e-3, std::f64::consts::PI / 1.5);
        let creep = |t_s: f64| {
            let phase = w * (t_s - 20.0).clamp(0.0, 1.5);
            [0.5 * height_rad * (1.0 - phase.cos()), 0.5 * height_rad * w * phase.sin()]
        };
        let reading = |k: u32| {
            let t_s = 0.2 * f64::from(k);
            let [q, qd] = creep(t_s);
            Reading { t_s, angle: Some((q + noise(2e-4), 4e-8)), rate: Some((qd + noise(2e-3), 4e-6)) }
        };
        let readings: Vec<Reading> = (0..200).map(reading).collect();
        let grid: Vec<f64> = (0..3980).map(|k| 0.01 * f64::from(k)).collect();
        // Root mean square of the error over what is said of it, within a time.
        let over = |smoother: &Smoother, from_s: f64, to_s: f64| {
            let nodes = grid.iter().zip(smoother.path(&readings).into_iter().zip(smoother.variances()));
            let within = nodes.filter(|(t, _)| (from_s..to_s).contains(*t));
            let (sum, n) = within.fold((0.0, 0.0), |(sum, n), (t, (node, variance))| {
                (sum + (node[0] - creep(*t)[0]).powi(2) / variance[0], n + 1.0)
            });
            f64::sqrt(sum / n)
        };
        let smoother = Smoother::of_intermittent(&readings, &grid);
        let (rests, creeps) = (over(&smoother, 1.0, 19.0), over(&smoother, 19.8, 21.7));
        assert!((0.4..2.0).contains(&rests) && (0.4..2.0).contains(&creeps), "{rests} at rest, {creeps} as it creeps");
        // While it rests it is known well.
        let at_rest = smoother.variances()[1000][0].sqrt();
        assert!(at_rest < 1e-4, "{at_rest} rad");
        let steady = over(&Smoother::new(&readings, &grid), 19.8, 21.7);
        assert!(steady > creeps, "{steady} with one density of jerk, {creeps} with a chain");
    }

    #[test]
    fn a_chain_of_two_levels_is_as_probable_as_the_sum_over_all_its_ways() {
        let (times, logs) = ([0.0, 1.0, 4.0], [[-0.3, -1.2], [-2.0, -0.1], [-0.4, -0.9]]);
        let stays = |k: usize| f64::exp(-(times[k + 1] - times[k]) / STEADY_S);
        let goes = |k: usize, a: usize, b: usize| 0.5 * (1.0 - stays(k)) + if a == b { stays(k) } else { 0.0 };
        let way = |w: usize| {
            let level = [w & 1, (w >> 1) & 1, (w >> 2) & 1];
            let seen: f64 = (0..3).map(|k| logs[k][level[k]]).sum();
            seen.exp() * goes(0, level[0], level[1]) * goes(1, level[1], level[2])
        };
        let total: f64 = (0..8).map(way).sum();
        for (k, p) in occupancy(&times, &logs).into_iter().enumerate() {
            let first: f64 = (0..8).filter(|w| (w >> k) & 1 == 0).map(way).sum();
            assert!((p[0] - first / total).abs() < 1e-12 && (p[0] + p[1] - 1.0).abs() < 1e-12, "{p:?}");
        }
    }

    #[test]
    fn a_resting_joint_is_smoothed_to_rest() {
        let readings: Vec<_> = (0..200)
            .map(|k| {
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                let (angle, rate) = (Some((0.1 + 2e-4 * sign, 4e-8)), Some((2e-3 * sign, 4e-6)));
                Reading { t_s: 0.2 * f64::from(k), angle, rate }
            })
            .collect();
        let out = smooth(&readings, &[10.0, 10.1, 20.0]);
        assert!(out.iter().all(|s| (s[0] - 0.1).abs() < 5e-5 && s[1].abs() < 2e-4), "{out:?}");
    }

    #[test]
    fn a_swing_is_followed_with_its_acceleration() {
        let w = 10.0_f64;
        let readings: Vec<_> = (0..2000)
            .map(|k| {
                let t_s = 0.005 * f64::from(k);
                let noise = if k % 2 == 0 { 4e-5 } else { -4e-5 };
                Reading { t_s, angle: Some((1.5 * (w * t_s).sin() + noise, 1.6e-9)), rate: None }
            })
            .collect();
        let grid: Vec<f64> = (100..1900).map(|k| 0.005 * f64::from(k) + 0.002).collect();
        for (t, s) in grid.iter().zip(smooth(&readings, &grid)) {
            assert!((s[2] + 150.0 * (w * t).sin()).abs() < 2.0, "{} rad/s2 at {t} s", s[2]);
        }
    }
}
