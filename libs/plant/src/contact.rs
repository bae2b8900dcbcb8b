//! A passive body on the table: floating, touched by the arm's tip, grasped.

use fss_multibody::{Coordinates, MAX_DOF};

use crate::physics::Grasped;
use crate::simulation::Simulation;
use crate::target::Target;

/// How far beyond the target's rim the gripper still takes hold (m).
const GRASP_REACH_M: f64 = 0.02;

/// Why nothing was grasped.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum GraspError {
    /// The plant has no `[target]`.
    #[error("the plant has no [target] to grasp")]
    NoTarget,
    /// The plant has no arm.
    #[error("the plant has no arm to grasp with")]
    NoArm,
    /// It is held already.
    #[error("the target is held already")]
    Held,
    /// The tip does not touch it.
    #[error("the target is out of reach: its rim is {gap_m:.3} m from the tip")]
    OutOfReach {
        /// Between tip and rim (m).
        gap_m: f64,
    },
}

impl Simulation {
    /// Pose and velocity of the target; zeros without one.
    pub(crate) fn target_motion(&self) -> ([f64; 3], [f64; 3]) {
        self.target.as_ref().map_or(([0.0; 3], [0.0; 3]), |t| (t.pose, t.velocity))
    }

    /// Puts the target where it should be.
    pub fn set_target(&mut self, pose: [f64; 3], velocity: [f64; 3]) {
        if let Some(target) = &mut self.target
            && target.held.is_none()
        {
            (target.pose, target.velocity) = (pose, velocity);
        }
    }

    /// All that the tip has pushed the target so far, table axes (N s).
    pub fn pushed_n_s(&self) -> [f64; 2] {
        self.target.as_ref().map_or([0.0; 2], |t| t.pushed_n_s)
    }

    /// Somebody pushes the vehicle through the origin of its base frame, table axes (N s).
    pub fn push(&mut self, impulse_n_s: [f64; 2]) {
        let mut along = Coordinates::zeros();
        (along[0], along[1]) = (impulse_n_s[0], impulse_n_s[1]);
        let q = self.motion.state.q;
        self.motion.state.v += self.model().mass_matrix_inverse(&q) * along;
    }

    /// Somebody holds the vehicle and moves its base as he likes; its joints go on as they are.
    pub fn carry_base(&mut self, pose: [f64; 3], velocity: [f64; 3]) {
        self.motion.state.q.as_mut_slice()[..3].copy_from_slice(&pose);
        self.motion.state.v.as_mut_slice()[..3].copy_from_slice(&velocity);
    }

    /// Whether the target is held.
    pub fn is_grasping(&self) -> bool {
        self.target.as_ref().is_some_and(|t| t.held.is_some())
    }

    /// Takes rigid hold of the target at the tip: a plastic impact of the target with the last link, in which the
    /// joints are free to give. Linear and angular momentum of all bodies together stay what they are.
    pub fn grasp(&mut self) -> Result<(), GraspError> {
        let target = self.target.as_ref().ok_or(GraspError::NoTarget)?;
        if target.held.is_some() {
            return Err(GraspError::Held);
        }
        let (pose, velocity, body) = (target.pose, target.velocity, target.body.clone());
        let links = self.joint_count();
        if links == 0 {
            return Err(GraspError::NoArm);
        }
        let tip = self.truth().ee_pose;
        let gap_m = (tip[0] - pose[0]).hypot(tip[1] - pose[1]) - body.radius_m;
        if gap_m > GRASP_REACH_M {
            return Err(GraspError::OutOfReach { gap_m });
        }
        // The target's centre in the last link's frame, which has its origin at the joint.
        let length = self.physics().links[links - 1].length_m;
        let (sin, cos) = tip[2].sin_cos();
        let d = [pose[0] - tip[0], pose[1] - tip[1]];
        let at = [length + cos * d[0] + sin * d[1], cos * d[1] - sin * d[0]];
        let q = self.motion.state.q;
        let model = *self.model();
        // M+ v+ = M v + J' M_t v_t, where M+ has the target on board.
        let jacobian = model.point_jacobian(&q, links, at);
        let mut momentum: Coordinates = model.mass_matrix(&q) * self.motion.state.v;
        let carried = [body.mass_kg * velocity[0], body.mass_kg * velocity[1], body.inertia_kg_m2 * velocity[2]];
        for i in 0..MAX_DOF {
            momentum[i] += (0..3).map(|row| jacobian[(row, i)] * carried[row]).sum::<f64>();
        }
        let grasped = Grasped { mass_kg: body.mass_kg, inertia_kg_m2: body.inertia_kg_m2, at_m: at };
        self.carry(grasped);
        self.motion.state.v = self.model().mass_matrix_inverse(&q) * momentum;
        if let Some(target) = &mut self.target {
            target.held = Some([at[0], at[1], pose[2] - tip[2]]);
        }
        Ok(())
    }

