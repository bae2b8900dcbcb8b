//! `fss workspace`: where the end-effector can be, and how well the arm moves it there.

mod contours;
mod figures;

use clap::Args;
use fss_launcher::files::{TextFile, write};
use fss_multibody::{Base, Manipulability, Model, coordinates};
use fss_plant::Plant;
use fss_workspace::reach::{fixed_area_m2, manipulability, max_manipulability, virtual_manipulator_radius_m};
use fss_workspace::straight_path::{straight_path, straight_path_area_m2};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

/// Compute reach and manipulability of a plant.
#[derive(Args)]
pub struct WorkspaceArgs {
    /// Plant file.
    #[arg(long, value_name = "FILE")]
    plant: PathBuf,
    /// Folder for `workspace.json` and the pictures.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A posture, deg, one angle a joint: straight paths start in it and ellipsoids belong to it. Give it again for more;
    /// the pictures show the first. Without it: half the joints' limits, in a zigzag.
    #[arg(long = "posture", value_name = "DEG,DEG,..", allow_hyphen_values = true)]
    postures: Vec<String>,
    /// How many directions straight paths take.
    #[arg(long, default_value_t = 36, value_parser = clap::value_parser!(u16).range(3..=720))]
    directions: u16,
}

/// What there is to say of one posture.
pub struct Look {
    q_rad: Vec<f64>,
    held: StraightPaths,
    /// None where the plant's base cannot float.
    floating: Option<StraightPaths>,
    held_ellipse: Manipulability,
    floating_ellipse: Option<Manipulability>,
}

/// Straight paths in directions that are evenly spread from 0 on.
pub struct StraightPaths {
    lengths_m: Vec<f64>,
    area_m2: f64,
}

/// Runs the command.
pub fn run(args: &WorkspaceArgs) -> Result<()> {
    let file = TextFile::read(&args.plant, "plant file")?;
    let plant = Plant::parse(&file.text).map_err(|e| file.error(e.message, e.help, Some(e.span)))?;
    let model = plant.model().into_diagnostic()?;
    let limits_rad: Vec<f64> = plant.links.iter().map(|link| link.joint_limit_rad).collect();
    if limits_rad.len() < 2 {
        return Err(miette!("{}: an arm of {} link(s) has no workspace", args.plant.display(), limits_rad.len()));
    }
    let postures = postures(&args.postures, &limits_rad)?;
    let radius_m = virtual_manipulator_radius_m(&model);
    let area_m2 = fixed_area_m2(&model, &limits_rad);
    let (fixed, fixed_q_rad) = max_manipulability(&model, &limits_rad, false);
    let (floating, floating_q_rad) = max_manipulability(&model, &limits_rad, true);
    let looks = postures
        .iter()
        .map(|q_rad| look(&model, &limits_rad, q_rad, args.directions.into()))
        .collect::<Result<Vec<_>>>()?;
    if let Some(radius_m) = radius_m {
        say!(
            "radius              {radius_m:.4} m   the end-effector's largest distance from the centre of mass, floating"
        );
    }
    say!("reach, base held    {area_m2:.4} m^2");
    say!("largest w2, held    {fixed:.6} m^2");
    say!("largest w2, free    {floating:.6} m^2");
    for look in &looks {
        say!("from {} deg", degrees(&look.q_rad));
        let free = |of: Option<f64>| of.map_or_else(String::new, |value| format!(", floating {value:.4} m^2"));
        let (paths, ellipse) = (look.floating.as_ref(), look.floating_ellipse.as_ref());
        say!("  straight paths    held {:.4} m^2{}", look.held.area_m2, free(paths.map(|paths| paths.area_m2)));
        say!(
            "  w2                held {:.4} m^2{}",
            look.held_ellipse.measure_m2(),
            free(ellipse.map(Manipulability::measure_m2))
        );
    }
    let mut answer = json!({ "format": "fss-workspace/1", "radius_m": radius_m, "fixed_area_m2": area_m2,
        "max_w2_fixed": fixed, "max_w2_fixed_q_rad": fixed_q_rad,
        "max_w2_floating": floating, "max_w2_floating_q_rad": floating_q_rad,
        "postures": looks.iter().map(Look::as_json).collect::<Vec<_>>() });
    if let Some(first) = looks.first() {
        answer["straight_path_fixed_area_m2"] = json!(first.held.area_m2);
        answer["straight_path_floating_area_m2"] = json!(first.floating.as_ref().map(|paths| paths.area_m2));
    }
    std::fs::create_dir_all(&args.out)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot make {}", args.out.display()))?;
    write(&args.out.join("workspace.json"), &serde_json::to_string_pretty(&answer).into_diagnostic()?)?;
    let held = figures::held_workspace(&plant, &model, &limits_rad, (fixed, &fixed_q_rad));
    write(&args.out.join("workspace-held.svg"), &held)?;
    if let Some(first) = looks.first() {
        write(&args.out.join("straight-paths.svg"), &figures::straight_paths(&plant, &model, radius_m, first))?;
        write(&args.out.join("manipulability.svg"), &figures::ellipsoids(&plant, &model, first))?;
    }
    Ok(())
}

