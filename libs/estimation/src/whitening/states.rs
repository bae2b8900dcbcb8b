//! States of the filter with what every column says of them, and what it does to them in place.

use super::Step;
use multiversion::multiversion;

/// Numbers that are added together: rows are padded to a multiple of it.
const LANES: usize = 8;

/// Means and covariance of the states.
#[derive(Debug)]
pub(super) struct States {
    rows: Rows,
    updates: Updates,
    transition: Transition,
}

/// A row of each state: its covariance with every state, then its mean in every column. What the filter does to the covariance from
/// the left, it does to the means.
#[derive(Debug)]
struct Rows {
    count: usize,
    values: Vec<f64>,
    /// Length of a row, and of the covariances at its beginning.
    stride: usize,
    lead: usize,
}

/// What the last measurements say of the states, not yet in the states' rows: to the row of state i comes the sum of `gain[i] row` over
/// the measurements. Several are brought there at once.
#[derive(Debug)]
struct Updates {
    count: usize,
    /// Of each measurement a row as long as the states' rows: its covariance with the states over its standard deviation, then the
    /// columns' expected values.
    gains: Vec<f64>,
    rows: Vec<f64>,
}

/// Measurements whose updates wait at the most.
const TOGETHER: usize = 4;

/// A transition as operations that are done in place: states gain from others, then those that do not are scaled.
#[derive(Debug, Default)]
struct Transition {
    gains: Vec<Gain>,
    /// Factor of each state at the end.
    scale: Vec<f64>,
    /// Elements beside the diagonal in order of rows, and the rows that have any.
    beside: Vec<(usize, usize, f64)>,
    is_mixed: Vec<bool>,
    kept: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
enum Gain {
    /// A state is scaled first.
    Scaled(usize, f64),
    /// To a state so many times another one.
    From(usize, usize, f64),
    /// A state that others gain from later as it was is kept in a place.
    Kept(usize, usize),
    /// To a state so many times what is kept in a place.
    FromKept(usize, usize, f64),
}

impl States {
    /// Means of 0 of so many columns, and a covariance, n x n, row-major.
    pub(super) fn new(count: usize, covariance: &[f64], columns: usize) -> Self {
        let lead = count.next_multiple_of(LANES);
        let stride = lead + columns.next_multiple_of(LANES);
        let mut values = vec![0.0; count * stride];
        for (row, covariance) in values.chunks_exact_mut(stride).zip(covariance.chunks_exact(count)) {
            row[..count].copy_from_slice(covariance);
        }
        let updates = Updates { count: 0, gains: vec![0.0; TOGETHER * stride], rows: vec![0.0; TOGETHER * stride] };
        Self { rows: Rows { count, values, stride, lead }, updates, transition: Transition::default() }
    }

    pub(super) fn advance(&mut self, step: &Step) {
        self.updates.bring(&mut self.rows);
        self.transition.set(&step.transition, &self.rows);
        advance(&mut self.transition, &step.noise, &mut self.rows);
    }

    /// Values of the columns become their innovations over the standard deviation; returns its square.
    pub(super) fn measure(&mut self, values: &mut [f64], measured: &[(usize, f64)], noise: f64) -> f64 {
        if self.updates.count == TOGETHER {
            self.updates.bring(&mut self.rows);
        }
        measure((values, measured, noise), &self.rows, &mut self.updates)
    }
}

impl Transition {
    /// Takes over the elements of a matrix.
    fn set(&mut self, elements: &[(usize, usize, f64)], states: &Rows) {
        let Self { gains, scale, beside, is_mixed, kept } = self;
        gains.clear();
        beside.clear();
        scale.clear();
        scale.resize(states.lead, 0.0);
        is_mixed.clear();
        is_mixed.resize(states.count, false);
        for &(i, j, f) in elements {
            if i == j {
                scale[i] += f;
            } else {
                beside.push((i, j, f));
                is_mixed[i] = true;
            }
        }
        beside.sort_unstable_by_key(|(i, ..)| *i);
        let mut places = 0;
        for of_state in beside.chunk_by(|a, b| a.0 == b.0) {
            let state = of_state[0].0;
            if beside.iter().any(|(i, j, _)| *i > state && *j == state) {
                gains.push(Gain::Kept(state, places));
                places += 1;
            }
            if scale[state] != 1.0 {
                gains.push(Gain::Scaled(state, scale[state]));
                scale[state] = 1.0;
            }
            for &(_, from, by) in of_state {
                let place = |gain: &Gain| match gain {
                    Gain::Kept(of, place) if *of == from => Some(*place),
                    _ => None,
                };
                let kept = if from < state && is_mixed[from] { gains.iter().find_map(place) } else { None };
                gains.push(kept.map_or(Gain::From(state, from, by), |place| Gain::FromKept(state, place, by)));
            }
        }
        kept.resize(places * states.stride, 0.0);
    }
}

/// `to += by from`, both of a length that is a multiple of [`LANES`].
#[allow(clippy::inline_always)] // Into functions for the processor at hand.
#[inline(always)]
fn add_scaled(to: &mut [f64], by: f64, from: &[f64]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += by * from);
}

