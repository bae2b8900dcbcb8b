//! Whether the records are sound: frames without a body, spikes, gaps, and noise that is not what the plant file says.
//!
//! Nothing here is a cause. What is not a measurement is left out, what is noisier than stated is believed less, and each
//! is told.

use crate::startup_transient::startup_transient_end_s;
use fss_estimation::statistics::median;
use fss_experiments::measured::{Poses, Run};
use fss_plant::Plant;
use std::f64::consts::TAU;

/// A sample is a spike if it is this many standard deviations off its neighbours, and they are not off each other.
const SPIKE_SIGMAS: f64 = 12.0;
/// A pause between two samples is a gap if it is this many times the usual one, and at least so long, s.
const GAP_PERIODS: f64 = 5.5;
const GAP_S: f64 = 0.2;
/// Noise is not what the plant file says if it is this many times as large.
const NOISIER: f64 = 1.25;
/// With fewer samples nothing is said of noise.
const FEWEST: usize = 50;
/// Median of the absolute value of a standard normal variable.
const NORMAL_MEDIAN: f64 = 0.6745;
/// Standard deviation of a third difference of white noise of standard deviation 1.
const THIRD_DIFFERENCE: f64 = 4.472_135_955;

/// Runs that can be used, and what there was to say of them.
pub struct Examined {
    /// The plant, its sensors as noisy as they are.
    pub plant: Plant,
    /// The runs without what is no measurement.
    pub runs: Vec<Run>,
    /// A sentence each.
    pub remarks: Vec<String>,
}

/// Looks at all runs.
pub fn examine(plant: &Plant, runs: &[Run]) -> Examined {
    let mut out = Examined { plant: plant.clone(), runs: runs.to_vec(), remarks: Vec::new() };
    for run in &mut out.runs {
        for (name, poses) in [("base_pose", &mut run.base_pose), ("ee_pose", &mut run.ee_pose)] {
            let Some(poses) = poses else { continue };
            let empty = keep(poses, |poses, k| !is_empty(&poses.values[k]));
            let spikes = drop_spikes(poses);
            let of = format!("{name} of {}", run.name);
            for (count, what) in [(empty, "frames without a body"), (spikes, "spikes")] {
                if count > 0 {
                    out.remarks.push(format!("{of}: {count} {what} left out"));
                }
            }
            if let Some((count, longest_s, at_s)) = gaps(&poses.t_s) {
                out.remarks.push(format!("{of}: {count} gaps, the longest of {longest_s:.2} s at {at_s:.2} s"));
            }
        }
    }
    if plant.link_count() > 0 && !plant.base.clamped {
        for run in &mut out.runs {
            let Some(from_s) = startup_transient_end_s(run) else { continue };
            *run = std::mem::take(run).measured_from(from_s);
            out.remarks.push(format!(
                "{}: until {from_s:.1} s something moves the arm, which its drives do not hold yet, faster than its telemetry \
                 tells; that time is left out",
                run.name
            ));
        }
    }
    if plant.link_count() > 0 {
        out.remarks.extend(joints_at_rest(&out.runs, plant.link_count()));
        out.remarks.extend([true, false].into_iter().filter_map(|commanded| without_telemetry(&out.runs, commanded)));
    }
    let sensors = &mut out.plant.sensors;
    let mut noise = |name: &str, stated: &mut f64, seen: Option<f64>| {
        if let Some(seen) = seen.filter(|seen| *seen > NOISIER * *stated) {
            out.remarks.push(format!("{name}: noise of {seen:.2e}, {:.1} times what is stated", seen / *stated));
            *stated = seen;
        }
    };
    let component = |i: usize| {
        let series = out.runs.iter().filter_map(|run| run.base_pose.as_ref());
        quietest(series.filter_map(|poses| noise_of(&poses.values.iter().map(|v| v[i]).collect::<Vec<_>>())))
    };
    let position = [component(0), component(1)].into_iter().flatten().reduce(f64::max);
    noise("motion capture, position (m)", &mut sensors.mocap_position_m, position);
    noise("motion capture, angle (rad)", &mut sensors.mocap_angle_rad, component(2));
    let gyro = out.runs.iter().filter_map(|run| run.gyro.as_ref());
    noise("gyro (rad/s)", &mut sensors.gyro_rad_s, quietest(gyro.filter_map(|gyro| noise_of(&gyro.values))));
    out
}

/// Joints of which these runs cannot tell what is wrong with their motors.
fn joints_at_rest(runs: &[Run], joints: usize) -> Option<String> {
    let is_driven = runs.iter().filter_map(|run| run.joints.as_ref()).any(|j| !j.current_a.is_empty());
    let at_rest = (1..=joints).filter(|joint| !runs.iter().any(|run| run.moves(*joint)));
    let names: Vec<String> = at_rest.map(|joint| joint.to_string()).collect();
    (is_driven && !names.is_empty()).then(|| {
        format!(
            "joints that hardly move in any run: {}. What is wrong with a motor, a spring, a torque sensor or the friction there \
             is not asked: friction holds what it is given. A run that moves them would tell",
            names.join(", ")
        )
    })
}

/// What runs without telemetry of the arm are taken for.
fn without_telemetry(runs: &[Run], commanded: bool) -> Option<String> {
    let which = runs.iter().filter(|run| run.joints.is_none() && run.joint_command.is_some() == commanded);
    let names: Vec<&str> = which.map(|run| run.name.as_str()).collect();
    let how = if commanded {
        "it is taken to stand where it was told to; times or runs in which it is told to move are left out"
    } else {
        "nor a command for it: it is taken to rest at zero"
    };
    (!names.is_empty()).then(|| format!("no telemetry of the arm in {}: {how}", names.join(", ")))
}

