//! What happened in a run, told from its log alone.

use crate::figures::{self, CaptureFigures, CarryFigures, Rows, StopFigures};
use crate::stack::Stack;
use fss_messages::{ArmCommand, Event, Health, MissionState, NavState, Sample, TruthState, text_of, topic};
use fss_plant::Effect;
use fss_records::log::{Log, LogError, Samples, TopicInfo};
use serde::Serialize;
use std::any::Any;
use std::collections::BTreeMap;

/// A run's figures; what is not in the log is absent.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// `fss-summary/1`.
    pub format: &'static str,
    /// The mission's name.
    pub mission: String,
    /// `done`, `aborted`, or `unfinished`.
    pub outcome: &'static str,
    /// From the first to the last record, s.
    pub duration_s: f64,
    /// Effects of the plant that flew: each as its id, its index or channel, and its values.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<String>,
    /// Topics with counts and rates.
    pub topics: Vec<Topic>,
    /// How far the base turned while the arm worked: at the end and at most, degrees.
    pub base_rotation_deg: Option<Rotation>,
    /// The end-effector's motion and error.
    pub end_effector: Option<EndEffector>,
    /// Navigation against truth.
    pub navigation: Option<Navigation>,
    /// Gas used, kg.
    pub gas_used_kg: Option<f64>,
    /// What a stop took.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop: Option<StopFigures>,
    /// How a capture went.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub capture: Option<CaptureFigures>,
    /// How a target was carried and let go.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub carry: Option<CarryFigures>,
    /// Each service's cycles and overruns.
    pub services: BTreeMap<String, ServiceFigures>,
    /// What a flight that calibrates has found: `fss-calibration/1`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<serde_json::Value>,
    /// Warnings and worse.
    pub warnings: Vec<String>,
}

/// One topic.
#[derive(Debug, Serialize)]
pub struct Topic {
    /// Its name.
    #[serde(rename = "topic")]
    pub name: String,
    /// Messages in the log.
    pub count: u64,
    /// Messages a second.
    pub rate_hz: Option<f64>,
}

/// How far the base turned, from the truth.
#[derive(Debug, Serialize)]
pub struct Rotation {
    /// At the end of the mission less at its start, degrees.
    pub end_deg: f64,
    /// The largest deviation from the start, degrees.
    pub max_deg: f64,
}

/// What the end-effector did, from the truth.
#[allow(clippy::struct_field_names)] // all are lengths
#[derive(Debug, Serialize)]
pub struct EndEffector {
    /// Distance between its first and last position, m.
    pub moved_m: f64,
    /// Distance from the commanded goal at the end, m; absent where no Cartesian task was flown.
    pub final_error_m: Option<f64>,
    /// Largest distance from the commanded path, m.
    pub max_error_m: Option<f64>,
}

/// Root mean square of navigation less truth.
#[derive(Debug, Serialize)]
pub struct Navigation {
    /// Of the position, m.
    pub position_rms_m: f64,
    /// Of the heading, degrees.
    pub heading_rms_deg: f64,
    /// Largest position error, m.
    pub position_max_m: f64,
}

/// How a service kept its rate.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct ServiceFigures {
    /// Steps.
    pub cycles: u64,
    /// Steps that ended after their deadline.
    pub overruns: u64,
    /// Boundaries skipped.
    pub skipped: u64,
    /// Samples that could not be sent.
    pub dropped: u64,
    /// Starts.
    pub starts: u32,
}

/// What a log holds of a run, as far as its figures need it.
#[derive(Default)]
pub struct Records {
    topics: Vec<TopicInfo>,
    truth: Vec<TruthState>,
    nav: Vec<NavState>,
    states: Vec<MissionState>,
    arm: Vec<ArmCommand>,
    health: Vec<Health>,
    events: Vec<Event>,
}

