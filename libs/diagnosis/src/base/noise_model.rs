//! What disturbs the base's motion and what its sensors add, as a state-space model.

use super::arrivals::Arrivals;
use super::assembled::Assembled;
use super::carriage::joints_only;
use super::hyper::{Hyper, hyper_parameters};
use super::joint_motion::JointMotion;
use super::prediction::Predictor;
use super::samples::Samples;
use super::shown::Shown;
use super::thrust_errors::ThrustErrors;
use crate::block::HyperParameter;
use crate::servo_response::{arrival_time, datagrams};
use fss_estimation::processes::SingerStep;
use fss_estimation::{Columns, Whitener};
use fss_experiments::measured::Run;
use fss_multibody::{JointVector, MAX_LINKS, ModelError, State};
use fss_plant::{Effect, Physics, Plant};

/// States of the deviation: place and speed of the centre of mass, heading, angular momentum, coloured force and torque.
const BODY: usize = 9;
/// Of these, the first of the forces.
pub(super) const FORCES: usize = 6;
/// And of an arm: angular momentum of its rates' errors, error of the centre of mass.
const ARM: usize = 3;
pub(super) const ARM_MOMENTUM: usize = BODY;
pub(super) const ARM_SHIFT: usize = BODY + 1;
/// And of each joint that datagrams command: how late they arrive, and how far it is displaced.
const ARRIVAL: usize = 2;
/// Variances of what is not known at the start: place (m^2) or heading (rad^2), speed (m^2/s^2), rate (rad^2/s^2).
const START: [f64; 3] = [1e2, 1.0, 10.0];
/// Interval of telemetry that is assumed where none came (s).
const SLOW_TELEMETRY_S: f64 = 0.2;

#[derive(Clone)]
pub(super) struct NoiseModel {
    pub(super) hyper_parameters: Vec<HyperParameter>,
    mass_kg: f64,
    /// For each block: time, centre of mass from the base's origin (table axes, m), inertia (kg m^2).
    moments: Vec<(f64, [f64; 2], f64)>,
    /// Rows of each block: the standard deviation of each (x, y, heading, and the gyro's).
    rows: Vec<Vec<f64>>,
    /// Of the arm: correlation time of the errors of its path (s), and for each block the standard deviations that they give to
    /// its angular momentum (kg m^2/s) and to its centre of mass (m).
    arm: Option<(f64, Vec<[f64; 2]>)>,
    arrivals: Vec<Arrivals>,
    thrust: ThrustErrors,
    gyro_walk: f64,
}

impl NoiseModel {
    pub(super) fn new(
        plant: &Plant,
        run: &Run,
        samples: &Samples,
        predictor: &Predictor,
        beside: &JointMotion,
    ) -> Result<Self, ModelError> {
        let physics = Physics::with(plant, &plant.effects);
        let (path, carriage) = (predictor.path(&physics), predictor.carriage(&physics)?);
        let moment = |t_s: f64| {
            let (k, _) = predictor.pose.grid.locate(t_s);
            let (sin, cos) = path.turn[k];
            let [x, y] = carriage.com_m[k];
            (t_s, [cos * x - sin * y, sin * x + cos * y], carriage.inertia_kg_m2[k])
        };
        let mut rows: Vec<Vec<f64>> = Vec::new();
        for (channel, sd) in samples.channel_of_row.iter().zip(&samples.noise_of_row) {
            if *channel == 0 {
                rows.push(Vec::with_capacity(4));
            }
            if let Some(row) = rows.last_mut() {
                row.push(*sd);
            }
        }
        let times = samples.block_times();
        let arm = if plant.link_count() > 0 { Some(arm_errors(&physics, run, predictor, &times)?) } else { None };
        let noise = std::array::from_fn(|i| rows.first().map_or(0.0, |row| row[i]));
        let of_joints = |c| Arrivals::of_joints(plant, arrival_time(c), predictor, beside, (&times, noise));
        let arrivals = datagrams(plant, run).map_or_else(Vec::new, of_joints);
        let thrust = ThrustErrors::new((plant, &plant.effects), predictor, (&path, &carriage), &times)?;
        let walk = plant.sensors.gyro_bias_walk_rad_s_sqrt_s;
        Ok(Self {
            hyper_parameters: hyper_parameters(plant, carriage.inertia_kg_m2[0]),
            mass_kg: carriage.mass_kg,
            moments: times.into_iter().map(moment).collect(),
            rows,
            arm,
            arrivals,
            thrust,
            gyro_walk: walk * walk,
        })
    }

