//! Stopping a vehicle that turns and drifts, with the least gas.
//!
//! The arm is held, so the vehicle is one body with momentum `p` and angular momentum `l` about its centre of mass. A thruster
//! with lever `a` about that centre gives per unit of impulse a push of length one, in a direction that turns with the
//! body, and `a` of angular momentum. As long as the body turns, every thruster points in every direction once a turn, for
//! nothing but time; so what counts is only how much impulse there is, and its lever: [`least_impulse`].
//!
//! Where the spin needs more than the drift, that bound is met by the one thruster with the longest lever against the spin,
//! if its impulses together make `-p`. [`plan`] finds two burns that do: between them the vehicle turns, freely, until the
//! second burn points to where the first one's push and the drift are undone. What noise leaves of the momentum is damped out.

use crate::allocation::Wrench;
use fss_multibody::{Model, State};
use std::f64::consts::TAU;

/// The vehicle with its arm held, as one body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Of everything, kg.
    pub mass_kg: f64,
    /// About the centre of mass, kg m2.
    pub inertia_kg_m2: f64,
    /// Heading of the base, rad.
    pub heading_rad: f64,
    /// Its rate, rad/s.
    pub rate_rad_s: f64,
    /// Momentum in table axes, kg m/s.
    pub momentum: [f64; 2],
    /// Centre of mass in base axes, m.
    pub centre_m: [f64; 2],
    /// The same in the table frame, m.
    pub place_m: [f64; 2],
}

impl Body {
    /// Of a vehicle whose joints stand.
    pub fn of(model: &Model, state: &State) -> Self {
        let mut held = *state;
        held.v.iter_mut().skip(3).for_each(|rate| *rate = 0.0);
        let momentum = model.momentum(&held).linear;
        let centre = model.center_of_mass(&state.q);
        let (sin, cos) = state.q[2].sin_cos();
        let (x, y) = (centre.x - state.q[0], centre.y - state.q[1]);
        Self {
            mass_kg: model.total_mass_kg(),
            inertia_kg_m2: model.inertia_about_com(&state.q),
            heading_rad: state.q[2],
            rate_rad_s: state.v[2],
            momentum: [momentum.x, momentum.y],
            centre_m: [cos * x + sin * y, cos * y - sin * x],
            place_m: [centre.x, centre.y],
        }
    }

    /// Thrust and lever about the centre of mass of a thruster with this wrench in base axes about the base's origin.
    pub fn thrust_and_lever(&self, wrench: &Wrench) -> (f64, f64) {
        let thrust = wrench[0].hypot(wrench[1]);
        let torque = wrench[2] - self.centre_m[0] * wrench[1] + self.centre_m[1] * wrench[0];
        (thrust, if thrust > 0.0 { torque / thrust } else { 0.0 })
    }

