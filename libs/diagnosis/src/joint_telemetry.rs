//! What a joint's encoder told, and what it shows of a motion.

use crate::servo_response::Nodes;
use fss_estimation::smoothing::{Reading, Smoother, likeliest_jerk};

/// Readings of one joint, with what it takes to smooth them at the nodes of a path.
#[derive(Clone, Debug)]
pub(crate) struct JointTelemetry {
    readings: Vec<Reading>,
    smoother: Smoother,
}

impl JointTelemetry {
    /// Of readings in the order of time; `None` without any.
    pub(crate) fn new(readings: Vec<Reading>, grid_s: &[f64]) -> Option<Self> {
        let jerk = likeliest_jerk(&readings);
        let smoother = Smoother::new(&readings, jerk, grid_s);
        (!readings.is_empty()).then_some(Self { readings, smoother })
    }

    /// The motion that they tell, at the nodes.
    pub(crate) fn path(&self) -> Nodes {
        self.smoother.path(&self.readings)
    }

    /// Variances of its angles, rates and accelerations.
    pub(crate) fn variances(&self) -> Nodes {
        self.smoother.variances()
    }

    /// What they do not show, between their times, of a change of the motion: its nodes, and its angle and rate over time.
    pub(crate) fn unseen(&self, change: &Nodes, at: impl Fn(f64) -> [f64; 2]) -> Nodes {
        let reading = |r: &Reading| {
            let [angle, rate] = at(r.t_s);
            Reading { angle: r.angle.map(|(_, n)| (angle, n)), rate: r.rate.map(|(_, n)| (rate, n)), ..*r }
        };
        let readings: Vec<Reading> = self.readings.iter().map(reading).collect();
        let seen = self.smoother.path(&readings);
        change.iter().zip(&seen).map(|(all, seen)| std::array::from_fn(|i| all[i] - seen[i])).collect()
    }
}
