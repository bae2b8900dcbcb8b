//! The runs as blocks, the possible causes and uncertain values, and the columns that they give: linearize, then whiten.

use crate::base::BaseBlock;
use crate::block::{Block, HyperParameter, VARIATION};
use crate::candidates::{Candidate, Records, candidates};
use crate::joint_telemetry::{ranges, rate_variance, rates};
use crate::joints::joint_block_with;
pub(crate) use crate::linearized::{Column, Linearized, Slope, difference};
use crate::servo_response::datagrams;
use crate::tuning::Tuning;
use crate::uncertain::{OfServo, Uncertain, uncertain};
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Physics, Plant, Response};
use rayon::prelude::*;
use std::sync::Arc;

/// A block, the run that it is of, and its family: blocks of a family share hyper-parameters.
#[derive(Clone)]
pub(crate) struct Member {
    pub(crate) run: usize,
    pub(crate) family: usize,
    pub(crate) block: Arc<dyn Block>,
}

/// A cause of the model that everything is linearized about: which candidate, at which coordinates.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Present {
    pub(crate) candidate: usize,
    pub(crate) coordinates: Vec<f64>,
}

/// Everything that is linear: runs, causes, uncertain values.
#[derive(Clone)]
pub(crate) struct Problem {
    pub(crate) plant_file: Plant,
    /// The plant of the plant file, its servos tuned as the runs show.
    pub(crate) plant: Plant,
    pub(crate) tuning: Tuning,
    pub(crate) members: Vec<Member>,
    pub(crate) runs: usize,
    pub(crate) candidates: Vec<Candidate>,
    /// First parameter of each candidate.
    pub(crate) first: Vec<usize>,
    /// The one run that serves a first look at a candidate, where all are not worth their cost.
    seen_in: Vec<Option<usize>>,
    pub(crate) uncertain: Vec<Uncertain>,
    /// Hyper-parameters of all families, then the variation from run to run.
    pub(crate) hyper: Vec<HyperParameter>,
    family_at: Vec<usize>,
    /// Family of each hyper-parameter; the last has none.
    pub(crate) family_of: Vec<usize>,
    /// Deviation of each parameter's spike.
    pub(crate) spikes: Vec<f64>,
    /// The same of causes of the model that everything is linearized about.
    pub(crate) spikes_about: Vec<f64>,
    /// The uncertain value that each parameter of a candidate sets.
    pub(crate) sets: Vec<Option<SetValue>>,
}

/// The blocks of all runs. A family has one noise model: what does not share it with the first of its family is left out.
fn members(plant: &Plant, runs: &[Run]) -> Result<Vec<Member>, ModelError> {
    let of_run = |run: &Run| -> Result<[Option<Arc<dyn Block>>; 2], ModelError> {
        let answers = Arc::default();
        let base = BaseBlock::with_answers(plant, run, &answers)?.map(|b| Arc::new(b) as Arc<dyn Block>);
        Ok([base, joint_block_with(plant, run, &answers).map(|b| Arc::new(b) as Arc<dyn Block>)])
    };
    let blocks: Vec<_> = runs.par_iter().map(of_run).collect::<Result<_, ModelError>>()?;
    let mut members: Vec<Member> = Vec::new();
    for (run, of_run) in blocks.into_iter().enumerate() {
        for (family, block) in of_run.into_iter().enumerate() {
            members.extend(block.map(|block| Member { run, family, block }));
        }
    }
    let model_of: Vec<(usize, usize)> = members.iter().map(|m| (m.family, m.block.hyper_parameters().len())).collect();
    members.retain(|m| {
        let first = model_of.iter().find(|(family, _)| *family == m.family);
        first.is_some_and(|(_, count)| *count == m.block.hyper_parameters().len())
    });
    Ok(members)
}

/// An uncertain value that a cause's parameter sets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SetValue {
    /// Which uncertain value.
    pub(crate) uncertain: usize,
    /// By how much a standard deviation of it moves the parameter.
    pub(crate) deviation: f64,
}

/// The uncertain value that each parameter of the candidates sets, where it sets one: beside such a cause, the value does nothing.
fn set_values(plant: &Plant, uncertain: &[Uncertain], candidates: &[Candidate]) -> Vec<Option<SetValue>> {
    let as_is = |plant: &Plant| Physics::with(plant, &plant.effects);
    let moved = uncertain.iter().map(|value| value.moved(plant, 1.0)).enumerate();
    let moved: Vec<(usize, Plant)> = moved.filter(|(_, there)| as_is(there) != as_is(plant)).collect();
    let set_by = |candidate: &Candidate, i: usize| {
        let nominal = |plant: &Plant| candidate.nominal.clone().nominal(plant);
        let here = nominal(plant);
        let beside = |plant: &Plant| Physics::with(plant, std::slice::from_ref(&here));
        let deviation = |there: &Plant| nominal(there).values().get(i).zip(here.values().get(i)).map(|(a, b)| a - b);
        let set = |(uncertain, there): &(usize, Plant)| {
            let deviation = deviation(there).filter(|deviation| *deviation != 0.0)?;
            (beside(there) == beside(plant)).then_some(SetValue { uncertain: *uncertain, deviation })
        };
        moved.iter().find_map(set)
    };
    let of_candidate = |candidate: &Candidate| -> Vec<Option<SetValue>> {
        let continuous = candidate.prior.response != Response::Discrete;
        (0..candidate.size).map(|i| if continuous { set_by(candidate, i) } else { None }).collect()
    };
    candidates.iter().flat_map(of_candidate).collect()
}

