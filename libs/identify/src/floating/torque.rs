//! The joints' torques: what the sensor behind the gear says, what the current makes, what the motion takes.
//!
//! The two sides of the sensor separate causes: friction and torque constant stand between current and sensor, masses
//! and inertias between sensor and motion.

use super::drive::{driven, measured};
use super::layout::Window;
use super::{Flight, STEP_S, Simulated};
use fss_multibody::{JointVector, MAX_LINKS, State};
use fss_plant::BaseMotion;
use nalgebra::Vector3;

impl Flight<'_> {
    /// For each telemetry sample and joint: sensor less motion, then sensor less current; where there is no sensor,
    /// current less motion.
    pub(super) fn torque_rows(&self, window: &Window, simulated: &Simulated, out: &mut Vec<f64>) {
        let Some(joints) = &self.record.run.joints else { return };
        for k in window.joints.clone() {
            let stamp_s = joints.t_s[k];
            let physics = self.rollout.physics(stamp_s);
            let mut needed = (f64::NAN, JointVector::zeros());
            for joint in 0..self.plant.link_count() {
                let drive = &physics.joints[joint];
                let t_s = stamp_s - physics.sensors.link_age_s(joint);
                if needed.0 != t_s {
                    needed = (t_s, self.needed_torques(simulated, t_s));
                }
                let needed = &needed.1;
                let (rate, rate_sd) = self.rate(t_s, joint);
                let driven = driven(joints, k, joint, drive, rate, rate_sd);
                match (measured(&joints.torque_nm, joint, k), driven) {
                    (Some(torque), driven) => {
                        out.push(torque - drive.torque_reading(needed[joint]));
                        out.extend(driven.map(|driven| torque - drive.torque_reading(driven)));
                    }
                    (None, Some(driven)) => out.push(driven - needed[joint]),
                    (None, None) => {}
                }
            }
        }
    }

    /// Rate of a joint and its standard deviation, rad/s.
    fn rate(&self, t_s: f64, joint: usize) -> (f64, f64) {
        let half = self.half(t_s);
        (self.motion.samples[half].qd_rad_s[joint], self.motion.variance[half][1][joint].sqrt())
    }

    /// Torques that the drives must pass on for the arm to move as it does.
    fn needed_torques(&self, simulated: &Simulated, t_s: f64) -> JointVector {
        let base = simulated.at(t_s);
        let half = self.half(t_s);
        let mut state = State::at_rest(self.configuration(&base, t_s));
        state.v.fixed_rows_mut::<3>(0).copy_from_slice(&base.velocity);
        state.v.fixed_rows_mut::<MAX_LINKS>(3).copy_from(&self.motion.samples[half].qd_rad_s);
        let physics = self.rollout.physics(t_s);
        let step = (((t_s - simulated.start_s) / STEP_S).max(0.0) as usize).min(simulated.thrust.len().max(1) - 1);
        let [fx, fy, torque] = simulated.thrust.get(step).copied().unwrap_or_default();
        let (sin, cos) = base.pose[2].sin_cos();
        let motion = BaseMotion { t_s, pose: base.pose, velocity: base.velocity };
        let push = Vector3::new(cos * fx - sin * fy, sin * fx + cos * fy, torque)
            + Vector3::from(physics.base_wrench(&motion));
        let model = self.rollout.model(t_s);
        let acc = model.prescribed_dynamics(&state, &self.motion.acceleration[half], &push);
        let mut needed = model.inverse_dynamics(&state, &acc).fixed_rows::<MAX_LINKS>(3).into_owned();
        for law in &physics.joint_laws {
            let i = law.joint;
            needed[i] -= (law.law)(&law.values, t_s, state.q[3 + i], state.v[3 + i]);
        }
        needed
    }
}
