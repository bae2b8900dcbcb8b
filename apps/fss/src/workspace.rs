//! `fss workspace`: where the end-effector can be, and how well the arm moves it there.

use crate::files::TextFile;
use clap::Args;
use fss_identify::workspace::{fixed_area_m2, max_manipulability, virtual_manipulator_radius_m};
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result, WrapErr};
use serde_json::json;
use std::path::PathBuf;

/// Compute reach and manipulability of a plant.
#[derive(Args)]
pub struct WorkspaceArgs {
    /// Plant file.
    #[arg(long, value_name = "FILE")]
    plant: PathBuf,
    /// Folder for `workspace.json`.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Runs the command.
pub fn run(args: &WorkspaceArgs) -> Result<()> {
    let file = TextFile::read(&args.plant, "plant file")?;
    let plant = Plant::parse(&file.text).map_err(|e| file.error(e.message, e.help, Some(e.span)))?;
    let model = plant.model().into_diagnostic()?;
    let limits_rad: Vec<f64> = plant.links.iter().map(|link| link.joint_limit_rad).collect();
    let radius_m = virtual_manipulator_radius_m(&model);
    let area_m2 = fixed_area_m2(&model, &limits_rad);
    let (fixed, fixed_q_rad) = max_manipulability(&model, &limits_rad, false);
    let (floating, floating_q_rad) = max_manipulability(&model, &limits_rad, true);
    if let Some(radius_m) = radius_m {
        println!(
            "radius              {radius_m:.4} m   the end-effector's largest distance from the centre of mass, floating"
        );
    }
    println!("reach, base held    {area_m2:.4} m^2");
    println!("largest w2, held    {fixed:.6} m^2");
    println!("largest w2, free    {floating:.6} m^2");
    let answer = json!({ "format": "fss-workspace/1", "radius_m": radius_m, "fixed_area_m2": area_m2,
        "max_w2_fixed": fixed, "max_w2_fixed_q_rad": fixed_q_rad,
        "max_w2_floating": floating, "max_w2_floating_q_rad": floating_q_rad });
    std::fs::create_dir_all(&args.out)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot make {}", args.out.display()))?;
    let path = args.out.join("workspace.json");
    let text = serde_json::to_string_pretty(&answer).into_diagnostic()?;
    std::fs::write(&path, text).into_diagnostic().wrap_err_with(|| format!("cannot write {}", path.display()))?;
    println!("{}", path.display());
    Ok(())
}
