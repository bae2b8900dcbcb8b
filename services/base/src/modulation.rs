//! On/off valves for wanted open shares: a sigma-delta modulator with a minimum on-time.
//!
//! Each thruster owes its share of every step; when it owes a shortest pulse it opens, for as long as it owes.

use fss_messages::MAX_THRUSTERS;

/// The modulator.
#[derive(Clone, Debug)]
pub struct Modulator {
    count: usize,
    /// Shortest pulse, steps.
    min_steps: u32,
    owed_steps: [f64; MAX_THRUSTERS],
    open_steps: [u32; MAX_THRUSTERS],
}

impl Modulator {
    /// For `count` thrusters whose shortest pulse is `min_steps` steps, at least one.
    pub fn new(count: usize, min_steps: u32) -> Self {
        Self {
            count: count.min(MAX_THRUSTERS),
            min_steps: min_steps.max(1),
            owed_steps: [0.0; MAX_THRUSTERS],
            open_steps: [0; MAX_THRUSTERS],
        }
    }

    /// Valves for the next step, 1 for open.
    pub fn step(&mut self, duty: &[f64; MAX_THRUSTERS]) -> [u8; MAX_THRUSTERS] {
        let shortest = f64::from(self.min_steps);
        let mut valves = [0; MAX_THRUSTERS];
        for i in 0..self.count {
            // A thruster that is no longer wanted forgets what it owes, down to a pulse that it has begun.
            let owed = if duty[i] > 0.0 { self.owed_steps[i] + duty[i] } else { self.owed_steps[i].min(0.0) };
            self.owed_steps[i] = owed.clamp(-shortest, 2.0 * shortest);
            let unfinished = self.open_steps[i] > 0 && self.open_steps[i] < self.min_steps;
            let wanted =
                if self.open_steps[i] > 0 { self.owed_steps[i] >= 0.5 } else { self.owed_steps[i] >= shortest };
            if unfinished || wanted {
                valves[i] = 1;
                self.owed_steps[i] -= 1.0;
                self.open_steps[i] += 1;
            } else {
                self.open_steps[i] = 0;
            }
        }
        valves
    }

    /// Forgets everything: all valves are shut.
    pub fn reset(&mut self) {
        self.owed_steps = [0.0; MAX_THRUSTERS];
        self.open_steps = [0; MAX_THRUSTERS];
    }
}
