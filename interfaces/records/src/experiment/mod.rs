//! Measured experiments in the format `fss-experiment/1`: one folder a run, plain CSV, SI units, angles in radians.
//!
//! A missing file means that the channel was not measured, and columns may be missing; what is there must be whole:
//! a file that is malformed is refused with its row and column.

mod table;

pub use table::Table;

use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Why an experiment could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The file system refused.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file does not say what it should.
    #[error("{path}:{row}: column '{column}': {reason}", path = path.display())]
    Cell {
        /// The file.
        path: PathBuf,
        /// The line in the file, the heading being line 1.
        row: usize,
        /// The column's name.
        column: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// `run.toml` is malformed, or a file must not be there.
    #[error("{path}: {reason}", path = path.display())]
    Description {
        /// The file.
        path: PathBuf,
        /// What is wrong and where.
        reason: String,
    },
}

/// What the joints' drivers were told to follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JointMode {
    /// Angles.
    Position,
    /// Rates.
    Velocity,
    /// Currents.
    Current,
    /// Nothing: the joints are not driven.
    None,
}

#[derive(Deserialize)]
struct Description {
    format: String,
    name: String,
    duration_s: Option<f64>,
    joint_mode: Option<JointMode>,
}

/// The format that this module reads.
const FORMAT: &str = "fss-experiment/1";

/// One run of an experiment; a channel that was not measured is `None`.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// The run's folder.
    pub folder: PathBuf,
    /// What was done.
    pub name: String,
    /// How long it took, s, where `run.toml` says so.
    pub duration_s: Option<f64>,
    /// What the drivers followed; none where `run.toml` does not say.
    pub joint_mode: JointMode,
    /// `x_m, y_m, theta_rad` of the base frame in the table frame; theta unwrapped.
    pub base_pose: Option<Table>,
    /// The same of the end-effector.
    pub ee_pose: Option<Table>,
    /// `rate_rad_s` of the base.
    pub gyro: Option<Table>,
    /// `q1_rad.., qd1_rad_s.., current1_A.., torque1_Nm..`, as far as they were measured; angles unwrapped.
    pub joints: Option<Table>,
    /// `q1_rad..` that the drivers were told.
    pub joint_command: Option<Table>,
    /// `v1..`, 1 is open, held until the next row.
    pub valves: Option<Table>,
    /// `u1..`, levels of proportional thrusters, 0 to 1, held until the next row; in place of [`Experiment::valves`].
    pub thrust_level: Option<Table>,
}

impl Experiment {
    /// Reads a run's folder.
    ///
    /// # Errors
    /// Names the file, the row and the column.
    pub fn read(folder: &Path) -> Result<Self, ExperimentError> {
        let path = folder.join("run.toml");
        let text =
            std::fs::read_to_string(&path).map_err(|source| ExperimentError::File { path: path.clone(), source })?;
        let refuse = |reason: String| ExperimentError::Description { path: path.clone(), reason };
        let description: Description = toml::from_str(&text).map_err(|e| refuse(e.to_string()))?;
        if description.format != FORMAT {
            return Err(refuse(format!("format = \"{}\": this reader knows \"{FORMAT}\"", description.format)));
        }
        let table = |name: &str| Table::read(&folder.join(name));
        let pose = |name: &str| {
            table(name).map(|table| {
                table.map(|mut table| {
                    table.unwrap_angles("theta_rad");
                    table
                })
            })
        };
        // Angles may wrap at half a turn: those of joints too.
        let angles = |name: &str| {
            table(name).map(|table| {
                table.map(|mut table| {
                    for i in 1..=table.numbered("q", "_rad").len() {
                        table.unwrap_angles(&format!("q{i}_rad"));
                    }
                    table
                })
            })
        };
        let (valves, thrust_level) = (table("valves.csv")?, thrust_level(folder)?);
        if valves.is_some() && thrust_level.is_some() {
            let reason = "valves.csv is there too, and both say what the thrusters were told; remove valves.csv where \
                          thrusters are proportional, else this file"
                .to_owned();
            return Err(ExperimentError::Description { path: folder.join(THRUST_LEVEL), reason });
        }
        Ok(Self {
            folder: folder.to_owned(),
            name: description.name,
            duration_s: description.duration_s,
            joint_mode: description.joint_mode.unwrap_or(JointMode::None),
            base_pose: pose("base_pose.csv")?,
            ee_pose: pose("ee_pose.csv")?,
            gyro: table("gyro.csv")?,
            joints: angles("joints.csv")?,
            joint_command: angles("joint_command.csv")?,
            valves,
            thrust_level,
        })
    }
}

/// The file of commanded levels.
const THRUST_LEVEL: &str = "thrust_level.csv";

/// Levels of all thrusters: `u1`, `u2` and so on without a gap, nothing else, each between 0 and 1.
fn thrust_level(folder: &Path) -> Result<Option<Table>, ExperimentError> {
    let path = folder.join(THRUST_LEVEL);
    let outside = |column: &str, value: f64| {
        (column != "t_s" && !(0.0..=1.0).contains(&value))
            .then(|| format!("{value} is no level; a level is a fraction between 0 and 1, not a percentage"))
    };
    let Some(table) = Table::read_within(&path, &outside)? else { return Ok(None) };
    let levels = table.numbered("u", "").len();
    if levels == 0 || levels < table.width() {
        let reason = "the columns are t_s, u1, u2 and so on, one for each thruster, and this one is missing".to_owned();
        return Err(ExperimentError::Cell { path, row: 1, column: format!("u{}", levels + 1), reason });
    }
    Ok(Some(table))
}

#[cfg(test)]
mod tests;