impl Records {
    /// Reads a log whose topics carry `vehicle` in front.
    ///
    /// # Errors
    /// Where the log does not hold this build's samples.
    pub fn of(log: &Log, vehicle: &str) -> Result<Self, LogError> {
        let name = |topic: &str| if vehicle.is_empty() { topic.to_owned() } else { format!("/{vehicle}{topic}") };
        let mut truth = Samples::of(&name(topic::TRUTH_STATE.name));
        let mut nav = Samples::of(&name(topic::NAV_STATE.name));
        let mut states = Samples::of(&name(topic::MISSION_STATE.name));
        let mut arm = Samples::of(&name(topic::ARM_COMMAND.name));
        let mut health = Samples::of(&name(topic::HEALTH.name));
        let mut events = Samples::of(&name(topic::EVENTS.name));
        log.collect(&mut [&mut truth, &mut nav, &mut states, &mut arm, &mut health, &mut events])?;
        Ok(Self {
            topics: log.topics()?,
            truth: truth.samples,
            nav: nav.samples,
            states: states.samples,
            arm: arm.samples,
            health: health.samples,
            events: events.samples,
        })
    }

    /// Adds a topic; of its samples, a `Vec`, those that the figures need.
    pub fn add(&mut self, topic: TopicInfo, samples: Box<dyn Any>) {
        let at = self.topics.partition_point(|other| other.topic < topic.topic);
        self.topics.insert(at, topic);
        let _of_no_figure = put(samples, &mut self.truth)
            .or_else(|samples| put(samples, &mut self.nav))
            .or_else(|samples| put(samples, &mut self.states))
            .or_else(|samples| put(samples, &mut self.arm))
            .or_else(|samples| put(samples, &mut self.health))
            .or_else(|samples| put(samples, &mut self.events));
    }

    /// The truth from when the mission began to fly its phases.
    pub fn flown(&self) -> &[TruthState] {
        let Some(start) = self.states.iter().find(|m| m.state == MissionState::RUNNING) else { return &[] };
        &self.truth[self.truth.partition_point(|t| t.stamp_ns < start.stamp_ns)..]
    }

    /// RMS of navigation's position against truth where navigation does not call itself lost, and of how many states.
    pub fn navigation_rms_m(&self) -> Option<(f64, f64)> {
        let trusted: Vec<NavState> = self.nav.iter().copied().filter(|n| n.mode != NavState::LOST).collect();
        navigation(&trusted, &self.truth).map(|n| (n.position_rms_m, trusted.len() as f64))
    }

    /// The truth of the whole run.
    pub fn truth(&self) -> &[TruthState] {
        &self.truth
    }

    /// Where the mission stood.
    pub fn states(&self) -> &[MissionState] {
        &self.states
    }

    /// What the arm was told.
    pub fn arm(&self) -> &[ArmCommand] {
        &self.arm
    }

    /// Navigation's states.
    pub fn nav(&self) -> &[NavState] {
        &self.nav
    }

    /// What the services said of their rates.
    pub fn health(&self) -> &[Health] {
        &self.health
    }

    /// What happened.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// First and last time of the log, ns.
    pub fn span_ns(&self) -> [u64; 2] {
        let first = self.topics.iter().map(|t| t.first_ns).min().unwrap_or(0);
        [first, self.topics.iter().map(|t| t.last_ns).max().unwrap_or(0)]
    }

    /// The run's figures, with those that the mission of this stack is measured by.
    pub fn summary_of(&self, stack: &Stack) -> Summary {
        let stop = figures::stop(stack, &self.truth, &self.states);
        let capture = figures::capture(stack, &self.truth, &self.states);
        let carry = figures::carry(&self.truth, &self.states);
        let effects = stack.laboratory().effects.iter().map(Effect::in_words).collect();
        Summary { effects, stop, capture, carry, ..self.summary(&stack.mission_name) }
    }

