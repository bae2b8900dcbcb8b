//! A stack as its three files describe it: launch file, plant file, mission file.

use crate::files::{TextFile, write_silently};
use crate::programs;
use fss_bus::launch::{GROUND, Launch, SERVICES};
use fss_lab::{Faults, LabConfig};
use fss_messages::MissionState;
use fss_mission::Mission;
use fss_plant::Plant;
use fss_records::log::Log;
use fss_service::{LAUNCH_FILE, MISSION_FILE, PLANT_FILE, PROGRAMS_FILE, ProgramEntry, read_programs};
use fss_wire::link::Key;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// Mean time between two faults that a seed draws, s.
pub const FAULT_EVERY_S: f64 = 4.0;
/// The log's name in a run's folder.
pub const LOG_FILE: &str = "run.mcap";

/// Missions that come with the program.
pub const MISSIONS: &[(&str, &str)] = &[
    ("hold", include_str!("../../../deploy/etc/missions/hold.toml")),
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
const DEFAULT_PLANT: &str = include_str!("../../../deploy/etc/plants/fss.toml");

const FAULTS_FILE: &str = "faults.toml";
/// The laboratory's own plant file, which may be another than the services believe.
pub const LABORATORY_FILE: &str = "laboratory.toml";

/// A stack's files and what they say.
#[derive(Clone)]
pub struct Stack {
    /// Rates, priorities, devices.
    pub launch: Launch,
    /// The vehicle and its laboratory.
    pub plant: Plant,
    /// Services that were written elsewhere, as they describe themselves.
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
    laboratory: Option<(Plant, String)>,
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
    /// Reads and checks the files; the program's own where none is named.
    ///
    /// # Errors
    /// Names the file, the line and what to do.
    pub fn load(launch: Option<&Path>, plant: Option<&Path>, mission: &str) -> Result<Self> {
        let launch_file = file_or(launch, "launch file", "lab.toml", DEFAULT_LAUNCH)?;
        let plant_file = file_or(plant, "plant file", "fss.toml", DEFAULT_PLANT)?;
        let (mission_name, mission_file) = mission_file(mission)?;
        let mut stack = Self::parse(&launch_file, &plant_file, &mission_file, mission_name)?;
        stack.programs = programs::find(&stack.launch, &launch_file)?;
        Ok(stack)
    }

    /// Reads the files that a launcher left in a run's folder.
    ///
    /// # Errors
    /// Names the file, the line and what to do.
    pub fn in_folder(folder: &Path) -> Result<Self> {
        let read = |name: &str, what| TextFile::read(&folder.join(name), what);
        let mut stack = Self::parse(
            &read(LAUNCH_FILE, "launch file")?,
            &read(PLANT_FILE, "plant file")?,
            &read(MISSION_FILE, "mission file")?,
            String::new(),
        )?;
        stack.programs = read_programs(folder)?;
        let faults = folder.join(FAULTS_FILE);
        let stack = if faults.exists() { stack.with_faults(&TextFile::read(&faults, "fault file")?)? } else { stack };
        let laboratory = folder.join(LABORATORY_FILE);
        if laboratory.exists() { stack.in_laboratory(&laboratory) } else { Ok(stack) }
    }

    /// Reads the files that a log holds.
    ///
    /// # Errors
    /// Where one is missing or makes no sense.
    pub fn of_log(log: &Log) -> Result<Self> {
        let read = |name: &str| -> Result<TextFile> {
            let text = log.attachment(name).into_diagnostic()?;
            let text = text.ok_or_else(|| miette!("{} holds no {name}", log.path().display()))?;
            Ok(TextFile { path: log.path().join(name), text })
        };
        let mut stack = Self::parse(&read(LAUNCH_FILE)?, &read(PLANT_FILE)?, &read(MISSION_FILE)?, String::new())?;
        if let Some(text) = log.attachment(PROGRAMS_FILE).into_diagnostic()? {
            stack.programs = serde_json::from_str(&text).into_diagnostic().wrap_err(PROGRAMS_FILE)?;
        }
        stack.mission_name.clone_from(&stack.mission.name);
        match log.attachment(LABORATORY_FILE).into_diagnostic()? {
            Some(text) => stack.with_laboratory(TextFile { path: log.path().join(LABORATORY_FILE), text }),
            None => Ok(stack),
        }
    }

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
            files.push((PROGRAMS_FILE, programs::to_text(&self.programs)?));
        }
        Ok(files)
    }

    /// The same with what a fault file says.
    ///
    /// # Errors
    /// Names the file, the line and what to do.
    pub fn with_faults(self, file: &TextFile) -> Result<Self> {
        let faults = checked_faults(toml::from_str(&file.text), file, &self.plant)?;
        Ok(Self { faults, ..self })
    }

    fn parse(
        launch_file: &TextFile,
        plant_file: &TextFile,
        mission_file: &TextFile,
        mission_name: String,
    ) -> Result<Self> {
        let launch =
            Launch::parse(&launch_file.text, SERVICES).map_err(|e| launch_file.error(e.message, e.help, e.span))?;
        let launch = asked_for(launch, launch_file, mission_file)?;
        let mut plant =
            Plant::parse(&plant_file.text).map_err(|e| plant_file.error(e.message, e.help, Some(e.span)))?;
        let mission = Mission::parse_for(&mission_file.text, &plant)
            .map_err(|e| mission_file.error(e.message, e.help, Some(e.span)))?;
        bring_target(&mut plant, &mission);
        if launch.devices.links.len() != plant.link_count() {
            let message = format!(
                "the launch file gives {} link addresses, but the plant has {} links",
                launch.devices.links.len(),
                plant.link_count()
            );
            let help =
                format!("give [devices] links = [...] one address for each [[link]] of {}", plant_file.path.display());
            return Err(launch_file.error(message, help, None));
        }
        let faults = checked_faults(Faults::in_mission(&mission_file.text), mission_file, &plant)?;
        Ok(Self {
            launch,
            plant,
            programs: Vec::new(),
            mission,
            faults,
            mission_name,
            launch_text: launch_file.text.clone(),
            plant_text: plant_file.text.clone(),
            mission_text: mission_file.text.clone(),
            laboratory: None,
        })
    }

    /// The same in a laboratory of its own, which the services do not know.
    ///
    /// # Errors
    /// Names the file, the line and what to do.
    pub fn in_laboratory(self, path: &Path) -> Result<Self> {
        self.with_laboratory(TextFile::read(path, "laboratory's plant file")?)
    }

    fn with_laboratory(mut self, file: TextFile) -> Result<Self> {
        let mut plant = Plant::parse(&file.text).map_err(|e| file.error(e.message, e.help, Some(e.span)))?;
        bring_target(&mut plant, &self.mission);
        let count = |plant: &Plant| (plant.link_count(), plant.thrusters.len());
        if count(&plant) != count(&self.plant) {
            let message = "the laboratory has other links or thrusters than the plant".to_owned();
            let help = "give the laboratory as many [[link]] and [[thruster]] tables as the plant file has".to_owned();
            return Err(file.error(message, help, None));
        }
        self.laboratory = Some((plant, file.text));
        Ok(self)
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

    /// The same with other texts of its plant, mission and laboratory; `change` says in errors what is other.
    ///
    /// # Errors
    /// Where they make no sense, with the line and what to do.
    pub fn with_texts(&self, texts: Texts, change: &str) -> Result<Self> {
        let file = |name: &str, text: String| TextFile { path: PathBuf::from(format!("{name} with {change}")), text };
        let launch = TextFile { path: PathBuf::from(LAUNCH_FILE), text: self.launch_text.clone() };
        let (plant, mission) = (file(PLANT_FILE, texts.plant), file(MISSION_FILE, texts.mission));
        let mut stack = Self::parse(&launch, &plant, &mission, self.mission_name.clone())?;
        stack.programs.clone_from(&self.programs);
        match texts.laboratory {
            Some(text) => stack.with_laboratory(file(LABORATORY_FILE, text)),
            None => Ok(stack),
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
        write_silently(&programs, &programs::to_text(&self.programs)?)
    }
}

/// What a mission asks of the launcher.
#[derive(Deserialize)]
struct Demand {
    #[serde(default)]
    services: Vec<Spanned<String>>,
}

/// The launch file without the services on demand that the mission does not ask for.
fn asked_for(mut launch: Launch, launch_file: &TextFile, mission_file: &TextFile) -> Result<Launch> {
    let demand: Demand = toml::from_str(&mission_file.text).map_err(|e| {
        let help = "services = [\"calibration\"] asks for services that the launch file has on demand".to_owned();
        mission_file.error(e.message().to_owned(), help, e.span())
    })?;
    for service in &demand.services {
        if launch.schedule(service.get_ref()).is_none() {
            let message = format!("the mission asks for the service '{}', which is not launched", service.get_ref());
            let help = format!("add a [[service]] of that name with its rate_hz to {}", launch_file.path.display());
            return Err(mission_file.error(message, help, Some(service.span())));
        }
    }
    let serves = launch.ground.is_some();
    if serves && launch.schedule(GROUND).is_none() {
        let help = "add a [[service]] with name = \"ground\" and its rate_hz, or remove [ground]".to_owned();
        return Err(launch_file.error(
            "[ground] says where to listen, but there is no such service".to_owned(),
            help,
            None,
        ));
    }
    launch.services.retain(|schedule| {
        let is_it = |service: &Spanned<String>| service.get_ref() == schedule.name.get_ref();
        let asked = !schedule.on_demand || demand.services.iter().any(is_it);
        asked && (serves || schedule.name.get_ref() != GROUND)
    });
    Ok(launch)
}

/// A mission brings the target that it captures onto the table.
fn bring_target(plant: &mut Plant, mission: &Mission) {
    if let Some(target) = &mission.target {
        plant.target = Some(target.body.clone());
    }
}

/// Faults as a file says them, where they make sense with this plant.
fn checked_faults(said: Result<Faults, toml::de::Error>, file: &TextFile, plant: &Plant) -> Result<Faults> {
    let faults = said.map_err(|e| {
        let help = "faults are [network.NAME] tables and [[fault]] tables with from_s, to_s and kind".to_owned();
        file.error(e.message().to_owned(), help, e.span())
    })?;
    let key = Key::new(&[1; 32]).into_diagnostic()?;
    faults.check(plant, &LabConfig::new(0, key)).map_err(|e| file.error(e.to_string(), String::new(), None))?;
    Ok(faults)
}

fn file_or(path: Option<&Path>, what: &str, own_name: &str, own_text: &str) -> Result<TextFile> {
    match path {
        Some(path) => TextFile::read(path, what),
        None => Ok(TextFile { path: PathBuf::from(format!("built-in {own_name}")), text: own_text.to_owned() }),
    }
}

/// A mission by the name of one that comes with the program, or by its file.
fn mission_file(mission: &str) -> Result<(String, TextFile)> {
    if let Some((name, text)) = MISSIONS.iter().find(|(name, _)| *name == mission) {
        let path = PathBuf::from(format!("built-in {name}.toml"));
        return Ok(((*name).to_owned(), TextFile { path, text: (*text).to_owned() }));
    }
    let path = Path::new(mission);
    if !path.exists() {
        let names: Vec<_> = MISSIONS.iter().map(|(name, _)| *name).collect();
        miette::bail!(
            help =
                format!("the missions that come with fss are {}; or give the path of a mission file", names.join(", ")),
            "there is no mission '{mission}', neither built in nor as a file"
        );
    }
    let name = path.file_stem().map_or_else(|| mission.to_owned(), |stem| stem.to_string_lossy().into_owned());
    Ok((name, TextFile::read(path, "mission file")?))
}
