//! What the rows would have read along the measured path, and how they depend on the motion beside it.

use super::mechanics::{ArmState, Mechanics};
use super::path::MeasuredPath;
use super::rows::{Kind, Row, Slopes, moments};
use crate::friction::direction;
use fss_multibody::{Coordinates, JointVector, MAX_LINKS};
use fss_plant::{Plant, Stream};
use nalgebra::Matrix3;

/// Step of central differences of torques by angles and rates, rad and rad/s: torques are polynomials of rates and
/// sines of angles.
const DIFFERENCE: f64 = 1e-4;

/// Readings of all joints at one time: currents where there is one, and torques.
struct Drives {
    current_a: JointVector,
    torque_n_m: JointVector,
    motor_n_m: JointVector,
}

/// What drives carry when the readings of one stamp were taken.
pub(super) struct Loaded {
    /// Standard deviation of each joint's rate, rad/s.
    rate_sd: JointVector,
    /// Arm and torques on its links, N m, at each time at which joints were read, s.
    at: Vec<(f64, ArmState, JointVector)>,
}

/// When a joint was read whose reading has this stamp.
fn read_at(mechanics: &Mechanics, stamp_s: f64, joint: usize) -> f64 {
    stamp_s - mechanics.physics(stamp_s).sensors.link_age_s(joint)
}

impl Loaded {
    fn new(mechanics: &Mechanics, links: usize, stamp_s: f64, rate_sd: JointVector) -> Self {
        let mut at = Vec::<(f64, ArmState, JointVector)>::with_capacity(1);
        for t_s in (0..links).map(|i| read_at(mechanics, stamp_s, i)) {
            if at.iter().all(|(known_s, ..)| *known_s != t_s) {
                let (arm, base) = (mechanics.arm(t_s), mechanics.base(t_s));
                at.push((t_s, arm, mechanics.torques(t_s, &base, &arm, mechanics.thrust(t_s))));
            }
        }
        Self { rate_sd, at }
    }

    /// Readings at the stamp `stamp_s`.
    fn drives(&self, mechanics: &Mechanics, stamp_s: f64, links: usize) -> Drives {
        let zero = JointVector::zeros();
        let mut out = Drives { current_a: zero, torque_n_m: zero, motor_n_m: zero };
        for i in 0..links {
            let read_s = read_at(mechanics, stamp_s, i);
            let Some((t_s, arm, torques)) = self.at.iter().find(|(t_s, ..)| *t_s == read_s) else { continue };
            let motor = mechanics.motor_torque(*t_s, i, torques[i], arm, self.rate_sd[i]);
            out.motor_n_m[i] = motor;
            out.current_a[i] = mechanics.current(*t_s, i, motor);
            out.torque_n_m[i] = mechanics.physics(*t_s).joints[i].torque_reading(torques[i]);
        }
        out
    }
}

/// What drives carry at each moment.
pub(super) fn loaded(mechanics: &Mechanics, path: &MeasuredPath, rows: &[Row]) -> Vec<Loaded> {
    let times_s: Vec<f64> = moments(rows).iter().map(|moment| rows[moment.start].t_s).collect();
    let of = |(t_s, sd): (&f64, &JointVector)| Loaded::new(mechanics, path.joints.len(), *t_s, *sd);
    times_s.iter().zip(path.rates_sd_at(&times_s)).map(of).collect()
}

/// What rows of these kinds read at one time.
pub(super) fn readings(mechanics: &Mechanics, path: &MeasuredPath, stamp_s: f64, kinds: &[Kind]) -> Vec<f64> {
    readings_of(mechanics, path, stamp_s, kinds.iter().copied(), None).collect()
}

