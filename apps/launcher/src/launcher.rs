//! The launcher: starts the services of a launch file as processes, watches them, restarts what dies, stops them in order.

use crate::files::program_of;
use crate::limits::LimitWatch;
use crate::member::{BIRTH_TIME, FIRST_PAUSE, Member, Site};
use crate::notify::Systemd;
use crate::services::published_by;
use crate::stack::Stack;
use fss_bus::launch::{BRIDGE, GROUND, PROGRAMS, Schedule};
use fss_bus::{Batch, Bus, InputPort, Latest, Output, OutputPort, Service, SharedConfig, Time, realtime};
use fss_messages::{Event, Health, LinksState, MissionState, text_of, topic};
use fss_mission::MissionService;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use rustix::process::setpriority_process;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Of the launcher and of services without a real-time priority, and of all while they start.
const NICE: i32 = -10;
/// How often the launcher looks after its children.
const WATCH_PERIOD: Duration = Duration::from_millis(5);
/// A service that ends by itself so often before its first sign of life cannot start: the run is given up, with its reason.
/// Once is not enough: a host that stands still for a second can part any two processes that make a topic together.
const START_TRIES: u32 = 2;
/// Longest pause before a restart.
const LONGEST_PAUSE: Duration = Duration::from_millis(500);
/// A start that ends within this time did not work; one that lived longer did, and its next pause is the first again.
const STILLBORN: Duration = Duration::from_millis(500);
/// So many starts in a row that did not work, of a service that the flight needs, end it in safe mode.
const STILLBORN_LIMIT: u32 = 8;
/// A launcher that was itself held up for so long cannot tell who else was.
const OWN_STALL: Duration = Duration::from_millis(150);
/// How long safe mode is recorded before the run ends.
const SAFE_MODE_TIME: Duration = Duration::from_secs(1);
/// Who publishes one of these moves the vehicle: safe mode stops it, and what it drove comes to rest by its own time-out.
const MOVING: [&str; 4] =
    [topic::MISSION_STATE.name, topic::ARM_COMMAND.name, topic::BASE_COMMAND.name, topic::THRUSTERS_COMMAND.name];
/// They end after the flight's services: the world in which these act, and the log of what they do.
const OUTLASTING: [&str; 2] = ["recorder", "lab"];
/// The flight goes on without them, whatever happens to them.
const SPARED: [&str; 3] = ["recorder", GROUND, BRIDGE];

/// How a run of processes ended.
#[derive(Debug, Default)]
pub struct Flown {
    /// The last state of the mission.
    pub mission: Option<MissionState>,
    /// Restarts of all services together.
    pub restarts: u32,
    /// Whether a person or the system asked to stop.
    pub interrupted: bool,
    /// What iceoryx2 still held of dead processes when all had ended.
    pub dead_nodes_removed: usize,
}

/// Flies the stack as processes until its mission ends or `stop` is set; calls `progress` now and then.
///
/// # Errors
/// Where a service cannot start; whatever happens, no process and no shared memory is left behind.
pub fn fly(stack: &Stack, site: &Site, stop: &AtomicBool, mut progress: impl FnMut(&MissionState)) -> Result<Flown> {
    for service in PROGRAMS.iter().filter(|name| stack.launch.schedule(name).is_some()) {
        program_of(service)?;
    }
    fss_bus::remove_stale_stacks().into_diagnostic()?;
    // What supervises, starts and records goes before other people's work; where that is refused, beside it.
    let _beside = setpriority_process(None, NICE);
    let mut supervisor = Supervisor::join(stack, site)?;
    let flight = supervisor.fly(stop, &mut progress);
    supervisor.stop_all();
    supervisor.systemd.ends();
    let mut flown = std::mem::take(&mut supervisor.flown);
    drop(supervisor);
    let cleaned = fss_bus::remove_dead_nodes(&site.bus_prefix, true).into_diagnostic();
    flight?;
    flown.dead_nodes_removed = cleaned?;
    Ok(flown)
}

/// The topics that a service of the stack publishes.
fn outputs_of(stack: &Stack, service: &str) -> Vec<String> {
    match stack.program(service) {
        Some((_, description)) => description.outputs.iter().map(|port| port.topic.clone()).collect(),
        None => published_by(service),
    }
}

struct Supervisor<'a> {
    site: &'a Site,
    members: Vec<Member>,
    mission: Latest<MissionState>,
    health: Batch<Health>,
    events: Output<Event>,
    links: Latest<LinksState>,
    limits: LimitWatch,
    systemd: Systemd,
    watched: Instant,
    flown: Flown,
}

