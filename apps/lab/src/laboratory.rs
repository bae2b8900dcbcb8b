//! The core: physics, devices and the ways between them and the computer, as a function of time.

use crate::channel::Channel;
use crate::config::{ActiveFaults, FaultKind};
use crate::devices::camera::Camera;
use crate::devices::gyro::{self, Gyro};
use crate::devices::link::Link;
use crate::gripper::Gripper;
use crate::random::{Random, Stream};
use crate::shared_table::SharedTable;
use crate::{LabConfig, LabError, truth};
use fss_messages::TruthState;
use fss_plant::{Instruments, Plant, Simulation};
use fss_wire::shared_table;
use std::net::SocketAddr;

/// The laboratory steps by this much (ns).
pub const STEP_NS: u64 = 1_000_000;

/// Takes what the devices send, in the order in which it arrives at the computer.
pub trait DeviceOutputs {
    /// A frame of motion capture arrives, as bytes of the tracker's protocol.
    fn mocap(&mut self, time_ns: u64, datagram: &[u8]);
    /// A piece of the gyro's serial line arrives.
    fn gyro(&mut self, time_ns: u64, bytes: &[u8]);
    /// A telemetry datagram of a link (from 0) arrives at the address from which the link was last commanded.
    fn link(&mut self, time_ns: u64, link: usize, to: SocketAddr, datagram: &[u8]);
}

/// What went through a laboratory so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Traffic {
    /// Frames of motion capture that arrived.
    pub mocap: u64,
    /// Gyro lines that arrived.
    pub gyro: u64,
    /// Telemetry datagrams that arrived.
    pub telemetry: u64,
    /// Commands that links accepted.
    pub commands: u64,
    /// Datagrams that links refused: damaged, unsigned, replayed, not theirs.
    pub refused: u64,
}

/// A simulated laboratory. The same plant, configuration and inputs at the same times give the same bytes.
#[derive(Debug, Clone)]
pub struct Laboratory {
    simulation: Simulation,
    instruments: Instruments,
    config: LabConfig,
    start_ns: u64,
    now_ns: u64,
    valves: u16,
    /// Valves that are open: as the lines say, but for faults.
    open: u16,
    camera: Camera,
    camera_latency_ns: u64,
    link_latency_ns: u64,
    gyro: Gyro,
    links: Vec<Link>,
    camera_channel: Channel<()>,
    gyro_channel: Channel<()>,
    up: Vec<Channel<SocketAddr>>,
    down: Vec<Channel<SocketAddr>>,
    gripper: Option<Gripper>,
    shared_table: SharedTable,
    target_mass_kg: Option<f64>,
    traffic: Traffic,
}

impl Laboratory {
    /// The laboratory at rest at `start_ns` (monotonic clock, or 0 on a virtual one): valves shut, drivers off.
    pub fn new(plant: &Plant, config: LabConfig, start_ns: u64) -> Result<Self, LabError> {
        config.check(plant)?;
        let random = |stream, index| Random::new(config.seed, stream, index);
        let mut simulation = Simulation::new(plant, config.seed)?;
        let start = &config.start;
        simulation.set_state(start.pose, start.velocity, &start.q_rad, &start.qd_rad_s);
        if let Some([pose, velocity]) = start.target {
            simulation.set_target(pose, velocity);
        }
        let sensors = &plant.sensors;
        let links = 0..plant.link_count();
        let link = |i| Link::new(i, config.key.clone(), random(Stream::Link, i), sensors.link_rate_hz, start_ns);
        Ok(Self {
            camera: Camera::new(config.tracker.clone(), sensors.mocap_rate_hz, plant.target.is_some(), start_ns),
            gyro: Gyro::new(random(Stream::Gyro, 0), &simulation, config.gyro_clock_error, start_ns),
            links: links.clone().map(link).collect(),
            camera_channel: Channel::new(config.mocap, random(Stream::CameraChannel, 0)),
            gyro_channel: Channel::new(config.gyro, random(Stream::GyroChannel, 0)),
            up: links.clone().map(|i| Channel::new(config.link_up, random(Stream::LinkUp, i))).collect(),
            down: links.map(|i| Channel::new(config.link_down, random(Stream::LinkDown, i))).collect(),
            simulation,
            instruments: Instruments::new(plant.link_count(), config.seed),
            camera_latency_ns: (sensors.mocap_latency_s * 1e9) as u64,
            link_latency_ns: (sensors.link_latency_s * 1e9) as u64,
            config,
            start_ns,
            now_ns: start_ns,
            valves: 0,
            open: 0,
            gripper: plant.target.as_ref().map(Gripper::new),
            shared_table: SharedTable::default(),
            target_mass_kg: plant.target.as_ref().map(|target| target.mass_kg),
            traffic: Traffic::default(),
        })
    }

    /// Time that the laboratory has reached (ns), at most [`STEP_NS`] before the last `step_to`.
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Number of links.
    pub fn link_count(&self) -> usize {
        self.links.len()
    }

    /// What went through so far.
    pub fn traffic(&self) -> Traffic {
        self.traffic
    }

    /// The physics.
    pub fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    /// Sets all valve lines at `at_ns`, now or later; bit 0 is thruster 1.
    pub fn set_valves(&mut self, mask: u16, at_ns: u64) {
        self.valves = mask;
        self.move_valves(at_ns);
    }

