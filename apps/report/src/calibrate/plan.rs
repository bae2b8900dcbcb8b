//! `fss calibrate plan`: the postures that determine the kinematics best, as a mission.

use clap::{Args, ValueEnum};
use fss_calibrate::kinematic::Choice;
use fss_calibrate::plan::{self, Criterion, Limits, Plan};
use fss_launcher::files::{read_plant, write};
use fss_multibody::{Model, coordinates};
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result, miette};
use std::fmt::Write;
use std::path::PathBuf;

/// What the postures shall make smallest.
#[derive(Clone, Copy, ValueEnum)]
enum Smallest {
    /// The product of the standard deviations: the box of all intervals.
    Intervals,
    /// The volume of the ellipsoid of confidence: D-optimal.
    Volume,
}

/// What `fss calibrate plan` takes.
#[derive(Args)]
pub struct PlanArgs {
    /// Plant file: what is believed before.
    #[arg(long, value_name = "FILE")]
    plant: PathBuf,
    /// The mission file to write; `fss run` flies it.
    #[arg(long, value_name = "MISSION")]
    out: PathBuf,
    /// Number of postures.
    #[arg(long, default_value_t = 13, value_parser = clap::value_parser!(u16).range(1..=200))]
    poses: u16,
    /// A length of its own for each link; otherwise all but the last share one.
    #[arg(long)]
    each_length: bool,
    /// What the postures shall make smallest.
    #[arg(long, value_enum, default_value = "intervals")]
    criterion: Smallest,
    /// Standard deviation of the end-effector's position in one posture; otherwise from the plant file's sensors.
    #[arg(long, value_name = "M")]
    position_noise: Option<f64>,
    /// Standard deviation of its angle.
    #[arg(long, value_name = "DEG")]
    angle_noise: Option<f64>,
}

/// Joints stay this far from their stops, rad.
const MARGIN_RAD: f64 = 0.05;
/// A joint moves at most this fast on its way, rad/s, and no faster than a half of what its driver allows.
const COMFORTABLE_RAD_S: f64 = 0.3;
/// Peak over mean rate of a motion from rest to rest.
const PEAK: f64 = 1.875;
/// Shortest way, and rest in a posture, s.
const SHORTEST_S: f64 = 3.0;
const REST_S: f64 = 4.0;
/// Of the rest, so much counts: before, the arm still settles, s.
const COUNTED_S: f64 = 2.0;
/// Way of the tip by a joint's angle, on average, m: for the expected noise.
const LEVER_M: f64 = 0.7;
/// A link is so wide, m.
const LINK_WIDTH_M: f64 = 0.1;
/// Nothing comes nearer to the table's edge, m.
const EDGE_M: f64 = 0.2;

/// Runs the command.
pub(super) fn run(args: &PlanArgs) -> Result<()> {
    let plant = read_plant(&args.plant)?;
    let model = plant.nominal().model().into_diagnostic()?;
    if plant.link_count() == 0 {
        return Err(miette!("{}: the plant has no [[link]]: there are no postures", args.plant.display()));
    }
    let choice = Choice { each_length: args.each_length };
    let fewest = plan::fewest(&model, choice);
    if usize::from(args.poses) < fewest {
        return Err(miette!(
            help = "each posture gives three numbers",
            "{} postures cannot determine all parameters: {fewest} are the fewest",
            args.poses
        ));
    }
    let limits = limits(&plant, args);
    let criterion = match args.criterion {
        Smallest::Intervals => Criterion::Intervals,
        Smallest::Volume => Criterion::Volume,
    };
    let made = plan::plan(&model, &limits, usize::from(args.poses), choice, criterion);
    let start = middle_of_table(&plant, &model, &made)?;
    say!("{} postures; expected standard deviations:\n", made.postures.len());
    for (name, std) in &made.expected {
        say!("{name:<30}{std:>12.6}");
    }
    say!("\nwith {:.3} mm and {:.4} deg of noise in a posture", limits.noise[0] * 1e3, limits.noise[1].to_degrees());
    if made.blocked > 0 {
        say!("- on {} ways between postures the arm comes near the base or itself: look at them first", made.blocked);
    }
    let text = mission(&plant, &made, start).into_diagnostic()?;
    write(&args.out, &text)
}

