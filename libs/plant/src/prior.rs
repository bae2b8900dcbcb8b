//! What is believed of an effect before any data: how its parameters enter a prediction, how large they may be.
//!
//! Each parameter has a spike, the deviation that every laboratory has and nobody states, and a slab, a departure that would
//! be named: a normal distribution about the nominal value, of one of three widths, [`SLAB_WIDTHS`] times the typical size.
//! Of several parameters that act in proportion all depart, or one alone; the components of a vector depart together. Special values,
//! such as a thruster that is stuck shut, are points besides.

use crate::about::{MAX_PARAMETERS, Parameter};
use crate::file::Plant;

/// Standard deviations of the three slabs over the typical size of a departure, each with a third of the probability.
pub const SLAB_WIDTHS: [f64; 3] = [0.25, 1.0, 4.0];
/// Spike over typical size where an effect's file gives none: a laboratory leaves about a hundredth of what it would notice.
const SPIKE_SHARE: f64 = 0.01;
/// Of the friction that would be named, what no data sheet tells: oil and grease warm up.
pub(crate) const FRICTION_SPIKE_SHARE: f64 = 1.0 / 60.0;

/// How an effect's parameters enter a prediction that is linear in small effects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Response {
    /// Each parameter's departure from nominal acts in proportion.
    Linear,
    /// The first parameter is a strength k, each further one a place p without action: linear in k and k p.
    Strength,
    /// The first parameter acts in proportion, the second has one of these values.
    Shape(&'static [f64]),
    /// The first parameter acts in proportion, the second, larger than 0, is anywhere about these values, evenly in its logarithm.
    Scale(&'static [f64]),
    /// The first parameter acts in proportion, from the start of a run or from any time in it.
    Onset,
    /// The inverse of the first parameter acts in proportion.
    Inverse,
    /// There or not there, without a size.
    Discrete,
}

/// The prior of an effect in a plant. Sizes are in the units of the coordinates of [`Response`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// How the parameters enter.
    pub response: Response,
    /// Typical size of a departure from nominal.
    pub typical: [f64; MAX_PARAMETERS],
    /// Standard deviation of what is there without being a fault.
    pub spike: [f64; MAX_PARAMETERS],
    /// Special values of the first parameter.
    pub points: &'static [f64],
    /// Whether the first two parameters are the components of a vector, which points in any direction.
    pub is_vector: bool,
    /// Whether its forces come and go with contact: in the small it does nothing like what it does.
    pub is_contact: bool,
}

impl Prior {
    /// Linear, with the parameters' own typical sizes.
    pub fn of(parameters: &[Parameter]) -> Self {
        let mut typical = [0.0; MAX_PARAMETERS];
        typical.iter_mut().zip(parameters).for_each(|(own, parameter)| *own = parameter.scale);
        Self {
            response: Response::Linear,
            typical,
            spike: typical.map(|size| SPIKE_SHARE * size),
            points: &[],
            is_vector: false,
            is_contact: false,
        }
    }

    /// Linear, with these typical sizes and spikes.
    pub fn sized(typical: &[f64], spike: &[f64]) -> Self {
        let padded = |values: &[f64]| {
            let mut all = [0.0; MAX_PARAMETERS];
            all.iter_mut().zip(values).for_each(|(own, value)| *own = *value);
            all
        };
        Self {
            response: Response::Linear,
            typical: padded(typical),
            spike: padded(spike),
            points: &[],
            is_vector: false,
            is_contact: false,
        }
    }

    /// The same with another response.
    #[must_use]
    pub fn responding(mut self, response: Response) -> Self {
        self.response = response;
        self
    }

    /// The same with special values of the first parameter.
    #[must_use]
    pub fn with_points(mut self, points: &'static [f64]) -> Self {
        self.points = points;
        self
    }

    /// The same of an effect whose first two parameters are the components of a vector.
    #[must_use]
    pub fn of_vector(mut self) -> Self {
        self.is_vector = true;
        self
    }

    /// The same of an effect whose forces come and go with contact.
    #[must_use]
    pub fn of_contact(mut self) -> Self {
        self.is_contact = true;
        self
    }

    /// Which part of the effect a parameter belongs to, from 0: a part departs as a whole.
    pub fn part(&self, parameter: usize) -> usize {
        parameter - usize::from(self.is_vector && parameter > 0)
    }
}

