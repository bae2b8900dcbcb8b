//! The integration of the motion through sticking and sliding.
//!
//! Between changes of sticking or sliding the motion is smooth and goes by classical Runge-Kutta steps of fourth
//! order. A joint that comes to rest inside a step ends the step there; a resting joint is a constraint, so that it
//! stays exactly at rest, until the torque that would be needed to hold it exceeds the breakaway torque.
//!
//! Runge-Kutta steps keep momentum only to their order, so the base's velocity takes up the rest: after each step the
//! momentum is what it was and the impulse of the forces from outside, to rounding.

use fss_multibody::{Coordinates, JointVector, State};
use nalgebra::Vector3;

use crate::check::MAX_LINKS;
use crate::dynamics::{Dynamics, Load, Motion, Rates, Sliding};

/// A set of joints, one bit each.
type Mask = u32;

/// Changes between sticking and sliding that one step may have.
const MAX_EVENTS: usize = 16;
/// Steps of the search for the moment of rest.
const MAX_REFINEMENTS: usize = 12;
/// A joint slower than this has come to rest (rad/s).
const REST_RAD_S: f64 = 1e-11;

impl Dynamics {
    /// Advances `motion` by `dt_s` from `t_s`.
    pub(crate) fn advance(&self, motion: &mut Motion, t_s: f64, dt_s: f64, load: &Load) {
        let (mut now, mut left) = (t_s, dt_s);
        let mut keep_resting = 0;
        let mut momentum = self.momentum(motion);
        for _ in 0..MAX_EVENTS {
            let (sliding, first) = self.sliding(motion, now, load, keep_resting);
            let (end, impulse) = self.runge_kutta(motion, &first, now, left, load, &sliding);
            let Some((joint, share)) = self.first_rest(motion, &end, &sliding) else {
                *motion = end;
                momentum += impulse;
                left = 0.0;
                break;
            };
            if share <= 0.0 {
                // Set free without a way to go: it rests after all.
                keep_resting |= 1 << joint;
                continue;
            }
            let duration = self.rest_time(joint, motion, &first, now, left, load, &sliding);
            let (at_rest, impulse) = self.runge_kutta(motion, &first, now, duration, load, &sliding);
            *motion = at_rest;
            momentum += impulse;
            self.stop(joint, motion, &sliding);
            now += duration;
            left -= duration;
            if left <= 1e-12 {
                break;
            }
        }
        if left > 1e-12 {
            // More changes than a step can have: the rest of it with everything at rest that rests.
            let (sliding, first) = self.sliding(motion, now, load, Mask::MAX);
            let (end, impulse) = self.runge_kutta(motion, &first, now, left, load, &sliding);
            *motion = end;
            momentum += impulse;
        }
        self.restore(motion, &momentum);
    }

    /// Linear momentum and angular momentum about the table's origin; of a clamped vehicle nobody asks.
    fn momentum(&self, motion: &Motion) -> Vector3<f64> {
        if self.physics.base.clamped {
            return Vector3::zeros();
        }
        about_origin(&motion.state.q, &self.model.momentum(&motion.state).about_base())
    }

    /// Changes the base's velocity so that the momentum is `wanted`.
    fn restore(&self, motion: &mut Motion, wanted: &Vector3<f64>) {
        if self.physics.base.clamped {
            return;
        }
        let (x, y) = (motion.state.q[0], motion.state.q[1]);
        let missing = wanted - self.momentum(motion);
        let about_base = Vector3::new(missing.x, missing.y, missing.z - x * missing.y + y * missing.x);
        let change = self.model.base_twist(&motion.state.q, &JointVector::zeros(), &about_base);
        for i in 0..3 {
            motion.state.v[i] += change[i];
        }
    }

    /// Force and torque from outside, about the table's origin: `outside` and gravity; on a clamped vehicle nobody asks.
    fn external(&self, motion: &Motion, outside: &Coordinates) -> Vector3<f64> {
        if self.physics.base.clamped {
            return Vector3::zeros();
        }
        let q = &motion.state.q;
        let mut sum = about_origin(q, &Vector3::new(outside[0], outside[1], outside[2]));
        let [gx, gy] = self.model.gravity_m_s2();
        if gx != 0.0 || gy != 0.0 {
            let centre = self.model.center_of_mass(q);
            let weight = self.model.total_mass_kg();
            sum += weight * Vector3::new(gx, gy, centre.x * gy - centre.y * gx);
        }
        sum
    }

