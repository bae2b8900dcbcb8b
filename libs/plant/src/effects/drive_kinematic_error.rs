//! `drive_kinematic_error`
//!
//! Link angle = motor angle + amplitude sin(cycles * link angle); the encoder sits on the motor.

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::{Prior, Response};

pub(super) struct DriveKinematicError;

const ABOUT: About = About {
    id: "drive_kinematic_error",
    sentence: "A drive's ratio ripples: the link leads and lags its motor with the angle.",
    place: Place::Joint,
    index: Index::Joint,
    parameters: &[
        Parameter::new("amplitude_rad", "rad", "largest lead").within(-0.5, 0.5).scale(0.002),
        Parameter::new("cycles_per_rev", "", "periods in one turn of the joint")
            .nominal(2.0)
            .within(0.0, 1000.0)
            .scale(1.0),
    ],
};

impl EffectKind for DriveKinematicError {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        // Precision gears are specified to an arc minute.
        Prior::sized(&[2e-3], &[3e-4]).responding(Response::Shape(&[1.0, 2.0, 3.0, 4.0, 6.0, 8.0]))
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            let [amplitude, cycles, ..] = effect.padded();
            physics.joints[i].kinematic_error_rad = amplitude;
            physics.joints[i].kinematic_cycles = cycles;
        }
    }
}
