//! The state-space model of what the joints' channels have in common beside the prediction.
//!
//! States: each joint's angle, rate and acceleration beside the reference; a torque of unit variance on each link and one in
//! each drive; three of unit variance that displace the end-effector; the time by which rates lag; and of joints that datagrams
//! command an acceleration of each at the instant of a row. The motion of an arm that follows commands is smooth
//! (acceleration of inferred strength); that of an arm whose torques are known all the time is anything, and its torques tell
//! what it is.

use super::hyper::Hyper;
use super::path::MeasuredPath;
use super::process::{by_accelerations, singer};
use super::rows::{Kind, Row, Slopes, moments};
use super::telemetry::{is_driven, median_interval};
use crate::servo_response::datagrams;
use fss_estimation::{Columns, Step, Whitener};
use fss_experiments::measured::Run;
use fss_plant::Plant;

/// Standard deviations at the first row, much more than anything: rad, rad/s.
const START_SD: [f64; 2] = [10.0, 30.0];
/// No error of a path's acceleration is as many times the path's own.
const ANY_SHARE: f64 = 10.0;
/// Half of the time over which a command's acceleration is averaged, s.
const ACTIVITY_S: f64 = 0.3;
/// Pauses so many times longer than other intervals say nothing of a swinging arm's motion.
const PAUSE: f64 = 2.5;
/// Where no sensor has noise: share of the torque scale that a free joint's bearing is known to leave, for numerics.
const LEAST_TORQUE: f64 = 1e-6;

/// The model of a run's rows, but for its hyper-parameters.
#[derive(Clone, Debug)]
pub(super) struct NoiseModel {
    pub(super) links: usize,
    pub(super) driven: bool,
    /// Which joints have a torque sensor, which a known motor torque.
    pub(super) sensed: Vec<bool>,
    pub(super) powered: Vec<bool>,
    pub(super) has_tip: bool,
    /// Length by which an error of the end-effector's place becomes one of its angle, m.
    pub(super) reach_m: f64,
    /// Rows in order of time and what each depends on.
    pub(super) slopes: Vec<Slopes>,
    /// Commanded acceleration of each joint before each moment, root mean square over some tenths of a second, rad/s2.
    pub(super) activity: Vec<Vec<f64>>,
    /// Standard deviation of a swinging arm's acceleration beside the path's before torques tell it, rad/s2.
    pub(super) any_acceleration: f64,
    /// Usual interval between telemetry rows, s.
    pub(super) interval_s: f64,
    /// Whether datagrams command the joints: after each, servos settle within some hundredths of a second, in which accelerations hang
    /// on gains and on when exactly it arrived. What they are when a row is read is not known but from the torques of that row; a joint
    /// that is told to rest has none.
    pub(super) is_told_by_datagrams: bool,
}

/// Places of the states.
pub(super) struct Places {
    link: Vec<Option<usize>>,
    drive: Vec<Option<usize>>,
    tip: Option<usize>,
    rate_lag: usize,
    eccentricity: usize,
    /// Inertias of rotors, where torques tell the motion.
    rotor: usize,
    /// Accelerations of the step before, where torques tell the motion.
    before: usize,
    /// Accelerations at the instant of a row, where datagrams command the joints.
    instant: usize,
    count: usize,
}

impl NoiseModel {
    /// The model but for the rows' slopes.
    pub(super) fn new(plant: &Plant, run: &Run, path: &MeasuredPath, rows: &[Row]) -> Self {
        let links = plant.link_count();
        let has = |wanted: &dyn Fn(Kind) -> bool| rows.iter().any(|r| wanted(r.kind));
        let times_s: Vec<f64> = moments(rows).iter().map(|m| rows[m.start].t_s).collect();
        let activity = times_s.iter().map(|t| (0..links).map(|i| path_activity(path, i, *t)).collect()).collect();
        let reach_m: f64 = plant.links.iter().map(|l| l.length_m).sum::<f64>().max(1e-3);
        Self {
            links,
            driven: is_driven(run),
            sensed: (0..links).map(|i| has(&|k| k == Kind::Torque(i))).collect(),
            powered: (0..links).map(|i| has(&|k| k == Kind::Current(i) || k == Kind::Undriven(i))).collect(),
            has_tip: has(&|k| matches!(k, Kind::Tip(_))),
            reach_m,
            slopes: Vec::new(),
            activity,
            interval_s: median_interval(&times_s),
            any_acceleration: any_acceleration(path),
            is_told_by_datagrams: datagrams(plant, run).is_some(),
        }
    }

