//! The service: what the mission wants, as commands to the joints.

use crate::estimate::{Estimate, Estimator, joints_at};
use crate::line::{Handle, Line};
use crate::reference::Reference;
use crate::task::{Blocked, Task};
use crate::{ArmConfig, Drive};
use core::fmt;
use fss_bus::{Latest, Output, Service, Time, inputs, outputs};
use fss_messages::parameter::Tuning;
use fss_messages::{ArmCommand, Event, LinksState, MissionState, MocapPose, NavState, Parameters, topic};
use fss_multibody::{JointVector, MAX_LINKS};

/// A line begins within this time of its phase or not at all, ns.
const LATEST_START_NS: u64 = 1_000_000_000;
/// A line that stands still for this long is blocked, s.
const STANDSTILL_S: f64 = 0.5;
/// A line slowed to less than this share stands still.
const STANDSTILL_SHARE: f64 = 0.02;
/// A joint that lags behind for this long is blocked, s.
const LAG_S: f64 = 1.0;
/// A joint further than this from its reference when telemetry returns was moved by something else, rad.
const MOVED_RAD: f64 = 0.05;
/// The longest step that the reference is moved on by, s.
const LONGEST_STEP_S: f64 = 0.25;

inputs! {
    /// What the controller reads.
    pub struct Inputs {
        /// Navigation state of the base.
        nav: Latest<NavState> = topic::NAV_STATE,
        /// State of the joints.
        links: Latest<LinksState> = topic::LINKS_STATE,
        /// What the mission wants.
        mission: Latest<MissionState> = topic::MISSION_STATE,
        /// Motion capture of the end-effector, where there is one.
        end_effector: Latest<MocapPose> = topic::MOCAP_END_EFFECTOR,
        /// How it shall be tuned.
        parameters: Latest<Parameters> = topic::PARAMETERS_COMMAND,
    }
}

outputs! {
    /// What the controller says.
    pub struct Outputs {
        /// Commands to the joints.
        command: Output<ArmCommand> = topic::ARM_COMMAND,
        /// How it is tuned.
        parameters: Output<Parameters> = topic::PARAMETERS_STATE,
        /// What happened.
        events: Output<Event> = topic::EVENTS,
    }
}

/// Controls one arm.
pub struct ArmService {
    config: ArmConfig,
    estimator: Estimator,
    reference: Reference,
    /// Whether the reference stands for where the joints are.
    anchored: bool,
    task: Task,
    /// State, phase and its start, by which a new phase is seen.
    phase: Option<(u8, u32, u64)>,
    blocked: bool,
    holding: bool,
    standstill_s: f64,
    lagging_s: [f64; MAX_LINKS],
    last_step: Option<Time>,
    command: ArmCommand,
    tuning: Tuning,
}

/// The inputs that are good enough to act on, at one time.
struct Seen<'a> {
    now: Time,
    dt_s: f64,
    mission: Option<&'a MissionState>,
    links: Option<&'a LinksState>,
    here: Option<Estimate>,
}

impl ArmService {
    /// A controller that has seen nothing yet.
    pub fn new(config: ArmConfig) -> Self {
        Self {
            tuning: Tuning::new(Self::NAME, &config.tuned()),
            config,
            estimator: Estimator::default(),
            reference: Reference::default(),
            anchored: false,
            task: Task::Hold,
            phase: None,
            blocked: false,
            holding: false,
            standstill_s: 0.0,
            lagging_s: [0.0; MAX_LINKS],
            last_step: None,
            command: ArmCommand::default(),
        }
    }

    /// Takes what the ground tunes. A joint that is under way by a profile goes on at its profile's rate.
    fn tune(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        if let Some(wanted) = inputs.parameters.fresh()
            && let Some(values) = self.tuning.follow(now.ns(), wanted, |event| outputs.events.publish(event))
        {
            self.config.tune(values);
        }
        if let Some(state) = self.tuning.report(now.ns()) {
            outputs.parameters.publish(state);
        }
    }

    fn link_count(&self) -> usize {
        self.config.model.link_count()
    }

