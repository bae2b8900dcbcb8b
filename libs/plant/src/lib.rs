//! One laboratory as data and as physics: the plant file, the effects that a plant can have, the
//! actuators, the sensors, and the simulation that they drive.
//!
//! - [`Plant`] is the file: nominal values, read strictly, written back.
//! - [`Effect`] is what a plant has beyond them; [`effects::catalogue`] lists every kind.
//! - [`Physics`] is what really acts: the values with the effects built in.

mod check;
mod docs;
mod effect;
pub mod effects;
mod error;
mod file;
mod friction;
mod parts;
mod physics;

pub use check::MAX_LINKS;
pub use docs::effects_table_markdown;
pub use effect::{About, Effect, EffectError, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
pub use error::PlantError;
pub use file::{DEFAULT_PLANT, Plant};
pub use friction::Friction;
pub use parts::{
    Base, Battery, Disturbance, Link, Sensors, Servo, Table, Tank, Target, Thruster, Uncertainty,
    Valves,
};
pub use physics::{
    BaseLaw, BaseMotion, BasePhysics, JointLaw, JointPhysics, LinkPhysics, Physics, SensorPhysics,
    Stream, SupplyPhysics, ThrusterPhysics,
};