    pub(super) fn places(&self) -> Places {
        let mut count = 3 * self.links;
        let mut next = |present: bool| {
            let place = present.then_some(count);
            count += usize::from(present);
            place
        };
        let link = self.sensed.iter().map(|s| next(*s)).collect();
        let drive = self.powered.iter().map(|p| next(*p)).collect();
        let tip = next(self.has_tip);
        let rate_lag = if self.has_tip { count + 2 } else { count };
        let eccentricity = rate_lag + 1;
        let rotor = eccentricity + if self.driven { 2 * self.links } else { 0 };
        let before = rotor + if self.driven { self.links } else { 0 };
        let instant = before + if self.driven { self.links } else { 0 };
        let count = instant + if self.is_told_by_datagrams { self.links } else { 0 };
        Places { link, drive, tip, rate_lag, eccentricity, rotor, before, instant, count }
    }

    /// What the rows read of a small motion beside the path: of a joint's angle, rate and acceleration at a stamp.
    pub(super) fn read_motion(&self, rows: &[Row], motion: impl Fn(usize, f64) -> [f64; 3]) -> Vec<f64> {
        let mut out = self.read_mixed(rows, motion);
        // The end-effector's rows are mixed in the slopes: back to plain ones.
        for k in 0..rows.len() {
            if let (Kind::Tip(axis), Some((mix, _))) = (rows[k].kind, &self.slopes[k].mix) {
                out[k] -= (0..axis).map(|c| mix[c] * out[k - axis + c]).sum::<f64>();
            }
        }
        out
    }

    /// The same of rows whose end-effector's are mixed ([`Slopes::mix`]).
    fn read_mixed(&self, rows: &[Row], motion: impl Fn(usize, f64) -> [f64; 3]) -> Vec<f64> {
        // Rows are means over their samples: so is the motion.
        let mean = |row: &Row, joint: usize| -> [f64; 3] {
            let count = row.stamps_s.len().max(1) as f64;
            let all = row.stamps_s.iter().map(|stamp_s| motion(joint, *stamp_s));
            all.fold([0.0; 3], |sum, d| std::array::from_fn(|i| sum[i] + d[i] / count))
        };
        let states = |row: &Row| -> Vec<f64> { (0..self.links).flat_map(|j| mean(row, j)).collect() };
        let read = |(row, slopes): (&Row, &Slopes)| {
            let states = states(row);
            slopes.motion.iter().map(|(state, c)| c * states[*state]).sum()
        };
        rows.iter().zip(&self.slopes).map(read).collect()
    }

    /// Whitens columns with these hyper-parameters, whose rows of the end-effector are mixed ([`Slopes::mix`]).
    pub(super) fn whiten(&self, rows: &[Row], (hyper, breakaway_n_m): (&Hyper, &[f64]), columns: &mut Columns) -> f64 {
        let places = self.places();
        let n = places.count;
        let mut initial = vec![0.0; n * n];
        for j in 0..self.links {
            initial[3 * j * (n + 1)] = START_SD[0] * START_SD[0];
            initial[(3 * j + 1) * (n + 1)] = START_SD[1] * START_SD[1];
            initial[(3 * j + 2) * (n + 1)] = self.acceleration_variance(0, j, hyper);
        }
        (3 * self.links..places.before).for_each(|i| initial[i * (n + 1)] = 1.0);
        (places.before..places.instant).for_each(|i| initial[i * (n + 1)] = self.any_acceleration.powi(2));
        (places.instant..n).for_each(|i| initial[i * (n + 1)] = self.instant_variance(0, i - places.instant));
        let begin: Vec<f64> = (0..n).map(|i| initial[i * (n + 1)]).collect();
        let mut filter = Whitener::new(n, &initial, columns);
        let (mut step, mut states) = (Step::default(), Vec::with_capacity(n));
        let (mut last_s, mut before_s, mut moment) = (f64::NAN, f64::NAN, 0);
        for (k, row) in rows.iter().enumerate() {
            if k > 0 && row.t_s > last_s {
                moment += 1;
                let dt_s = row.t_s - last_s;
                let before_or_now_s = if moment > 1 { before_s } else { dt_s };
                self.step((dt_s, before_or_now_s), moment, hyper, &begin, &places, &mut step);
                filter.advance(&step);
                before_s = dt_s;
            }
            last_s = row.t_s;
            let variance = self.measurement((row, k), (hyper, breakaway_n_m), &places, &mut states);
            filter.measure(&states, variance);
        }
        filter.log_det() - self.log_det_of_rests(rows, breakaway_n_m)
    }

