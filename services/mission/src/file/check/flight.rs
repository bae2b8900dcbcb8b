//! The mission flown on paper, before it is flown: does everything that floats stay on the table, and does the gas last?
//!
//! Without thrust the centre of mass goes on as it began; open valves push a vehicle whose arm is held; a base with a goal is
//! at rest at that goal. That is coarse, and enough to refuse what cannot be meant.

use super::{Checked, For, number};
use crate::error::Fault;
use crate::file::{ArmGoal, BaseGoal, Mission, Phase, Pulse, raw};
use fss_multibody::{Coordinates, Model, State, coordinates};
use fss_plant::Plant;
use std::ops::Range;
use toml::Spanned;

/// Standard gravity, which makes a specific impulse a speed, m/s2.
const G0_M_S2: f64 = 9.806_65;
/// Step in which open valves are followed, s.
const STEP_S: f64 = 0.02;
/// Largest rate of a quintic over its mean.
const PEAK: f64 = 1.875;
/// A lever at which thrusters turn the base, m.
const LEVER_M: f64 = 0.1;

pub(super) fn check(mission: &Mission, raw: &raw::Mission, plant: For) -> Checked<()> {
    let spans = raw.phase.get_ref().iter().chain(&raw.abort);
    let phases = || mission.phases.iter().chain(&mission.aborts);
    for (phase, spanned) in phases().zip(spans) {
        if phase.needs_target() && mission.target.is_none() {
            let help = "add a [target] table with its mass_kg, inertia_kg_m2, radius_m, x_m and y_m";
            return Err(Fault::new(spanned.span(), "there is no target to meet, to capture or to carry", help));
        }
    }
    let closes = |phase: &&Phase| phase.gripper_closed == Some(true);
    let first_closed = mission.phases.iter().position(|phase| closes(&phase)).unwrap_or(usize::MAX);
    for (i, (phase, spanned)) in mission.phases.iter().zip(raw.phase.get_ref()).enumerate() {
        if matches!(phase.base, BaseGoal::Carry { .. }) && i < first_closed {
            let help = "write gripper = \"closed\" in a phase before it, one in which the arm captures the target";
            let span = spanned.get_ref().base.goal.span();
            return Err(Fault::new(span, "nothing can be carried here: the gripper is open", help));
        }
    }
    let Some(plant) = plant else { return Ok(()) };
    let Ok(model) = plant.model() else { return Ok(()) };
    if model.base().clamped {
        return Ok(());
    }
    let mut flight = Flight::begin(mission, plant, &model);
    flight.all_on_table(raw.initial.x_m.as_ref().map_or(raw.name.span(), Spanned::span), "at the start")?;
    for (phase, spanned) in mission.phases.iter().zip(raw.phase.get_ref()) {
        flight.fly(phase, spanned.get_ref())?;
        flight.check_gas(raw, spanned.get_ref())?;
    }
    Ok(())
}

/// The vehicle on paper.
struct Flight<'a> {
    plant: &'a Plant,
    model: &'a Model,
    /// Base pose and joint angles.
    q: Coordinates,
    /// Velocity of the centre of mass and rate, m/s and rad/s.
    rate: [f64; 3],
    gas_kg: f64,
    /// Whether a goal has put it to where nothing is known in advance: beside a target, or where others want it.
    is_elsewhere: bool,
}

impl<'a> Flight<'a> {
    fn begin(mission: &Mission, plant: &'a Plant, model: &'a Model) -> Self {
        let initial = &mission.initial;
        let q = coordinates(initial.base_pose, &initial.q_rad);
        let state = State { q, v: coordinates(initial.base_rate, &initial.qd_rad_s) };
        let linear = model.momentum(&state).linear / model.total_mass_kg();
        let rate = [linear.x, linear.y, initial.base_rate[2]];
        Self { plant, model, q, rate, gas_kg: 0.0, is_elsewhere: false }
    }

