//! What a thruster makes of its commands: delay, first-order lag of the level, minimum on time of a valve.

use std::collections::VecDeque;

use crate::physics::ThrusterPhysics;

/// Commands on their way that there is room for from the start.
const CAPACITY: usize = 256;
/// Commands that may be on their way at once: 2 s of delay at two commands a millisecond.
const MOST_PENDING: usize = 4096;

/// One thruster's commands on their way and its level: 0 is shut, 1 is the whole thrust.
#[derive(Debug, Clone)]
pub(crate) struct Valve {
    /// Commands that have not yet moved the valve: when they do (s), and to which level.
    pending: VecDeque<(f64, f64)>,
    /// Last command given.
    commanded: f64,
    /// The level that it goes to.
    goal: f64,
    opened_at_s: f64,
    /// A closing that waits for the minimum on time (s).
    close_at_s: Option<f64>,
    level: f64,
    /// Means of the level, of its square and of its cube over the last step.
    pub(crate) mean: [f64; 3],
}

impl Valve {
    pub(crate) fn new() -> Self {
        Self {
            pending: VecDeque::with_capacity(CAPACITY),
            commanded: 0.0,
            goal: 0.0,
            opened_at_s: f64::NEG_INFINITY,
            close_at_s: None,
            level: 0.0,
            mean: [0.0; 3],
        }
    }

    /// Commands a level, held to 0 to 1; the thruster follows from `acts_at_s`. A repeated command changes nothing.
    pub(crate) fn command(&mut self, level: f64, acts_at_s: f64) {
        let level = level.clamp(0.0, 1.0);
        if level == self.commanded {
            return;
        }
        self.commanded = level;
        if self.pending.len() == MOST_PENDING {
            self.pending.pop_front();
        }
        let after = self.pending.back().map_or(acts_at_s, |last| last.0);
        self.pending.push_back((acts_at_s.max(after), level));
    }

    /// Level now, 0 to 1.
    pub(crate) fn level(&self) -> f64 {
        self.level
    }

    /// Moves the level from `from_s` to `to_s` and returns the means of its powers on the way, so that
    /// a step's impulse is exact wherever in the step the level moved.
    pub(crate) fn advance(&mut self, from_s: f64, to_s: f64, thruster: &ThrusterPhysics) -> [f64; 3] {
        if self.pending.is_empty() && self.close_at_s.is_none() && self.level == self.goal {
            return powers(self.level);
        }
        let mut now = from_s;
        let mut integral = [0.0; 3];
        while let Some(at) = self.next_event().filter(|at| *at < to_s) {
            let at = at.max(now);
            add(&mut integral, self.drift(at - now, thruster));
            now = at;
            self.take_event(now, thruster.min_on_s);
        }
        add(&mut integral, self.drift(to_s - now, thruster));
        integral.map(|power| power / (to_s - from_s))
    }

    fn next_event(&self) -> Option<f64> {
        let pending = self.pending.front().map(|p| p.0);
        match (pending, self.close_at_s) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    fn take_event(&mut self, now: f64, min_on_s: f64) {
        if let Some(&(at, level)) = self.pending.front()
            && at <= now
        {
            self.pending.pop_front();
            if level > 0.0 {
                self.close_at_s = None;
                if self.goal == 0.0 {
                    self.opened_at_s = now;
                }
                self.goal = level;
            } else if self.goal > 0.0 {
                self.close_at_s = Some(now.max(self.opened_at_s + min_on_s));
            }
        }
        if self.close_at_s.is_some_and(|at| at <= now) {
            self.close_at_s = None;
            self.goal = 0.0;
        }
    }

    /// First-order approach to the goal; returns the integrals of the level, of its square and of its cube (s), in closed
    /// form: they are those of `goal + gap exp(-t / time)`.
    fn drift(&mut self, duration_s: f64, thruster: &ThrusterPhysics) -> [f64; 3] {
        let goal = self.goal;
        let gap = self.level - goal;
        let time = if gap < 0.0 { thruster.rise_s } else { thruster.fall_s };
        if time <= 0.0 {
            self.level = goal;
            return powers(goal).map(|power| power * duration_s);
        }
        let left = (-duration_s / time).exp();
        self.level = goal + gap * left;
        if (self.level - goal).abs() < 1e-9 {
            self.level = goal;
        }
        // Integrals of the gap and of its powers.
        let first = gap * time * (1.0 - left);
        let second = first * gap * (1.0 + left) / 2.0;
        let third = first * gap * gap * (1.0 + left + left * left) / 3.0;
        [
            goal * duration_s + first,
            goal * goal * duration_s + 2.0 * goal * first + second,
            goal * goal * goal * duration_s + 3.0 * goal * (goal * first + second) + third,
        ]
    }
}

/// A level, its square and its cube.
pub(crate) fn powers(level: f64) -> [f64; 3] {
    [level, level * level, level * level * level]
}

fn add(sum: &mut [f64; 3], more: [f64; 3]) {
    for (sum, more) in sum.iter_mut().zip(more) {
        *sum += more;
    }
}
