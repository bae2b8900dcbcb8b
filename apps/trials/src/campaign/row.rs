//! What a campaign keeps of a run.

use super::definition::Campaign;
use fss_launcher::fast;
use fss_launcher::summary::Summary;
use fss_records::table::{Column, ParquetFile, Table, TableFile, Values};
use miette::{IntoDiagnostic, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// A run whose files make no sense together: it was not flown.
const REFUSED: &str = "refused";

/// One run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    /// Its number, from 1.
    pub run: u64,
    /// Seed of everything random in its laboratory.
    pub seed: u64,
    /// Swept values, in the order of the campaign's sweeps.
    pub swept: Vec<f64>,
    /// `done`, `aborted`, `unfinished`, or `refused` where it was not flown.
    pub outcome: String,
    /// Whether the mission was done, with its target where it has one.
    pub success: bool,
    /// Why it did not succeed; empty where it did.
    pub reason: String,
    /// In the order of [`FIGURES`]; `None` where the mission has no such figure.
    pub figures: Vec<Option<f64>>,
    /// How long it took to fly, s.
    pub wall_time_s: f64,
}

/// A figure of merit, taken from a run's summary.
type Figure = (&'static str, fn(&Summary) -> Option<f64>);

/// Figures of merit, named as in `summary.json`.
pub(super) const FIGURES: &[Figure] = &[
    ("duration_s", |s| Some(s.duration_s)),
    ("base_rotation_end_deg", |s| s.base_rotation_deg.as_ref().map(|r| r.end_deg)),
    ("base_rotation_max_deg", |s| s.base_rotation_deg.as_ref().map(|r| r.max_deg)),
    ("end_effector_moved_m", |s| s.end_effector.as_ref().map(|e| e.moved_m)),
    ("end_effector_final_error_m", |s| s.end_effector.as_ref()?.final_error_m),
    ("end_effector_max_error_m", |s| s.end_effector.as_ref()?.max_error_m),
    ("navigation_position_rms_m", |s| s.navigation.as_ref().map(|n| n.position_rms_m)),
    ("navigation_position_max_m", |s| s.navigation.as_ref().map(|n| n.position_max_m)),
    ("navigation_heading_rms_deg", |s| s.navigation.as_ref().map(|n| n.heading_rms_deg)),
    ("gas_used_kg", |s| s.gas_used_kg),
    ("stop_gas_used_kg", |s| s.stop.as_ref().map(|s| s.gas_used_kg)),
    ("stop_least_gas_kg", |s| s.stop.as_ref().map(|s| s.least_gas_kg)),
    ("stop_ratio", |s| s.stop.as_ref().map(|s| s.ratio)),
    ("stop_speed_start_m_s", |s| s.stop.as_ref().map(|s| s.speed_m_s[0])),
    ("stop_speed_end_m_s", |s| s.stop.as_ref().map(|s| s.speed_m_s[1])),
    ("stop_rate_start_deg_s", |s| s.stop.as_ref().map(|s| s.rate_deg_s[0])),
    ("stop_rate_end_deg_s", |s| s.stop.as_ref().map(|s| s.rate_deg_s[1])),
    ("capture_miss_m", |s| s.capture.as_ref()?.miss_m),
    ("capture_contact_speed_m_s", |s| s.capture.as_ref()?.contact_speed_m_s),
    ("capture_base_turned_deg", |s| s.capture.as_ref()?.base_turned_deg),
    ("capture_room_on_table_m", |s| s.capture.as_ref().map(|c| c.room_on_table_m)),
    ("carry_deviation_rms_m", |s| s.carry.as_ref().map(|c| c.deviation_rms_m)),
    ("carry_deviation_max_m", |s| s.carry.as_ref().map(|c| c.deviation_max_m)),
    ("carry_placed_error_m", |s| s.carry.as_ref()?.placed_error_m),
    ("carry_placed_error_deg", |s| s.carry.as_ref()?.placed_error_deg),
    ("carry_left_speed_m_s", |s| s.carry.as_ref()?.left_speed_m_s),
    ("carry_left_rate_deg_s", |s| s.carry.as_ref()?.left_rate_deg_s),
    ("carry_gas_used_kg", |s| s.carry.as_ref().map(|c| c.gas_used_kg)),
];

/// Flies a run of a campaign.
///
/// # Errors
/// Where this computer does not let it fly; that its values make no sense is a row as another.
pub(super) fn fly(campaign: &Campaign, run: u64) -> Result<Row> {
    let start = Instant::now();
    let (seed, stack) = match campaign.stack(run) {
        Ok(found) => found,
        Err(refusal) => return Ok(Row::refused(campaign, run, &refusal)),
    };
    let summary = fast::fly_unrecorded(&stack, seed)?.summary_of(&stack);
    Ok(Row::of(campaign, run, &summary, start.elapsed().as_secs_f64()))
}

impl Row {
    /// Of a flight.
    pub(super) fn of(campaign: &Campaign, run: u64, summary: &Summary, wall_time_s: f64) -> Self {
        let missed = summary.capture.as_ref().is_some_and(|capture| !capture.success);
        let misplaced = summary.carry.as_ref().is_some_and(|carry| !carry.success);
        let success = summary.outcome == "done" && !missed && !misplaced;
        let reason = match (success, summary.warnings.last()) {
            (true, _) => String::new(),
            (false, Some(warning)) => warning.clone(),
            (false, None) if missed => "the target is not held".to_owned(),
            (false, None) if misplaced => "the target was not left where it was carried to".to_owned(),
            (false, None) => "the mission did not end in its time".to_owned(),
        };
        Self {
            outcome: summary.outcome.to_owned(),
            success,
            reason,
            // What is no finite number is no figure; the journal could not hold it.
            figures: FIGURES.iter().map(|(_, figure)| figure(summary).filter(|f| f.is_finite())).collect(),
            wall_time_s,
            ..Self::named(campaign, run)
        }
    }

    fn refused(campaign: &Campaign, run: u64, refusal: &miette::Report) -> Self {
        let reason = refusal.chain().map(ToString::to_string).collect::<Vec<_>>().join(": ");
        Self { outcome: REFUSED.to_owned(), reason, ..Self::named(campaign, run) }
    }

    fn named(campaign: &Campaign, run: u64) -> Self {
        Self {
            run,
            seed: campaign.seed(run),
            swept: campaign.point(run).iter().map(|swept| swept.value).collect(),
            outcome: String::new(),
            success: false,
            reason: String::new(),
            figures: vec![None; FIGURES.len()],
            wall_time_s: 0.0,
        }
    }
}

/// Writes rows as a Parquet file, which is there whole or not at all.
pub(super) fn write_table<'a>(campaign: &Campaign, rows: impl Iterator<Item = &'a Row>, path: &Path) -> Result<()> {
    let table = table(campaign, &rows.collect::<Vec<_>>());
    let part = path.with_extension("parquet.part");
    let mut file = ParquetFile::create(&part, &table).into_diagnostic()?;
    file.append(&table).into_diagnostic()?;
    file.finish().into_diagnostic()?;
    std::fs::rename(&part, path).into_diagnostic()
}

