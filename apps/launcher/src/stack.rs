//! A stack as its three files describe it: launch file, plant file, mission file.

use crate::files::write_silently;
use fss_bus::launch::{Launch, Schedule};
use fss_lab::Faults;
use fss_messages::MissionState;
use fss_mission::Mission;
use fss_plant::Plant;
pub use fss_records::log::LOG_FILE;
use fss_service::{Description, LAUNCH_FILE, MISSION_FILE, PLANT_FILE, PROGRAMS_FILE, ProgramEntry, Site};
use miette::{IntoDiagnostic, Result, miette};
use std::path::Path;

/// Mean time between two faults that a seed draws, s.
pub const FAULT_EVERY_S: f64 = 4.0;

/// Missions that come with the program.
pub const MISSIONS: &[(&str, &str)] = &[
    ("hold", include_str!("../../../deploy/etc/missions/hold.toml")),
    ("follow", include_str!("../../../deploy/etc/missions/follow.toml")),
    ("slew", include_str!("../../../deploy/etc/missions/slew.toml")),
    ("reach", include_str!("../../../deploy/etc/missions/reach.toml")),
    ("zero-reaction", include_str!("../../../deploy/etc/missions/zero-reaction.toml")),
    ("detumble", include_str!("../../../deploy/etc/missions/detumble.toml")),
    ("capture", include_str!("../../../deploy/etc/missions/capture.toml")),
    ("drift", include_str!("../../../deploy/etc/missions/drift.toml")),
    ("service", include_str!("../../../deploy/etc/missions/service.toml")),
    ("calibrate", include_str!("../../../deploy/etc/missions/calibrate.toml")),
    ("experiment-coast", include_str!("../../../deploy/etc/missions/experiment-coast.toml")),
    ("experiment-single-joint", include_str!("../../../deploy/etc/missions/experiment-single-joint.toml")),
    ("experiment-excitation", include_str!("../../../deploy/etc/missions/experiment-excitation.toml")),
    ("experiment-thrusters", include_str!("../../../deploy/etc/missions/experiment-thrusters.toml")),
    ("experiment-mixed", include_str!("../../../deploy/etc/missions/experiment-mixed.toml")),
    ("experiment-validation", include_str!("../../../deploy/etc/missions/experiment-validation.toml")),
];

/// The launch file that is used where none is given.
pub const DEFAULT_LAUNCH: &str = include_str!("../../../deploy/etc/launch/lab.toml");

pub(crate) const FAULTS_FILE: &str = "faults.toml";
/// The laboratory's own plant file, which may be another than the services believe.
pub const LABORATORY_FILE: &str = "laboratory.toml";

/// A stack's files and what they say.
#[derive(Clone)]
pub struct Stack {
    /// Rates, priorities, devices.
    pub launch: Launch,
    /// The vehicle and its laboratory.
    pub plant: Plant,
    /// Services that do not come with fss, as they describe themselves.
    pub programs: Vec<ProgramEntry>,
    /// What to fly.
    pub mission: Mission,
    /// What goes wrong in the simulated laboratory: what the mission file says, unless a fault file or a seed replaces it.
    pub faults: Faults,
    /// The mission's short name.
    pub mission_name: String,
    /// The launch file's text.
    pub launch_text: String,
    /// The plant file's text.
    pub plant_text: String,
    /// The mission file's text.
    pub mission_text: String,
    /// The plant of the simulated laboratory and its file's text, where it is another.
    pub(crate) laboratory: Option<(Plant, String)>,
}

/// What a stack's files say, as far as a campaign may vary it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texts {
    /// Of the plant file.
    pub plant: String,
    /// Of the mission file.
    pub mission: String,
    /// Of the laboratory's own plant file, where it has one.
    pub laboratory: Option<String>,
}

