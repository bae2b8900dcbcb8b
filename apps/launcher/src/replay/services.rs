//! Each service with what it read and wrote.

use super::player::{FromDevice, Player, Verdict, replay};
use super::tape::Tape;
use crate::stack::Stack;
use fss_arm::{ArmConfig, ArmService};
use fss_base::{Base, BaseConfig};
use fss_bus::{Bus, Feed, Queue, Service};
use fss_calibration::{Calibration, MovementBand};
use fss_fusion::{Fusion, FusionConfig, GYRO_QUEUE, GyroPacket, MOCAP_QUEUE, MocapPacket};
use fss_links::{LinksConfig, LinksService, TELEMETRY_QUEUE, TelemetryDatagram};
use fss_messages::{MocapPose, Step, topic};
use fss_mission::{MissionConfig, MissionService};
use fss_records::log::Log;
use fss_thrusters::{DRIVER_QUEUE, Thrusters};
use fss_wire::link::Key;
use miette::{IntoDiagnostic, Result, miette};

/// Reads the topics of every service that is replayed.
///
/// # Errors
/// Where the logs cannot be read.
pub(super) fn tape(stack: &Stack, logs: &[Log]) -> Result<Tape> {
    Tape::new(&stack.launch)
        .with_ports_of::<Fusion>()
        .with_ports_of::<LinksService>()
        .with_ports_of::<MissionService>()
        .with_ports_of::<ArmService>()
        .with_ports_of::<Base>()
        .with_ports_of::<Thrusters>()
        .with_ports_of::<Calibration>()
        .read(logs)
        .into_diagnostic()
}

/// Replays every service of the stack.
///
/// # Errors
/// Where a service cannot be made from the stack's files.
pub(super) fn replay_all(stack: &Stack, tape: &Tape) -> Result<Vec<Verdict>> {
    let mut verdicts = vec![
        replay(tape, |_| fusion(stack, tape))?,
        replay(tape, |life| links(stack, tape, life))?,
        replay(tape, |life| mission(stack, tape, life))?,
        replay(tape, |_| arm(stack, tape))?,
        replay(tape, |_| base(stack, tape))?,
        replay(tape, |_| thrusters(stack, tape))?,
    ];
    if stack.launch.schedule(Calibration::NAME).is_some() {
        verdicts.push(replay(tape, |_| calibration(stack, tape))?);
    }
    Ok(verdicts)
}

fn bus(stack: &Stack) -> Bus {
    Bus::local().for_stack(&stack.launch)
}

fn queue<T: Send + 'static>(bus: &Bus, name: &'static str) -> Result<Queue<T>> {
    bus.queue(name, Feed::<T>::CAPACITY).into_diagnostic()
}

fn fusion<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, Fusion>> {
    let bus = &bus(stack);
    let (mocap, gyro) = (queue(bus, MOCAP_QUEUE)?, queue(bus, GYRO_QUEUE)?);
    let poses = [topic::MOCAP_BASE, topic::MOCAP_END_EFFECTOR, topic::MOCAP_TARGET];
    let [base, end_effector, target] = poses.map(|topic| tape.topic(topic));
    let bodies = [base?, end_effector?, target?];
    let rates = tape.topic(topic::GYRO)?;
    let give_mocap = move |step: &Step, _| {
        let frames = frames(bodies.map(|body| body.at(step.published_ns)));
        frames.iter().filter(|frame| mocap.push(**frame).is_ok()).count() as u64
    };
    let give_gyro = move |step: &Step, _| {
        let readings = rates.at(step.published_ns).iter().map(|reading| GyroPacket {
            received_ns: reading.received_ns,
            rate_rad_s: reading.omega_rad_s,
            valid: reading.valid != 0,
        });
        readings.filter(|reading| gyro.push(*reading).is_ok()).count() as u64
    };
    let devices = vec![
        // A frame that names no body of ours is no sample, and does nothing.
        FromDevice { queue: MOCAP_QUEUE, name: "motion capture frames", complete: false, give: Box::new(give_mocap) },
        FromDevice { queue: GYRO_QUEUE, name: "gyro readings", complete: true, give: Box::new(give_gyro) },
    ];
    Player::new(Fusion::new(FusionConfig::from_plant(&stack.plant)), bus, tape, devices)
}

