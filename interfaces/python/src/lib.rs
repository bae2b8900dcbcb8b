//! What the Python module `fss` asks of Rust: logs, experiments, plants, flights, and the commands of the program.
//!
//! It is thin: plain numbers, bytes and JSON go across; the objects that a person sees are made in `fss/*.py`. Python's
//! interpreter runs on while Rust works.
// The Python names and types of arguments are told in `fss/_fss.pyi`; PyO3 takes arguments by value.
#![allow(clippy::needless_pass_by_value)]

mod command;
mod dynamics;
mod error;
mod experiment;
mod flight;
mod job;
mod live;
mod log;
mod plant;

use pyo3::prelude::*;

/// The native half of the module fss.
#[pymodule]
fn _fss(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("Error", m.py().get_type::<error::Error>())?;
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add_class::<log::LogFile>()?;
    m.add_class::<log::Blocks>()?;
    m.add_class::<plant::PlantFile>()?;
    m.add_function(wrap_pyfunction!(plant::effects, m)?)?;
    m.add_function(wrap_pyfunction!(plant::toml_to_json, m)?)?;
    m.add_function(wrap_pyfunction!(experiment::read_experiment, m)?)?;
    m.add_function(wrap_pyfunction!(flight::fly, m)?)?;
    m.add_function(wrap_pyfunction!(live::live_topics, m)?)?;
    m.add_function(wrap_pyfunction!(live::running_stack, m)?)?;
    m.add_function(wrap_pyfunction!(command::command, m)?)?;
    m.add_function(wrap_pyfunction!(command::campaign_begin, m)?)?;
    m.add_function(wrap_pyfunction!(command::campaign_run, m)?)?;
    m.add_function(wrap_pyfunction!(command::campaign_write, m)?)
}
