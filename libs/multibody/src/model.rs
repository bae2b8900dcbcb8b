//! The mechanism: what a plant file says of it, checked and lumped once.

use nalgebra::Vector2;

use crate::{MAX_BODIES, MAX_DOF, MAX_LINKS};

/// The base: a rigid body in the plane that carries joint 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Base {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia about the base's own centre of mass, kg m^2.
    pub inertia_kg_m2: f64,
    /// Centre of mass in the base frame, m; zero where the frame's origin is where it should be.
    pub com_m: [f64; 2],
    /// Joint 1 in the base frame, m.
    pub joint1_xy_m: [f64; 2],
    /// Angle of link 1 to the base frame at `q_1 + joint_offset = 0`, rad.
    pub joint1_angle_rad: f64,
    /// Held by the world: its acceleration is zero whatever acts on it.
    pub clamped: bool,
}

impl Default for Base {
    fn default() -> Self {
        Self {
            mass_kg: 1.0,
            inertia_kg_m2: 1.0,
            com_m: [0.0; 2],
            joint1_xy_m: [0.0; 2],
            joint1_angle_rad: 0.0,
            clamped: false,
        }
    }
}

/// One link with the revolute joint at its root.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Joint to next joint (last link: to the end-effector), m.
    pub length_m: f64,
    /// Centre of mass to next joint along the link, m.
    pub com_to_next_joint_m: f64,
    /// Centre of mass beside the line from joint to joint, positive to the left of it, m.
    pub com_offset_m: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia about the link's centre of mass, kg m^2.
    pub inertia_kg_m2: f64,
    /// Geometric angle = encoder angle + offset, rad.
    pub joint_offset_rad: f64,
    /// Inertia of the joint's motor and gear seen at the joint (gear ratio squared times the rotor's), kg m^2. It
    /// resists the joint's acceleration only (Featherstone 2008, section 9.6, without the gyroscopic terms).
    pub rotor_inertia_kg_m2: f64,
}

impl Default for Link {
    fn default() -> Self {
        Self {
            length_m: 1.0,
            com_to_next_joint_m: 0.5,
            com_offset_m: 0.0,
            mass_kg: 1.0,
            inertia_kg_m2: 1.0 / 12.0,
            joint_offset_rad: 0.0,
            rotor_inertia_kg_m2: 0.0,
        }
    }
}

impl Link {
    const ABSENT: Self = Self {
        length_m: 0.0,
        com_to_next_joint_m: 0.0,
        com_offset_m: 0.0,
        mass_kg: 0.0,
        inertia_kg_m2: 0.0,
        joint_offset_rad: 0.0,
        rotor_inertia_kg_m2: 0.0,
    };
}

/// Why a mechanism is refused. Links count from 1.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// More links than the fixed capacity.
    #[error("{0} links, but at most {MAX_LINKS} are possible")]
    TooManyLinks(usize),
    /// A parameter names a link that is not there.
    #[error("there is no link {number}: the arm has {links}")]
    NoSuchLink {
        /// The link asked for, counted from 1.
        number: usize,
        /// Number of links.
        links: usize,
    },
    /// A clamped base without an arm has nothing that can move.
    #[error("a clamped base without links has nothing that can move")]
    NothingMoves,
    /// Infinite or not a number.
    #[error("{body}: {quantity} is not a finite number")]
    NotFinite {
        /// Whose value it is.
        body: Body,
        /// Field name of the value.
        quantity: &'static str,
    },
    /// A mass or an inertia below zero.
    #[error("{body}: {quantity} is {value}, but cannot be negative")]
    Negative {
        /// Whose value it is.
        body: Body,
        /// Field name of the value.
        quantity: &'static str,
        /// The value refused.
        value: f64,
    },
    /// A mass or an inertia of zero where the equations of motion need one.
    #[error("{body}: {quantity} is zero, so nothing resists its acceleration")]
    NoInertia {
        /// Whose value it is.
        body: Body,
        /// Field name of the value.
        quantity: &'static str,
    },
}

/// Names a part of the mechanism in a [`ModelError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Body {
    /// The base.
    Base,
    /// A link, counted from 1.
    Link(usize),
    /// The world: gravity.
    World,
}

impl std::fmt::Display for Body {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Base => write!(f, "base"),
            Self::Link(number) => write!(f, "link {number}"),
            Self::World => write!(f, "world"),
        }
    }
}

