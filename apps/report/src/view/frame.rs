//! What the page shows of an instant, and what is on the table.

use crate::values;
use fss_launcher::stack::Stack;
use fss_messages::{
    ArmCommand, Definition, Event, Health, LinksState, MAX_LINKS, MissionState, MocapPose, NavState, TruthState,
    text_of,
};
use fss_multibody::Model;
use fss_plant::scene::{Posture, Scene};
use miette::{IntoDiagnostic, Result};
use serde::Serialize;

/// What does not change: the vehicle, the mission's names.
pub(super) struct Stage {
    stack: Stack,
    model: Model,
}

/// The stage as the page wants it.
#[derive(Serialize)]
struct Setting<'a> {
    live: bool,
    title: &'a str,
    description: &'a str,
    #[serde(flatten)]
    scene: Scene,
}

/// The newest samples at an instant.
#[derive(Clone, Copy, Default)]
pub(super) struct Samples<'a> {
    /// The truth, in the simulated laboratory.
    pub truth: Option<&'a TruthState>,
    /// The estimate.
    pub nav: Option<&'a NavState>,
    /// What the arm is commanded.
    pub arm: Option<&'a ArmCommand>,
    /// The arm's telemetry.
    pub links: Option<&'a LinksState>,
    /// Where the mission stands.
    pub mission: Option<&'a MissionState>,
    /// The target as motion capture last saw it.
    pub target: Option<&'a MocapPose>,
    /// Valves that were open since the frame before, a bit each.
    pub pushing: u32,
}

/// An instant, rounded to what a picture needs.
#[derive(Serialize)]
pub(super) struct Frame {
    /// s.
    t: f64,
    /// By the truth, or by the estimate where there is none.
    #[serde(flatten)]
    posture: Posture,
    rate: [f64; 3],
    /// The estimate, where the posture is the truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    believed: Option<[f64; 3]>,
    /// Estimate less truth: x m, y m, heading rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<[f64; 3]>,
    /// Encoder angles, rad, and torques, N m; none where a link is silent.
    q: Vec<f64>,
    torque: Vec<f64>,
    held: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    gas: Option<f64>,
    nav: &'static str,
    phase: String,
}

/// A service's report.
#[derive(Serialize)]
pub(super) struct HealthRow {
    t: f64,
    service: String,
    hz: f64,
    cycles: u64,
    overruns: u64,
    skipped: u64,
    dropped: u64,
    wake_us: [f64; 3],
    step_us: [f64; 3],
    starts: u32,
    real_time: bool,
}

/// An event.
#[derive(Serialize)]
pub(super) struct EventRow {
    t: f64,
    severity: u8,
    service: String,
    text: String,
}

fn round(value: f64) -> f64 {
    (value * 1e5).round() / 1e5
}

/// For angles and errors whose last digits show.
fn finely(value: f64) -> f64 {
    (value * 1e7).round() / 1e7
}

impl Stage {
    /// Of a stack.
    ///
    /// # Errors
    /// Where its plant has no model.
    pub(super) fn of(stack: Stack) -> Result<Self> {
        let model = stack.plant.nominal().model().into_diagnostic()?;
        Ok(Self { stack, model })
    }

    /// As the page wants it.
    ///
    /// # Errors
    /// None that a plant can cause.
    pub(super) fn json(&self, is_live: bool) -> Result<String> {
        let mission = &self.stack.mission;
        let scene = Scene::of(&self.stack.plant, mission.target.as_ref().map(|target| &target.body));
        let (title, description) = (&mission.name, &mission.description);
        serde_json::to_string(&Setting { live: is_live, title, description, scene }).into_diagnostic()
    }

