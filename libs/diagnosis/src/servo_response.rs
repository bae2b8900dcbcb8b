//! What servos make of the datagrams that command them.
//!
//! Between two datagrams a servo settles within some hundredths of a second, which telemetry does not show, but a floating base does. So
//! the motion is taken from a simulation of the servos, that with other gains or on other drives from another; [`swing`] tells what links
//! do on elastic drives. A joint that dry friction holds or turns back answers to gains by no derivative: differences are simulated.

mod swing;

use crate::path::TimeGrid;
use fss_estimation::statistics::median;
use fss_experiments::commands::Commands;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Physics, Place, Plant, Servo, Simulation, Stream};
use std::sync::{Arc, Mutex, PoisonError};

pub(crate) use swing::{Elasticity, Swing, elasticity};

/// Standard deviation of the time that a datagram takes to its link, s: anything from 2 to 8 ms over a radio.
pub(crate) const ARRIVAL_SD_S: f64 = 1.7e-3;

/// Angle, rad, rate and acceleration at each node of a path.
pub(crate) type Nodes = Vec<[f64; 3]>;

/// What a joint is driven by: its driver and its gear.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Drive {
    servo: Servo,
    pub(crate) elasticity: Elasticity,
}

/// The drive of each joint.
pub(crate) fn drives(physics: &Physics) -> Vec<Drive> {
    let pairs = physics.servos.iter().zip(elasticity(physics));
    pairs.map(|(servo, elasticity)| Drive { servo: servo.clone(), elasticity }).collect()
}

/// The joints' motion in answer to datagrams.
#[derive(Clone, Debug)]
pub(crate) struct Response {
    /// What each joint's encoder shows.
    pub(crate) nominal: Vec<Nodes>,
    /// What each link does on its elastic drive; `None` where all are rigid.
    pub(crate) swings: Option<Vec<Swing>>,
}

impl Response {
    /// The same where datagrams arrive later; its nodes are those of a grid. Swings stay where they are: milliseconds are little of one.
    pub(crate) fn later(&self, by_s: f64, grid: TimeGrid) -> Self {
        if by_s == 0.0 {
            return self.clone();
        }
        let joint = |own: &Nodes| -> Nodes {
            let at = |k: usize| grid.between(own, grid.edge_s(k) - by_s);
            (0..own.len()).map(|k| [at(k)[0], at(k)[1], own[k][2]]).collect()
        };
        Self { nominal: self.nominal.iter().map(joint).collect(), swings: self.swings.clone() }
    }

    /// The joints' motion beside another.
    pub(crate) fn beside(&self, other: &Self) -> Vec<Nodes> {
        let node = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|i| a[i] - b[i]);
        let joint = |(own, other): (&Nodes, &Nodes)| own.iter().zip(other).map(node).collect();
        self.nominal.iter().zip(&other.nominal).map(joint).collect()
    }
}

/// A joint's state at one time of a simulation.
#[derive(Clone, Copy, Debug, Default)]
struct Instant {
    /// Angle, rad, and rate, rad/s, that its encoder shows.
    encoder: [f64; 2],
    /// The same of its link ahead of its motor.
    ahead: [f64; 2],
}

/// A simulation of the joints: times, s, and each joint's states.
#[derive(Debug)]
struct Simulated {
    t_s: Vec<f64>,
    joints: Vec<Vec<Instant>>,
}

impl Simulated {
    fn new(plant: &Plant, commands: &Commands) -> Result<Self, ModelError> {
        let still = Plant { disturbance: None, ..plant.clone() };
        let mut out = Self { t_s: Vec::new(), joints: vec![Vec::new(); plant.link_count()] };
        commands.play(&still, 0, 1, |simulation| {
            out.t_s.push(simulation.t_s());
            out.joints.iter_mut().enumerate().for_each(|(i, own)| own.push(instant(simulation, i)));
        })?;
        Ok(out)
    }
}

/// How plants' servos answer the datagrams of one run: the first plant that was asked for and the last one are kept.
#[derive(Debug, Default)]
pub(crate) struct Answers(Mutex<Vec<(Plant, Arc<Simulated>)>>);

impl Answers {
    /// The answer of a plant's servos at the times `grid_s`, s.
    ///
    /// # Errors
    /// When the plant's masses are impossible.
    pub(crate) fn response(&self, plant: &Plant, commands: &Commands, grid_s: &[f64]) -> Result<Response, ModelError> {
        let simulated = self.simulated(plant, commands)?;
        Ok(response(plant, &simulated, grid_s))
    }

    /// One at a time: who else asks most often wants the same.
    fn simulated(&self, plant: &Plant, commands: &Commands) -> Result<Arc<Simulated>, ModelError> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, known)) = kept.iter().find(|(of, _)| of == plant) {
            return Ok(known.clone());
        }
        let simulated = Arc::new(Simulated::new(plant, commands)?);
        kept.truncate(1);
        kept.push((plant.clone(), simulated.clone()));
        Ok(simulated)
    }
}

