//! Figures of merit of missions that stop a vehicle, capture a target or carry one, from the truth.

use crate::stack::Stack;
use fss_base::stop::{Body, least_impulse};
use fss_messages::{MissionState, TruthState};
use fss_multibody::wrapped;
use fss_multibody::{Model, State};
use fss_plant::{Grasped, Physics, Plant};
use serde::Serialize;

/// Standard gravity, which makes a specific impulse a speed, m/s2.
const G0_M_S2: f64 = 9.806_65;

/// How much gas a stop took.
#[derive(Clone, Debug, Serialize)]
pub struct StopFigures {
    /// Gas from the start of the stop to the end of the mission, kg.
    pub gas_used_kg: f64,
    /// Less than this no thruster firings need, kg.
    pub least_gas_kg: f64,
    /// One over the other.
    pub ratio: f64,
    /// Speed of the centre of mass at the start and at the end, m/s.
    pub speed_m_s: [f64; 2],
    /// Rate of the base at the start and at the end, degrees/s.
    pub rate_deg_s: [f64; 2],
}

/// How a capture went.
#[derive(Clone, Debug, Serialize)]
pub struct CaptureFigures {
    /// Whether the target is held at the end, or, where the mission carries it somewhere, whether it was taken.
    pub success: bool,
    /// Distance of the end-effector from the handle when the gripper took it, m.
    pub miss_m: Option<f64>,
    /// Speed of the end-effector past the handle then, m/s.
    pub contact_speed_m_s: Option<f64>,
    /// Of vehicle and target together just before and just after: kg m/s, kg m/s, kg m2/s about the table's middle.
    pub momentum_before: Option<[f64; 3]>,
    /// The same just after.
    pub momentum_after: Option<[f64; 3]>,
    /// How far the base turned from the start of the arm's reach to the grasp, at most, degrees.
    pub base_turned_deg: Option<f64>,
    /// Nearest that base, joints, end-effector or target came to the table's edge, m; negative is beyond.
    pub room_on_table_m: f64,
}

/// A target that is left so far from where it was carried to, m,
const PLACED_M: f64 = 0.01;
/// so much turned, degrees,
const PLACED_DEG: f64 = 2.0;
/// and no faster than this, m/s, was put there.
const PLACED_M_S: f64 = 0.003;

/// How a target was carried along a path and let go.
#[derive(Clone, Debug, Serialize)]
pub struct CarryFigures {
    /// Whether it was let go at the path's end, within 10 mm and 2 degrees of where it should be and slower than 3 mm/s.
    pub success: bool,
    /// Length of the path of the target's centre, m.
    pub path_m: f64,
    /// Root of the mean square distance of its centre from the straight legs, m.
    pub deviation_rms_m: f64,
    /// The largest, m.
    pub deviation_max_m: f64,
    /// When it was let go: distance of its centre from the path's end, m.
    pub placed_error_m: Option<f64>,
    /// Difference of its heading then, degrees.
    pub placed_error_deg: Option<f64>,
    /// How fast it drifts afterwards, m/s.
    pub left_speed_m_s: Option<f64>,
    /// How fast it turns afterwards, degrees/s.
    pub left_rate_deg_s: Option<f64>,
    /// Gas from the start of the first leg until it was let go, kg.
    pub gas_used_kg: f64,
}

/// Of a mission with a phase whose base goal is to stop.
pub fn stop(stack: &Stack, truth: &[TruthState], states: &[MissionState]) -> Option<StopFigures> {
    let is_stop = |s: &&MissionState| s.state == MissionState::RUNNING && s.base_mode == MissionState::BASE_STOP;
    let begin_ns = states.iter().find(is_stop)?.phase_start_ns;
    let plant = stack.laboratory();
    let specific_impulse_s = plant.tank.as_ref()?.specific_impulse_s;
    let first = truth.get(truth.partition_point(|t| t.stamp_ns < begin_ns))?;
    let last = truth.last()?;
    let body = |t: &TruthState| body(plant, t);
    let wrenches = fss_base::wrenches(&Physics::at(plant, 0.0));
    let (at_first, at_last) = (body(first)?, body(last)?);
    let least_gas_kg = least_impulse(&at_first, &wrenches) / (G0_M_S2 * specific_impulse_s);
    let gas_used_kg = last.gas_used_kg - first.gas_used_kg;
    let speed = |body: &Body| body.momentum[0].hypot(body.momentum[1]) / body.mass_kg;
    Some(StopFigures {
        gas_used_kg,
        least_gas_kg,
        ratio: gas_used_kg / least_gas_kg,
        speed_m_s: [speed(&at_first), speed(&at_last)],
        rate_deg_s: [at_first.rate_rad_s.to_degrees(), at_last.rate_rad_s.to_degrees()],
    })
}

fn body(plant: &Plant, t: &TruthState) -> Option<Body> {
    Some(Body::of(&model(plant, t)?, &state(t)))
}

