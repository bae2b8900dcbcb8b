//! How the service is made.

use crate::Thrusters;
use fss_service::{NoConfig, Program, Refusal, Site};
use serde::Deserialize;
use serde::de::IgnoredAny;

/// What the service needs of the plant file: how many thrusters there are.
#[derive(Deserialize)]
struct Plant {
    #[serde(default)]
    thruster: Vec<IgnoredAny>,
}

impl Program for Thrusters {
    type Config = NoConfig;

    fn new(_config: NoConfig, site: &Site) -> Result<Self, Refusal> {
        Ok(Self::new(site.plant::<Plant>()?.thruster.len()))
    }
}
