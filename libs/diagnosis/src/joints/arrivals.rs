//! Datagrams that arrive earlier or later than they are taken to, and what servos make of that.
//!
//! A datagram that says an angle p and a rate v arrives u standard deviations s late; the u of different datagrams are
//! independent. Until the next one the target, which goes on from its arrival at the rate v, is displaced by -v s u; and the
//! target's rate has kept its old value for s u longer. With H the generalized inertia of the joints, K the velocity gains,
//! G the position gains and B the viscous friction, the joints' motion d beside the reference is
//!
//! ```text
//! H d'' = K (G (-v s u - d) - d') - B d',     and at an arrival   d' -> d' - H^-1 K (v - v_before) s u
//! ```

use super::mechanics::Mechanics;
use super::path::Reference;
use super::rows::{Kind, Row, Slopes, moments};
use crate::servo_response::{ARRIVAL_SD_S, generalized_inertia};
use fss_experiments::commands::Commands;
use fss_multibody::Coordinates;
use fss_plant::{JointCommand, Plant};
use nalgebra::{DMatrix, DVector};

/// Whether a datagram has arrived is not known this long before and after it is taken to, s: of 2 to 8 ms over a radio, and of the
/// laboratory's step.
const UNCERTAIN_S: f64 = 4e-3;

/// From one moment to the next: elements of the transition and of the noise's covariance that are not 0. States: u of each joint,
/// then the angles d, then the rates d'.
#[derive(Clone, Debug, Default)]
pub(super) struct ArrivalStep {
    pub(super) transition: Vec<(usize, usize, f64)>,
    pub(super) noise: Vec<(usize, usize, f64)>,
}

/// What late datagrams do over a run.
#[derive(Clone, Debug, Default)]
pub(super) struct Arrivals {
    /// Before each moment but the first.
    pub(super) steps: Vec<ArrivalStep>,
    /// At each moment, accelerations by the states, links x 3 links.
    pub(super) acceleration: Vec<DMatrix<f64>>,
}

/// The servos' linear dynamics at one time.
struct Loop {
    /// Rates of the states.
    rates: DMatrix<f64>,
    /// H^-1 K, and H^-1 K G.
    velocity: DMatrix<f64>,
    position: DMatrix<f64>,
}

impl Loop {
    /// Of a plant in a posture, whose joints are commanded the rates `v`.
    fn new(plant: &Plant, mechanics: &Mechanics, t_s: f64, v: &[f64]) -> Option<Self> {
        let n = v.len();
        let mut q = Coordinates::zeros();
        let arm = mechanics.arm(t_s);
        (0..n).for_each(|i| q[3 + i] = arm.q_rad[i]);
        let inertia = generalized_inertia(mechanics.model(t_s), plant.base.clamped, &q)?;
        let inverse = inertia.try_inverse()?;
        let diagonal = |of: &dyn Fn(usize) -> f64| DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| of(i)));
        let velocity = &inverse * diagonal(&|i| plant.servo(i).velocity_gain_n_m_s_rad);
        let position = &velocity * diagonal(&|i| plant.servo(i).position_gain_1_s);
        let damping = &velocity + &inverse * diagonal(&|i| plant.links[i].viscous_friction_n_m_s_rad);
        let mut rates = DMatrix::zeros(3 * n, 3 * n);
        rates.view_mut((n, 2 * n), (n, n)).fill_with_identity();
        rates.view_mut((2 * n, n), (n, n)).copy_from(&-&position);
        rates.view_mut((2 * n, 2 * n), (n, n)).copy_from(&-damping);
        let mut out = Self { rates, velocity, position };
        v.iter().enumerate().for_each(|(joint, v)| out.follow(joint, *v));
        Some(out)
    }

    /// One joint is commanded the rate `v` from now on.
    fn follow(&mut self, joint: usize, v: f64) {
        let n = self.joints();
        (0..n).for_each(|i| self.rates[(2 * n + i, joint)] = -self.position[(i, joint)] * v * ARRIVAL_SD_S);
    }

    fn joints(&self) -> usize {
        self.velocity.nrows()
    }

    /// Accelerations by the states.
    fn acceleration(&self) -> DMatrix<f64> {
        let n = self.joints();
        self.rates.view((2 * n, 0), (n, 3 * n)).into_owned()
    }

    /// What a datagram of one joint does that arrives a standard deviation late and changes the rate by `dv`.
    fn arrival(&self, joint: usize, dv: f64) -> DVector<f64> {
        let n = self.joints();
        let mut out = DVector::zeros(3 * n);
        out[joint] = 1.0;
        (0..n).for_each(|i| out[2 * n + i] = -self.velocity[(i, joint)] * dv * ARRIVAL_SD_S);
        out
    }
}

