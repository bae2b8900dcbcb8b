//! What the rows change by where servos make another motion of the datagrams than the nominal plant's would: with other gains,
//! other masses.

use super::noise::NoiseModel;
use super::path::{MeasuredPath, Reference};
use super::rows::Row;
use crate::servo_response::{self, GainSlope, Nodes, datagrams};
use fss_experiments::commands::Commands;
use fss_experiments::measured::Run;
use fss_plant::Plant;

/// The servos of a run.
pub(super) struct Servos {
    /// What they were told; `None` without datagrams.
    pub(super) commands: Option<Commands>,
}

impl Servos {
    pub(super) fn new(plant: &Plant, run: &Run) -> Self {
        Self { commands: datagrams(plant, run).cloned() }
    }

    /// What a plant's servos make of the datagrams; `None` without datagrams, or where the plant is no mechanism.
    pub(super) fn reference(&self, plant: &Plant, path: &MeasuredPath) -> Option<Reference> {
        let commands = self.commands.as_ref()?;
        let grid_s: Vec<f64> = path.grid_s().collect();
        Some(path.reference_of(servo_response::response(plant, commands, &grid_s).ok()?))
    }
}

/// What the rows change by with each gain of each joint's servo.
pub(super) fn gain_slopes(
    changes: &[Vec<Nodes>],
    path: &MeasuredPath,
    rows: &[Row],
    model: &NoiseModel,
) -> Vec<GainSlope> {
    let of = |gain: usize, joint: usize| {
        let unseen = path.unseen(joint, &changes[gain][joint]);
        let motion = |j: usize, stamp_s: f64| if j == joint { unseen.at(stamp_s) } else { [0.0; 3] };
        GainSlope { gain, joint, of_row: model.read_motion(rows, motion) }
    };
    (0..changes.len()).flat_map(|gain| (0..model.links).map(move |joint| of(gain, joint))).collect()
}