    fn see<'a>(&mut self, now: Time, inputs: &'a Inputs) -> Seen<'a> {
        let dt_s = self.last_step.map_or(0.0, |last| now.seconds_since(last).clamp(0.0, LONGEST_STEP_S));
        self.last_step = Some(now);
        let (count, max_age_ns) = (self.link_count(), self.config.max_age_ns);
        let links = inputs
            .links
            .within(now, max_age_ns)
            .filter(|links| links.link_count as usize == count && links.alive[..count].iter().all(|alive| *alive != 0));
        let nav = inputs.nav.within(now, max_age_ns);
        let nav = nav.filter(|nav| !matches!(nav.mode, NavState::INITIALISING | NavState::LOST));
        let ee = inputs.end_effector.within(now, max_age_ns);
        let (config, reference) = (&self.config, &self.reference);
        let here = nav
            .zip(links)
            .filter(|_| self.anchored)
            .map(|(nav, links)| self.estimator.update(config, (now, dt_s), nav, links, ee, reference));
        let mission = inputs.mission.within(now, self.config.max_mission_age_ns);
        Seen { now, dt_s, mission, links, here }
    }

    /// Lets the reference begin where the joints are: all of them at first, later those whose drivers are off and those
    /// that something moved while they were not seen.
    fn anchor(&mut self, now: Time, links: &LinksState, events: &mut Output<Event>) {
        let measured = joints_at(now, links);
        for i in 0..self.link_count() {
            let is_off = links.driver_mode[i] == LinksState::DRIVER_OFF;
            let was_moved = self.holding && (self.reference.q_rad[i] - measured[i]).abs() > MOVED_RAD;
            if self.anchored && was_moved && !is_off {
                say(events, now, Event::WARNING, format_args!("joint {} was moved while it was not seen", i + 1));
            }
            if !self.anchored || is_off || was_moved {
                self.reference.q_rad[i] = measured[i];
                self.reference.qd_rad_s[i] = 0.0;
                self.estimator.tracker.restart(i, measured[i]);
            }
        }
        self.anchored = true;
    }

    /// Begins what a new phase asks for.
    fn begin(&mut self, seen: &Seen, events: &mut Output<Event>) {
        let Some(mission) = seen.mission else { return };
        let phase = (mission.state, mission.phase, mission.phase_start_ns);
        let is_running = mission.state == MissionState::RUNNING;
        let is_same = |old: (u8, u32, u64)| if is_running { old == phase } else { old.0 == mission.state };
        if self.phase.is_some_and(is_same) {
            return;
        }
        self.phase = Some(phase);
        self.blocked = false;
        self.standstill_s = 0.0;
        (self.command.progress, self.command.sigma_min) = (0.0, 0.0);
        let late_s = seen.now.age_ns(mission.phase_start_ns) as f64 * 1e-9;
        self.task = Task::of(mission, &self.config, &self.reference, late_s);
        if let Task::Joints(motion) = &self.task
            && motion.duration_s > mission.arm_duration_s
        {
            let needs = motion.duration_s;
            say(events, seen.now, Event::WARNING, format_args!("the joints need {needs:.1} s for this motion"));
        }
        if let Task::Sines(sines) = &self.task
            && sines.share < 1.0
        {
            let percent = sines.share * 100.0;
            say(events, seen.now, Event::WARNING, format_args!("the joints move in {percent:.0} % of these sines"));
        }
    }

    /// Whether the task cannot go on because something that it needs is not seen.
    fn is_blind(&self, seen: &Seen) -> bool {
        let count = self.link_count();
        let all_driven = seen
            .links
            .is_some_and(|links| links.driver_mode[..count].iter().all(|mode| *mode != LinksState::DRIVER_OFF));
        match self.task {
            Task::Off => false,
            Task::Hold => seen.links.is_none(),
            Task::Joints(_) | Task::Sines(_) | Task::Follow => !all_driven || seen.mission.is_none(),
            Task::LineToBegin(_) | Task::Line(_) => !all_driven || seen.mission.is_none() || seen.here.is_none(),
        }
    }

    /// Moves the reference on by one step of the task.
    fn act(&mut self, seen: &Seen, events: &mut Output<Event>) {
        if let Task::LineToBegin(ask) = self.task
            && !self.blocked
        {
            if seen.now.age_ns(ask.phase_start_ns) > LATEST_START_NS {
                self.block(seen.now, Blocked::Late, events);
            } else if let Some(here) = seen.here.filter(|_| !self.holding) {
                if !ask.is_capture {
                    self.task = Task::Line(Line::from_here(&ask, &here));
                } else if let Some(handle) = self.handle(seen) {
                    self.task = Task::Line(Line::to_handle(&ask, &here, handle));
                }
            }
        }
        if self.blocked || self.holding {
            self.reference.brake(&self.config, seen.dt_s);
            return;
        }
        match (self.task, &seen.here) {
            (Task::Joints(mut motion), _) => {
                if motion.was_interrupted(&self.reference) {
                    motion = motion.resumed(&self.config, &self.reference);
                }
                self.command.progress = motion.advance(&mut self.reference, seen.dt_s);
                self.task = Task::Joints(motion);
            }
            (Task::Sines(mut sines), _) => {
                if sines.was_interrupted(&self.reference) {
                    sines = sines.resumed(&self.reference);
                }
                self.command.progress = sines.advance(&mut self.reference, seen.dt_s);
                self.task = Task::Sines(sines);
            }
            (Task::Follow, _) => {
                let goal_rad = seen.mission.map_or(self.reference.q_rad, |m| JointVector::from(m.q_goal_rad));
                self.reference.approach(&self.config, &goal_rad, seen.dt_s);
            }
            (Task::Line(line), Some(here)) => self.follow(line, here, seen, events),
            _ => self.reference.brake(&self.config, seen.dt_s),
        }
    }

    /// The handle that a capture goes for, where it is seen.
    fn handle(&self, seen: &Seen) -> Option<Handle> {
        Handle::of(seen.mission?, self.config.target_radius_m?, seen.now)
    }

    fn follow(&mut self, mut line: Line, here: &Estimate, seen: &Seen, events: &mut Output<Event>) {
        line.see(self.handle(seen));
        let solution = line.resolve(&self.config, &self.reference, &self.estimator, here);
        if solution.scale > 0.0 {
            self.reference.advance(&solution.rates, seen.dt_s);
        } else {
            self.reference.brake(&self.config, seen.dt_s);
        }
        line.clock_s += seen.dt_s * solution.scale;
        self.task = Task::Line(line);
        self.command.sigma_min = solution.sigma_min;
        self.command.progress = line.progress();
        self.command.limited = solution.at_bound.map(u8::from);

        let stands_still = line.progress() < 1.0 && solution.scale < STANDSTILL_SHARE;
        self.standstill_s = if stands_still { self.standstill_s + seen.dt_s } else { 0.0 };
        let deviation_m = line.deviation_m(&here.ee);
        if self.standstill_s > STANDSTILL_S {
            let is_singular = solution.sigma_min < self.config.sigma_singular;
            let why = if is_singular { Blocked::Singular(solution.sigma_min) } else { Blocked::Limits };
            self.block(seen.now, why, events);
        } else if deviation_m > self.config.max_deviation_m {
            self.block(seen.now, Blocked::OffTheLine(deviation_m), events);
        }
    }

    fn block(&mut self, now: Time, why: Blocked, events: &mut Output<Event>) {
        self.blocked = true;
        say(events, now, Event::ERROR, format_args!("blocked, holds: {why}"));
    }

    /// A joint that stays away from its reference is held up by something.
    fn watch_lag(&mut self, seen: &Seen, events: &mut Output<Event>) {
        let Some(links) = seen.links else { return };
        let measured = joints_at(seen.now, links);
        for i in 0..self.link_count() {
            let lags = (self.reference.q_rad[i] - measured[i]).abs() > self.config.max_lag_rad;
            self.lagging_s[i] = if lags { self.lagging_s[i] + seen.dt_s } else { 0.0 };
            if self.lagging_s[i] > LAG_S && !self.blocked {
                self.block(seen.now, Blocked::JointLags(i), events);
            }
        }
    }

    fn set_holding(&mut self, holding: bool, now: Time, events: &mut Output<Event>) {
        if holding != self.holding {
            self.holding = holding;
            let (severity, what) =
                if holding { (Event::WARNING, "holds: an input is stale") } else { (Event::INFO, "goes on") };
            say(events, now, severity, format_args!("{what}"));
        }
    }

    fn compose(&mut self, seen: &Seen) -> ArmCommand {
        let count = self.link_count();
        let measured = seen.links.map(|links| joints_at(seen.now, links));
        let (config, reference, c) = (&self.config, &self.reference, &mut self.command);
        c.stamp_ns = seen.now.ns();
        c.link_count = count as u32;
        c.holding = u8::from(self.holding);
        c.blocked = u8::from(self.blocked);
        c.gripper = seen.mission.map_or(c.gripper, |mission| mission.gripper);
        let is_off = !self.anchored || matches!(self.task, Task::Off);
        c.mode = match config.drive {
            _ if is_off => ArmCommand::OFF,
            Drive::Position => ArmCommand::POSITION,
            Drive::Velocity => ArmCommand::VELOCITY,
        };
        for i in 0..count {
            c.q_rad[i] = reference.q_rad[i];
            c.qd_rad_s[i] = reference.qd_rad_s[i];
            if let (Drive::Velocity, Some(measured)) = (config.drive, measured) {
                let correction = config.joint_gain_1_s * (reference.q_rad[i] - measured[i]);
                let limit = config.max_rate_rad_s[i];
                c.qd_rad_s[i] = (c.qd_rad_s[i] + correction).clamp(-limit, limit);
            }
            c.limited[i] |= u8::from(reference.is_at_limit(config, i));
        }
        if let Some(here) = &seen.here {
            c.ee = here.ee.into();
        }
        c.ee_goal = if let Task::Line(line) = &self.task { line.goal().into() } else { c.ee };
        *c
    }
}

fn say(events: &mut Output<Event>, now: Time, severity: u8, message: fmt::Arguments<'_>) {
    events.publish(Event::new(now.ns(), ArmService::NAME, severity, message));
}

impl Service for ArmService {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "arm";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        self.tune(now, inputs, outputs);
        let seen = self.see(now, inputs);
        let events = &mut outputs.events;
        self.command.limited = [0; MAX_LINKS];
        if matches!(self.task, Task::Off) {
            self.anchored = false;
        }
        if let Some(links) = seen.links {
            self.anchor(now, links, events);
        }
        if self.anchored {
            self.begin(&seen, events);
            self.set_holding(self.is_blind(&seen), now, events);
            self.act(&seen, events);
            self.watch_lag(&seen, events);
        }
        outputs.command.publish(self.compose(&seen));
    }
}
