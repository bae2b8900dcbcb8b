//! What a simulation is told: valves, levels of thrusters, joints.

use super::Simulation;
use crate::physics::Stream;
use crate::servo::JointCommand;

impl Simulation {
    /// Commands all valves now, in the order of the plant's thrusters.
    pub fn set_valves(&mut self, open: &[bool]) {
        let now = self.t_s;
        for (line, open) in open.iter().enumerate() {
            self.set_valve(line, *open, now);
        }
    }

    /// Commands valve line `line` (from 0) at `at_s`, which may lie ahead within the next step.
    pub fn set_valve(&mut self, line: usize, open: bool, at_s: f64) {
        self.set_level(line, f64::from(open), at_s);
    }

    /// Commands the level of the thruster on line `line` (from 0), 0 to 1, at `at_s` as in [`Simulation::set_valve`]: 0 shuts
    /// a valve, 1 opens it.
    pub fn set_level(&mut self, line: usize, level: f64, at_s: f64) {
        let physics = &self.stages[self.stage].1.physics;
        let early = physics.sensors.clock_offset_s[Stream::Valves as usize];
        for (thruster, valve) in physics.thrusters.iter().zip(&mut self.valves) {
            if thruster.line == line {
                let acts_at = at_s.max(self.t_s) + (thruster.delay_s - early).max(0.0);
                valve.command(level, acts_at);
            }
        }
    }

    /// Commands the driver of joint `joint` (from 0).
    pub fn set_joint(&mut self, joint: usize, command: JointCommand) {
        if let Some(own) = self.commands.get_mut(joint) {
            *own = command;
        }
    }

    /// Tells the driver of joint `joint` (from 0) to use no more than this torque (N m); the motor's own limit holds
    /// beside it.
    pub fn set_torque_limit(&mut self, joint: usize, max_torque_n_m: f64) {
        if let Some(own) = self.torque_limit_n_m.get_mut(joint) {
            *own = max_torque_n_m.max(0.0);
        }
    }
}
