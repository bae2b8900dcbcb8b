//! Where a simulation differs from what was measured, and why: examine, linearize, whiten, search, conclude.
//!
//! In the order of reading:
//!
//! - [`block`]: what the search needs of a set of channels of one run: a prediction linear in small effects, a noise model.
//! - [`base`]: the motion of a floating base as a block.
//! - [`joints`]: the joints and the end-effector as a block.
//! - `servo_response`: what servos make of the datagrams that command them; `memo`: what is computed once for plants that are alike.
//! - `examine`, `startup_transient`: what of the records is no measurement; `tuning`: how servos are tuned.
//! - `problem`: all runs as blocks, all possible causes; `linearized`, `columns`: what each does in the small; `screening`: which are
//!   worth searching with.
//! - `gram`: products of the whitened columns.
//! - `search`: marginal likelihoods of sets of causes, and of wirings of the thrusters.
//! - `conclude`: what is asserted; `constancy`: whether it is of one size in all runs; `scores`: what other runs say of it; `misfit`:
//!   errors over noise.
//! - `pulses`: single pulses that a thruster did not deliver.
//! - [`diagnosis`]: the answer.
//! - `draw`: causes drawn from the prior, to test all of this with.

mod alike;
pub mod base;
pub mod block;
mod candidates;
mod columns;
mod conclude;
mod constancy;
pub mod diagnosis;
mod draw;
pub mod examine;
mod friction;
mod gram;
mod joint_telemetry;
pub mod joints;
mod linearized;
mod memo;
mod misfit;
mod path;
mod problem;
mod pulses;
mod scores;
mod screening;
mod search;
mod servo_response;
mod startup_transient;
mod tuning;
pub mod uncertain;

pub use conclude::ASSERTED;
use diagnosis::{Cause, ChannelMisfit, Diagnosis, Gain, Verdict};
pub use draw::drawn_causes;
use examine::{Examined, examine};
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Physics, Plant};
use problem::{Linearized, Problem};
use search::{Contact, NoCause, Rewired, Searched, Standing};
use std::collections::BTreeSet;
use tuning::Tuning;

