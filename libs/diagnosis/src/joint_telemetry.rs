//! What a joint's encoder told, and what it shows of a motion.

use crate::servo_response::Nodes;
use fss_estimation::smoothing::{Reading, Smoother};
use fss_experiments::measured::Run;
use fss_plant::Plant;

/// Readings of one joint, with what it takes to smooth them at the nodes of a path.
#[derive(Clone, Debug)]
pub(crate) struct JointTelemetry {
    readings: Vec<Reading>,
    smoother: Smoother,
}

impl JointTelemetry {
    /// Of readings in the order of time; `None` without any.
    pub(crate) fn new(readings: Vec<Reading>, grid_s: &[f64]) -> Option<Self> {
        let smoother = Smoother::of_intermittent(&readings, grid_s);
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

/// Least and largest rate of each joint over all runs, rad/s.
pub(crate) fn rates(plant: &Plant, runs: &[Run]) -> Vec<[f64; 2]> {
    let of_joint = |joint: usize| {
        let rates = runs.iter().filter_map(|run| run.joints.as_ref()?.qd_rad_s.get(joint)).flatten();
        rates.filter(|v| v.is_finite()).fold([0.0, 0.0], |[low, high]: [f64; 2], v| [low.min(*v), high.max(*v)])
    };
    (0..plant.link_count()).map(of_joint).collect()
}

/// Range of each joint's angle over all runs, rad.
pub(crate) fn ranges(plant: &Plant, runs: &[Run]) -> Vec<f64> {
    let of_joint = |joint: usize| {
        let angles = runs.iter().filter_map(|run| run.joints.as_ref()?.q_rad.get(joint)).flatten();
        let finite = angles.filter(|v| v.is_finite());
        let [low, high] = finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)]);
        (high - low).max(0.0)
    };
    (0..plant.link_count()).map(of_joint).collect()
}

/// Variance of a joint's rate in a run, rad2/s2.
pub(crate) fn rate_variance(run: &Run, joint: usize) -> f64 {
    let rates = run.joints.as_ref().and_then(|joints| joints.qd_rad_s.get(joint));
    let finite: Vec<f64> = rates.into_iter().flatten().copied().filter(|v| v.is_finite()).collect();
    let count = finite.len().max(1) as f64;
    let mean = finite.iter().sum::<f64>() / count;
    finite.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count
}
