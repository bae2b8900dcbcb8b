//! Limits with yellow and red: what the launcher watches besides signs of life, and says in `/events` when it changes.

use fss_bus::launch::Limits;
use fss_messages::{Event, Health, LinksState, MAX_LINKS, text_of};
use std::collections::BTreeMap;

/// A level must last for so many looks to count: one bad report is none.
const LOOKS: u32 = 3;

/// How near to its limit something is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Level {
    #[default]
    Green,
    Yellow,
    Red,
}

/// The level of one thing, and what it seems to become.
#[derive(Clone, Copy, Debug, Default)]
struct Watched {
    level: Level,
    next: Level,
    looks: u32,
}

impl Watched {
    /// The new level, where it has changed for good.
    fn look(&mut self, now: Level) -> Option<Level> {
        if now == self.level {
            self.looks = 0;
            return None;
        }
        self.looks = if now == self.next { self.looks + 1 } else { 1 };
        self.next = now;
        (self.looks >= LOOKS).then(|| {
            (self.level, self.looks) = (now, 0);
            now
        })
    }
}

/// All that is watched.
pub(crate) struct LimitWatch {
    limits: Limits,
    batteries: [Watched; MAX_LINKS],
    lateness: BTreeMap<String, Watched>,
}

impl LimitWatch {
    /// Watches these limits.
    pub(crate) fn new(limits: Limits) -> Self {
        Self { limits, batteries: [Watched::default(); MAX_LINKS], lateness: BTreeMap::new() }
    }

    /// Looks at the links' batteries; says each change.
    pub(crate) fn look_at_links(&mut self, links: &LinksState, mut say: impl FnMut(u8, std::fmt::Arguments<'_>)) {
        for (i, watched) in self.batteries.iter_mut().enumerate().take(links.link_count as usize) {
            let volts = links.battery_v[i];
            // Zero is no battery but no telemetry.
            let level = match volts {
                v if v <= 0.0 || v >= self.limits.battery_yellow_v => Level::Green,
                v if v >= self.limits.battery_red_v => Level::Yellow,
                _ => Level::Red,
            };
            if let Some(level) = watched.look(level) {
                say(severity(level), format_args!("{}: battery of link {} at {volts:.2} V", colour(level), i + 1));
            }
        }
    }

    /// Looks at how late a service's steps end: yellow beyond half its deadline, red beyond all of it.
    pub(crate) fn look_at_health(
        &mut self,
        health: &Health,
        deadline_ns: u64,
        mut say: impl FnMut(u8, std::fmt::Arguments<'_>),
    ) {
        let service = text_of(&health.service);
        let late_ns = health.wake_p99_ns + health.step_p99_ns;
        let level = match late_ns {
            late if late > deadline_ns => Level::Red,
            late if late > deadline_ns / 2 => Level::Yellow,
            _ => Level::Green,
        };
        let watched = self.lateness.entry(service.to_owned()).or_default();
        if let Some(level) = watched.look(level) {
            let (late_us, deadline_us) = (late_ns / 1000, deadline_ns / 1000);
            let colour = colour(level);
            say(
                severity(level),
                format_args!("{colour}: {service} ends its steps {late_us} us late of {deadline_us} us"),
            );
        }
    }
}

fn severity(level: Level) -> u8 {
    match level {
        Level::Green => Event::INFO,
        Level::Yellow => Event::WARNING,
        Level::Red => Event::ERROR,
    }
}

fn colour(level: Level) -> &'static str {
    match level {
        Level::Green => "green",
        Level::Yellow => "yellow",
        Level::Red => "red",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(watch: &mut LimitWatch, volts: f64, looks: u32) -> Vec<(u8, String)> {
        let mut said = Vec::new();
        let mut links = LinksState { link_count: 1, ..LinksState::default() };
        links.battery_v[0] = volts;
        for _ in 0..looks {
            watch.look_at_links(&links, |severity, words| said.push((severity, words.to_string())));
        }
        said
    }

    #[test]
    fn a_battery_that_runs_down_is_told_once_at_yellow_and_once_at_red() {
        let mut watch = LimitWatch::new(Limits { battery_yellow_v: 13.6, battery_red_v: 12.8 });
        assert!(said(&mut watch, 14.4, 10).is_empty());
        assert!(said(&mut watch, 13.0, 1).is_empty(), "one bad report is none");
        assert!(said(&mut watch, 14.4, 1).is_empty());
        let yellow = said(&mut watch, 13.0, 10);
        assert!(
            yellow.len() == 1 && yellow[0].0 == Event::WARNING && yellow[0].1.contains("link 1 at 13.00 V"),
            "{yellow:?}"
        );
        let red = said(&mut watch, 12.0, 10);
        assert!(red.len() == 1 && red[0].0 == Event::ERROR, "{red:?}");
        let green = said(&mut watch, 14.4, 10);
        assert!(green.len() == 1 && green[0].0 == Event::INFO, "{green:?}");
        assert!(said(&mut watch, 0.0, 10).is_empty(), "no telemetry is no empty battery");
    }

    #[test]
    fn a_service_that_ends_late_turns_yellow_and_then_red() {
        let mut watch = LimitWatch::new(Limits::default());
        let mut look = |wake_p99_ns| {
            let mut said = Vec::new();
            let health = Health { service: fss_messages::text("base"), wake_p99_ns, ..Health::default() };
            for _ in 0..LOOKS {
                watch.look_at_health(&health, 1_000_000, |severity, words| said.push((severity, words.to_string())));
            }
            said
        };
        assert!(look(100_000).is_empty());
        assert_eq!(look(600_000)[0].0, Event::WARNING);
        assert_eq!(look(2_000_000)[0].0, Event::ERROR);
    }
}