/// A row as an object with the table's names.
pub(super) fn object(campaign: &Campaign, row: &Row) -> Value {
    let value = |values: &Values| match values {
        Values::Bool(v) => json!(v[0]),
        Values::U64(v) => json!(v[0]),
        Values::F64(v) => json!(v[0]),
        Values::Known(v) => json!(v[0]),
        Values::Text(v) => json!(v[0]),
        // The table has no column of these.
        Values::U8(_) | Values::U16(_) | Values::U32(_) | Values::I64(_) => Value::Null,
    };
    let columns = table(campaign, &[row]).columns;
    Value::Object(columns.iter().map(|column| (column.name.clone(), value(&column.values))).collect())
}

fn table(campaign: &Campaign, rows: &[&Row]) -> Table {
    fn all<T>(rows: &[&Row], value: impl Fn(&Row) -> T) -> Vec<T> {
        rows.iter().map(|row| value(row)).collect()
    }
    let mut columns = vec![
        Column::new("run", Values::U64(all(rows, |row| row.run))),
        Column::new("seed", Values::U64(all(rows, |row| row.seed))),
    ];
    for (i, sweep) in campaign.sweeps.iter().enumerate() {
        columns.push(Column::new(&sweep.key, Values::F64(all(rows, |row| row.swept[i]))));
    }
    columns.push(Column::new("outcome", Values::Text(all(rows, |row| row.outcome.clone()))));
    columns.push(Column::new("success", Values::Bool(all(rows, |row| row.success))));
    columns.push(Column::new("reason", Values::Text(all(rows, |row| row.reason.clone()))));
    for (i, (name, _)) in FIGURES.iter().enumerate() {
        columns.push(Column::new(*name, Values::Known(all(rows, |row| row.figures[i]))));
    }
    columns.push(Column::new("wall_time_s", Values::F64(all(rows, |row| row.wall_time_s))));
    Table { columns }
}