fn state(t: &TruthState) -> State {
    let joints = t.link_count as usize;
    State::from_slices(
        &[&[t.x_m, t.y_m, t.theta_rad], &t.q_rad[..joints]].concat(),
        &[&[t.vx_m_s, t.vy_m_s, t.omega_rad_s], &t.qd_rad_s[..joints]].concat(),
    )
}

/// The vehicle as it is then: with the target where that is held, without the gas that is used.
fn model(plant: &Plant, t: &TruthState) -> Option<Model> {
    let mut physics = Physics::at(plant, 0.0);
    if let (true, Some(target), Some(link)) = (t.target_held != 0, &plant.target, plant.links.last()) {
        let (sin, cos) = t.ee[2].sin_cos();
        let (dx, dy) = (t.target[0] - t.ee[0], t.target[1] - t.ee[1]);
        physics.grasped = Some(Grasped {
            mass_kg: target.mass_kg,
            inertia_kg_m2: target.inertia_kg_m2,
            at_m: [link.length_m + cos * dx + sin * dy, cos * dy - sin * dx],
        });
    }
    physics.model(t.gas_used_kg).ok()
}

/// Momentum of the vehicle and of the target, kg m/s, kg m/s, and kg m2/s about the table's middle; once the target is held
/// the vehicle's is that of both, and there is no other.
pub fn momenta(plant: &Plant, t: &TruthState) -> Option<([f64; 3], Option<[f64; 3]>)> {
    let centre = model(plant, t)?.center_of_mass(&state(t).q);
    let [px, py] = t.momentum;
    let vehicle = [px, py, t.angular_momentum + centre.x * py - centre.y * px];
    let target = plant.target.as_ref().filter(|_| t.target_held == 0).map(|target| {
        let ([x, y, _], [vx, vy, omega]) = (t.target, t.target_rate);
        let m = target.mass_kg;
        [m * vx, m * vy, m * (x * vy - y * vx) + target.inertia_kg_m2 * omega]
    });
    Some((vehicle, target))
}

/// Of a mission with a target.
pub fn capture(stack: &Stack, truth: &[TruthState], states: &[MissionState]) -> Option<CaptureFigures> {
    let target = stack.mission.target.as_ref()?;
    let last = truth.last()?;
    let grasped = (last.grasp_ns > 0).then_some(last);
    let reach = states.iter().find(|s| s.arm_mode == MissionState::ARM_CAPTURE).map(|s| s.phase_start_ns);
    let turned = reach.filter(|_| grasped.is_some()).and_then(|begin_ns| {
        let first = truth.iter().find(|t| t.stamp_ns >= begin_ns)?;
        let during = truth.iter().filter(|t| (begin_ns..=last.grasp_ns).contains(&t.stamp_ns));
        Some(during.map(|t| (t.theta_rad - first.theta_rad).to_degrees().abs()).fold(0.0, f64::max))
    });
    let half = stack.laboratory().table.size_m.map(|size| size / 2.0);
    let room = |x: f64, y: f64| (half[0] - x.abs()).min(half[1] - y.abs());
    let nearest = |t: &TruthState| {
        let disc = room(t.target[0], t.target[1]) - target.body.radius_m;
        room(t.x_m, t.y_m).min(room(t.ee[0], t.ee[1])).min(disc)
    };
    let is_carried_away = states.iter().any(|s| s.carrying != 0);
    Some(CaptureFigures {
        success: last.target_held != 0 || (is_carried_away && grasped.is_some()),
        miss_m: grasped.map(|t| t.grasp_miss_m),
        contact_speed_m_s: grasped.map(|t| t.grasp_speed_m_s),
        momentum_before: grasped.map(|t| t.grasp_momentum_before),
        momentum_after: grasped.map(|t| t.grasp_momentum_after),
        base_turned_deg: turned,
        room_on_table_m: truth.iter().map(nearest).fold(f64::INFINITY, f64::min),
    })
}

