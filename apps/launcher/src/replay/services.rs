//! Each service with what it read and wrote.

use super::player::{Checker, Feeder, FromDevice, FromTopic, Player, ToTopic, Verdict, replay};
use super::tape::Tape;
use crate::stack::Stack;
use fss_arm::{ArmConfig, ArmService};
use fss_base::{Base, BaseConfig};
use fss_bus::{Bus, Feed, Queue, Runner, Service};
use fss_calibration::{Calibration, MovementBand};
use fss_fusion::{Fusion, FusionConfig, GYRO_QUEUE, GyroPacket, MocapPacket, VICON_QUEUE};
use fss_links::{LinksConfig, LinksService, TELEMETRY_QUEUE, TelemetryDatagram};
use fss_messages::{MocapPose, Step};
use fss_mission::{MissionConfig, MissionService};
use fss_thrusters::{DRIVER_QUEUE, Thrusters};
use fss_wire::link::Key;
use miette::{IntoDiagnostic, Result, miette};

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

macro_rules! player {
    ($service:expr, $bus:expr, [$($input:expr),* $(,)?], [$($output:expr),* $(,)?]) => {
        Ok(Player {
            runner: Runner::new($service, $bus).into_diagnostic()?,
            inputs: vec![$( $input as Box<dyn Feeder + '_> ),*],
            outputs: vec![$( ToTopic::open($bus, $output).into_diagnostic()? as Box<dyn Checker + '_> ),*],
        })
    };
}

fn fusion<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, Fusion>> {
    let bus = &bus(stack);
    let (vicon, gyro) = (queue(bus, VICON_QUEUE)?, queue(bus, GYRO_QUEUE)?);
    let give_vicon = move |step: &Step| {
        let at = step.published_ns;
        let frames = frames([tape.mocap_base.at(at), tape.mocap_end_effector.at(at), tape.mocap_target.at(at)]);
        frames.iter().filter(|frame| vicon.push(**frame).is_ok()).count() as u64
    };
    let give_gyro = move |step: &Step| {
        let readings = tape.gyro.at(step.published_ns).iter().map(|reading| GyroPacket {
            received_ns: reading.received_ns,
            rate_rad_s: reading.omega_rad_s,
            valid: reading.valid != 0,
        });
        readings.filter(|reading| gyro.push(*reading).is_ok()).count() as u64
    };
    player!(
        Fusion::new(FusionConfig::from_plant(&stack.plant)),
        bus,
        [
            // A frame that names no body of ours is no sample, and does nothing.
            Box::new(FromDevice { name: "motion capture frames", complete: false, give: give_vicon }),
            Box::new(FromDevice { name: "gyro readings", complete: true, give: give_gyro }),
        ],
        [&tape.mocap_base, &tape.mocap_end_effector, &tape.mocap_target, &tape.gyro, &tape.nav, &tape.events]
    )
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
    let give = move |step: &Step| {
        let datagrams = tape.telemetry.at(step.published_ns);
        datagrams.iter().filter(|datagram| telemetry.push((*datagram).into()).is_ok()).count() as u64
    };
    // Commands are numbered from the calendar time of the start: the first number that the log shows.
    let sent = tape.links.since(life[0].published_ns).iter().map(|state| state.command_sequence);
    let first = sent.flatten().find(|sequence| *sequence > 0).map_or(0, |sequence| sequence - 1);
    // The signature goes out to the links only; no key is needed to compute the state again.
    let key = Key::new(&[1; 32]).into_diagnostic()?;
    player!(
        LinksService::new(LinksConfig::new(&stack.plant), key, first),
        bus,
        [
            Box::new(FromDevice { name: "telemetry datagrams", complete: true, give }),
            FromTopic::open(bus, &tape.arm).into_diagnostic()?,
        ],
        [&tape.telemetry, &tape.links, &tape.events]
    )
}

fn mission<'a>(stack: &Stack, tape: &'a Tape, life: &[Step]) -> Result<Player<'a, MissionService>> {
    let bus = &bus(stack);
    let (mission, config) = (stack.mission.clone(), MissionConfig::for_plant(&stack.plant));
    // A process that was started again went on from what the one before had published last.
    let service = match tape.mission.before(life[0].published_ns) {
        Some(last) => MissionService::resumed(mission, config, *last),
        None => MissionService::new(mission, config),
    };
    player!(
        service,
        bus,
        [
            FromTopic::open(bus, &tape.nav).into_diagnostic()?,
            FromTopic::open(bus, &tape.links).into_diagnostic()?,
            FromTopic::open(bus, &tape.arm).into_diagnostic()?,
            FromTopic::open(bus, &tape.mocap_target).into_diagnostic()?,
            FromTopic::open(bus, &tape.mission_command).into_diagnostic()?,
            FromTopic::open(bus, &tape.target_nav).into_diagnostic()?,
            FromTopic::open(bus, &tape.target_peer).into_diagnostic()?,
        ],
        [&tape.mission, &tape.events]
    )
}

fn arm<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, ArmService>> {
    let bus = &bus(stack);
    player!(
        ArmService::new(ArmConfig::new(&stack.plant).into_diagnostic()?),
        bus,
        [
            FromTopic::open(bus, &tape.nav).into_diagnostic()?,
            FromTopic::open(bus, &tape.links).into_diagnostic()?,
            FromTopic::open(bus, &tape.mission).into_diagnostic()?,
            FromTopic::open(bus, &tape.mocap_end_effector).into_diagnostic()?,
            FromTopic::open(bus, &tape.parameters_command).into_diagnostic()?,
        ],
        [&tape.arm, &tape.parameters_state, &tape.events]
    )
}

fn calibration<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, Calibration>> {
    let bus = &bus(stack);
    player!(
        Calibration::new(stack.plant.link_count(), MovementBand::of(&stack.plant)),
        bus,
        [
            FromTopic::open(bus, &tape.mocap_end_effector).into_diagnostic()?,
            FromTopic::open(bus, &tape.mocap_base).into_diagnostic()?,
            FromTopic::open(bus, &tape.links).into_diagnostic()?,
            FromTopic::open(bus, &tape.mission).into_diagnostic()?,
        ],
        [&tape.postures, &tape.events]
    )
}

fn base<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, Base>> {
    let bus = &bus(stack);
    let model = stack.plant.model().into_diagnostic()?;
    let schedule = stack.launch.schedule(Base::NAME).ok_or_else(|| miette!("the launch file has no service 'base'"))?;
    player!(
        Base::new(BaseConfig::from_plant(&stack.plant, model, *schedule.rate_hz.get_ref())),
        bus,
        [
            FromTopic::open(bus, &tape.nav).into_diagnostic()?,
            FromTopic::open(bus, &tape.mocap_base).into_diagnostic()?,
            FromTopic::open(bus, &tape.mission).into_diagnostic()?,
            FromTopic::open(bus, &tape.links).into_diagnostic()?,
            FromTopic::open(bus, &tape.parameters_command).into_diagnostic()?,
        ],
        [&tape.base, &tape.thrusters, &tape.parameters_state, &tape.events]
    )
}

fn thrusters<'a>(stack: &Stack, tape: &'a Tape) -> Result<Player<'a, Thrusters>> {
    let bus = &bus(stack);
    let driver = queue(bus, DRIVER_QUEUE)?;
    let give = move |step: &Step| {
        // Of several words of the driver only the last counts, and the state says which it was.
        let had = step.input[1];
        let words = tape.valves.at(step.published_ns).iter().map(|state| state.driver_works != 0);
        if had > 0 && words.take(1).filter(|word| driver.push(*word).is_ok()).count() == 1 { had } else { 0 }
    };
    player!(
        Thrusters::new(stack.plant.thrusters.len()),
        bus,
        [
            FromTopic::open(bus, &tape.thrusters).into_diagnostic()?,
            Box::new(FromDevice { name: "words of the valve driver", complete: true, give }),
        ],
        [&tape.valves, &tape.events]
    )
}
