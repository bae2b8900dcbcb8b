//! A table that two vehicles share: what this laboratory makes of the other one's word.
//!
//! Each laboratory moves its own vehicle. The other one's is this one's target: it stands where its own laboratory has it, until
//! this vehicle's gripper holds it; then this laboratory moves both as one body, and the other one follows. What is held
//! is a rigid body with the mass and inertia of this plant's `[target]`: its thrust and what its arm does move nothing meanwhile.

use fss_plant::Simulation;
use fss_wire::shared_table::State;

/// A word that is older does not count: the other vehicle floats on as it moved, ns.
const STALE_NS: u64 = 100_000_000;
/// A target whose mass is off by a larger share than this is not the other vehicle, and somebody should know.
const MASS_TOLERANCE: f64 = 0.01;

/// The other vehicle, as it was last heard of.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SharedTable {
    other: Option<State>,
    /// The sum of its pushes that this vehicle has come to (N s).
    taken_n_s: [f64; 2],
}

impl SharedTable {
    /// Takes the other laboratory's word; `target_mass_kg` is what this plant believes of the other vehicle.
    pub(crate) fn hear(&mut self, other: &State, target_mass_kg: Option<f64>) {
        if self.other.is_none_or(|known| known.session != other.session) {
            self.taken_n_s = other.pushed_n_s;
            if let Some(mass_kg) = target_mass_kg.filter(|m| (m - other.mass_kg).abs() > MASS_TOLERANCE * other.mass_kg)
            {
                let weighs_kg = other.mass_kg;
                eprintln!("[target] has {mass_kg} kg, and the vehicle that stands for it {weighs_kg} kg");
            }
        } else if self.other.is_some_and(|known| known.time_ns > other.time_ns) {
            return;
        }
        self.other = Some(*other);
    }

    /// The sum of the other's pushes that this vehicle has come to (N s).
    pub(crate) fn taken_n_s(&self) -> [f64; 2] {
        self.taken_n_s
    }

    /// Whether the other vehicle's gripper holds this one.
    pub(crate) fn is_held(&self, now_ns: u64) -> bool {
        self.fresh(now_ns).is_some_and(|other| other.held.is_some())
    }

    /// Brings the other vehicle, and what it does to this one, to `now_ns`.
    pub(crate) fn apply(&mut self, now_ns: u64, simulation: &mut Simulation) {
        let Some(other) = self.fresh(now_ns) else { return };
        let since_s = now_ns.saturating_sub(other.time_ns) as f64 * 1e-9;
        let ahead = |pose: [f64; 3], velocity: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|i| pose[i] + since_s * velocity[i])
        };
        let push: [f64; 2] = std::array::from_fn(|i| other.pushed_n_s[i] - self.taken_n_s[i]);
        if push != [0.0; 2] {
            self.taken_n_s = other.pushed_n_s;
            simulation.push(push);
        }
        if let Some([pose, velocity]) = other.held {
            simulation.carry_base(ahead(pose, velocity), velocity);
        }
        // What this vehicle's tip has pushed and the other laboratory has not heard of yet.
        let on_its_way = simulation.pushed_n_s();
        let mut velocity = other.velocity;
        for i in 0..2 {
            velocity[i] += (on_its_way[i] - other.taken_n_s[i]) / other.mass_kg;
        }
        simulation.set_target(ahead(other.pose, velocity), velocity);
    }

    fn fresh(&self, now_ns: u64) -> Option<State> {
        self.other.filter(|other| now_ns.saturating_sub(other.time_ns) <= STALE_NS && other.mass_kg > 0.0)
    }
}