/// Diagnoses measured runs of a plant. Validation runs judge the answer; they play no part in choosing it.
///
/// # Errors
/// Where the plant's values or effects make a mass or an inertia impossible.
pub fn diagnose(
    plant: &Plant,
    runs: &[Run],
    validation: &[Run],
    say: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, ModelError> {
    let Examined { plant, runs, remarks } = examine(plant, runs);
    let validation = examine(&plant, validation).runs;
    let answer = answer(&plant, (&runs, &validation), &Start::PlantFile, say)?;
    let remarks = [remarks, answer.remarks].concat();
    Ok(Diagnosis { remarks, ..answer })
}

/// What is said where the best model is one in which no thruster pushes, and it is not good.
const NO_COMMAND_SHOWS: &str = "no command of a thruster shows in the motion: the commands are of another motion, or nothing \
    reached the thrusters; no cause is asserted";

/// A thrust below this share of the plant file's is none.
const NO_THRUST: f64 = 0.01;

/// Whether no thruster of the plant pushes with these causes, though one does without them.
fn commands_do_nothing(plant: &Plant, causes: &[Cause]) -> bool {
    let largest_n = |effects: &[Effect]| {
        let thrusters = Physics::with(plant, effects).thrusters;
        thrusters.iter().flat_map(|t| t.curve_n).map(f64::abs).fold(0.0, f64::max)
    };
    let with: Vec<Effect> = plant.effects.iter().cloned().chain(causes.iter().map(|c| c.effect.clone())).collect();
    let before_n = largest_n(&plant.effects);
    before_n > 0.0 && largest_n(&with) < NO_THRUST * before_n
}

/// What a search sets out from.
enum Start {
    /// The plant file, as it is.
    PlantFile,
    /// A plant with a wiring that was found.
    Rewired,
    /// A contact that was found, which no other cause is sought beside.
    Contact(Contact),
}

impl Start {
    fn contact(&self) -> Option<&Contact> {
        if let Self::Contact(contact) = self { Some(contact) } else { None }
    }
}

/// The answer from records that hold nothing but measurements.
fn answer(
    plant: &Plant,
    records: (&[Run], &[Run]),
    start: &Start,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, ModelError> {
    let problem = Problem::new(plant, records.0, &Tuning::default())?;
    if problem.is_empty() {
        return Ok(nothing_to_say(plant));
    }
    let nothing = search::without_causes(&problem, (None, Linearized::default()), say)?;
    let noise = nothing.noise.clone();
    let (mut problem, mut nothing) = tuned((problem, nothing), records.0, say)?;
    // A contact is sought alone.
    let among = start.contact().map(|contact| BTreeSet::from([contact.candidate()]));
    let (mut left, mut refused) = (RETUNED, problem.tuning.clone());
    loop {
        let mut next = None;
        let mut is_tuned_otherwise = |standing: &Standing| -> Result<bool, ModelError> {
            let found = standing.tuning()?;
            if left == 0 || found.is_near(&problem.tuning) || found.is_near(&refused) {
                return Ok(false);
            }
            let other = Problem::new(plant, records.0, &found)?;
            let is_likelier = standing.is_likelier_in(&other)?;
            if is_likelier {
                let gains = other.of_causes(other.known_from(&problem, standing.linearized), true);
                next = Some((other, gains));
            } else {
                refused = found;
            }
            Ok(is_likelier)
        };
        let from = (start.contact(), among.as_ref());
        let searched = search::search(&problem, nothing, from, &mut is_tuned_otherwise, say)?;
        let Some((other, gains)) = next else { return answer_of(&searched, records, start, say) };
        nothing = search::without_causes(&other, (Some(&noise), gains), say)?;
        (problem, left) = (other, left - 1);
    }
}

/// The runs without causes, with the gains and frictions that suit them best.
fn tuned(
    (mut problem, mut nothing): (Problem, NoCause),
    runs: &[Run],
    say: &(dyn Fn(&str) + Sync),
) -> Result<(Problem, NoCause), ModelError> {
    for _ in 0..RETUNED {
        let found = nothing.tuning(&problem)?;
        if found.is_near(&problem.tuning) {
            break;
        }
        say("tuning the servos");
        let other = Problem::new(&problem.plant_file, runs, &found)?;
        let known = other.known_from(&problem, &nothing.uncertain);
        let there = search::without_causes_at(&other, &nothing.noise, known)?;
        if there.log_posterior <= nothing.log_posterior {
            break;
        }
        (problem, nothing) = (other, there);
    }
    let gains = problem.of_causes(nothing.uncertain, true);
    let nothing = search::without_causes(&problem, (Some(&nothing.noise), gains), say)?;
    Ok((problem, nothing))
}

/// So often at the most servos are tuned otherwise, without causes and with them.
const RETUNED: usize = 4;

/// The answer that a search leads to.
fn answer_of(
    searched: &Searched,
    records: (&[Run], &[Run]),
    start: &Start,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, ModelError> {
    let (problem, (runs, validation)) = (searched.search.problem, records);
    let judged_on = problem.of_other_runs(validation)?;
    say("measuring the gain");
    let scores = scores::scores(searched, Some(&judged_on))?;
    let mut concluded = conclude::conclude(problem, searched, &scores, &constancy::constancies(searched));
    let misfits = |plant: &Plant| Misfits::new((problem, runs), (&judged_on, validation), plant, &searched.hyper);
    let before = misfits(&problem.settled(&searched.points[0].posterior.means()[searched.uncertain_at()..]))?;
    let mut remarks = std::mem::take(&mut concluded.remarks);
    if concluded.verdict.leaves_something() {
        let is_first = matches!(start, Start::PlantFile);
        say("asking for another wiring, or for contacts");
        let wiring = if is_first { search::rewired(searched)? } else { None };
        if let Some(Rewired::By(exchanges, probability)) = wiring {
            return rewired(&problem.plant_file, records, (exchanges, probability), before, say);
        }
        if let Some(contact) = if is_first { search::contact(searched)? } else { None } {
            let answer = answer(&problem.plant_file, records, &Start::Contact(contact), say)?;
            // Its noise alone may have been what was more probable.
            if !answer.causes.is_empty() {
                return Ok(beside(before, answer));
            }
        }
        if wiring.is_some() || commands_do_nothing(&problem.plant, &concluded.causes) {
            remarks.push(NO_COMMAND_SHOWS.to_owned());
            concluded.assert_nothing();
        }
    }
    say("asking for single pulses");
    let mut missing_pulses = pulses::missing_pulses(searched, problem, runs)?;
    missing_pulses.extend(pulses::missing_pulses(searched, &judged_on, validation)?);
    let means = searched.uncertain_means();
    let extended = with(problem.settled(&means), &concluded);
    let after = misfits(&extended)?;
    let names = problem.uncertain.iter().map(|u| u.name.clone());
    Ok(Diagnosis {
        remarks,
        verdict: concluded.verdict,
        causes: concluded.causes,
        suspects: concluded.suspects,
        laws: concluded.laws,
        missing_pulses,
        probability_of_none: concluded.probability_of_none,
        inclusion: concluded.inclusion,
        discrepancy: concluded.discrepancy,
        run_to_run: searched.hyper.last().copied().unwrap_or(0.0),
        gain: Gain { before: before.overall(), after: after.overall() },
        before: before.fitted,
        after: after.fitted,
        validation_before: before.validation,
        validation_after: after.validation,
        settled: names.zip(means).collect(),
        extended,
    })
}

/// The answer where the thrusters are wired in another way, by exchanges of lines, than in the plant file.
fn rewired(
    plant: &Plant,
    records: (&[Run], &[Run]),
    (exchanges, probability): (Vec<Effect>, f64),
    before: Misfits,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, ModelError> {
    let mut wired = plant.clone();
    wired.effects.extend(exchanges.iter().cloned());
    let mut answer = answer(&wired, records, &Start::Rewired, say)?;
    let causes = exchanges.into_iter().map(|effect| Cause::certain(effect, probability));
    answer.causes.splice(0..0, causes);
    answer.verdict = answer.verdict.with_causes();
    answer.probability_of_none = 0.0;
    Ok(beside(before, answer))
}

/// An answer beside the misfit of the plant as given.
fn beside(before: Misfits, answer: Diagnosis) -> Diagnosis {
    let gain = Gain { before: before.overall(), ..answer.gain };
    Diagnosis { gain, before: before.fitted, validation_before: before.validation, ..answer }
}

/// The plant with what was concluded.
fn with(mut plant: Plant, concluded: &conclude::Concluded) -> Plant {
    let causes = concluded.causes.iter().map(|c| c.effect.clone());
    let effects: Vec<_> = causes.chain(concluded.laws.iter().cloned()).collect();
    plant.effects.retain(|e| !effects.iter().any(|n| problem::is_same(n, e)));
    plant.effects.extend(effects);
    // What is settled stands behind what is concluded.
    plant.effects.sort_by_key(uncertain::are_link_stamps);
    plant
}

/// Misfit of all runs under a plant.
struct Misfits {
    fitted: Vec<ChannelMisfit>,
    validation: Vec<ChannelMisfit>,
}

impl Misfits {
    fn new(
        (problem, runs): (&Problem, &[Run]),
        (judged_on, validation): (&Problem, &[Run]),
        plant: &Plant,
        hyper: &[f64],
    ) -> Result<Self, ModelError> {
        let (fitted, validation) = (problem.misfit(runs, plant, hyper)?, judged_on.misfit(validation, plant, hyper)?);
        Ok(Self { fitted, validation })
    }

    /// Of the validation runs; of the fitted ones where there are none.
    fn overall(&self) -> f64 {
        misfit::overall(if self.validation.is_empty() { &self.fitted } else { &self.validation })
    }
}

fn nothing_to_say(plant: &Plant) -> Diagnosis {
    Diagnosis {
        remarks: Vec::new(),
        verdict: Verdict::Consistent,
        causes: Vec::new(),
        suspects: Vec::new(),
        laws: Vec::new(),
        missing_pulses: Vec::new(),
        probability_of_none: 1.0,
        inclusion: Vec::new(),
        discrepancy: Vec::new(),
        run_to_run: 0.0,
        before: Vec::new(),
        after: Vec::new(),
        validation_before: Vec::new(),
        validation_after: Vec::new(),
        gain: Gain { before: 1.0, after: 1.0 },
        settled: Vec::new(),
        extended: plant.clone(),
    }
}
