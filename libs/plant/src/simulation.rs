//! The laboratory in motion: commands in, time forward, truth out.

use fss_multibody::{Model, ModelError, State};

use crate::check::MAX_LINKS;
use crate::dynamics::{Dynamics, Load, Motion};
use crate::file::Plant;
use crate::physics::{Grasped, Physics};
use crate::power::{Air, Charge};
use crate::room::Room;
use crate::servo::{Driver, Joint, JointCommand};
use crate::target::Target;
use crate::thrust;
use crate::truth::{History, Moment, Truth};
use crate::valves::Valve;

mod commands;

/// Longest step of the integration, which is also the period of the servo drivers (s).
pub const INTERNAL_STEP_S: f64 = 1e-3;

/// A plant's motion from the start of a run.
///
/// Deterministic: the same plant, seed and calls give the same truth to the last bit. It knows no
/// clock and allocates nothing while it steps. Sensors are apart, in [`crate::Instruments`].
#[derive(Debug, Clone)]
pub struct Simulation {
    /// The plant at each stage of the run, with the time from which it holds: effects begin.
    stages: Vec<(f64, Dynamics)>,
    stage: usize,
    pub(crate) motion: Motion,
    pub(crate) target: Option<Target>,
    t_s: f64,
    steps: u64,
    valves: Vec<Valve>,
    air: Air,
    base_charge: Charge,
    link_charge: Vec<Charge>,
    drivers: [Driver; MAX_LINKS],
    commands: [JointCommand; MAX_LINKS],
    torque_limit_n_m: [f64; MAX_LINKS],
    current_a: [f64; MAX_LINKS],
    room: Option<Room>,
    last_load: Load,
    history: History,
    /// Whether any sensor shows what was rather than what is, so that every step must be remembered.
    looks_back: bool,
}

impl Simulation {
    /// The plant at rest at the table's middle with all joints at zero, valves shut, drivers off.
    ///
    /// # Errors
    /// When effects make a mass or an inertia impossible; a plant that was read from a file has none such.
    pub fn new(plant: &Plant, seed: u64) -> Result<Self, ModelError> {
        let stages = Physics::stages(plant, &plant.effects)
            .into_iter()
            .map(|(t, physics)| Dynamics::new(physics).map(|dynamics| (t, dynamics)))
            .collect::<Result<Vec<_>, _>>()?;
        let slowest = stages.iter().map(|(_, d)| crate::truth::oldest_sample_s(&d.physics)).fold(0.0, f64::max);
        let mut simulation = Self {
            stage: 0,
            motion: Motion::zero(),
            target: plant.target.as_ref().map(Target::new),
            t_s: 0.0,
            steps: 0,
            valves: vec![Valve::new(); plant.thrusters.len()],
            air: Air::new(plant.tank.clone()),
            base_charge: Charge::new(plant.battery.clone()),
            link_charge: plant.links.iter().map(|l| Charge::new(l.battery.clone())).collect(),
            drivers: [Driver::default(); MAX_LINKS],
            commands: [JointCommand::Free; MAX_LINKS],
            torque_limit_n_m: [f64::INFINITY; MAX_LINKS],
            current_a: [0.0; MAX_LINKS],
            room: Room::new(plant, seed),
            last_load: Load::zero(),
            history: History::new(slowest, INTERNAL_STEP_S),
            looks_back: slowest > 0.0,
            stages,
        };
        simulation.set_state([0.0; 3], [0.0; 3], &[], &[]);
        Ok(simulation)
    }

    /// Puts base frame and joints where they should be, as if they had always been there.
    ///
    /// `pose` and `velocity` are of the base frame in the table frame, `q_rad` and `qd_rad_s` of
    /// the joints (geometric angle less `joint_offset_rad`, so without encoder errors); what is
    /// missing of these stays.
    pub fn set_state(&mut self, pose: [f64; 3], velocity: [f64; 3], q_rad: &[f64], qd_rad_s: &[f64]) {
        let joints = self.joint_count();
        for (own, q) in self.motion.state.q.as_mut_slice()[3..3 + joints].iter_mut().zip(q_rad) {
            *own = *q;
        }
        for (own, qd) in self.motion.state.v.as_mut_slice()[3..3 + joints].iter_mut().zip(qd_rad_s) {
            *own = *qd;
        }
        let dynamics = &self.stages[self.stage].1;
        self.motion.state.q.as_mut_slice()[..3].copy_from_slice(&pose);
        self.motion.state.v.as_mut_slice()[..3].copy_from_slice(&velocity);
        dynamics.align_rotors(&mut self.motion);
        self.history.clear();
        self.remember();
    }

    /// Lets `dt_s` pass (s).
    pub fn step(&mut self, dt_s: f64) {
        let end = self.t_s + dt_s;
        while end - self.t_s > 1e-9 {
            self.enter_stage();
            let mut step = INTERNAL_STEP_S.min(end - self.t_s);
            if let Some((onset, _)) = self.stages.get(self.stage + 1)
                && *onset > self.t_s
            {
                step = step.min(onset - self.t_s);
            }
            if end - self.t_s - step < 1e-9 {
                step = end - self.t_s;
            }
            self.internal_step(step);
            if self.looks_back {
                self.remember();
            }
        }
        self.t_s = end;
        if !self.looks_back {
            self.remember();
        }
    }