impl<'a> Supervisor<'a> {
    fn join(stack: &Stack, site: &'a Site) -> Result<Self> {
        let config = SharedConfig { node: "launcher".to_owned(), prefix: site.bus_prefix.clone() };
        let bus = Bus::shared(&config).into_diagnostic()?.for_stack(&stack.launch);
        let member = |service: &Schedule| {
            let name = service.name.get_ref();
            let moves = outputs_of(stack, name).iter().any(|topic| MOVING.contains(&topic.as_str()));
            Member::new(service.clone(), stack.program(name).map(|(path, _)| path.to_owned()), moves)
        };
        let members = stack.launch.services.iter().map(member).collect();
        Ok(Self {
            site,
            members,
            mission: Latest::open(&bus, topic::MISSION_STATE).into_diagnostic()?,
            health: Batch::open(&bus, topic::HEALTH).into_diagnostic()?,
            events: Output::open(&bus, topic::EVENTS).into_diagnostic()?,
            links: Latest::open(&bus, topic::LINKS_STATE).into_diagnostic()?,
            limits: LimitWatch::new(stack.launch.limits),
            systemd: Systemd::from_environment(),
            watched: Instant::now(),
            flown: Flown::default(),
        })
    }

    fn fly(&mut self, stop: &AtomicBool, progress: &mut impl FnMut(&MissionState)) -> Result<()> {
        for i in 0..self.members.len() {
            self.members[i].start(self.site, None)?;
            if self.members[i].schedule.name.get_ref() == "recorder" {
                self.wait_for(i);
            }
        }
        loop {
            if stop.load(Ordering::Relaxed) {
                self.flown.interrupted = true;
                self.say(Event::WARNING, format_args!("stopped on request"));
                return Ok(());
            }
            self.watch()?;
            self.systemd.live(self.members.iter().all(|member| member.heard.is_some()));
            self.mission.refresh();
            if let Some(mission) = self.mission.fresh() {
                progress(mission);
                self.flown.mission = Some(*mission);
                if mission.state == MissionState::DONE || mission.state == MissionState::ABORTED {
                    return Ok(());
                }
            }
            std::thread::sleep(WATCH_PERIOD);
        }
    }

    /// Waits for a member's first sign of life: a log from which services are replayed holds their first steps, so the
    /// recorder listens before anybody speaks.
    fn wait_for(&mut self, i: usize) {
        let waits = |member: &mut Member| {
            let lives = member.child.as_mut().is_some_and(|child| matches!(child.try_wait(), Ok(None)));
            lives && member.heard.is_none() && member.started.elapsed() < BIRTH_TIME
        };
        while waits(&mut self.members[i]) {
            std::thread::sleep(Duration::from_millis(2));
            self.listen();
        }
    }

    /// Restarts what has died, and kills what has frozen.
    fn watch(&mut self) -> Result<()> {
        self.listen();
        self.look_at_limits();
        for i in 0..self.members.len() {
            if let Some(status) = self.members[i].ended().into_diagnostic()? {
                let name = self.members[i].schedule.name.get_ref();
                // Its number may be another process's soon.
                self.site.processes.lock().unwrap_or_else(PoisonError::into_inner).remove(name);
                self.bury(i, status)?;
            }
            let member = &mut self.members[i];
            if member.restart_at.is_some_and(|at| Instant::now() >= at) {
                self.restart(i);
            }
        }
        Ok(())
    }

    /// A computer without room for one process more may have it again soon: that alone ends no flight.
    fn restart(&mut self, i: usize) {
        let member = &mut self.members[i];
        self.mission.refresh();
        let last = self.mission.get().filter(|_| member.schedule.name.get_ref() == MissionService::NAME);
        match member.start(self.site, last) {
            Ok(()) => self.flown.restarts += 1,
            Err(why) => {
                member.restart_at = Some(Instant::now() + member.pause);
                member.pause = (2 * member.pause).min(LONGEST_PAUSE);
                self.say(Event::ERROR, format_args!("{why:#}"));
            }
        }
    }

