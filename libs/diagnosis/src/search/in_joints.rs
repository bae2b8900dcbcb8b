//! What the joints' own channels tell of uncertain values, whatever acts on the base.

use super::sets::SIZES;
use super::space::Search;
use crate::gram::GramCache;
use crate::problem::{Linearized, Present, Problem, Slope};
use crate::uncertain::OfServo;
use fss_multibody::ModelError;
use fss_plant::{Effect, Friction, Physics};

/// The family of the joints' blocks.
const JOINTS: usize = 1;

impl Search<'_> {
    /// Posterior means of the uncertain values, in stated standard deviations, with the most probable of a model's causes and of the frictions
    /// that would be taken for dry friction; empty where no servo's answer hangs on it.
    pub(super) fn values_in_joints(
        &self,
        (about, hyper): (&Linearized, &[f64]),
        model: &[Present],
    ) -> Result<Vec<f64>, ModelError> {
        if self.problem.uncertain.iter().all(|value| value.of_servo != Some(OfServo::DryFriction)) {
            return Ok(Vec::new());
        }
        let known = self.problem.of_uncertain(about);
        let (problem, known) = self.problem.of_blocks(|member| member.family == JOINTS, known);
        let is_present = |c: usize| model.iter().any(|p| p.candidate == c);
        let mut search = Search::new(&problem);
        search.chosen =
            (0..problem.candidates.len()).filter(|c| is_present(*c) || problem.is_other_friction(*c)).collect();
        (search.parameters, search.position) = search.parameters_with(&search.chosen);
        let linearized =
            problem.linearized((model, hyper), Slope::Secant, &|c, _| search.chosen.contains(&c), known)?;
        let points: Vec<_> =
            search.point(&linearized, hyper, &search.parameters, &GramCache::default()).into_iter().collect();
        let sets = search.beam(&points, SIZES.len() - 1);
        Ok(search.values(&points, &sets[0]))
    }
}

impl Problem {
    /// Whether a candidate is a friction of a joint for which no uncertain value stands: in the joints' channels it would be taken for dry
    /// friction.
    fn is_other_friction(&self, candidate: usize) -> bool {
        let own = &self.candidates[candidate];
        let probe: Vec<f64> = (0..own.size).map(|i| own.probe(i)).collect();
        let friction = |effects: &[Effect]| -> Vec<Friction> {
            Physics::with(&self.plant, effects).joints.iter().map(|joint| joint.friction).collect()
        };
        self.parameters_of(candidate).all(|p| self.sets[p].is_none()) && friction(&own.at(&probe)) != friction(&[])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::tuning::Tuning;
    use fss_plant::Plant;

    #[test]
    fn static_friction_would_be_taken_for_dry_friction_and_what_uncertain_values_stand_for_is_no_other() {
        let mut plant = Plant::default_laboratory().unwrap();
        let uncertainty = plant.uncertainty.get_or_insert_default();
        (uncertainty.coulomb_friction_n_m, uncertainty.viscous_friction_n_m_s_rad) = (0.01, 0.02);
        let problem = Problem::new(&plant, &[], &Tuning::default()).unwrap();
        let others = (0..problem.candidates.len()).filter(|c| problem.is_other_friction(*c));
        let mut others: Vec<_> = others.map(|c| &problem.candidates[c].nominal).map(|e| (e.id(), e.index())).collect();
        // At several rates.
        others.dedup();
        let each_joint = |id| (1..=plant.links.len()).map(move |joint| (id, Some(joint)));
        assert_eq!(others, each_joint("joint_stribeck_friction").collect::<Vec<_>>());
    }
}
