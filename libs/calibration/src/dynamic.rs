//! Dynamic calibration from whole trajectories: kinematic and dynamic parameters together.
//!
//! No thruster fires and the base floats, so that two things hold at every instant, not only at the end of a maneuver:
//!
//! - the centre of mass of base and arm drifts along a line: `r_base + R(theta) c(q; parameters)`;
//! - the base turns with the arm: `theta = theta_0 + int (reaction_vector(q) . q' + L / H(q)) dt` (Umetani and Yoshida 1989).
//!
//! End-effector poses, where they were measured, hold the geometry, and torque sensors the equations of motion
//! (`torque.rs`). Where the drift starts, and how the room pushes it, is a nuisance that a filter takes out
//! (`drift.rs`); how strong the push is, the data say. All times stand at reports of the joints, where their angles are
//! measured and not interpolated; motion capture is averaged around them.

mod noise;
mod stretch;
mod torque;

use super::drift::{Drifting, Interval, START, Whitener, likeliest_walks};
use super::kinematic::{self, PLAUSIBLE_DELAY_S};
use super::{CalibrationError, Estimate, Estimated, Row, Unknown, first_guess, solve};
use fss_experiments::measured::Run;
use fss_multibody::{Model, Parameter};
use nalgebra::Matrix3;
use noise::Noise;
use stretch::{Series, Stretch};

/// What is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// A length of its own for each link; otherwise all but the last share one.
    pub each_length: bool,
    /// The masses too; otherwise they were weighed.
    pub masses: bool,
    /// Torque sensors too. Their reports are rare: only a torque that changes slowly against them is understood.
    pub torque: bool,
}

/// What came out.
#[derive(Clone, Debug)]
pub struct Dynamic {
    /// The parameters. Kinds of noise: centre of mass, angle of the base, position and angle of the end-effector, each over
    /// what the sensors' noise gives; torque impulse, N m s.
    pub estimate: Estimate,
    /// What was held and what the data lack, a sentence each.
    pub remarks: Vec<String>,
    /// Time without thrust that was used, s.
    pub used_s: f64,
}

/// Kinds of observation.
const CENTER: usize = 0;
const ANGLE: usize = 1;
const TIP: usize = 2;
const TIP_ANGLE: usize = 3;
const TORQUE: usize = 4;
/// Known no better than this, a parameter counts as not determined.
const PLAUSIBLE_COM_M: f64 = 0.05;
const PLAUSIBLE_INERTIA: f64 = 0.05;
const PLAUSIBLE_BASE_INERTIA: f64 = 0.2;
const PLAUSIBLE_MASS_KG: f64 = 1.0;
/// All masses together are off by at most this share.
const PLAUSIBLE_MASS_SCALE: f64 = 0.15;
const PLAUSIBLE_ACCELERATION: f64 = 0.01;
/// Joints that move by less are at rest, rad.
const AT_REST_RAD: f64 = 0.02;
/// A torque sensor's scale so many deviations from one belongs to torques that do not explain the motion.
const DISAGREEMENT: f64 = 4.0;
/// The nuisance's strength and the telemetry's delay are sought anew at most this often.
const ROUNDS: usize = 4;

/// Estimates geometry, centres of mass and inertias. `noise` is `[position m, angle rad, encoder rad]`: that of motion capture
/// counts where its samples are too rare to tell themselves.
///
/// # Errors
/// [`CalibrationError`]: nothing to calibrate on, said in words, or an iteration that fails.
pub fn calibrate(model: &Model, runs: &[Run], noise: [f64; 3], choice: Choice) -> Result<Dynamic, CalibrationError> {
    refuse_impossible(model, runs)?;
    let noise = Noise::of(runs, noise);
    let fit = |choice| fit(model, runs, noise, choice);
    if !choice.torque {
        return fit(choice);
    }
    // Whether torques are those of the motion is asked with the masses as weighed: free masses would take up any scale.
    let why = match fit(Choice { masses: false, ..choice }) {
        Ok(found) => match torques_disagree(&found.estimate, choice.masses) {
            None if choice.masses => return fit(choice),
            None => return Ok(found),
            Some(why) => why,
        },
        Err(CalibrationError::Diverged) => {
            "torque sensors are left out: with them the iteration does not converge".into()
        }
        Err(other) => return Err(other),
    };
    let mut without = fit(Choice { torque: false, ..choice })?;
    without.remarks.push(why);
    Ok(without)
}