    /// What rows of joints at rest put into the determinant's logarithm beside one row for each rest, over the same of a friction of 1 N m:
    /// however often a rest is looked at, its friction says no more of how large friction can be.
    fn log_det_of_rests(&self, rows: &[Row], breakaway_n_m: &[f64]) -> f64 {
        let of_row = |(row, slopes): (&Row, &Slopes)| {
            let (Kind::Current(i) | Kind::Undriven(i)) = row.kind else { return 0.0 };
            let variance = |n_m: f64| row.noise.powi(2) + slopes.unit_friction_variance * n_m.powi(2);
            let ratio = variance(breakaway_n_m[i]) / variance(1.0);
            if ratio > 0.0 { slopes.repeats_rest * ratio.ln() } else { 0.0 }
        };
        rows.iter().zip(&self.slopes).map(of_row).sum()
    }

    fn acceleration_variance(&self, moment: usize, joint: usize, hyper: &Hyper) -> f64 {
        if self.driven {
            return self.any_acceleration * self.any_acceleration;
        }
        hyper.acceleration[0].powi(2) + (hyper.acceleration[1] * self.activity(moment, joint)).powi(2)
    }

    /// Of an acceleration at an instant, beside the path's: whatever servos do as they settle.
    fn instant_variance(&self, moment: usize, joint: usize) -> f64 {
        (ANY_SHARE * self.activity(moment, joint)).powi(2)
    }

    fn activity(&self, moment: usize, joint: usize) -> f64 {
        self.activity.get(moment).map_or(0.0, |a| a[joint])
    }

    fn step(
        &self,
        (dt_s, before_s): (f64, f64),
        moment: usize,
        hyper: &Hyper,
        begin: &[f64],
        places: &Places,
        step: &mut Step,
    ) {
        step.clear();
        let (transition, noise) = (&mut step.transition, &mut step.noise);
        let followed = if self.driven { None } else { Some(singer(dt_s, hyper.acceleration_s)) };
        for j in 0..self.links {
            let variance = self.acceleration_variance(moment, j, hyper);
            let own = 3 * j;
            if let Some((f, q)) = followed {
                for (a, b) in (0..3).flat_map(|a| (0..3).map(move |b| (a, b))) {
                    noise.push((own + a, own + b, variance * q[a][b]));
                    if f[a][b] != 0.0 {
                        transition.push((own + a, own + b, f[a][b]));
                    }
                }
            } else if dt_s > PAUSE * self.interval_s {
                noise.extend((own..own + 3).chain([places.before + j]).map(|i| (i, i, begin[i])));
            } else {
                let by = by_accelerations(dt_s, before_s);
                transition.extend([(own, own, 1.0), (own, own + 1, dt_s), (own + 1, own + 1, 1.0)]);
                transition.push((places.before + j, own + 2, 1.0));
                for (i, [before, now, _]) in by.into_iter().enumerate() {
                    transition.extend([(own + i, places.before + j, before), (own + i, own + 2, now)]);
                }
                let push = [by[0][2], by[1][2], 1.0];
                for (a, b) in (0..3).flat_map(|a| (0..3).map(move |b| (a, b))) {
                    noise.push((own + a, own + b, variance * push[a] * push[b]));
                }
            }
        }
        transition.extend((places.rate_lag..places.before).map(|i| (i, i, 1.0)));
        for i in 3 * self.links..places.rate_lag {
            transition.push((i, i, (-dt_s / hyper.torque_s).exp()));
            noise.push((i, i, -(-2.0 * dt_s / hyper.torque_s).exp_m1()));
        }
        noise.extend((places.instant..places.count).map(|i| (i, i, self.instant_variance(moment, i - places.instant))));
    }

