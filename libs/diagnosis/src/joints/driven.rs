//! Rows of arms whose torques are known all the time: the motion follows from them.

use super::linearize::{eccentric, readings, torque_slopes};
use super::mechanics::Mechanics;
use super::path::MeasuredPath;
use super::rows::{Kind, Row, Slopes, moments};
use fss_multibody::{JointVector, MAX_LINKS};
use nalgebra::{DVector, SMatrix};

/// What drives' rows of one moment read where the motion follows from the torques: what the nominal plant reads of the path,
/// and the difference in motion that the plant makes of the same torques, as the torque that the nominal plant would need for
/// it. So a plant cannot explain a residual of torques by making all torques small.
fn driven(mechanics: &Mechanics, anchor: &Anchor, path: &MeasuredPath, rows: &[Row]) -> JointVector {
    let stamp_s = rows[0].t_s;
    let links = path.joints.len();
    let t_s = stamp_s - mechanics.physics(stamp_s).sensors.link_age_s(0);
    let arm = mechanics.arm(t_s);
    let sd: Vec<f64> = (0..links).map(|i| path.rate_sd(i, stamp_s)).collect();
    let mut motor = JointVector::zeros();
    for row in rows {
        if let Kind::Current(i) = row.kind {
            motor[i] = mechanics.given(t_s, i, row.value);
        }
    }
    let moved = mechanics.accelerations(t_s, &arm, &motor, &sd);
    let difference = moved - anchor.acceleration;
    -(anchor.inertia * difference)
}

/// What the nominal plant makes of the torques at one moment.
#[derive(Clone, Debug)]
pub(super) struct Anchor {
    /// Readings of the moment's rows.
    reading: Vec<f64>,
    /// Accelerations of the encoders, rad/s2, and the torques that it takes to change them, N m s2/rad.
    acceleration: JointVector,
    inertia: SMatrix<f64, MAX_LINKS, MAX_LINKS>,
    /// Amperes or newton metres a newton metre.
    unit: JointVector,
}

/// Anchors of all moments at which all joints' drives are known; `None` where torques are not.
pub(super) fn anchors(
    mechanics: &Mechanics,
    path: &MeasuredPath,
    rows: &[Row],
    nominal: &[f64],
) -> Vec<Option<Anchor>> {
    let links = path.joints.len();
    let anchor = |moment: std::ops::Range<usize>| {
        let known =
            |i: usize| rows[moment.clone()].iter().any(|r| r.kind == Kind::Current(i) || r.kind == Kind::Undriven(i));
        if !(0..links).all(known) {
            return None;
        }
        let t_s = rows[moment.start].t_s;
        let columns = torque_slopes(mechanics, t_s, links);
        let mut unit = JointVector::repeat(1.0);
        for row in &rows[moment.clone()] {
            if let Kind::Current(i) = row.kind {
                unit[i] = mechanics.current(t_s, i, 1.0);
            }
        }
        let mut out = Anchor {
            reading: nominal[moment.clone()].to_vec(),
            acceleration: JointVector::zeros(),
            inertia: SMatrix::from_fn(|i, j| if i < links && j < links { columns[3 * j + 2][i] } else { 0.0 }),
            unit,
        };
        out.acceleration = -nominal_accelerations(mechanics, &out, path, &rows[moment]);
        Some(out)
    };
    moments(rows).into_iter().map(anchor).collect()
}

/// Minus the accelerations that the nominal plant makes of the torques.
fn nominal_accelerations(mechanics: &Mechanics, anchor: &Anchor, path: &MeasuredPath, rows: &[Row]) -> JointVector {
    let unit = Anchor { inertia: SMatrix::identity(), ..anchor.clone() };
    driven(mechanics, &unit, path, rows)
}

/// What all rows read at their times, where torques are known all the time.
pub(super) fn predict_driven(
    mechanics: &Mechanics,
    path: &MeasuredPath,
    rows: &[Row],
    anchors: &[Option<Anchor>],
) -> Vec<f64> {
    let mut out = Vec::with_capacity(rows.len());
    for (moment, anchor) in moments(rows).into_iter().zip(anchors) {
        let own = &rows[moment.clone()];
        let kinds: Vec<Kind> = own.iter().map(|r| r.kind).collect();
        let Some(anchor) = anchor else {
            out.extend(readings(mechanics, path, own[0].t_s, &kinds));
            continue;
        };
        let missing = driven(mechanics, anchor, path, own);
        let rest: Vec<Kind> = kinds.iter().copied().filter(|k| matches!(k, Kind::Torque(_) | Kind::Tip(_))).collect();
        let mut rest = readings(mechanics, path, own[0].t_s, &rest).into_iter();
        out.extend(kinds.iter().zip(&anchor.reading).map(|(kind, nominal)| match *kind {
            Kind::Current(i) | Kind::Undriven(i) => nominal + anchor.unit[i] * missing[i],
            Kind::Torque(_) | Kind::Tip(_) => rest.next().unwrap_or(*nominal),
            Kind::Angle(_) | Kind::Rate(_) => *nominal,
        }));
    }
    out
}

/// Standard deviation of the inertia that a rigid drive's rotor adds to its joint, as a share of the joint's own: what a gear of
/// six to ten makes of a rotor. A plant file does not state it.
const ROTOR_SHARE: f64 = 0.05;

/// What the current of joint `i` depends on its rotor's inertia by, in standard deviations: through the acceleration that the
/// nominal plant makes of the torques, not the measured one, which what is left of the torques is in.
fn by_rotor(anchor: &Anchor, i: usize) -> f64 {
    anchor.unit[i] * ROTOR_SHARE * anchor.inertia[(i, i)] * anchor.acceleration[i]
}

/// Adds what drives' rows depend on rotors and on encoders' errors once a turn by, where the motion follows from the torques. An
/// encoder with the error e reads the acceleration (1 + e') a of a link; of the part of a that no torque explains this is none of the
/// error's doing. Without these slopes an error would explain what is left of the torques by making it smaller.
pub(super) fn add_rotors_and_encoders(
    path: &MeasuredPath,
    rows: &[Row],
    anchors: &[Option<Anchor>],
    slopes: &mut [Slopes],
) {
    let links = path.joints.len();
    for (moment, anchor) in moments(rows).into_iter().zip(anchors) {
        let Some(anchor) = anchor else { continue };
        let inertia = anchor.inertia.view((0, 0), (links, links)).into_owned();
        let mut left = DVector::zeros(links);
        for (row, reading) in rows[moment.clone()].iter().zip(&anchor.reading) {
            if let Kind::Current(i) | Kind::Undriven(i) = row.kind {
                left[i] = (reading - row.value) / anchor.unit[i];
            }
        }
        let Some(unexplained) = inertia.clone().lu().solve(&left) else { continue };
        for k in moment {
            let (Kind::Current(i) | Kind::Undriven(i)) = rows[k].kind else { continue };
            slopes[k].eccentricity.clear();
            if let Kind::Current(_) = rows[k].kind {
                slopes[k].rotor = by_rotor(anchor, i);
            }
            for j in 0..links {
                let (sin, cos) = path.joints[j].at(rows[k].t_s)[0].sin_cos();
                let torque = anchor.unit[i] * inertia[(i, j)] * unexplained[j];
                slopes[k].eccentricity.extend(eccentric(j, [torque * cos, -torque * sin]));
            }
        }
    }
}