    /// The thruster with the longest lever against the spin, and that lever's length, m.
    pub fn best_against_spin(&self, wrenches: &[Wrench]) -> Option<(usize, f64)> {
        let against = |(i, wrench): (usize, &Wrench)| (i, -self.rate_rad_s.signum() * self.thrust_and_lever(wrench).1);
        wrenches.iter().enumerate().map(against).filter(|(_, lever)| *lever > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn drift_kg_m_s(&self) -> f64 {
        self.momentum[0].hypot(self.momentum[1])
    }

    fn spin_kg_m2_s(&self) -> f64 {
        self.inertia_kg_m2 * self.rate_rad_s.abs()
    }
}

/// No thruster firings whatever stop the body with less impulse than this, N s.
///
/// Firings add up to `sum J_i e_i = -p` and `sum J_i a_i = -l`. With `|e_i| = 1` and `|a_i| <= a`, the largest lever against
/// the spin, `sum J_i >= max(|p|, |l| / a)`: the optimum of the linear program over all thrusters in all headings. Infinite where
/// no thruster turns against the spin.
pub fn least_impulse(body: &Body, wrenches: &[Wrench]) -> f64 {
    let by_spin = match body.best_against_spin(wrenches) {
        Some((_, lever)) => body.spin_kg_m2_s() / lever,
        None if body.rate_rad_s == 0.0 => 0.0,
        None => f64::INFINITY,
    };
    body.drift_kg_m_s().max(by_spin)
}

/// Two burns of one thruster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// The thruster, from 0.
    pub thruster: usize,
    /// Heading at which the first burn begins, rad.
    pub first_rad: f64,
    /// Rate, without its sign, at which it ends, rad/s.
    pub between_rad_s: f64,
}

/// A complex number: a direction and a length.
type Vector = [f64; 2];

fn turned([x, y]: Vector, angle_rad: f64) -> Vector {
    let (sin, cos) = angle_rad.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

fn angle([x, y]: Vector) -> f64 {
    y.atan2(x)
}

/// What a thruster does that slows the spin down.
#[derive(Clone, Copy)]
struct Brake {
    /// Thrust in base axes, N.
    force: Vector,
    /// By how much it slows the spin, rad/s2.
    deceleration: f64,
    /// Side of the spin.
    side: f64,
}

/// Intervals of Simpson's rule over a burn.
const INTERVALS: usize = 24;

impl Brake {
    /// Impulse in table axes of a burn that begins at heading 0 with one rate (without its sign) and ends at another, N s.
    fn impulse(&self, from_rad_s: f64, to_rad_s: f64) -> Vector {
        let time_s = (from_rad_s - to_rad_s) / self.deceleration;
        let step_s = time_s / INTERVALS as f64;
        let mut sum = [0.0; 2];
        for k in 0..=INTERVALS {
            let weight = if k == 0 || k == INTERVALS {
                1.0
            } else if k % 2 == 1 {
                4.0
            } else {
                2.0
            };
            let t_s = k as f64 * step_s;
            let heading = self.side * (from_rad_s - 0.5 * self.deceleration * t_s) * t_s;
            let push = turned(self.force, heading);
            sum = [sum[0] + weight * push[0], sum[1] + weight * push[1]];
        }
        sum.map(|s| s * step_s / 3.0)
    }

    /// Angle that such a burn takes, with its sign, rad.
    fn angle_of(&self, from_rad_s: f64, to_rad_s: f64) -> f64 {
        self.side * (from_rad_s * from_rad_s - to_rad_s * to_rad_s) / (2.0 * self.deceleration)
    }

    /// The next heading from `here_rad` in the sense of the spin that is `wanted_rad` but for whole turns.
    fn next(&self, wanted_rad: f64, here_rad: f64) -> f64 {
        let ahead_rad = (self.side * (wanted_rad - here_rad)).rem_euclid(TAU);
        here_rad + self.side * if ahead_rad > TAU - JUST_PASSED_RAD { 0.0 } else { ahead_rad }
    }
}

fn brake(body: &Body, wrenches: &[Wrench]) -> Option<(usize, Brake)> {
    let (thruster, lever) = body.best_against_spin(wrenches)?;
    let wrench = wrenches.get(thruster)?;
    let thrust = wrench[0].hypot(wrench[1]);
    let side = body.rate_rad_s.signum();
    Some((thruster, Brake { force: [wrench[0], wrench[1]], deceleration: thrust * lever / body.inertia_kg_m2, side }))
}

/// Rates between the burns among which the burns' balance is sought, and rates that are tried within it.
const SEARCHED: usize = 48;
const TRIED: usize = 24;
/// A vehicle must not wait longer than this for its headings, s.
const LONGEST_WAIT_S: f64 = 200.0;
/// What a second is worth beside a metre from the table's middle, m.
const WORTH_OF_A_SECOND_M: f64 = 0.002;
/// A heading that was passed by less than this is not waited for through a whole turn, rad.
const JUST_PASSED_RAD: f64 = 0.1;

/// The two burns that stop the body with [`least_impulse`] and keep it nearest to the table's middle; `None` where the drift
/// needs more impulse than the spin, or the burns would have to wait for too long.
///
/// Rates between the burns with which they can undo the drift, and each other, lie around those where both make the same;
/// without drift any heading would do for the first. So the way that the vehicle goes between the burns can be chosen.
pub fn plan(body: &Body, wrenches: &[Wrench]) -> Option<Plan> {
    let (thruster, brake) = brake(body, wrenches)?;
    let rate = body.rate_rad_s.abs();
    let drift = body.drift_kg_m_s();
    let length = |[x, y]: Vector| x.hypot(y);
    // By how much the first burn makes more than the second.
    let excess = |between: f64| length(brake.impulse(rate, between)) - length(brake.impulse(between, 0.0));
    let mut best: Option<(f64, Plan)> = None;
    let mut consider = |between_rad_s: f64| {
        for (cost, first_rad) in first_burns(body, &brake, between_rad_s).into_iter().flatten() {
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, Plan { thruster, first_rad, between_rad_s }));
            }
        }
    };
    let searched = |k: usize| rate * k as f64 / SEARCHED as f64;
    for k in 0..SEARCHED {
        let (from, to) = (searched(k), searched(k + 1));
        let (at_from, at_to) = (excess(from), excess(to));
        let (least, most) = (at_from.min(at_to), at_from.max(at_to));
        if least > drift || most < -drift || at_from == at_to {
            continue;
        }
        // Nearly a straight line from one to the other: the part of it where the triangle closes.
        let share = |wanted: f64| ((wanted - at_from) / (at_to - at_from)).clamp(0.0, 1.0);
        let (first, last) = (share(-drift), share(drift));
        for n in 0..=TRIED {
            let share = first + (last - first) * n as f64 / TRIED as f64;
            consider(from + (to - from) * share);
        }
    }
    best.map(|(_, plan)| plan)
}