    /// The states that a row measures and the variance of its noise.
    fn measurement(
        &self,
        (row, k): (&Row, usize),
        (hyper, breakaway_n_m): (&Hyper, &[f64]),
        places: &Places,
        states: &mut Vec<(usize, f64)>,
    ) -> f64 {
        let slopes = &self.slopes[k];
        states.clear();
        states.extend_from_slice(&slopes.motion);
        if self.is_told_by_datagrams {
            let by_acceleration = slopes.motion.iter().filter(|(state, _)| state % 3 == 2);
            states.extend(by_acceleration.map(|(state, c)| (places.instant + state / 3, *c)));
        }
        if self.driven {
            states.extend(slopes.eccentricity.iter().map(|(state, v)| (places.eccentricity + state, *v)));
            if let Kind::Current(i) = row.kind {
                states.push((places.rotor + i, slopes.rotor));
            }
        }
        let (noise, torque) = (row.noise, slopes.torque);
        let variance = match row.kind {
            Kind::Angle(_) => (noise * hyper.noise[0]).powi(2),
            Kind::Rate(_) => {
                states.push((places.rate_lag, slopes.rate_lag));
                (noise * hyper.noise[1]).powi(2) + slopes.timing_variance
            }
            Kind::Torque(i) => {
                states.extend(places.link[i].map(|place| (place, torque * hyper.link)));
                (noise * hyper.noise[3]).powi(2) + self.white(torque, hyper) + slopes.timing_variance
            }
            Kind::Current(i) | Kind::Undriven(i) => {
                states.extend(places.link[i].map(|place| (place, torque * hyper.link)));
                states.extend(places.drive[i].map(|place| (place, torque * hyper.drive)));
                let least = (torque * LEAST_TORQUE).powi(2);
                (noise * hyper.noise[2]).powi(2)
                    + self.white(torque, hyper)
                    + slopes.unit_friction_variance * breakaway_n_m[i].powi(2)
                    + slopes.timing_variance
                    + least
            }
            Kind::Tip(axis) => {
                let (mix, own) = slopes.mix.unwrap_or((std::array::from_fn(|c| f64::from(u8::from(c == axis))), noise));
                let units = [hyper.tip_m, hyper.tip_m, hyper.tip_m / self.reach_m];
                let displaced = (0..=axis).filter_map(|c| Some((places.tip? + c, mix[c] * units[c])));
                states.extend(displaced.filter(|(_, v)| *v != 0.0));
                (own * hyper.noise[4]).powi(2) + slopes.timing_variance
            }
        };
        variance.max(f64::MIN_POSITIVE)
    }

    /// Variance of what a drive's row reads of accelerations at its instant and of the torque on its link, and of all else that it reads
    /// beside the path.
    pub(super) fn variances_of_drive(
        &self,
        (row, k): (&Row, usize),
        moment: usize,
        (hyper, breakaway_n_m): (&Hyper, &[f64]),
        places: &Places,
    ) -> [f64; 2] {
        let mut states = Vec::new();
        let (mut shared, mut own) = (0.0, self.measurement((row, k), (hyper, breakaway_n_m), places, &mut states));
        for (state, slope) in states {
            if state >= places.instant {
                shared += slope * slope * self.instant_variance(moment, state - places.instant);
            } else if places.link.contains(&Some(state)) {
                shared += slope * slope;
            } else if places.drive.contains(&Some(state)) {
                own += slope * slope;
            }
        }
        [shared, own]
    }

    /// Variance of white torque over the interval of a row.
    fn white(&self, torque: f64, hyper: &Hyper) -> f64 {
        if self.driven { (torque * hyper.white).powi(2) / self.interval_s } else { 0.0 }
    }
}

/// An acceleration that no error of the path is as large as, rad/s2.
fn any_acceleration(path: &MeasuredPath) -> f64 {
    let squares = path.joints.iter().flat_map(|track| path.grid_s().map(|t| track.at(t)[2].powi(2)));
    let (sum, count) = squares.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
    ANY_SHARE * (sum / f64::max(count, 1.0)).sqrt() + 1.0
}

/// Root mean square of what a joint's acceleration is to be around `t_s`, rad/s2.
fn path_activity(path: &MeasuredPath, joint: usize, t_s: f64) -> f64 {
    const SAMPLES: i32 = 12;
    let track = path.reference.as_ref().map_or(&path.joints[joint], |reference| &reference[joint]);
    let at = |k: i32| track.at(t_s + ACTIVITY_S * f64::from(k) / f64::from(SAMPLES))[2];
    ((-SAMPLES..=SAMPLES).map(|k| at(k).powi(2)).sum::<f64>() / f64::from(2 * SAMPLES + 1)).sqrt()
}