/// Where a body was not seen some systems say that it is at the origin.
fn is_empty(pose: &[f64; 3]) -> bool {
    pose[0] == 0.0 && pose[1] == 0.0 && (pose[2] / TAU - (pose[2] / TAU).round()).abs() < 1e-12
}

/// Keeps the samples that pass; gives how many did not.
fn keep(poses: &mut Poses, passes: impl Fn(&Poses, usize) -> bool) -> usize {
    let good: Vec<usize> = (0..poses.t_s.len()).filter(|k| passes(poses, *k)).collect();
    let lost = poses.t_s.len() - good.len();
    if lost > 0 {
        *poses = Poses {
            t_s: good.iter().map(|k| poses.t_s[*k]).collect(),
            values: good.iter().map(|k| poses.values[*k]).collect(),
        };
    }
    lost
}

fn drop_spikes(poses: &mut Poses) -> usize {
    let sd: Vec<f64> = (0..3)
        .map(|i| noise_of(&poses.values.iter().map(|v| v[i]).collect::<Vec<_>>()).unwrap_or(f64::INFINITY))
        .collect();
    keep(poses, |poses, k| {
        if k == 0 || k + 1 == poses.t_s.len() {
            return true;
        }
        let (before, now, after) = (&poses.values[k - 1], &poses.values[k], &poses.values[k + 1]);
        let share = (poses.t_s[k] - poses.t_s[k - 1]) / (poses.t_s[k + 1] - poses.t_s[k - 1]);
        (0..3).all(|i| {
            let off = (now[i] - before[i] - share * (after[i] - before[i])).abs();
            off < SPIKE_SIGMAS * sd[i] || off < 2.0 * (after[i] - before[i]).abs()
        })
    })
}

/// Number of gaps, length and beginning of the longest.
fn gaps(t_s: &[f64]) -> Option<(usize, f64, f64)> {
    let mut steps: Vec<f64> = t_s.windows(2).map(|w| w[1] - w[0]).collect();
    let all: Vec<(f64, f64)> = steps.iter().copied().zip(t_s.iter().copied()).collect();
    let usual = median(&mut steps)?;
    let gaps = || all.iter().filter(|(step, _)| *step > GAP_S.max(GAP_PERIODS * usual));
    let longest = gaps().max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((gaps().count(), longest.0, longest.1))
}

/// Standard deviation of a series' white noise: of its third differences, which smooth motion leaves at zero, by their
/// median, which the few at an opening valve do not move.
fn noise_of(values: &[f64]) -> Option<f64> {
    if values.len() < FEWEST {
        return None;
    }
    let mut third: Vec<f64> = values.windows(4).map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs()).collect();
    Some(median(&mut third)? / (NORMAL_MEDIAN * THIRD_DIFFERENCE))
}

/// The run in which the vehicle was calmest says what the sensor does.
fn quietest(noise: impl Iterator<Item = f64>) -> Option<f64> {
    noise.reduce(f64::min)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A base that drifts, seen 50 times a second with noise of the plant file's size times `noisier`.
    fn drifting(plant: &Plant, noisier: f64) -> Run {
        // Numbers of a linear congruence, summed to something near enough to normal.
        let mut state = 7_u64;
        let mut random = || {
            let mut sum = -6.0;
            for _ in 0..12 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 33) as f64 / (1_u64 << 31) as f64;
            }
            noisier * sum
        };
        let (p, a) = (plant.sensors.mocap_position_m, plant.sensors.mocap_angle_rad);
        let t_s: Vec<f64> = (0..2000).map(|k| 0.02 * f64::from(k)).collect();
        let values =
            t_s.iter().map(|t| [0.1 + 0.02 * t + p * random(), -0.3 + p * random(), 0.05 * t + a * random()]).collect();
        Run { name: "drift".into(), base_pose: Some(Poses { t_s, values }), ..Run::default() }
    }

    fn plant() -> Plant {
        Plant::parse("[base]\nmass_kg = 10.0\ninertia_kg_m2 = 0.25\n").unwrap()
    }

    #[test]
    fn a_sound_record_is_left_as_it_is() {
        let plant = plant();
        let examined = examine(&plant, &[drifting(&plant, 1.0)]);
        assert!(examined.remarks.is_empty(), "{:?}", examined.remarks);
        assert_eq!(examined.plant, plant);
        assert_eq!(examined.runs[0].base_pose.as_ref().unwrap().t_s.len(), 2000);
    }

    #[test]
    fn empty_frames_spikes_and_gaps_are_told_and_left_out() {
        let plant = plant();
        let mut run = drifting(&plant, 1.0);
        let poses = run.base_pose.as_mut().unwrap();
        for k in 300..310 {
            poses.values[k] = [0.0; 3];
        }
        poses.values[700][1] += 0.05;
        poses.t_s.drain(1000..1050);
        poses.values.drain(1000..1050);
        let examined = examine(&plant, &[run]);
        assert_eq!(examined.runs[0].base_pose.as_ref().unwrap().t_s.len(), 2000 - 10 - 1 - 50);
        let told = examined.remarks.join("\n");
        assert!(told.contains("10 frames without a body") && told.contains("1 spikes"), "{told}");
        assert!(told.contains("the longest of 1.02 s at 19.98 s"), "{told}");
    }

    #[test]
    fn a_sensor_noisier_than_stated_is_believed_less() {
        let plant = plant();
        let examined = examine(&plant, &[drifting(&plant, 3.0)]);
        let ratio = examined.plant.sensors.mocap_position_m / plant.sensors.mocap_position_m;
        assert!((ratio - 3.0).abs() < 0.2, "{ratio}");
        assert_eq!(examined.remarks.len(), 2, "{:?}", examined.remarks);
    }
}