    /// Rate at which drive `i` rubs: of its rotor where it is elastic, else of the joint.
    fn rubbing_rate(&self, i: usize, motion: &Motion) -> f64 {
        if self.physics.joints[i].is_elastic() { motion.rotor_rad_s[i] } else { motion.state.v[3 + i] }
    }

    /// Which drives slide and where to, and which rest, and the accelerations then; drives in `keep_resting` do not break
    /// away.
    pub(crate) fn sliding(&self, motion: &Motion, t_s: f64, load: &Load, keep_resting: Mask) -> (Sliding, Rates) {
        let mut sliding = [0.0; MAX_LINKS];
        let mut resting: Mask = 0;
        for i in 0..self.joints {
            let rate = self.rubbing_rate(i, motion);
            if rate != 0.0 {
                sliding[i] = rate.signum();
            } else if self.physics.joints[i].friction.is_dry() && keep_resting & (1 << i) == 0 {
                resting |= 1 << i;
            }
        }
        loop {
            let rates = self.rates(motion, t_s, load, &sliding);
            let Some((joint, direction)) = self.breakaway(motion, load, &rates, resting) else {
                return (sliding, rates);
            };
            sliding[joint] = direction;
            resting &= !(1 << joint);
        }
    }

    /// The resting drive that is furthest beyond its breakaway torque, and where it goes.
    fn breakaway(&self, motion: &Motion, load: &Load, rates: &Rates, resting: Mask) -> Option<(usize, f64)> {
        if resting == 0 {
            return None;
        }
        let needed = self.needed_torques(motion, rates);
        let mut worst = None;
        let mut worst_excess = 0.0;
        for i in (0..self.joints).filter(|i| resting & (1 << i) != 0) {
            let joint = &self.physics.joints[i];
            let motor = load.motor_n_m[i];
            let held = if joint.is_elastic() {
                motor - self.wind_up_torque(i, motion)
            } else {
                motor * joint.gear_ratio(motion.state.q[3 + i]) - needed[3 + i]
            };
            let excess = held.abs() - joint.friction.breakaway_n_m() * (1.0 + 1e-9) - 1e-12;
            if excess > worst_excess {
                worst_excess = excess;
                worst = Some((i, held.signum()));
            }
        }
        worst
    }

    /// The first drive whose sliding ends between `start` and `end`, and the share of the step until then; 0 for one
    /// that never set out.
    fn first_rest(&self, start: &Motion, end: &Motion, sliding: &Sliding) -> Option<(usize, f64)> {
        let mut first = None;
        let mut earliest = f64::INFINITY;
        for i in 0..self.joints {
            if !self.physics.joints[i].friction.is_dry() || sliding[i] == 0.0 {
                continue;
            }
            let before = self.rubbing_rate(i, start) * sliding[i];
            let after = self.rubbing_rate(i, end) * sliding[i];
            if after < 0.0 || (after == 0.0 && before > 0.0) {
                let share = before / (before - after);
                if share < earliest {
                    earliest = share;
                    first = Some((i, share));
                }
            }
        }
        first
    }

    /// When within `left_s` drive `i` comes to rest (s), by regula falsi (Illinois).
    #[allow(clippy::too_many_arguments)] // one step's circumstances, which change from call to call
    fn rest_time(
        &self,
        i: usize,
        start: &Motion,
        first: &Rates,
        t_s: f64,
        left_s: f64,
        load: &Load,
        sliding: &Sliding,
    ) -> f64 {
        let rate_after = |duration: f64| {
            let (end, _) = self.runge_kutta(start, first, t_s, duration, load, sliding);
            self.rubbing_rate(i, &end) * sliding[i]
        };
        let (mut low, mut low_rate) = (0.0, self.rubbing_rate(i, start) * sliding[i]);
        let (mut high, mut high_rate) = (left_s, rate_after(left_s));
        let mut side = 0;
        let mut middle = left_s;
        for _ in 0..MAX_REFINEMENTS {
            middle = low + (high - low) * low_rate / (low_rate - high_rate);
            let rate = rate_after(middle);
            if rate.abs() < REST_RAD_S {
                break;
            }
            if rate > 0.0 {
                (low, low_rate) = (middle, rate);
                high_rate *= if side == 1 { 0.5 } else { 1.0 };
                side = 1;
            } else {
                (high, high_rate) = (middle, rate);
                low_rate *= if side == -1 { 0.5 } else { 1.0 };
                side = -1;
            }
        }
        middle
    }