    /// The run's figures.
    pub fn summary(&self, mission: &str) -> Summary {
        let [first_ns, last_ns] = self.span_ns();
        let flown = self.flown();
        Summary {
            format: "fss-summary/1",
            mission: mission.to_owned(),
            outcome: outcome(&self.states),
            effects: Vec::new(),
            duration_s: (last_ns - first_ns) as f64 * 1e-9,
            base_rotation_deg: rotation(flown),
            end_effector: end_effector(flown, &self.arm),
            navigation: navigation(&self.nav, &self.truth),
            gas_used_kg: self.truth.last().map(|t| t.gas_used_kg),
            stop: None,
            capture: None,
            carry: None,
            services: services(&self.health),
            calibration: None,
            warnings: warnings(&self.events, first_ns),
            topics: self
                .topics
                .iter()
                .map(|t| Topic { rate_hz: t.rate_hz(), name: t.topic.clone(), count: t.count })
                .collect(),
        }
    }
}

impl Summary {
    /// Prints topics, the table, and what was warned of.
    pub fn print(&self) {
        say!("\n{:<26} {:>8} {:>10}", "topic", "count", "rate Hz");
        for t in &self.topics {
            say!("{:<26} {:>8} {:>10}", t.name, t.count, number(t.rate_hz, 1.0, 2));
        }
        say!("");
        let warnings = self.warnings.iter().map(|warning| ("warning", warning.clone()));
        for (what, value) in self.table().into_iter().chain(warnings) {
            say!("{what:<18} {value}");
        }
    }

    /// The figures for a person.
    pub fn table(&self) -> Rows {
        let mut rows = vec![("mission", format!("{} ({}, {:.1} s)", self.mission, self.outcome, self.duration_s))];
        rows.extend(self.effects.iter().map(|effect| ("effect of the plant", effect.clone())));
        if let Some(r) = &self.base_rotation_deg {
            rows.push(("base rotation", format!("{:.3} deg at the end, {:.3} deg at most", r.end_deg, r.max_deg)));
        }
        if let Some(e) = &self.end_effector {
            let (error, worst) = (number(e.final_error_m, 1e3, 2), number(e.max_error_m, 1e3, 2));
            let moved = format!("moved {:.4} m, error {error} mm at the end, {worst} mm at most", e.moved_m);
            rows.push(("end-effector", moved));
        }
        if let Some(n) = &self.navigation {
            let (p, h) = (n.position_rms_m * 1e3, n.heading_rms_deg);
            rows.push(("navigation error", format!("{p:.3} mm and {h:.4} deg RMS against truth")));
        }
        rows.extend(self.stop.iter().flat_map(StopFigures::rows));
        rows.extend(self.capture.iter().flat_map(CaptureFigures::rows));
        rows.extend(self.carry.iter().flat_map(CarryFigures::rows));
        rows.push(("gas used", format!("{} g", number(self.gas_used_kg, 1e3, 2))));
        let total = |f: fn(&ServiceFigures) -> u64| self.services.values().map(f).sum::<u64>();
        let (late, cycles, skipped) = (total(|s| s.overruns), total(|s| s.cycles), total(|s| s.skipped));
        rows.push(("overruns", format!("{late} of {cycles} cycles, {skipped} boundaries skipped")));
        rows
    }
}

/// Puts samples where they belong if they are of that kind; else gives them back.
fn put<T: Sample>(samples: Box<dyn Any>, place: &mut Vec<T>) -> Result<(), Box<dyn Any>> {
    samples.downcast().map(|samples| *place = *samples)
}

fn number(value: Option<f64>, scale: f64, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{:.digits$}", v * scale))
}

/// How a mission ended whose states these are.
pub fn outcome(states: &[MissionState]) -> &'static str {
    match states.last().map(|s| s.state) {
        Some(MissionState::DONE) => "done",
        Some(MissionState::ABORTED) => "aborted",
        _ => "unfinished",
    }
}

fn rotation(truth: &[TruthState]) -> Option<Rotation> {
    let start = truth.first()?.theta_rad;
    let turned = |t: &TruthState| (t.theta_rad - start).to_degrees();
    let max_deg = truth.iter().map(|t| turned(t).abs()).fold(0.0, f64::max);
    Some(Rotation { end_deg: turned(truth.last()?), max_deg })
}

