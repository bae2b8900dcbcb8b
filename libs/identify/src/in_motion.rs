//! Masses that were found, and how they change what an arm makes of its commands.
//!
//! A log tells what drivers were told, not where links were between two reports: that is simulated. How drivers carry their
//! commands out hangs on the masses that they move, and simulated with those of the plant file a heavier base looks like a
//! soft drive.

use fss_experiments::commands::Commands;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Place, Plant};
use rayon::prelude::*;

/// The masses among the causes, where a log tells commands and another cause hangs on how the arm moves between two reports.
pub(crate) fn masses_that_move(causes: &[Effect], runs: &[Run]) -> Option<Vec<Effect>> {
    let hangs_on_motion = |e: &Effect| !matches!(e.about().place, Place::Base | Place::Mass | Place::Thruster);
    let masses: Vec<Effect> = causes.iter().filter(|e| e.about().place == Place::Mass).cloned().collect();
    let matters = !masses.is_empty() && causes.iter().any(hangs_on_motion);
    (matters && runs.iter().any(|run| run.commands.is_some())).then_some(masses)
}

/// Runs whose arms carry out their commands with these masses.
pub(crate) fn carried_out(runs: &[Run], plant: &Plant, masses: &[Effect]) -> Result<Vec<Run>, ModelError> {
    let anew = |run: &Run| {
        let commands = run.commands.clone().map(|commands| Commands { beside: masses.to_vec(), ..commands });
        let joint_command = commands.as_ref().map(|commands| commands.carried_out(plant)).transpose()?;
        Ok(Run { commands, joint_command, ..run.clone() })
    };
    runs.par_iter().map(anew).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fss_plant::EffectError;

    #[test]
    fn masses_matter_beside_what_hangs_on_the_arms_motion() -> Result<(), EffectError> {
        let logs = [Run { commands: Some(Commands::default()), ..Run::default() }];
        let (inertia, drive) = (Effect::new("base_inertia")?, Effect::new("joint_flexibility")?.at(2));
        let thruster = Effect::new("thruster_gain")?.at(1);
        assert_eq!(masses_that_move(&[inertia.clone(), drive.clone()], &logs), Some(vec![inertia.clone()]));
        assert_eq!(
            masses_that_move(&[inertia.clone(), thruster], &logs),
            None,
            "a thruster is one whatever the arm does"
        );
        assert_eq!(masses_that_move(std::slice::from_ref(&drive), &logs), None, "no mass is off");
        assert_eq!(
            masses_that_move(&[inertia, drive], &[Run::default()]),
            None,
            "without an arm nothing was commanded"
        );
        Ok(())
    }
}
