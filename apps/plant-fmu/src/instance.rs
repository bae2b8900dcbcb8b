//! One simulation with the variables of its FMU.

use crate::variables::{Causality, Meaning, Variable, variables};
use fss_plant::{JointCommand, Plant, Simulation};
use std::path::Path;

/// The laboratory steps by this much, s.
const STEP_S: f64 = 1e-3;

/// A running FMU.
pub struct Instance {
    plant: Plant,
    variables: Vec<Variable>,
    /// Values of parameters and inputs, by value reference.
    values: Vec<f64>,
    simulation: Simulation,
}

impl Instance {
    /// The plant of the FMU whose resources lie in this folder.
    ///
    /// # Errors
    /// Where there is no sound plant file.
    pub fn open(resources: &Path) -> Result<Self, String> {
        let path = resources.join("plant.toml");
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let plant = Plant::parse(&text).map_err(|e| format!("{}: {e}", path.display()))?;
        let simulation = Simulation::new(&plant, 1).map_err(|e| e.to_string())?;
        let variables = variables(&plant);
        let values = variables.iter().map(|variable| variable.start).collect();
        let mut instance = Self { plant, variables, values, simulation };
        instance.begin();
        Ok(instance)
    }

    /// Back to before the start.
    pub fn reset(&mut self) {
        self.values = self.variables.iter().map(|variable| variable.start).collect();
        self.begin();
    }

    /// Starts with the parameters as they are.
    pub fn begin(&mut self) {
        // What was made once for this plant can be made again.
        if let Ok(simulation) = Simulation::new(&self.plant, self.parameter(Meaning::Seed) as u64) {
            self.simulation = simulation;
        }
        let base: [f64; 6] = std::array::from_fn(|i| self.parameter(Meaning::StartBase(i)));
        let joints: Vec<f64> = (0..self.plant.link_count()).map(|i| self.parameter(Meaning::StartJoint(i))).collect();
        let still = vec![0.0; joints.len()];
        let [x, y, theta, vx, vy, omega] = base;
        self.simulation.set_state([x, y, theta], [vx, vy, omega], &joints, &still);
    }

    /// The value of what is set, by its meaning.
    fn parameter(&self, meaning: Meaning) -> f64 {
        let place = self.variables.iter().position(|variable| variable.meaning == meaning);
        place.and_then(|place| self.values.get(place)).copied().unwrap_or(0.0)
    }

    /// Sets a parameter or an input; false where the reference is none of them or the value no number.
    pub fn set(&mut self, reference: u32, value: f64) -> bool {
        let is_set = |variable: &Variable| matches!(variable.causality, Causality::Parameter | Causality::Input);
        let is_known = self.variables.get(reference as usize).is_some_and(is_set);
        match self.values.get_mut(reference as usize) {
            Some(own) if is_known && value.is_finite() => {
                *own = value;
                true
            }
            _ => false,
        }
    }

    /// The value of a variable.
    pub fn get(&self, reference: u32) -> Option<f64> {
        let variable = self.variables.get(reference as usize)?;
        if matches!(variable.causality, Causality::Parameter | Causality::Input) {
            return self.values.get(reference as usize).copied();
        }
        let truth = self.simulation.truth();
        let of_body = |pose: [f64; 3], velocity: [f64; 3], i: usize| if i < 3 { pose[i] } else { velocity[i - 3] };
        Some(match variable.meaning {
            Meaning::Base(i) => of_body(truth.base_pose, truth.base_velocity, i),
            Meaning::EndEffector(i) => of_body(truth.ee_pose, truth.ee_velocity, i),
            Meaning::Target(i) => of_body(truth.target_pose, truth.target_velocity, i),
            Meaning::Encoder(i) => self.simulation.encoder_rad(i),
            Meaning::JointRate(i) => truth.qd_rad_s[i],
            Meaning::MotorCurrent(i) => truth.current_a[i],
            Meaning::Torque(i) => truth.torque_n_m[i],
            Meaning::Gas => self.simulation.gas_used_kg(),
            Meaning::Time => self.simulation.t_s(),
            _ => 0.0,
        })
    }

    /// Lets `h_s` pass with the inputs as they are, in the laboratory's steps; false where that is no time.
    pub fn step(&mut self, h_s: f64) -> bool {
        if !(h_s.is_finite() && h_s > 0.0) {
            return false;
        }
        self.command();
        let whole = (h_s / STEP_S + 1e-6).floor();
        for _ in 0..whole as u64 {
            self.simulation.step(STEP_S);
        }
        let rest_s = h_s - whole * STEP_S;
        if rest_s > 1e-9 {
            self.simulation.step(rest_s);
        }
        true
    }

    fn command(&mut self) {
        let now_s = self.simulation.t_s();
        for (variable, value) in self.variables.iter().zip(&self.values) {
            match variable.meaning {
                Meaning::Valve(line) => self.simulation.set_level(line, value.clamp(0.0, 1.0), now_s),
                Meaning::Mode(joint) => {
                    // Current, rate and angle of a joint stand behind its mode.
                    let of = |meaning| self.parameter(meaning);
                    let command = match value.round() as i64 {
                        1 => JointCommand::Current { current_a: of(Meaning::Current(joint)) },
                        2 => JointCommand::Velocity { qd_rad_s: of(Meaning::Rate(joint)) },
                        3 => JointCommand::Position {
                            q_rad: of(Meaning::Angle(joint)),
                            qd_rad_s: of(Meaning::Rate(joint)),
                        },
                        _ => JointCommand::Free,
                    };
                    self.simulation.set_joint(joint, command);
                }
                _ => {}
            }
        }
    }
}