fn limits(plant: &Plant, args: &PlanArgs) -> Limits {
    let s = &plant.sensors;
    // End-effector seen from the base: two poses, the base's angle on a lever, and the encoders on theirs; all averaged.
    let reports = (COUNTED_S * s.link_rate_hz).max(1.0);
    let encoders = plant.link_count() as f64 * s.encoder_rad.powi(2);
    let position = (2.0 * s.mocap_position_m.powi(2) + LEVER_M.powi(2) * (s.mocap_angle_rad.powi(2) + encoders)).sqrt();
    let angle = (2.0 * s.mocap_angle_rad.powi(2) + encoders).sqrt();
    let averaged = [position, angle].map(|noise| (noise / reports.sqrt()).max(1e-6));
    Limits {
        joint_rad: plant.links.iter().map(|link| (link.joint_limit_rad - MARGIN_RAD).max(0.0)).collect(),
        clearance_m: 0.5 * plant.base.size_m[0].hypot(plant.base.size_m[1]),
        link_clearance_m: LINK_WIDTH_M,
        noise: [args.position_noise.unwrap_or(averaged[0]), args.angle_noise.map_or(averaged[1], f64::to_radians)],
    }
}

/// Where the base starts so that the centre of mass, which stays, is in the middle of the table.
fn middle_of_table(plant: &Plant, model: &Model, made: &Plan) -> Result<[f64; 2]> {
    let half = 0.5 * plant.table.size_m[0].min(plant.table.size_m[1]);
    for posture in &made.postures {
        let q = coordinates([0.0; 3], posture);
        let (center, all) = (model.center_of_mass(&q), model.kinematics(&q));
        let farthest = all
            .joints
            .iter()
            .take(posture.len() + 1)
            .map(|joint| (joint - center).norm())
            .fold(center.norm(), f64::max);
        if farthest + EDGE_M > half {
            return Err(miette!(
                "the arm reaches {farthest:.2} m from the centre of mass: the table is too small for it"
            ));
        }
    }
    let center = made
        .postures
        .first()
        .map_or_else(Default::default, |posture| model.center_of_mass(&coordinates([0.0; 3], posture)));
    Ok([-center.x, -center.y])
}

fn mission(plant: &Plant, made: &Plan, start: [f64; 2]) -> std::result::Result<String, std::fmt::Error> {
    let degrees = |posture: &[f64]| -> String {
        let all: Vec<String> = posture.iter().map(|q| format!("{:.2}", q.to_degrees())).collect();
        format!("[{}]", all.join(", "))
    };
    let mut text = String::from("# Made by fss calibrate plan. Expected standard deviations:\n");
    for (name, std) in &made.expected {
        writeln!(text, "#   {name} {std:.6}")?;
    }
    writeln!(text, "name = \"calibrate\"\nservices = [\"calibration\"]")?;
    writeln!(
        text,
        "description = \"{} postures that determine the kinematics best; the base floats.\"",
        made.postures.len()
    )?;
    let first = made.postures.first().map_or("[]".into(), |posture| degrees(posture));
    writeln!(text, "\n[initial]\nq_deg = {first}\nx_m = {:.3}\ny_m = {:.3}", start[0], start[1])?;
    for (k, posture) in made.postures.iter().enumerate() {
        let before = made.postures.get(k.wrapping_sub(1)).unwrap_or(posture);
        let way_s = |(i, (a, b)): (usize, (&f64, &f64))| {
            PEAK * (b - a).abs() / COMFORTABLE_RAD_S.min(0.5 * plant.servo(i).max_rate_rad_s)
        };
        let duration_s = before.iter().zip(posture).enumerate().map(way_s).fold(SHORTEST_S, f64::max);
        writeln!(text, "\n[[phase]]\nname = \"posture {}\"", k + 1)?;
        writeln!(text, "duration_s = {:.1}\nsettle_s = {REST_S}", (10.0 * duration_s).ceil() / 10.0)?;
        writeln!(text, "base = {{ goal = \"free\" }}\narm = {{ goal = \"joints\", q_deg = {} }}", degrees(posture))?;
    }
    Ok(text)
}