    /// The same where thrusters follow their commands otherwise.
    pub(super) fn with_thrust_of(
        &self,
        plant: (&Plant, &[Effect]),
        nominal: &Physics,
        predictor: &Predictor,
    ) -> Result<Self, ModelError> {
        let (path, carriage) = (predictor.path(nominal), predictor.carriage(nominal)?);
        let times: Vec<f64> = self.moments.iter().map(|m| m.0).collect();
        let thrust = ThrustErrors::new(plant, predictor, (&path, &carriage), &times)?;
        Ok(Self { thrust, ..self.clone() })
    }

    fn states(&self) -> usize {
        self.first_thruster() + self.thrust.states() + usize::from(self.gyro_walk > 0.0)
    }

    fn first_thruster(&self) -> usize {
        self.first_arrival() + ARRIVAL * self.arrivals.len()
    }

    fn first_arrival(&self) -> usize {
        BODY + if self.arm.is_some() { ARM } else { 0 }
    }

    /// Each joint's first state, and the joint.
    fn each_arrivals(&self) -> impl Iterator<Item = (usize, &Arrivals)> {
        let first = self.first_arrival();
        self.arrivals.iter().enumerate().map(move |(i, arrivals)| (first + ARRIVAL * i, arrivals))
    }

    /// Whitens columns with the model at these values of the hyper-parameters, deviations of the motion shown as by these sensors; the
    /// logarithm of the determinant.
    pub(super) fn whiten(&self, hyper: &[f64], shown: Shown, columns: &mut Columns) -> f64 {
        let h = Hyper::of(hyper);
        let n = self.states();
        let mut filter = Whitener::new(n, &self.initial(&h), columns);
        let (mut step, mut states) = (Assembled::default(), Vec::with_capacity(16));
        for (block, (moment, sds)) in self.moments.iter().zip(&self.rows).enumerate() {
            let arm_sd = self.arm_sd(&h, block);
            if let Some(before) = block.checked_sub(1) {
                self.step(&h, before, &mut step);
                filter.advance(step.complete());
            }
            for (channel, sd) in sds.iter().enumerate() {
                states.clear();
                states.extend(shown.body(channel, moment.2));
                states.extend(self.arm.as_ref().map(|arm| shown.arm(channel, (arm_sd, arm.0), moment.2)));
                states.extend(self.each_arrivals().flat_map(|own| shown.arrivals(channel, own, block)));
                if channel == 3 && self.gyro_walk > 0.0 {
                    states.push((n - 1, 1.0));
                }
                let inflation = [h.noise_position, h.noise_position, h.noise_angle, h.noise_gyro][channel];
                states.retain(|(_, by)| *by != 0.0);
                filter.measure(&states, (inflation * sd).powi(2));
            }
        }
        filter.log_det()
    }

    fn initial(&self, h: &Hyper) -> Vec<f64> {
        let n = self.states();
        let inertia = self.moments.first().map_or(1.0, |m| m.2);
        let [place, speed, rate] = START;
        let force = h.force.powi(2);
        let body = [place, speed, place, speed, place, rate * inertia * inertia, force, force, h.torque.powi(2)];
        let mut initial = vec![0.0; n * n];
        let arm = [1.0; ARM].into_iter().filter(|_| self.arm.is_some());
        body.into_iter().chain(arm).enumerate().for_each(|(i, variance)| initial[i * n + i] = variance);
        for (u, arrivals) in self.each_arrivals() {
            let stationary = arrivals.stationary();
            (0..2).for_each(|i| (0..2).for_each(|j| initial[(u + i) * n + u + j] = stationary[i][j]));
        }
        (self.first_thruster()..self.first_thruster() + self.thrust.states()).for_each(|i| initial[i * n + i] = 1.0);
        initial
    }

