//! One laboratory as data and as physics: the plant file, the effects that a plant can have, the
//! actuators, the sensors, and the simulation that they drive.
//!
//! - [`Plant`] is the file: nominal values, read strictly, written back.
//! - [`Effect`] is what a plant has beyond them; [`effects::catalogue`] lists every kind.
//! - [`Physics`] is what really acts: the values with the effects built in.
//! - [`Simulation`] lets it move: commands in, time forward, [`Truth`] out.
//! - [`Rollout`] is the base alone, fast, under recorded joints and thrusters, for identification.
//! - [`Instruments`] are the sensors: what they say about the truth.
//! - [`scene::Scene`] and [`urdf`] are what viewers draw: shapes from above, and a robot description.
//!
//! ```
//! use fss_plant::{Effect, JointCommand, Plant, Simulation};
//!
//! let weak = Effect::new("thruster_gain")?.at(3).with(&[0.72]);
//! let plant = Plant::default_laboratory()?.with_effects(&[weak]);
//! let mut simulation = Simulation::new(&plant, 1)?;
//! simulation.set_joint(0, JointCommand::Position { q_rad: 0.5, qd_rad_s: 0.0 });
//! simulation.set_valve(2, true, 0.0);
//! simulation.step(2.0);
//! println!("the base turned by {:.3} rad", simulation.truth().base_pose[2]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod about;
mod acting;
mod advance;
mod check;
mod contact;
mod docs;
mod draw;
mod dynamics;
mod effect;
mod effect_file;
pub mod effects;
mod error;
mod file;
mod friction;
mod instruments;
mod kind;
mod parts;
mod physics;
mod power;
mod prior;
mod reader;
mod rollout;
mod room;
pub mod scene;
mod servo;
mod simulation;
mod target;
mod thrust;
mod thruster;
mod truth;
pub mod urdf;
mod valves;

pub use check::MAX_LINKS;
pub use contact::GraspError;
pub use docs::effects_table_markdown;
pub use effect::{Effect, EffectError};
pub use error::PlantError;
pub use file::Plant;
pub use friction::Friction;
pub use instruments::{Instruments, LinkSample};
pub use kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
pub use parts::{Base, Battery, Disturbance, Link, SecondProcess, Sensors, Servo, Table, Tank, Target, Uncertainty};
pub use physics::{
    BaseLaw, BaseMotion, BasePhysics, Grasped, JointLaw, JointPhysics, LinkPhysics, Physics, SensorPhysics, Stream,
    SupplyPhysics, ThrusterPhysics,
};
pub use prior::{Prior, Response, SLAB_WIDTHS};
pub use reader::DEFAULT_PLANT;
pub use rollout::{BaseSample, Grid, JointSample, Pulse, Rollout, ValveHistory};
pub use servo::JointCommand;
pub use simulation::{INTERNAL_STEP_S, Simulation};
pub use thruster::{Thruster, Valves};
pub use truth::Truth;