    /// The samples as a picture's frame; `None` before anything is known of the vehicle.
    pub(super) fn frame(&self, t_s: f64, of: &Samples) -> Option<Frame> {
        let links = self.model.link_count();
        let believed = of.nav.filter(|n| n.mode != NavState::INITIALISING).map(|n| [n.x_m, n.y_m, n.theta_rad]);
        let told = of.links.map_or([0.0; MAX_LINKS], |l| l.q_rad);
        let (base, rate, q_rad) = match (of.truth, of.nav, believed) {
            (Some(t), _, _) => ([t.x_m, t.y_m, t.theta_rad], [t.vx_m_s, t.vy_m_s, t.omega_rad_s], t.q_rad),
            (None, Some(n), Some(pose)) => (pose, [n.vx_m_s, n.vy_m_s, n.omega_rad_s], told),
            _ => return None,
        };
        let telemetry = of.links.filter(|l| l.alive[..links].iter().all(|alive| *alive != 0));
        let has_target = self.stack.mission.target.is_some();
        let seen = of.target.filter(|pose| pose.quality == MocapPose::VALID).map(|p| [p.x_m, p.y_m, p.theta_rad]);
        let target = of.truth.map(|t| t.target).or(seen).filter(|_| has_target);
        let held = of.truth.map_or_else(|| of.mission.is_some_and(|m| m.target_held != 0), |t| t.target_held != 0);
        let error = of.truth.zip(of.nav.filter(|_| believed.is_some())).map(|(t, n)| error_of(n, t));
        Some(Frame {
            t: round(t_s),
            posture: Posture {
                base: base.map(round),
                arm: Posture::of(&self.model, base, &q_rad).arm.into_iter().map(|pose| pose.map(round)).collect(),
                target: target.map(|pose| pose.map(round)),
                goal: of.arm.map(|arm| arm.ee_goal.map(round)).filter(|goal| *goal != [0.0; 3]),
                pushing: of.pushing,
            },
            rate: rate.map(finely),
            believed: believed.filter(|_| of.truth.is_some()).map(|pose| pose.map(round)),
            error: error.map(|error| error.map(finely)),
            q: telemetry.map_or_else(Vec::new, |l| l.q_rad[..links].iter().copied().map(round).collect()),
            torque: telemetry.map_or_else(Vec::new, |l| l.torque_nm[..links].iter().copied().map(round).collect()),
            held,
            gas: of.truth.map(|t| finely(t.gas_used_kg)),
            nav: of.nav.map_or("none", navigation_mode),
            phase: of.mission.map_or_else(|| "no mission".to_owned(), |m| self.stack.phase_name(m)),
        })
    }
}

/// Estimate less truth, which is brought to the estimate's time: x m, y m, heading rad.
fn error_of(nav: &NavState, truth: &TruthState) -> [f64; 3] {
    let later_s = (i128::from(nav.stamp_ns) - i128::from(truth.stamp_ns)) as f64 * 1e-9;
    let heading = nav.theta_rad - truth.theta_rad - truth.omega_rad_s * later_s;
    [
        nav.x_m - truth.x_m - truth.vx_m_s * later_s,
        nav.y_m - truth.y_m - truth.vy_m_s * later_s,
        heading.sin().atan2(heading.cos()),
    ]
}

fn navigation_mode(nav: &NavState) -> &'static str {
    ["initialising", "tracking", "coasting", "lost", "no gyro"].get(usize::from(nav.mode)).unwrap_or(&"?")
}

/// The newest sample of a topic of a service from elsewhere.
#[derive(Serialize)]
pub(super) struct OtherRow {
    /// s.
    t: f64,
    topic: String,
    text: String,
}

/// Between two rows of one topic, ns.
pub(super) const OTHER_PERIOD_NS: u64 = 200_000_000;

impl OtherRow {
    /// Of a sample at a time of the page's clock, s.
    pub(super) fn of(t_s: f64, topic: &str, definition: &Definition, sample: &[u8]) -> Self {
        Self { t: round(t_s), topic: topic.to_owned(), text: values::line(definition, sample) }
    }
}

impl HealthRow {
    /// Of a report at a time of the page's clock, s.
    pub(super) fn of(t_s: f64, h: &Health) -> Self {
        let us = |all: [u64; 3]| all.map(|ns| (ns as f64 * 1e-2).round() / 10.0);
        Self {
            t: round(t_s),
            service: text_of(&h.service).to_owned(),
            hz: h.rate_hz,
            cycles: h.cycles,
            overruns: h.overruns,
            skipped: h.skipped,
            dropped: h.dropped,
            wake_us: us([h.wake_p50_ns, h.wake_p99_ns, h.wake_max_ns]),
            step_us: us([h.step_p50_ns, h.step_p99_ns, h.step_max_ns]),
            starts: h.starts,
            real_time: h.real_time == 1,
        }
    }
}

impl EventRow {
    /// Of an event at a time of the page's clock, s.
    pub(super) fn of(t_s: f64, e: &Event) -> Self {
        let (service, text) = (text_of(&e.service).to_owned(), text_of(&e.text).to_owned());
        Self { t: round(t_s), severity: e.severity, service, text }
    }
}
