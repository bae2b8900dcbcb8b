//! Plants: read, written, simulated; their mechanism in `dynamics`.

use crate::dynamics::{self, Quantity};
use crate::error::{from_error, of_plant};
use fss_multibody::Model;
use fss_plant::{DEFAULT_PLANT, JointCommand, Plant, Simulation, Truth, effects::catalogue};
use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::json;

/// A plant, read and checked.
#[pyclass(frozen, module = "fss")]
pub(crate) struct PlantFile {
    plant: Plant,
    model: Model,
}

#[pymethods]
impl PlantFile {
    /// Of a file's text; the default laboratory where there is none. `name` is the file's in errors.
    #[new]
    #[pyo3(signature = (text=None, name="plant"))]
    fn new(text: Option<&str>, name: &str) -> PyResult<Self> {
        let plant = Plant::parse(text.unwrap_or(DEFAULT_PLANT)).map_err(|e| of_plant(name, &e))?;
        let model = plant.model().map_err(|e| from_error(&e))?;
        Ok(Self { plant, model })
    }

    /// Of the text that [`PlantFile::to_json`] gives, changed.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        let table: toml::Table = serde_json::from_str(text).map_err(|e| from_error(&e))?;
        Self::new(Some(&toml::to_string(&table).map_err(|e| from_error(&e))?), "the changed plant")
    }

    fn to_toml(&self) -> PyResult<String> {
        self.plant.to_toml().map_err(|e| from_error(&e))
    }

    fn to_json(&self) -> PyResult<String> {
        serde_json::to_string(&self.plant).map_err(|e| from_error(&e))
    }

    fn nominal(&self) -> PyResult<Self> {
        let plant = self.plant.nominal();
        let model = plant.model().map_err(|e| from_error(&e))?;
        Ok(Self { plant, model })
    }

    #[getter]
    fn links(&self) -> usize {
        self.plant.link_count()
    }

    #[getter]
    fn thrusters(&self) -> usize {
        self.plant.thrusters.len()
    }

    #[getter]
    fn mass_kg(&self) -> f64 {
        self.model.total_mass_kg()
    }

    /// A quantity of the mechanism at many states; the shapes are checked by the caller.
    fn dynamics<'py>(
        &self,
        py: Python<'py>,
        quantity: &str,
        q: PyReadonlyArray2<'py, f64>,
        v: PyReadonlyArray2<'py, f64>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let quantity = Quantity::named(quantity)
            .ok_or_else(|| PyValueError::new_err(format!("there is no quantity '{quantity}'")))?;
        let (q, v, u) = (q.as_slice()?, v.as_slice()?, u.as_slice()?);
        let values = py.detach(|| dynamics::at_each(&self.model, quantity, q, v, u));
        Ok(PyArray1::from_vec(py, values))
    }

    /// The laboratory's motion from a state under commands, one row a step: valves' levels, joints' commands (their kind is
    /// `mode`; what follows are rates for positions). Gives rows of [`row_of`].
    #[allow(clippy::too_many_arguments)]
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        step_s: f64,
        steps: usize,
        start: PyReadonlyArray2<'py, f64>,
        levels: PyReadonlyArray2<'py, f64>,
        joints: PyReadonlyArray2<'py, f64>,
        mode: &str,
        seed: u64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let links = self.plant.link_count();
        let command: fn(f64) -> JointCommand = match mode {
            "position" => |q_rad| JointCommand::Position { q_rad, qd_rad_s: 0.0 },
            "velocity" => |qd_rad_s| JointCommand::Velocity { qd_rad_s },
            "current" => |current_a| JointCommand::Current { current_a },
            "free" => |_| JointCommand::Free,
            other => {
                let words = format!("mode '{other}' is none of position, velocity, current, free");
                return Err(PyValueError::new_err(words));
            }
        };
        let (start, levels, joints) = (start.as_slice()?, levels.as_slice()?, joints.as_slice()?);
        let (thrusters, dof) = (self.plant.thrusters.len(), 3 + links);
        let rows = py.detach(|| {
            let mut simulation = Simulation::new(&self.plant, seed)?;
            let (q, v) = start.split_at(dof);
            simulation.set_state([q[0], q[1], q[2]], [v[0], v[1], v[2]], &q[3..], &v[3..]);
            let mut rows = Vec::with_capacity((steps + 1) * (13 + 4 * links));
            row_of(&simulation.truth(), links, &mut rows);
            for step in 0..steps {
                let now_s = simulation.t_s();
                for (line, level) in levels.iter().skip(step * thrusters).take(thrusters).enumerate() {
                    simulation.set_level(line, *level, now_s);
                }
                for (joint, value) in joints.iter().skip(step * links).take(links).enumerate() {
                    simulation.set_joint(joint, command(*value));
                }
                simulation.step(step_s);
                row_of(&simulation.truth(), links, &mut rows);
            }
            Ok::<_, fss_multibody::ModelError>(rows)
        });
        Ok(PyArray1::from_vec(py, rows.map_err(|e| from_error(&e))?))
    }
}

/// Time, base pose and velocity, end-effector pose and velocity; joints' angles, rates, currents and torques.
fn row_of(truth: &Truth, links: usize, rows: &mut Vec<f64>) {
    rows.push(truth.t_s);
    for part in [&truth.base_pose, &truth.base_velocity, &truth.ee_pose, &truth.ee_velocity] {
        rows.extend_from_slice(part);
    }
    for part in [&truth.q_rad, &truth.qd_rad_s, &truth.current_a, &truth.torque_n_m] {
        rows.extend_from_slice(&part[..links]);
    }
}

/// The catalogue of effects as JSON.
#[pyfunction]
pub(crate) fn effects() -> String {
    let one = |about: &fss_plant::About| {
        let parameters =
            about.parameters.iter().map(|p| json!({ "name": p.name, "unit": p.unit, "meaning": p.meaning }));
        json!({ "id": about.id, "sentence": about.sentence, "index": about.index.name(), "parameters": parameters.collect::<Vec<_>>() })
    };
    json!(catalogue().iter().map(|kind| one(kind.about())).collect::<Vec<_>>()).to_string()
}

/// A TOML text as JSON.
#[pyfunction]
pub(crate) fn toml_to_json(text: &str) -> PyResult<String> {
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| from_error(&e))?;
    serde_json::to_string(&table).map_err(|e| from_error(&e))
}
