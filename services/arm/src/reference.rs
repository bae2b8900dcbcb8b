//! The joints' reference: where they shall be, and how fast they shall move.

use crate::ArmConfig;
use fss_multibody::JointVector;

/// Angles and rates that the joints follow.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Reference {
    pub(crate) q_rad: JointVector,
    pub(crate) qd_rad_s: JointVector,
}

impl Reference {
    /// Largest angle that the reference may take, to both sides of zero.
    pub(crate) fn reach(config: &ArmConfig, joint: usize) -> f64 {
        (config.limit_rad[joint] - config.margin_rad).max(0.0)
    }

    /// Least and largest rates with which no joint runs into its limit.
    pub(crate) fn rate_bounds(&self, config: &ArmConfig) -> (JointVector, JointVector) {
        let (mut low, mut high) = (-config.max_rate_rad_s, config.max_rate_rad_s);
        for i in 0..config.model.link_count() {
            let reach = Self::reach(config, i);
            high[i] = high[i].min(config.approach_1_s * (reach - self.q_rad[i]).max(0.0));
            low[i] = low[i].max(-config.approach_1_s * (reach + self.q_rad[i]).max(0.0));
        }
        (low, high)
    }

    /// Whether a joint stands at its limit, where `rate_bounds` leave it next to nothing.
    pub(crate) fn is_at_limit(&self, config: &ArmConfig, joint: usize) -> bool {
        self.q_rad[joint].abs() >= Self::reach(config, joint) - 0.002
    }

    /// Moves on at these rates.
    pub(crate) fn advance(&mut self, rates: &JointVector, dt_s: f64) {
        self.q_rad += rates * dt_s;
        self.qd_rad_s = *rates;
    }

    /// Leads each joint to its goal, which may be another at each step: as fast as its rate limit and its braking allow.
    pub(crate) fn approach(&mut self, config: &ArmConfig, goal_rad: &JointVector, dt_s: f64) {
        let (braking, step_s, mut rates) = (config.braking_rad_s2, dt_s.max(1e-6), JointVector::zeros());
        for i in 0..config.model.link_count() {
            let reach = Self::reach(config, i);
            let apart = goal_rad[i].clamp(-reach, reach) - self.q_rad[i];
            // The rate from which steps of `dt_s` bring the joint to rest at the goal; in the last one, onto it.
            let stopping = braking * ((0.25 * dt_s * dt_s + 2.0 * apart.abs() / braking).sqrt() - 0.5 * dt_s);
            let wanted = stopping.min(apart.abs() / step_s).copysign(apart);
            let change = braking * dt_s;
            let rate = wanted.clamp(self.qd_rad_s[i] - change, self.qd_rad_s[i] + change);
            let fastest = config.max_rate_rad_s[i];
            // No reference goes beyond the reach, whatever it came with.
            let low = ((-reach - self.q_rad[i]) / step_s).clamp(-fastest, 0.0);
            let high = ((reach - self.q_rad[i]) / step_s).clamp(0.0, fastest);
            rates[i] = rate.clamp(low, high);
        }
        self.advance(&rates, dt_s);
    }

    /// Slows all joints down evenly, so that they keep their ratios (a zero-reaction maneuver stays one), then stands.
    pub(crate) fn brake(&mut self, config: &ArmConfig, dt_s: f64) {
        let fastest = self.qd_rad_s.amax();
        let left = if fastest > 0.0 { (1.0 - config.braking_rad_s2 * dt_s / fastest).max(0.0) } else { 0.0 };
        let (low, high) = self.rate_bounds(config);
        let rates = (self.qd_rad_s * left).zip_zip_map(&low, &high, f64::clamp);
        self.advance(&rates, dt_s);
    }
}
