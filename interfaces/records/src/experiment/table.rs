//! One CSV file: a heading, times that increase, finite numbers.

use super::ExperimentError;
use std::f64::consts::TAU;
use std::path::Path;

/// Why a value must not stand in a column, if it must not.
type Refused<'a> = &'a dyn Fn(&str, f64) -> Option<String>;

/// A file's columns over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Times of the rows, s.
    pub t_s: Vec<f64>,
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
}

impl Table {
    /// Reads a file; `None` where there is none.
    ///
    /// # Errors
    /// Names the row and the column that cannot be read.
    pub fn read(path: &Path) -> Result<Option<Self>, ExperimentError> {
        Self::read_within(path, &|_, _| None)
    }

    /// The same where `refused` tells, from a column's name and a value, why the value must not stand there.
    pub(super) fn read_within(path: &Path, refused: Refused) -> Result<Option<Self>, ExperimentError> {
        match std::fs::read(path) {
            // What is no UTF-8 is refused where it stands, as no number.
            Ok(bytes) => Self::parse_within(path, &String::from_utf8_lossy(&bytes), refused).map(Some),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(ExperimentError::File { path: path.to_owned(), source }),
        }
    }

    /// Reads a file's text; `path` is for errors.
    ///
    /// # Errors
    /// Names the row and the column that cannot be read.
    pub fn parse(path: &Path, text: &str) -> Result<Self, ExperimentError> {
        Self::parse_within(path, text, &|_, _| None)
    }

    fn parse_within(path: &Path, text: &str, refused: Refused) -> Result<Self, ExperimentError> {
        let refuse = |row: usize, column: &str, reason: &str| ExperimentError::Cell {
            path: path.to_owned(),
            row,
            column: column.to_owned(),
            reason: reason.to_owned(),
        };
        // Spreadsheets put a byte order mark before UTF-8.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let Some((_, heading)) = lines.next() else {
            return Err(refuse(1, "t_s", "the file is empty; its first line names the columns"));
        };
        let names: Vec<String> = heading.split(',').map(|name| name.trim().to_owned()).collect();
        if names[0] != "t_s" {
            return Err(refuse(1, &names[0], "the first column must be t_s, in UTF-8 text"));
        }
        if let Some(twice) = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
            return Err(refuse(1, twice.1, "the column stands there twice"));
        }
        let mut columns = vec![Vec::new(); names.len()];
        for (i, line) in lines {
            let row = i + 1;
            let mut cells = line.split(',');
            for (name, column) in names.iter().zip(&mut columns) {
                let cell = cells.next().ok_or_else(|| refuse(row, name, "the row ends before this column"))?.trim();
                let value: f64 = cell.parse().map_err(|_| refuse(row, name, &format!("'{cell}' is no number")))?;
                if !value.is_finite() {
                    return Err(refuse(
                        row,
                        name,
                        &format!("'{cell}' is not finite; leave out rows that were not measured"),
                    ));
                }
                if let Some(reason) = refused(name, value) {
                    return Err(refuse(row, name, &reason));
                }
                column.push(value);
            }
            if cells.next().is_some() {
                return Err(refuse(row, &names[names.len() - 1], "the row goes on behind the last column"));
            }
            let t_s = &columns[0];
            if t_s.len() > 1 && t_s[t_s.len() - 1] <= t_s[t_s.len() - 2] {
                return Err(refuse(row, "t_s", "time does not increase"));
            }
        }
        let t_s = columns.remove(0);
        Ok(Self { t_s, names: names[1..].to_vec(), columns })
    }

    /// A column by its name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.names.iter().position(|n| n == name).map(|i| self.columns[i].as_slice())
    }

    /// The columns' names, that of the times left out.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The columns `prefix1suffix`, `prefix2suffix` and so on, as many as there are without a gap.
    pub fn numbered(&self, prefix: &str, suffix: &str) -> Vec<&[f64]> {
        (1..).map_while(|i| self.column(&format!("{prefix}{i}{suffix}"))).collect()
    }

    /// How many columns there are beside the times.
    pub fn width(&self) -> usize {
        self.columns.len()
    }

    /// How many rows there are.
    pub fn len(&self) -> usize {
        self.t_s.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.t_s.is_empty()
    }

    /// Takes out the jumps by a turn that an angle makes where it is wrapped.
    pub(super) fn unwrap_angles(&mut self, name: &str) {
        if let Some(i) = self.names.iter().position(|n| n == name) {
            let column = &mut self.columns[i];
            for k in 1..column.len() {
                let step = column[k] - column[k - 1];
                column[k] -= TAU * (step / TAU).round();
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        Table::parse(Path::new("gyro.csv"), text).unwrap_err().to_string()
    }

    #[test]
    fn a_malformed_file_is_refused_with_its_row_and_column() {
        assert!(
            refused("t_s,rate_rad_s\n0,1\n0.1,x\n").starts_with("gyro.csv:3: column 'rate_rad_s': 'x' is no number")
        );
        assert!(refused("t_s,rate_rad_s\n0,1\n0,2\n").contains("gyro.csv:3: column 't_s'"));
        assert!(refused("t_s,rate_rad_s\n0\n").contains("gyro.csv:2: column 'rate_rad_s'"));
        assert!(refused("t_s,rate_rad_s\n0,NaN\n").contains("not finite"));
        assert!(refused("rate_rad_s\n0\n").contains("first column must be t_s"));
        assert!(refused("").contains("empty"));
    }

    #[test]
    fn a_wrapped_angle_is_unwrapped() {
        let mut table = Table::parse(Path::new("p.csv"), "t_s,theta_rad\n0,3.1\n1,-3.1\n2,-2.9\n").unwrap();
        table.unwrap_angles("theta_rad");
        let theta = table.column("theta_rad").unwrap();
        assert!((theta[1] - (TAU - 3.1)).abs() < 1e-12 && (theta[2] - (TAU - 2.9)).abs() < 1e-12);
    }

    #[test]
    fn missing_columns_end_the_numbering() {
        let table = Table::parse(Path::new("j.csv"), "t_s,q1_rad,q2_rad,qd1_rad_s\n0,1,2,3\n").unwrap();
        assert_eq!(table.numbered("q", "_rad").len(), 2);
        assert_eq!(table.numbered("qd", "_rad_s"), [&[3.0]]);
        assert!(table.numbered("torque", "_Nm").is_empty());
    }
}
