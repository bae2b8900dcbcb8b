//! How the answer of servos to the same datagrams changes with their gains.
//!
//! With M the joints' generalized inertia, s the motors' torque scales, B the viscous frictions, G, K and I the gains of position, rate
//! and the rate's integral, e a servo's error of rate and l that of its angle, all 0 of gains whose motion is known and 1 of
//! others, the motion d that the others make beside it and the torque w of their integrals are
//!
//! ```text
//! M d'' = s ((K1 - K0) e + K1 (G1 - G0) l + w - K1 (G1 d + d')) - B d'
//! w'    = (I1 - I0) e + I1 ((G1 - G0) l - G1 d - d')
//! ```
//!
//! This is linear in d and exact but for centrifugal torques, which are slow. A joint that rests is held there.

use super::{Error, Response};
use fss_multibody::{Coordinates, Model};
use fss_plant::{Friction, Physics, Servo};
use nalgebra::{DMatrix, Matrix3};

/// The joints' inertia is taken to be constant for so long, s: an arm turns by some hundredths of a radian.
const SEGMENT_S: f64 = 0.2;
/// A joint slower than this rests if its friction is dry, rad/s.
const RESTS_RAD_S: f64 = 1e-5;

/// Angle, rate and acceleration at each node of a path.
pub(crate) type Nodes = Vec<[f64; 3]>;

/// Drives and what they move, over a run.
#[derive(Clone, Debug)]
pub(crate) struct ClosedLoop {
    /// The joints' generalized inertia in each segment, kg m2.
    inertia: Vec<DMatrix<f64>>,
    drives: Vec<Drive>,
    step_s: f64,
}

/// One drive.
#[derive(Clone, Debug)]
struct Drive {
    torque_scale: f64,
    friction: Friction,
    servo: Servo,
}

/// What the joints' motors feel of the arm's inertia; a floating base gives way.
fn generalized_inertia(model: &Model, clamped: bool, q: &Coordinates) -> Option<DMatrix<f64>> {
    let mass = model.mass_matrix(q);
    let joints = model.link_count();
    let base: Matrix3<f64> = mass.fixed_view::<3, 3>(0, 0).into_owned();
    let across = DMatrix::from_fn(3, joints, |i, j| mass[(i, 3 + j)]);
    let own = DMatrix::from_fn(joints, joints, |i, j| mass[(3 + i, 3 + j)]);
    if clamped { Some(own) } else { Some(own - across.transpose() * (base.try_inverse()? * &across)) }
}

impl ClosedLoop {
    /// Of what acts at postures; nodes are `step_s` apart. `None` where a posture is no mechanism.
    pub(crate) fn new(
        model: &Model,
        physics: &Physics,
        step_s: f64,
        postures: impl ExactSizeIterator<Item = Coordinates>,
    ) -> Option<Self> {
        let of_segment = |q| generalized_inertia(model, physics.base.clamped, &q);
        let inertia = postures.step_by(segment(step_s)).map(of_segment).collect::<Option<_>>()?;
        let drive = |(joint, servo): (&fss_plant::JointPhysics, &Servo)| Drive {
            torque_scale: joint.torque_scale,
            friction: joint.friction,
            servo: servo.clone(),
        };
        Some(Self { inertia, drives: physics.joints.iter().zip(&physics.servos).map(drive).collect(), step_s })
    }

    /// The motion that joints with other servos make beside those of these; `None` where they are these.
    pub(crate) fn change(&self, servos: &[Servo], response: &Response) -> Option<Vec<Nodes>> {
        let (joints, nodes) = (self.drives.len(), response.nominal.first()?.len());
        if nodes < 2 || self.drives.iter().zip(servos).all(|(own, other)| own.servo == *other) {
            return None;
        }
        let mut out = vec![Vec::with_capacity(nodes); joints];
        let mut state = vec![0.0; 3 * joints];
        let (mut push, mut next) = (vec![0.0; 2 * joints], state.clone());
        let mut rests = vec![false; joints];
        let mut known: Option<(usize, Vec<bool>, Step)> = None;
        for k in 0..nodes {
            let at = k / segment(self.step_s);
            (0..joints).for_each(|i| rests[i] = self.rests(response, i, k));
            if known.as_ref().is_none_or(|(segment, resting, _)| *segment != at || *resting != rests) {
                let step = Step::new(&self.inertia[at], (&self.drives, servos, &rests), self.step_s)?;
                known = Some((at, rests.clone(), step));
            }
            let (_, _, step) = known.as_ref()?;
            (0..joints).filter(|i| rests[*i]).for_each(|i| state[joints + i] = 0.0);
            self.push(servos, |i| response.errors[i][k].now, &mut push);
            for (i, out) in out.iter_mut().enumerate() {
                out.push([state[i], state[joints + i], step.acceleration(i, &state, &push)]);
            }
            self.push(servos, |i| response.errors[i][k].until_next, &mut push);
            step.advance(&state, &push, &mut next);
            std::mem::swap(&mut state, &mut next);
        }
        Some(out)
    }

