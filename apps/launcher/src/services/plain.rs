//! Services without a device of their own.

use super::linked::{Flight, Linked};
use crate::stack::Stack;
use fss_arm::ArmService;
use fss_base::Base;
use fss_calibration::Calibration;
use fss_messages::topic;
use fss_mission::MissionService;
use fss_service::NoConfig;
use miette::{IntoDiagnostic, Result, WrapErr};
use zerocopy::IntoBytes;

pub(super) struct Sequencer;

impl Linked for Sequencer {
    type Service = MissionService;

    /// A process that was started again goes on from what the one before it had published last.
    fn config(&self, _stack: &Stack, flight: &Flight<'_>) -> Result<fss_mission::Config> {
        let resume = match flight {
            Flight::RealTime(seat) => {
                let last = seat.resume.as_deref().map(hex::decode).transpose();
                last.into_diagnostic().wrap_err("--resume")?
            }
            Flight::Virtual(_) => None,
            Flight::Replay(tape, life) => {
                let last = tape.topic(topic::MISSION_STATE)?.before(life[0].published_ns);
                last.map(|state| state.as_bytes().to_vec())
            }
        };
        Ok(fss_mission::Config { resume })
    }
}

pub(super) struct Arm;

impl Linked for Arm {
    type Service = ArmService;

    fn config(&self, stack: &Stack, _flight: &Flight<'_>) -> Result<fss_arm::Config> {
        Ok(fss_arm::Config { target: stack.plant.target.clone() })
    }
}

pub(super) struct BaseController;

impl Linked for BaseController {
    type Service = Base;

    fn config(&self, stack: &Stack, _flight: &Flight<'_>) -> Result<fss_base::Config> {
        Ok(fss_base::Config { target: stack.plant.target.clone() })
    }
}

pub(super) struct Postures;

impl Linked for Postures {
    type Service = Calibration;

    fn config(&self, _stack: &Stack, _flight: &Flight<'_>) -> Result<NoConfig> {
        Ok(NoConfig {})
    }
}
