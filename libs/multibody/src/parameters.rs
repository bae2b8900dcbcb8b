//! The mechanism's numbers by name: for calibration and what-if.

use nalgebra::{Vector2, Vector3};

use crate::chain::{Chain, perp};
use crate::{Coordinates, MAX_BODIES, MAX_LINKS, Model, ModelError};

/// One number of a [`Model`], in the units of its field. Links count from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Parameter {
    /// [`crate::Base::mass_kg`].
    BaseMass,
    /// [`crate::Base::inertia_kg_m2`].
    BaseInertia,
    /// x of [`crate::Base::com_m`].
    BaseComX,
    /// y of [`crate::Base::com_m`].
    BaseComY,
    /// x of [`crate::Base::joint1_xy_m`].
    Joint1X,
    /// y of [`crate::Base::joint1_xy_m`].
    Joint1Y,
    /// [`crate::Base::joint1_angle_rad`]; the same to every observer as the offset of joint 1.
    Joint1Angle,
    /// x of gravity, table axes.
    GravityX,
    /// y of gravity, table axes.
    GravityY,
    /// [`crate::Link::length_m`], with `com_to_next_joint_m` held: the centre of mass moves with the next joint.
    LinkLength(usize),
    /// [`crate::Link::com_to_next_joint_m`].
    ComToNextJoint(usize),
    /// [`crate::Link::com_offset_m`].
    ComOffset(usize),
    /// [`crate::Link::mass_kg`].
    LinkMass(usize),
    /// [`crate::Link::inertia_kg_m2`].
    LinkInertia(usize),
    /// [`crate::Link::joint_offset_rad`].
    JointOffset(usize),
    /// [`crate::Link::rotor_inertia_kg_m2`].
    RotorInertia(usize),
}

impl Parameter {
    /// Those of base and gravity.
    pub const OF_THE_BASE: [Self; 9] = [
        Self::BaseMass,
        Self::BaseInertia,
        Self::BaseComX,
        Self::BaseComY,
        Self::Joint1X,
        Self::Joint1Y,
        Self::Joint1Angle,
        Self::GravityX,
        Self::GravityY,
    ];

    /// Those of link `number`, counted from 1.
    pub const fn of_link(number: usize) -> [Self; 7] {
        [
            Self::LinkLength(number),
            Self::ComToNextJoint(number),
            Self::ComOffset(number),
            Self::LinkMass(number),
            Self::LinkInertia(number),
            Self::JointOffset(number),
            Self::RotorInertia(number),
        ]
    }

    /// The link that the parameter belongs to, counted from 1; none for base and gravity.
    pub const fn link(self) -> Option<usize> {
        match self {
            Self::LinkLength(number)
            | Self::ComToNextJoint(number)
            | Self::ComOffset(number)
            | Self::LinkMass(number)
            | Self::LinkInertia(number)
            | Self::JointOffset(number)
            | Self::RotorInertia(number) => Some(number),
            _ => None,
        }
    }
}

impl Model {
    /// All parameters of this model: base, gravity, then link by link.
    pub fn parameters(&self) -> impl Iterator<Item = Parameter> + use<> {
        Parameter::OF_THE_BASE.into_iter().chain((1..=self.link_count()).flat_map(Parameter::of_link))
    }

    /// Value of a parameter; none where the model has no such link.
    pub fn parameter(&self, parameter: Parameter) -> Option<f64> {
        let mut copy = *self;
        copy.slot(parameter).map(|slot| *slot)
    }

    /// The model with one parameter replaced.
    ///
    /// # Errors
    /// [`ModelError`] where the value makes no mechanism, or the model has no such link.
    pub fn with_parameter(&self, parameter: Parameter, value: f64) -> Result<Self, ModelError> {
        self.with_parameters([(parameter, value)])
    }

    /// The model with several parameters replaced at once.
    ///
    /// # Errors
    /// [`ModelError`] where the values make no mechanism, or the model has no such link.
    pub fn with_parameters(&self, values: impl IntoIterator<Item = (Parameter, f64)>) -> Result<Self, ModelError> {
        let mut changed = *self;
        for (parameter, value) in values {
            let number = parameter.link().unwrap_or_default();
            *changed.slot(parameter).ok_or(ModelError::NoSuchLink { number, links: self.link_count() })? = value;
        }
        changed.checked()
    }

    /// Derivative of the end-effector's pose `[x, y, angle]` with respect to a parameter, m and rad per its unit: the
    /// columns of kinematic calibration. Zero for what is no matter of geometry.
    pub fn end_effector_by_parameter(&self, q: &Coordinates, parameter: Parameter) -> Vector3<f64> {
        if parameter.link().is_some_and(|number| number > self.link_count()) {
            return Vector3::zeros();
        }
        let chain = Chain::<MAX_BODIES>::at(self, q);
        let along = |body: usize, x: f64, y: f64| {
            let moved = chain.turned(body, &Vector2::new(x, y));
            Vector3::new(moved.x, moved.y, 0.0)
        };
        let turn = |body: usize| {
            let arm: Vector2<f64> = chain.d[body..].iter().sum();
            let moved = perp(&arm);
            Vector3::new(moved.x, moved.y, 1.0)
        };
        match parameter {
            Parameter::Joint1X => along(0, 1.0, 0.0),
            Parameter::Joint1Y => along(0, 0.0, 1.0),
            Parameter::Joint1Angle if self.link_count() > 0 => turn(1),
            Parameter::LinkLength(number) => along(number, 1.0, 0.0),
            Parameter::JointOffset(number) => turn(number),
            _ => Vector3::zeros(),
        }
    }

    fn slot(&mut self, parameter: Parameter) -> Option<&mut f64> {
        let count = self.link_count;
        if let Some(number) = parameter.link() {
            if number == 0 || number > count || number > MAX_LINKS {
                return None;
            }
            let link = &mut self.links[number - 1];
            return Some(match parameter {
                Parameter::LinkLength(_) => &mut link.length_m,
                Parameter::ComToNextJoint(_) => &mut link.com_to_next_joint_m,
                Parameter::ComOffset(_) => &mut link.com_offset_m,
                Parameter::LinkMass(_) => &mut link.mass_kg,
                Parameter::LinkInertia(_) => &mut link.inertia_kg_m2,
                Parameter::JointOffset(_) => &mut link.joint_offset_rad,
                _ => &mut link.rotor_inertia_kg_m2,
            });
        }
        let base = &mut self.base;
        Some(match parameter {
            Parameter::BaseMass => &mut base.mass_kg,
            Parameter::BaseInertia => &mut base.inertia_kg_m2,
            Parameter::BaseComX => &mut base.com_m[0],
            Parameter::BaseComY => &mut base.com_m[1],
            Parameter::Joint1X => &mut base.joint1_xy_m[0],
            Parameter::Joint1Y => &mut base.joint1_xy_m[1],
            Parameter::Joint1Angle => &mut base.joint1_angle_rad,
            Parameter::GravityX => &mut self.gravity_m_s2[0],
            _ => &mut self.gravity_m_s2[1],
        })
    }

    fn checked(&self) -> Result<Self, ModelError> {
        Self::new(self.base, self.links(), self.gravity_m_s2)
    }
}
