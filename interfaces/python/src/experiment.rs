//! Measured experiments, read and checked.

use crate::error::from_error;
use fss_records::experiment::{Experiment, JointMode, Table};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A run's folder: name, duration, joint mode, and the tables by name, each a dictionary of columns.
#[pyfunction]
pub(crate) fn read_experiment(py: Python<'_>, folder: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let experiment = py.detach(|| Experiment::read(&folder)).map_err(|e| from_error(&e))?;
    let mode = match experiment.joint_mode {
        JointMode::Position => "position",
        JointMode::Velocity => "velocity",
        JointMode::Current => "current",
        JointMode::None => "none",
    };
    let tables = [
        ("base_pose", &experiment.base_pose),
        ("ee_pose", &experiment.ee_pose),
        ("gyro", &experiment.gyro),
        ("joints", &experiment.joints),
        ("joint_command", &experiment.joint_command),
        ("valves", &experiment.valves),
        ("thrust_level", &experiment.thrust_level),
    ];
    let all = PyDict::new(py);
    for (name, table) in tables {
        if let Some(table) = table {
            all.set_item(name, columns(py, table)?)?;
        }
    }
    let run = PyDict::new(py);
    run.set_item("name", &experiment.name)?;
    run.set_item("duration_s", experiment.duration_s)?;
    run.set_item("joint_mode", mode)?;
    run.set_item("tables", all)?;
    Ok(run)
}

fn columns<'py>(py: Python<'py>, table: &Table) -> PyResult<Bound<'py, PyDict>> {
    let columns = PyDict::new(py);
    columns.set_item("t_s", PyArray1::from_slice(py, &table.t_s))?;
    for name in table.names() {
        if let Some(values) = table.column(name) {
            columns.set_item(name, PyArray1::from_slice(py, values))?;
        }
    }
    Ok(columns)
}