/// Hyper-parameters of all families, then the variation from run to run; the first of each family; the family of each.
fn hyper_parameters(members: &[Member]) -> (Vec<HyperParameter>, Vec<usize>, Vec<usize>) {
    let (mut hyper, mut family_at, mut family_of) = (Vec::new(), Vec::new(), Vec::new());
    let families = members.iter().map(|m| m.family + 1).max().unwrap_or(0);
    for family in 0..families {
        family_at.push(hyper.len());
        let of_family = members.iter().find(|m| m.family == family);
        hyper.extend(of_family.map_or(&[][..], |m| m.block.hyper_parameters()).iter().cloned());
        family_of.resize(hyper.len(), family);
    }
    family_of.push(usize::MAX);
    hyper.push(VARIATION);
    (hyper, family_at, family_of)
}

impl Problem {
    /// Of runs of a plant, whose servos are tuned otherwise than its file says.
    pub(crate) fn new(plant: &Plant, runs: &[Run], tuning: &Tuning) -> Result<Self, ModelError> {
        let swing = runs.iter().any(|run| datagrams(plant, run).is_some());
        let uncertain = uncertain(plant, swing);
        let values = uncertain.iter().enumerate();
        let tuned = values.fold(plant.clone(), |plant, (i, value)| match tuning.by(i) {
            0.0 => plant,
            by => value.moved(&plant, by),
        });
        let members = members(&tuned, runs)?;
        let duration_s = members.iter().map(|m| span_s(m.block.as_ref())).fold(1.0, f64::max);
        let (rates_rad_s, ranges_rad) = (rates(plant, runs), ranges(plant, runs));
        let candidates = candidates(plant, &Records { duration_s, rates_rad_s, ranges_rad, swing });
        // Each stiffness takes a simulation of every run: the run in which its joint moves most tells most.
        let busiest = |c: &Candidate| {
            let joint = c.nominal.index().filter(|_| swing && c.is_elastic(&tuned))? - 1;
            (0..runs.len()).max_by(|a, b| rate_variance(&runs[*a], joint).total_cmp(&rate_variance(&runs[*b], joint)))
        };
        let seen_in = candidates.iter().map(busiest).collect();
        let (hyper, family_at, family_of) = hyper_parameters(&members);
        let (mut first, mut spikes) = (Vec::new(), Vec::new());
        for candidate in &candidates {
            first.push(spikes.len());
            let discrete = candidate.prior.response == Response::Discrete;
            for i in 0..candidate.size {
                spikes.push(if discrete { 1e-6 } else { candidate.prior.spike[i] });
            }
        }
        let sets = set_values(plant, &uncertain, &candidates);
        // About a cause that sets an uncertain value, this has no column of its own.
        let about = |(spike, sets): (&f64, &Option<SetValue>)| spike.hypot(sets.map_or(0.0, |value| value.deviation));
        let mut spikes_about: Vec<f64> = spikes.iter().zip(&sets).map(about).collect();
        for all in [&mut spikes, &mut spikes_about] {
            all.extend(uncertain.iter().map(|_| 1.0));
        }
        let (plant_file, plant, tuning, runs) = (plant.clone(), tuned, tuning.clone(), runs.len());
        Ok(Self {
            plant_file,
            plant,
            tuning,
            members,
            runs,
            candidates,
            first,
            seen_in,
            uncertain,
            hyper,
            family_at,
            family_of,
            spikes,
            spikes_about,
            sets,
        })
    }

    /// The plant with its uncertain values moved by so many standard deviations from the plant file's.
    pub(crate) fn settled(&self, by: &[f64]) -> Plant {
        let moved = |plant: Plant, (i, value): (usize, &Uncertain)| match by.get(i) {
            Some(by) => value.moved(&plant, by - self.tuning.by(i)),
            None => plant,
        };
        self.uncertain.iter().enumerate().fold(self.plant.clone(), moved)
    }

