//! What no known effect explains: where it acts and what it depends on.

use crate::contest::{Contest, GYRO, Refined, Shaken};
use crate::empirical::{Dependence, Term, UNMODELLED, columns, velocity};
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::Effect;
use std::f64::consts::FRAC_PI_2;

/// A dependence that explains less than this share of the forces is none.
const WORTH_SAYING: f64 = 0.5;
/// One that explains more than this share says all that there is to say.
const ALL_BUT_NOTHING: f64 = 0.95;

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
    /// Terms that would take some of it off the fitted runs.
    pub(crate) terms: Vec<Term>,
}

/// Looks at what is left of a fit.
pub(crate) fn describe(contest: &mut Contest, fit: &Refined, runs: &[Run]) -> Result<Unexplained, ModelError> {
    // The contest may have fitted the windows to other causes since.
    contest.centre(&fit.effects, &fit.hypotheses)?;
    let refined = &contest.only(fit, |_| true)?;
    let contest = &*contest;
    let left = contest.unexplained(&refined.residuals, &refined.nuisance);
    let (closing, closing_share) = closing(contest, refined, &left)?;
    let mut depends_on = Vec::new();
    if closing_share > 0.0 {
        depends_on.push(("a force on the base that is steady within each window".to_owned(), closing_share));
    }
    depends_on.extend(place_and_speed(&closing, runs));
    let excess = refined.chi2 - refined.freedom;
    let share = |gain: f64| if excess > 0.0 { (gain / excess).min(1.0) } else { 0.0 };
    let axis_rad = principal_axis_rad(&closing);
    let mut terms = Vec::new();
    for dependence in Dependence::ALL {
        if let Some((frequency, term)) = dependence.term(contest, refined, axis_rad, runs)? {
            let words = in_words(dependence, frequency, &term);
            depends_on.extend(words.map(|words| (words, share(term.gain))));
            terms.push(term);
        }
    }
    depends_on.retain(|(_, share)| *share > WORTH_SAYING);
    let air = contest.air(refined);
    if air.is_too_strong() && depends_on.iter().all(|(_, share)| *share < ALL_BUT_NOTHING) {
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
    Ok(Unexplained { mean_square: refined.mean_square(), worst, closing, depends_on, terms })
}

/// Forces along both axes and a torque that do not change.
fn steady() -> Vec<Effect> {
    let laws = [("base_force", 0.0), ("base_force", FRAC_PI_2), ("base_torque", 0.0)];
    let law = |(channel, direction_rad)| {
        let effect = Effect::new(UNMODELLED).ok()?.on(channel);
        Some(effect.with(&[1e-3, 0.0, direction_rad, FRAC_PI_2]))
    };
    laws.into_iter().filter_map(law).collect()
}

/// The steady force that closes each window, and the share of the excess that such forces take off.
fn closing(
    contest: &Contest,
    refined: &Refined,
    left: &[nalgebra::DVector<f64>],
) -> Result<(Vec<Closing>, f64), ModelError> {
    let all = columns(contest, &refined.effects, &refined.residuals, &steady())?;
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

/// What a periodic term would do, in words.
fn in_words(dependence: Dependence, frequency: f64, term: &Term) -> Option<String> {
    let what = match dependence {
        Dependence::Time => format!("time, with a period of {:.2} s ({frequency:.3} Hz)", 1.0 / frequency),
        Dependence::Place => format!("the place on the table, with a wave of {:.3} m", 1.0 / frequency),
        Dependence::Heading => format!("the heading of the base, {frequency:.2} times a turn"),
        Dependence::Velocity => return None,
    };
    let does = |law: &Effect| {
        let (size, direction_rad) = (law.values()[0], law.get("direction_rad").unwrap_or(0.0));
        match (law.channel().is_some_and(|c| c.starts_with("base_torque")), direction_rad) {
            (true, _) => format!("torque {size:.5} N m"),
            (false, 0.0) => format!("force {size:.4} N along x"),
            (false, FRAC_PI_2) => format!("force {size:.4} N along y"),
            (false, other) => format!("force {size:.4} N along {:.0} deg", other.to_degrees()),
        }
    };
    let does: Vec<String> = term.effects.iter().map(does).collect();
    Some(format!("{what}: {}", does.join(", "))).filter(|_| !does.is_empty())
}

/// Along which axis forces push most, rad: the principal axis of their second moments.
fn principal_axis_rad(closing: &[Closing]) -> f64 {
    let moment = |i: usize, j: usize| closing.iter().map(|(_, _, force)| force[i] * force[j]).sum::<f64>();
    0.5 * f64::atan2(2.0 * moment(0, 1), moment(0, 0) - moment(1, 1))
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
        rows.push(Window { pose: poses.values[k], velocity: velocity(poses, k), force: *force });
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
