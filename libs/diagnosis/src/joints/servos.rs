//! What the rows change by where servos make another motion of the datagrams than the nominal plant's would: with other gains, other
//! masses, at other times.

use super::noise::NoiseModel;
use super::path::{MeasuredPath, Reference};
use super::response::{self, GAINS};
use super::rows::Row;
use super::telemetry::median_interval;
use super::track::Track;
use fss_experiments::commands::Commands;
use fss_experiments::measured::Run;
use fss_plant::{Effect, Place, Plant, Servo};

/// Standard deviation of the time that a datagram takes to its link, s: anything from 2 to 8 ms over a radio.
const ARRIVAL_SD_S: f64 = 1.7e-3;

/// The servos of a run.
pub(super) struct Servos {
    /// What they were told; `None` without datagrams.
    commands: Option<Commands>,
    /// Gains with which the reference was computed.
    nominal: Vec<Servo>,
}

/// What the rows change by with the logarithm of a gain of a joint's servo.
pub(super) struct GainSlope {
    gain: usize,
    joint: usize,
    of_row: Vec<f64>,
}

impl Servos {
    pub(super) fn new(plant: &Plant, run: &Run) -> Self {
        let nominal = (0..plant.link_count()).map(|i| plant.servo(i).clone()).collect();
        Self { commands: datagrams(plant, run).cloned(), nominal }
    }

    /// Adds what the gains of a plant change.
    pub(super) fn tune(&self, plant: &Plant, by_gain: &[GainSlope], rows: &mut [f64]) {
        for slope in by_gain {
            let gain = |servo: &Servo| GAINS[slope.gain](&mut servo.clone()).max(f64::MIN_POSITIVE);
            let tuned = (gain(plant.servo(slope.joint)) / gain(&self.nominal[slope.joint])).ln();
            if tuned != 0.0 {
                rows.iter_mut().zip(&slope.of_row).for_each(|(v, s)| *v += tuned * s);
            }
        }
    }

    /// What servos of the nominal gains make of the datagrams on another plant; `None` without datagrams, or where the plant is
    /// no mechanism.
    pub(super) fn reference(&self, plant: &Plant, path: &MeasuredPath) -> Option<Reference> {
        let commands = self.commands.as_ref()?;
        let mut plant = plant.clone();
        for (link, servo) in plant.links.iter_mut().zip(&self.nominal) {
            link.servo = Some(servo.clone());
        }
        let grid_s: Vec<f64> = path.grid_s().collect();
        Some(path.reference_of(response::response(&plant, commands, &grid_s).ok()?))
    }
}

/// Whether an effect changes what servos make of their commands.
pub(super) fn moves(effect: &Effect) -> bool {
    matches!(effect.about().place, Place::Mass | Place::Joint)
}

/// What the rows change by with the logarithm of each gain of each joint's servo.
pub(super) fn gain_slopes(by_gain: &[Vec<Track>], rows: &[Row], model: &NoiseModel) -> Vec<GainSlope> {
    let of = |gain: usize, joint: usize| {
        let motion = |j: usize, stamp_s: f64| {
            if j == joint { by_gain[gain][joint].at(stamp_s) } else { [0.0; 3] }
        };
        GainSlope { gain, joint, of_row: model.read_motion(rows, motion) }
    };
    (0..by_gain.len()).flat_map(|gain| (0..model.links).map(move |joint| of(gain, joint))).collect()
}

/// What datagrams told each joint, and when they arrived; `None` where the run has none, or none that change anything.
pub(super) fn datagrams<'a>(plant: &Plant, run: &'a Run) -> Option<&'a Commands> {
    run.commands.as_ref().filter(|c| c.joints.len() == plant.link_count() && c.joints.iter().any(|j| j.len() > 1))
}

/// Correlation time of how late datagrams arrive, s: half of the interval at which another one comes.
pub(super) fn arrival_time(commands: &Commands) -> f64 {
    let most = commands.joints.iter().max_by_key(|joint| joint.len());
    let times: Vec<f64> = most.into_iter().flatten().map(|(t_s, _)| *t_s).collect();
    0.5 * median_interval(&times)
}

/// What a row changes by where the datagrams of a joint arrive a standard deviation later than they are taken to.
pub(super) fn uncertain_arrivals(reference: Option<&Reference>, rows: &[Row], model: &mut NoiseModel) {
    let Some(reference) = reference.filter(|_| model.arrival_s.is_some()) else { return };
    for joint in 0..model.links {
        let later = |j: usize, stamp_s: f64| {
            if j != joint {
                return [0.0; 3];
            }
            let (before, now) = (reference.joints[j].at(stamp_s - ARRIVAL_SD_S), reference.joints[j].at(stamp_s));
            std::array::from_fn(|i| before[i] - now[i])
        };
        for (slopes, by) in model.read_mixed(rows, later).into_iter().enumerate() {
            model.slopes[slopes].arrival.push(by);
        }
    }
}