    /// Opens and shuts what the lines and the faults say.
    fn move_valves(&mut self, at_ns: u64) {
        let at_s = at_ns.saturating_sub(self.start_ns) as f64 / 1e9;
        let open = ActiveFaults::at(&self.config.faults, self.elapsed_s()).valves(self.valves);
        if open == self.open {
            return;
        }
        self.open = open;
        for line in 0..self.simulation.physics().thrusters.len() {
            self.simulation.set_valve(line, open >> line & 1 == 1, at_s);
        }
    }

    /// Sends a datagram to a link (from 0) over its network; `from` is where its telemetry goes if it is accepted.
    pub fn command_link(&mut self, link: usize, from: SocketAddr, datagram: &[u8]) {
        if let Some(channel) = self.up.get_mut(link) {
            channel.send(self.now_ns, 0, from, datagram);
        }
    }

    /// Takes the word of the laboratory of another vehicle on the same table: that vehicle is this one's target.
    pub fn hear(&mut self, other: &shared_table::State) {
        self.shared_table.hear(other, self.target_mass_kg);
    }

    /// What the laboratory of another vehicle on the same table must know of this one.
    pub fn tell(&self) -> shared_table::State {
        let truth = self.simulation.truth();
        shared_table::State {
            session: self.start_ns,
            time_ns: self.now_ns,
            pose: truth.base_pose,
            velocity: truth.base_velocity,
            mass_kg: self.simulation.model().total_mass_kg(),
            pushed_n_s: self.simulation.pushed_n_s(),
            taken_n_s: self.shared_table.taken_n_s(),
            held: self.simulation.is_grasping().then_some([truth.target_pose, truth.target_velocity]),
        }
    }

    /// Sends a byte to the gyro.
    pub fn request_gyro(&mut self, byte: u8) {
        self.gyro.request(byte);
    }

    /// Lets time pass until `time_ns` and hands over what the devices send meanwhile.
    pub fn step_to(&mut self, time_ns: u64, outputs: &mut dyn DeviceOutputs) {
        while self.now_ns + STEP_NS <= time_ns {
            self.move_valves(self.now_ns);
            self.drive_links();
            self.shared_table.apply(self.now_ns, &mut self.simulation);
            self.simulation.step(STEP_NS as f64 * 1e-9);
            self.now_ns += STEP_NS;
            self.move_gripper();
            self.sample_devices();
            self.deliver(outputs);
        }
    }

    /// The truth at the time that the laboratory has reached.
    pub fn truth(&self) -> TruthState {
        let mut truth = truth::state(&self.simulation, self.now_ns, self.valves);
        if let Some(gripper) = &self.gripper {
            gripper.tell(&mut truth);
        }
        truth
    }

    /// The gripper at the arm's end does what its link was told.
    fn move_gripper(&mut self) {
        if let (Some(gripper), Some(link), false) =
            (&mut self.gripper, self.links.last(), self.shared_table.is_held(self.now_ns))
        {
            gripper.step(self.now_ns, link.closes_gripper(), &mut self.simulation);
        }
    }

    /// Time since the start of the run (s), rounded once, so that a fault at 1.1 s begins there.
    fn elapsed_s(&self) -> f64 {
        (self.now_ns - self.start_ns) as f64 / 1e9
    }

    fn drive_links(&mut self) {
        let faults = ActiveFaults::at(&self.config.faults, self.elapsed_s());
        for (i, link) in self.links.iter_mut().enumerate() {
            let is_dead = faults.has(&FaultKind::LinkDead { link: i + 1 });
            while let Some((at_ns, from, datagram)) = self.up[i].arrived(self.now_ns) {
                if is_dead {
                    continue;
                }
                match link.receive(at_ns, from, &datagram) {
                    Ok(()) => self.traffic.commands += 1,
                    Err(_) => self.traffic.refused += 1,
                }
            }
            let drive = link.drive(self.now_ns, &self.simulation, faults);
            self.simulation.set_joint(i, drive.command);
            self.simulation.set_torque_limit(i, drive.max_torque_nm);
        }
    }

    fn sample_devices(&mut self) {
        let now_ns = self.now_ns;
        let faults = ActiveFaults::at(&self.config.faults, self.elapsed_s());
        if let Some(datagram) = self.camera.sample(now_ns, &self.simulation, &mut self.instruments, faults) {
            self.camera_channel.send(now_ns, self.camera_latency_ns, (), datagram);
        }
        if let Some(line) = self.gyro.sample(now_ns, &self.simulation, &mut self.instruments, faults) {
            self.gyro_channel.send(now_ns, gyro::transfer_ns(&line), (), line.as_bytes());
        }
        for ((link, down), number) in self.links.iter_mut().zip(&mut self.down).zip(1..) {
            let own_start_ns = self.start_ns.saturating_add_signed((faults.clock_step_s(number) * 1e9) as i64);
            if let Some((to, datagram)) =
                link.sample(now_ns, own_start_ns, &self.simulation, &mut self.instruments, faults)
            {
                down.send(now_ns, self.link_latency_ns, to, &datagram);
            }
        }
    }

    fn deliver(&mut self, outputs: &mut dyn DeviceOutputs) {
        while let Some((at_ns, (), datagram)) = self.camera_channel.arrived(self.now_ns) {
            self.traffic.mocap += 1;
            outputs.mocap(at_ns, &datagram);
        }
        while let Some((at_ns, (), bytes)) = self.gyro_channel.arrived(self.now_ns) {
            self.traffic.gyro += 1;
            outputs.gyro(at_ns, &bytes);
        }
        for (i, down) in self.down.iter_mut().enumerate() {
            while let Some((at_ns, to, datagram)) = down.arrived(self.now_ns) {
                self.traffic.telemetry += 1;
                outputs.link(at_ns, i, to, &datagram);
            }
        }
    }
}
