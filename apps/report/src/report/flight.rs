//! What a log holds of a flight, on one clock that starts with the log.

use crate::drawing::scene::{Moment, Table, goal};
use crate::drawing::strips::Span;
use fss_launcher::stack::Stack;
use fss_launcher::summary::Records;
use fss_messages::{LinksState, MocapPose, Sample, ThrustersState, topic};
use fss_multibody::Model;
use fss_plant::scene::{Posture, mask};
use fss_records::log::{Log, Samples};
use miette::{IntoDiagnostic, Result};
use std::collections::BTreeMap;

/// Moments of a log without truth are so far apart, ns.
const MOMENT_NS: u64 = 20_000_000;

/// A flight as its log tells it.
pub struct Flight {
    /// The files that flew.
    pub stack: Stack,
    /// The plant's nominal model.
    pub model: Model,
    /// Build, host, clock, seed.
    pub facts: BTreeMap<String, String>,
    /// What the recorder says it lost, by topic.
    pub lost: Vec<(String, u64)>,
    /// Whether the log was ended properly.
    pub is_complete: bool,
    /// Truth, navigation, mission, arm, health, events.
    pub records: Records,
    /// Telemetry of the links.
    pub links: Vec<LinksState>,
    /// Valves at their driver.
    pub valves: Vec<ThrustersState>,
    /// Motion capture of the target.
    pub target: Vec<MocapPose>,
    zero_ns: u64,
}

impl Flight {
    /// Reads a log.
    ///
    /// # Errors
    /// Names what is wrong with it or missing.
    pub fn read(log: &Log) -> Result<Self> {
        let stack = Stack::of_log(log)?;
        let vehicle = stack.launch.vehicle.clone();
        let name = |topic: &str| if vehicle.is_empty() { topic.to_owned() } else { format!("/{vehicle}{topic}") };
        let records = Records::of(log, &vehicle).into_diagnostic()?;
        let mut links = Samples::of(&name(topic::LINKS_STATE.name));
        let mut valves = Samples::of(&name(topic::THRUSTERS_STATE.name));
        let mut target = Samples::of(&name(topic::MOCAP_TARGET.name));
        log.collect(&mut [&mut links, &mut valves, &mut target]).into_diagnostic()?;
        let kept = log.metadata("fss-recorder").into_diagnostic()?.unwrap_or_default();
        let lost = kept.iter().filter_map(|(key, count)| {
            Some((key.strip_prefix("lost ")?.to_owned(), count.parse().ok().filter(|count| *count > 0)?))
        });
        Ok(Self {
            model: stack.plant.nominal().model().into_diagnostic()?,
            facts: log.metadata("fss").into_diagnostic()?.unwrap_or_default(),
            lost: lost.collect(),
            is_complete: log.is_complete(),
            zero_ns: records.span_ns()[0],
            stack,
            records,
            links: links.samples,
            valves: valves.samples,
            target: target.samples,
        })
    }

    /// A time of the log, s.
    pub fn seconds(&self, ns: u64) -> f64 {
        ns.saturating_sub(self.zero_ns) as f64 * 1e-9
    }

    /// First and last time, s.
    pub fn span_s(&self) -> [f64; 2] {
        self.records.span_ns().map(|ns| self.seconds(ns))
    }

    /// Values of samples over time.
    pub fn series<T: Sample>(&self, samples: &[T], of: impl Fn(&T) -> f64) -> Vec<(f64, f64)> {
        samples.iter().map(|sample| (self.seconds(sample.header().stamp_ns), of(sample))).collect()
    }

    /// Whether it was flown in the simulated laboratory.
    pub fn has_truth(&self) -> bool {
        !self.records.truth().is_empty()
    }

    /// When the gripper took the target, s.
    pub fn grasp_s(&self) -> Option<f64> {
        let grasp_ns = self.records.truth().last().map(|t| t.grasp_ns)?;
        (grasp_ns > 0).then(|| self.seconds(grasp_ns))
    }

    /// What is on the table.
    pub fn table(&self) -> Table<'_> {
        let target = self.stack.mission.target.as_ref().map(|target| &target.body);
        Table { plant: &self.stack.plant, model: &self.model, target }
    }

    /// Where everything was: from the truth, or from what the stack believed.
    pub fn moments(&self) -> Vec<Moment> {
        if self.has_truth() {
            let table = self.table();
            let truth = self.records.truth().iter();
            return truth.map(|t| Moment::of_truth(t, self.zero_ns, &table, self.records.arm())).collect();
        }
        let seen: Vec<&MocapPose> = self.target.iter().filter(|pose| pose.quality == MocapPose::VALID).collect();
        let mut next_ns = 0;
        let mut moments = Vec::new();
        for nav in self.records.nav() {
            let links = self.links.partition_point(|l| l.stamp_ns <= nav.stamp_ns);
            if nav.stamp_ns < next_ns || links == 0 {
                continue;
            }
            next_ns = nav.stamp_ns + MOMENT_NS;
            let at = seen.partition_point(|pose| pose.stamp_ns <= nav.stamp_ns);
            let target = at.checked_sub(1).map(|i| [seen[i].x_m, seen[i].y_m, seen[i].theta_rad]);
            let vehicle = Posture::of(&self.model, [nav.x_m, nav.y_m, nav.theta_rad], &self.links[links - 1].q_rad);
            let open = self.valves.partition_point(|v| v.stamp_ns <= nav.stamp_ns).checked_sub(1);
            let pushing = open.map_or(0, |i| mask(&self.valves[i].valves));
            let goal = goal(self.records.arm(), nav.stamp_ns);
            let [x_m, y_m, _] = vehicle.arm[vehicle.arm.len() - 1];
            let posture = Posture { target, goal, pushing, ..vehicle };
            moments.push(Moment { t_s: self.seconds(nav.stamp_ns), end_effector_m: [x_m, y_m], posture });
        }
        moments
    }

    /// The phases as they were flown.
    pub fn phases(&self) -> Vec<Span> {
        let mut spans: Vec<Span> = Vec::new();
        let mut last = None;
        for state in self.records.states() {
            let at_s = self.seconds(state.stamp_ns);
            if let Some(span) = spans.last_mut() {
                span.during_s[1] = at_s;
            }
            let key = (state.state, state.phase);
            if last != Some(key) {
                last = Some(key);
                spans.push(Span { during_s: [at_s, at_s], name: self.stack.phase_name(state) });
            }
        }
        spans
    }

    /// When each valve was open, s.
    pub fn openings(&self) -> Vec<(String, Vec<[f64; 2]>)> {
        let count = self.stack.plant.thrusters.len();
        let mut rows: Vec<(String, Vec<[f64; 2]>)> = (1..=count).map(|k| (k.to_string(), Vec::new())).collect();
        let mut opened: Vec<Option<f64>> = vec![None; count];
        for state in &self.valves {
            let at_s = self.seconds(state.stamp_ns);
            for (k, row) in rows.iter_mut().enumerate() {
                match (state.valves[k] != 0, opened[k]) {
                    (true, None) => opened[k] = Some(at_s),
                    (false, Some(from_s)) => {
                        row.1.push([from_s, at_s]);
                        opened[k] = None;
                    }
                    _ => {}
                }
            }
        }
        let end_s = self.span_s()[1];
        for (row, from_s) in rows.iter_mut().zip(opened) {
            row.1.extend(from_s.map(|from_s| [from_s, end_s]));
        }
        rows
    }
}
