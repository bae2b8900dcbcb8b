//! Flies a mission: phase after phase, or the safe end.

use crate::{ArmGoal, BaseGoal, Mission, Phase, Pulse, Sine};
use fss_bus::{Latest, Output, Service, Time, inputs, outputs};
use fss_messages::{ArmCommand, Event, LinksState, MAX_LINKS, MAX_SINES, MAX_THRUSTERS, MissionState, NavState, topic};

/// How patient the mission is.
#[derive(Clone, Copy, Debug)]
pub struct MissionConfig {
    /// Older navigation, telemetry or arm commands are missing ones, ns.
    pub max_age_ns: u64,
    /// Navigation and telemetry must be good for this long before the first phase begins, ns.
    pub ready_ns: u64,
    /// What is missing or faulty for this long aborts the mission, ns.
    pub patience_ns: u64,
}

impl Default for MissionConfig {
    fn default() -> Self {
        Self { max_age_ns: 500_000_000, ready_ns: 1_000_000_000, patience_ns: 1_000_000_000 }
    }
}

inputs! {
    /// What the mission watches.
    pub struct Inputs {
        /// Navigation state of the base.
        nav: Latest<NavState> = topic::NAV_STATE,
        /// Telemetry of the links.
        links: Latest<LinksState> = topic::LINKS_STATE,
        /// How the arm's task goes.
        arm: Latest<ArmCommand> = topic::ARM_COMMAND,
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

/// Why the mission cannot go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    Navigation,
    NavigationLost,
    Telemetry,
    Link(usize),
    LinkFault(usize, u8),
    ArmController,
    ArmBlocked,
}

impl Trouble {
    /// Whether waiting cannot mend it.
    fn is_final(self) -> bool {
        matches!(self, Self::NavigationLost | Self::ArmBlocked)
    }
}

impl core::fmt::Display for Trouble {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Navigation => write!(f, "no navigation state: is fusion running, are motion capture and gyro on?"),
            Self::NavigationLost => write!(f, "navigation is lost"),
            Self::Telemetry => write!(f, "no telemetry: is links running?"),
            Self::Link(i) => write!(f, "link {} is silent", i + 1),
            Self::LinkFault(i, bits) => write!(f, "link {} reports fault bits {bits:#04x}", i + 1),
            Self::ArmController => write!(f, "the arm controller is silent"),
            Self::ArmBlocked => write!(f, "the arm is blocked: joint limits or a singularity end its line here"),
        }
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
        Self { mission, config, sample, since: None, phase_end: Time::default() }
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
                events.publish(event(now, Event::ERROR, format_args!("mission aborted: {trouble}")));
                self.end(MissionState::ABORTED);
                return;
            }
        } else {
            self.since = None;
        }
        while self.sample.state == MissionState::RUNNING && now >= self.phase_end {
            let next = self.sample.phase as usize + 1;
            if next < self.mission.phases.len() {
                self.begin(next, self.phase_end, inputs, events);
            } else {
                events.publish(event(now, Event::INFO, format_args!("mission {} is done", self.mission.name)));
                self.end(MissionState::DONE);
            }
        }
        if self.sample.base_mode == MissionState::BASE_VALVES
            && let BaseGoal::Valves(pulses) = &self.mission.phases[self.sample.phase as usize].base
        {
            self.sample.valves = open_valves(pulses, now.age_ns(self.sample.phase_start_ns));
        }
    }

    fn begin(&mut self, index: usize, start: Time, inputs: &Inputs, events: &mut Output<Event>) {
        let phase = &self.mission.phases[index];
        let Phase { name, duration_s, settle_s, .. } = phase;
        events.publish(event(start, Event::INFO, format_args!("phase {}: {name}", index + 1)));
        self.phase_end = start.plus_ns(((duration_s + settle_s) * 1e9) as u64);
        let here = inputs.nav.get().map_or(self.sample.base_goal, |nav| [nav.x_m, nav.y_m, nav.theta_rad]);
        let s = &mut self.sample;
        s.phase = index as u32;
        s.phase_start_ns = start.ns();
        set_base_goal(s, phase, here);
        set_arm_goal(s, phase);
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
        let Some(nav) = inputs.nav.within(now, max_age_ns) else { return Some(Trouble::Navigation) };
        match nav.mode {
            NavState::TRACKING | NavState::NO_GYRO => {}
            NavState::COASTING if running => {}
            NavState::LOST if running => return Some(Trouble::NavigationLost),
            _ => return Some(Trouble::Navigation),
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

/// Base goals are published as absolute poses, so that a controller that restarts within a phase still knows them.
fn set_base_goal(s: &mut MissionState, phase: &Phase, here: [f64; 3]) {
    let was_controlled = s.base_mode == MissionState::BASE_HOLD;
    s.base_goal_relative = 0;
    s.base_mode = MissionState::BASE_HOLD;
    s.base_duration_s = phase.duration_s;
    s.valves = [0; MAX_THRUSTERS];
    match phase.base {
        BaseGoal::Free => {
            s.base_mode = MissionState::BASE_FREE;
            s.base_goal = here;
        }
        BaseGoal::Hold => {
            s.base_duration_s = 0.0;
            s.base_goal = if was_controlled { s.base_goal } else { here };
        }
        BaseGoal::Goto { pose: [x, y, theta], relative: true } => {
            s.base_goal = [here[0] + x, here[1] + y, here[2] + theta];
        }
        BaseGoal::Goto { pose: [x, y, theta], relative: false } => {
            // The heading is unwrapped: take the turn that is the shorter one.
            let turn =
                (theta - here[2] + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
            s.base_goal = [x, y, here[2] + turn];
        }
        BaseGoal::Valves(_) => {
            s.base_mode = MissionState::BASE_VALVES;
            s.base_goal = here;
        }
    }
}

/// Which valves the pulses want open `since_ns` after the start of their phase.
fn open_valves(pulses: &[Pulse], since_ns: u64) -> [u8; MAX_THRUSTERS] {
    let mut valves = [0; MAX_THRUSTERS];
    // The mission steps on a raster of its own: what falls between two steps comes with the later one.
    let ns = |time_s: f64| (time_s * 1e9).round() as u64;
    for pulse in pulses.iter().filter(|p| (ns(p.at_s)..ns(p.at_s + p.for_s)).contains(&since_ns)) {
        for &thruster in &pulse.thrusters {
            if let Some(valve) = valves.get_mut(thruster) {
                *valve = 1;
            }
        }
    }
    valves
}

fn set_sines(s: &mut MissionState, sines: &[Sine]) {
    s.sine_amplitude_rad = [0.0; MAX_LINKS * MAX_SINES];
    let mut used = [0; MAX_LINKS];
    for sine in sines {
        let Some(own) = used.get_mut(sine.joint).filter(|own| **own < MAX_SINES) else { continue };
        let slot = sine.joint * MAX_SINES + *own;
        *own += 1;
        s.sine_amplitude_rad[slot] = sine.amplitude_rad;
        s.sine_frequency_hz[slot] = sine.frequency_hz;
        s.sine_phase_rad[slot] = sine.phase_rad;
    }
}

fn set_arm_goal(s: &mut MissionState, phase: &Phase) {
    s.arm_duration_s = phase.duration_s;
    s.arm_mode = match &phase.arm {
        ArmGoal::Off => MissionState::ARM_OFF,
        ArmGoal::Hold => MissionState::ARM_HOLD,
        ArmGoal::Joints(q_rad) => {
            for (goal, q) in s.q_goal_rad.iter_mut().zip(q_rad) {
                *goal = *q;
            }
            MissionState::ARM_JOINTS
        }
        ArmGoal::Sines { about_rad, sines } => {
            for (goal, q) in s.q_goal_rad.iter_mut().zip(about_rad) {
                *goal = *q;
            }
            set_sines(s, sines);
            MissionState::ARM_SINES
        }
        ArmGoal::Line { length_m, direction_rad, keep_orientation, zero_reaction } => {
            s.line_length_m = *length_m;
            s.line_direction_rad = *direction_rad;
            match (zero_reaction, keep_orientation) {
                (false, false) => MissionState::ARM_LINE,
                (false, true) => MissionState::ARM_LINE_POSE,
                (true, false) => MissionState::ARM_ZERO_REACTION,
                (true, true) => MissionState::ARM_ZERO_REACTION_POSE,
            }
        }
    };
}

fn event(now: Time, severity: u8, message: core::fmt::Arguments<'_>) -> Event {
    Event::new(now.ns(), MissionService::NAME, severity, message)
}

impl Service for MissionService {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "mission";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        match self.sample.state {
            MissionState::WAITING => self.wait(now, inputs, &mut outputs.events),
            MissionState::RUNNING => self.run(now, inputs, &mut outputs.events),
            _ => {}
        }
        self.sample.stamp_ns = now.ns();
        outputs.mission.publish(self.sample);
    }
}
