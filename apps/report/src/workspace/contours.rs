//! Bands of colour for a field over the plane.

use crate::drawing::plane::Plot;
use std::fmt::Write;

/// Viridis (S. van der Walt and N. Smith, 2015) in ten steps, dark for little.
pub(super) const COLOURS: [&str; 10] =
    ["#482475", "#414487", "#355f8d", "#2a788e", "#21918c", "#22a884", "#44bf70", "#7ad151", "#bddf26", "#fde725"];

/// Values at the corners of square cells: `values[row][column]` at `x0 + column * side, y0 + row * side`.
pub(super) struct Field {
    /// Lower left corner, m.
    pub corner_m: [f64; 2],
    /// Side of a cell, m.
    pub side_m: f64,
    /// Rows from below.
    pub values: Vec<Vec<f64>>,
}

impl Field {
    /// The bands as SVG: where the field is above `level[k]` in colour `k`, each over those below it.
    pub(super) fn bands(&self, plot: &Plot, levels: &[f64]) -> String {
        let mut svg = String::new();
        for (level, colour) in levels.iter().zip(COLOURS) {
            let mut d = String::new();
            for row in 0..self.values.len().saturating_sub(1) {
                self.row_above(row, *level, plot, &mut d);
            }
            // A hair of outline closes the seams between the pieces.
            let _ = write!(svg, "<path d=\"{d}\" fill=\"{colour}\" stroke=\"{colour}\" stroke-width=\"0.6\"/>");
        }
        svg
    }

    /// The parts above the level of the cells of one row; whole neighbours as one rectangle.
    fn row_above(&self, row: usize, level: f64, plot: &Plot, d: &mut String) {
        let columns = self.values[row].len() - 1;
        let mut whole_from = None;
        for column in 0..=columns {
            let corners = (column < columns).then(|| {
                [(0, 0), (0, 1), (1, 1), (1, 0)].map(|(up, right)| {
                    let (r, c) = (row + up, column + right);
                    (self.place(r as f64, c as f64), self.values[r][c] - level)
                })
            });
            let whole = corners.is_some_and(|corners| corners.iter().all(|corner| corner.1 >= 0.0));
            if whole {
                whole_from.get_or_insert(column);
                continue;
            }
            if let Some(from) = whole_from.take() {
                let (low, high) = (row as f64, row as f64 + 1.0);
                let (left, right) = (from as f64, column as f64);
                write_polygon(
                    d,
                    plot,
                    &[(low, left), (low, right), (high, right), (high, left)].map(|(r, c)| self.place(r, c)),
                );
            }
            if let Some(corners) = corners {
                write_polygon(d, plot, &above(&corners));
            }
        }
    }

    fn place(&self, row: f64, column: f64) -> [f64; 2] {
        [self.corner_m[0] + column * self.side_m, self.corner_m[1] + row * self.side_m]
    }
}

/// The part of a cell where the field is not negative, straight between the crossings of its sides.
fn above(corners: &[([f64; 2], f64); 4]) -> Vec<[f64; 2]> {
    let mut points = Vec::with_capacity(6);
    for (i, (here, value)) in corners.iter().enumerate() {
        let (next, next_value) = corners[(i + 1) % 4];
        if *value >= 0.0 {
            points.push(*here);
        }
        if (*value >= 0.0) != (next_value >= 0.0) {
            let share = value / (value - next_value);
            points.push([here[0] + share * (next[0] - here[0]), here[1] + share * (next[1] - here[1])]);
        }
    }
    points
}

fn write_polygon(d: &mut String, plot: &Plot, points: &[[f64; 2]]) {
    for (i, point) in points.iter().enumerate() {
        let [x, y] = plot.at(*point);
        let _ = write!(d, "{}{x:.1} {y:.1}", if i == 0 { "M" } else { "L" });
    }
    if !points.is_empty() {
        d.push('Z');
    }
}
