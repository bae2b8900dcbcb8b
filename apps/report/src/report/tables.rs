//! What stands in words and numbers.

use super::flight::Flight;
use crate::drawing::page::{escape, table};
use fss_launcher::summary::Summary;
use fss_messages::{Event, Health, text_of};
use std::collections::BTreeMap;
use std::fmt::Write;

/// No more events than these are listed.
const EVENTS: usize = 200;

/// How it ended, in a sentence or two.
pub(super) fn verdict(html: &mut String, flight: &Flight, summary: &Summary) {
    let captured = summary.capture.as_ref().is_none_or(|capture| capture.success);
    let placed = summary.carry.as_ref().is_none_or(|carry| carry.success);
    let good = summary.outcome == "done" && captured && placed;
    let ended = match summary.outcome {
        "done" => "flew all its phases",
        "aborted" => "was aborted",
        _ => "has no end in this log",
    };
    let mut text = format!("The mission {ended}: {:.1} s.", summary.duration_s);
    if let Some(carry) = &summary.carry {
        let how = match (carry.placed_error_m, carry.left_speed_m_s) {
            (Some(error_m), Some(speed_m_s)) => format!(
                " The target was carried along {:.2} m and let go {:.1} mm from the path's end, where it drifts at {:.2} mm/s.",
                carry.path_m,
                error_m * 1e3,
                speed_m_s * 1e3
            ),
            _ => " The target was taken and never let go.".to_owned(),
        };
        text.push_str(&how);
    } else if let Some(capture) = &summary.capture {
        let how = match (capture.success, capture.miss_m, capture.contact_speed_m_s) {
            (true, Some(miss_m), Some(speed_m_s)) => format!(
                " The target was captured, {:.2} mm off the handle at {:.2} mm/s, and is held.",
                miss_m * 1e3,
                speed_m_s * 1e3
            ),
            (false, Some(_), _) => " The target was taken and let go.".to_owned(),
            _ => " The target was not captured.".to_owned(),
        };
        text.push_str(&how);
    } else if flight.stack.mission.target.is_some() {
        let held = flight.records.states().last().is_some_and(|state| state.target_held != 0);
        let believed = if held { "holds" } else { "does not hold" };
        let _ = write!(text, " The arm says that it {believed} the target; without truth the log cannot prove it.");
    }
    if !flight.is_complete {
        text.push_str(" The log was cut off: its recorder died or the file was damaged.");
    }
    let class = if good { "verdict" } else { "verdict bad" };
    let _ = write!(html, "<p class=\"{class}\">{text}</p>");
}

/// Mission, plant, build, host, seed.
pub(super) fn facts(html: &mut String, flight: &Flight, summary: &Summary) {
    let fact = |key: &str| flight.facts.get(key).cloned();
    let plant = &flight.stack.laboratory();
    let mass_kg = |masses: &[f64]| format!("{:.2} kg", masses.iter().sum::<f64>());
    let links: Vec<f64> = plant.links.iter().map(|link| link.mass_kg).collect();
    let vehicle = format!(
        "base of {:.2} kg with {} thrusters, arm of {} links, {}",
        plant.base.mass_kg,
        plant.thrusters.len(),
        links.len(),
        mass_kg(&links)
    );
    let effects: Vec<String> = plant.effects.iter().map(ToString::to_string).collect();
    let started = fact("unix_minus_monotonic_ns").and_then(|ns| ns.parse::<u64>().ok());
    let started = started.map(|offset| utc((offset + flight.records.span_ns()[0]) / 1_000_000_000));
    let clock = match fact("clock").as_deref() {
        Some("virtual") => "virtual: one process, as fast as the machine allows".to_owned(),
        Some("real time") => "real time: each service a process".to_owned(),
        other => other.unwrap_or("not recorded").to_owned(),
    };
    let in_laboratory = if flight.has_truth() { "simulated" } else { "real, or the log holds no truth" };
    let services: Vec<_> = flight.stack.launch.services.iter().map(|s| s.name.get_ref().as_str()).collect();
    let rows = [
        ("mission", Some(format!("{}, {} phases", summary.mission, flight.stack.mission.phases.len()))),
        ("vehicle", Some(vehicle)),
        ("beyond the nominal model", (!effects.is_empty()).then(|| effects.join("; "))),
        ("laboratory", Some(in_laboratory.to_owned())),
        ("seed", fact("seed")),
        ("started", started),
        ("services", Some(services.join(", "))),
        ("clock", Some(clock)),
        ("program", fact("version").map(|version| format!("fss {version}"))),
        ("host", fact("host").map(|host| format!("{host}, kernel {}", fact("kernel").unwrap_or_default()))),
    ];
    let rows = rows.into_iter().filter_map(|(name, value)| Some([name.to_owned(), value?]));
    table(html, "text", &[], rows);
}

