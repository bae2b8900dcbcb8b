//! What servos make of the datagrams that command them, and how that depends on their gains.
//!
//! Between two datagrams a servo settles within some hundredths of a second. Telemetry shows the torque of one instant of that,
//! so that the motion is taken from a simulation of the servo, and its gains are values of the plant that are known only so well.

use fss_estimation::statistics::median;
use fss_experiments::commands::Commands;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Place, Plant, Servo};

/// Angle, rate and acceleration at each node of a path.
pub(crate) type Nodes = Vec<[f64; 3]>;

/// The gains that are not known exactly: of the position loop, of the velocity loop, of its integral.
const GAINS: [fn(&mut Plant, usize) -> &mut f64; 3] = [
    |p, i| &mut own_servo(p, i).position_gain_1_s,
    |p, i| &mut own_servo(p, i).velocity_gain_n_m_s_rad,
    |p, i| &mut own_servo(p, i).velocity_integral_n_m_rad,
];
/// Those of one servo.
pub(crate) type Gains = [f64; GAINS.len()];

/// Step of a gain in differences, as a share of it.
const STEP: f64 = 0.1;

/// Standard deviation of the time that a datagram takes to its link, s: anything from 2 to 8 ms over a radio.
pub(crate) const ARRIVAL_SD_S: f64 = 1.7e-3;

/// The joints' motion in answer to datagrams.
#[derive(Clone, Debug)]
pub(crate) struct Response {
    /// Each joint with the plant's gains.
    pub(crate) nominal: Vec<Nodes>,
    /// For each of [`GAINS`], what each joint's motion changes by where it is larger by the share [`STEP`]. A joint is taken to depend
    /// on its own gains.
    pub(crate) by_gain: Vec<Vec<Nodes>>,
}

/// The answer of a plant's servos at the times `grid_s`, s.
///
/// # Errors
/// When the plant's masses are impossible.
pub(crate) fn response(plant: &Plant, commands: &Commands, grid_s: &[f64]) -> Result<Response, ModelError> {
    let nominal = played(plant, commands, grid_s)?;
    let by_gain = GAINS.iter().map(|gain| {
        let mut other = plant.clone();
        (0..plant.link_count()).for_each(|joint| *gain(&mut other, joint) *= 1.0 + STEP);
        let other = played(&other, commands, grid_s)?;
        let change = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|i| b[i] - a[i]);
        Ok(nominal.iter().zip(&other).map(|(a, b)| a.iter().zip(b).map(change).collect()).collect())
    });
    let by_gain = by_gain.collect::<Result<_, ModelError>>()?;
    Ok(Response { nominal, by_gain })
}

/// The servo of one joint, apart from what others share.
pub(crate) fn own_servo(plant: &mut Plant, joint: usize) -> &mut Servo {
    let shared = plant.servo.clone();
    plant.links[joint].servo.get_or_insert(shared)
}

/// What datagrams told each joint, and when they arrived; `None` where the run has none, or none that change anything.
pub(crate) fn datagrams<'a>(plant: &Plant, run: &'a Run) -> Option<&'a Commands> {
    run.commands.as_ref().filter(|c| c.joints.len() == plant.link_count() && c.joints.iter().any(|j| j.len() > 1))
}

/// Correlation time of how late datagrams arrive, s: half of the interval at which another one comes.
pub(crate) fn arrival_time(commands: &Commands) -> f64 {
    let most = commands.joints.iter().max_by_key(|joint| joint.len());
    let mut intervals: Vec<f64> = most.map_or(&[][..], |joint| joint).windows(2).map(|w| w[1].0 - w[0].0).collect();
    0.5 * median(&mut intervals).unwrap_or(1.0)
}

/// What rows change by where a gain of a joint's servo is larger by the share [`STEP`].
pub(crate) struct GainSlope {
    pub(crate) gain: usize,
    pub(crate) joint: usize,
    pub(crate) of_row: Vec<f64>,
}

/// The gains of each joint's servo.
pub(crate) fn gains(plant: &Plant) -> Vec<Gains> {
    let mut plant = plant.clone();
    let joints = plant.link_count();
    (0..joints).map(|joint| GAINS.map(|gain| *gain(&mut plant, joint))).collect()
}

/// Adds what the gains of a plant change over the `nominal` ones.
pub(crate) fn tune(plant: &Plant, nominal: &[Gains], by_gain: &[GainSlope], rows: &mut [f64]) {
    let own = gains(plant);
    for slope in by_gain {
        let (now, nominal) = (own[slope.joint][slope.gain], nominal[slope.joint][slope.gain]);
        if now != nominal && nominal != 0.0 {
            let steps = (now / nominal - 1.0) / STEP;
            rows.iter_mut().zip(&slope.of_row).for_each(|(v, s)| *v += steps * s);
        }
    }
}

/// What among effects changes what servos make of their datagrams.
pub(crate) fn moving(effects: &[Effect]) -> Vec<Effect> {
    effects.iter().filter(|e| matches!(e.about().place, Place::Mass | Place::Joint)).cloned().collect()
}

/// Whether the servos of a plant with these effects answer as those of another plant with its own.
pub(crate) fn answer_alike(plant: &Plant, effects: &[Effect], other: &Plant) -> bool {
    with_exactly(plant, &other.effects) == *other && moving(effects) == moving(&other.effects)
}

/// A plant with exactly these effects.
pub(crate) fn with_exactly(plant: &Plant, effects: &[Effect]) -> Plant {
    Plant { effects: effects.to_vec(), ..plant.clone() }
}

/// Each joint's motion with the plant's gains, at the times `grid_s`, s.
///
/// # Errors
/// When the plant's masses are impossible.
fn played(plant: &Plant, commands: &Commands, grid_s: &[f64]) -> Result<Vec<Nodes>, ModelError> {
    let still = Plant { disturbance: None, ..plant.clone() };
    let mut times = Vec::new();
    let mut states = vec![Vec::new(); plant.link_count()];
    commands.play(&still, 0, 1, |simulation| {
        times.push(simulation.t_s());
        for (i, states) in states.iter_mut().enumerate() {
            states.push([simulation.encoder_rad(i), simulation.encoder_rate_rad_s(i)]);
        }
    })?;
    Ok(states.iter().map(|states| grid_s.iter().map(|t| node(&times, states, *t)).collect()).collect())
}

/// Angle, rate and acceleration at `t_s`, of a motion with constant acceleration between its samples.
fn node(t_s: &[f64], states: &[[f64; 2]], at_s: f64) -> [f64; 3] {
    let after = t_s.partition_point(|t| *t <= at_s);
    if after == 0 || after == t_s.len() {
        let end = if after == 0 { 0 } else { after - 1 };
        let [q, qd] = states.get(end).copied().unwrap_or_default();
        return [q + qd * (at_s - t_s.get(end).copied().unwrap_or(at_s)), qd, 0.0];
    }
    let (a, b) = (states[after - 1], states[after]);
    let (step_s, past_s) = (t_s[after] - t_s[after - 1], at_s - t_s[after - 1]);
    let acceleration = (b[1] - a[1]) / step_s;
    [a[0] + past_s * (b[0] - a[0]) / step_s, a[1] + past_s * acceleration, acceleration]
}