    /// Takes the last trace of rate out of drive `i` by a torque impulse inside the joint, which leaves the momentum
    /// of the whole as it is.
    fn stop(&self, i: usize, motion: &mut Motion, sliding: &Sliding) {
        if self.physics.joints[i].is_elastic() {
            motion.rotor_rad_s[i] = 0.0;
            return;
        }
        // Velocity changes under impulses solve the same equations as accelerations under forces, at rest and without
        // gravity; the difference of two solutions is free of it.
        let model = &self.model;
        let at_rest = State::at_rest(motion.state.q);
        let mut changes = self.resting(sliding).unwrap_or_default();
        changes[i] = Some(0.0);
        let without = model.hybrid_accelerations(&at_rest, &Coordinates::zeros(), &changes);
        changes[i] = Some(-motion.state.v[3 + i]);
        let change = model.hybrid_accelerations(&at_rest, &Coordinates::zeros(), &changes) - without;
        motion.state.v += change;
        motion.state.v[3 + i] = 0.0;
    }

    /// One step from accelerations `k1`, and the impulse from outside in it about the table's origin.
    fn runge_kutta(
        &self,
        start: &Motion,
        k1: &Rates,
        t_s: f64,
        dt_s: f64,
        load: &Load,
        sliding: &Sliding,
    ) -> (Motion, Vector3<f64>) {
        let half = 0.5 * dt_s;
        let m2 = start.moved(start, k1, half);
        let k2 = self.rates(&m2, t_s + half, load, sliding);
        let m3 = start.moved(&m2, &k2, half);
        let k3 = self.rates(&m3, t_s + half, load, sliding);
        let m4 = start.moved(&m3, &k3, dt_s);
        let k4 = self.rates(&m4, t_s + dt_s, load, sliding);
        let sixth = dt_s / 6.0;
        let mut end = *start;
        let rate = start.state.v + 2.0 * (m2.state.v + m3.state.v) + m4.state.v;
        end.state.q += sixth * rate;
        end.state.v += sixth * (k1.joints + 2.0 * (k2.joints + k3.joints) + k4.joints);
        if self.is_elastic {
            for i in 0..self.joints {
                let rate = |m: &Motion| m.rotor_rad_s[i];
                end.rotor_rad[i] += sixth * (rate(start) + 2.0 * (rate(&m2) + rate(&m3)) + rate(&m4));
                end.rotor_rad_s[i] += sixth * (k1.rotors[i] + 2.0 * (k2.rotors[i] + k3.rotors[i]) + k4.rotors[i]);
            }
        }
        let w = |m: &Motion, k: &Rates| self.external(m, &k.outside);
        let impulse = sixth * (w(start, k1) + 2.0 * (w(&m2, &k2) + w(&m3, &k3)) + w(&m4, &k4));
        (end, impulse)
    }
}

/// A force or momentum about the base's origin, about the table's instead.
fn about_origin(q: &Coordinates, base: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(base.x, base.y, base.z + q[0] * base.y - q[1] * base.x)
}

impl Motion {
    /// This motion carried on for `dt_s` with the rates of `along` and the accelerations `k`.
    #[inline]
    fn moved(&self, along: &Self, k: &Rates, dt_s: f64) -> Self {
        let mut out = *self;
        out.state.q += dt_s * along.state.v;
        out.state.v += dt_s * k.joints;
        for i in 0..MAX_LINKS {
            out.rotor_rad[i] += dt_s * along.rotor_rad_s[i];
            out.rotor_rad_s[i] += dt_s * k.rotors[i];
        }
        out
    }
}
