//! Flies a mission: phase after phase, or the safe end.

use crate::follow::{Outcome, follow};
use crate::goals::{Meeting, carried, nearest_turn, open_valves, set_arm_goal, set_base_goal};
use crate::sight::Sight;
use crate::trouble::Trouble;
use crate::{ArmGoal, BaseGoal, Condition, Mission, MissionConfig, Phase};
use fss_bus::{Batch, Latest, Output, Service, Time, inputs, outputs};
use fss_messages::{
    ArmCommand, Event, LinksState, MAX_LINKS, MAX_THRUSTERS, MissionCommand, MissionGoal, MissionState, MocapPose,
    NavState, PeerState, topic,
};
use fss_multibody::State;

inputs! {
    /// What the mission watches.
    pub struct Inputs {
        /// Navigation state of the base.
        nav: Latest<NavState> = topic::NAV_STATE,
        /// Telemetry of the links.
        links: Latest<LinksState> = topic::LINKS_STATE,
        /// How the arm's task goes.
        arm: Latest<ArmCommand> = topic::ARM_COMMAND,
        /// Motion capture of the target, where there is one.
        target: Latest<MocapPose> = topic::MOCAP_TARGET,
        /// What the ground commands.
        command: Latest<MissionCommand> = topic::MISSION_COMMAND,
        /// Navigation state of the target, where that is a vehicle and speaks; its times are on its own clock.
        target_nav: Latest<NavState> = topic::NAV_STATE.of_target(),
        /// What brings these times to this host's clock.
        target_peer: Latest<PeerState> = topic::PEER.of_target(),
        /// Where a controller outside the stack wants base and arm.
        goals: Batch<MissionGoal> = topic::MISSION_GOAL,
    }
}

outputs! {
    /// What the mission says.
    pub struct Outputs {
        /// The goals of the phase.
        mission: Output<MissionState> = topic::MISSION_STATE,
        /// What happened.
        events: Output<Event> = topic::EVENTS,
    }
}

/// The sequencer of one mission.
pub struct MissionService {
    mission: Mission,
    config: MissionConfig,
    sample: MissionState,
    /// When all became good (while waiting), or when the trouble began (while running).
    since: Option<Time>,
    phase_end: Time,
    /// Since when the phase's condition holds.
    met_since: Option<Time>,
    sight: Sight,
}

impl MissionService {
    /// For one flight of `mission`.
    pub fn new(mission: Mission, config: MissionConfig) -> Self {
        let sample = MissionState {
            state: MissionState::WAITING,
            base_mode: MissionState::BASE_FREE,
            arm_mode: MissionState::ARM_HOLD,
            phase_count: mission.phases.len() as u32,
            ..MissionState::default()
        };
        Self {
            mission,
            config,
            sample,
            since: None,
            phase_end: Time::default(),
            met_since: None,
            sight: Sight::default(),
        }
    }

    /// The same flight of `mission`, gone on with by a new process: `last` is what the one before published last. A phase goes
    /// on by the clock that it began with; a condition that was to hold for some time begins to hold anew.
    pub fn resumed(mission: Mission, config: MissionConfig, last: MissionState) -> Self {
        let mut service = Self::new(mission, config);
        service.sample = last;
        if let Some(phase) = service.mission.phase(last.phase as usize) {
            service.phase_end = end_of(phase, Time::from_ns(last.phase_start_ns));
        }
        service
    }

    fn wait(&mut self, now: Time, inputs: &Inputs, events: &mut Output<Event>) {
        if let Some(trouble) = self.trouble(now, inputs) {
            // Say what is waited for, but only now and then.
            if now.age_ns(self.sample.phase_start_ns) >= 5_000_000_000 {
                self.sample.phase_start_ns = now.ns();
                events.publish(event(now, Event::INFO, format_args!("waits: {trouble}")));
            }
            self.since = None;
            return;
        }
        let since = *self.since.get_or_insert(now);
        if now.age_ns(since.ns()) >= self.config.ready_ns {
            self.since = None;
            self.sample.state = MissionState::RUNNING;
            events.publish(event(now, Event::INFO, format_args!("mission {} begins", self.mission.name)));
            self.begin(0, now, inputs, events);
        }
    }

