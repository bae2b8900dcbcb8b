//! `clock_offset`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct ClockOffset;

const ABOUT: About = About {
    id: "clock_offset",
    sentence: "A data stream is stamped by a clock that is wrong by a constant.",
    place: Place::Time,
    index: Index::Channel,
    parameters: &[Parameter::new("offset_s", "s", "stamp less true time").within(-5.0, 5.0).scale(0.02)],
};

impl EffectKind for ClockOffset {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.02], &[1e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for stream in super::streams(effect.channel()) {
            physics.sensors.clock_offset_s[*stream as usize] += effect.first();
        }
    }
}