    fn fly(&mut self, phase: &Phase, raw: &raw::Phase) -> Checked<()> {
        let longest = raw.timeout_s.as_ref().unwrap_or(&raw.duration_s);
        match &phase.base {
            BaseGoal::Free => self.coast(phase.longest_s(), &longest.span())?,
            BaseGoal::Valves(pulses) => self.push(phase.longest_s(), pulses, &raw.base.goal.span())?,
            BaseGoal::Goto { pose, relative } => {
                let from = [self.q[0], self.q[1], self.q[2]];
                let to: [f64; 3] = std::array::from_fn(|i| pose[i] + if *relative { from[i] } else { 0.0 });
                self.use_gas_of_leg(from, to, phase.duration_s);
                self.q.as_mut_slice()[..3].copy_from_slice(&to);
                self.rate = [0.0; 3];
            }
            BaseGoal::Hold | BaseGoal::Stop => {
                let impulse = self.model.total_mass_kg() * self.rate[0].hypot(self.rate[1]);
                self.gas_kg += self.gas_of(impulse);
                self.rate = [0.0; 3];
            }
            // Where a target is, how it is held, and what others want is known in flight only.
            BaseGoal::Meet { .. } | BaseGoal::Carry { .. } | BaseGoal::Follow => {
                (self.is_elsewhere, self.rate) = (true, [0.0; 3]);
            }
        }
        match &phase.arm {
            ArmGoal::Joints(q_rad) => self.q.as_mut_slice()[3..3 + q_rad.len()].copy_from_slice(q_rad),
            ArmGoal::Follow => self.is_elsewhere = true,
            _ => {}
        }
        let place = [&raw.base.x_m, &raw.base.y_m, &raw.base.theta_deg].into_iter().flatten().next();
        let place = place.map_or(raw.arm.span(), Spanned::span);
        self.all_on_table(place, "at the end of this phase")
    }

    /// Without thrust.
    fn coast(&mut self, time_s: f64, blame: &Range<usize>) -> Checked<()> {
        let [vx, vy, omega] = self.rate;
        let edges = self.room();
        let centre = self.model.center_of_mass(&self.q);
        for (at, v, half) in [(centre.x, vx, edges[0]), (centre.y, vy, edges[1])] {
            let leaves_s = if v == 0.0 { f64::INFINITY } else { (half.copysign(v) - at) / v };
            if leaves_s < time_s && !self.is_elsewhere {
                let speed_mm_s = vx.hypot(vy) * 1e3;
                let message =
                    format!("the vehicle drifts at {speed_mm_s:.0} mm/s and leaves the table after {leaves_s:.0} s");
                let help = "give this phase less time, the start less speed, or the base a goal";
                return Err(Fault::new(blame.clone(), message, help));
            }
        }
        self.turn_about_centre(omega * time_s, [vx * time_s, vy * time_s]);
        Ok(())
    }

    /// With open valves and the arm held.
    fn push(&mut self, time_s: f64, pulses: &[Pulse], blame: &Range<usize>) -> Checked<()> {
        let (mass, inertia) = (self.model.total_mass_kg(), self.model.inertia_about_com(&self.q));
        for step in 0..(time_s / STEP_S) as usize {
            let t_s = step as f64 * STEP_S;
            let open = pulses.iter().filter(|pulse| (pulse.at_s..pulse.at_s + pulse.for_s).contains(&t_s));
            let centre = self.model.center_of_mass(&self.q);
            let (sin, cos) = self.q[2].sin_cos();
            for &thruster in open.flat_map(|pulse| &pulse.thrusters) {
                let [fx, fy, torque] = self.plant.thruster_wrench(thruster);
                let force = [cos * fx - sin * fy, sin * fx + cos * fy];
                let about_centre = torque - (centre.x - self.q[0]) * force[1] + (centre.y - self.q[1]) * force[0];
                self.rate[0] += force[0] / mass * STEP_S;
                self.rate[1] += force[1] / mass * STEP_S;
                self.rate[2] += about_centre / inertia * STEP_S;
                self.gas_kg += self.gas_of(fx.hypot(fy) * STEP_S);
            }
            let [vx, vy, omega] = self.rate;
            self.turn_about_centre(omega * STEP_S, [vx * STEP_S, vy * STEP_S]);
            let centre = self.model.center_of_mass(&self.q);
            let edges = self.room();
            if (centre.x.abs() > edges[0] || centre.y.abs() > edges[1]) && !self.is_elsewhere {
                let message = format!("these pulses drive the vehicle off the table after {t_s:.1} s");
                return Err(Fault::new(blame.clone(), message, "less or shorter pulses, or others against them"));
            }
        }
        Ok(())
    }

