//! A valve: delay, rise and fall of thrust, minimum on time.

use std::collections::VecDeque;

use crate::physics::ThrusterPhysics;

/// Commands that may be on their way to a valve at once.
const CAPACITY: usize = 256;

/// One valve's commands on their way and its opening.
#[derive(Debug, Clone)]
pub(crate) struct Valve {
    /// Commands that have not yet moved the valve: when they do (s), and to open or to close.
    pending: VecDeque<(f64, bool)>,
    /// Last command given.
    commanded: bool,
    is_open: bool,
    opened_at_s: f64,
    /// A closing that waits for the minimum on time (s).
    close_at_s: Option<f64>,
    /// Share of the thrust, 0 to 1.
    opening: f64,
    /// Mean opening over the last step.
    pub(crate) mean: f64,
}

impl Valve {
    pub(crate) fn new() -> Self {
        Self {
            pending: VecDeque::with_capacity(CAPACITY),
            commanded: false,
            is_open: false,
            opened_at_s: f64::NEG_INFINITY,
            close_at_s: None,
            opening: 0.0,
            mean: 0.0,
        }
    }

    /// Commands the valve; it moves at `acts_at_s`. A repeated command changes nothing.
    pub(crate) fn command(&mut self, open: bool, acts_at_s: f64) {
        if open == self.commanded {
            return;
        }
        self.commanded = open;
        if self.pending.len() == CAPACITY {
            self.pending.pop_front();
        }
        let after = self.pending.back().map_or(acts_at_s, |last| last.0);
        self.pending.push_back((acts_at_s.max(after), open));
    }

    /// Opening now, 0 to 1.
    pub(crate) fn opening(&self) -> f64 {
        self.opening
    }

    /// Moves the valve from `from_s` to `to_s` and returns its mean opening on the way, so that
    /// a step's impulse is exact wherever in the step the valve moved.
    pub(crate) fn advance(&mut self, from_s: f64, to_s: f64, valve: &ThrusterPhysics) -> f64 {
        if self.pending.is_empty() && self.close_at_s.is_none() && self.is_settled() {
            return self.opening;
        }
        let mut now = from_s;
        let mut integral = 0.0;
        while let Some(at) = self.next_event().filter(|at| *at < to_s) {
            let at = at.max(now);
            integral += self.drift(at - now, valve);
            now = at;
            self.take_event(now, valve.min_on_s);
        }
        integral += self.drift(to_s - now, valve);
        integral / (to_s - from_s)
    }

    fn is_settled(&self) -> bool {
        self.opening == f64::from(u8::from(self.is_open))
    }

    fn next_event(&self) -> Option<f64> {
        let pending = self.pending.front().map(|p| p.0);
        match (pending, self.close_at_s) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    fn take_event(&mut self, now: f64, min_on_s: f64) {
        if let Some(&(at, open)) = self.pending.front()
            && at <= now
        {
            self.pending.pop_front();
            if open {
                self.close_at_s = None;
                if !self.is_open {
                    self.is_open = true;
                    self.opened_at_s = now;
                }
            } else if self.is_open {
                self.close_at_s = Some(now.max(self.opened_at_s + min_on_s));
            }
        }
        if self.close_at_s.is_some_and(|at| at <= now) {
            self.close_at_s = None;
            self.is_open = false;
        }
    }

    /// First-order approach to open or closed; returns the integral of the opening (s).
    fn drift(&mut self, duration_s: f64, valve: &ThrusterPhysics) -> f64 {
        let (goal, time) = if self.is_open { (1.0, valve.rise_s) } else { (0.0, valve.fall_s) };
        let gap = self.opening - goal;
        if time <= 0.0 {
            self.opening = goal;
            return goal * duration_s;
        }
        let left = (-duration_s / time).exp();
        self.opening = goal + gap * left;
        if (self.opening - goal).abs() < 1e-9 {
            self.opening = goal;
        }
        goal * duration_s + gap * time * (1.0 - left)
    }
}