    fn run(&mut self, now: Time, inputs: &Inputs, events: &mut Output<Event>) {
        if let Some(trouble) = self.trouble(now, inputs) {
            let since = *self.since.get_or_insert(now);
            if trouble.is_final() || now.age_ns(since.ns()) >= self.config.patience_ns {
                self.give_up(now, trouble, inputs, events);
                return;
            }
        } else {
            self.since = None;
        }
        self.follow(now, inputs, events);
        self.watch_condition(now, inputs, events);
        while self.sample.state == MissionState::RUNNING && now >= self.phase_end {
            self.go_on(inputs, events);
        }
        if self.sample.base_mode == MissionState::BASE_VALVES
            && let Some(Phase { base: BaseGoal::Valves(pulses), .. }) = self.mission.phase(self.sample.phase as usize)
        {
            self.sample.valves = open_valves(pulses, now.age_ns(self.sample.phase_start_ns));
        }
    }

    /// Takes goals from outside, in a phase that follows them and unless they are old.
    fn follow(&mut self, now: Time, inputs: &Inputs, events: &mut Output<Event>) {
        let Some(phase) = self.mission.phase(self.sample.phase as usize) else { return };
        let theta_rad = inputs.nav.get().map_or(self.sample.base_goal[2], |nav| nav.theta_rad);
        for goal in inputs.goals.samples().iter().filter(|goal| now.age_ns(goal.stamp_ns) <= self.config.max_age_ns) {
            let [x, y, theta] = goal.base_goal;
            let place = format_args!("x {x:.3} m, y {y:.3} m, {:.1} deg", theta.to_degrees());
            match follow(&mut self.sample, phase, goal, theta_rad, self.config.edges_m) {
                Outcome::Same => {}
                Outcome::New => events.publish(event(now, Event::INFO, format_args!("follows a goal: {place}"))),
                Outcome::OffTable => {
                    events.publish(event(
                        now,
                        Event::WARNING,
                        format_args!("a goal beyond the table is refused: {place}"),
                    ));
                }
            }
        }
    }

    /// After the phase that has ended.
    fn go_on(&mut self, inputs: &Inputs, events: &mut Output<Event>) {
        let (at, next) = (self.phase_end, self.sample.phase as usize + 1);
        if self.is_on_abort_path() {
            events.publish(event(at, Event::ERROR, format_args!("mission aborted: its way out is flown")));
            self.end(MissionState::ABORTED);
        } else if next < self.mission.phases.len() {
            self.begin(next, at, inputs, events);
        } else {
            events.publish(event(at, Event::INFO, format_args!("mission {} is done", self.mission.name)));
            self.end(MissionState::DONE);
        }
    }

    fn is_on_abort_path(&self) -> bool {
        self.sample.phase as usize >= self.mission.phases.len()
    }

    /// Does what the ground commands, unless the mission has ended or the word is old.
    fn obey(&mut self, now: Time, inputs: &Inputs, events: &mut Output<Event>) {
        let Some(command) = inputs.command.fresh().filter(|c| now.age_ns(c.stamp_ns) <= self.config.max_age_ns) else {
            return;
        };
        match (self.sample.state, command.command) {
            (MissionState::RUNNING, MissionCommand::ABORT) => self.give_up(now, Trouble::Commanded, inputs, events),
            (MissionState::RUNNING | MissionState::WAITING, _) => {
                events.publish(event(now, Event::ERROR, format_args!("mission aborted: {}", Trouble::Commanded)));
                self.end(MissionState::ABORTED);
            }
            _ => {}
        }
    }

    /// The way out, where there is one and the trouble leaves it; else the end.
    fn give_up(&mut self, now: Time, trouble: Trouble, inputs: &Inputs, events: &mut Output<Event>) {
        let way_out = self.mission.phase(self.sample.phase as usize).and_then(|phase| phase.on_abort);
        if let Some(way_out) = way_out.filter(|_| trouble.leaves_a_way_out() && !self.is_on_abort_path()) {
            events.publish(event(now, Event::ERROR, format_args!("leaves its phases: {trouble}")));
            self.since = None;
            self.begin(self.mission.phases.len() + way_out, now, inputs, events);
        } else {
            events.publish(event(now, Event::ERROR, format_args!("mission aborted: {trouble}")));
            self.end(MissionState::ABORTED);
        }
    }

    /// Ends a phase whose condition has held for long enough, or that waits for it in vain.
    fn watch_condition(&mut self, now: Time, inputs: &Inputs, events: &mut Output<Event>) {
        let phase = self.mission.phase(self.sample.phase as usize);
        let Some(until) = phase.and_then(|phase| phase.until) else { return };
        self.met_since = self.met_since.filter(|_| self.is_met(until.condition, now, inputs));
        if self.met_since.is_none() && self.is_met(until.condition, now, inputs) {
            self.met_since = Some(now);
        }
        if self.met_since.is_some_and(|since| now.seconds_since(since) >= until.for_s) {
            self.phase_end = now;
        } else if now >= self.phase_end {
            self.phase_end = now.plus_ns(1);
            self.give_up(now, Trouble::TimedOut, inputs, events);
        }
    }