    /// Whether dry friction holds a joint at a node.
    fn rests(&self, response: &Response, joint: usize, node: usize) -> bool {
        self.drives[joint].friction.is_dry() && response.nominal[joint][node][1].abs() < RESTS_RAD_S
    }

    /// What pushes the joints off their motion: torques, then rates of the torques of the integral parts.
    fn push(&self, servos: &[Servo], error: impl Fn(usize) -> Error, out: &mut [f64]) {
        let joints = self.drives.len();
        for (i, (own, new)) in self.drives.iter().zip(servos).enumerate() {
            let (old, error) = (&own.servo, error(i));
            let turned = (new.position_gain_1_s - old.position_gain_1_s) * error.angle_rad;
            let gains = (new.velocity_gain_n_m_s_rad - old.velocity_gain_n_m_s_rad) * error.rate_rad_s
                + new.velocity_gain_n_m_s_rad * turned;
            out[i] = own.torque_scale * gains;
            out[joints + i] = (new.velocity_integral_n_m_rad - old.velocity_integral_n_m_rad) * error.rate_rad_s
                + new.velocity_integral_n_m_rad * turned;
        }
    }
}

/// Nodes of a segment.
fn segment(step_s: f64) -> usize {
    ((SEGMENT_S / step_s) as usize).max(1)
}

/// A step of `x' = A x + B p` with angles and rates x and torques p: the Pade approximant (2, 2) of the exponential, which
/// decays whatever the step.
struct Step {
    /// A, and M^-1.
    rates: DMatrix<f64>,
    inverse: DMatrix<f64>,
    /// The transition, and next to it what a constant torque adds; row-major.
    rows: Vec<f64>,
}

impl Step {
    /// Of the joints that do not rest: what rests is held, whatever pushes it.
    fn new(
        inertia: &DMatrix<f64>,
        (drives, servos, rests): (&[Drive], &[Servo], &[bool]),
        step_s: f64,
    ) -> Option<Self> {
        let n = drives.len();
        let moving: Vec<usize> = (0..n).filter(|i| !rests[*i]).collect();
        let own = DMatrix::from_fn(moving.len(), moving.len(), |i, j| inertia[(moving[i], moving[j])]).try_inverse()?;
        let mut inverse = DMatrix::zeros(n, n);
        for (i, to) in moving.iter().enumerate() {
            moving.iter().enumerate().for_each(|(j, from)| inverse[(*to, *from)] = own[(i, j)]);
        }
        let mut rates = DMatrix::zeros(3 * n, 3 * n);
        rates.view_mut((0, n), (n, n)).fill_with_identity();
        for (j, (drive, servo)) in drives.iter().zip(servos).enumerate() {
            let gain = drive.torque_scale * servo.velocity_gain_n_m_s_rad;
            for i in 0..n {
                rates[(n + i, j)] = -inverse[(i, j)] * gain * servo.position_gain_1_s;
                rates[(n + i, n + j)] = -inverse[(i, j)] * (gain + drive.friction.viscous_n_m_s_rad);
                rates[(n + i, 2 * n + j)] = inverse[(i, j)] * drive.torque_scale;
            }
            rates[(2 * n + j, j)] = -servo.velocity_integral_n_m_rad * servo.position_gain_1_s;
            rates[(2 * n + j, n + j)] = -servo.velocity_integral_n_m_rad;
        }
        let z = &rates * step_s;
        let even = DMatrix::identity(3 * n, 3 * n) + &z * &z / 12.0;
        let mut right = DMatrix::zeros(3 * n, 5 * n);
        right.view_mut((0, 0), (3 * n, 3 * n)).copy_from(&(&even + 0.5 * &z));
        // (exp z - 1)/z of the same approximant is the inverse of its denominator.
        right.view_mut((n, 3 * n), (n, n)).copy_from(&(step_s * &inverse));
        right.view_mut((2 * n, 4 * n), (n, n)).copy_from(&(step_s * DMatrix::identity(n, n)));
        let solved = (even - 0.5 * z).lu().solve(&right)?;
        Some(Self { rates, inverse, rows: solved.transpose().as_slice().to_vec() })
    }