fn fit(model: &Model, runs: &[Run], noise: Noise, choice: Choice) -> Result<Dynamic, CalibrationError> {
    let n = model.link_count();
    let mut delay_s = 0.0;
    let mut stretches = stretch::all(runs, n, delay_s);
    if stretches.is_empty() {
        let why = "no run has base poses and telemetry of all joints for 3 s without thrust: there is nothing to calibrate on";
        return Err(CalibrationError::NoData(why.into()));
    }
    let resting = resting(&stretches, n);
    if resting.len() == n {
        let why = "no joint moves in these runs: what does not move says nothing about masses and inertias";
        return Err(CalibrationError::NoData(why.into()));
    }
    let problem = Problem::new(model, choice, &stretches);
    let mut remarks = problem.remarks(&resting, choice);
    let unknowns = problem.unknowns();
    let mut values = first_guess(&unknowns);
    let mut walks = [0.0; 2];
    let mut best = None;
    for _ in 0..ROUNDS {
        let believed = problem.model_at(&values).ok_or(CalibrationError::Diverged)?;
        for stretch in &mut stretches {
            stretch.prepare(&believed, noise);
        }
        let whiteners: Vec<Whitener> = stretches.iter().map(|s| s.whitener(&believed, walks)).collect();
        let rows = problem.rows(&stretches);
        let kinds = [1.0, 1.0, 1.0, 1.0, 0.02];
        let estimate = solve(&unknowns, &values, &rows, &kinds[..if problem.torque { 5 } else { 4 }], |values| {
            problem.residuals(&stretches, &whiteners, values, delay_s)
        })?;
        values.clone_from(&estimate.values);
        let before = (walks, delay_s);
        walks = problem.likeliest_walks(&stretches, &values, delay_s).ok_or(CalibrationError::Diverged)?;
        delay_s = values[problem.delay];
        best = Some(estimate);
        if before.0 == walks && (before.1 - delay_s).abs() < 1e-3 {
            break;
        }
        stretches = stretch::all(runs, n, delay_s);
    }
    let estimate = best.ok_or(CalibrationError::Diverged)?;
    remarks.extend(estimate.undetermined.is_empty().then(|| "all parameters are seen".to_owned()));
    Ok(Dynamic { estimate, remarks, used_s: stretches.iter().map(Stretch::duration_s).sum() })
}

fn refuse_impossible(model: &Model, runs: &[Run]) -> Result<(), CalibrationError> {
    let refuse = |why: &str| Err(CalibrationError::NoData(why.into()));
    if model.link_count() == 0 {
        return refuse("the plant has no [[link]]: there is nothing to calibrate");
    }
    if model.base().clamped {
        return refuse("the base is clamped: it cannot answer the arm, and its motion is what this calibration reads");
    }
    if runs.iter().all(|run| run.base_pose.is_none()) {
        return refuse("no run has poses of the base: they are what this calibration reads");
    }
    if runs.iter().all(|run| run.joints.is_none()) {
        return refuse("no run has telemetry of the joints");
    }
    Ok(())
}

/// Says so where the torques cannot be those of the motion. A report is a torque at an instant; where the drive corrects
/// between its reports, that is not the torque that moved the arm, and no noise of the residuals tells by how much.
///
/// A sensor's scale is one; where the masses are not known, what all sensors share may be the masses', as far as is plausible.
fn torques_disagree(estimate: &Estimate, masses_unknown: bool) -> Option<String> {
    let scales = || estimate.parameters.iter().filter(|p| p.name.ends_with("torque_sensor_scale"));
    let weights: f64 = scales().map(|p| p.std.powi(-2)).sum();
    let shared = scales().map(|p| p.value * p.std.powi(-2)).sum::<f64>() / weights;
    let most = if masses_unknown { PLAUSIBLE_MASS_SCALE } else { 0.0 };
    let expected = 1.0 + (shared - 1.0).clamp(-most, most);
    let off = |p: &&Estimated| (p.value - expected).abs() / p.std;
    let worst = scales().max_by(|a, b| off(a).total_cmp(&off(b)))?;
    (off(&worst) > DISAGREEMENT).then(|| {
        format!(
            "torque sensors are left out: for the motion, {} would have to be {:.2} with a deviation of {:.2}; either the sensor is off, or the drive corrects faster than it reports",
            worst.name, worst.value, worst.std
        )
    })
}