impl Stack {
    /// The files that a log of it holds, with their names: the laboratory's where that is another than the plant, the
    /// faults where there are any.
    ///
    /// # Errors
    /// Where the faults cannot be written as text.
    pub fn attachments(&self) -> Result<Vec<(&'static str, String)>> {
        let mut files = vec![
            (PLANT_FILE, self.plant_text.clone()),
            (LAUNCH_FILE, self.launch_text.clone()),
            (MISSION_FILE, self.mission_text.clone()),
        ];
        if let Some((_, text)) = self.laboratory.as_ref().filter(|(_, text)| *text != self.plant_text) {
            files.push((LABORATORY_FILE, text.clone()));
        }
        if self.faults != Faults::default() {
            files.push((FAULTS_FILE, toml::to_string(&self.faults).into_diagnostic()?));
        }
        if !self.programs.is_empty() {
            files.push((PROGRAMS_FILE, to_text(&self.programs)?));
        }
        Ok(files)
    }

    /// When a service runs.
    ///
    /// # Errors
    /// Where the launch file does not have it.
    pub(crate) fn schedule(&self, name: &str) -> Result<&Schedule> {
        let schedule = self.launch.schedule(name);
        schedule.ok_or_else(|| miette!("the launch file has no [[service]] named '{name}'; add one with its rate_hz"))
    }

    /// The program of a service that has one of its own, and what it says of itself.
    pub(crate) fn program(&self, service: &str) -> Option<(&Path, &Description)> {
        let program = self.programs.iter().find(|program| program.description.service == service)?;
        Some((program.path.as_deref()?, &program.description))
    }

    /// What a service may know of where it flies.
    ///
    /// # Errors
    /// Where the launch file does not have it.
    pub(crate) fn site(&self, service: &str, starts: u32) -> Result<Site> {
        Ok(Site {
            rate_hz: *self.schedule(service)?.rate_hz.get_ref(),
            starts,
            vehicle: self.launch.vehicle.clone(),
            plant_text: self.plant_text.clone(),
            mission_text: self.mission_text.clone(),
        })
    }

    /// The phase that a mission is in, by the name that its file gives it.
    pub fn phase_name(&self, state: &MissionState) -> String {
        match state.state {
            MissionState::WAITING => "waiting".to_owned(),
            MissionState::DONE => "done".to_owned(),
            MissionState::ABORTED => "aborted".to_owned(),
            _ => {
                let phase = self.mission.phase(state.phase as usize);
                phase.map_or_else(|| format!("phase {}", state.phase + 1), |phase| phase.name.clone())
            }
        }
    }

    /// The texts that [`Self::with_texts`] replaces.
    pub fn texts(&self) -> Texts {
        Texts {
            plant: self.plant_text.clone(),
            mission: self.mission_text.clone(),
            laboratory: self.laboratory.as_ref().map(|(_, text)| text.clone()),
        }
    }

    /// The plant of the simulated laboratory.
    pub fn laboratory(&self) -> &Plant {
        self.laboratory.as_ref().map_or(&self.plant, |(plant, _)| plant)
    }

    /// Writes the three files into a run's folder.
    ///
    /// # Errors
    /// Where the folder refuses.
    pub fn write_to(&self, folder: &Path) -> Result<()> {
        let faults = toml::to_string(&self.faults).into_diagnostic()?;
        let files = [
            (LAUNCH_FILE, &self.launch_text),
            (PLANT_FILE, &self.plant_text),
            (MISSION_FILE, &self.mission_text),
            (FAULTS_FILE, &faults),
            (LABORATORY_FILE, self.laboratory.as_ref().map_or(&self.plant_text, |(_, text)| text)),
        ];
        files.iter().try_for_each(|(name, text)| write_silently(&folder.join(name), text))?;
        let programs = folder.join(PROGRAMS_FILE);
        if self.programs.is_empty() && !programs.exists() {
            return Ok(());
        }
        write_silently(&programs, &to_text(&self.programs)?)
    }
}

fn to_text(programs: &[ProgramEntry]) -> Result<String> {
    serde_json::to_string_pretty(programs).into_diagnostic()
}
