//! How the answer of servos to the same datagrams changes with masses, frictions, torque constants and gains.
//!
//! With M the joints' generalized inertia, s the motors' torque scales, f the frictions and B their viscous parts, G, K and I the gains
//! of position, rate and the rate's integral, e a servo's error of rate and l that of its angle, all 0 of a plant whose
//! motion q0 is known and 1 of another, the motion d that the other makes beside q0 and the torque w of its integrals are
//!
//! ```text
//! M1 d'' = (s1/s0 M0 - M1) q0'' + s1/s0 f0 - f1 + s1 ((K1 - K0) e + K1 (G1 - G0) l + w - K1 (G1 d + d')) - B1 d'
//! w'     = (I1 - I0) e + I1 ((G1 - G0) l - G1 d - d')
//! ```
//!
//! This is linear in d and exact in M but for centrifugal torques, which are slow. A joint that rests on the way q0 is held there.

use super::{Error, Response};
use crate::friction::direction;
use fss_multibody::{Coordinates, Model};
use fss_plant::{Friction, Physics};
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
    physics: Physics,
    /// The joints' generalized inertia in each segment, kg m2.
    inertia: Vec<DMatrix<f64>>,
    drives: Vec<Drive>,
}

/// One drive.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Drive {
    torque_scale: f64,
    friction: Friction,
    position_gain_1_s: f64,
    velocity_gain_n_m_s_rad: f64,
    velocity_integral_n_m_rad: f64,
}

/// What the joints' motors feel of the arm's inertia; a floating base gives way.
pub(crate) fn generalized_inertia(model: &Model, clamped: bool, q: &Coordinates) -> Option<DMatrix<f64>> {
    let mass = model.mass_matrix(q);
    let joints = model.link_count();
    let base: Matrix3<f64> = mass.fixed_view::<3, 3>(0, 0).into_owned();
    let across = DMatrix::from_fn(3, joints, |i, j| mass[(i, 3 + j)]);
    let own = DMatrix::from_fn(joints, joints, |i, j| mass[(3 + i, 3 + j)]);
    if clamped { Some(own) } else { Some(own - across.transpose() * (base.try_inverse()? * &across)) }
}

impl ClosedLoop {
    /// Of what acts at times and postures; nodes are `step_s` apart. `None` where a posture is no mechanism.
    pub(crate) fn new<'a>(
        nodes: usize,
        step_s: f64,
        physics: &Physics,
        at: impl Fn(usize) -> (&'a Model, Coordinates),
    ) -> Option<Self> {
        let of_segment = |k: usize| {
            let (model, q) = at(k);
            generalized_inertia(model, physics.base.clamped, &q)
        };
        let inertia = (0..nodes).step_by(segment(step_s)).map(of_segment).collect::<Option<_>>()?;
        let drive = |(joint, servo): (&fss_plant::JointPhysics, &fss_plant::Servo)| Drive {
            torque_scale: joint.torque_scale,
            friction: joint.friction,
            position_gain_1_s: servo.position_gain_1_s,
            velocity_gain_n_m_s_rad: servo.velocity_gain_n_m_s_rad,
            velocity_integral_n_m_rad: servo.velocity_integral_n_m_rad,
        };
        Some(Self {
            physics: physics.clone(),
            inertia,
            drives: physics.joints.iter().zip(&physics.servos).map(drive).collect(),
        })
    }

    /// Whether what acts has the same masses and drives.
    pub(crate) fn is_of(&self, physics: &Physics) -> bool {
        let own = &self.physics;
        own.base == physics.base
            && own.links == physics.links
            && own.joints == physics.joints
            && own.servos == physics.servos
            && own.payload_kg == physics.payload_kg
            && own.grasped == physics.grasped
    }

