//! The calibration job in flight: collects the postures in which the arm stands still.
//!
//! A mission that asks for it (`services = ["calibration"]`) moves the arm from posture to posture. Of each this service
//! publishes the mean encoder angles and the mean pose of the end-effector seen from the base, which may float meanwhile:
//! both poses come from one frame of motion capture. The estimate is made of these postures when the flight is over, by
//! `fss calibrate kinematic` and by `fss run` with the same function: flight waits for no matrix.
//!
//! What counts as still: from one report to the next no joint moves by more than the [`MovementBand`], and has not for
//! [`SETTLE_NS`]. A frame counts when the report after it says that the arm still stood.
//!
//! Nothing is kept over a restart: the rest begins anew, and what was published before stays in the log.

mod mean;
mod program;
mod rest;

use fss_bus::{Latest, Output, Service, Time, inputs, outputs};
use fss_messages::{Event, LinksState, MAX_LINKS, MissionState, MocapPose, Posture, topic};
use fss_plant::Plant;
use rest::{Frames, Rest};

/// After coming to rest, the arm still settles for so long, ns.
pub const SETTLE_NS: u64 = 1_000_000_000;
/// Reports of every link that make a posture.
pub const LEAST_REPORTS: u32 = 5;
/// Frames of motion capture that make a posture.
pub const LEAST_FRAMES: u32 = 20;
/// Reports farther apart do not tell that the arm stood still between them, ns.
const LONGEST_GAP_NS: u64 = 600_000_000;
/// A mission state that is older counts as none, ns.
const MISSION_AGE_NS: u64 = 500_000_000;

/// How far a joint may move between two of its reports and still count as still, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovementBand(pub f64);

impl MovementBand {
    /// 2 mrad, or eight standard deviations of the encoders where that is more.
    pub fn of(plant: &Plant) -> Self {
        Self((8.0 * plant.sensors.encoder_rad).max(0.002))
    }
}

inputs! {
    /// What the service reads: of motion capture the newest frame, which is enough for a mean.
    pub struct Inputs {
        /// Frames of the end-effector.
        end_effector: Latest<MocapPose> = topic::MOCAP_END_EFFECTOR,
        /// Frames of the base.
        base: Latest<MocapPose> = topic::MOCAP_BASE,
        /// Telemetry of the links.
        links: Latest<LinksState> = topic::LINKS_STATE,
        /// Whether the mission flies, and which phase.
        mission: Latest<MissionState> = topic::MISSION_STATE,
    }
}

outputs! {
    /// What the service writes.
    pub struct Outputs {
        /// The posture, anew with each report.
        posture: Output<Posture> = topic::CALIBRATION_POSTURE,
        /// What happened.
        events: Output<Event> = topic::EVENTS,
    }
}

/// The service.
pub struct Calibration {
    link_count: usize,
    band: MovementBand,
    frames: Frames,
    rest: Option<Rest>,
    /// When each link's last report was measured, ns.
    measured_ns: [u64; MAX_LINKS],
    phase_start_ns: u64,
    number: u32,
}

impl Calibration {
    /// For a vehicle with this many links, at most [`MAX_LINKS`].
    pub fn new(link_count: usize, band: MovementBand) -> Self {
        Self {
            link_count: link_count.min(MAX_LINKS),
            band,
            frames: Frames::default(),
            rest: None,
            measured_ns: [0; MAX_LINKS],
            phase_start_ns: 0,
            number: 0,
        }
    }

    fn forget(&mut self) {
        self.rest = None;
        self.frames.forget();
    }

    /// Whether every link has reported since the last time; takes note of when.
    fn is_new_row(&mut self, links: &LinksState) -> bool {
        let n = self.link_count;
        let complete = links.measured_ns[..n].iter().zip(&self.measured_ns).all(|(now, before)| now > before);
        if complete {
            self.measured_ns = links.measured_ns;
        }
        complete
    }

    fn look(&mut self, now: Time, links: &LinksState, outputs: &mut Outputs) {
        let n = self.link_count;
        if links.link_count as usize != n || links.alive[..n].contains(&0) {
            self.forget();
            return;
        }
        if !self.is_new_row(links) {
            return;
        }
        let times = &links.measured_ns[..n];
        let (Some(&first_ns), Some(&last_ns)) = (times.iter().min(), times.iter().max()) else { return };
        let stands = |rest: &&mut Rest| {
            first_ns.saturating_sub(rest.reported_ns) < LONGEST_GAP_NS
                && rest.holds(&links.measured_q_rad[..n], self.band)
        };
        let Some(rest) = self.rest.as_mut().filter(stands) else {
            self.frames.forget_until(last_ns);
            self.rest = Some(Rest::begin(last_ns, &links.measured_q_rad));
            return;
        };
        rest.reported_ns = last_ns;
        rest.take(&mut self.frames, first_ns, &links.measured_q_rad);
        if rest.reports() < LEAST_REPORTS || rest.frames() < LEAST_FRAMES {
            return;
        }
        if rest.number == 0 {
            self.number += 1;
            rest.number = self.number;
            let message = format_args!("posture {}: the arm stands still", self.number);
            outputs.events.publish(Event::new(now.ns(), Self::NAME, Event::INFO, message));
        }
        outputs.posture.publish(Posture { link_count: n as u32, ..rest.posture(first_ns) });
    }
}

impl Service for Calibration {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "calibration";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        let mission = inputs.mission.within(now, MISSION_AGE_NS);
        let Some(mission) = mission.filter(|mission| mission.state == MissionState::RUNNING) else {
            self.forget();
            return;
        };
        if mission.phase_start_ns != self.phase_start_ns {
            // The arm gets its next goal.
            self.phase_start_ns = mission.phase_start_ns;
            self.forget();
        }
        if let (Some(base), Some(tip)) = (inputs.base.get(), inputs.end_effector.fresh()) {
            self.frames.take(base, tip);
        }
        if let Some(links) = inputs.links.fresh() {
            self.look(now, links, outputs);
        }
    }
}