/// The mechanism, checked, with its masses lumped (crate documentation). Plain data: copying it is cheap enough for a
/// simulation that varies it, and no method allocates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    pub(crate) base: Base,
    pub(crate) links: [Link; MAX_LINKS],
    pub(crate) link_count: usize,
    pub(crate) gravity_m_s2: [f64; 2],
    pub(crate) lumps: Lumps,
}

/// Constants of the equations of motion, one entry per body, zero beyond the last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lumps {
    /// Mass of everything, kg.
    pub(crate) total_mass: f64,
    /// `1 / total_mass`, zero for a massless whole (a clamped base may weigh nothing).
    pub(crate) per_mass: f64,
    /// Mass of the bodies beyond body `i`, kg.
    pub(crate) carried: [f64; MAX_BODIES],
    /// `d_i`, body frame: joint `i` (base: origin) to joint `i + 1`.
    pub(crate) d: [Vector2<f64>; MAX_BODIES],
    /// `c_i`, body frame: joint `i` (base: origin) to centre of mass.
    pub(crate) c: [Vector2<f64>; MAX_BODIES],
    /// `s_i`, body frame: first moment of body `i` and what it carries.
    pub(crate) s: [Vector2<f64>; MAX_BODIES],
    /// `J_i`: second moment of the same, without rotors.
    pub(crate) j: [f64; MAX_BODIES],
    /// What is added to `phi_{i-1} + q_i` to give `phi_i`.
    pub(crate) angle: [f64; MAX_BODIES],
    /// Mass, inertia about the own centre of mass and reflected rotor inertia of the joint at the root.
    pub(crate) mass: [f64; MAX_BODIES],
    pub(crate) inertia: [f64; MAX_BODIES],
    pub(crate) rotor: [f64; MAX_BODIES],
}

impl Model {
    /// Checks and lumps a mechanism: `links` from the base outwards, `gravity_m_s2` the acceleration that a free body
    /// would have, in table axes.
    ///
    /// # Errors
    /// [`ModelError`] names the body and the value at fault.
    pub fn new(base: Base, links: &[Link], gravity_m_s2: [f64; 2]) -> Result<Self, ModelError> {
        if links.len() > MAX_LINKS {
            return Err(ModelError::TooManyLinks(links.len()));
        }
        if base.clamped && links.is_empty() {
            return Err(ModelError::NothingMoves);
        }
        check_base(&base)?;
        for (i, link) in links.iter().enumerate() {
            check_link(link, Body::Link(i + 1))?;
        }
        finite(Body::World, "gravity_m_s2", gravity_m_s2[0])?;
        finite(Body::World, "gravity_m_s2", gravity_m_s2[1])?;
        let mut all = [Link::ABSENT; MAX_LINKS];
        all[..links.len()].copy_from_slice(links);
        let lumps = Lumps::new(&base, &all, links.len());
        Ok(Self { base, links: all, link_count: links.len(), gravity_m_s2, lumps })
    }

    /// The base as given.
    pub fn base(&self) -> &Base {
        &self.base
    }

    /// The links as given, from the base outwards.
    pub fn links(&self) -> &[Link] {
        &self.links[..self.link_count]
    }

    /// Number of links, `n`.
    pub fn link_count(&self) -> usize {
        self.link_count
    }

    /// Degrees of freedom, `n + 3` (for a clamped base too: its first three stay still).
    pub fn dof(&self) -> usize {
        self.link_count + MAX_DOF - MAX_LINKS
    }

    /// Acceleration of a free body in table axes, m/s^2.
    pub fn gravity_m_s2(&self) -> [f64; 2] {
        self.gravity_m_s2
    }

    /// The same mechanism under another gravity.
    ///
    /// # Errors
    /// [`ModelError::NotFinite`].
    pub fn with_gravity(&self, gravity_m_s2: [f64; 2]) -> Result<Self, ModelError> {
        Self::new(self.base, self.links(), gravity_m_s2)
    }

    /// Mass of everything, kg.
    pub fn total_mass_kg(&self) -> f64 {
        self.lumps.total_mass
    }
}

