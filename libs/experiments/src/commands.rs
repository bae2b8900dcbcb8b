//! Commands of a flight, played again on a simulation.

use crate::series::Many;
use fss_multibody::ModelError;
use fss_plant::{Effect, JointCommand, Plant, Servo, Simulation};

/// A link goes on at a command's rate for this long, s.
const MOVE_ON_S: f64 = 0.4;
/// How often commands are looked at, and drivers look at their joints, s.
const STEP_S: f64 = 1e-3;
/// Between the rows of the joints' motion, in such steps.
const ROW_STEPS: usize = 10;
/// The same where links swing on their drives, which is simulated often.
const SWING_STEP_S: f64 = 2e-3;
const SWING_ROW_STEPS: usize = 3;
/// A driver that undoes more than this share of its motor's error of rate within a step is looked at every `STEP_S`.
const HASTY: f64 = 1.5;

/// How motors, and links on elastic drives, carry out commands.
#[derive(Clone, Debug, Default)]
pub struct CarriedOut {
    /// Motor angles, rad.
    pub motor: Many,
    /// Link angles, rad.
    pub link: Many,
    /// Their rates, rad/s.
    pub link_rate: Many,
}

impl CarriedOut {
    /// The sum of several, each times its weight, at the times of the first.
    pub fn mixed(parts: &[(f64, &Self)]) -> Self {
        let mix = |series: fn(&Self) -> &Many| {
            let t_s = parts.first().map_or_else(Vec::new, |(_, part)| series(part).t_s.clone());
            let joints = parts.first().map_or(0, |(_, part)| series(part).values.len());
            let value = |i: usize, k: usize| parts.iter().map(|(w, part)| w * series(part).values[i][k]).sum();
            Many { values: (0..joints).map(|i| (0..t_s.len()).map(|k| value(i, k)).collect()).collect(), t_s }
        };
        Self { motor: mix(|p| &p.motor), link: mix(|p| &p.link), link_rate: mix(|p| &p.link_rate) }
    }
}

/// What was commanded in a flight, and from where it began.
#[derive(Clone, Debug, Default)]
pub struct Commands {
    /// Base at the start, table frame: m, m, rad.
    pub pose: [f64; 3],
    /// Encoder angles at the start, rad.
    pub q_rad: Vec<f64>,
    /// When commands reached each link, s, and what they said.
    pub joints: Vec<Vec<(f64, JointCommand)>>,
    /// When valves were commanded anew, s.
    pub valves: Vec<(f64, Vec<bool>)>,
    /// When the flight ended, s.
    pub end_s: f64,
    /// Effects that a plant which carries them out has beside its own: masses that were found.
    pub beside: Vec<Effect>,
}

impl Commands {
    /// What a joint's driver has been told at `t_s`, and how it understands it by then; `None` before the first command.
    pub fn told(&self, joint: usize, t_s: f64) -> Option<JointCommand> {
        let commands = &self.joints[joint];
        let last = commands.partition_point(|(since_s, _)| *since_s <= t_s).checked_sub(1)?;
        let (since_s, command) = commands[last];
        Some(moved_on(command, t_s - since_s))
    }

    /// Plays the commands on a plant; `see` is called every `every` steps of a millisecond.
    ///
    /// # Errors
    /// When effects make a mass or an inertia impossible.
    pub fn play(&self, plant: &Plant, seed: u64, every: usize, see: impl FnMut(&Simulation)) -> Result<(), ModelError> {
        self.play_in_steps(STEP_S, plant, seed, every, see)
    }

    fn play_in_steps(
        &self,
        step_s: f64,
        plant: &Plant,
        seed: u64,
        every: usize,
        mut see: impl FnMut(&Simulation),
    ) -> Result<(), ModelError> {
        let is_known = |e: &&Effect| plant.effects.iter().any(|own| own.id() == e.id() && own.index() == e.index());
        let news: Vec<Effect> = self.beside.iter().filter(|e| !is_known(e)).cloned().collect();
        let mut simulation = Simulation::new(&plant.with_effects(&news), seed)?.in_steps_of(step_s);
        simulation.set_state(self.pose, [0.0; 3], &self.q_rad, &[]);
        let mut opened = 0;
        for step in 0..=(self.end_s / step_s) as usize {
            if step % every.max(1) == 0 {
                see(&simulation);
            }
            let now_s = simulation.t_s();
            for i in 0..self.joints.len() {
                if let Some(command) = self.told(i, now_s) {
                    simulation.set_joint(i, command);
                }
            }
            while let Some((_, open)) = self.valves.get(opened).filter(|row| row.0 <= now_s) {
                simulation.set_valves(open);
                opened += 1;
            }
            simulation.step(step_s);
        }
        Ok(())
    }

    /// The encoder angles that the plant's own drivers would make of the commands.
    ///
    /// # Errors
    /// When effects make a mass or an inertia impossible.
    pub fn carried_out(&self, plant: &Plant) -> Result<Many, ModelError> {
        let mut out = Many { t_s: Vec::new(), values: vec![Vec::new(); self.joints.len()] };
        let still = Plant { disturbance: None, ..plant.clone() };
        self.play(&still, 0, ROW_STEPS, |simulation| {
            out.t_s.push(simulation.t_s());
            for (i, values) in out.values.iter_mut().enumerate() {
                values.push(simulation.encoder_rad(i));
            }
        })?;
        Ok(out)
    }

    /// What the plant's own drivers make of the commands where drives are elastic and links swing on them.
    ///
    /// # Errors
    /// When effects make a mass or an inertia impossible.
    pub fn swung(&self, plant: &Plant) -> Result<CarriedOut, ModelError> {
        let empty = || Many { t_s: Vec::new(), values: vec![Vec::new(); self.joints.len()] };
        let mut out = CarriedOut { motor: empty(), link: empty(), link_rate: empty() };
        let is_hasty = |servo: &Servo| servo.velocity_gain_n_m_s_rad * SWING_STEP_S > HASTY * servo.rotor_inertia_kg_m2;
        let any_is_hasty = (0..plant.link_count()).any(|joint| is_hasty(plant.servo(joint)));
        let step_s = if any_is_hasty { STEP_S } else { SWING_STEP_S };
        let still = Plant { disturbance: None, ..plant.clone() };
        self.play_in_steps(step_s, &still, 0, SWING_ROW_STEPS, |simulation| {
            let CarriedOut { motor, link, link_rate } = &mut out;
            for many in [&mut *motor, link, link_rate] {
                many.t_s.push(simulation.t_s());
            }
            for i in 0..self.joints.len() {
                let (q_rad, qd_rad_s) = simulation.joint(i);
                motor.values[i].push(simulation.motor(i).0);
                link.values[i].push(q_rad);
                link_rate.values[i].push(qd_rad_s);
            }
        })?;
        Ok(out)
    }
}

/// A command as its driver understands it some time later.
fn moved_on(command: JointCommand, age_s: f64) -> JointCommand {
    match command {
        JointCommand::Position { q_rad, qd_rad_s } => JointCommand::Position {
            q_rad: q_rad + qd_rad_s * age_s.min(MOVE_ON_S),
            qd_rad_s: if age_s < MOVE_ON_S { qd_rad_s } else { 0.0 },
        },
        other => other,
    }
}