    fn enter_stage(&mut self) {
        while let Some((onset, next)) = self.stages.get(self.stage + 1)
            && *onset <= self.t_s + 1e-9
        {
            // Coordinates and rates go on as they are; a drive that becomes elastic starts without wind-up.
            if next.longest_step_s() < self.stages[self.stage].1.longest_step_s() {
                next.align_rotors(&mut self.motion);
            }
            let grasped = self.physics().grasped;
            self.stage += 1;
            self.stages[self.stage].1.physics.grasped = grasped;
            self.stages[self.stage].1.set_used_gas(self.air.used_kg());
        }
    }

    fn internal_step(&mut self, dt_s: f64) {
        let load = self.load(dt_s);
        let dynamics = &mut self.stages[self.stage].1;
        if load.thrust != [0.0; 3] {
            dynamics.set_used_gas(self.air.used_kg());
        }
        let pieces = (dt_s / dynamics.longest_step_s()).ceil().clamp(1.0, 1000.0);
        let piece = dt_s / pieces;
        for i in 0..pieces as usize {
            dynamics.advance(&mut self.motion, self.t_s + i as f64 * piece, piece, &load);
        }
        self.t_s += dt_s;
        self.steps += 1;
        self.last_load = load;
        self.move_target(dt_s);
        self.draw_power(dt_s);
    }

    fn remember(&mut self) {
        let moment = self.moment();
        self.history.push(&moment);
    }

    fn moment(&self) -> Moment {
        Moment {
            t_s: self.t_s,
            stage: self.stage,
            motion: self.motion,
            load: self.last_load,
            current_a: self.current_a,
            target: self.target_motion(),
        }
    }

    /// What drives the next `dt_s`.
    fn load(&mut self, dt_s: f64) -> Load {
        let dynamics = &self.stages[self.stage].1;
        let physics = &dynamics.physics;
        let mut load = Load::zero();
        if let Some(room) = &mut self.room {
            room.step(dt_s);
            load.steady.as_mut_slice()[..3].copy_from_slice(room.now());
        }
        let to = self.t_s + dt_s;
        let share = self.air.thrust_share() * physics.supply.trend(self.t_s + 0.5 * dt_s);
        let mut level_sum = 0.0;
        for (valve, thruster) in self.valves.iter_mut().zip(&physics.thrusters) {
            valve.mean = valve.advance(self.t_s, to, thruster);
            level_sum += valve.mean[0];
        }
        let mut impulse = 0.0;
        for (valve, thruster) in self.valves.iter().zip(&physics.thrusters) {
            let force = share * thruster.mean_force_n(valve.mean, level_sum, &physics.supply);
            impulse += force * dt_s;
            thrust::push(&mut load, thruster, force, dynamics, &self.motion);
        }
        self.air.take(impulse);
        for i in 0..physics.joints.len() {
            let joint = &physics.joints[i];
            let (encoder_rad, encoder_rate_rad_s) = self.encoder(i);
            let seen = Joint {
                encoder_rad,
                encoder_rate_rad_s,
                torque_constant_n_m_a: joint.torque_constant_n_m_a,
                max_torque_n_m: joint.max_torque_n_m.min(self.torque_limit_n_m[i]),
            };
            let command = if self.link_charge[i].is_alive() { self.commands[i] } else { JointCommand::Free };
            let current = self.drivers[i].current_a(command, &seen, &physics.servos[i], dt_s);
            self.current_a[i] = current;
            load.motor_n_m[i] = current * joint.torque_constant_n_m_a * joint.torque_scale;
        }
        load
    }

    fn draw_power(&mut self, dt_s: f64) {
        self.base_charge.draw(0.0, dt_s);
        let load = &self.last_load;
        for (i, charge) in self.link_charge.iter_mut().enumerate() {
            // Mechanical power, and what the winding turns to heat: as much as full torque at 1 rad/s.
            let torque = load.motor_n_m[i].abs();
            charge.draw(torque * (self.motion.state.v[3 + i].abs() + 1.0), dt_s);
        }
    }

    /// Time since the start of the run (s).
    pub fn t_s(&self) -> f64 {
        self.t_s
    }

    /// Number of joints.
    pub fn joint_count(&self) -> usize {
        self.physics().joints.len()
    }

    /// What really acts now.
    pub fn physics(&self) -> &Physics {
        &self.stages[self.stage].1.physics
    }

    pub(crate) fn dynamics(&self) -> &Dynamics {
        &self.stages[self.stage].1
    }

    /// The mechanism as it really is now.
    pub fn model(&self) -> &Model {
        &self.dynamics().model
    }

    /// Puts a grasped body on the last link.
    pub(crate) fn carry(&mut self, grasped: Grasped) {
        let used = self.air.used_kg();
        let dynamics = &mut self.stages[self.stage].1;
        dynamics.physics.grasped = Some(grasped);
        dynamics.set_used_gas(used);
    }

