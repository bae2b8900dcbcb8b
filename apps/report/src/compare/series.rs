//! The fields of a log as series over time.

use fss_messages::{Definition, Field, Header, MissionState, Scalar, topic};
use fss_multibody::wrapped;
use fss_records::log::{Log, LogError, definition_of};
use std::collections::BTreeMap;

/// Topics that tell of processes and packets, not of the flight, or on which several speak at the same time.
const LEFT_OUT: &[&str] = &["/health", "/steps", "/events", "/links/telemetry", "/parameters/state"];
/// Two samples that are further apart than this many usual periods have nothing in between.
const LONGEST_GAP_PERIODS: f64 = 5.0;

/// What a log tells of a flight.
pub(super) struct Flight {
    /// All fields of all topics.
    pub series: Vec<Series>,
    /// When the mission began, ns on the log's clock.
    pub mission_ns: Option<u64>,
    /// What is taken off the log's times, ns.
    zero_ns: u64,
    shift_s: f64,
}

/// One field over time.
pub(super) struct Series {
    topic: String,
    field: String,
    is_real: bool,
    is_angle: bool,
    /// When the samples are of, ns on the log's clock.
    stamps_ns: Vec<u64>,
    /// The same on the common clock, s.
    times_s: Vec<f64>,
    values: Vec<f64>,
    gap_s: f64,
}

impl Flight {
    /// Reads all topics of a vehicle by the schemas that the log has of them, those of services from elsewhere as well.
    ///
    /// # Errors
    /// Where the log cannot be read, or a schema is none of plain samples.
    pub(super) fn read(log: &Log, vehicle: &str) -> Result<Self, LogError> {
        let prefix = if vehicle.is_empty() { String::new() } else { format!("/{vehicle}") };
        let mission = log.samples::<MissionState>(&format!("{prefix}{}", topic::MISSION_STATE.name))?;
        let mut topics = BTreeMap::<String, Read>::new();
        let mut refused = None;
        log.for_each(|channel, _, sample| {
            let Some(name) = channel.topic.strip_prefix(&prefix).filter(|name| !LEFT_OUT.contains(name)) else {
                return;
            };
            if !topics.contains_key(name) {
                match definition_of(channel) {
                    Ok(definition) => drop(topics.insert(name.to_owned(), Read { definition, bytes: Vec::new() })),
                    Err(reason) => refused = Some((channel.topic.clone(), reason)),
                }
            }
            let Some(read) = topics.get_mut(name) else { return };
            read.bytes.extend(sample.get(..read.definition.size).unwrap_or_default());
        })?;
        if let Some((topic, reason)) = refused {
            return Err(LogError::Schema { path: log.path().to_owned(), topic, reason });
        }
        let running = mission.iter().find(|state| state.state == MissionState::RUNNING);
        let mission_ns = running.map(|state| state.phase_start_ns);
        let series = topics.iter().flat_map(|(topic, read)| read.series(topic)).collect();
        let mut flight = Self { series, mission_ns, zero_ns: 0, shift_s: 0.0 };
        flight.set_zero(0, 0.0);
        Ok(flight)
    }

    /// The first stamp of all, ns.
    pub(super) fn first_ns(&self) -> u64 {
        self.series.iter().filter_map(|series| series.stamps_ns.first()).min().copied().unwrap_or(0)
    }

    /// Counts time from `zero_ns` on the log's clock, and `shift_s` later.
    pub(super) fn set_zero(&mut self, zero_ns: u64, shift_s: f64) {
        (self.zero_ns, self.shift_s) = (zero_ns, shift_s);
        for series in &mut self.series {
            let since_zero = |ns: &u64| (i128::from(*ns) - i128::from(zero_ns)) as f64 * 1e-9 + shift_s;
            series.times_s = series.stamps_ns.iter().map(since_zero).collect();
        }
    }

    /// Shifts all times by this much more.
    pub(super) fn shift(&mut self, by_s: f64) {
        self.set_zero(self.zero_ns, self.shift_s + by_s);
    }

    /// First and last time, s.
    pub(super) fn span_s(&self) -> [f64; 2] {
        let ends = self.series.iter().filter_map(|s| Some([*s.times_s.first()?, *s.times_s.last()?]));
        ends.fold([f64::INFINITY, f64::NEG_INFINITY], |span, end| [span[0].min(end[0]), span[1].max(end[1])])
    }

