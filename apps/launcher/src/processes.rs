//! One process of a stack: a service with its devices, or the laboratory.

use crate::description::{Description, unix_time_ns};
use crate::files::program_of;
use crate::launcher::BIRTH_TIME;
use crate::link_key::read_key;
use crate::stack::LOG_FILE;
use crate::stack::Stack;
use fss_arm::{ArmConfig, ArmService};
use fss_base::{Base, BaseConfig};
use fss_bus::health::{Monitor, REPORT_PERIOD_NS};
use fss_bus::launch::PROGRAMS;
use fss_bus::{Output, OutputPort, Time, realtime};
use fss_calibration::{Calibration, MovementBand};
use fss_fusion::device::{read_gyro, receive_mocap};
use fss_fusion::{Fusion, FusionConfig, GYRO_QUEUE, MOCAP_QUEUE};
use fss_lab::process::{Addresses, Process, Stepped};
use fss_lab::{LabConfig, Start};
use fss_links::{COMMAND_QUEUE, LinksConfig, LinksService, TELEMETRY_QUEUE};
use fss_messages::{MAX_LINKS, MissionState, TruthState, topic};
use fss_mission::{Mission, MissionConfig, MissionService};
use fss_multibody::State;
use fss_plant::Plant;
use fss_recorder::{Limits, Recorder};
use fss_records::log::LogWriter;
use fss_service::{Process as ServiceProcess, SiteArgs, read_programs};
use fss_thrusters::Thrusters;
use fss_thrusters::device::{Driver, GpioLines, LaboratoryLine, Valves};
use fss_wire::link::{Key, first_sequence};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use zerocopy::FromBytes;

/// A process's stack, and where it runs.
struct Seat {
    stack: Stack,
    site: ServiceProcess,
}

impl std::ops::Deref for Seat {
    type Target = ServiceProcess;

    fn deref(&self) -> &ServiceProcess {
        &self.site
    }
}

impl Seat {
    fn open(name: &str, args: &SiteArgs) -> Result<Self> {
        let stack = Stack::in_folder(&args.run)?;
        let site = ServiceProcess::of(name, args, stack.launch.clone())?;
        Ok(Self { stack, site })
    }

    fn link_key(&self) -> Result<Key> {
        let path =
            self.launch.devices.link_key.as_deref().ok_or_else(|| miette!("the launch file names no link_key"))?;
        read_key(path)
    }
}

/// Runs one service until it is told to stop.
pub fn service(name: &str, args: &SiteArgs) -> Result<()> {
    if PROGRAMS.contains(&name) {
        return become_program(&program_of(name)?, args);
    }
    if let Some(program) = read_programs(&args.run)?.iter().find(|program| program.description.service == name) {
        return become_program(&program.path, args);
    }
    let site = Seat::open(name, args)?;
    let rate_hz = *site.schedule(name)?.rate_hz.get_ref();
    let plant = &site.stack.plant;
    match name {
        "recorder" => return recorder(&site, args),
        "fusion" => return fusion(&site),
        "links" => return links(&site),
        "thrusters" => return thrusters(&site),
        "base" => {
            let model = plant.model().into_diagnostic()?;
            site.fly(Base::new(BaseConfig::from_plant(plant, model, rate_hz)), || ())?;
        }
        "arm" => {
            site.fly(ArmService::new(ArmConfig::new(plant).into_diagnostic()?), || ())?;
        }
        "calibration" => {
            site.fly(Calibration::new(plant.link_count(), MovementBand::of(plant)), || ())?;
        }
        "mission" => {
            let (mission, config) = (site.stack.mission.clone(), MissionConfig::for_plant(plant));
            let service = match &args.resume {
                Some(last) => MissionService::resumed(mission, config, last_state(last)?),
                None => MissionService::new(mission, config),
            };
            site.fly(service, || ())?;
        }
        _ => miette::bail!("there is no service '{name}'; `fss service --help` lists them"),
    }
    Ok(())
}

/// Goes on as another program.
fn become_program(path: &Path, args: &SiteArgs) -> Result<()> {
    let refused = Command::new(path).args(args.to_arguments()).exec();
    Err(refused).into_diagnostic().wrap_err_with(|| format!("cannot start {}", path.display()))
}