    fn is_met(&self, condition: Condition, now: Time, inputs: &Inputs) -> bool {
        let Some(nav) = inputs.nav.within(now, self.config.max_age_ns) else { return false };
        let s = &self.sample;
        match condition {
            Condition::TargetSeen => self.sight.is_known(now),
            Condition::Grasped => s.target_held != 0,
            Condition::Released => s.target_held == 0,
            Condition::Still { speed_m_s, omega_rad_s } => {
                self.speed_of_centre(nav, inputs.links.get()) <= speed_m_s && nav.omega_rad_s.abs() <= omega_rad_s
            }
            Condition::Arrived { distance_m, speed_m_s } => {
                let gone_s = now.age_ns(s.phase_start_ns) as f64 * 1e-9;
                let apart: [f64; 3] = std::array::from_fn(|i| s.base_goal[i] + s.base_goal_rate[i] * gone_s);
                let carried = (s.carrying != 0).then(|| (self.sight.motion(now).pose, s.target_goal));
                let (at, goal) = carried.unwrap_or(([nav.x_m, nav.y_m, nav.theta_rad], apart));
                let rate = s.base_goal_rate;
                // The leg is not over before its time, however near the goal is.
                gone_s >= s.base_duration_s
                    && (at[0] - goal[0]).hypot(at[1] - goal[1]) <= distance_m
                    && (at[2] - nearest_turn(goal[2], at[2])).abs() * 0.5 <= distance_m
                    && (nav.vx_m_s - rate[0]).hypot(nav.vy_m_s - rate[1]) <= speed_m_s
                    && (nav.omega_rad_s - rate[2]).abs() * 0.5 <= speed_m_s
            }
        }
    }

    /// Of the whole vehicle, its joints held; of the base where the vehicle is not known, m/s.
    fn speed_of_centre(&self, nav: &NavState, links: Option<&LinksState>) -> f64 {
        let (Some(model), Some(links)) = (&self.config.model, links) else { return nav.vx_m_s.hypot(nav.vy_m_s) };
        let mut state =
            State::from_slices(&[nav.x_m, nav.y_m, nav.theta_rad], &[nav.vx_m_s, nav.vy_m_s, nav.omega_rad_s]);
        for (slot, q_rad) in state.q.iter_mut().skip(3).zip(&links.q_rad[..model.link_count()]) {
            *slot = *q_rad;
        }
        model.momentum(&state).linear.norm() / model.total_mass_kg()
    }

    fn begin(&mut self, index: usize, start: Time, inputs: &Inputs, events: &mut Output<Event>) {
        let Some(phase) = self.mission.phase(index) else { return };
        events.publish(event(start, Event::INFO, format_args!("phase {}: {}", index + 1, phase.name)));
        self.phase_end = end_of(phase, start);
        self.met_since = None;
        let here = inputs.nav.get().map_or(self.sample.base_goal, |nav| [nav.x_m, nav.y_m, nav.theta_rad]);
        let s = &mut self.sample;
        s.phase = index as u32;
        s.phase_start_ns = start.ns();
        set_base_goal(s, phase, here);
        set_arm_goal(s, phase, inputs.links.get().map_or(s.q_goal_rad, |links| links.q_rad));
        match phase.base {
            BaseGoal::Meet { standoff_m } => self.meet(standoff_m, start, here, inputs),
            BaseGoal::Carry { pose } => {
                s.carrying = 1;
                s.target_goal = pose;
                s.base_goal = carried(here, self.sight.motion(start).pose, pose);
            }
            _ => {}
        }
    }

    /// The goal of a base that meets the target.
    fn meet(&mut self, standoff_m: f64, start: Time, here: [f64; 3], inputs: &Inputs) {
        let (Some(model), Some(target), Some(links)) = (&self.config.model, &self.mission.target, inputs.links.get())
        else {
            return;
        };
        let first = self.sample.phase as usize;
        let coming = &self.mission.phases[first.min(self.mission.phases.len())..];
        let q_rad = match coming.first().map(|phase| &phase.arm) {
            Some(ArmGoal::Joints(q_rad)) => q_rad.as_slice(),
            _ => &links.q_rad[..model.link_count()],
        };
        // The grasp is at the end of the arm's way to the handle.
        let mut grasp_after_s = 0.0;
        for phase in coming {
            grasp_after_s += phase.duration_s + phase.settle_s;
            if phase.arm == ArmGoal::Capture {
                break;
            }
        }
        let meeting = Meeting {
            model,
            q_rad,
            target: self.sight.motion(start),
            radius_m: target.body.radius_m,
            standoff_m,
            grasp_after_s,
        };
        (self.sample.base_goal, self.sample.base_goal_rate) = meeting.goal(here);
    }