    /// Takes it off again.
    pub(crate) fn let_go(&mut self) {
        let used = self.air.used_kg();
        let dynamics = &mut self.stages[self.stage].1;
        dynamics.physics.grasped = None;
        dynamics.set_used_gas(used);
    }

    /// Angle and rate of joint `joint` (from 0) now, without encoder errors (rad, rad/s); zeros where there is no such
    /// joint. What [`Simulation::truth`] says of it, without working out all that it does not ask for.
    pub fn joint(&self, joint: usize) -> (f64, f64) {
        let State { q, v } = &self.motion.state;
        if joint < self.joint_count() { (q[3 + joint], v[3 + joint]) } else { (0.0, 0.0) }
    }

    /// The same of its motor as seen at the joint.
    pub fn motor(&self, joint: usize) -> (f64, f64) {
        if joint < self.joint_count() { self.dynamics().motor(joint, &self.motion) } else { (0.0, 0.0) }
    }

    /// The truth now.
    pub fn truth(&self) -> Truth {
        Truth::of(&self.moment(), self.dynamics())
    }

    /// The truth at an earlier time, linear between what is remembered: every internal step where a sensor shows what
    /// was, else every call of [`Simulation::step`]; the oldest known before that.
    pub fn truth_at(&self, t_s: f64) -> Truth {
        let Some((earlier, later)) = self.history.around(t_s) else {
            return self.truth();
        };
        let first = Truth::of(earlier, &self.stages[earlier.stage].1);
        if later.t_s <= earlier.t_s {
            return first;
        }
        let share = (t_s - earlier.t_s) / (later.t_s - earlier.t_s);
        first.toward(&Truth::of(later, &self.stages[later.stage].1), share)
    }

    /// What the encoder of joint `joint` (from 0) shows its driver now, without noise (rad); 0 where there is no such
    /// joint.
    pub fn encoder_rad(&self, joint: usize) -> f64 {
        self.encoder(joint).0
    }

    /// The rate that a joint's encoder reads, without noise (rad/s).
    pub fn encoder_rate_rad_s(&self, joint: usize) -> f64 {
        self.encoder(joint).1
    }

    /// Encoder angle (rad) and rate (rad/s) without noise.
    fn encoder(&self, joint: usize) -> (f64, f64) {
        let dynamics = self.dynamics();
        let Some(own) = dynamics.physics.joints.get(joint) else {
            return (0.0, 0.0);
        };
        let (angle, rate) = dynamics.motor(joint, &self.motion);
        (own.encoder_reading(angle), own.encoder_scale * rate)
    }

    /// Motor current of joint `joint` (from 0) through the last step (A); 0 where there is no such joint.
    pub fn current_a(&self, joint: usize) -> f64 {
        self.current_a.get(joint).copied().unwrap_or(0.0)
    }

    /// Level of each thruster, the opening of its valve, 0 to 1.
    pub fn openings(&self) -> impl Iterator<Item = f64> + '_ {
        self.valves.iter().map(Valve::level)
    }

    /// Thrust of each thruster now (N).
    pub fn thrusts_n(&self) -> impl Iterator<Item = f64> + '_ {
        let physics = self.physics();
        let share = self.air.thrust_share() * physics.supply.trend(self.t_s);
        let level_sum: f64 = self.openings().sum();
        let thrusters = self.valves.iter().zip(&physics.thrusters);
        thrusters.map(move |(valve, thruster)| share * thruster.force_n(valve.level(), level_sum, &physics.supply))
    }

    /// Gas used since the start (kg).
    pub fn gas_used_kg(&self) -> f64 {
        self.air.used_kg()
    }

    /// Tank pressure (Pa), if the plant has a tank.
    pub fn tank_pressure_pa(&self) -> Option<f64> {
        self.air.pressure_pa()
    }

    /// Voltage of the base's battery (V), if the plant has one.
    pub fn base_battery_v(&self) -> Option<f64> {
        self.base_charge.voltage_v()
    }

    /// Voltage of a link's battery (V), if it has one.
    pub fn link_battery_v(&self, link: usize) -> Option<f64> {
        self.link_charge.get(link).and_then(Charge::voltage_v)
    }

    /// Charge of a link's battery, 0 to 1, if it has one.
    pub fn link_battery_charge(&self, link: usize) -> Option<f64> {
        self.link_charge.get(link).and_then(Charge::charge)
    }

    /// Linear momentum of base and arm, and angular momentum about the table's origin
    /// (kg m/s, kg m/s, kg m^2/s).
    pub fn momentum(&self) -> [f64; 3] {
        let state = &self.motion.state;
        let momentum = self.model().momentum(state);
        let (px, py) = (momentum.linear.x, momentum.linear.y);
        [px, py, momentum.angular_about_base + state.q[0] * py - state.q[1] * px]
    }

    /// Kinetic energy of base and arm (J).
    pub fn kinetic_energy_j(&self) -> f64 {
        self.model().kinetic_energy(&self.motion.state)
    }

    /// Centre of mass of base and arm, table frame (m).
    pub fn centre_of_mass_m(&self) -> [f64; 2] {
        let centre = self.model().center_of_mass(&self.motion.state.q);
        [centre.x, centre.y]
    }
}