/// The sample that the launcher gave.
fn last_state(hexadecimal: &str) -> Result<MissionState> {
    let bytes = hex::decode(hexadecimal).into_diagnostic()?;
    let state = MissionState::read_from_bytes(&bytes);
    state.map_err(|_| miette!("--resume: not the bytes of a mission's state, which are {}", size_of::<MissionState>()))
}

fn recorder(site: &Seat, args: &SiteArgs) -> Result<()> {
    let description = Description::new(&site.stack, "real time", args.seed)?;
    let (folder, starts) = (args.run.clone(), args.starts);
    let open = move |part| {
        let mut log = LogWriter::create(&folder.join(log_name(starts, part)))?;
        description.write_to(&mut log)?;
        Ok(log)
    };
    let megabytes = 1_000_000_u64;
    let limits = Limits {
        rotate_bytes: site.launch.recording.rotate_mb.map(|mb| megabytes.saturating_mul(mb)),
        keep_free_bytes: megabytes.saturating_mul(site.launch.recording.keep_free_mb),
    };
    let recorder = Recorder::threaded(&site.bus, Box::new(open), limits).into_diagnostic()?;
    site.fly(recorder, || ())?.finish().into_diagnostic()
}

/// A recorder that was restarted begins a log of its own; the first one's is readable to its last chunk.
fn log_name(starts: u32, part: u32) -> String {
    match (starts, part) {
        (1, 1) => LOG_FILE.to_owned(),
        (_, 1) => format!("run-{starts}.mcap"),
        (1, _) => format!("run.part{part}.mcap"),
        _ => format!("run-{starts}.part{part}.mcap"),
    }
}

fn fusion(site: &Seat) -> Result<()> {
    let (devices, urgent) = (&site.launch.devices, site.is_real_time("fusion")?);
    let (frames, stop) = (site.queue(MOCAP_QUEUE)?, site.stop.clone());
    let mocap = receive_mocap(&devices.mocap, frames, stop, urgent)
        .into_diagnostic()
        .wrap_err_with(|| format!("motion capture: cannot receive {} ([devices] mocap)", devices.mocap))?;
    let path = &devices.gyro;
    let read = || read_gyro(path, site.queue(GYRO_QUEUE)?, site.stop.clone(), urgent).into_diagnostic();
    let gyro = wait_for_device(path, read)
        .wrap_err_with(|| format!("gyro: cannot open {} ([devices] gyro)", path.display()))?;
    site.fly(Fusion::new(FusionConfig::from_plant(&site.stack.plant)), || ())?;
    for thread in [mocap, gyro] {
        thread.join().map_err(|_| miette!("a device thread of fusion failed"))?;
    }
    Ok(())
}

fn links(site: &Seat) -> Result<()> {
    let devices = &site.launch.devices;
    let (telemetry, commands) = (site.queue(TELEMETRY_QUEUE)?, site.queue(COMMAND_QUEUE)?);
    let (local, links, urgent) = (devices.links_local, devices.links.clone(), site.is_real_time("links")?);
    let _device = fss_links::device::Device::start(local, links, telemetry, commands, urgent)
        .into_diagnostic()
        .wrap_err_with(|| format!("links: cannot speak from {} ([devices] links_local)", devices.links_local))?;
    let first = first_sequence(unix_time_ns()?);
    site.fly(LinksService::new(LinksConfig::new(&site.stack.plant), site.link_key()?, first), || ())?;
    Ok(())
}

fn thrusters(site: &Seat) -> Result<()> {
    let path = &site.launch.devices.valves;
    if let Some(offsets) = &site.launch.devices.valve_lines {
        let lines = GpioLines::open(path, offsets)
            .into_diagnostic()
            .wrap_err_with(|| format!("valves: cannot take the lines of {} ([devices] valves)", path.display()))?;
        return drive(site, lines);
    }
    let mut line = LaboratoryLine::new(path);
    wait_for_device(path, || line.set(0).into_diagnostic())
        .wrap_err_with(|| format!("valves: cannot open {} ([devices] valves)", path.display()))?;
    drive(site, line)
}