/// The same, where it is known what drives carry or not.
fn readings_of<'a>(
    mechanics: &'a Mechanics,
    path: &'a MeasuredPath,
    stamp_s: f64,
    kinds: impl Iterator<Item = Kind> + 'a,
    loaded: Option<&'a Loaded>,
) -> impl Iterator<Item = f64> + 'a {
    let links = path.joints.len();
    let mut known: Option<Drives> = None;
    let mut tip = None;
    kinds.map(move |kind| match kind {
        Kind::Angle(i) => path.joints[i].at(stamp_s)[0],
        Kind::Rate(i) => path.joints[i].at(stamp_s)[1],
        Kind::Tip(axis) => tip.get_or_insert_with(|| mechanics.end_effector(stamp_s))[axis],
        Kind::Current(i) | Kind::Torque(i) | Kind::Undriven(i) => {
            let drives = known.get_or_insert_with(|| {
                let new = || Loaded::new(mechanics, links, stamp_s, path.rates_sd(stamp_s));
                loaded.map_or_else(|| new().drives(mechanics, stamp_s, links), |l| l.drives(mechanics, stamp_s, links))
            });
            match kind {
                Kind::Current(_) => drives.current_a[i],
                Kind::Torque(_) => drives.torque_n_m[i],
                _ => drives.motor_n_m[i],
            }
        }
    })
}

/// Standard deviation of the time by which rates lag, the same for all joints of a run, s: they are derivatives after a filter
/// that nobody states.
const RATE_LAG_SD_S: f64 = 1e-3;
/// Standard deviation of each component of an encoder's error once a turn, rad: of a disc of 20 mm that sits 0.1 mm off its axis.
const ECCENTRICITY_SD_RAD: f64 = 5e-3;
/// A row's time is known to half of a valve's tick, s.
const TIMING_S: f64 = 0.0025;

/// Variance that uncertain times give a row: of a drive's where thrust begins or ends, the square of half of what the row changes
/// over the span of its samples and their timing, had the arm moved on evenly; of a rate's, and of the current that accelerates an elastic
/// drive's rotor, where a datagram arrives.
pub(super) fn timing(mechanics: &Mechanics, path: &MeasuredPath, rows: &[Row], slopes: &mut [Slopes]) {
    for moment in moments(rows) {
        let t_s = rows[moment.start].t_s;
        let stamps = &rows[moment.start].stamps_s;
        let half_s = TIMING_S + stamps.iter().map(|s| (s - t_s).abs()).fold(0.0, f64::max);
        let change = mechanics.thrust_change(t_s, half_s, path.joints.len());
        for k in moment {
            if let Kind::Torque(i) | Kind::Current(i) | Kind::Undriven(i) = rows[k].kind {
                let unit = reading_of_one(mechanics, t_s, rows[k].kind);
                slopes[k].timing_variance = (0.5 * unit * change[i]).powi(2);
                if let (Kind::Current(_), Some(inertia)) = (rows[k].kind, mechanics.own_rotor_kg_m2(t_s, i)) {
                    slopes[k].timing_variance += (unit * inertia * path.arrivals_sd(i, t_s)[1]).powi(2);
                }
            }
            if let Kind::Rate(i) = rows[k].kind {
                slopes[k].timing_variance = path.arrivals_sd(i, t_s)[0].powi(2);
            }
            if let Kind::Tip(_) = rows[k].kind {
                let by_angle = slopes[k].motion.iter().filter(|(state, _)| state % 3 == 0);
                slopes[k].timing_variance = by_angle.map(|(s, c)| (c * mechanics.swing_sd(s / 3, t_s)).powi(2)).sum();
            }
        }
    }
}

/// What all rows read at their times, where drives carry this.
pub(super) fn predict(mechanics: &Mechanics, path: &MeasuredPath, rows: &[Row], loaded: &[Loaded]) -> Vec<f64> {
    let mut out = Vec::with_capacity(rows.len());
    for (moment, loaded) in moments(rows).into_iter().zip(loaded) {
        let own = &rows[moment];
        let kinds = own.iter().map(|r| r.kind);
        out.extend(readings_of(mechanics, path, own[0].t_s, kinds, Some(loaded)));
    }
    out
}

/// How much the mean over each row's samples differs from the reading at the row's time, along the path.
pub(super) fn averaging(mechanics: &Mechanics, path: &MeasuredPath, rows: &[Row], at_middle: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; rows.len()];
    for moment in moments(rows) {
        let mut from = moment.start;
        while from < moment.end {
            // Rows of the same samples are read together.
            let stamps = &rows[from].stamps_s;
            let to = (from..moment.end).find(|k| rows[*k].stamps_s != *stamps).unwrap_or(moment.end);
            let kinds: Vec<Kind> = rows[from..to].iter().map(|r| r.kind).collect();
            if stamps.len() > 1 || stamps.first() != Some(&rows[from].t_s) {
                for stamp_s in stamps {
                    let now = readings(mechanics, path, *stamp_s, &kinds);
                    (from..to).for_each(|k| out[k] += (now[k - from] - at_middle[k]) / stamps.len() as f64);
                }
            }
            from = to;
        }
    }
    out
}

