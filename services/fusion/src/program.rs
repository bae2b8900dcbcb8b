//! How the service is made.

use crate::{Fusion, FusionConfig};
use fss_plant::Plant;
use fss_service::{NoConfig, Program, Refusal, Site};

impl Program for Fusion {
    type Config = NoConfig;

    fn new(_config: NoConfig, site: &Site) -> Result<Self, Refusal> {
        Ok(Self::new(FusionConfig::from_plant(&Plant::parse(&site.plant_text)?)))
    }
}
