//! How the service is made.

use crate::{Calibration, MovementBand};
use fss_plant::Plant;
use fss_service::{NoConfig, Program, Refusal, Site};

impl Program for Calibration {
    type Config = NoConfig;

    fn new(_config: NoConfig, site: &Site) -> Result<Self, Refusal> {
        let plant = Plant::parse(&site.plant_text)?;
        Ok(Self::new(plant.link_count(), MovementBand::of(&plant)))
    }
}
