//! How the service is made.

use crate::{Base, BaseConfig};
use fss_plant::{Plant, Target};
use fss_service::{Program, Refusal, Site};
use serde::Deserialize;

/// What the service is told besides the plant file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The body that the mission brings onto the table, in place of the plant file's.
    #[serde(default)]
    pub target: Option<Target>,
}

impl Program for Base {
    type Config = Config;

    fn new(config: Config, site: &Site) -> Result<Self, Refusal> {
        let mut plant = Plant::parse(&site.plant_text)?;
        plant.target = config.target.or(plant.target);
        let model = plant.model()?;
        Ok(Self::new(BaseConfig::from_plant(&plant, model, site.rate_hz)))
    }
}