/// Sizes that priors are measured by.
impl Plant {
    /// Mass of base and links (kg).
    pub fn total_mass_kg(&self) -> f64 {
        self.base.mass_kg + self.links.iter().map(|l| l.mass_kg).sum::<f64>()
    }

    /// Inertia of base and links about their centre of mass, the arm stretched out (kg m^2).
    pub fn total_inertia_kg_m2(&self) -> f64 {
        let [x, y] = self.base.joint1_xy_m;
        let (mut reach_m, mut first, mut second) = (x.hypot(y), 0.0, self.base.inertia_kg_m2);
        for link in &self.links {
            let centre_m = reach_m + link.length_m - link.com_to_next_joint_m;
            first += link.mass_kg * centre_m;
            second += link.inertia_kg_m2 + link.mass_kg * centre_m.powi(2);
            reach_m += link.length_m;
        }
        second - first.powi(2) / self.total_mass_kg()
    }

    /// Thrust of one thruster at its full level, the mean of all (N).
    pub fn typical_thrust_n(&self) -> f64 {
        let count = self.thrusters.len();
        (0..count).map(|i| self.thrust_n(i).abs()).sum::<f64>() / count.max(1) as f64
    }

    /// Torque at a joint (from 0) that matters: the motor's largest, or without a motor the one that gravity can exert (N m).
    pub fn typical_joint_torque_n_m(&self, joint: usize) -> f64 {
        let Some(link) = self.links.get(joint) else { return 1.0 };
        match (link.max_torque_n_m, self.largest_weight_n_m(joint)) {
            (0.0, 0.0) => 1.0,
            (0.0, weight) => weight,
            (motor, _) => motor,
        }
    }

    /// Friction at a joint (from 0) that would be named: of a drive 3 % of its largest torque, of a bare bearing, which has neither gear
    /// nor brushes, a tenth of that of the weight that it carries (N m).
    pub fn typical_joint_friction_n_m(&self, joint: usize) -> f64 {
        let has_motor = self.links.get(joint).is_none_or(|link| link.max_torque_n_m > 0.0);
        let share = if has_motor { 0.03 } else { 0.003 };
        share * self.typical_joint_torque_n_m(joint)
    }

    /// Rate of a joint (from 0) that matters: of an arm that its motors move 1 rad/s; of one that swings by its weight that of a
    /// pendulum's swing of 1 rad, sqrt(weight / inertia).
    pub fn typical_joint_rate_rad_s(&self, joint: usize) -> f64 {
        let Some(link) = self.links.get(joint) else { return 1.0 };
        let weight = self.largest_weight_n_m(joint);
        if link.max_torque_n_m > 0.0 || weight == 0.0 {
            return 1.0;
        }
        let beyond: f64 = self.links[joint + 1..].iter().map(|l| l.mass_kg).sum();
        let of_link = link.inertia_kg_m2 + link.mass_kg * (link.length_m - link.com_to_next_joint_m).powi(2);
        (weight / (of_link + beyond * link.length_m.powi(2))).sqrt()
    }

    /// Torque at a joint (from 0) that gravity can exert, N m.
    fn largest_weight_n_m(&self, joint: usize) -> f64 {
        let [gx, gy] = self.table.gravity_m_s2;
        let Some(link) = self.links.get(joint) else { return 0.0 };
        let beyond: f64 = self.links[joint + 1..].iter().map(|l| l.mass_kg).sum();
        let arm = link.mass_kg * (link.length_m - link.com_to_next_joint_m) + beyond * link.length_m;
        arm.abs() * gx.hypot(gy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_base_and_a_link_turn_about_their_centre_of_mass() {
        let mut plant = Plant::default_laboratory().unwrap_or_else(|error| panic!("{error}"));
        plant.links.truncate(1);
        (plant.base.mass_kg, plant.base.inertia_kg_m2, plant.base.joint1_xy_m) = (3.0, 0.5, [0.3, 0.4]);
        let link = &mut plant.links[0];
        (link.length_m, link.com_to_next_joint_m, link.mass_kg, link.inertia_kg_m2) = (1.9, 0.4, 1.0, 0.1);
        // 2 m apart, of reduced mass 3/4 kg.
        assert!((plant.total_inertia_kg_m2() - (0.5 + 0.1 + 0.75 * 4.0)).abs() < 1e-12);
    }
}