    /// Takes the signs of life; a service that gives none for too long is killed, and thereby restarted.
    fn listen(&mut self) {
        let now = Instant::now();
        let stalled = now - std::mem::replace(&mut self.watched, now) > OWN_STALL;
        self.health.refresh();
        for member in &mut self.members {
            let name = member.schedule.name.get_ref();
            let is_its_own = |health: &&Health| health.starts == member.starts && text_of(&health.service) == name;
            let heard = self.health.samples().iter().any(|health| is_its_own(&health));
            member.has_lived |= heard;
            if heard || (stalled && member.heard.is_some()) {
                member.heard = Some(now);
            }
        }
        for i in 0..self.members.len() {
            let member = &mut self.members[i];
            let Some(child) = &mut member.child else { continue };
            let patience = match member.heard {
                Some(_) => Duration::from_millis(member.schedule.frozen_ms),
                None => BIRTH_TIME,
            };
            let silent = now - member.heard.unwrap_or(member.started);
            if silent > patience {
                // A process that is gone already is buried in a moment.
                let _ = child.kill();
                member.heard = Some(now);
                let (name, silent_ms) = (member.schedule.name.get_ref().clone(), silent.as_millis());
                self.say(Event::ERROR, format_args!("{name} gave no sign of life for {silent_ms} ms: killed"));
            }
        }
    }

    /// Says what comes near its limit, or is beyond it.
    fn look_at_limits(&mut self) {
        let mut said = Vec::new();
        let mut say = |severity: u8, words: std::fmt::Arguments<'_>| said.push((severity, words.to_string()));
        self.links.refresh();
        if let Some(links) = self.links.fresh() {
            self.limits.look_at_links(links, &mut say);
        }
        for health in self.health.samples() {
            let name = text_of(&health.service);
            if let Some(member) = self.members.iter().find(|member| member.schedule.name.get_ref() == name) {
                self.limits.look_at_health(health, member.schedule.deadline_ns(), &mut say);
            }
        }
        for (severity, words) in said {
            self.say(severity, format_args!("{words}"));
        }
    }

    /// Stops what moves the vehicle, lets the rest record for a moment, and ends the run.
    fn safe_mode(&mut self, why: &str) -> Result<()> {
        self.say(Event::CRITICAL, format_args!("safe mode: {why}"));
        for member in &mut self.members {
            if member.moves {
                member.stop();
            }
        }
        std::thread::sleep(SAFE_MODE_TIME);
        Err(miette!("{why}: the vehicle was brought to safe mode (valves shut, arm held by its links' own time-outs)"))
    }

    fn bury(&mut self, i: usize, status: ExitStatus) -> Result<()> {
        let member = &mut self.members[i];
        let name = member.schedule.name.get_ref().clone();
        let said = std::mem::take(&mut *member.said.lock().unwrap_or_else(PoisonError::into_inner));
        let could_not_start = !member.has_lived && name != BRIDGE && status.signal().is_none();
        if could_not_start && member.starts >= START_TRIES {
            return Err(miette!("{}", said.trim_end()).wrap_err(format!("service '{name}' could not start")));
        }
        if !member.schedule.restart && !could_not_start {
            return Err(miette!("{}", said.trim_end()).wrap_err(format!("service '{name}' ended ({status})")));
        }
        let worked = member.started.elapsed() >= STILLBORN;
        member.stillborn = if worked { 0 } else { member.stillborn + 1 };
        if member.stillborn >= STILLBORN_LIMIT && !SPARED.contains(&name.as_str()) {
            let why = format!("service '{name}' ended {STILLBORN_LIMIT} times in a row as soon as it was started");
            return self.safe_mode(&why).wrap_err(said.trim_end().to_owned());
        }
        if worked {
            member.pause = FIRST_PAUSE;
        }
        member.restart_at = Some(Instant::now() + member.pause);
        let pause_ms = member.pause.as_millis();
        member.pause = (2 * member.pause).min(LONGEST_PAUSE);
        self.say(Event::ERROR, format_args!("{name} ended ({status}), restart in {pause_ms} ms"));
        if could_not_start {
            let reason = said.trim_end();
            self.say(Event::ERROR, format_args!("{name} could not start: {reason}"));
        }
        Ok(())
    }

    fn say(&mut self, severity: u8, message: std::fmt::Arguments<'_>) {
        let now = realtime::now().unwrap_or_else(|_| Time::from_ns(0));
        self.events.publish(Event::new(now.ns(), "launcher", severity, message));
        self.events.flush(now);
    }

    /// Stops the flight's services together, since the end of one is no fault for the others to report, and then the others in
    /// the opposite order of their start, so that the recorder, started first, hears all.
    fn stop_all(&mut self) {
        for member in &mut self.members {
            if !OUTLASTING.contains(&member.schedule.name.get_ref().as_str()) {
                member.ask_to_stop();
            }
        }
        for member in self.members.iter_mut().rev() {
            member.stop();
        }
    }
}

impl Drop for Supervisor<'_> {
    fn drop(&mut self) {
        self.stop_all();
    }
}