/// Joints, from 1, that stand still in all stretches.
fn resting(stretches: &[Stretch], links: usize) -> Vec<usize> {
    let range = |i: usize| {
        let all = || stretches.iter().flat_map(|s| s.q.iter().map(move |q| q[i]));
        all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min)
    };
    (0..links).filter(|i| range(*i) < AT_REST_RAD).map(|i| i + 1).collect()
}

/// The unknowns, where they stand among the values, and how they give residuals.
struct Problem<'a> {
    model: &'a Model,
    parts: Vec<(Unknown, Vec<Parameter>)>,
    /// Further unknowns: the telemetry's delay, the two accelerations of the table, the
    /// end-effector's delay, then torque scale and bias of each joint.
    delay: usize,
    tips: bool,
    torque: bool,
    scales: bool,
}

impl<'a> Problem<'a> {
    fn new(model: &'a Model, choice: Choice, stretches: &[Stretch]) -> Self {
        let n = model.link_count();
        let tips = stretches.iter().any(|s| s.tip.iter().any(Option::is_some));
        let mut parts = kinematic::unknowns(model, kinematic::Choice { each_length: choice.each_length });
        if !tips {
            parts.retain(|(unknown, _)| unknown.name.ends_with("_rad"));
        }
        let mut add = |name: String, plausible: f64, place: Parameter| {
            let value = model.parameter(place).unwrap_or_default();
            parts.push((Unknown { name, value, plausible }, vec![place]));
        };
        for i in 1..=n {
            add(format!("link[{i}].com_to_next_joint_m"), PLAUSIBLE_COM_M, Parameter::ComToNextJoint(i));
        }
        for i in 1..=n {
            add(format!("link[{i}].inertia_kg_m2"), PLAUSIBLE_INERTIA, Parameter::LinkInertia(i));
        }
        add("base.inertia_kg_m2".into(), PLAUSIBLE_BASE_INERTIA, Parameter::BaseInertia);
        if choice.masses {
            add("base.mass_kg".into(), PLAUSIBLE_MASS_KG, Parameter::BaseMass);
            for i in 1..=n {
                add(format!("link[{i}].mass_kg"), PLAUSIBLE_MASS_KG, Parameter::LinkMass(i));
            }
        }
        let torque = choice.torque && stretches.iter().any(|s| !s.torque.is_empty());
        Self { model, delay: parts.len(), parts, tips, torque, scales: torque && !choice.masses }
    }

    fn unknowns(&self) -> Vec<Unknown> {
        let mut all: Vec<Unknown> = self.parts.iter().map(|(u, _)| u.clone()).collect();
        let mut add = |name: String, value: f64, plausible: f64| all.push(Unknown { name, value, plausible });
        add("telemetry_delay_s".into(), 0.0, PLAUSIBLE_DELAY_S);
        let [x, y] = self.model.gravity_m_s2();
        add("table.gravity_m_s2.x".into(), x, PLAUSIBLE_ACCELERATION);
        add("table.gravity_m_s2.y".into(), y, PLAUSIBLE_ACCELERATION);
        if self.tips {
            add("end_effector_delay_s".into(), 0.0, PLAUSIBLE_DELAY_S);
        }
        for i in 1..=self.model.link_count() {
            if self.scales {
                add(format!("link[{i}].torque_sensor_scale"), 1.0, 1.0);
            }
            if self.torque {
                add(format!("link[{i}].torque_sensor_bias_N_m"), 0.0, 0.5);
            }
        }
        all
    }

    fn remarks(&self, resting: &[usize], choice: Choice) -> Vec<String> {
        let mut remarks = Vec::new();
        for joint in resting {
            remarks.push(format!(
                "joint {joint} does not move: {} and link {joint} turn the base as one body, only their total is seen in motion",
                if *joint == 1 { "the base".to_owned() } else { format!("link {}", joint - 1) }
            ));
        }
        if !self.tips {
            remarks.push("no poses of the end-effector: link lengths and the first joint's place are held as the plant file has them, and the intervals take them for exact".into());
        }
        remarks.push(match (choice.masses, self.torque) {
            (false, _) => "masses are held as the plant file has them (weighed)".into(),
            (true, true) => {
                "masses are estimated; their scale comes from the torque sensors alone, taken for right".into()
            }
            (true, false) => "masses are estimated without torque sensors: motion alone shows their ratios only".into(),
        });
        remarks
    }

