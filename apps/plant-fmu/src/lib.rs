//! A plant as an FMU for co-simulation, FMI 2.0 and 3.0: valves and joint commands in, poses, rates and currents out.
//!
//! [`variables`] says what the FMU has, [`description::xml`] writes its `modelDescription.xml`; the shared library finds the plant
//! file in the FMU's resources (`fmi2`, `fmi3`). Inside is the simulation that the laboratory flies, in steps of 1 ms: the
//! same commands at the same times give the same motion to the last bit. Disturbances are drawn from the parameter `seed`.

mod abi;
pub mod description;
mod fmi2;
mod fmi3;
mod instance;
pub mod variables;

pub use instance::Instance;