/// Frames of motion capture put together again from the poses of their bodies.
fn frames(mut bodies: [&[MocapPose]; 3]) -> Vec<MocapPacket> {
    let mut frames = Vec::new();
    // All bodies stand in the order in which the frames came.
    while let Some(next) = bodies.iter().filter_map(|poses| poses.first()).min_by_key(|pose| pose.received_ns) {
        let (received_ns, frame) = (next.received_ns, next.frame);
        let poses = bodies.each_mut().map(|poses| {
            let (first, rest) = poses.split_first()?;
            let same = first.received_ns == received_ns && first.frame == frame;
            same.then(|| {
                *poses = rest;
                [first.x_m, first.y_m, first.theta_rad]
            })
        });
        frames.push(MocapPacket { received_ns, frame, poses });
    }
    frames
}

fn links<'a>(stack: &Stack, tape: &'a Tape, life: &[Step]) -> Result<Player<'a, LinksService>> {
    let bus = &bus(stack);
    let telemetry = queue::<TelemetryDatagram>(bus, TELEMETRY_QUEUE)?;
    let received = tape.topic(topic::LINKS_TELEMETRY)?;
    let give = move |step: &Step, _| {
        let datagrams = received.at(step.published_ns);
        datagrams.iter().filter(|datagram| telemetry.push((*datagram).into()).is_ok()).count() as u64
    };
    // Commands are numbered from the calendar time of the start: the first number that the log shows.
    let sent = tape.topic(topic::LINKS_STATE)?.since(life[0].published_ns).iter().map(|state| state.command_sequence);
    let first = sent.flatten().find(|sequence| *sequence > 0).map_or(0, |sequence| sequence - 1);
    // The signature goes out to the links only; no key is needed to compute the state again.
    let key = Key::new(&[1; 32]).into_diagnostic()?;
    let devices =
        vec![FromDevice { queue: TELEMETRY_QUEUE, name: "telemetry datagrams", complete: true, give: Box::new(give) }];
    Player::new(LinksService::new(LinksConfig::new(&stack.plant), key, first), bus, tape, devices)
}

fn mission<'a>(stack: &Stack, tape: &'a Tape, life: &[Step]) -> Result<Player<'a, MissionService>> {
    let (mission, config) = (stack.mission.clone(), MissionConfig::for_plant(&stack.plant));
    // A process that was started again went on from what the one before had published last.
    let service = match tape.topic(topic::MISSION_STATE)?.before(life[0].published_ns) {
        Some(last) => MissionService::resumed(mission, config, *last),
        None => MissionService::new(mission, config),
    };
    Player::new(service, &bus(stack), tape, Vec::new())
}

fn arm<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, ArmService>> {
    let service = ArmService::new(ArmConfig::new(&stack.plant).into_diagnostic()?);
    Player::new(service, &bus(stack), tape, Vec::new())
}

fn calibration<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, Calibration>> {
    let service = Calibration::new(stack.plant.link_count(), MovementBand::of(&stack.plant));
    Player::new(service, &bus(stack), tape, Vec::new())
}

fn base<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, Base>> {
    let model = stack.plant.model().into_diagnostic()?;
    let schedule = stack.launch.schedule(Base::NAME).ok_or_else(|| miette!("the launch file has no service 'base'"))?;
    let service = Base::new(BaseConfig::from_plant(&stack.plant, model, *schedule.rate_hz.get_ref()));
    Player::new(service, &bus(stack), tape, Vec::new())
}

fn thrusters<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, Thrusters>> {
    let bus = &bus(stack);
    let driver = queue(bus, DRIVER_QUEUE)?;
    let states = tape.topic(topic::THRUSTERS_STATE)?;
    let give = move |step: &Step, had| {
        // Of several words of the driver only the last counts, and the state says which it was.
        let words = states.at(step.published_ns).iter().map(|state| state.driver_works != 0);
        if had > 0 && words.take(1).filter(|word| driver.push(*word).is_ok()).count() == 1 { had } else { 0 }
    };
    let devices = vec![FromDevice {
        queue: DRIVER_QUEUE,
        name: "words of the valve driver",
        complete: true,
        give: Box::new(give),
    }];
    Player::new(Thrusters::new(stack.plant.thrusters.len()), bus, tape, devices)
}