impl Arrivals {
    /// Along the measured path; `None` where a posture is no mechanism.
    pub(super) fn new(plant: &Plant, mechanics: &Mechanics, commands: &Commands, rows: &[Row]) -> Option<Self> {
        let links = plant.link_count();
        let mut events: Vec<(f64, usize, f64)> = Vec::new();
        for (joint, own) in commands.joints.iter().enumerate().take(links) {
            events.extend(own.iter().map(|(t_s, command)| (*t_s, joint, rate(command))));
        }
        events.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut events = events.into_iter().peekable();
        let mut v = vec![0.0; links];
        let mut out = Self::default();
        let mut last_s: Option<f64> = None;
        for moment in moments(rows) {
            let t_s = rows[moment.start].t_s;
            let mut now = Loop::new(plant, mechanics, t_s, &v)?;
            let size = 3 * links;
            let (mut transition, mut noise) = (DMatrix::identity(size, size), DMatrix::zeros(size, size));
            let mut from_s = last_s.unwrap_or(f64::NEG_INFINITY);
            let go_on = |now: &Loop, dt_s: f64, transition: &mut DMatrix<f64>, noise: &mut DMatrix<f64>| {
                let f = (&now.rates * dt_s).exp();
                *transition = &f * &*transition;
                *noise = &f * &*noise * f.transpose();
            };
            while let Some((at_s, joint, rate)) = events.next_if(|event| event.0 <= t_s) {
                if at_s > from_s && from_s.is_finite() {
                    go_on(&now, at_s - from_s, &mut transition, &mut noise);
                }
                from_s = at_s;
                let pushed = now.arrival(joint, rate - v[joint]);
                transition.row_mut(joint).fill(0.0);
                noise.row_mut(joint).fill(0.0);
                noise.column_mut(joint).fill(0.0);
                noise += &pushed * pushed.transpose();
                v[joint] = rate;
                now.follow(joint, rate);
            }
            if t_s > from_s && from_s.is_finite() {
                go_on(&now, t_s - from_s, &mut transition, &mut noise);
            }
            if last_s.is_some() {
                out.steps.push(ArrivalStep { transition: elements(&transition), noise: elements(&noise) });
            }
            out.acceleration.push(now.acceleration());
            last_s = Some(t_s);
        }
        Some(out)
    }

    /// Adds to a row's states, of which the first of these is at `first`, what its slopes by the joints' motion make of them.
    pub(super) fn read(&self, moment: usize, motion: &[(usize, f64)], first: usize, states: &mut Vec<(usize, f64)>) {
        let Some(acceleration) = self.acceleration.get(moment) else { return };
        let links = acceleration.nrows();
        let mut own = vec![0.0; 3 * links];
        for (state, slope) in motion {
            let (joint, derivative) = (state / 3, state % 3);
            match derivative {
                0 => own[links + joint] += slope,
                1 => own[2 * links + joint] += slope,
                _ => own.iter_mut().zip(acceleration.row(joint).iter()).for_each(|(o, a)| *o += slope * a),
            }
        }
        states.extend(own.iter().enumerate().filter(|(_, v)| **v != 0.0).map(|(i, v)| (first + i, *v)));
    }
}

