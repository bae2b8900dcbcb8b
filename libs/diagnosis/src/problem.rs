//! The runs as blocks, the possible causes and uncertain values, and the columns that they give: linearize, then whiten.

use crate::base::BaseBlock;
use crate::block::{Block, HyperParameter, VARIATION};
use crate::candidates::{Candidate, Records, candidates};
use crate::joint_telemetry::{rate_variance, rates};
use crate::joints::joint_block_with;
pub(crate) use crate::linearized::{Kept, Linearized, Slope, difference};
use crate::servo_response::datagrams;
use crate::tuning::Tuning;
use crate::uncertain::{Uncertain, uncertain};
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant, Response};
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

/// Share of its typical size above which a coordinate's secant through zero is taken, not a probe.
const SECANT_ABOVE: f64 = 0.05;
/// Step of a tangent over the probe's size.
const TANGENT_STEP: f64 = 0.4;
/// The same of a spring's coordinate over its size: a swing's frequency stays almost what it is.
const SPRING_STEP: f64 = 0.05;

/// Everything that is linear: runs, causes, uncertain values.
#[derive(Clone)]
pub(crate) struct Problem {
    pub(crate) plant_file: Plant,
    /// The plant of the plant file, its servos tuned as the runs show.
    pub(crate) plant: Plant,
    tuning: Tuning,
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
        let uncertain = uncertain(plant);
        let values = uncertain.iter().enumerate();
        let tuned = values.fold(plant.clone(), |plant, (i, value)| match tuning.by(i) {
            0.0 => plant,
            by => value.moved(&plant, by),
        });
        let members = members(&tuned, runs)?;
        let duration_s = members.iter().map(|m| span_s(m.block.as_ref())).fold(1.0, f64::max);
        let swing = runs.iter().any(|run| datagrams(plant, run).is_some());
        let candidates = candidates(plant, &Records { duration_s, rates_rad_s: rates(plant, runs), swing });
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
        spikes.extend(uncertain.iter().map(|_| 1.0));
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
        (other.candidates, other.first, other.spikes) =
            (self.candidates.clone(), self.first.clone(), self.spikes.clone());
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

    /// Whether a candidate's columns in a block serve the first look at all candidates: a law's are many, and show in the base.
    pub(crate) fn at_first(&self, candidate: usize, member: &Member) -> bool {
        let is_law = self.candidates[candidate].is_law;
        let shows = !is_law || Some(member.family) == self.members.iter().map(|m| m.family).min();
        shows && self.seen_in[candidate].is_none_or(|run| run == member.run)
    }

    /// Families of blocks in which a candidate acts.
    pub(crate) fn families(&self, linearized: &Linearized, candidate: usize) -> Vec<usize> {
        let acts =
            |columns: &Vec<Vec<f64>>| self.parameters_of(candidate).any(|p| columns[p + 1].iter().any(|v| *v != 0.0));
        let all = self.members.iter().zip(&linearized.columns);
        all.filter(|(_, columns)| acts(columns)).map(|(member, _)| member.family).collect()
    }

