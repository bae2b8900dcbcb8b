//! A clamped arm: the joints are simulated from their measured state.

use super::{ChannelMisfit, Gathered};
use crate::clamped::drive;
use crate::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Plant, Simulation};

/// The misfit of joint angles and rates.
pub(super) fn misfit(plant: &Plant, run: &Run, window_s: f64) -> Result<Vec<ChannelMisfit>, ModelError> {
    let Some(joints) = &run.joints else { return Ok(Vec::new()) };
    let n = plant.link_count();
    if joints.q_rad.len() < n || joints.qd_rad_s.len() < n {
        return Ok(Vec::new()); // without angles and rates there is no state to begin from
    }
    let mut simulation = Simulation::new(plant, 0)?;
    let mut angles: Vec<Gathered> = (0..n).map(|_| Gathered::default()).collect();
    let mut rates: Vec<Gathered> = (0..n).map(|_| Gathered::default()).collect();
    let row = |values: &[Vec<f64>], k: usize| values.iter().take(n).map(|v| v[k]).collect::<Vec<_>>();
    let variances = [plant.sensors.encoder_rad, plant.sensors.encoder_rate_rad_s].map(|sd| sd * sd);
    let mut start = 0;
    for k in 0..joints.t_s.len().saturating_sub(1) {
        if joints.t_s[k] - joints.t_s[start] >= window_s || k == 0 {
            start = k;
            simulation.set_state([0.0; 3], [0.0; 3], &row(&joints.q_rad, k), &row(&joints.qd_rad_s, k));
        }
        drive(&mut simulation, run.drive, joints, k);
        simulation.step(joints.t_s[k + 1] - joints.t_s[k]);
        for i in 0..n {
            let (q_rad, qd_rad_s) = simulation.joint(i);
            angles[i].add(joints.t_s[k + 1], joints.q_rad[i][k + 1] - q_rad, variances[0]);
            rates[i].add(joints.t_s[k + 1], joints.qd_rad_s[i][k + 1] - qd_rad_s, variances[1]);
        }
    }
    let named = |all: Vec<Gathered>, prefix: &str| {
        let numbered = all.into_iter().zip(1..);
        numbered.filter_map(|(g, i)| g.finish(&run.name, &format!("{prefix}{i}"))).collect::<Vec<_>>()
    };
    let mut channels = named(angles, "q");
    channels.extend(named(rates, "qd"));
    Ok(channels)
}
