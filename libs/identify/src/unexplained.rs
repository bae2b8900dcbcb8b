//! What no known effect explains: where it acts and what it depends on.

use crate::contest::{Contest, GYRO, Refined, Shaken};
use crate::hypothesis::OUTSIDE;
use crate::measured::Run;
use crate::sensitivity::Column;
use crate::verdict::Cause;
use fss_multibody::ModelError;
use fss_plant::Effect;
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// Periods that are looked for lie between these frequencies, Hz.
const FREQUENCIES_HZ: [f64; 2] = [0.05, 2.0];
const FREQUENCIES: usize = 24;
/// A dependence that explains less than this share of the forces is none.
const WORTH_SAYING: f64 = 0.5;

/// The generalized force that would close a window: run, middle of the window (s), N, N, N m in table axes.
pub type Closing = (String, f64, [f64; 3]);

/// What is left unexplained.
#[derive(Clone, Debug)]
pub struct Unexplained {
    /// Mean square of the whitened residuals, 1 where only noise is left.
    pub mean_square: f64,
    /// The channel and run where it stands out most, RMS over noise.
    pub worst: Option<(String, String, f64)>,
    /// Generalized force that would close each window: run, middle of the window (s), N, N, N m in table axes.
    pub closing: Vec<Closing>,
    /// What it depends on, in words, and the share of the misfit that such a term would explain.
    pub depends_on: Vec<(String, f64)>,
}

/// Looks at what is left of a fit; these fitted it better than any known effect.
pub(crate) fn describe(
    contest: &Contest,
    refined: &Refined,
    outside: &[Cause],
    runs: &[Run],
) -> Result<Unexplained, ModelError> {
    let left = contest.unexplained(&refined.residuals, &refined.nuisance);
    let floats = !contest.trial.plant.base.clamped;
    let (closing, closing_share) = if floats { closing(contest, refined, &left)? } else { (Vec::new(), 0.0) };
    let mut depends_on = Vec::new();
    if closing_share > 0.0 {
        depends_on.push(("a force on the base that is steady within each window".to_owned(), closing_share));
    }
    if floats {
        depends_on.extend(period(contest, refined)?);
        depends_on.extend(place_and_speed(&closing, runs));
    }
    depends_on.retain(|(_, share)| *share > WORTH_SAYING);
    let excess = (refined.chi2 - refined.freedom).max(1.0);
    depends_on.extend(outside.iter().map(|law| (words(&law.effect), (law.gain / excess).min(1.0))));
    let air = contest.air(refined);
    if air.is_too_strong() {
        let (axis, times) = air.strongest();
        // The share is of what stands above the air that the plant file tells of.
        let share = 1.0 - 1.0 / (times * times);
        depends_on.push((
            format!("a force on the base, strongest {axis}: {times:.1} times what the room's air makes"),
            share,
        ));
    }
    depends_on.sort_by(|a, b| b.1.total_cmp(&a.1));
    let worst = contest.worst(refined);
    let worst = match contest.shaken {
        Some(Shaken { record, rms })
            if refined.effects.is_empty() && worst.as_ref().is_none_or(|(_, _, other)| *other < rms) =>
        {
            Some((GYRO.to_owned(), contest.evidence.records[record].name().to_owned(), rms))
        }
        _ => worst,
    };
    Ok(Unexplained { mean_square: refined.mean_square(), worst, closing, depends_on })
}

/// A law that no effect of the catalogue has.
fn words(law: &Effect) -> String {
    let joint = law.channel().and_then(|c| c.strip_prefix("joint_torque_")?.strip_suffix("_by_rate"));
    match joint {
        Some(joint) => {
            format!(
                "the square of the rate of joint {joint}: a torque against it of {:.4} N m s2/rad2",
                law.values()[0]
            )
        }
        None => law.to_string(),
    }
}

/// Columns of a force or torque that the catalogue has no cause for.
fn columns(
    contest: &Contest,
    refined: &Refined,
    channel: &str,
    values: [f64; 4],
) -> Result<Option<Column>, ModelError> {
    let Ok(effect) = Effect::new(OUTSIDE) else { return Ok(None) };
    let mut effects = refined.effects.clone();
    effects.push(effect.on(channel).with(&values));
    let after = contest.evidence.residuals(&contest.trial_with(&effects), &contest.evidence.cells)?;
    Ok(Some(refined.residuals.iter().zip(after).map(|(before, after)| (before - after) / values[0]).collect()))
}

/// The steady force that closes each window, and the share of the excess that such forces take off.
fn closing(
    contest: &Contest,
    refined: &Refined,
    left: &[nalgebra::DVector<f64>],
) -> Result<(Vec<Closing>, f64), ModelError> {
    let probes = [("base_force", 0.0), ("base_force", FRAC_PI_2), ("base_torque", 0.0)];
    let strength = 1e-3;
    let all: Vec<Column> = probes
        .iter()
        .map(|(channel, direction)| columns(contest, refined, channel, [strength, 0.0, *direction, FRAC_PI_2]))
        .collect::<Result<Vec<_>, _>>()?
        .into_iter()
        .flatten()
        .collect();
    let mut out = Vec::new();
    let (mut gain, mut excess) = (0.0, 0.0);
    for (i, cell) in contest.evidence.cells.iter().enumerate() {
        let j = nalgebra::DMatrix::from_columns(&all.iter().map(|c| c[i].clone()).collect::<Vec<_>>());
        let normal = crate::normal::Normal { g: j.tr_mul(&j), b: j.tr_mul(&left[i]), c: 0.0, freedom: 0.0 };
        let fit = normal.fit(&[0, 1, 2]);
        gain += fit.gain;
        excess += left[i].norm_squared() - cell.freedom;
        let name = contest.evidence.records[cell.record].name().to_owned();
        out.push((name, 0.5 * (cell.from_s + cell.to_s), [fit.value[0], fit.value[1], fit.value[2]]));
    }
    Ok((out, if excess > 0.0 { (gain / excess).min(1.0) } else { 0.0 }))
}