    fn acceleration(&self, joint: usize, state: &[f64], push: &[f64]) -> f64 {
        let joints = self.inverse.nrows();
        let pushed: f64 = (0..joints).map(|j| self.inverse[(joint, j)] * push[j]).sum();
        let back: f64 = state.iter().enumerate().map(|(j, x)| self.rates[(joints + joint, j)] * x).sum();
        pushed + back
    }

    fn advance(&self, state: &[f64], push: &[f64], next: &mut [f64]) {
        let width = state.len() + push.len();
        for (row, next) in self.rows.chunks_exact(width).zip(next) {
            *next = row.iter().zip(state.iter().chain(push)).map(|(a, b)| a * b).sum();
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::servo_response::Answers;
    use fss_experiments::commands::Commands;
    use fss_plant::{DEFAULT_PLANT, JointCommand, Plant};

    const STEP_S: f64 = 0.001;

    /// A plant whose joints have no dry friction: where they stick and slip, no linearization holds.
    fn plant() -> Plant {
        let mut plant = Plant::parse(DEFAULT_PLANT).unwrap();
        plant.links.iter_mut().for_each(|link| link.coulomb_friction_n_m = 0.0);
        plant
    }

    /// Joints that swing, each with its own period, told 25 times a second.
    fn swings(joints: usize) -> Commands {
        let told = |joint: usize, k: i32| {
            let (t_s, w) = (0.04 * f64::from(k), 3.0 + 0.7 * joint as f64);
            let command =
                JointCommand::Position { q_rad: 0.1 * (1.0 - (w * t_s).cos()), qd_rad_s: 0.1 * w * (w * t_s).sin() };
            (t_s, command)
        };
        let joints: Vec<_> = (0..joints).map(|joint| (0..150).map(|k| told(joint, k)).collect()).collect();
        Commands { q_rad: vec![0.0; joints.len()], joints, end_s: 6.0, ..Commands::default() }
    }

    fn closed_loop(plant: &Plant, path: &Response) -> ClosedLoop {
        let physics = Physics::with(plant, &plant.effects);
        let posture = |k: usize| {
            let mut q = Coordinates::zeros();
            path.nominal.iter().enumerate().for_each(|(i, joint)| q[3 + i] = joint[k][0]);
            q
        };
        let postures = (0..path.nominal[0].len()).map(posture);
        ClosedLoop::new(&physics.model(0.0).unwrap(), &physics, STEP_S, postures).unwrap()
    }

    fn servos(plant: &Plant) -> Vec<Servo> {
        (0..plant.link_count()).map(|i| plant.servo(i).clone()).collect()
    }

    /// How fast the difference of two simulated plants' accelerations changes, and the part that the linear change does not tell. What is
    /// slow, as of centrifugal torques, telemetry shows.
    fn difference_and_rest(other: &Plant) -> [f64; 2] {
        let plant = plant();
        let commands = swings(plant.link_count());
        let grid_s: Vec<f64> = (0..5500).map(|k| STEP_S * f64::from(k)).collect();
        let [here, there] =
            [&plant, other].map(|plant| Answers::default().response(plant, &commands, &grid_s).unwrap());
        let change = closed_loop(&plant, &here).change(&servos(other), &here).unwrap();
        let mut squares = [0.0; 2];
        for joint in 0..plant.link_count() {
            for k in 1000..grid_s.len() {
                let differs = |k: usize| there.nominal[joint][k][2] - here.nominal[joint][k][2];
                let (difference, told) = (differs(k) - differs(k - 1), change[joint][k][2] - change[joint][k - 1][2]);
                squares[0] += difference * difference;
                squares[1] += (difference - told).powi(2);
            }
        }
        squares.map(f64::sqrt)
    }

    #[test]
    fn joints_with_other_gains_answer_as_their_simulation_does() {
        let mut tuned = plant();
        tuned.servo.velocity_gain_n_m_s_rad *= 0.8;
        tuned.servo.position_gain_1_s *= 1.2;

        let [difference, rest] = difference_and_rest(&tuned);

        assert!(difference > 1.0 && rest < 0.5 * difference, "{rest} of {difference} rad/s2 are left");
    }

    #[test]
    fn a_plant_answers_like_itself() {
        let plant = plant();
        let commands = swings(plant.link_count());
        let path = Answers::default().response(&plant, &commands, &[0.0, STEP_S, 2.0 * STEP_S]).unwrap();
        assert!(closed_loop(&plant, &path).change(&servos(&plant), &path).is_none());
    }
}