    /// What the errors of the arm's path give to its angular momentum and to its centre of mass at a block.
    fn arm_sd(&self, h: &Hyper, block: usize) -> [f64; 2] {
        let of = self.arm.as_ref().and_then(|(_, sds)| sds.get(block));
        of.map_or([0.0; 2], |sds| sds.map(|sd| h.arm * sd))
    }

    /// From a block to the next.
    fn step(&self, h: &Hyper, block: usize, step: &mut Assembled) {
        let (from, to) = (&self.moments[block], &self.moments[block + 1]);
        let dt = to.0 - from.0;
        let mean = |a: f64, b: f64| 0.5 * (a + b);
        let (cx, cy) = (mean(from.1[0], to.1[0]), mean(from.1[1], to.1[1]));
        let (mass, inertia) = (self.mass_kg, mean(from.2, to.2));
        step.clear();
        let transition = &mut step.step.transition;
        transition.extend((0..FORCES).map(|i| (i, i, 1.0)));
        transition.extend([(0, 1, dt), (2, 3, dt), (4, 5, dt / inertia)]);
        let singer = SingerStep::new(dt, h.correlation);
        // Force along x and y at the base's origin, torque; then the errors of each thruster, of unit variance.
        let (force, torque) = (h.force.powi(2), h.torque.powi(2));
        let ways = [([1.0, 0.0, cy], force), ([0.0, 1.0, -cx], force), ([0.0, 0.0, 1.0], torque)];
        for (i, (wrench, variance)) in ways.into_iter().enumerate() {
            step.add_force((FORCES + i, wrench, variance), &singer, (mass, inertia));
        }
        let singer = SingerStep::new(dt, h.thrust_correlation);
        for (i, wrench) in self.thrust.wrenches(block, h.thrust).enumerate() {
            step.add_force((self.first_thruster() + i, wrench, 1.0), &singer, (mass, inertia));
        }
        let impulses =
            [([1.0, 0.0, cy], h.white_force), ([0.0, 1.0, -cx], h.white_force), ([0.0, 0.0, 1.0], h.white_torque)];
        for ([fx, fy, torque], density) in impulses {
            // An impulse anywhere in the step: half of the step on average goes by after it.
            let half = 0.5 * dt;
            let onto = [half * fx / mass, fx / mass, half * fy / mass, fy / mass, half * torque / inertia, torque];
            let variance = density * density * dt;
            for (row, by) in step.body.iter_mut().zip(onto) {
                row.iter_mut().zip(onto).for_each(|(q, with)| *q += variance * by * with);
            }
        }
        self.add_arm(h, block, dt, inertia, step);
        self.add_arrivals(dt, step);
        if self.gyro_walk > 0.0 {
            let bias = self.states() - 1;
            step.step.transition.push((bias, bias, 1.0));
            step.step.noise.push((bias, bias, self.gyro_walk * dt));
        }
    }

    /// Errors of the arm's path, of unit variance: of its momentum, which turns the base the other way, and of its place.
    fn add_arm(&self, h: &Hyper, block: usize, dt: f64, inertia: f64, step: &mut Assembled) {
        let Some((correlation_s, _)) = self.arm else { return };
        let momentum = 0.5 * (self.arm_sd(h, block)[0] + self.arm_sd(h, block + 1)[0]);
        let singer = SingerStep::new(dt, correlation_s);
        step.step.transition.push((4, ARM_MOMENTUM, -singer.velocity * momentum / inertia));
        step.step.transition.extend((ARM_MOMENTUM..BODY + ARM).map(|state| (state, state, singer.decay)));
        let onto = [(4, [0.0, -momentum / inertia, 0.0]), (ARM_MOMENTUM, [0.0, 0.0, 1.0])];
        step.add_noise(&onto, &singer.noise, 1.0);
        step.step.noise.extend((ARM_SHIFT..BODY + ARM).map(|state| (state, state, singer.noise[2][2])));
    }

