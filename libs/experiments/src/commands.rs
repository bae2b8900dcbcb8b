//! Commands of a flight, played again on a simulation.

use crate::series::Many;
use fss_multibody::ModelError;
use fss_plant::{JointCommand, Plant, Simulation};

/// A link goes on at a command's rate for this long, s.
const MOVE_ON_S: f64 = 0.4;
/// How often commands are looked at, and drivers look at their joints, s.
const STEP_S: f64 = 1e-3;
/// Between the rows of the joints' motion, in such steps.
const ROW_STEPS: usize = 10;

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
    pub fn play(
        &self,
        plant: &Plant,
        seed: u64,
        every: usize,
        mut see: impl FnMut(&Simulation),
    ) -> Result<(), ModelError> {
        let mut simulation = Simulation::new(plant, seed)?;
        simulation.set_state(self.pose, [0.0; 3], &self.q_rad, &[]);
        let mut opened = 0;
        for step in 0..=(self.end_s / STEP_S) as usize {
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
            simulation.step(STEP_S);
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
