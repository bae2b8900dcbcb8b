//! One process of a stack: a service with its devices, or the laboratory.

use crate::description::Description;
use crate::files::program_of;
use crate::link_key::read_secret;
use crate::seat::Seat;
use crate::services::Services;
use crate::stack::LOG_FILE;
use fss_bus::health::{Monitor, REPORT_PERIOD_NS};
use fss_bus::launch::PROGRAMS;
use fss_bus::{Output, OutputPort, Time, realtime};
use fss_lab::process::{Addresses, Process, Stepped};
use fss_lab::{LabConfig, Start};
use fss_messages::{MAX_LINKS, TruthState, topic};
use fss_mission::Mission;
use fss_multibody::State;
use fss_plant::Plant;
use fss_recorder::{Limits, Recorder};
use fss_records::log::LogWriter;
use fss_service::{SiteArgs, read_programs};
use fss_wire::link::Key;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

/// Runs one service until it is told to stop.
pub fn service(name: &str, args: &SiteArgs) -> Result<()> {
    if PROGRAMS.contains(&name) {
        return become_program(&program_of(name)?, args);
    }
    let programs = read_programs(&args.run)?;
    let program = programs.iter().find(|program| program.description.service == name);
    if let Some(path) = program.and_then(|program| program.path.as_ref()) {
        return become_program(path, args);
    }
    if name == "recorder" {
        return recorder(&Seat::open(name, args)?, args);
    }
    let linked = Services::linked().get(name);
    let service = linked.ok_or_else(|| miette!("there is no service '{name}'; `fss service --help` lists them"))?;
    service.run(&Seat::open(name, args)?)
}

/// Goes on as another program.
fn become_program(path: &Path, args: &SiteArgs) -> Result<()> {
    let refused = Command::new(path).args(args.to_arguments()).exec();
    Err(refused).into_diagnostic().wrap_err_with(|| format!("cannot start {}", path.display()))
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

/// Runs the laboratory until it is told to stop.
pub fn lab(args: &SiteArgs) -> Result<()> {
    let seed = args.seed;
    let site = Seat::open("lab", args)?;
    let schedule = site.schedule("lab")?;
    let key = Key::new(&read_secret(site.link_key()?)?).into_diagnostic()?;
    let mut config = LabConfig::new(seed, key);
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