    /// The motion that another plant's joints make beside those of this one; `None` where they answer alike.
    pub(crate) fn change(&self, other: &Self, response: &Response, step_s: f64) -> Option<Vec<Nodes>> {
        let (joints, nodes) = (self.drives.len(), response.nominal.first()?.len());
        if (self.inertia == other.inertia && self.drives == other.drives) || nodes < 2 {
            return None;
        }
        let mut out = vec![Vec::with_capacity(nodes); joints];
        let mut state = vec![0.0; 3 * joints];
        let (mut push, mut next) = (vec![0.0; 2 * joints], state.clone());
        let mut known: Option<(usize, Vec<bool>, Step)> = None;
        for k in 0..nodes {
            let at = k / segment(step_s);
            let rests: Vec<bool> = (0..joints).map(|i| other.rests(response, i, k)).collect();
            if known.as_ref().is_none_or(|(segment, resting, _)| *segment != at || *resting != rests) {
                let step = Step::new(&other.inertia[at], (&other.drives, &rests), step_s)?;
                known = Some((at, rests.clone(), step));
            }
            let (_, _, step) = known.as_ref()?;
            (0..joints).filter(|i| rests[*i]).for_each(|i| state[joints + i] = 0.0);
            let instant = |i: usize| (response.nominal[i][k][1], response.nominal[i][k][2], response.errors[i][k].now);
            self.push(other, at, instant, &mut push);
            let acceleration = |i: usize| -> f64 {
                let pushed: f64 = (0..joints).map(|j| step.inverse[(i, j)] * push[j]).sum();
                let back: f64 = (0..3 * joints).map(|j| step.rates[(joints + i, j)] * state[j]).sum();
                pushed + back
            };
            for (i, out) in out.iter_mut().enumerate() {
                out.push([state[i], state[joints + i], acceleration(i)]);
            }
            let Some(after) = (k + 1 < nodes).then_some(k + 1) else { break };
            let mean = |i: usize| {
                let nodes = &response.nominal[i];
                let (from, to) = (nodes[k][1], nodes[after][1]);
                (0.5 * (from + to), (to - from) / step_s, response.errors[i][k].until_next)
            };
            self.push(other, at, mean, &mut push);
            step.advance(&state, &push, &mut next);
            std::mem::swap(&mut state, &mut next);
        }
        Some(out)
    }

    /// Whether dry friction holds a joint at a node.
    fn rests(&self, response: &Response, joint: usize, node: usize) -> bool {
        self.drives[joint].friction.is_dry() && response.nominal[joint][node][1].abs() < RESTS_RAD_S
    }

    /// What pushes the joints off the motion of this plant in another, of each joint's rate, acceleration and servo errors: torques,
    /// then rates of the torques of the integral parts.
    fn push(&self, other: &Self, segment: usize, at: impl Fn(usize) -> (f64, f64, Error), out: &mut [f64]) {
        let (before, after) = (&self.inertia[segment], &other.inertia[segment]);
        let joints = self.drives.len();
        for (i, (own, new)) in self.drives.iter().zip(&other.drives).enumerate() {
            let ratio = new.torque_scale / own.torque_scale.max(LEAST_SCALE);
            let (rate, _, error) = at(i);
            let turned = (new.position_gain_1_s - own.position_gain_1_s) * error.angle_rad;
            let gains = (new.velocity_gain_n_m_s_rad - own.velocity_gain_n_m_s_rad) * error.rate_rad_s
                + new.velocity_gain_n_m_s_rad * turned;
            let inertial: f64 = (0..joints).map(|j| (ratio * before[(i, j)] - after[(i, j)]) * at(j).1).sum();
            let friction = |drive: &Drive| drive.friction.sliding_n_m(direction(rate, 0.0), rate);
            let friction = if own == new { 0.0 } else { ratio * friction(own) - friction(new) };
            out[i] = inertial + friction + new.torque_scale * gains;
            out[joints + i] = (new.velocity_integral_n_m_rad - own.velocity_integral_n_m_rad) * error.rate_rad_s
                + new.velocity_integral_n_m_rad * turned;
        }
    }

    /// The torques on the links, N m, and of the motors over their scales, that a motion beside the path takes at a node.
    pub(crate) fn torques(&self, node: usize, step_s: f64, motion: impl Fn(usize) -> [f64; 3]) -> Vec<[f64; 2]> {
        let inertia = &self.inertia[(node / segment(step_s)).min(self.inertia.len() - 1)];
        let accelerations: Vec<f64> = (0..self.drives.len()).map(|j| motion(j)[2]).collect();
        let of = |(i, drive): (usize, &Drive)| {
            let link: f64 = accelerations.iter().enumerate().map(|(j, a)| inertia[(i, j)] * a).sum();
            [link, (link + drive.friction.viscous_n_m_s_rad * motion(i)[1]) / drive.torque_scale.max(LEAST_SCALE)]
        };
        self.drives.iter().enumerate().map(of).collect()
    }
}