/// Seconds since 1970 as a date and time, UTC (Howard Hinnant's `civil_from_days`).
fn utc(unix_s: u64) -> String {
    let (days, second) = (unix_s / 86_400, unix_s % 86_400);
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year}-{month:02}-{day:02} {:02}:{:02}:{:02} UTC", second / 3600, second / 60 % 60, second % 60)
}

/// What `summary.json` says, for a person.
pub(super) fn figures(html: &mut String, summary: &Summary) {
    let warnings = ("warnings", summary.warnings.len().to_string());
    let rows = summary.table().into_iter().chain([warnings]).map(|(what, value)| [what.to_owned(), value]);
    table(html, "text", &[], rows);
}

/// Cycles, overruns and latencies of each service, and what the recorder lost.
pub(super) fn health(html: &mut String, flight: &Flight, summary: &Summary) {
    let mut reports: BTreeMap<&str, Vec<&Health>> = BTreeMap::new();
    for health in flight.records.health() {
        reports.entry(text_of(&health.service)).or_default().push(health);
    }
    let microseconds = |ns: Option<u64>| ns.map_or_else(|| "-".to_owned(), |ns| format!("{:.0}", ns as f64 * 1e-3));
    let rows = reports.iter().map(|(name, reports)| {
        let figures = summary.services.get(*name).copied().unwrap_or_default();
        let middle = |of: fn(&Health) -> u64| {
            let mut all: Vec<u64> = reports.iter().map(|h| of(h)).collect();
            all.sort_unstable();
            microseconds(all.get(all.len() / 2).copied())
        };
        let largest = |of: fn(&Health) -> u64| microseconds(reports.iter().map(|h| of(h)).max());
        let last = reports[reports.len() - 1];
        vec![
            (*name).to_owned(),
            format!("{:.0}", last.rate_hz),
            figures.cycles.to_string(),
            figures.overruns.to_string(),
            figures.skipped.to_string(),
            figures.dropped.to_string(),
            figures.starts.to_string(),
            middle(|h| h.wake_p50_ns),
            middle(|h| h.wake_p99_ns),
            largest(|h| h.wake_max_ns),
            middle(|h| h.step_p50_ns),
            middle(|h| h.step_p99_ns),
            largest(|h| h.step_max_ns),
            if last.real_time == 1 { "real time" } else { "normal" }.to_owned(),
        ]
    });
    if reports.is_empty() {
        html.push_str("<p>On a virtual clock no service can be late: there is no health to report.</p>");
    } else {
        let header = [
            "service",
            "Hz",
            "cycles",
            "overruns",
            "skipped",
            "dropped",
            "starts",
            "wake p50",
            "wake p99",
            "wake max",
            "step p50",
            "step p99",
            "step max",
            "scheduling",
        ];
        table(html, "numbers", &header, rows);
        html.push_str(
            "<p class=\"caption\">Wake-up latency and step time in µs: of all reports the middle one's percentile, and the \
             largest of all.</p>",
        );
    }
    recorded(html, flight, summary);
}

/// What the recorder lost, and the topics of the log.
fn recorded(html: &mut String, flight: &Flight, summary: &Summary) {
    if flight.lost.is_empty() {
        html.push_str("<p>The recorder lost nothing.</p>");
    } else {
        let lost: Vec<_> = flight.lost.iter().map(|(topic, count)| format!("{count} of {}", escape(topic))).collect();
        let _ = write!(html, "<p>The recorder lost {}.</p>", lost.join(", "));
    }
    html.push_str("<details><summary>Topics</summary>");
    let rows = summary.topics.iter().map(|t| {
        let rate = t.rate_hz.map_or_else(|| "-".to_owned(), |rate| format!("{rate:.2}"));
        [t.name.clone(), t.count.to_string(), rate]
    });
    table(html, "numbers", &["topic", "messages", "rate, Hz"], rows);
    html.push_str("</details>");
}

/// What happened, in its order.
pub(super) fn events(html: &mut String, flight: &Flight) {
    let events: Vec<&Event> = flight.records.events().iter().filter(|e| e.severity >= Event::INFO).collect();
    let rows = events.iter().take(EVENTS).map(|event| {
        let severity = ["debug", "info", "warning", "error", "critical"].get(usize::from(event.severity));
        [
            format!("{:.2} s", flight.seconds(event.stamp_ns)),
            (*severity.unwrap_or(&"?")).to_owned(),
            text_of(&event.service).to_owned(),
            text_of(&event.text).to_owned(),
        ]
    });
    table(html, "text", &["time", "severity", "service", "event"], rows);
    if events.len() > EVENTS {
        let _ = write!(html, "<p>And {} more: <code>fss log info</code> lists them.</p>", events.len() - EVENTS);
    }
}

#[cfg(test)]
mod tests {
    use super::utc;

    #[test]
    fn seconds_become_dates() {
        assert_eq!(utc(0), "1970-01-01 00:00:00 UTC");
        assert_eq!(utc(951_827_696), "2000-02-29 12:34:56 UTC");
        assert_eq!(utc(1_735_689_599), "2024-12-31 23:59:59 UTC");
    }
}