/// How each row depends on the motion beside the path, under the plant of `mechanics`.
pub(super) fn slopes(
    plant: &Plant,
    mechanics: &Mechanics,
    path: &MeasuredPath,
    rows: &[Row],
    scale: &[f64],
) -> Vec<Slopes> {
    let links = path.joints.len();
    let mut out = Vec::with_capacity(rows.len());
    for moment in moments(rows) {
        let t_s = rows[moment.start].t_s;
        let mut by_motion: Option<Vec<JointVector>> = None;
        for k in moment.clone() {
            let row = &rows[k];
            let mut own = Slopes::default();
            match row.kind {
                Kind::Angle(i) => {
                    own.motion.push((3 * i, 1.0));
                    let (sin, cos) = path.joints[i].at(t_s)[0].sin_cos();
                    own.eccentricity = eccentric(i, [sin, cos]);
                }
                Kind::Rate(i) => {
                    own.motion.push((3 * i + 1, 1.0));
                    let [angle, rate, acceleration] = path.joints[i].at(t_s);
                    let (sin, cos) = angle.sin_cos();
                    own.rate_lag = -RATE_LAG_SD_S * acceleration;
                    own.eccentricity = eccentric(i, [cos * rate, -sin * rate]);
                }
                Kind::Torque(i) | Kind::Current(i) | Kind::Undriven(i) => {
                    let columns = by_motion.get_or_insert_with(|| torque_slopes(mechanics, t_s, links));
                    let unit = reading_of_one(mechanics, t_s, row.kind);
                    own.torque = unit * scale[i];
                    own.motion = columns.iter().enumerate().map(|(state, c)| (state, unit * c[i])).collect();
                    if !matches!(row.kind, Kind::Torque(_)) {
                        let friction = mechanics.physics(t_s).joints[i].friction;
                        own.motion[3 * i + 1].1 += unit * friction.viscous_n_m_s_rad;
                        let sense = direction(path.joints[i].at(t_s)[1], path.rate_sd(i, t_s));
                        own.unit_friction_variance = unit * unit * (1.0 - sense * sense);
                    }
                }
                Kind::Tip(axis) => own.motion = tip_slopes(mechanics, t_s, links, axis),
            }
            out.push(own);
        }
    }
    one_stiction_a_rest(rows, &mut out, plant, path);
    mix_tips(plant, rows, &mut out);
    out
}

/// What a drive's row reads more of a torque by 1 N m in its joint.
pub(super) fn reading_of_one(mechanics: &Mechanics, t_s: f64, kind: Kind) -> f64 {
    match kind {
        Kind::Current(i) => mechanics.current(t_s, i, 1.0),
        Kind::Torque(i) => mechanics.physics(t_s).joints[i].torque_sensor_scale,
        _ => 1.0,
    }
}

/// Slopes by the sine and the cosine of joint `i`'s encoder error once a turn, in standard deviations.
pub(super) fn eccentric(i: usize, [sin, cos]: [f64; 2]) -> Vec<(usize, f64)> {
    vec![(2 * i, ECCENTRICITY_SD_RAD * sin), (2 * i + 1, ECCENTRICITY_SD_RAD * cos)]
}

/// Torques by angle, rate and acceleration of each joint.
pub(super) fn torque_slopes(mechanics: &Mechanics, t_s: f64, links: usize) -> Vec<JointVector> {
    let (arm, base) = (mechanics.arm(t_s), mechanics.base(t_s));
    let moved = |joint: usize, derivative: usize, by: f64| {
        let mut arm = arm;
        match derivative {
            0 => arm.q_rad[joint] += by,
            1 => arm.qd_rad_s[joint] += by,
            _ => arm.qdd_rad_s2[joint] += by,
        }
        mechanics.torques(t_s, &base, &arm, mechanics.thrust(t_s))
    };
    let slope = |state: usize| {
        let (joint, derivative) = (state / 3, state % 3);
        // Accelerations act linearly.
        let by = if derivative == 2 { 1.0 } else { DIFFERENCE };
        (moved(joint, derivative, by) - moved(joint, derivative, -by)) / (2.0 * by)
    };
    (0..3 * links).map(slope).collect()
}

