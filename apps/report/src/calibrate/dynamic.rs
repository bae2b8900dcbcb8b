//! `fss calibrate dynamic`.

use super::Files;
use super::answer::{self, Kind};
use crate::diagnose::runs;
use clap::{Args, ValueEnum};
use fss_calibrate::attitude::{self, Maneuver};
use fss_calibrate::dynamic::{self, Choice};
use fss_calibrate::{CalibrationError, Estimate};
use fss_experiments::measured::Run;
use fss_launcher::files::read_plant;
use fss_plant::Plant;
use miette::{IntoDiagnostic, Report, Result, miette};

/// How.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Method {
    /// Whole trajectories: geometry, centres of mass and inertias together, from momentum, and from torque sensors on request.
    Trajectory,
    /// The paper's: one joint at a time from rest to rest, how far the base turned, one inertia for all links.
    Attitude,
}

/// What `fss calibrate dynamic` takes. Only times without thrust count.
#[derive(Args)]
pub struct DynamicArgs {
    #[command(flatten)]
    files: Files,
    /// What is read from the runs.
    #[arg(long, value_enum, default_value = "trajectory")]
    method: Method,
    /// A length of its own for each link; otherwise all but the last share one.
    #[arg(long)]
    each_length: bool,
    /// Estimate masses too: nothing was weighed.
    #[arg(long)]
    masses: bool,
    /// Read the torque sensors too, where torques change slowly against their 5 reports a second.
    #[arg(long)]
    torque: bool,
}

const OF_NOISE: &str = "times the sensors' noise";
const TRAJECTORY: [Kind; 5] = [
    Kind::plain("center_of_mass_ratio", "centre of mass", OF_NOISE),
    Kind::plain("base_angle_ratio", "angle of the base", OF_NOISE),
    Kind::plain("end_effector_ratio", "end-effector", OF_NOISE),
    Kind::plain("end_effector_angle_ratio", "its angle", OF_NOISE),
    Kind::plain("torque_impulse_N_m_s", "torque over two seconds", "N m s"),
];
const ATTITUDE: [Kind; 1] = [Kind::radians("base_angle_rad", "turn of the base after a maneuver")];
const HELP: &str = "a dynamic calibration needs base_pose.csv and joints.csv (or a log of `fss run`) of an arm that moves while no valve is open";

/// Runs the command.
pub(super) fn run(args: &DynamicArgs) -> Result<()> {
    let plant = read_plant(&args.files.answer.plant)?;
    let measured = runs::read(&args.files.runs, &plant)?;
    let (estimate, kinds) = match args.method {
        Method::Trajectory => trajectory(args, &plant, &measured)?,
        Method::Attitude => attitude(&plant, &measured)?,
    };
    answer::print(&estimate, kinds);
    args.files.write(&plant, &estimate, &answer::json("dynamic", &estimate, kinds))
}

fn refused(error: &CalibrationError) -> Report {
    miette!(help = HELP, "{error}")
}

fn trajectory(args: &DynamicArgs, plant: &Plant, runs: &[Run]) -> Result<(Estimate, &'static [Kind])> {
    let model = plant.nominal().model().into_diagnostic()?;
    let sensors = &plant.sensors;
    let noise = [sensors.mocap_position_m, sensors.mocap_angle_rad, sensors.encoder_rad].map(|sd| sd.max(1e-5));
    let choice = Choice { each_length: args.each_length, masses: args.masses, torque: args.torque };
    let found = dynamic::calibrate(&model, runs, noise, choice).map_err(|e| refused(&e))?;
    say!("{:.0} s without thrust", found.used_s);
    for remark in &found.remarks {
        say!("- {remark}");
    }
    Ok((found.estimate, &TRAJECTORY))
}

fn attitude(plant: &Plant, runs: &[Run]) -> Result<(Estimate, &'static [Kind])> {
    let model = plant.nominal().model().into_diagnostic()?;
    let (mut all, mut mixed) = (Vec::<Maneuver>::new(), 0);
    for run in runs {
        let (found, others) = attitude::maneuvers(run, plant.link_count());
        all.extend(found);
        mixed += others;
    }
    let noise_rad = plant.sensors.mocap_angle_rad.max(1e-5);
    let estimate =
        attitude::calibrate(&model, &all, noise_rad, attitude::Choice::default()).map_err(|e| refused(&e))?;
    say!("{} maneuvers of one joint from rest to rest", all.len());
    if mixed > 0 {
        say!("- {mixed} motions of several joints at once are left out: the method cannot use them");
    }
    say!(
        "- centres of mass, masses and geometry are held as the plant file has them, and the interval takes them for exact"
    );
    if let Some(p) = estimate.parameters.first() {
        say!("- the inertia is known to {:.1} percent", 100.0 * p.std / p.value.abs());
    }
    Ok((estimate, &ATTITUDE))
}
