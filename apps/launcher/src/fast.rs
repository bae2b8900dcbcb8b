//! A whole run in one process on a virtual clock: the same cores, the same device bytes, as fast as the machine allows.

use crate::description::Description;
use crate::follower::Follower;
use crate::link_key::secret_of;
use crate::listener::Listener;
use crate::processes::start_of;
use crate::services::Services;
use crate::stack::Stack;
use crate::summary::Records;
use fss_bus::launch::{BRIDGE, GROUND, Schedule};
use fss_bus::virtual_time::{self, Tick};
use fss_bus::{Bus, BusError, Feed, InputPort, Latest, Output, OutputPort, Queue, Runner, Time};
use fss_fusion::device::{gyro_packet, packet};
use fss_fusion::{GYRO_QUEUE, GyroPacket, MOCAP_QUEUE, MocapPacket};
use fss_lab::{DeviceOutputs, LabConfig, Laboratory, TRUTH_PERIOD_NS};
use fss_links::{COMMAND_QUEUE, CommandDatagram, TELEMETRY_QUEUE, TelemetryDatagram};
use fss_messages::{MissionState, TruthState, topic};
use fss_plant::Plant;
use fss_recorder::Recorder;
use fss_records::log::LogWriter;
use fss_service::topics_of;
use fss_thrusters::{VALVES_QUEUE, ValvesCommand};
use fss_wire::dsp3000;
use fss_wire::link::Key;
use fss_wire::mocap::{Reader, Sighting};
use miette::{IntoDiagnostic, Result, miette};
use std::cell::RefCell;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::rc::Rc;

/// A mission that has not ended so long after it should have is given up, s.
const PATIENCE_S: f64 = 60.0;

/// Flies the mission in a laboratory, which may be another than the plant that the stack believes in, and records it.
///
/// # Errors
/// Where the log cannot be written or the mission does not end.
pub fn fly(
    stack: &Stack,
    laboratory: &Plant,
    log_path: &Path,
    seed: u64,
    progress: impl FnMut(&MissionState),
) -> Result<()> {
    let bus = bus(stack)?;
    let (description, path) = (Description::new(stack, "virtual", seed)?, log_path.to_owned());
    let open = move |_| {
        let mut log = LogWriter::create(&path)?;
        description.write_to(&mut log)?;
        Ok(log)
    };
    let recorder = Recorder::waiting(&bus, Box::new(open)).into_diagnostic()?;
    let recorder = Rc::new(RefCell::new(Runner::new(recorder, &bus).into_diagnostic()?));
    let outcome = until_its_end(stack, laboratory, &bus, seed, &recorder, progress);
    let recorder = Rc::into_inner(recorder).ok_or_else(|| miette!("the recorder is still in use"))?;
    let recorder = recorder.into_inner();
    let lost = recorder.service.lost();
    recorder.service.finish().into_diagnostic()?;
    if lost > 0 {
        return Err(miette!("{} could not be written: {lost} samples are missing", log_path.display()));
    }
    if !outcome? {
        return Err(miette!(
            "the mission did not end within {PATIENCE_S} s of its time; the log says what it waits for"
        ));
    }
    Ok(())
}

/// Flies the mission and gives what [`fly`] would record of it, without a log.
///
/// # Errors
/// Where the stack does not fly. A mission that does not end is none: its records say so.
pub fn fly_unrecorded(stack: &Stack, seed: u64) -> Result<Records> {
    let bus = bus(stack)?;
    let listener = Rc::new(RefCell::new(Listener::new(&bus).into_diagnostic()?));
    let outcome = until_its_end(stack, stack.laboratory(), &bus, seed, &listener, |_| ());
    let listener = Rc::into_inner(listener).ok_or_else(|| miette!("the listener is still in use"))?;
    outcome.map(|_has_ended| listener.into_inner().told())
}

fn bus(stack: &Stack) -> Result<Bus> {
    Ok(Bus::local().for_stack(&stack.launch).with_program_topics(topics_of(&stack.programs)?))
}

/// Flies until the mission has ended, or until it is given up, which gives false; `recorder` stands where the launch file has the recorder.
fn until_its_end(
    stack: &Stack,
    laboratory: &Plant,
    bus: &Bus,
    seed: u64,
    recorder: &Rc<RefCell<impl Tick + 'static>>,
    mut progress: impl FnMut(&MissionState),
) -> Result<bool> {
    let mut mission = Latest::open(bus, topic::MISSION_STATE).into_diagnostic()?;
    let mut clock = virtual_time::Stack::new();
    for schedule in &stack.launch.services {
        add(&mut clock, schedule, (stack, laboratory), bus, seed, recorder)?;
    }
    let deadline = Time::from_ns(((stack.mission.duration_s() + PATIENCE_S) * 1e9) as u64);
    loop {
        let Some(now) = clock.step().into_diagnostic()? else {
            return Err(miette!("the launch file starts no service"));
        };
        mission.refresh();
        if let Some(state) = mission.fresh() {
            let state: &MissionState = state;
            progress(state);
            if state.state == MissionState::DONE || state.state == MissionState::ABORTED {
                recorder.borrow_mut().tick(now).into_diagnostic()?; // the last samples
                return Ok(true);
            }
        }
        if now > deadline {
            return Ok(false);
        }
    }
}

