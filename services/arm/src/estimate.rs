//! What the controller believes of the vehicle: configuration, momentum, end-effector.

use crate::ArmConfig;
use crate::reference::Reference;
use crate::tracker::Tracker;
use fss_bus::Time;
use fss_messages::{LinksState, MAX_LINKS, MocapPose, NavState};
use fss_multibody::{Coordinates, JointVector, Model, State};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::{PI, TAU};

/// Motion capture and the computed end-effector may be apart by this much, m and rad.
const LARGEST_CORRECTION_M: f64 = 0.15;
const LARGEST_CORRECTION_RAD: f64 = 0.3;

/// Navigation and telemetry at one time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Estimate {
    /// Coordinates and rates as measured, brought to now.
    pub(crate) state: State,
    /// End-effector: x m, y m, angle rad.
    pub(crate) ee: Vector3<f64>,
}

/// What must be remembered from step to step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Estimator {
    pub(crate) tracker: Tracker,
    /// Linear momentum, kg m/s, and angular momentum about the whole's centre of mass, kg m^2/s.
    momentum: Option<(Vector2<f64>, f64)>,
    /// Motion capture less computed end-effector: m, m, rad.
    ee_correction: Option<Vector3<f64>>,
}

impl Estimator {
    /// Brings the measurements to `now` and takes them into account.
    pub(crate) fn update(
        &mut self,
        config: &ArmConfig,
        (now, dt_s): (Time, f64),
        nav: &NavState,
        links: &LinksState,
        ee: Option<&MocapPose>,
        reference: &Reference,
    ) -> Estimate {
        // The reference was last moved on at the step before.
        let q_ref_rad = reference.q_rad + reference.qd_rad_s * dt_s;
        self.tracker.remember(now, &q_ref_rad);
        let q_rad = self.tracker.angles(links, &q_ref_rad);
        let state = state_at(now, nav, links, &q_rad);
        let model = &config.model;
        let momentum = model.momentum(&state);
        let blend = (dt_s / config.momentum_time_s).min(1.0);
        let (linear, angular) = self.momentum.get_or_insert((momentum.linear, momentum.angular_about_com));
        *linear += (momentum.linear - *linear) * blend;
        *angular += (momentum.angular_about_com - *angular) * blend;

        let computed = model.end_effector(&state.q);
        if let Some(mocap) = ee.filter(|mocap| mocap.quality == MocapPose::VALID) {
            let rate = model.jacobian(&state.q) * state.v;
            let age_s = now.age_ns(mocap.stamp_ns) as f64 * 1e-9;
            let mut error = Vector3::new(mocap.x_m, mocap.y_m, mocap.theta_rad) + rate * age_s - computed;
            error.z = (error.z + PI).rem_euclid(TAU) - PI;
            // More than a bad calibration makes is no end-effector.
            if error.xy().norm() < LARGEST_CORRECTION_M && error.z.abs() < LARGEST_CORRECTION_RAD {
                let blend = (dt_s / config.mocap_time_s).min(1.0);
                let correction = self.ee_correction.get_or_insert(error);
                *correction += (error - *correction) * blend;
            }
        }
        Estimate { state, ee: computed + self.ee_correction.unwrap_or_default() }
    }

    /// Momentum `[Px, Py, L about the base's origin]` in configuration `q`.
    pub(crate) fn momentum_about_base(&self, model: &Model, q: &Coordinates) -> Vector3<f64> {
        let (linear, angular) = self.momentum.unwrap_or_default();
        let lever = model.center_of_mass(q) - Vector2::new(q[0], q[1]);
        Vector3::new(linear.x, linear.y, angular + lever.x * linear.y - lever.y * linear.x)
    }
}

fn state_at(now: Time, nav: &NavState, links: &LinksState, q_rad: &JointVector) -> State {
    let nav_age_s = now.age_ns(nav.stamp_ns) as f64 * 1e-9;
    let mut state = State::zero();
    let rate = [nav.vx_m_s, nav.vy_m_s, nav.omega_rad_s];
    for (i, (pose, rate)) in [nav.x_m, nav.y_m, nav.theta_rad].into_iter().zip(rate).enumerate() {
        state.q[i] = pose + rate * nav_age_s;
        state.v[i] = rate;
    }
    for i in 0..(links.link_count as usize).min(MAX_LINKS) {
        state.q[3 + i] = q_rad[i];
        state.v[3 + i] = links.qd_rad_s[i];
    }
    state
}

/// Joint angles as `links` extrapolates them, brought to `now`.
pub(crate) fn joints_at(now: Time, links: &LinksState) -> JointVector {
    let age_s = now.age_ns(links.stamp_ns) as f64 * 1e-9;
    JointVector::from_fn(|i, _| links.q_rad[i] + links.qd_rad_s[i] * age_s)
}