fn end_effector(truth: &[TruthState], arm: &[ArmCommand]) -> Option<EndEffector> {
    let (first, last) = (truth.first()?, truth.last()?);
    let distance = |a: &[f64; 3], b: &[f64; 3]| (a[0] - b[0]).hypot(a[1] - b[1]);
    // A goal of exact zeros is none: the arm flew no Cartesian task then.
    let mut tasks = arm.iter().filter(|a| a.ee_goal != [0.0; 3]).peekable();
    let mut max_error_m = tasks.peek().map(|_| 0.0_f64);
    let mut final_error_m = None;
    for task in tasks {
        let i = truth.partition_point(|t| t.stamp_ns < task.stamp_ns);
        if let Some(t) = truth.get(i) {
            max_error_m = max_error_m.map(|m| m.max(distance(&t.ee, &task.ee_goal)));
        }
        final_error_m = Some(distance(&last.ee, &task.ee_goal));
    }
    Some(EndEffector { moved_m: distance(&first.ee, &last.ee), final_error_m, max_error_m })
}

/// An estimate less the truth of its time: x m, y m, heading rad. `None` where the truth does not reach.
pub fn navigation_error(nav: &NavState, truth: &[TruthState]) -> Option<[f64; 3]> {
    let after = truth.partition_point(|t| t.stamp_ns < nav.stamp_ns);
    let (a, b) = (truth.get(after.checked_sub(1)?)?, truth.get(after)?);
    let at = |f: fn(&TruthState) -> f64| {
        let share = (nav.stamp_ns - a.stamp_ns) as f64 / (b.stamp_ns - a.stamp_ns).max(1) as f64;
        f(a) + share * (f(b) - f(a))
    };
    let heading = nav.theta_rad - at(|t| t.theta_rad);
    Some([nav.x_m - at(|t| t.x_m), nav.y_m - at(|t| t.y_m), heading.sin().atan2(heading.cos())])
}

fn navigation(nav: &[NavState], truth: &[TruthState]) -> Option<Navigation> {
    let (mut count, mut position2, mut heading2, mut position_max_m) = (0.0, 0.0, 0.0, 0.0_f64);
    for n in nav.iter().filter(|n| n.mode != NavState::INITIALISING) {
        let Some([x, y, heading]) = navigation_error(n, truth) else { continue };
        let error = x.hypot(y);
        position2 += error * error;
        heading2 += heading * heading;
        position_max_m = position_max_m.max(error);
        count += 1.0;
    }
    (count > 0.0).then(|| Navigation {
        position_rms_m: f64::sqrt(position2 / count),
        heading_rms_deg: f64::sqrt(heading2 / count).to_degrees(),
        position_max_m,
    })
}

/// The last report of each start of each service, added up.
fn services(health: &[Health]) -> BTreeMap<String, ServiceFigures> {
    let mut last = BTreeMap::<(String, u32), ServiceFigures>::new();
    for h in health {
        let figures = ServiceFigures {
            cycles: h.cycles,
            overruns: h.overruns,
            skipped: h.skipped,
            dropped: h.dropped,
            starts: h.starts,
        };
        last.insert((text_of(&h.service).to_owned(), h.starts), figures);
    }
    let mut services = BTreeMap::<String, ServiceFigures>::new();
    for ((service, starts), f) in last {
        let sum = services.entry(service).or_default();
        sum.cycles += f.cycles;
        sum.overruns += f.overruns;
        sum.skipped += f.skipped;
        sum.dropped += f.dropped;
        sum.starts = sum.starts.max(starts);
    }
    services
}

/// What was warned of, in at most so many lines: what floods is counted.
fn warnings(events: &[Event], first_ns: u64) -> Vec<String> {
    const MOST: usize = 100;
    let grave = || events.iter().filter(|e| e.severity >= Event::WARNING);
    let seconds = |e: &Event| e.header().stamp_ns.saturating_sub(first_ns) as f64 * 1e-9;
    let said = |e: &Event| format!("{:.2} s {}: {}", seconds(e), text_of(&e.service), text_of(&e.text));
    let rest = grave().count().saturating_sub(MOST);
    grave().take(MOST).map(said).chain((rest > 0).then(|| format!("and {rest} more, in the log"))).collect()
}