    fn model_at(&self, values: &[f64]) -> Option<Model> {
        let changes = self.parts.iter().zip(values).flat_map(|((_, places), v)| places.iter().map(|p| (*p, *v)));
        self.model.with_parameters(changes).ok()
    }

    /// Scale and bias of a torque sensor.
    fn sensor(&self, values: &[f64], joint: usize) -> (f64, f64) {
        let first = self.delay + 3 + usize::from(self.tips);
        if self.scales {
            (values[first + 2 * joint], values[first + 2 * joint + 1])
        } else {
            (1.0, values[first + joint])
        }
    }

    fn series(&self, stretch: &Stretch, model: &Model, values: &[f64], built_delay_s: f64) -> Series {
        let tip_delay_s = if self.tips { values[self.delay + 3] } else { 0.0 };
        let tilt = [values[self.delay + 1], values[self.delay + 2]];
        stretch.series(model, values[self.delay] - built_delay_s, tip_delay_s, tilt)
    }

    fn likeliest_walks(&self, stretches: &[Stretch], values: &[f64], built_delay_s: f64) -> Option<[f64; 2]> {
        let model = self.model_at(values)?;
        let series: Vec<Series> = stretches.iter().map(|s| self.series(s, &model, values, built_delay_s)).collect();
        let noise: Vec<Vec<Matrix3<f64>>> =
            stretches.iter().map(|s| s.mixing.iter().map(|mixing| mixing.rest).collect()).collect();
        let intervals: Vec<Vec<Interval>> = stretches.iter().map(|s| s.intervals(&model)).collect();
        let all: Vec<Drifting> = (0..stretches.len())
            .map(|i| Drifting { series: &series[i].drifting, noise: &noise[i], intervals: &intervals[i] })
            .collect();
        Some(likeliest_walks(&all))
    }

    /// The kind, instant and series of every residual, in the order of [`Problem::residuals`].
    fn rows(&self, stretches: &[Stretch]) -> Vec<Row> {
        let (mut rows, mut first) = (Vec::new(), 0);
        for (number, stretch) in stretches.iter().enumerate() {
            let series = 16 * number;
            for (k, tip) in stretch.tip.iter().enumerate() {
                let instant = first + k;
                let mut add = |kinds: [(usize, usize); 3]| {
                    rows.extend(kinds.map(|(kind, axis)| Row { kind, instant, series: series + axis }));
                };
                if k >= START {
                    add([(CENTER, 0), (CENTER, 1), (ANGLE, 0)]);
                }
                if tip.is_some() {
                    add([(TIP, 0), (TIP, 1), (TIP_ANGLE, 0)]);
                }
            }
            first += stretch.len();
            for window in stretch.torque.iter().filter(|_| self.torque) {
                let instant = first + window.first;
                rows.extend((0..self.model.link_count()).map(|i| Row { kind: TORQUE, instant, series: series + i }));
            }
            first += stretch.len();
        }
        rows
    }

    fn residuals(&self, stretches: &[Stretch], white: &[Whitener], values: &[f64], built_s: f64) -> Option<Vec<f64>> {
        let model = self.model_at(values)?;
        let mut out = Vec::new();
        for (stretch, white) in stretches.iter().zip(white) {
            let series = self.series(stretch, &model, values, built_s);
            for (k, (drifting, tip)) in white.apply(&series.drifting).iter().zip(&series.tip).enumerate() {
                out.extend(drifting.iter().take(if k < START { 0 } else { 3 }));
                out.extend(tip.iter().flatten());
            }
            for window in stretch.torque.iter().filter(|_| self.torque) {
                let impulses = stretch.impulses(&model, window);
                for (joint, measured) in window.measured.iter().enumerate() {
                    let (scale, bias) = self.sensor(values, joint);
                    out.push(measured - scale * impulses[joint] - bias * window.weight);
                }
            }
        }
        Some(out)
    }
}