/// What a simulation shows at the times `grid_s`, s.
fn response(plant: &Plant, simulated: &Simulated, grid_s: &[f64]) -> Response {
    let (times, states) = (&simulated.t_s, &simulated.joints);
    let nodes = |of: &dyn Fn(&Instant) -> [f64; 2]| -> Vec<Nodes> {
        let joint = |own: &Vec<Instant>| {
            let states: Vec<[f64; 2]> = own.iter().map(of).collect();
            grid_s.iter().map(|t| node(times, &states, *t)).collect()
        };
        states.iter().map(joint).collect()
    };
    let drives = elasticity(&Physics::with(plant, &plant.effects));
    let step_s = grid_s.get(1).zip(grid_s.first()).map_or(1.0, |(b, a)| b - a);
    let swings = |ahead: Vec<Nodes>| {
        let drives = ahead.into_iter().zip(&drives);
        drives.map(|(ahead, drive)| Swing::new(ahead, drive, step_s)).collect()
    };
    let is_elastic = drives.iter().any(Elasticity::is_elastic);
    Response { nominal: nodes(&|state| state.encoder), swings: is_elastic.then(|| swings(nodes(&|state| state.ahead))) }
}

fn instant(simulation: &Simulation, joint: usize) -> Instant {
    let (q, qd) = (simulation.encoder_rad(joint), simulation.encoder_rate_rad_s(joint));
    let (link, motor) = (simulation.joint(joint), simulation.motor(joint));
    let own = &simulation.physics().joints[joint];
    let ahead = [own.motor_angle(link.0) - motor.0, own.gear_ratio(link.0) * link.1 - motor.1];
    Instant { encoder: [q, qd], ahead }
}

/// The servo of one joint, apart from what others share.
pub(crate) fn own_servo(plant: &mut Plant, joint: usize) -> &mut Servo {
    let shared = plant.servo.clone();
    plant.links[joint].servo.get_or_insert(shared)
}

/// What datagrams told each joint, and when they arrived; `None` where the run has none, or none that change anything.
pub(crate) fn datagrams<'a>(plant: &Plant, run: &'a Run) -> Option<&'a Commands> {
    run.commands.as_ref().filter(|c| c.joints.len() == plant.link_count() && c.joints.iter().any(|j| j.len() > 1))
}

/// Correlation time of how late datagrams arrive, s: half of the interval at which another one comes.
pub(crate) fn arrival_time(commands: &Commands) -> f64 {
    let most = commands.joints.iter().max_by_key(|joint| joint.len());
    let mut intervals: Vec<f64> = most.map_or(&[][..], |joint| joint).windows(2).map(|w| w[1].0 - w[0].0).collect();
    0.5 * median(&mut intervals).unwrap_or(1.0)
}

/// What among effects changes what servos make of their datagrams.
pub(crate) fn moving(effects: &[Effect]) -> Vec<Effect> {
    effects.iter().filter(|e| matches!(e.about().place, Place::Mass | Place::Joint)).cloned().collect()
}

/// Whether the servos of a plant with these effects answer as those of another plant with its own.
pub(crate) fn answer_alike(plant: &Plant, effects: &[Effect], other: &Plant) -> bool {
    with_exactly(plant, &other.effects) == *other && moving(effects) == moving(&other.effects)
}

/// How much later datagrams reach their links than they are taken to, s.
pub(crate) fn lateness_s(physics: &Physics) -> f64 {
    -physics.sensors.age_s(Stream::JointCommand)
}

/// How much older each link's telemetry is than its stamps say, s.
pub(crate) fn link_ages_s(physics: &Physics) -> Vec<f64> {
    (0..physics.links.len()).map(|i| physics.sensors.link_age_s(i)).collect()
}

/// A plant with exactly these effects.
pub(crate) fn with_exactly(plant: &Plant, effects: &[Effect]) -> Plant {
    Plant { effects: effects.to_vec(), ..plant.clone() }
}

/// Angle, rate and acceleration at `t_s`, of a motion with constant acceleration between its samples.
fn node(t_s: &[f64], states: &[[f64; 2]], at_s: f64) -> [f64; 3] {
    let after = t_s.partition_point(|t| *t <= at_s);
    if after == 0 || after == t_s.len() {
        let end = if after == 0 { 0 } else { after - 1 };
        let [q, qd] = states.get(end).copied().unwrap_or_default();
        return [q + qd * (at_s - t_s.get(end).copied().unwrap_or(at_s)), qd, 0.0];
    }
    let (a, b) = (states[after - 1], states[after]);
    let (step_s, past_s) = (t_s[after] - t_s[after - 1], at_s - t_s[after - 1]);
    let acceleration = (b[1] - a[1]) / step_s;
    [a[0] + past_s * (b[0] - a[0]) / step_s, a[1] + past_s * acceleration, acceleration]
}