    /// Takes in where the target is and whether it is held.
    fn look(&mut self, now: Time, inputs: &Inputs, events: &mut Output<Event>) {
        let is_held = self.sample.target_held != 0;
        let Inputs { target, target_nav, target_peer, .. } = inputs;
        if self.sight.look(now, target.fresh(), is_held, target_nav.get(), target_peer.get()) {
            events.publish(if self.sight.is_by_word() {
                event(now, Event::INFO, format_args!("the target speaks: its own navigation counts"))
            } else {
                event(now, Event::WARNING, format_args!("the target's word is stale: motion capture counts"))
            });
        }
        if let Some(links) = inputs.links.within(now, self.config.max_age_ns) {
            let last = (links.link_count as usize).clamp(1, MAX_LINKS) - 1;
            self.sample.target_held = u8::from(links.fault[last] & LinksState::GRIPPING != 0);
        }
    }

    fn tell_of_target(&mut self, now: Time) {
        let motion = self.sight.tell(now);
        (self.sample.target, self.sample.target_rate) = (motion.pose, motion.rate);
        self.sample.target_seen = u8::from(self.sight.is_known(now));
    }

    /// The safe end: thrusters shut, joints held.
    fn end(&mut self, state: u8) {
        self.sample.state = state;
        self.sample.base_mode = MissionState::BASE_FREE;
        self.sample.valves = [0; MAX_THRUSTERS];
        self.sample.arm_mode = MissionState::ARM_HOLD;
    }

    fn trouble(&self, now: Time, inputs: &Inputs) -> Option<Trouble> {
        let max_age_ns = self.config.max_age_ns;
        let running = self.sample.state == MissionState::RUNNING;
        let phase = self.mission.phase(self.sample.phase as usize).filter(|_| running);
        let Some(nav) = inputs.nav.within(now, max_age_ns) else { return Some(Trouble::Navigation) };
        match nav.mode {
            NavState::TRACKING | NavState::NO_GYRO => {}
            NavState::COASTING if running => {}
            NavState::LOST if running => return Some(Trouble::NavigationLost),
            _ => return Some(Trouble::Navigation),
        }
        if running && self.config.edges_m.is_some_and(|[x, y]| nav.x_m.abs() > x || nav.y_m.abs() > y) {
            return Some(Trouble::OffTable);
        }
        if phase.is_some_and(Phase::needs_target) && self.sample.target_held == 0 && self.sight.is_lost(now) {
            return Some(Trouble::TargetLost);
        }
        if running && self.sample.carrying != 0 && self.sample.target_held == 0 {
            return Some(Trouble::TargetDropped);
        }
        let Some(links) = inputs.links.within(now, max_age_ns) else { return Some(Trouble::Telemetry) };
        let serious = LinksState::FAULT_DRIVER | LinksState::FAULT_TORQUE_SENSOR | LinksState::FAULT_COMMAND_TIMEOUT;
        for i in 0..(links.link_count as usize).min(MAX_LINKS) {
            if links.alive[i] == 0 {
                return Some(Trouble::Link(i));
            }
            if links.fault[i] & serious != 0 && self.sample.arm_mode != MissionState::ARM_OFF {
                return Some(Trouble::LinkFault(i, links.fault[i]));
            }
        }
        let Some(arm) = inputs.arm.within(now, max_age_ns) else { return Some(Trouble::ArmController) };
        let blocked = running && arm.blocked != 0 && arm.stamp_ns > self.sample.phase_start_ns;
        blocked.then_some(Trouble::ArmBlocked)
    }
}

fn end_of(phase: &Phase, start: Time) -> Time {
    start.plus_ns((phase.longest_s() * 1e9) as u64)
}

fn event(now: Time, severity: u8, message: core::fmt::Arguments<'_>) -> Event {
    Event::new(now.ns(), MissionService::NAME, severity, message)
}

impl Service for MissionService {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "mission";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        self.look(now, inputs, &mut outputs.events);
        self.obey(now, inputs, &mut outputs.events);
        match self.sample.state {
            MissionState::WAITING => self.wait(now, inputs, &mut outputs.events),
            MissionState::RUNNING => self.run(now, inputs, &mut outputs.events),
            _ => {}
        }
        self.sample.stamp_ns = now.ns();
        self.tell_of_target(now);
        outputs.mission.publish(self.sample);
    }
}