impl Updates {
    /// Into the states' rows.
    fn bring(&mut self, states: &mut Rows) {
        if self.count > 0 {
            // What was left of earlier ones adds nothing.
            self.gains[self.count * states.stride..].fill(0.0);
            add_updates(states, self);
            self.count = 0;
        }
    }
}

/// An innovation over its standard deviation, and what it says of the states; returns its variance.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn measure(
    (values, measured, noise): (&mut [f64], &[(usize, f64)], f64),
    states: &Rows,
    Updates { count, gains, rows }: &mut Updates,
) -> f64 {
    let (stride, lead) = (states.stride, states.lead);
    let (before, gain) = gains.split_at_mut(*count * stride);
    let gain = &mut gain[..stride];
    gain.fill(0.0);
    // The covariance is symmetric: a row is a column. The same sum of the means is what the row was expected to be.
    for &(state, coefficient) in measured {
        add_scaled(gain, coefficient, &states.values[state * stride..(state + 1) * stride]);
    }
    for (before, row) in before.chunks_exact(stride).zip(rows.chunks_exact(stride)) {
        add_scaled(gain, measured.iter().map(|(state, c)| c * before[*state]).sum(), row);
    }
    let variance = measured.iter().map(|(state, c)| c * gain[*state]).sum::<f64>() + noise;
    let over_sd = 1.0 / variance.sqrt();
    let update = &mut rows[*count * stride..(*count + 1) * stride];
    for ((value, expected), update) in values.iter_mut().zip(&gain[lead..]).zip(&mut update[lead..]) {
        *value = (*value - expected) * over_sd;
        *update = *value;
    }
    for (gain, update) in gain[..lead].iter_mut().zip(update) {
        *gain *= over_sd;
        *update = -*gain;
    }
    *count += 1;
    variance
}

#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn add_updates(states: &mut Rows, updates: &Updates) {
    let stride = states.stride;
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| &updates.rows[k * stride..(k + 1) * stride]);
    for (i, row) in states.values.chunks_exact_mut(stride).enumerate() {
        let by: [f64; TOGETHER] = std::array::from_fn(|k| updates.gains[k * stride + i]);
        for ((((to, a), b), c), d) in row.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *to += (by[0] * a + by[1] * b) + (by[2] * c + by[3] * d);
        }
    }
}

/// `P <- F P F' + Q`, kept symmetric, and `m <- F m`.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn advance(transition: &mut Transition, noise: &[(usize, usize, f64)], states: &mut Rows) {
    let (stride, lead) = (states.stride, states.lead);
    let (rows, kept) = (&mut states.values, &mut transition.kept);
    for gain in &transition.gains {
        match *gain {
            Gain::Scaled(to, by) => rows[to * stride..(to + 1) * stride].iter_mut().for_each(|v| *v *= by),
            Gain::From(to, from, by) => {
                let (to, from) = two_rows(rows, stride, to, from);
                add_scaled(to, by, from);
            }
            Gain::Kept(from, place) => {
                kept[place * stride..(place + 1) * stride].copy_from_slice(&rows[from * stride..(from + 1) * stride]);
            }
            Gain::FromKept(to, place, by) => {
                add_scaled(&mut rows[to * stride..(to + 1) * stride], by, &kept[place * stride..(place + 1) * stride]);
            }
        }
    }
    for (row, by) in rows.chunks_exact_mut(stride).zip(&transition.scale).filter(|(_, by)| **by != 1.0) {
        for value in row {
            *value *= by;
        }
    }
    for gain in &transition.gains {
        let rows = rows.chunks_exact_mut(stride);
        match *gain {
            Gain::Scaled(to, by) => rows.for_each(|row| row[to] *= by),
            Gain::From(to, from, by) => rows.for_each(|row| row[to] += by * row[from]),
            Gain::Kept(from, place) => rows.zip(&mut kept[place * stride..]).for_each(|(row, kept)| *kept = row[from]),
            Gain::FromKept(to, place, by) => {
                rows.zip(&kept[place * stride..]).for_each(|(row, kept)| row[to] += by * kept);
            }
        }
    }
    for row in rows.chunks_exact_mut(stride) {
        row[..lead].iter_mut().zip(&transition.scale).for_each(|(v, by)| *v *= by);
    }
    for &(i, j, q) in noise {
        rows[i * stride + j] += q;
    }
    for i in 1..states.count {
        let (before, own) = rows.split_at_mut(i * stride);
        own[..i].iter_mut().zip(before[i..].iter().step_by(stride)).for_each(|(own, other)| *own = *other);
    }
}

/// Two rows that are not the same.
#[allow(clippy::inline_always)] // As above.
#[inline(always)]
fn two_rows(rows: &mut [f64], stride: usize, to: usize, from: usize) -> (&mut [f64], &[f64]) {
    let (before, after) = rows.split_at_mut(to.max(from) * stride);
    let (first, second) = (&mut before[to.min(from) * stride..][..stride], &mut after[..stride]);
    if to < from { (first, second) } else { (second, first) }
}
