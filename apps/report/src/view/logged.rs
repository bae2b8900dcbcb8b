//! A log as the page wants it: frames at the picture's rate, reports of health, events.

use super::frame::{EventRow, Frame, HealthRow, OTHER_PERIOD_NS, OtherRow, Samples, Stage};
use crate::report::Flight;
use fss_messages::{Event, Header, MocapPose, Sample};
use fss_plant::scene::mask;
use fss_records::log::Log;
use fss_service::topics_of;
use miette::{IntoDiagnostic, Result};
use serde::Serialize;
use std::collections::BTreeMap;

/// The picture's rate, and the most frames of a log, which then come less often.
const RATE_HZ: f64 = 30.0;
const MOST_FRAMES: f64 = 9000.0;

#[derive(Serialize)]
struct Logged {
    frames: Vec<Frame>,
    health: Vec<HealthRow>,
    events: Vec<EventRow>,
    others: Vec<OtherRow>,
}

/// Reads a log; gives the scene and the flight as JSON.
///
/// # Errors
/// Names what is wrong with the log or missing.
pub(super) fn read(log: &Log) -> Result<(String, String)> {
    let flight = Flight::read(log)?;
    let stage = Stage::of(flight.stack.clone())?;
    let [start_s, end_s] = flight.span_s();
    let period_s = (1.0 / RATE_HZ).max((end_s - start_s) / MOST_FRAMES);
    let seen: Vec<MocapPose> = flight.target.iter().filter(|p| p.quality == MocapPose::VALID).copied().collect();
    let records = &flight.records;
    let mut frames = Vec::new();
    let count = ((end_s - start_s) / period_s).floor() as usize;
    let mut valves_from = 0;
    for k in 0..=count {
        let t_s = start_s + k as f64 * period_s;
        let passed = flight.valves[valves_from..].partition_point(|v| flight.seconds(v.stamp_ns) <= t_s);
        let passed = &flight.valves[valves_from..valves_from + passed];
        let pushing = passed.iter().fold(0, |all, state| all | mask(&state.valves));
        valves_from += passed.len();
        let samples = Samples {
            truth: newest(&flight, records.truth(), t_s),
            nav: newest(&flight, records.nav(), t_s),
            arm: newest(&flight, records.arm(), t_s),
            links: newest(&flight, &flight.links, t_s),
            mission: newest(&flight, records.states(), t_s),
            target: newest(&flight, &seen, t_s),
            pushing,
        };
        frames.extend(stage.frame(t_s, &samples));
    }
    let health = records.health().iter().map(|h| HealthRow::of(flight.seconds(h.stamp_ns), h)).collect();
    let events = records.events().iter().filter(|e| e.severity >= Event::INFO);
    let events = events.map(|e| EventRow::of(flight.seconds(e.stamp_ns), e)).collect();
    let others = others(log, &flight)?;
    let text = serde_json::to_string(&Logged { frames, health, events, others }).into_diagnostic()?;
    Ok((stage.json(false)?, text))
}

/// Now and then a sample of each topic of services from elsewhere.
fn others(log: &Log, flight: &Flight) -> Result<Vec<OtherRow>> {
    let vehicle = &flight.stack.launch.vehicle;
    let prefix = if vehicle.is_empty() { String::new() } else { format!("/{vehicle}") };
    let topics = topics_of(&flight.stack.programs)?;
    let mut due: BTreeMap<String, _> =
        topics.iter().map(|topic| (format!("{prefix}{}", topic.name), (topic, 0_u64))).collect();
    let mut rows = Vec::new();
    log.for_each(|channel, _, sample| {
        let Some((topic, told_ns)) = due.get_mut(&channel.topic) else { return };
        let Some(header) = Header::of_sample(sample) else { return };
        if *told_ns == 0 || header.stamp_ns >= *told_ns + OTHER_PERIOD_NS {
            *told_ns = header.stamp_ns;
            rows.push(OtherRow::of(flight.seconds(header.stamp_ns), &topic.name, &topic.definition, sample));
        }
    })
    .into_diagnostic()?;
    Ok(rows)
}

/// The newest sample at a time, s.
fn newest<'a, T: Sample>(flight: &Flight, samples: &'a [T], t_s: f64) -> Option<&'a T> {
    let after = samples.partition_point(|sample| flight.seconds(sample.header().stamp_ns) <= t_s);
    samples.get(after.checked_sub(1)?)
}
