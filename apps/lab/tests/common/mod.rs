//! A laboratory on a virtual clock, and a note of what it sent.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used)]

use fss_lab::{DeviceOutputs, LabConfig, Laboratory};
use fss_plant::Plant;
use fss_wire::dsp3000;
use fss_wire::link::{Command, Key, Mode, Telemetry};
use std::net::{Ipv4Addr, SocketAddr};

pub const MS: u64 = 1_000_000;
pub const S: u64 = 1000 * MS;
pub const SEED: u64 = 42;
pub const COMPUTER: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 51100);

pub fn key() -> Key {
    Key::new(b"the laboratory's own test key...").unwrap()
}

pub fn plant() -> Plant {
    Plant::default_laboratory().unwrap()
}

pub fn config() -> LabConfig {
    println!("seed {SEED}");
    LabConfig::new(SEED, key())
}

/// Everything that arrived, with its time.
#[derive(Debug, Default, PartialEq)]
pub struct Heard {
    pub mocap: Vec<(u64, Vec<u8>)>,
    pub gyro: Vec<(u64, Vec<u8>)>,
    pub links: Vec<(u64, usize, SocketAddr, Vec<u8>)>,
}

impl DeviceOutputs for Heard {
    fn mocap(&mut self, time_ns: u64, datagram: &[u8]) {
        self.mocap.push((time_ns, datagram.to_vec()));
    }
    fn gyro(&mut self, time_ns: u64, bytes: &[u8]) {
        self.gyro.push((time_ns, bytes.to_vec()));
    }
    fn link(&mut self, time_ns: u64, link: usize, to: SocketAddr, datagram: &[u8]) {
        self.links.push((time_ns, link, to, datagram.to_vec()));
    }
}

impl Heard {
    /// Telemetry of one link (from 0).
    pub fn telemetry(&self, link: usize) -> Vec<Telemetry> {
        let of_link = self.links.iter().filter(|(_, from, ..)| *from == link);
        of_link.map(|(.., datagram)| Telemetry::decode(datagram).unwrap()).collect()
    }

    pub fn gyro_readings(&self) -> Vec<(u64, dsp3000::Reading)> {
        let mut decoder = dsp3000::Decoder::new();
        assert!(decoder.push(b'\n').is_none(), "joins at the start of a line");
        let read = |(time, bytes): &(u64, Vec<u8>)| {
            bytes.iter().filter_map(|byte| decoder.push(*byte)).last().map(|reading| (*time, reading))
        };
        self.gyro.iter().filter_map(read).collect()
    }
}

/// A laboratory with the `links` service's part played 5 times a second.
pub struct Bench {
    pub laboratory: Laboratory,
    pub heard: Heard,
    pub sequence: u64,
}

impl Bench {
    pub fn new(plant: &Plant, config: LabConfig) -> Self {
        Self { laboratory: Laboratory::new(plant, config, 0).unwrap(), heard: Heard::default(), sequence: 0 }
    }

    pub fn wait(&mut self, duration_ns: u64) {
        self.laboratory.step_to(self.laboratory.now_ns() + duration_ns, &mut self.heard);
    }

    /// Sets all valve lines now.
    pub fn set_valves(&mut self, mask: u16) {
        self.laboratory.set_valves(mask, self.laboratory.now_ns());
    }

    /// Sends one signed command to a link (from 0).
    pub fn command(&mut self, link: usize, command: Command) -> Vec<u8> {
        self.sequence += 1;
        let datagram = Command { link: link as u8 + 1, sequence: self.sequence, ..command }.encode(&key());
        self.laboratory.command_link(link, COMPUTER, &datagram);
        datagram.to_vec()
    }

    /// Commands a link every 200 ms; `command` is a function of the time since now (s).
    pub fn drive(&mut self, link: usize, duration_ns: u64, command: impl Fn(f64) -> Command) {
        for period in 0..duration_ns / (200 * MS) {
            self.command(link, command(period as f64 * 0.2));
            self.wait(200 * MS);
        }
    }
}

pub fn position(position_rad: f64, velocity_rad_s: f64) -> Command {
    let (position_rad, velocity_rad_s) = (position_rad as f32, velocity_rad_s as f32);
    Command { mode: Mode::Position, position_rad, velocity_rad_s, max_torque_nm: 1.8, ..Command::default() }
}

pub fn velocity(velocity_rad_s: f32) -> Command {
    Command { mode: Mode::Velocity, velocity_rad_s, max_torque_nm: 1.8, ..Command::default() }
}
