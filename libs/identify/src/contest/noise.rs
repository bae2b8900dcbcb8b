//! What no cause explains: how far each sensor, and the room's air, are beyond what they should be.

use super::{Contest, Refined};
use crate::normal::Normal;
use crate::trial::Whitened;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use nalgebra::DVector;
use std::collections::BTreeMap;

/// Mean square over its expectation beyond which a channel is noisier than its sensor.
const NOISY: f64 = 1.2;
/// Mean square of the gyro over its expectation beyond which links may swing on their drives, and that is asked.
const RESTLESS: f64 = 2.0;
/// The same beyond which something shakes the base, whether anybody knows what. The windows take an arm to move smoothly between two
/// reports; what sound servos do there is left in the gyro at some times its noise.
const SHAKEN: f64 = 8.0;
pub(crate) const GYRO: &str = "gyro";

/// How far a gyro stands out from its noise whatever the catalogue adds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shaken {
    /// Whose.
    pub(crate) record: usize,
    /// RMS over its noise.
    pub(crate) rms: f64,
}
/// The room's air pushes harder than it can if the mean square of its force is this much over one, and so many standard
/// deviations of a mean square more.
const HARD_PUSH: f64 = 0.5;
const HARD_PUSH_SIGMAS: f64 = 4.0;

/// Mean square of whitened rows over its expectation.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Scatter {
    sum: f64,
    expected: f64,
}

impl Scatter {
    fn add(&mut self, residual: f64, expected: f64) {
        self.sum += residual * residual;
        self.expected += expected;
    }

    /// 1 where only noise is left.
    pub(crate) fn mean_square(self) -> f64 {
        if self.expected > 0.0 { self.sum / self.expected } else { 1.0 }
    }

    fn is_hard_push(self) -> bool {
        let sigma = (2.0 / self.expected.max(1.0)).sqrt();
        self.mean_square() > 1.0 + HARD_PUSH + HARD_PUSH_SIGMAS * sigma
    }
}

/// The room's air as the windows need it: force x, force y, torque.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Air([Scatter; 3]);

impl Air {
    /// Whether something pushes the base harder than the air of the plant file can.
    pub(crate) fn is_too_strong(&self) -> bool {
        self.0.iter().any(|axis| axis.is_hard_push())
    }

    /// The sum of squares beyond what it should be.
    pub(crate) fn excess(&self) -> f64 {
        self.0.iter().map(|axis| (axis.sum - axis.expected).max(0.0)).sum()
    }

    /// RMS over what the plant file says, of the axis where that is most.
    pub(crate) fn strongest(&self) -> (&'static str, f64) {
        let names = ["along x", "along y", "turning it"];
        let axes = names.into_iter().zip(self.0.map(|axis| axis.mean_square().sqrt()));
        axes.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or(("", 1.0))
    }
}

impl Contest {
    /// The air that the windows need where this is what is left.
    pub(crate) fn air(&self, refined: &Refined) -> Air {
        let mut air = Air::default();
        for (cell, left) in self.evidence.cells.iter().zip(&self.left(refined)) {
            let span = &self.evidence.records[cell.record].spans()[cell.window];
            let (rows, knots) = (span.whitening.len(), span.prior_count / 3);
            for k in 0..3 * knots {
                air.0[k / knots].add(left[rows + k], cell.freedom_of(rows + k));
            }
        }
        air
    }

    /// The channel of a run that stands out most from its noise: channel, run, RMS of its whitened rows. Gyro and torques
    /// count half: between two reports a joint moves in ways that nothing tells, and they feel it first.
    pub(crate) fn worst(&self, refined: &Refined) -> Option<(String, String, f64)> {
        let name = |record: usize, channel: usize| self.evidence.records[record].channels()[channel].as_str();
        let weight = |name: &str| {
            if name.starts_with("base") || name.starts_with("ee") { 1.0 } else { 0.5 }
        };
        let weighed = |((record, channel), scatter): ((usize, usize), Scatter)| {
            ((record, channel), weight(name(record, channel)) * scatter.mean_square().sqrt())
        };
        let all = self.scatter(&self.left(refined)).into_iter().map(weighed);
        let ((record, channel), rms) = all.max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some((name(record, channel).to_owned(), self.evidence.records[record].name().to_owned(), rms))
    }

