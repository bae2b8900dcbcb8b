//! What a flight leaves in its folder: figures, a picture, and the plant file that it calibrated.

use crate::calibrate::{self, Calibrated};
use crate::drawing::scene::Table;
use crate::picture;
use fss_bus::Service;
use fss_calibration::Calibration;
use fss_launcher::fast;
use fss_launcher::files::write_silently;
use fss_launcher::stack::{LOG_FILE, Stack};
use fss_launcher::summary::{self, Records, Summary};
use fss_messages::MissionState;
use fss_records::log::Log;
use miette::{IntoDiagnostic, Result, WrapErr};
use std::path::Path;

/// The plant file that a flight with the service `calibration` leaves in its folder.
const CALIBRATED_FILE: &str = "calibrated.toml";

/// Flies a mission on a virtual clock into a folder, as `fss run --fast` does, and says what happened.
pub fn fly_fast(stack: &Stack, folder: &Path, seed: u64) -> Result<Summary> {
    std::fs::create_dir_all(folder).into_diagnostic().wrap_err_with(|| format!("cannot make {}", folder.display()))?;
    stack.write_to(folder)?;
    fast::fly(stack, stack.laboratory(), &folder.join(LOG_FILE), seed, |_| ())?;
    conclude(stack, folder, None)
}

/// Writes what a flight whose log lies in `folder` has come to, and says it. `ended` is how the mission ended, where the
/// log may not know.
///
/// # Errors
/// Where the log cannot be read, or the folder refuses.
pub fn conclude(stack: &Stack, folder: &Path, ended: Option<&MissionState>) -> Result<Summary> {
    let log = Log::open(&folder.join(LOG_FILE)).into_diagnostic()?;
    let records = Records::of(&log, &stack.launch.vehicle).into_diagnostic()?;
    let mut summary = records.summary_of(stack);
    if let Some(mission) = ended {
        // The first log knows nothing of what came after its recorder's death.
        summary.outcome = summary::outcome(&[*mission]);
    }
    // The services have ended: what the estimate takes of this computer is nobody's time.
    let calibrates = stack.launch.schedule(Calibration::NAME).is_some() && summary.outcome == "done";
    let calibrated = calibrates.then(|| calibrate::of_log(&folder.join(LOG_FILE), &stack.plant)).transpose()?;
    summary.calibration = calibrated.as_ref().map(Calibrated::json);
    let write = |name: &str, text: String| write_silently(&folder.join(name), &text);
    write("summary.json", serde_json::to_string_pretty(&summary).into_diagnostic()?)?;
    let model = stack.plant.nominal().model().into_diagnostic()?;
    let title = format!("{}: {}", stack.mission_name, stack.mission.description);
    let target = stack.mission.target.as_ref().map(|target| &target.body);
    let table = Table { plant: &stack.plant, model: &model, target };
    if let Some(svg) = picture::render(&table, &title, records.flown(), records.arm()) {
        write("run.svg", svg)?;
    }
    summary.print();
    say!("log                {}", folder.join(LOG_FILE).display());
    if let Some(calibrated) = calibrated {
        say_part!("calibration        ");
        calibrated.print();
        calibrated.write(&stack.plant, &folder.join(CALIBRATED_FILE))?;
    }
    Ok(summary)
}