/// Headings at which a first burn down to a rate can begin, so that a second one can undo what is then left; and what
/// each costs, m.
fn first_burns(body: &Body, brake: &Brake, between: f64) -> [Option<(f64, f64)>; 2] {
    let rate = body.rate_rad_s.abs();
    let wanted = [-body.momentum[0], -body.momentum[1]];
    let (first, second) = (brake.impulse(rate, between), brake.impulse(between, 0.0));
    let (a, b, c) = (first[0].hypot(first[1]), second[0].hypot(second[1]), body.drift_kg_m_s());
    // The triangle of both burns and what they shall make together.
    let cos = (c * c - a * a - b * b) / (2.0 * a * b);
    // At the ends of what can close it, rounding must not open it.
    if !(-1.02..=1.02).contains(&cos) {
        return [None; 2];
    }
    let opened = cos.clamp(-1.0, 1.0).acos();
    [opened, -opened].map(|apart| {
        let both = turned([b, 0.0], apart);
        let first_direction = angle(wanted) - angle([a + both[0], both[1]]);
        let first_rad = brake.next(first_direction - angle(first), body.heading_rad);
        let burnt_rad = first_rad + brake.angle_of(rate, between);
        let second_rad = brake.next(first_direction + apart - angle(second), burnt_rad);
        let waits_s = [(first_rad - body.heading_rad).abs() / rate, (second_rad - burnt_rad).abs() / between.max(1e-9)];
        let push = turned(first, first_rad);
        let after = [body.momentum[0] + push[0], body.momentum[1] + push[1]];
        let place =
            |from: Vector, momentum: Vector, time_s: f64| [0, 1].map(|i| from[i] + momentum[i] / body.mass_kg * time_s);
        let at_first = place(body.place_m, body.momentum, waits_s[0]);
        let burn_s = (rate - between) / brake.deceleration;
        let half_way = [0, 1].map(|i| 0.5 * (body.momentum[i] + after[i]));
        let at_second = place(place(at_first, half_way, burn_s), after, waits_s[1]);
        let last_s = between / brake.deceleration;
        let at_end = place(at_second, after.map(|p| 0.5 * p), last_s);
        let from_middle = |[x, y]: Vector| x.abs().max(y.abs());
        let farthest_m = from_middle(at_first).max(from_middle(at_second)).max(from_middle(at_end));
        let wait_s = waits_s[0] + waits_s[1];
        (wait_s < LONGEST_WAIT_S).then_some((farthest_m + WORTH_OF_A_SECOND_M * wait_s, first_rad))
    })
}