/// A member that the run needs back when the clock has stopped.
struct Shared<T>(Rc<RefCell<T>>);

impl<T: Tick> Tick for Shared<T> {
    fn tick(&mut self, now: Time) -> Result<(), BusError> {
        self.0.borrow_mut().tick(now)
    }
}

fn add(
    clock: &mut virtual_time::Stack<'_>,
    schedule: &Schedule,
    (stack, laboratory): (&Stack, &Plant),
    bus: &Bus,
    seed: u64,
    recorder: &Rc<RefCell<impl Tick + 'static>>,
) -> Result<()> {
    let (period_ns, phase_ns) = (schedule.period_ns(), schedule.phase_ns());
    let name = schedule.name.get_ref().as_str();
    if let Some((path, description)) = stack.program(name) {
        clock.add(Follower::start(stack, (path, description), bus, seed, 1)?, period_ns, phase_ns);
        return Ok(());
    }
    match name {
        "recorder" => clock.add(Shared(recorder.clone()), period_ns, phase_ns),
        "lab" => clock.add(VirtualLaboratory::new(stack, laboratory, bus, seed)?, period_ns, phase_ns),
        // Nobody can watch a clock that nobody waits for, and no other vehicle flies by it.
        GROUND | BRIDGE => {}
        _ => {
            let service = Services::linked().get(name);
            let service = service.ok_or_else(|| miette!("service '{name}' does not fly on a virtual clock"))?;
            clock.add(service.on_virtual_clock(stack, bus, seed)?, period_ns, phase_ns);
        }
    }
    Ok(())
}

/// The laboratory with its devices wired to the services' queues, through the same bytes as in real time.
struct VirtualLaboratory {
    laboratory: Laboratory,
    wires: Wires,
    commands: Queue<CommandDatagram>,
    valves: Queue<ValvesCommand>,
    truth: Output<TruthState>,
    next_truth_ns: u64,
}

struct Wires {
    reader: Reader,
    mocap: Queue<MocapPacket>,
    gyro: Queue<GyroPacket>,
    decoder: dsp3000::Decoder,
    telemetry: Queue<TelemetryDatagram>,
}

impl VirtualLaboratory {
    fn new(stack: &Stack, plant: &Plant, bus: &Bus, seed: u64) -> Result<Self> {
        let mut config = LabConfig::new(seed, Key::new(&secret_of(seed)).into_diagnostic()?);
        config.start = start_of(&stack.mission, plant, seed);
        config.tracker = stack.launch.devices.mocap.tracker();
        stack.faults.apply_to(&mut config);
        let mut wires = Wires {
            reader: Reader::new(config.tracker.clone()),
            mocap: queue(bus, MOCAP_QUEUE)?,
            gyro: queue(bus, GYRO_QUEUE)?,
            decoder: dsp3000::Decoder::new(),
            telemetry: queue(bus, TELEMETRY_QUEUE)?,
        };
        wires.mocap(0, &config.tracker.introduction());
        Ok(Self {
            laboratory: Laboratory::new(plant, config, 0).into_diagnostic()?,
            wires,
            commands: queue(bus, COMMAND_QUEUE)?,
            valves: queue(bus, VALVES_QUEUE)?,
            truth: Output::open(bus, topic::TRUTH_STATE).into_diagnostic()?,
            next_truth_ns: 0,
        })
    }
}

fn queue<T: Send + 'static>(bus: &Bus, name: &'static str) -> Result<Queue<T>> {
    bus.queue(name, Feed::<T>::CAPACITY).into_diagnostic()
}

impl Tick for VirtualLaboratory {
    fn tick(&mut self, now: Time) -> Result<(), BusError> {
        while let Some(command) = self.valves.pop() {
            self.laboratory.set_valves(command.mask, command.at_ns);
        }
        let from = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        while let Some(command) = self.commands.pop() {
            self.laboratory.command_link(command.link, from, &command.bytes);
        }
        self.laboratory.step_to(now.ns(), &mut self.wires);
        if now.ns() >= self.next_truth_ns {
            self.next_truth_ns += TRUTH_PERIOD_NS;
            self.truth.publish(self.laboratory.truth());
            self.truth.flush(now);
        }
        Ok(())
    }
}

impl DeviceOutputs for Wires {
    fn mocap(&mut self, time_ns: u64, bytes: &[u8]) {
        let queue = &self.mocap;
        let hand_over = |sighting: Sighting| {
            queue.force_push(packet(&sighting, time_ns));
        };
        // What the network has damaged is lost.
        let _ = self.reader.read(bytes, hand_over);
    }

    fn gyro(&mut self, time_ns: u64, bytes: &[u8]) {
        for &byte in bytes {
            if let Some(reading) = self.decoder.push(byte) {
                self.gyro.force_push(gyro_packet(reading, time_ns));
            }
        }
    }

    fn link(&mut self, time_ns: u64, _link: usize, _to: SocketAddr, datagram: &[u8]) {
        self.telemetry.force_push(TelemetryDatagram::new(time_ns, datagram));
    }
}
