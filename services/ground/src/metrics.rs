//! Figures of the stack in Prometheus' text format, for a laboratory's dashboards: `GET /metrics`.

use crate::topics::AllTopics;
use fss_bus::Time;
use fss_messages::{Health, LinksState, MissionState, NavState, text_of, topic};
use std::collections::BTreeMap;
use std::fmt::Write;

/// How often the text is made anew, ns.
const PERIOD_NS: u64 = 1_000_000_000;

/// The newest of what figures are made of.
#[derive(Default)]
pub(crate) struct Metrics {
    health: BTreeMap<String, Health>,
    nav: Option<NavState>,
    links: Option<LinksState>,
    mission: Option<MissionState>,
    next_ns: u64,
}

impl Metrics {
    /// Takes in what is new; gives the text when it is due.
    pub(crate) fn learn(&mut self, now: Time, inputs: &AllTopics) -> Option<String> {
        for health in inputs.samples(topic::HEALTH) {
            self.health.insert(text_of(&health.service).to_owned(), *health);
        }
        self.nav = inputs.samples(topic::NAV_STATE).last().copied().or(self.nav);
        self.links = inputs.samples(topic::LINKS_STATE).last().copied().or(self.links);
        self.mission = inputs.samples(topic::MISSION_STATE).last().copied().or(self.mission);
        if now.ns() < self.next_ns {
            return None;
        }
        self.next_ns = now.ns() + PERIOD_NS;
        Some(self.text(now))
    }

    fn text(&self, now: Time) -> String {
        type Figure = (&'static str, &'static str, &'static str, fn(&Health) -> f64);
        let figures: [Figure; 7] = [
            ("fss_cycles_total", "counter", "Steps since the start.", |h| h.cycles as f64),
            ("fss_overruns_total", "counter", "Steps that ended after their deadline.", |h| h.overruns as f64),
            ("fss_skipped_total", "counter", "Boundaries missed and skipped.", |h| h.skipped as f64),
            ("fss_dropped_total", "counter", "Samples that could not be published or queued.", |h| h.dropped as f64),
            ("fss_starts_total", "counter", "Times that the service was started.", |h| h.starts.into()),
            ("fss_wake_p99_seconds", "gauge", "Wake-up latency, 99th percentile.", |h| h.wake_p99_ns as f64 * 1e-9),
            ("fss_step_p99_seconds", "gauge", "Step time, 99th percentile.", |h| h.step_p99_ns as f64 * 1e-9),
        ];
        let mut text = String::new();
        for (name, kind, about, value) in figures {
            let _ = writeln!(text, "# HELP {name} {about}\n# TYPE {name} {kind}");
            for (service, health) in &self.health {
                let _ = writeln!(text, "{name}{{service=\"{service}\"}} {}", value(health));
            }
        }
        let mut gauge = |name: &str, about: &str, value: f64| {
            let _ = writeln!(text, "# HELP {name} {about}\n# TYPE {name} gauge\n{name} {value}");
        };
        if let Some(nav) = &self.nav {
            gauge("fss_nav_mode", "Mode of navigation, as NavState has it.", nav.mode.into());
            gauge("fss_nav_age_seconds", "Age of navigation's newest sample.", now.age_ns(nav.stamp_ns) as f64 * 1e-9);
        }
        if let Some(mission) = &self.mission {
            gauge("fss_mission_state", "State of the mission, as MissionState has it.", mission.state.into());
        }
        if let Some(links) = &self.links {
            let _ =
                writeln!(text, "# HELP fss_link_battery_volts Battery of a link.\n# TYPE fss_link_battery_volts gauge");
            for (link, volts) in links.battery_v.iter().enumerate().take(links.link_count as usize) {
                let _ = writeln!(text, "fss_link_battery_volts{{link=\"{}\"}} {volts}", link + 1);
            }
        }
        text
    }
}