/// The heading at which the last burn shall begin, rad: its impulse points against what momentum is left; and how much of
/// that it then leaves, N s.
fn last_burn(body: &Body, wrenches: &[Wrench]) -> (f64, f64) {
    let Some((_, brake)) = brake(body, wrenches) else { return (body.heading_rad, 0.0) };
    let impulse = brake.impulse(body.rate_rad_s.abs(), 0.0);
    let against = [-body.momentum[0], -body.momentum[1]];
    let heading = brake.next(angle(against) - angle(impulse), body.heading_rad);
    (heading, (impulse[0].hypot(impulse[1]) - body.drift_kg_m_s()).abs())
}

/// Where a stop stands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Begins,
    Waits(Plan),
    Burns(Plan),
    /// Navigation needs a moment until it has the velocity that a burn has left, s.
    Settles(Plan, f64),
    WaitsAgain(Plan, f64),
    BurnsAgain(Plan),
    SettlesAgain(f64),
    /// What is left is damped out.
    Damps,
}

/// A stop under way.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    stage: Stage,
    side: f64,
}

/// What a last burn may leave of the momentum without being split in two once more, N s.
const TOLERATED_N_S: f64 = 0.015;
/// Time for navigation to follow after a burn, s.
const SETTLING_S: f64 = 1.0;

/// Spins slower than this are damped out at once, rad/s.
const SLOW_RAD_S: f64 = 0.01;

impl Default for Stop {
    fn default() -> Self {
        Self { stage: Stage::Begins, side: 0.0 }
    }
}

/// What the thrusters shall do now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// Nothing.
    Coast,
    /// This one is open.
    Burn(usize),
    /// Rates are damped out.
    Damp,
}

impl Stop {
    /// What to do with the body as it is, one period after the step before.
    pub fn step(&mut self, body: &Body, wrenches: &[Wrench], period_s: f64) -> Action {
        if self.stage == Stage::Begins {
            self.side = body.rate_rad_s.signum();
            let slow = body.rate_rad_s.abs() < SLOW_RAD_S;
            self.stage = plan(body, wrenches).filter(|_| !slow).map_or(Stage::Damps, Stage::Waits);
        }
        let passed = |heading: f64| self.side * (body.heading_rad - heading) >= 0.0;
        let slower_than = |rate: f64| self.side * body.rate_rad_s <= rate;
        self.stage = match self.stage {
            Stage::Waits(plan) if passed(plan.first_rad) => Stage::Burns(plan),
            Stage::Burns(plan) if slower_than(plan.between_rad_s) => Stage::Settles(plan, SETTLING_S),
            Stage::Settles(plan, left_s) if left_s <= 0.0 => {
                let (heading, leaves) = last_burn(body, wrenches);
                let split = leaves > TOLERATED_N_S && body.rate_rad_s.abs() > SLOW_RAD_S;
                let anew = if split { self::plan(body, wrenches) } else { None };
                anew.map_or(Stage::WaitsAgain(plan, heading), Stage::Waits)
            }
            Stage::Settles(plan, left_s) => Stage::Settles(plan, left_s - period_s),
            Stage::WaitsAgain(plan, heading) if passed(heading) => Stage::BurnsAgain(plan),
            Stage::BurnsAgain(_) if slower_than(0.0) => Stage::SettlesAgain(SETTLING_S),
            Stage::SettlesAgain(left_s) if left_s <= 0.0 => Stage::Damps,
            Stage::SettlesAgain(left_s) => Stage::SettlesAgain(left_s - period_s),
            same => same,
        };
        match self.stage {
            Stage::Burns(plan) | Stage::BurnsAgain(plan) => Action::Burn(plan.thruster),
            Stage::Damps => Action::Damp,
            _ => Action::Coast,
        }
    }
}