    fn left(&self, refined: &Refined) -> Vec<DVector<f64>> {
        self.unexplained(&refined.residuals, &refined.nuisance)
    }

    /// The mean squares of what is left, by run and channel.
    fn scatter(&self, left: &[DVector<f64>]) -> BTreeMap<(usize, usize), Scatter> {
        let mut all: BTreeMap<(usize, usize), Scatter> = BTreeMap::new();
        for (cell, residual) in self.evidence.cells.iter().zip(left) {
            let span = &self.evidence.records[cell.record].spans()[cell.window];
            for (k, row) in span.whitening.iter().enumerate() {
                all.entry((cell.record, row.channel)).or_default().add(residual[k], cell.freedom_of(k));
            }
        }
        all
    }

    /// The gyro that stands out most from its noise.
    fn most_shaken(&self, scatter: &BTreeMap<(usize, usize), Scatter>) -> Option<Shaken> {
        let is_gyro = |record: usize, channel: usize| self.evidence.records[record].channels()[channel] == GYRO;
        let gyros = scatter.iter().filter(|((record, channel), _)| is_gyro(*record, *channel));
        let all = gyros.map(|((record, _), scatter)| Shaken { record: *record, rms: scatter.mean_square().sqrt() });
        all.max_by(|a, b| a.rms.total_cmp(&b.rms))
    }

    /// Where all causes of the catalogue together leave a channel noisier than its sensor, the rest is taken for noise too:
    /// servos, say, that move between two reports otherwise than they were told. Not so of the base's own motion, which
    /// is what everything is judged by.
    pub(super) fn loosen(&mut self, runs: &[Run]) -> Result<(), ModelError> {
        let Some(mut scatter) = self.scatter_of_the_rest() else { return Ok(()) };
        let gyro = self.most_shaken(&scatter);
        self.shaken = gyro.filter(|gyro| gyro.rms.powi(2) > SHAKEN);
        if let Some(gyro) = gyro.filter(|gyro| gyro.rms.powi(2) > RESTLESS) {
            // Links that swing are dear to ask about.
            let drives = self.swinging(runs, gyro.record)?;
            self.ask_too(drives)?;
            scatter = self.scatter_of_the_rest().unwrap_or(scatter);
        }
        let noisy: BTreeMap<(usize, usize), f64> = scatter
            .into_iter()
            .filter(|((record, channel), scatter)| {
                !self.evidence.records[*record].channels()[*channel].starts_with("base")
                    && scatter.mean_square() > NOISY
            })
            .map(|(which, scatter)| (which, 1.0 / scatter.mean_square().sqrt()))
            .collect();
        for (cell, columns) in self.evidence.cells.iter_mut().zip(&mut self.columns) {
            let span = &self.evidence.records[cell.record].spans()[cell.window];
            let factor = |row: &Whitened| noisy.get(&(cell.record, row.channel)).copied().unwrap_or(1.0);
            let mut weights: Vec<f64> = span.whitening.iter().map(factor).collect();
            weights.resize(cell.residual.len(), 1.0);
            let weights = DVector::from_vec(weights);
            for mut column in columns.column_iter_mut() {
                column.component_mul_assign(&weights);
            }
            cell.weigh(weights);
        }
        self.sum_up();
        Ok(())
    }

    /// The mean squares of what all causes of the catalogue together leave, by run and channel.
    fn scatter_of_the_rest(&self) -> Option<BTreeMap<(usize, usize), Scatter>> {
        let width = self.width();
        let mut all = Normal::sum(width, self.screen.iter());
        for i in 0..width {
            let prior = if i < self.nuisance_count { self.unit } else { 1e-6 * all.g[(i, i)].max(1e-12) };
            all.g[(i, i)] += prior;
        }
        let value = all.g.cholesky()?.solve(&all.b);
        let left: Vec<DVector<f64>> =
            self.evidence.cells.iter().zip(&self.columns).map(|(cell, j)| &cell.residual - j * &value).collect();
        Some(self.scatter(&left))
    }
}