    /// Strengths of the structured discrepancy, of each family of blocks.
    pub(crate) fn discrepancies(&self, hyper: &[f64]) -> Vec<(String, f64, f64)> {
        let mut out = Vec::new();
        for (family, at) in self.family_at.iter().enumerate() {
            if let Some(member) = self.members.iter().find(|m| m.family == family) {
                let count = member.block.hyper_parameters().len();
                out.extend(member.block.discrepancies(&hyper[*at..at + count]));
            }
        }
        out
    }

    /// The same of other runs, with this one's candidates and hyper-parameters, without the blocks whose noise model this one does not
    /// have.
    pub(crate) fn of_other_runs(&self, runs: &[Run]) -> Result<Self, ModelError> {
        let mut other = Self::new(&self.plant_file, runs, &self.tuning)?;
        (other.candidates, other.first) = (self.candidates.clone(), self.first.clone());
        (other.spikes, other.spikes_about, other.sets) =
            (self.spikes.clone(), self.spikes_about.clone(), self.sets.clone());
        let knows = |m: &Member| {
            let family = self.members.iter().find(|own| own.family == m.family);
            family.is_some_and(|own| own.block.hyper_parameters().len() == m.block.hyper_parameters().len())
        };
        other.members.retain(knows);
        (other.hyper, other.family_at, other.family_of) =
            (self.hyper.clone(), self.family_at.clone(), self.family_of.clone());
        Ok(other)
    }

    /// The same of the one run that tells most of a candidate, with columns of this one's blocks; of all runs where none does.
    pub(crate) fn where_seen(&self, candidate: usize, of_all: Linearized) -> (Self, Linearized) {
        let serves = |member: &Member| self.seen_in[candidate].is_none_or(|run| run == member.run);
        self.of_blocks(serves, of_all)
    }

    /// The same of some blocks, with these blocks' columns.
    pub(crate) fn of_blocks(&self, serves: impl Fn(&Member) -> bool, of_all: Linearized) -> (Self, Linearized) {
        let own = self.members.iter().cloned().zip(of_all.columns).filter(|(member, _)| serves(member));
        let (members, columns) = own.unzip();
        (Self { members, ..self.clone() }, Linearized { columns, ..of_all })
    }

    /// Whether a candidate lets links swing, which is simulated.
    pub(crate) fn swings(&self, candidate: usize) -> bool {
        self.seen_in[candidate].is_some()
    }

    /// Number of runs that have any block.
    pub(crate) fn runs(&self) -> usize {
        (0..self.runs).filter(|run| self.members.iter().any(|m| m.run == *run)).count()
    }

