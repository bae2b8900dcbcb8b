//! From files to the series that the identification works on.

use super::log;
use fss_experiments::measured::{Drive, Joints, Many, Poses, Run, Series};
use fss_plant::Plant;
use fss_records::experiment::{Experiment, JointMode, Table};
use miette::{IntoDiagnostic, Result, miette};
use std::path::PathBuf;

/// Reads the runs: folders of CSV, or logs of ours.
pub fn read(folders: &[PathBuf], plant: &Plant) -> Result<Vec<Run>> {
    folders
        .iter()
        .map(|folder| {
            if let Some(log) = log::log_of(folder) {
                return log::read(&log, plant);
            }
            if !folder.is_dir() {
                return Err(miette!(
                    help = "a run is a folder with run.toml and CSV files (fss-experiment/1), or a log of `fss run` or its folder",
                    "{} is neither a folder nor a log",
                    folder.display()
                ));
            }
            let experiment = Experiment::read(folder).into_diagnostic()?;
            check(&experiment, plant)?;
            Ok(run(&experiment))
        })
        .collect()
}

/// Refuses a run that cannot belong to the plant.
fn check(experiment: &Experiment, plant: &Plant) -> Result<()> {
    let folder = experiment.folder.display();
    let joints = experiment.joints.as_ref().map_or(0, |t| t.numbered("q", "_rad").len());
    if joints > plant.link_count() {
        return Err(miette!(
            "{folder}/joints.csv has {joints} joints, but the plant file has {} [[link]] tables",
            plant.link_count()
        ));
    }
    let commanded = [
        ("valves.csv", &experiment.valves, "v", "valves"),
        ("thrust_level.csv", &experiment.thrust_level, "u", "levels"),
    ];
    for (file, table, prefix, what) in commanded {
        let count = table.as_ref().map_or(0, |t| t.numbered(prefix, "").len());
        if count > plant.thrusters.len() {
            return Err(miette!(
                "{folder}/{file} has {count} {what}, but the plant file has {} [[thruster]] tables",
                plant.thrusters.len()
            ));
        }
    }
    Ok(())
}

fn run(e: &Experiment) -> Run {
    let folder = e.folder.file_name().map(|name| name.to_string_lossy().into_owned());
    Run {
        name: folder.unwrap_or_else(|| e.name.clone()),
        base_pose: e.base_pose.as_ref().and_then(poses),
        ee_pose: e.ee_pose.as_ref().and_then(poses),
        gyro: e.gyro.as_ref().and_then(|t| series(t, "rate_rad_s")),
        joints: e.joints.as_ref().map(joints),
        joint_command: e
            .joint_command
            .as_ref()
            .map(|t| Many { t_s: t.t_s.clone(), values: owned(&t.numbered("q", "_rad")) }),
        commands: None,
        thrust_levels: thrust_levels(e),
        drive: match e.joint_mode {
            JointMode::Position | JointMode::Velocity => Drive::Servo,
            JointMode::Current => Drive::Current,
            JointMode::None => Drive::Free,
        },
        postures: Vec::new(),
    }
}

fn poses(table: &Table) -> Option<Poses> {
    let (x, y, theta) = (table.column("x_m")?, table.column("y_m")?, table.column("theta_rad")?);
    let values = (0..table.len()).map(|k| [x[k], y[k], theta[k]]).collect();
    Some(Poses { t_s: table.t_s.clone(), values })
}

fn series(table: &Table, column: &str) -> Option<Series> {
    Some(Series { t_s: table.t_s.clone(), values: table.column(column)?.to_vec() })
}

fn joints(table: &Table) -> Joints {
    Joints {
        t_s: table.t_s.clone(),
        q_rad: owned(&table.numbered("q", "_rad")),
        qd_rad_s: owned(&table.numbered("qd", "_rad_s")),
        current_a: owned(&table.numbered("current", "_A")),
        torque_nm: owned(&table.numbered("torque", "_Nm")),
    }
}

fn owned(columns: &[&[f64]]) -> Vec<Vec<f64>> {
    columns.iter().map(|column| column.to_vec()).collect()
}

/// Levels as they were commanded; of valves 0 and 1.
fn thrust_levels(e: &Experiment) -> Vec<(f64, Vec<f64>)> {
    let rows = |table: &Table, prefix: &str, level: fn(f64) -> f64| {
        let columns = table.numbered(prefix, "");
        let row = |k: usize| columns.iter().map(|column| level(column[k])).collect();
        table.t_s.iter().enumerate().map(|(k, &t_s)| (t_s, row(k))).collect()
    };
    match (&e.thrust_level, &e.valves) {
        (Some(levels), _) => rows(levels, "u", |level| level),
        (None, Some(valves)) => rows(valves, "v", |state| f64::from(state > 0.5)),
        (None, None) => Vec::new(),
    }
}
