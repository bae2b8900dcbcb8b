//! Which thrusters make a wanted wrench.
//!
//! A thruster only pushes, and only with its whole thrust: the open shares `0 <= u <= 1` minimise
//! `|S (W u - w)|^2 + gas * sum(u)` with the thrusters' wrenches as columns of `W`, so that opposite thrusters never open
//! against each other. Coordinate descent from the last solution solves this small problem without allocation.

use fss_messages::MAX_THRUSTERS;

/// Force x, force y in N and torque in N m, in body axes about the base frame's origin.
pub type Wrench = [f64; 3];

/// Length that makes torques comparable with forces, m: about a thruster's lever.
const LEVER_M: f64 = 0.1;
/// Price of gas, as a share of one thruster's squared thrust for one fully open thruster.
const GAS_PRICE: f64 = 1e-3;
/// How many times that price the first sweeps pay: it drives thrusters apart that began against each other.
const FIRST_PRICE: f64 = 50.0;
/// Sweeps over all thrusters, first at the high price, then at the true one.
const SWEEPS: [(usize, f64); 2] = [(20, FIRST_PRICE), (30, 1.0)];

/// The thrusters of a vehicle.
#[derive(Clone, Debug)]
pub struct Allocator {
    count: usize,
    /// Scaled wrench of each thruster.
    columns: [Wrench; MAX_THRUSTERS],
    /// Squared length of each column.
    squares: [f64; MAX_THRUSTERS],
    duty: [f64; MAX_THRUSTERS],
}

/// Share of a wanted wrench that may be missing before the thrusters count as being at their end.
const SATURATED: f64 = 0.05;
/// Sweeps end when none changed a share by more than this.
const SETTLED: f64 = 1e-6;

/// Open shares, and how much of the wanted wrench they do not make (0 to 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allocation {
    /// Share of open time of each thruster.
    pub duty: [f64; MAX_THRUSTERS],
    /// Length of the missing wrench over that of the wanted one.
    pub missing: f64,
}

impl Allocation {
    /// Whether the wanted wrench is more than the thrusters have.
    pub fn is_saturated(&self) -> bool {
        self.missing > SATURATED && self.duty.iter().any(|&share| share >= 1.0)
    }
}

impl Allocator {
    /// For thrusters with these wrenches; those beyond [`MAX_THRUSTERS`] are not used.
    pub fn new(wrenches: &[Wrench]) -> Self {
        let count = wrenches.len().min(MAX_THRUSTERS);
        let mut columns = [[0.0; 3]; MAX_THRUSTERS];
        for (column, wrench) in columns.iter_mut().zip(wrenches) {
            *column = scaled(*wrench);
        }
        let squares = columns.map(|c| dot(c, c));
        Self { count, columns, squares, duty: [0.0; MAX_THRUSTERS] }
    }

    /// Open shares for a wanted wrench.
    pub fn allocate(&mut self, wanted: Wrench) -> Allocation {
        let wanted = scaled(wanted);
        let price = GAS_PRICE * self.squares.iter().copied().fold(0.0, f64::max);
        // What the present shares do not make.
        let mut missing = wanted;
        for i in 0..self.count {
            add(&mut missing, self.columns[i], -self.duty[i]);
        }
        for (sweeps, factor) in SWEEPS {
            for _ in 0..sweeps {
                if self.sweep(&mut missing, factor * price) < SETTLED {
                    break;
                }
            }
        }
        let length = dot(wanted, wanted).sqrt();
        let missing = if length > 0.0 { dot(missing, missing).sqrt() / length } else { 0.0 };
        Allocation { duty: self.duty, missing }
    }

    /// Sets each share to its best with the others as they are; returns the largest change.
    fn sweep(&mut self, missing: &mut Wrench, price: f64) -> f64 {
        let mut largest = 0.0_f64;
        for i in 0..self.count {
            if self.squares[i] > 0.0 {
                let step = (dot(self.columns[i], *missing) - price) / self.squares[i];
                let share = (self.duty[i] + step).clamp(0.0, 1.0);
                add(missing, self.columns[i], self.duty[i] - share);
                largest = largest.max((share - self.duty[i]).abs());
                self.duty[i] = share;
            }
        }
        largest
    }
}

fn scaled([fx, fy, torque]: Wrench) -> Wrench {
    [fx, fy, torque / LEVER_M]
}

fn dot(a: Wrench, b: Wrench) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn add(a: &mut Wrench, b: Wrench, factor: f64) {
    for (x, y) in a.iter_mut().zip(b) {
        *x += factor * y;
    }
}