    fn add_arrivals(&self, dt: f64, Assembled { step, .. }: &mut Assembled) {
        for (u, arrivals) in self.each_arrivals() {
            let (transition, noise) = arrivals.step(dt);
            for (i, j) in (0..ARRIVAL).flat_map(|i| (0..ARRIVAL).map(move |j| (i, j))) {
                step.noise.push((u + i, u + j, noise[i][j]));
                if transition[i][j] != 0.0 {
                    step.transition.push((u + i, u + j, transition[i][j]));
                }
            }
        }
    }
}

/// Correlation time of the errors of the arm's path, half of telemetry's median interval, and what they do at each block: the
/// smoother's standard deviations, carried through the angular momentum of each joint's rate and the shift by each angle.
fn arm_errors(
    physics: &Physics,
    run: &Run,
    predictor: &Predictor,
    times: &[f64],
) -> Result<(f64, Vec<[f64; 2]>), ModelError> {
    let mut gaps: Vec<f64> =
        run.joints.as_ref().map_or_else(Vec::new, |j| j.t_s.windows(2).map(|w| w[1] - w[0]).collect());
    gaps.sort_by(f64::total_cmp);
    let interval_s = gaps.get(gaps.len() / 2).copied().unwrap_or(SLOW_TELEMETRY_S).max(1e-3);
    let (model, carriage) = (physics.model(0.0)?, predictor.carriage(physics)?);
    let path = &predictor.encoders;
    let at = |t_s: &f64| {
        let (k, _) = path.grid.locate(*t_s);
        let (mut momentum, mut shift) = (0.0, 0.0);
        for joint in 0..physics.links.len().min(MAX_LINKS) {
            let mut unit = JointVector::zeros();
            unit[joint] = 1.0;
            let q = joints_only(&carriage.samples[k].q_rad);
            let moving = model.momentum(&State { q, v: joints_only(&unit) });
            momentum += (moving.angular_about_com * path.rate_sd[k][joint]).powi(2);
            shift += (moving.linear.norm() / carriage.mass_kg * path.angle_sd[k][joint]).powi(2);
        }
        [momentum.sqrt(), shift.sqrt()]
    };
    Ok((0.5 * interval_s, times.iter().map(at).collect()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::base::BaseBlock;
    use crate::block::Block;
    use crate::servo_response::ARRIVAL_SD_S;
    use fss_experiments::commands::Commands;
    use fss_experiments::measured::{Joints, Poses, Run};
    use fss_plant::{Effect, JointCommand, Plant};

    /// A joint that swings, its datagrams `late_s` later than they are taken to arrive; no sensor is noisy.
    fn flight(plant: &Plant, late_s: f64) -> Run {
        let told = |k: i32| {
            let (t_s, w) = (0.04 * f64::from(k), 3.0);
            let (q_rad, qd_rad_s) = (0.1 * (1.0 - (w * t_s).cos()), 0.1 * w * (w * t_s).sin());
            (t_s, JointCommand::Position { q_rad, qd_rad_s })
        };
        let rests = vec![(0.0, JointCommand::Position { q_rad: 0.0, qd_rad_s: 0.0 })];
        let mut joints = vec![rests; plant.link_count()];
        joints[0] = (0..150).map(told).collect();
        let commands = Commands { q_rad: vec![0.0; joints.len()], joints, end_s: 6.0, ..Commands::default() };
        let mut late = commands.clone();
        late.joints[0].iter_mut().for_each(|(t_s, _)| *t_s += late_s);
        let (mut pose, mut telemetry) = (Poses::default(), Joints::default());
        telemetry.q_rad = vec![Vec::new(); plant.link_count()];
        telemetry.qd_rad_s = telemetry.q_rad.clone();
        let still = Plant { disturbance: None, ..plant.clone() };
        late.play(&still, 0, 20, |simulation| {
            pose.t_s.push(simulation.t_s());
            pose.values.push(simulation.truth().base_pose);
            telemetry.t_s.push(simulation.t_s());
            for joint in 0..plant.link_count() {
                telemetry.q_rad[joint].push(simulation.encoder_rad(joint));
                telemetry.qd_rad_s[joint].push(simulation.encoder_rate_rad_s(joint));
            }
        })
        .unwrap();
        Run { base_pose: Some(pose), joints: Some(telemetry), commands: Some(commands), ..Run::default() }
    }

    /// Sum of squares about the likeliest line: a run begins with a speed that nobody knows.
    fn squares_about_a_line(values: impl Iterator<Item = f64>) -> f64 {
        let values: Vec<f64> = values.collect();
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let from_middle = |k: usize| k as f64 - 0.5 * (count - 1.0);
        let slope = values.iter().enumerate().map(|(k, v)| from_middle(k) * v).sum::<f64>()
            / (0..values.len()).map(|k| from_middle(k).powi(2)).sum::<f64>();
        values.iter().enumerate().map(|(k, v)| (v - mean - slope * from_middle(k)).powi(2)).sum()
    }

    #[test]
    fn a_late_datagram_moves_the_base_along_its_own_motion_and_only_the_joint_that_swings_does() {
        let plant = Plant::default_laboratory().unwrap();
        let [on_time, late] = [0.0, ARRIVAL_SD_S].map(|late_s| flight(&plant, late_s));
        let late = Run { base_pose: late.base_pose, ..on_time.clone() };
        let blocks = [on_time, late].map(|run| BaseBlock::new(&plant, &run).unwrap().unwrap());
        let arrivals = &blocks[0].nominal.noise.arrivals;
        assert_eq!(arrivals.len(), 1);
        let errors = blocks.each_ref().map(|block| {
            let predicted = block.predict(&plant, &[]).unwrap();
            block.measured().iter().zip(predicted).map(|(y, p)| y - p).collect::<Vec<_>>()
        });
        for axis in 0..3 {
            // What begins later is behind.
            let behind = |k: usize| errors[0][3 * k + axis] - errors[1][3 * k + axis];
            let moved = &arrivals[0].moved;
            let all = squares_about_a_line((50..moved.len()).map(behind));
            let rest = squares_about_a_line((50..moved.len()).map(|k| behind(k) - moved[k][axis]));
            assert!(all > 0.0 && rest < 0.1 * all, "axis {axis}: {rest} of {all}");
        }
    }

    #[test]
    fn datagrams_that_are_all_late_are_so_by_the_clock_of_the_commands() {
        let plant = Plant::default_laboratory().unwrap();
        let [on_time, mut late] = [0.0, 0.012].map(|late_s| flight(&plant, late_s));
        late.commands = on_time.commands;
        // Telemetry as slow as a radio's: what it does not show, the datagrams tell.
        let seldom = |all: &mut Vec<f64>| *all = all.iter().step_by(10).copied().collect();
        let telemetry = late.joints.as_mut().unwrap();
        seldom(&mut telemetry.t_s);
        telemetry.q_rad.iter_mut().chain(&mut telemetry.qd_rad_s).for_each(seldom);
        let block = BaseBlock::new(&plant, &late).unwrap().unwrap();
        let stamped = |early_s: f64| Effect::new("clock_offset").unwrap().on("joint_command").with(&[early_s]);
        let left = |effects: &[Effect]| {
            let predicted = block.predict(&plant, effects).unwrap();
            let error = |k: usize| block.measured()[3 * k + 2] - predicted[3 * k + 2];
            squares_about_a_line((5..block.measured().len() / 3 - 5).map(error))
        };
        let [as_taken, as_sent, too_late] = [left(&[]), left(&[stamped(-0.012)]), left(&[stamped(-0.024)])];
        assert!(as_sent < 0.1 * as_taken && as_sent < 0.5 * too_late, "{as_sent} of {as_taken} and {too_late}");
    }
}