    /// Only the columns of the uncertain values.
    pub(crate) fn of_uncertain(&self, linearized: &Linearized) -> Linearized {
        let first = 1 + self.parameters() - self.uncertain.len();
        let own = |columns: &Vec<Vec<f64>>| -> Vec<Vec<f64>> {
            columns.iter().enumerate().map(|(i, c)| if i < first { Vec::new() } else { c.clone() }).collect()
        };
        Linearized { columns: linearized.columns.iter().map(own).collect(), size: linearized.size.clone() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.members.is_empty()
    }

    /// Number of parameters: coordinates of causes and uncertain values.
    pub(crate) fn parameters(&self) -> usize {
        self.spikes.len()
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
        let news: Vec<Effect> = model.iter().flat_map(|p| self.candidates[p.candidate].at(&p.coordinates)).collect();
        let replaced = |e: &Effect| news.iter().any(|n| is_same(n, e));
        self.plant.effects.iter().filter(|e| !replaced(e)).cloned().chain(news.iter().cloned()).collect()
    }

    /// Linearizes every block about a model. Candidates that are not `wanted` in a block keep the columns that they had, or get
    /// none.
    pub(crate) fn linearized(
        &self,
        model: &[Present],
        slope: Slope,
        wanted: &(dyn Fn(usize, &Member) -> bool + Sync),
        kept: Kept,
    ) -> Result<Linearized, ModelError> {
        let keeps_uncertain = matches!(kept, Kept::All(_));
        let before = match kept {
            Kept::Nothing => vec![vec![Vec::new(); 1 + self.parameters()]; self.members.len()],
            Kept::Causes(before) | Kept::All(before) => before.columns,
        };
        let columns = self.members.par_iter().zip(before);
        let columns = columns.map(|(m, before)| {
            let wanted: Vec<bool> = (0..self.candidates.len()).map(|c| wanted(c, m)).collect();
            self.columns(m.block.as_ref(), (model, slope), (&wanted, !keeps_uncertain), before)
        });
        let mut size = vec![0.0; self.parameters()];
        let continuous = |p: &&Present| self.candidates[p.candidate].prior.response != Response::Discrete;
        for present in model.iter().filter(continuous) {
            let own = self.parameters_of(present.candidate).zip(&present.coordinates);
            own.for_each(|(p, value)| size[p] = value.abs());
        }
        Ok(Linearized { columns: columns.collect::<Result<_, _>>()?, size })
    }

    fn columns(
        &self,
        block: &dyn Block,
        (model, slope): (&[Present], Slope),
        (wanted, wants_uncertain): (&[bool], bool),
        mut columns: Vec<Vec<f64>>,
    ) -> Result<Vec<Vec<f64>>, ModelError> {
        block.forget();
        let plant = &self.plant;
        let base = block.predict(plant, &self.effects(model))?;
        let mut data: Vec<f64> = block.measured().iter().zip(&base).map(|(y, p)| y - p).collect();
        for candidate in 0..self.candidates.len() {
            if !wanted[candidate] {
                continue;
            }
            let present = model.iter().find(|p| p.candidate == candidate);
            let own = self.candidate_columns(block, (plant, model), slope, candidate, &base)?;
            for (i, column) in own.into_iter().enumerate() {
                let theta = present.map_or(0.0, |p| p.coordinates[i]);
                if theta != 0.0 {
                    data.iter_mut().zip(&column).for_each(|(d, c)| *d += theta * c);
                }
                columns[1 + self.first[candidate] + i] = column;
            }
        }
        let effects = self.effects(model);
        for (i, (value, at)) in self.uncertain.iter().zip(self.uncertain_parameters()).enumerate() {
            if wants_uncertain {
                columns[1 + at] = difference(&block.predict(&value.moved(plant, 1.0), &effects)?, &base, 1.0);
            }
            let now = self.tuning.by(i);
            if now != 0.0 {
                data.iter_mut().zip(&columns[1 + at]).for_each(|(d, c)| *d += now * c);
            }
        }
        columns[0] = data;
        Ok(columns)
    }

    /// A column for each coordinate of a candidate: secants through zero where the model has it, probes where not.
    fn candidate_columns(
        &self,
        block: &dyn Block,
        (plant, model): (&Plant, &[Present]),
        slope: Slope,
        candidate: usize,
        base: &[f64],
    ) -> Result<Vec<Vec<f64>>, ModelError> {
        let own = &self.candidates[candidate];
        let zero = vec![0.0; own.size];
        let now = model.iter().find(|p| p.candidate == candidate).map_or(&zero, |p| &p.coordinates);
        // The same effect with another shape makes way.
        let makes_way = |p: &Present| {
            let other = &self.candidates[p.candidate];
            let is_discrete = own.prior.response == Response::Discrete;
            p.candidate != candidate && !is_discrete && is_same(&other.nominal, &own.nominal)
        };
        let others: Vec<Present> =
            model.iter().filter(|p| p.candidate != candidate && !makes_way(p)).cloned().collect();
        let predict = |coordinates: &[f64]| {
            let mut other = others.clone();
            other.push(Present { candidate, coordinates: coordinates.to_vec() });
            block.predict(plant, &self.effects(&other))
        };
        let without = if model.iter().any(makes_way) { Some(predict(&zero)?) } else { None };
        let base = without.as_deref().unwrap_or(base);
        let moved = |from: &[f64], i: usize, to: f64| {
            let mut coordinates = from.to_vec();
            coordinates[i] = to;
            coordinates
        };
        if own.prior.response == Response::Discrete {
            let there = predict(&[1.0])?;
            let absent = if now[0] == 0.0 { None } else { Some(predict(&zero)?) };
            return Ok(vec![
                absent.map_or_else(|| difference(&there, base, 1.0), |absent| difference(base, &absent, 1.0)),
            ]);
        }
        if slope == Slope::Tangent && own.prior.response != Response::Strength {
            let is_spring = own.prior.response == Response::Inverse;
            let step = |i: usize| if is_spring { SPRING_STEP * now[i] } else { TANGENT_STEP * own.probe(i) };
            let tangent = |i: usize| Ok(difference(&predict(&moved(now, i, now[i] + step(i)))?, base, step(i)));
            return (0..own.size).map(tangent).collect();
        }
        let is_strength = own.prior.response == Response::Strength && !own.is_law;
        let strength = if now[0] == 0.0 { own.probe(0) } else { now[0] };
        let mut columns = Vec::with_capacity(own.size);
        // Of a strength with places: the strength alone, at the places 0.
        let alone = if is_strength { Some(predict(&moved(&zero, 0, strength))?) } else { None };
        for i in 0..own.size {
            let significant = now[i].abs() > SECANT_ABOVE * own.prior.typical[i];
            columns.push(match &alone {
                Some(alone) if i == 0 => difference(alone, &predict(&zero)?, strength),
                _ if significant => difference(base, &predict(&moved(now, i, 0.0))?, now[i]),
                Some(alone) => difference(&predict(&moved(&moved(&zero, 0, strength), i, strength))?, alone, strength),
                None => difference(&predict(&moved(now, i, now[i] + own.probe(i)))?, base, own.probe(i)),
            });
        }
        Ok(columns)
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
