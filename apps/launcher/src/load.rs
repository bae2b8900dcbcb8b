//! A stack's files, read and checked: from the disk, from a run's folder, from a log.

use crate::files::TextFile;
use crate::programs;
use crate::services::names;
use crate::stack::{DEFAULT_LAUNCH, FAULTS_FILE, LABORATORY_FILE, MISSIONS, Stack, Texts};
use fss_bus::launch::{GROUND, Launch};
use fss_lab::{Faults, LabConfig};
use fss_mission::Mission;
use fss_plant::Plant;
use fss_records::log::Log;
use fss_service::{LAUNCH_FILE, MISSION_FILE, PLANT_FILE, PROGRAMS_FILE, ProgramEntry, read_programs};
use fss_wire::link::Key;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use toml::Spanned;

const DEFAULT_PLANT: &str = include_str!("../../../deploy/etc/plants/fss.toml");

impl Stack {
    /// Reads and checks the files; the program's own where none is named.
    ///
    /// # Errors
    /// Names the file, the line and what to do.
    pub fn load(launch: Option<&Path>, plant: Option<&Path>, mission: &str) -> Result<Self> {
        let launch_file = file_or(launch, "launch file", "lab.toml", DEFAULT_LAUNCH)?;
        let plant_file = file_or(plant, "plant file", "fss.toml", DEFAULT_PLANT)?;
        let (mission_name, mission_file) = mission_file(mission)?;
        let mut stack = Self::parse(&launch_file, &plant_file, &mission_file, mission_name, Vec::new())?;
        stack.programs = programs::find(&stack.launch, &launch_file)?;
        Ok(stack)
    }

    /// Reads the files that a launcher left in a run's folder.
    ///
    /// # Errors
    /// Names the file, the line and what to do.
    pub fn in_folder(folder: &Path) -> Result<Self> {
        let read = |name: &str, what| TextFile::read(&folder.join(name), what);
        let stack = Self::parse(
            &read(LAUNCH_FILE, "launch file")?,
            &read(PLANT_FILE, "plant file")?,
            &read(MISSION_FILE, "mission file")?,
            String::new(),
            read_programs(folder)?,
        )?;
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
        let programs = log.attachment(PROGRAMS_FILE).into_diagnostic()?;
        let programs = programs.map_or(Ok(Vec::new()), |text| serde_json::from_str(&text));
        let programs = programs.into_diagnostic().wrap_err(PROGRAMS_FILE)?;
        let (launch, plant, mission) = (read(LAUNCH_FILE)?, read(PLANT_FILE)?, read(MISSION_FILE)?);
        let mut stack = Self::parse(&launch, &plant, &mission, String::new(), programs)?;
        stack.mission_name.clone_from(&stack.mission.name);
        match log.attachment(LABORATORY_FILE).into_diagnostic()? {
            Some(text) => stack.with_laboratory(TextFile { path: log.path().join(LABORATORY_FILE), text }),
            None => Ok(stack),
        }
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
        programs: Vec<ProgramEntry>,
    ) -> Result<Self> {
        // Who wrote the list of programs knew their services, linked in or not.
        let mut known = names();
        known.extend(programs.iter().map(|program| program.description.service.as_str()));
        let launch =
            Launch::parse(&launch_file.text, &known).map_err(|e| launch_file.error(e.message, e.help, e.span))?;
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
            programs,
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

    /// The same with other texts of its plant, mission and laboratory; `change` says in errors what is other.
    ///
    /// # Errors
    /// Where they make no sense, with the line and what to do.
    pub fn with_texts(&self, texts: Texts, change: &str) -> Result<Self> {
        let file = |name: &str, text: String| TextFile { path: PathBuf::from(format!("{name} with {change}")), text };
        let launch = TextFile { path: PathBuf::from(LAUNCH_FILE), text: self.launch_text.clone() };
        let (plant, mission) = (file(PLANT_FILE, texts.plant), file(MISSION_FILE, texts.mission));
        let stack = Self::parse(&launch, &plant, &mission, self.mission_name.clone(), self.programs.clone())?;
        match texts.laboratory {
            Some(text) => stack.with_laboratory(file(LABORATORY_FILE, text)),
            None => Ok(stack),
        }
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