    /// Lets go of the target, which floats on as it moved.
    pub fn release(&mut self) {
        if let Some(target) = &mut self.target
            && target.held.take().is_some()
        {
            self.let_go();
        }
    }

    /// The target's own motion over the last `dt_s`, or that of the link that holds it, and its contact with the tip.
    pub(crate) fn move_target(&mut self, dt_s: f64) {
        let Some(mut target) = self.target.take() else {
            return;
        };
        if let Some(held) = target.held {
            self.carry_along(&mut target, held);
        } else {
            let [gx, gy] = self.physics().gravity_m_s2;
            for (i, g) in [gx, gy, 0.0].into_iter().enumerate() {
                target.pose[i] += dt_s * (target.velocity[i] + 0.5 * dt_s * g);
                target.velocity[i] += dt_s * g;
            }
            self.touch(&mut target);
        }
        self.target = Some(target);
    }

    fn carry_along(&self, target: &mut Target, held: [f64; 3]) {
        let links = self.joint_count();
        let model = self.model();
        let state = &self.motion.state;
        let tip = model.end_effector(&state.q);
        let length = self.physics().links[links - 1].length_m;
        let (sin, cos) = tip.z.sin_cos();
        let (along, beside) = (held[0] - length, held[1]);
        target.pose = [tip.x + cos * along - sin * beside, tip.y + sin * along + cos * beside, tip.z + held[2]];
        let twist = model.point_jacobian(&state.q, links, [held[0], held[1]]) * state.v;
        target.velocity = [twist.x, twist.y, twist.z];
    }

    /// A smooth tip that meets the disc: an impulse along the normal (Newton's law of restitution).
    fn touch(&mut self, target: &mut Target) {
        let links = self.joint_count();
        if links == 0 {
            return;
        }
        let model = *self.model();
        let state = self.motion.state;
        let tip = model.end_effector(&state.q);
        let d = [target.pose[0] - tip.x, target.pose[1] - tip.y];
        let distance = d[0].hypot(d[1]);
        if distance > target.body.radius_m || distance == 0.0 {
            return;
        }
        let normal = [d[0] / distance, d[1] / distance];
        let jacobian = model.jacobian(&state.q);
        let mut along = Coordinates::zeros();
        for i in 0..MAX_DOF {
            along[i] = normal[0] * jacobian[(0, i)] + normal[1] * jacobian[(1, i)];
        }
        let approach = along.dot(&state.v) - normal[0] * target.velocity[0] - normal[1] * target.velocity[1];
        if approach <= 0.0 {
            return;
        }
        let per_impulse = model.mass_matrix_inverse(&state.q) * along;
        let give = along.dot(&per_impulse) + 1.0 / target.body.mass_kg;
        let impulse = (1.0 + target.body.restitution) * approach / give;
        self.motion.state.v -= impulse * per_impulse;
        for (i, along) in normal.into_iter().enumerate() {
            target.velocity[i] += impulse * along / target.body.mass_kg;
            target.pushed_n_s[i] += impulse * along;
        }
    }
}