/// Of a mission with phases whose base goal is to carry the target.
pub fn carry(truth: &[TruthState], states: &[MissionState]) -> Option<CarryFigures> {
    let mut legs = states.iter().filter(|s| s.carrying != 0).collect::<Vec<_>>();
    legs.dedup_by_key(|s| s.phase_start_ns);
    let begin_ns = legs.first()?.phase_start_ns;
    let first = truth.get(truth.partition_point(|t| t.stamp_ns < begin_ns))?;
    let (mut from, mut path_m, mut sum2, mut count, mut most_m) = ([0.0; 2], 0.0, 0.0, 0.0, 0.0_f64);
    for (i, leg) in legs.iter().enumerate() {
        let end_ns = legs.get(i + 1).map_or(u64::MAX, |next| next.phase_start_ns);
        let held = |t: &&TruthState| t.target_held != 0 && (leg.phase_start_ns..end_ns).contains(&t.stamp_ns);
        let [to_x, to_y, _] = leg.target_goal;
        if i == 0 {
            from = [first.target[0], first.target[1]];
        }
        path_m += (to_x - from[0]).hypot(to_y - from[1]);
        for t in truth.iter().filter(held) {
            let apart_m = distance_from_segment([t.target[0], t.target[1]], from, [to_x, to_y]);
            (sum2, count, most_m) = (sum2 + apart_m * apart_m, count + 1.0, most_m.max(apart_m));
        }
        from = [to_x, to_y];
    }
    // It was let go where it is held no more; what it does then it goes on doing.
    let is_later = |t: &&TruthState| t.stamp_ns > begin_ns && t.target_held == 0;
    let (let_go, left) = (truth.iter().find(is_later), truth.last()?);
    let goal = legs.last()?.target_goal;
    let placed_error_m = let_go.map(|t| (t.target[0] - goal[0]).hypot(t.target[1] - goal[1]));
    let placed_error_deg = let_go.map(|t| {
        let apart = t.target[2] - goal[2];
        wrapped(apart).to_degrees().abs()
    });
    let left_speed_m_s = let_go.map(|_| left.target_rate[0].hypot(left.target_rate[1]));
    let within = |value: Option<f64>, most: f64| value.is_some_and(|value| value <= most);
    Some(CarryFigures {
        success: within(placed_error_m, PLACED_M)
            && within(placed_error_deg, PLACED_DEG)
            && within(left_speed_m_s, PLACED_M_S),
        path_m,
        deviation_rms_m: (sum2 / f64::max(count, 1.0)).sqrt(),
        deviation_max_m: most_m,
        placed_error_m,
        placed_error_deg,
        left_speed_m_s,
        left_rate_deg_s: let_go.map(|_| left.target_rate[2].to_degrees()),
        gas_used_kg: let_go.unwrap_or(left).gas_used_kg - first.gas_used_kg,
    })
}

/// Of a point from the straight way between two others, m.
fn distance_from_segment(point: [f64; 2], from: [f64; 2], to: [f64; 2]) -> f64 {
    let (way, gone) = ([to[0] - from[0], to[1] - from[1]], [point[0] - from[0], point[1] - from[1]]);
    let length2 = way[0] * way[0] + way[1] * way[1];
    let share = if length2 > 0.0 { ((gone[0] * way[0] + gone[1] * way[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (gone[0] - share * way[0]).hypot(gone[1] - share * way[1])
}

/// Rows of a table for a person: what, and its value; what is empty continues the row before.
pub type Rows = Vec<(&'static str, String)>;

impl StopFigures {
    /// Rows for a person.
    pub(crate) fn rows(&self) -> Rows {
        let (used, least) = (self.gas_used_kg * 1e3, self.least_gas_kg * 1e3);
        let ([v0, v1], [w0, w1]) = (self.speed_m_s.map(|v| v * 1e3), self.rate_deg_s);
        vec![
            ("stop", format!("{used:.2} g of gas, at least {least:.2} g are needed: ratio {:.3}", self.ratio)),
            ("", format!("from {w0:.2} deg/s and {v0:.1} mm/s to {w1:.3} deg/s and {v1:.1} mm/s")),
        ]
    }
}

impl CaptureFigures {
    /// Rows for a person.
    pub(crate) fn rows(&self) -> Rows {
        let (Some(miss), Some(speed)) = (self.miss_m, self.contact_speed_m_s) else {
            return vec![("capture", "failed: the gripper took nothing".to_owned())];
        };
        let what = if self.success { "the target was taken" } else { "the target was lost again" };
        let mut rows = vec![("capture", format!("{what}; missed by {:.2} mm at {:.2} mm/s", miss * 1e3, speed * 1e3))];
        if let (Some(before), Some(after)) = (self.momentum_before, self.momentum_after) {
            let show = |p: [f64; 3]| format!("({:.6}, {:.6}) kg m/s, {:.6} kg m2/s", p[0], p[1], p[2]);
            rows.push(("momentum", format!("before {}", show(before))));
            rows.push(("", format!("after  {}", show(after))));
        }
        let turned = self.base_turned_deg.unwrap_or(0.0);
        let room = self.room_on_table_m;
        rows.push(("", format!("the base turned by {turned:.2} deg meanwhile, {room:.2} m from the edge")));
        rows
    }
}

impl CarryFigures {
    /// Rows for a person.
    pub(crate) fn rows(&self) -> Rows {
        let (rms_mm, most_mm) = (self.deviation_rms_m * 1e3, self.deviation_max_m * 1e3);
        let off = format!("off the straight legs by {rms_mm:.1} mm RMS and {most_mm:.1} mm at most");
        let carried = format!("{:.2} m, {off}, with {:.2} g of gas", self.path_m, self.gas_used_kg * 1e3);
        let left = match (self.placed_error_m, self.placed_error_deg, self.left_speed_m_s, self.left_rate_deg_s) {
            (Some(apart_m), Some(turned_deg), Some(speed_m_s), Some(rate_deg_s)) => format!(
                "let go {:.1} mm and {turned_deg:.2} deg from the path's end, where it stays at {:.2} mm/s and \
                 {rate_deg_s:.3} deg/s",
                apart_m * 1e3,
                speed_m_s * 1e3
            ),
            _ => "and was never let go".to_owned(),
        };
        vec![("carried", carried), ("", left)]
    }
}