fn degrees(q_rad: &[f64]) -> String {
    q_rad.iter().map(|q| format!("{:.1}", q.to_degrees())).collect::<Vec<_>>().join(", ")
}

/// The postures asked for, or half the limits in a zigzag.
fn postures(asked: &[String], limits_rad: &[f64]) -> Result<Vec<Vec<f64>>> {
    if asked.is_empty() {
        const SIGNS: [f64; 4] = [0.5, -0.5, -0.5, 0.5];
        return Ok(vec![limits_rad.iter().enumerate().map(|(i, limit)| limit * SIGNS[i % 4]).collect()]);
    }
    asked.iter().map(|text| posture(text, limits_rad)).collect()
}

fn posture(text: &str, limits_rad: &[f64]) -> Result<Vec<f64>> {
    let q_rad: Vec<f64> = text
        .split(',')
        .map(|angle| angle.trim().parse::<f64>().map(f64::to_radians))
        .collect::<std::result::Result<_, _>>()
        .map_err(|_| miette!("--posture {text}: give angles in degrees, with commas between them"))?;
    if q_rad.len() != limits_rad.len() {
        return Err(miette!("--posture {text}: {} angles, but the plant has {} joints", q_rad.len(), limits_rad.len()));
    }
    let beyond = |(q, limit): (&f64, &f64)| q.is_nan() || q.abs() > limit + 1e-9;
    match q_rad.iter().zip(limits_rad).position(beyond) {
        Some(i) => {
            Err(miette!("--posture {text}: joint {} is beyond its {:.1} deg", i + 1, limits_rad[i].to_degrees()))
        }
        None => Ok(q_rad),
    }
}

fn look(model: &Model, limits_rad: &[f64], q_rad: &[f64], directions: usize) -> Result<Look> {
    let floats = !model.base().clamped;
    let held = Model::new(Base { clamped: true, ..*model.base() }, model.links(), [0.0, 0.0]).into_diagnostic()?;
    Ok(Look {
        q_rad: q_rad.to_vec(),
        held: straight_paths(&held, limits_rad, q_rad, directions),
        floating: floats.then(|| straight_paths(model, limits_rad, q_rad, directions)),
        held_ellipse: manipulability(model, q_rad, false),
        floating_ellipse: floats.then(|| manipulability(model, q_rad, true)),
    })
}

fn straight_paths(model: &Model, limits_rad: &[f64], q_rad: &[f64], directions: usize) -> StraightPaths {
    let start = coordinates([0.0; 3], q_rad);
    let angle_rad = |k: usize| TAU * k as f64 / directions as f64;
    let lengths_m: Vec<f64> = (0..directions)
        .into_par_iter()
        .map(|k| straight_path(model, limits_rad, &start, angle_rad(k)).length_m)
        .collect();
    StraightPaths { area_m2: straight_path_area_m2(&lengths_m), lengths_m }
}

impl Look {
    fn as_json(&self) -> Value {
        let paths = |paths: &StraightPaths| json!({ "area_m2": paths.area_m2, "length_m": paths.lengths_m });
        let ellipse = |e: &Manipulability| {
            json!({ "semi_axes_m": e.semi_axes_m, "major_axis_rad": e.major_axis_rad,
                "w2_m2": e.measure_m2(), "area_m2": PI * e.measure_m2() })
        };
        json!({ "q_rad": self.q_rad,
            "straight_path_fixed": paths(&self.held), "straight_path_floating": self.floating.as_ref().map(paths),
            "ellipsoid_fixed": ellipse(&self.held_ellipse),
            "ellipsoid_floating": self.floating_ellipse.as_ref().map(ellipse) })
    }
}