    /// The field of this topic and name.
    pub(super) fn named(&self, name: &str) -> Option<&Series> {
        self.series.iter().find(|series| series.name() == name)
    }
}

impl Series {
    /// Topic and field: `/nav/state.x_m`.
    pub(super) fn name(&self) -> String {
        format!("{}.{}", self.topic, self.field)
    }

    /// Whether a person means this one: by its topic, its field, both, or a field that is one of several.
    pub(super) fn is_called(&self, name: &str) -> bool {
        let stem = self.field.split('.').next().unwrap_or_default();
        let in_topic =
            |field: &str| name.strip_prefix(&self.topic).and_then(|rest| rest.strip_prefix('.')) == Some(field);
        name == self.topic || name == self.field || name == stem || in_topic(&self.field) || in_topic(stem)
    }

    /// Largest magnitude of all values.
    pub(super) fn largest_magnitude(&self) -> f64 {
        self.values.iter().fold(0.0, |largest, value| f64::max(largest, value.abs()))
    }

    /// Times and values between two times.
    pub(super) fn within(&self, [from_s, to_s]: [f64; 2]) -> impl Iterator<Item = (f64, f64)> {
        let all = self.times_s.iter().copied().zip(self.values.iter().copied());
        all.filter(move |(time_s, _)| (from_s..=to_s).contains(time_s))
    }

    /// The value at a time: a number between its neighbours, what counts or names something as it was last said. None
    /// before the first sample, after the last, and in a gap.
    pub(super) fn at(&self, time_s: f64) -> Option<f64> {
        const SAME_S: f64 = 1e-9;
        let next = self.times_s.partition_point(|t| *t < time_s - SAME_S);
        let (after_s, after) = (*self.times_s.get(next)?, self.values[next]);
        if (after_s - time_s).abs() <= SAME_S {
            return Some(after);
        }
        let before = next.checked_sub(1)?;
        let (before_s, before) = (self.times_s[before], self.values[before]);
        if after_s - before_s > self.gap_s {
            return None;
        }
        if !self.is_real {
            return Some(before);
        }
        Some(before + self.apart(before, after) * (time_s - before_s) / (after_s - before_s))
    }

    /// How much one value is more than another; of angles the shorter way around.
    pub(super) fn apart(&self, value: f64, other: f64) -> f64 {
        let apart = other - value;
        if self.is_angle { wrapped(apart) } else { apart }
    }
}

/// A topic's samples, one behind the other.
struct Read {
    definition: Definition,
    bytes: Vec<u8>,
}

impl Read {
    fn series(&self, topic: &str) -> Vec<Series> {
        let mut samples: Vec<(u64, &[u8])> = self
            .bytes
            .chunks_exact(self.definition.size)
            .filter_map(|sample| Some((Header::of_sample(sample)?.stamp_ns, sample)))
            .collect();
        samples.sort_by_key(|(stamp_ns, _)| *stamp_ns);
        let stamps_ns: Vec<u64> = samples.iter().map(|(stamp_ns, _)| *stamp_ns).collect();
        let gap_s = LONGEST_GAP_PERIODS * usual_period_s(&stamps_ns);
        let told = |field: &&Field<String>| {
            !field.name.ends_with("_ns") && !field.name.ends_with("sequence") && !field.is_padding() && !field.is_text()
        };
        let fields = self.definition.fields.iter().filter(told);
        let each = fields.flat_map(|field| (0..field.count.unwrap_or(1)).map(move |i| (field, i)));
        each.map(|(field, i)| Series {
            topic: topic.to_owned(),
            field: field.count.map_or_else(|| field.name.clone(), |_| format!("{}.{i}", field.name)),
            is_real: field.scalar == Scalar::F64,
            is_angle: field.name.ends_with("_rad"),
            stamps_ns: stamps_ns.clone(),
            times_s: Vec::new(),
            values: samples.iter().filter_map(|(_, sample)| field.number(i, sample)).collect(),
            gap_s,
        })
        .collect()
    }
}

/// The median time from one sample to the next.
fn usual_period_s(stamps_ns: &[u64]) -> f64 {
    let mut periods: Vec<u64> = stamps_ns.windows(2).map(|pair| pair[1] - pair[0]).collect();
    periods.sort_unstable();
    periods.get(periods.len() / 2).map_or(1.0, |ns| *ns as f64 * 1e-9)
}