/// Variance of each row of rates, torques and currents that is measured where it is not known whether a datagram has arrived: the
/// square of half of what the servos' answer changes there.
pub(super) fn add_timing(reference: &Reference, rows: &[Row], slopes: &mut [Slopes]) {
    for (row, slopes) in rows.iter().zip(slopes) {
        if matches!(row.kind, Kind::Angle(_) | Kind::Tip(_)) {
            continue;
        }
        let change = |(state, slope): &(usize, f64)| {
            let (joint, derivative) = (state / 3, state % 3);
            let at = |k: i32| reference.joints[joint].at(row.t_s + UNCERTAIN_S * f64::from(k) / 2.0)[derivative];
            let (low, high) =
                (-4..=4).map(at).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            if derivative == 0 { 0.0 } else { 0.5 * slope * (high - low) }
        };
        slopes.timing_variance += slopes.motion.iter().map(|own| change(own).powi(2)).sum::<f64>();
    }
}

fn rate(command: &JointCommand) -> f64 {
    match command {
        JointCommand::Position { qd_rad_s, .. } | JointCommand::Velocity { qd_rad_s } => *qd_rad_s,
        JointCommand::Free | JointCommand::Current { .. } => 0.0,
    }
}

/// Elements that are not 0, by the largest of their matrix.
fn elements(of: &DMatrix<f64>) -> Vec<(usize, usize, f64)> {
    let least = 1e-12 * of.amax();
    let all = (0..of.nrows()).flat_map(|i| (0..of.ncols()).map(move |j| (i, j)));
    all.map(|(i, j)| (i, j, of[(i, j)])).filter(|(_, _, v)| v.abs() > least).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// One joint: H = 0.2, K = 6, G = 8, no friction, commanded v = 0.5.
    fn one_joint() -> Loop {
        let (h, k, g, v) = (0.2, 6.0, 8.0, 0.5);
        let rates = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, -k * g * v * ARRIVAL_SD_S / h, -k * g / h, -k / h];
        let one = |value| DMatrix::from_element(1, 1, value);
        Loop { rates: DMatrix::from_row_slice(3, 3, &rates), velocity: one(k / h), position: one(k * g / h) }
    }

    #[test]
    fn a_late_datagram_leaves_its_joint_behind_by_what_it_would_have_moved() {
        let late = one_joint();
        let pushed = late.arrival(0, 0.5);
        let settled = (&late.rates * 5.0).exp() * &pushed;
        // Until another datagram comes: v s behind, at rest beside the reference.
        assert!((settled[1] + 0.5 * ARRIVAL_SD_S).abs() < 1e-9 && settled[2].abs() < 1e-9, "{settled}");
        // At once: the rate lacks what the new target would have added in the meantime.
        assert!((pushed[2] + 6.0 / 0.2 * 0.5 * ARRIVAL_SD_S).abs() < 1e-12);
    }

    #[test]
    fn a_late_datagram_is_what_the_difference_of_two_motions_says() {
        // x'' = k (v + g (p - x) - x'), from rest; the datagram arrives at 0, or one standard deviation later.
        let (k, g, v) = (30.0, 8.0, 0.5);
        let motion = |late_s: f64, until_s: f64| {
            let (mut x, mut rate, mut t) = (0.0, 0.0, 0.0);
            let step = 1e-6;
            while t < until_s {
                let (p, feed) = if t < late_s { (0.0, 0.0) } else { (v * (t - late_s), v) };
                rate += step * k * (feed + g * (p - x) - rate);
                x += step * rate;
                t += step;
            }
            [x, rate]
        };
        let late = one_joint();
        for after_s in [0.02, 0.06, 0.15] {
            let (now, then) = (motion(0.0, after_s), motion(ARRIVAL_SD_S, after_s));
            let linear = (&late.rates * after_s).exp() * late.arrival(0, v);
            for i in 0..2 {
                let (wanted, got) = (then[i] - now[i], linear[1 + i]);
                assert!((wanted - got).abs() < 0.1 * wanted.abs().max(1e-4), "{after_s} s: {wanted} {got}");
            }
        }
    }
}
