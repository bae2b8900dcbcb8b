//! How the service is made.

use crate::{Mission, MissionConfig, MissionService};
use fss_messages::MissionState;
use fss_plant::Plant;
use fss_service::{Program, Refusal, Site};
use serde::Deserialize;
use zerocopy::FromBytes;

/// What the service is told besides the plant file and the mission file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The sample that the process before this one published last: the mission goes on from there.
    #[serde(default)]
    pub resume: Option<Vec<u8>>,
}

impl Program for MissionService {
    type Config = Config;

    fn new(config: Config, site: &Site) -> Result<Self, Refusal> {
        let plant = Plant::parse(&site.plant_text)?;
        let mission = Mission::parse_for(&site.mission_text, &plant)?;
        let for_plant = MissionConfig::for_plant(&plant);
        let Some(last) = config.resume else { return Ok(Self::new(mission, for_plant)) };
        let last = MissionState::read_from_bytes(&last)
            .map_err(|_| format!("resume: not the {} bytes of a mission's state", size_of::<MissionState>()))?;
        Ok(Self::resumed(mission, for_plant, last))
    }
}