/// Share of its torque that a motor keeps: a current is finite whatever the motor gives for it.
const LEAST_SCALE: f64 = 0.01;

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
    fn new(inertia: &DMatrix<f64>, (drives, rests): (&[Drive], &[bool]), step_s: f64) -> Option<Self> {
        let n = drives.len();
        let moving: Vec<usize> = (0..n).filter(|i| !rests[*i]).collect();
        let own = DMatrix::from_fn(moving.len(), moving.len(), |i, j| inertia[(moving[i], moving[j])]).try_inverse()?;
        let mut inverse = DMatrix::zeros(n, n);
        for (i, to) in moving.iter().enumerate() {
            moving.iter().enumerate().for_each(|(j, from)| inverse[(*to, *from)] = own[(i, j)]);
        }
        let mut rates = DMatrix::zeros(3 * n, 3 * n);
        rates.view_mut((0, n), (n, n)).fill_with_identity();
        for (j, drive) in drives.iter().enumerate() {
            let gain = drive.torque_scale * drive.velocity_gain_n_m_s_rad;
            for i in 0..n {
                rates[(n + i, j)] = -inverse[(i, j)] * gain * drive.position_gain_1_s;
                rates[(n + i, n + j)] = -inverse[(i, j)] * (gain + drive.friction.viscous_n_m_s_rad);
                rates[(n + i, 2 * n + j)] = inverse[(i, j)] * drive.torque_scale;
            }
            rates[(2 * n + j, j)] = -drive.velocity_integral_n_m_rad * drive.position_gain_1_s;
            rates[(2 * n + j, n + j)] = -drive.velocity_integral_n_m_rad;
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
    use crate::servo_response::response;
    use fss_experiments::commands::Commands;
    use fss_plant::{DEFAULT_PLANT, Effect, JointCommand, Plant};

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

    fn closed_loop(plant: &Plant, nodes: usize, path: &Response) -> ClosedLoop {
        let physics = Physics::with(plant, &plant.effects);
        let model = physics.model(0.0).unwrap();
        let posture = |k: usize| {
            let mut q = Coordinates::zeros();
            path.nominal.iter().enumerate().for_each(|(i, joint)| q[3 + i] = joint[k][0]);
            (&model, q)
        };
        ClosedLoop::new(nodes, STEP_S, &physics, posture).unwrap()
    }

    /// How fast the difference of two simulated plants' accelerations changes, and the part that the linear change does not tell. What is
    /// slow, as of centrifugal torques, telemetry shows.
    fn difference_and_rest(other: &Plant) -> [f64; 2] {
        let plant = plant();
        let commands = swings(plant.link_count());
        let grid_s: Vec<f64> = (0..5500).map(|k| STEP_S * f64::from(k)).collect();
        let (here, there) =
            (response(&plant, &commands, &grid_s).unwrap(), response(other, &commands, &grid_s).unwrap());
        let own = closed_loop(&plant, grid_s.len(), &here);
        let change = own.change(&closed_loop(other, grid_s.len(), &here), &here, STEP_S).unwrap();
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
    fn another_plants_joints_answer_as_its_simulation_does() {
        let plant = plant();
        let heavy = Effect::new("link_inertia").unwrap().at(1).with(&[3.0 * plant.links[0].inertia_kg_m2]);
        let strong = Effect::new("torque_constant").unwrap().at(3).with(&[1.4]);
        let mut tuned = plant.clone();
        tuned.servo.velocity_gain_n_m_s_rad *= 0.8;
        tuned.servo.position_gain_1_s *= 1.2;
        for other in [plant.with_effects(&[heavy]), plant.with_effects(&[strong]), tuned] {
            let [difference, rest] = difference_and_rest(&other);

            assert!(difference > 1.0 && rest < 0.5 * difference, "{rest} of {difference} rad/s2 are left");
        }
    }

    #[test]
    fn a_plant_answers_like_itself() {
        let plant = plant();
        let path = response(&plant, &swings(plant.link_count()), &[0.0, STEP_S, 2.0 * STEP_S]).unwrap();
        let own = closed_loop(&plant, 3, &path);
        assert!(own.change(&own.clone(), &path, STEP_S).is_none());
    }
}