fn drive(site: &Seat, valves: impl Valves) -> Result<()> {
    // The valve line is this service's device: it is written in the loop, so that nothing stands between step and valve.
    // A write that fails shuts the valves on the other side; the next step connects anew.
    let mut driver = Driver::new(valves, &site.bus).into_diagnostic()?;
    site.fly(Thrusters::new(site.stack.plant.thrusters.len()), || driver.apply())?;
    driver.shut().into_diagnostic().wrap_err("valves: cannot shut them at the end; a closed line shuts them")
}

/// Runs the laboratory until it is told to stop.
pub fn lab(args: &SiteArgs) -> Result<()> {
    let seed = args.seed;
    let site = Seat::open("lab", args)?;
    let schedule = site.schedule("lab")?;
    let mut config = LabConfig::new(seed, site.link_key()?);
    config.start = start_of(&site.stack.mission, site.stack.laboratory(), seed);
    site.stack.faults.apply_to(&mut config);
    let devices = &site.launch.devices;
    let addresses = Addresses {
        mocap: devices.mocap.clone(),
        gyro: devices.gyro.clone(),
        valves: devices.valves.clone(),
        links: devices.links.clone(),
        shared_table: site.launch.shared_table.map(|table| [table.here, table.there]),
    };
    let mut laboratory = Process::open(site.stack.laboratory(), config, &addresses).into_diagnostic()?;
    let mut truth = Output::open(&site.bus, topic::TRUTH_STATE).into_diagnostic()?;
    let mut health = Output::open(&site.bus, topic::HEALTH).into_diagnostic()?;
    let mut monitor = Monitor::new("lab", &schedule, site.starts).into_diagnostic()?;
    let granted = realtime::enter(&schedule);
    monitor.set_privileges(granted.real_time, granted.memory_locked);
    let mut next_report_ns = 0;
    let tell_truth = |state: &TruthState| {
        truth.publish(*state);
        truth.flush(Time::from_ns(state.stamp_ns));
    };
    let report = |step: &Stepped| {
        let Stepped { boundary, woken, done, skipped } = *step;
        monitor.count_step(boundary, woken, done, 0);
        monitor.count_skipped(skipped);
        if done.ns() >= next_report_ns {
            next_report_ns = done.ns() + REPORT_PERIOD_NS;
            health.publish(monitor.report(done));
            health.flush(done);
        }
    };
    laboratory.run(&site.stop, tell_truth, report).into_diagnostic()
}

/// Where the laboratory starts for a mission with a seed.
pub fn start_of(mission: &Mission, plant: &Plant, seed: u64) -> Start {
    let initial = &mission.initial;
    let joints = |values: &[f64]| std::array::from_fn::<_, MAX_LINKS, _>(|i| values.get(i).copied().unwrap_or(0.0));
    let [vehicle, target] = mission.drawn(seed);
    let pose = sum(initial.base_pose, vehicle.pose);
    let q_rad = joints(&initial.q_rad);
    // A drawn spin is about the centre of mass of the whole: the base's origin goes around that.
    let lever = plant.model().map_or([0.0; 2], |model| {
        let state = State::from_slices(&[pose.as_slice(), &q_rad[..plant.link_count().min(MAX_LINKS)]].concat(), &[]);
        let centre = model.center_of_mass(&state.q);
        [pose[0] - centre.x, pose[1] - centre.y]
    });
    let [vx, vy, spin] = vehicle.velocity;
    Start {
        pose,
        velocity: sum(initial.base_rate, [vx - spin * lever[1], vy + spin * lever[0], spin]),
        q_rad,
        qd_rad_s: joints(&initial.qd_rad_s),
        target: mission
            .target
            .as_ref()
            .map(|known| [sum(known.body.pose, target.pose), sum(known.body.velocity, target.velocity)]),
    }
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// How long a device may be on its way: where the host is busy, the laboratory that makes it starts late. Less than what a
/// launcher waits for a sign of life, so that it hears the reason.
const DEVICE_PATIENCE: Duration = Duration::from_secs(4);
const _: () = assert!(DEVICE_PATIENCE.as_millis() < BIRTH_TIME.as_millis());

/// Opens a device that another process of the stack may be about to make.
fn wait_for_device<T>(path: &Path, mut open: impl FnMut() -> Result<T>) -> Result<T> {
    let asked = Instant::now();
    while asked.elapsed() < DEVICE_PATIENCE {
        if path.exists()
            && let Ok(device) = open()
        {
            return Ok(device);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    open()
}