impl Lumps {
    fn new(base: &Base, links: &[Link; MAX_LINKS], count: usize) -> Self {
        let mut lumps = Self {
            total_mass: 0.0,
            per_mass: 0.0,
            carried: [0.0; MAX_BODIES],
            d: [Vector2::zeros(); MAX_BODIES],
            c: [Vector2::zeros(); MAX_BODIES],
            s: [Vector2::zeros(); MAX_BODIES],
            j: [0.0; MAX_BODIES],
            angle: [0.0; MAX_BODIES],
            mass: [0.0; MAX_BODIES],
            inertia: [0.0; MAX_BODIES],
            rotor: [0.0; MAX_BODIES],
        };
        lumps.mass[0] = base.mass_kg;
        lumps.inertia[0] = base.inertia_kg_m2;
        lumps.d[0] = base.joint1_xy_m.into();
        lumps.c[0] = base.com_m.into();
        for (i, link) in (1..).zip(&links[..count]) {
            lumps.mass[i] = link.mass_kg;
            lumps.inertia[i] = link.inertia_kg_m2;
            lumps.rotor[i] = link.rotor_inertia_kg_m2;
            lumps.d[i] = Vector2::new(link.length_m, 0.0);
            lumps.c[i] = Vector2::new(link.length_m - link.com_to_next_joint_m, link.com_offset_m);
            lumps.angle[i] = link.joint_offset_rad;
        }
        if count > 0 {
            lumps.angle[1] += base.joint1_angle_rad;
        }
        for i in (0..=count).rev() {
            lumps.carried[i] = lumps.total_mass;
            lumps.total_mass += lumps.mass[i];
            let (mass, carried) = (lumps.mass[i], lumps.carried[i]);
            lumps.s[i] = mass * lumps.c[i] + carried * lumps.d[i];
            lumps.j[i] = lumps.inertia[i] + mass * lumps.c[i].norm_squared() + carried * lumps.d[i].norm_squared();
        }
        if lumps.total_mass > 0.0 {
            lumps.per_mass = 1.0 / lumps.total_mass;
        }
        lumps
    }
}

fn finite(body: Body, quantity: &'static str, value: f64) -> Result<(), ModelError> {
    if value.is_finite() { Ok(()) } else { Err(ModelError::NotFinite { body, quantity }) }
}

fn not_negative(body: Body, quantity: &'static str, value: f64) -> Result<(), ModelError> {
    finite(body, quantity, value)?;
    if value < 0.0 { Err(ModelError::Negative { body, quantity, value }) } else { Ok(()) }
}

fn check_base(base: &Base) -> Result<(), ModelError> {
    for (quantity, value) in [
        ("com_m", base.com_m[0]),
        ("com_m", base.com_m[1]),
        ("joint1_xy_m", base.joint1_xy_m[0]),
        ("joint1_xy_m", base.joint1_xy_m[1]),
        ("joint1_angle_rad", base.joint1_angle_rad),
    ] {
        finite(Body::Base, quantity, value)?;
    }
    for (quantity, value) in [("mass_kg", base.mass_kg), ("inertia_kg_m2", base.inertia_kg_m2)] {
        not_negative(Body::Base, quantity, value)?;
        if value == 0.0 && !base.clamped {
            return Err(ModelError::NoInertia { body: Body::Base, quantity });
        }
    }
    Ok(())
}

fn check_link(link: &Link, body: Body) -> Result<(), ModelError> {
    for (quantity, value) in [
        ("length_m", link.length_m),
        ("com_to_next_joint_m", link.com_to_next_joint_m),
        ("com_offset_m", link.com_offset_m),
        ("joint_offset_rad", link.joint_offset_rad),
    ] {
        finite(body, quantity, value)?;
    }
    not_negative(body, "mass_kg", link.mass_kg)?;
    not_negative(body, "inertia_kg_m2", link.inertia_kg_m2)?;
    not_negative(body, "rotor_inertia_kg_m2", link.rotor_inertia_kg_m2)?;
    // Each link alone must resist its joint. By induction from the base outwards, no motion is then free of kinetic
    // energy, in any configuration: the generalized inertia is positive definite.
    let along = link.length_m - link.com_to_next_joint_m;
    let about_joint = link.inertia_kg_m2 + link.mass_kg * (along * along + link.com_offset_m * link.com_offset_m);
    if about_joint + link.rotor_inertia_kg_m2 > 0.0 {
        Ok(())
    } else {
        Err(ModelError::NoInertia { body, quantity: "inertia_kg_m2" })
    }
}
