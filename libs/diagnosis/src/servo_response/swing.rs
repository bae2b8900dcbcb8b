//! What links do beside their motors on elastic drives.

use super::{ARRIVAL_SD_S, Nodes};
use fss_plant::{JointPhysics, Physics};

/// What lets a link move beside its motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Elasticity {
    stiffness_n_m_rad: Option<f64>,
    backlash_rad: f64,
}

impl Elasticity {
    pub(crate) fn is_elastic(&self) -> bool {
        self.stiffness_n_m_rad.is_some() || self.backlash_rad > 0.0
    }
}

/// Of each drive.
pub(crate) fn elasticity(physics: &Physics) -> Vec<Elasticity> {
    let of = |j: &JointPhysics| Elasticity { stiffness_n_m_rad: j.stiffness_n_m_rad, backlash_rad: j.backlash_rad };
    physics.joints.iter().map(of).collect()
}

/// What a link does on its elastic drive.
#[derive(Clone, Debug, Default)]
pub(crate) struct Swing {
    /// How far it is ahead of its motor, at the nodes.
    pub(crate) ahead: Nodes,
    /// How well that is known: standard deviations of angle, rad, and rate, rad/s.
    pub(crate) sd: Vec<[f64; 2]>,
}

/// In play a link strikes one flank, then the other. When it does cannot be foretold; its mean over this time can, s.
const STRIKES_S: f64 = 0.3;

impl Swing {
    /// Of a simulated motion on a drive.
    pub(super) fn new(simulated: Nodes, drive: &Elasticity, step_s: f64) -> Self {
        // A link swings as late as its datagram comes.
        let late = |[_, rate, acceleration]: [f64; 3]| [ARRIVAL_SD_S * rate.abs(), ARRIVAL_SD_S * acceleration.abs()];
        if drive.backlash_rad == 0.0 {
            return Self { sd: simulated.iter().copied().map(late).collect(), ahead: simulated };
        }
        let half = (0.5 * STRIKES_S / step_s).round().max(1.0) as usize;
        let ahead = means(&simulated, half);
        let square = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|i| (a[i] - b[i]).powi(2));
        let squares: Nodes = simulated.iter().zip(&ahead).map(square).collect();
        let sd = means(&squares, half).into_iter().map(|[angle, rate, _]| [angle.sqrt(), rate.sqrt()]).collect();
        Self { ahead, sd }
    }
}

/// Means over `half` nodes to either side.
fn means(nodes: &Nodes, half: usize) -> Nodes {
    let mut sums = vec![[0.0; 3]];
    for node in nodes {
        let last = sums[sums.len() - 1];
        sums.push(std::array::from_fn(|i| last[i] + node[i]));
    }
    let mean = |k: usize| {
        let (from, to) = (k.saturating_sub(half), (k + half + 1).min(nodes.len()));
        std::array::from_fn(|i| (sums[to][i] - sums[from][i]) / (to - from) as f64)
    };
    (0..nodes.len()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 0.005;
    const GAP_RAD: f64 = 4e-3;

    fn play() -> Elasticity {
        Elasticity { stiffness_n_m_rad: None, backlash_rad: GAP_RAD }
    }

    #[test]
    fn of_a_link_in_play_the_mean_is_predicted_and_its_strikes_are_noise() {
        // Three fifths of the time at one flank, two at the other, ten strikes a second.
        let strikes = |k: usize| [if k % 20 < 12 { 0.5 } else { -0.5 } * GAP_RAD, 0.0, 0.0];
        let swing = Swing::new((0..400).map(strikes).collect(), &play(), STEP_S);
        for (ahead, [sd, _]) in swing.ahead.iter().zip(&swing.sd).skip(60).take(280) {
            assert!((ahead[0] / GAP_RAD - 0.1).abs() < 0.05, "{ahead:?}");
            assert!((sd / GAP_RAD - 0.49).abs() < 0.05, "{sd}");
        }
    }

    #[test]
    fn a_link_on_a_spring_swings_as_late_as_its_datagram_comes() {
        let spring = Elasticity { stiffness_n_m_rad: Some(150.0), backlash_rad: 0.0 };
        let swing = Swing::new(vec![[1e-3, -0.2, 3.0]], &spring, STEP_S);
        assert_eq!(swing.ahead, [[1e-3, -0.2, 3.0]]);
        assert_eq!(swing.sd, [[ARRIVAL_SD_S * 0.2, ARRIVAL_SD_S * 3.0]]);
    }
}
