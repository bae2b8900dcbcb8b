//! How the service is made.

use crate::{LinksConfig, LinksService};
use fss_plant::Plant;
use fss_service::{Program, Refusal, Site};
use fss_wire::link::Key;
use serde::Deserialize;

/// What the service is told besides the plant file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The key that signs commands, bytes.
    pub key: Vec<u8>,
    /// Commands are numbered from here on, above all numbers that the links have seen.
    pub first_sequence: u64,
}

impl Program for LinksService {
    type Config = Config;

    fn new(config: Config, site: &Site) -> Result<Self, Refusal> {
        let plant = Plant::parse(&site.plant_text)?;
        Ok(Self::new(LinksConfig::new(&plant), Key::new(&config.key)?, config.first_sequence))
    }
}