/// The end-effector's place in the base's frame by the joints' angles, and where it is shown later than telemetry is, by their rates: it
/// shows them as they were.
fn tip_slopes(mechanics: &Mechanics, t_s: f64, links: usize, axis: usize) -> Vec<(usize, f64)> {
    let sensors = &mechanics.physics(t_s).sensors;
    let age_s = sensors.age_s(Stream::EePose);
    let mut q = Coordinates::zeros();
    q.fixed_rows_mut::<MAX_LINKS>(3).copy_from(&mechanics.arm(t_s - age_s).q_rad);
    let jacobian = mechanics.model(t_s).jacobian(&q);
    let by = |j: usize| {
        let (slope, later_s) = (jacobian[(axis, 3 + j)], age_s - sensors.link_age_s(j));
        std::iter::once((3 * j, slope)).chain((later_s != 0.0).then_some((3 * j + 1, -later_s * slope)))
    };
    (0..links).flat_map(by).collect()
}

/// A joint at rest has one static friction, however often it is looked at: all rows of a rest together say as much as one.
fn one_stiction_a_rest(rows: &[Row], slopes: &mut [Slopes], plant: &Plant, path: &MeasuredPath) {
    for joint in 0..plant.link_count() {
        let is_drive = |k: &usize| matches!(rows[*k].kind, Kind::Current(i) | Kind::Undriven(i) if i == joint);
        let own: Vec<usize> = (0..rows.len()).filter(is_drive).collect();
        let rests = |k: usize| {
            let t_s = rows[k].t_s;
            1.0 - direction(path.joints[joint].at(t_s)[1], path.rate_sd(joint, t_s)).powi(2)
        };
        let share: Vec<f64> = own.iter().map(|k| rests(*k)).collect();
        let mut from = 0;
        while from < own.len() {
            let to = (from..own.len()).find(|k| share[*k] < 0.5).unwrap_or(own.len());
            let together: f64 = share[from..to].iter().sum::<f64>().max(1.0);
            for k in &own[from..to] {
                slopes[*k].unit_friction_variance *= together;
                slopes[*k].repeats_rest = 1.0 - together.recip();
            }
            from = to.max(from + 1);
        }
    }
}

/// Makes the noises of the three rows of an end-effector's pose independent: the base's heading error is in all of them.
fn mix_tips(plant: &Plant, rows: &[Row], slopes: &mut [Slopes]) {
    let sensors = &plant.sensors;
    let floats = !plant.base.clamped;
    for first in (0..rows.len()).filter(|k| rows[*k].kind == Kind::Tip(0)) {
        if rows.get(first + 2).is_none_or(|r| r.kind != Kind::Tip(2)) {
            continue;
        }
        let count = rows[first].stamps_s.len() as f64;
        let (place, angle) = (sensors.mocap_position_m.powi(2), sensors.mocap_angle_rad.powi(2));
        let mut noise = Matrix3::from_diagonal(&[place, place, angle].into());
        if floats {
            let lever = nalgebra::Vector3::new(rows[first + 1].value, -rows[first].value, -1.0);
            noise += Matrix3::from_diagonal(&[place, place, 0.0].into()) + angle * lever * lever.transpose();
        }
        noise /= count;
        let Some(factor) = noise.cholesky().map(|c| c.l()) else { continue };
        let sd: [f64; 3] = std::array::from_fn(|i| factor[(i, i)]);
        let unit = Matrix3::from_fn(|i, j| factor[(i, j)] / sd[j]);
        let Some(inverse) = unit.try_inverse() else { continue };
        let plain: Vec<Vec<(usize, f64)>> = (first..first + 3).map(|k| slopes[k].motion.clone()).collect();
        for i in 0..3 {
            let mixed = |state: usize| (0..=i).map(|c| inverse[(i, c)] * plain[c][state].1).sum::<f64>();
            slopes[first + i].motion = (0..plain[i].len()).map(|s| (plain[i][s].0, mixed(s))).collect();
            slopes[first + i].mix = Some((std::array::from_fn(|c| inverse[(i, c)]), sd[i]));
        }
    }
}
