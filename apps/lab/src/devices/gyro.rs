//! The fibre-optic gyro: mean rate since its last line, by its own clock.

use crate::config::{ActiveFaults, FaultKind};
use crate::random::Random;
use fss_plant::{Instruments, Simulation, Stream};
use fss_wire::dsp3000::{Line, Mode, Reading, Request};

/// Bits on the line for one byte, 8N1, and the line's speed.
const BITS_PER_BYTE: u64 = 10;
const BAUD: u64 = 38_400;

/// The gyro.
#[derive(Debug, Clone)]
pub(crate) struct Gyro {
    random: Random,
    mode: Mode,
    period_ns: f64,
    start_ns: u64,
    /// Lines due since the start, sent or not.
    lines: u64,
    /// Time (s) and base heading (rad) of the last line.
    last: (f64, f64),
    /// Integrated reading since it was zeroed (rad).
    angle_rad: f64,
}

impl Gyro {
    /// A gyro whose period is `clock_error` longer than its nominal one.
    pub(crate) fn new(random: Random, simulation: &Simulation, clock_error: f64, start_ns: u64) -> Self {
        let period_ns = 1e9 / simulation.physics().sensors.nominal.gyro_rate_hz * (1.0 + clock_error);
        let last = (simulation.t_s(), simulation.truth().base_pose[2]);
        Self { random, mode: Mode::Rate, period_ns, start_ns, lines: 0, last, angle_rad: 0.0 }
    }

    /// Does what a byte from the computer asks for.
    pub(crate) fn request(&mut self, byte: u8) {
        match Request::from_byte(byte) {
            Some(Request::Select(mode)) => self.mode = mode,
            Some(Request::Zero) => self.angle_rad = 0.0,
            None => {}
        }
    }

    /// The line that the gyro begins to send at `now_ns`, if one is due.
    pub(crate) fn sample(
        &mut self,
        now_ns: u64,
        simulation: &Simulation,
        instruments: &mut Instruments,
        faults: ActiveFaults<'_>,
    ) -> Option<Line> {
        let due_ns = self.start_ns + ((self.lines + 1) as f64 * self.period_ns) as u64;
        if now_ns < due_ns {
            return None;
        }
        self.lines += 1;
        let reading = self.read(simulation, instruments, faults.has(&FaultKind::GyroInvalid));
        (!faults.has(&FaultKind::GyroSilent)).then(|| Line::encode(reading))
    }

    fn read(&mut self, simulation: &Simulation, instruments: &mut Instruments, faulty: bool) -> Reading {
        let sensors = &simulation.physics().sensors;
        let at_s = simulation.t_s() - sensors.age_s(Stream::Gyro).max(0.0);
        let truth = simulation.truth_at(at_s);
        let [.., heading_rad] = truth.base_pose;
        let [.., rate_now_rad_s] = truth.base_velocity;
        let (last_s, last_heading_rad) = self.last;
        self.last = (at_s, heading_rad);
        // The physics steps by milliseconds, and so do the edges of the mean.
        let interval_s = (at_s - last_s).max(1e-3);
        let mean_rad_s = (heading_rad - last_heading_rad) / interval_s;
        // The instrument reads the rate of this moment; the unit sends the mean since its last line.
        let reading_rad_s = instruments.gyro(simulation);
        let mut rate_rad_s = reading_rad_s + sensors.gyro_scale * (mean_rad_s - rate_now_rad_s);
        if faulty {
            rate_rad_s += 10.0 * (self.random.uniform() - 0.5);
        }
        let increment_rad = rate_rad_s * interval_s;
        self.angle_rad += increment_rad;
        let value_rad = match self.mode {
            Mode::Rate => rate_rad_s,
            Mode::IncrementalAngle => increment_rad,
            Mode::IntegratedAngle => self.angle_rad,
        };
        Reading { value_rad, valid: !faulty }
    }
}

/// How long a line is on the serial line (ns).
pub(crate) fn transfer_ns(line: &Line) -> u64 {
    line.as_bytes().len() as u64 * BITS_PER_BYTE * 1_000_000_000 / BAUD
}