/// A periodic force or torque, if that explains much.
fn period(contest: &Contest, refined: &Refined) -> Result<Option<(String, f64)>, ModelError> {
    let excess = refined.chi2 - refined.freedom;
    let gain_at = |frequency_hz: f64| -> Result<(f64, Vec<f64>), ModelError> {
        let mut all = Vec::new();
        for (channel, direction) in [("base_force", 0.0), ("base_force", FRAC_PI_2), ("base_torque", 0.0)] {
            for phase in [0.0, FRAC_PI_2] {
                all.extend(columns(contest, refined, channel, [1e-3, frequency_hz, direction, phase])?);
            }
        }
        let count: Vec<usize> = (0..all.len()).collect();
        let fit = contest.reduce(&refined.residuals, &all).normal.fit(&count);
        Ok((fit.gain, fit.value.as_slice().to_vec()))
    };
    let [low, high] = FREQUENCIES_HZ;
    let grid: Vec<f64> =
        (0..FREQUENCIES).map(|k| low * (high / low).powf(k as f64 / (FREQUENCIES - 1) as f64)).collect();
    let tried: Result<Vec<_>, ModelError> = grid.par_iter().map(|f| gain_at(*f).map(|(g, v)| (*f, g, v))).collect();
    let Some(mut best) = tried?.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)) else { return Ok(None) };
    // The record is long: the period is sharper than the grid.
    let mut reach = (high / low).powf(1.0 / (FREQUENCIES - 1) as f64);
    for _ in 0..5 {
        let near = [1.0 / reach, 1.0 / reach.sqrt(), reach.sqrt(), reach].map(|r| best.0 * r);
        let finer: Result<Vec<_>, ModelError> = near.par_iter().map(|f| gain_at(*f).map(|(g, v)| (*f, g, v))).collect();
        best = finer?.into_iter().chain(std::iter::once(best)).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
        reach = reach.sqrt();
    }
    let (frequency_hz, gain, v) = best;
    if v.len() < 6 || excess <= 0.0 {
        return Ok(None);
    }
    let (fx, fy, torque) = (v[0].hypot(v[1]), v[2].hypot(v[3]), v[4].hypot(v[5]));
    let text = format!(
        "time, with a period of {:.2} s ({frequency_hz:.3} Hz): force {fx:.4} N along x, {fy:.4} N along y, torque {torque:.5} N m",
        1.0 / frequency_hz
    );
    Ok(Some((text, (gain / excess).min(1.0))))
}

/// The base in the middle of a window, and the force that would close it.
struct Window {
    pose: [f64; 3],
    velocity: [f64; 3],
    force: [f64; 3],
}

/// How well place, heading and speed at a window's middle say its closing force (coefficient of determination).
fn place_and_speed(closing: &[Closing], runs: &[Run]) -> Vec<(String, f64)> {
    let mut rows: Vec<Window> = Vec::new();
    for (name, t_s, force) in closing {
        let Some(poses) = runs.iter().find(|r| r.name == *name).and_then(|r| r.base_pose.as_ref()) else { continue };
        let k = poses.t_s.partition_point(|t| t < t_s).min(poses.t_s.len() - 1);
        let (a, b) = (k.saturating_sub(25), (k + 25).min(poses.t_s.len() - 1));
        let dt = (poses.t_s[b] - poses.t_s[a]).max(1e-6);
        let rate = |i: usize| (poses.values[b][i] - poses.values[a][i]) / dt;
        rows.push(Window { pose: poses.values[k], velocity: [rate(0), rate(1), rate(2)], force: *force });
    }
    let share = |features: fn(&Window) -> Vec<f64>| determination(&rows, features);
    vec![
        ("the place on the table".to_owned(), share(|w| vec![1.0, w.pose[0], w.pose[1]])),
        ("the heading of the base".to_owned(), share(|w| vec![1.0, w.pose[2].cos(), w.pose[2].sin()])),
        ("the velocity of the base".to_owned(), share(|w| vec![1.0, w.velocity[0], w.velocity[1], w.velocity[2]])),
    ]
}

/// Share of the variance of the forces that a linear function of the features explains, for the degrees of freedom it uses.
fn determination(rows: &[Window], features: fn(&Window) -> Vec<f64>) -> f64 {
    let Some(width) = rows.first().map(|r| features(r).len()) else { return 0.0 };
    if rows.len() < 3 * width {
        return 0.0;
    }
    let x = nalgebra::DMatrix::from_fn(rows.len(), width, |i, j| features(&rows[i])[j]);
    let (mut left, mut all) = (0.0, 0.0);
    for component in 0..3 {
        let y = nalgebra::DVector::from_fn(rows.len(), |i, _| rows[i].force[component]);
        let scale = y.norm().max(1e-30);
        let y = y / scale;
        let mean = y.mean();
        all += y.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        if let Ok(fit) = x.clone().svd(true, true).solve(&y, 1e-12) {
            left += (&y - &x * fit).norm_squared();
        }
    }
    let n = rows.len() as f64;
    1.0 - (left / (n - width as f64)) / (all / (n - 1.0)).max(1e-30)
}
