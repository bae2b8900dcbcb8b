//! Where the bodies are, and how they move with the coordinates.

use nalgebra::{Vector2, Vector3};

use crate::chain::{Chain, absolute, by_bodies, perp};
use crate::{Coordinates, Jacobian, MAX_BODIES, Model, State};

/// Poses of all parts at one configuration, table frame. Entries beyond the last link are zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kinematics {
    /// `[x, y, angle]` of each body's centre of mass and its absolute angle: base first, then the links; m, rad.
    pub com: [Vector3<f64>; MAX_BODIES],
    /// Position of joint `i + 1`; after the last link's joint comes the end-effector; m.
    pub joints: [Vector2<f64>; MAX_BODIES],
    /// `[x, y, angle]` of the tip of the last link; m, rad. Without links: where joint 1 would be, the base's angle.
    pub end_effector: Vector3<f64>,
}

impl Model {
    /// Poses of all bodies, joints and of the end-effector at configuration `q`.
    pub fn kinematics(&self, q: &Coordinates) -> Kinematics {
        by_bodies!(self, poses(self, q))
    }

    /// Pose `[x, y, angle]` of the end-effector in the table frame, m and rad (angle not wrapped).
    pub fn end_effector(&self, q: &Coordinates) -> Vector3<f64> {
        by_bodies!(self, tip(self, q))
    }

    /// Geometric Jacobian of the end-effector, 3 x dof: its twist `[vx, vy, omega]` in table axes is `J v`.
    pub fn jacobian(&self, q: &Coordinates) -> Jacobian {
        let last = self.link_count();
        self.point_jacobian(q, last, self.lumps.d[last].into())
    }

    /// Time derivative of [`Model::jacobian`] along the motion: the tip's acceleration is `J acc + J' v`.
    pub fn jacobian_derivative(&self, state: &State) -> Jacobian {
        let last = self.link_count();
        self.point_jacobian_derivative(state, last, self.lumps.d[last].into())
    }

    /// Jacobian, 3 x dof, of a point fixed in body `body` (0 the base, `i` link `i`; the last body for more than there
    /// are), given in that body's frame, whose origin is the body's joint (the base's: its frame's) with x towards the
    /// next joint, m.
    pub fn point_jacobian(&self, q: &Coordinates, body: usize, point_m: [f64; 2]) -> Jacobian {
        by_bodies!(self, jacobian(self, q, body, &point_m.into()))
    }

    /// Time derivative of [`Model::point_jacobian`] along the motion.
    pub fn point_jacobian_derivative(&self, state: &State, body: usize, point_m: [f64; 2]) -> Jacobian {
        by_bodies!(self, jacobian_derivative(self, state, body, &point_m.into()))
    }

    /// Centre of mass of base and arm together, table frame, m.
    pub fn center_of_mass(&self, q: &Coordinates) -> Vector2<f64> {
        by_bodies!(self, center_of_mass(self, q))
    }
}

fn poses<const B: usize>(model: &Model, q: &Coordinates) -> Kinematics {
    let chain = Chain::<B>::at(model, q);
    let mut origin = Vector2::new(q[0], q[1]);
    let mut com = [Vector3::zeros(); MAX_BODIES];
    let mut joints = [Vector2::zeros(); MAX_BODIES];
    for i in 0..B {
        let centre = origin + chain.turned(i, &model.lumps.c[i]);
        com[i] = Vector3::new(centre.x, centre.y, chain.angle[i]);
        origin += chain.d[i];
        joints[i] = origin;
    }
    Kinematics { com, joints, end_effector: Vector3::new(origin.x, origin.y, chain.angle[B - 1]) }
}

fn tip<const B: usize>(model: &Model, q: &Coordinates) -> Vector3<f64> {
    let chain = Chain::<B>::at(model, q);
    let arm: Vector2<f64> = chain.d.iter().sum();
    Vector3::new(q[0] + arm.x, q[1] + arm.y, chain.angle[B - 1])
}

fn center_of_mass<const B: usize>(model: &Model, q: &Coordinates) -> Vector2<f64> {
    let chain = Chain::<B>::at(model, q);
    let moment: Vector2<f64> = chain.s.iter().sum();
    Vector2::new(q[0], q[1]) + moment * model.lumps.per_mass
}

/// Columns are the quarter turns of the arms from each joint to the point.
fn jacobian<const B: usize>(model: &Model, q: &Coordinates, body: usize, point: &Vector2<f64>) -> Jacobian {
    let chain = Chain::<B>::at(model, q);
    let body = body.min(B - 1);
    let mut jacobian = Jacobian::zeros();
    jacobian[(0, 0)] = 1.0;
    jacobian[(1, 1)] = 1.0;
    let mut arm = Vector2::zeros();
    for i in (0..=body).rev() {
        arm += if i == body { chain.turned(i, point) } else { chain.d[i] };
        let column = perp(&arm);
        jacobian.set_column(2 + i, &Vector3::new(column.x, column.y, 1.0));
    }
    jacobian
}

fn jacobian_derivative<const B: usize>(model: &Model, state: &State, body: usize, point: &Vector2<f64>) -> Jacobian {
    let chain = Chain::<B>::at(model, &state.q);
    let rate = absolute::<B>(&state.v);
    let body = body.min(B - 1);
    let mut jacobian = Jacobian::zeros();
    let mut arm_rate = Vector2::zeros();
    for i in (0..=body).rev() {
        let segment = if i == body { chain.turned(i, point) } else { chain.d[i] };
        arm_rate += rate[i] * perp(&segment);
        let column = perp(&arm_rate);
        jacobian.set_column(2 + i, &Vector3::new(column.x, column.y, 0.0));
    }
    jacobian
}