    /// Hyper-parameters of a family.
    pub(crate) fn hyper_of<'h>(&self, member: &Member, hyper: &'h [f64]) -> &'h [f64] {
        let mine = self.family_at[member.family];
        &hyper[mine..mine + member.block.hyper_parameters().len()]
    }

    /// Whether a candidate's columns in a block serve the first look at all candidates: those of laws and onsets are many, and show in the
    /// base, or of a joint in its channels.
    pub(crate) fn at_first(&self, candidate: usize, member: &Member) -> bool {
        let own = &self.candidates[candidate];
        let families = self.members.iter().map(|m| m.family);
        let shown_in = if own.is_law_of_joint() { families.max() } else { families.min() };
        let shows = !(own.is_law || own.begins_late()) || Some(member.family) == shown_in;
        shows && self.seen_in[candidate].is_none_or(|run| run == member.run)
    }

    /// Families of blocks in which a candidate acts.
    pub(crate) fn families(&self, linearized: &Linearized, candidate: usize) -> Vec<usize> {
        let acts =
            |columns: &Vec<Column>| self.parameters_of(candidate).any(|p| columns[p + 1].iter().any(|v| *v != 0.0));
        let all = self.members.iter().zip(&linearized.columns);
        all.filter(|(_, columns)| acts(columns)).map(|(member, _)| member.family).collect()
    }

    /// Only the columns of the uncertain values.
    pub(crate) fn of_uncertain(&self, linearized: &Linearized) -> Linearized {
        let first = 1 + self.parameters() - self.uncertain.len();
        let own = |columns: &Vec<Column>| -> Vec<Column> {
            columns.iter().enumerate().map(|(i, c)| if i < first { Vec::new() } else { c.clone() }).collect()
        };
        Linearized { columns: linearized.columns.iter().map(own).collect(), size: linearized.size.clone() }
    }

    /// Without the columns of uncertain values, which hang on the model; those of gains, each of which takes a simulation of every run,
    /// hardly do where no drive gives way.
    pub(crate) fn of_causes(&self, mut linearized: Linearized, keeps_gains: bool) -> Linearized {
        for (uncertain, p) in self.uncertain.iter().zip(self.uncertain_parameters()) {
            if !(keeps_gains && uncertain.of_servo == Some(OfServo::Gain)) {
                linearized.columns.iter_mut().for_each(|of_block| of_block[1 + p].clear());
            }
        }
        linearized
    }

    /// What is known here from the columns of uncertain values of another problem of the same runs, whose servos are tuned otherwise.
    pub(crate) fn known_from(&self, other: &Self, linearized: &Linearized) -> Linearized {
        let rows = |problem: &Self| -> Vec<_> {
            problem.members.iter().map(|m| (m.run, m.family, m.block.measured().len())).collect()
        };
        if rows(self) != rows(other) || self.parameters() != other.parameters() {
            return Linearized::default();
        }
        let mut known = other.of_uncertain(linearized);
        for (own, p) in self.uncertain.iter().zip(self.uncertain_parameters()) {
            // What one gain of a servo does hangs on its others.
            let mut of_joint = (0..self.uncertain.len()).filter(|i| self.uncertain[*i].index == own.index);
            if !of_joint.all(|i| self.tuning.is_like(&other.tuning, i)) {
                known.columns.iter_mut().for_each(|of_block| of_block[1 + p].clear());
            }
        }
        known
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.members.is_empty()
    }

    /// Number of parameters: coordinates of causes and uncertain values.
    pub(crate) fn parameters(&self) -> usize {
        self.spikes.len()
    }

    /// Deviations of parameters' spikes in a linearization.
    pub(crate) fn spikes_of(&self, linearized: &Linearized, parameters: &[usize]) -> Vec<f64> {
        let is_present = |p: usize| linearized.size.get(p).is_some_and(|size| *size != 0.0);
        parameters.iter().map(|p| if is_present(*p) { self.spikes_about[*p] } else { self.spikes[*p] }).collect()
    }

    /// Parameters of a candidate.
    pub(crate) fn parameters_of(&self, candidate: usize) -> std::ops::Range<usize> {
        self.first[candidate]..self.first[candidate] + self.candidates[candidate].size
    }

    /// Parameters of the uncertain values.
    pub(crate) fn uncertain_parameters(&self) -> std::ops::Range<usize> {
        self.parameters() - self.uncertain.len()..self.parameters()
    }

    /// The plant's own effects and those of a model.
    pub(crate) fn effects(&self, model: &[Present]) -> Vec<Effect> {
        self.effects_of(&self.plant, model)
    }

    /// The same of this plant with other values.
    pub(crate) fn effects_of(&self, plant: &Plant, model: &[Present]) -> Vec<Effect> {
        let news: Vec<Effect> = model.iter().flat_map(|p| self.candidates[p.candidate].at(&p.coordinates)).collect();
        let replaced = |e: &Effect| news.iter().any(|n| is_same(n, e));
        plant.effects.iter().filter(|e| !replaced(e)).cloned().chain(news.iter().cloned()).collect()
    }
}

fn span_s(block: &dyn Block) -> f64 {
    let t = block.time_of_row();
    t.last().copied().unwrap_or(0.0) - t.first().copied().unwrap_or(0.0)
}

/// Whether two are the same cause, whatever its size.
pub(crate) fn is_same(a: &Effect, b: &Effect) -> bool {
    a.id() == b.id() && a.index() == b.index() && a.channel() == b.channel() && a.id() != fss_plant::effects::UNMODELLED
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_sets_the_uncertain_value_that_does_nothing_beside_it() {
        let mut plant = Plant::default_laboratory().unwrap();
        plant.uncertainty.get_or_insert_default().coulomb_friction_n_m = 0.013;
        plant.effects.push(Effect::new("joint_coulomb_friction").unwrap().at(3).with(&[0.2]));
        let uncertain = uncertain(&plant, false);
        let sets = |id: &str, index: Option<usize>| {
            let records =
                Records { duration_s: 40.0, rates_rad_s: vec![[-1.0, 1.0]; 4], ranges_rad: vec![1.0; 4], swing: false };
            let mut all = candidates(&plant, &records);
            all.retain(|c| c.nominal.id() == id && c.nominal.index() == index);
            let value = set_values(&plant, &uncertain, &all)[0]?;
            Some((uncertain[value.uncertain].name.clone(), value.deviation))
        };
        let (name, deviation_n_m) = sets("joint_coulomb_friction", Some(2)).unwrap();
        assert_eq!(name, "link 2 coulomb_friction_N_m");
        assert!((deviation_n_m - 0.013).abs() < 1e-12);
        assert_eq!(sets("joint_coulomb_friction", Some(3)), None, "an effect of the plant file has set it");
        // A share of whatever the constant is sets none, and one valve's time leaves the others'.
        assert_eq!(sets("torque_constant", Some(2)), None);
        assert_eq!(sets("thruster_rise_time", Some(2)), None);
        assert_eq!(sets("thruster_rise_time", None).unwrap().0, "valves rise_s");
    }
}