    fn turn_about_centre(&mut self, angle_rad: f64, way: [f64; 2]) {
        let centre = self.model.center_of_mass(&self.q);
        self.q[2] += angle_rad;
        let turned = self.model.center_of_mass(&self.q);
        self.q[0] += centre.x + way[0] - turned.x;
        self.q[1] += centre.y + way[1] - turned.y;
    }

    /// How far from the middle the centre of mass may be, m.
    fn room(&self) -> [f64; 2] {
        self.plant.table.size_m.map(|size| size / 2.0)
    }

    /// Base and links float on pads of their own: each joint and the end-effector must be over the granite.
    fn all_on_table(&self, blame: Range<usize>, when: &str) -> Checked<()> {
        if self.is_elsewhere {
            return Ok(());
        }
        let kinematics = self.model.kinematics(&self.q);
        let tip = kinematics.end_effector;
        let joints = kinematics.joints[..self.model.link_count()].iter().map(|joint| (joint.x, joint.y));
        let edges = self.room();
        for (number, (x, y)) in joints.chain([(tip.x, tip.y)]).enumerate() {
            if x.abs() > edges[0] || y.abs() > edges[1] {
                let what = if number == self.model.link_count() {
                    "the end-effector".to_owned()
                } else {
                    format!("joint {}", number + 1)
                };
                let message = format!("{what} is off the table {when}, at ({x:.2}, {y:.2}) m");
                let help = format!(
                    "the table ends at {} and {} m from its middle; every link floats on its own pads",
                    edges[0], edges[1]
                );
                return Err(Fault::new(blame, message, help));
            }
        }
        Ok(())
    }

    /// From rest to rest: what it takes to get into motion, twice; no more than the thrusters give in that time, of which
    /// those that push against each other are never open together.
    fn use_gas_of_leg(&mut self, from: [f64; 3], to: [f64; 3], duration_s: f64) {
        let way = (to[0] - from[0]).hypot(to[1] - from[1]);
        let turn = (to[2] - from[2]).abs() * self.model.inertia_about_com(&self.q) / LEVER_M;
        let impulse = 2.0 * PEAK / duration_s * (self.model.total_mass_kg() * way + turn);
        let thrust: f64 = (0..self.plant.thrusters.len()).map(|i| self.plant.thrust_n(i)).sum();
        self.gas_kg += self.gas_of(impulse.min(0.5 * thrust * duration_s));
    }

    fn gas_of(&self, impulse_n_s: f64) -> f64 {
        self.plant.tank.as_ref().map_or(0.0, |tank| impulse_n_s / (G0_M_S2 * tank.specific_impulse_s))
    }

    fn check_gas(&self, raw: &raw::Mission, phase: &raw::Phase) -> Checked<()> {
        let limit_g = raw.limits.as_ref().and_then(|limits| limits.gas_g.as_ref()).map(number).transpose()?;
        let has_g = self.plant.tank.as_ref().map(|tank| tank.gas_kg() * 1e3);
        let needs_g = self.gas_kg * 1e3;
        for (has, what) in [(limit_g, "[limits] gas_g allows"), (has_g, "the tank holds")] {
            if let Some(has) = has.filter(|has| needs_g > *has) {
                let message = format!("up to here the mission needs {needs_g:.1} g of gas, {what} {has:.1} g");
                return Err(Fault::new(
                    phase.base.goal.span(),
                    message,
                    "more time for the base's ways needs less gas",
                ));
            }
        }
        Ok(())
    }
}
