//! An FMU as a controller, and the plant as an FMU.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{refused, skipped, succeed};
use fss_messages::{Event, TruthState, text_of, topic};
use fss_records::log::Log;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Whether the tests of the whole workspace have built what lies beside the program.
fn is_built(file: &str) -> bool {
    let is_there = Path::new(env!("CARGO_BIN_EXE_fss")).with_file_name(file).is_file();
    if !is_there {
        skipped(&format!("{file} is not there: cargo build -p fss-fmu -p fss-plant-fmu"));
    }
    is_there
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

const NAMES: [(&str, &str); 7] =
    [("x", "m"), ("y", "m"), ("theta", "rad"), ("vx", "m/s"), ("vy", "m/s"), ("omega", "rad/s"), ("state", "")];

/// The description of the C controller, for FMI 2 or 3; `unit` stands in place of metres.
fn description(fmi: u8, unit: &str) -> String {
    let variable = |name: &str, reference: usize, causality: &str, unit: &str| {
        let unit = if unit.is_empty() { String::new() } else { format!(" unit=\"{unit}\"") };
        let start = if causality == "output" { "" } else { " start=\"0\"" };
        let common = format!("name=\"{name}\" valueReference=\"{reference}\" causality=\"{causality}\"");
        if fmi == 2 {
            format!("<ScalarVariable {common}><Real{unit}{start}/></ScalarVariable>\n")
        } else {
            format!("<Float64 {common}{unit}{start}/>\n")
        }
    };
    let inputs = NAMES
        .iter()
        .enumerate()
        .map(|(i, (name, own))| variable(name, i, "input", if *own == "m" { unit } else { own }));
    let outputs = (1..=8).map(|i| variable(&format!("valve_{i}"), 6 + i, "output", ""));
    let all: String = inputs.chain(outputs).chain([variable("bandwidth", 20, "parameter", "rad/s")]).collect();
    let (version, token) = if fmi == 2 { ("2.0", "guid") } else { ("3.0", "instantiationToken") };
    format!(
        "<?xml version=\"1.0\"?>\n<fmiModelDescription fmiVersion=\"{version}\" modelName=\"pd\" {token}=\"{{pd}}\">\n\
         <CoSimulation modelIdentifier=\"pd\"/>\n<ModelVariables>\n{all}</ModelVariables>\n<ModelStructure/>\n\
         </fmiModelDescription>\n"
    )
}

/// Compiles the C controller and packs it; none without a compiler.
fn c_fmu(folder: &Path, fmi: u8, fault: u8, unit: &str) -> Option<PathBuf> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/controllers/pd_fmu.c");
    let library = folder.join(format!("pd-{fmi}-{fault}.so"));
    let mut cc = Command::new("cc");
    cc.args(["-shared", "-fPIC", "-O1", "-w", &format!("-DFMI={fmi}"), &format!("-DFAULT={fault}"), "-o"]);
    let Ok(status) = cc.arg(&library).arg(source).arg("-lm").status() else {
        skipped("there is no cc");
        return None;
    };
    assert!(status.success(), "cc fails");
    let platform = if fmi == 2 { "linux64".to_owned() } else { format!("{}-linux", std::env::consts::ARCH) };
    let archive = folder.join(format!("pd-{fmi}-{fault}-{}.fmu", unit.len()));
    let mut zip = zip::ZipWriter::new(std::fs::File::create(&archive).unwrap());
    let options = zip::write::SimpleFileOptions::default();
    zip.start_file("modelDescription.xml", options).unwrap();
    zip.write_all(description(fmi, unit).as_bytes()).unwrap();
    zip.start_file(format!("binaries/{platform}/pd.so"), options).unwrap();
    zip.write_all(&std::fs::read(library).unwrap()).unwrap();
    zip.finish().unwrap();
    Some(archive)
}

/// A launch file with the FMU in place of `base`.
fn launch_file(folder: &Path, fmu: &Path, first_port: u16) -> PathBuf {
    let lab = include_str!("../deploy/etc/launch/lab.toml");
    let tables: Vec<&str> = lab.split("[[service]]").filter(|table| !table.contains("name = \"base\"")).collect();
    let mut text = tables
        .join("[[service]]")
        .replace("51001", &first_port.to_string())
        .replace("5110", &(first_port / 10 + 1).to_string());
    let fmu = fmu.display();
    let mut tables = vec![format!(
        "\n[[service]]\nname = \"fmu\"\nprogram = \"fss-fmu\"\nrate_hz = 100\nphase_us = 1500\n[service.config]\nfmu = \"{fmu}\"\n"
    )];
    let nav = ["x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s"].map(|field| ("/nav/state", field));
    for ((name, _), (topic, field)) in NAMES.iter().zip(nav.into_iter().chain([("/mission/state", "state")])) {
        let wire = format!("variable = \"{name}\"\ntopic = \"{topic}\"\nfield = \"{field}\"\n");
        tables.push(format!("[[service.config.input]]\n{wire}"));
    }
    let valve = |i: usize| (format!("variable = \"valve_{}\"", i + 1), format!("valves[{i}]"));
    for (value, field) in [("value = 8".to_owned(), "valve_count".to_owned())].into_iter().chain((0..8).map(valve)) {
        let wire = format!("{value}\ntopic = \"/thrusters/command\"\nfield = \"{field}\"\n");
        tables.push(format!("[[service.config.output]]\n{wire}"));
    }
    text.push_str(&tables.concat());
    let path = folder.join(format!("launch-{first_port}.toml"));
    std::fs::write(&path, text).unwrap();
    path
}

/// Root mean square of how far the base was from where it began, m, and turned, rad.
fn strayed(log: &Path) -> [f64; 2] {
    let truth = Log::open(log).unwrap().samples::<TruthState>(topic::TRUTH_STATE.name).unwrap();
    let (first, count) = (truth[0], truth.len() as f64);
    let mean_square = |error: &dyn Fn(&TruthState) -> f64| truth.iter().map(|t| error(t).powi(2)).sum::<f64>() / count;
    [mean_square(&|t| (t.x_m - first.x_m).hypot(t.y_m - first.y_m)), mean_square(&|t| t.theta_rad - first.theta_rad)]
        .map(f64::sqrt)
}

fn hold(folder: &Path, launch: &Path, clock: &[&str]) -> [f64; 2] {
    let out = folder.join(format!("out-{}-{}", launch.file_stem().unwrap().display(), clock.len()));
    succeed(&[&["run", "hold", "--quiet", "--launch", path(launch), "--out", path(&out)], clock].concat());
    strayed(&out.join("run.mcap"))
}

#[test]
fn an_fmu_of_either_version_holds_the_base_in_place_of_ours_on_both_clocks() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let (Some(two), Some(three)) = (c_fmu(folder, 2, 0, "m"), c_fmu(folder, 3, 0, "m")) else { return };
    if !is_built("fss-fmu") {
        return;
    }
    let ours = folder.join("ours");
    succeed(&["run", "hold", "--fast", "--quiet", "--out", path(&ours)]);
    let ours = strayed(&ours.join("run.mcap"));
    let (two, three) = (launch_file(folder, &two, 54_510), launch_file(folder, &three, 54_530));
    for (launch, clock) in [(&two, ["--fast"].as_slice()), (&three, &["--fast"]), (&two, &[])] {
        let theirs = hold(folder, launch, clock);
        println!("{} {clock:?}: {theirs:?} m and rad, ours {ours:?}", launch.display());
        assert!(theirs[0] < 1.2 * ours[0] && theirs[1] < 1.2 * ours[1], "{theirs:?}, ours {ours:?}");
    }
}

#[test]
fn an_fmu_that_does_not_go_with_the_launch_file_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let (Some(fmu), Some(feet)) = (c_fmu(folder, 2, 0, "m"), c_fmu(folder, 2, 0, "ft")) else { return };
    if !is_built("fss-fmu") {
        return;
    }
    let launch = std::fs::read_to_string(launch_file(folder, &fmu, 54_550)).unwrap();
    let fmu = path(&fmu);
    for (from, to, words) in [
        (fmu, path(&feet), vec!["'x' is in ft", "x_m has m"]),
        (fmu, "/no/such.fmu", vec!["/no/such.fmu", "cannot be read"]),
        (fmu, "/etc/hostname", vec!["/etc/hostname", "is no FMU"]),
        ("\"valve_3\"", "\"valve_9\"", vec!["no variable 'valve_9'", "valve_1"]),
        ("\"theta_rad\"", "\"theta_deg\"", vec!["/nav/state has no field 'theta_deg'"]),
        ("/mission/state", "/mission/mood", vec!["there is no topic /mission/mood"]),
        ("valves[7]", "valves[77]", vec!["/thrusters/command valves has the numbers 0 to"]),
    ] {
        let file = folder.join("wrong.toml");
        std::fs::write(&file, launch.replace(from, to)).unwrap();
        refused(
            &["run", "hold", "--fast", "--quiet", "--launch", path(&file), "--out", path(&folder.join("no"))],
            &words,
        );
    }
}

#[test]
fn valves_stay_shut_when_an_fmu_crashes_fails_or_gives_no_numbers_and_the_flight_says_so() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    if !is_built("fss-fmu") {
        return;
    }
    for (fault, words) in [(3, "fails in its step"), (4, "a number that is none")] {
        let Some(fmu) = c_fmu(folder, 3, fault, "m") else { return };
        let launch = launch_file(folder, &fmu, 54_600 + u16::from(fault) * 20);
        let out = folder.join(format!("fault-{fault}"));
        succeed(&["run", "hold", "--fast", "--quiet", "--launch", path(&launch), "--out", path(&out)]);
        let log = Log::open(&out.join("run.mcap")).unwrap();
        let events = log.samples::<Event>(topic::EVENTS.name).unwrap();
        let said = events.iter().find(|event| text_of(&event.service) == "fmu" && text_of(&event.text).contains(words));
        let said_ns = said.unwrap_or_else(|| panic!("no event says '{words}'")).stamp_ns;
        let truth = log.samples::<TruthState>(topic::TRUTH_STATE.name).unwrap();
        let after = truth.iter().filter(|t| t.stamp_ns > said_ns + 200_000_000);
        assert!(
            after.clone().count() > 100 && after.clone().all(|t| t.valves.iter().all(|v| *v == 0)),
            "valves open after fault {fault}"
        );
    }
    let Some(fmu) = c_fmu(folder, 2, 2, "m") else { return };
    let launch = launch_file(folder, &fmu, 54_700);
    let out = folder.join("crash");
    refused(&["run", "hold", "--fast", "--quiet", "--launch", path(&launch), "--out", path(&out)], &["fmu"]);
}

#[test]
fn an_exported_plant_is_an_fmu_that_moves_as_the_simulation_does() {
    if !is_built("libfss_plant_fmu.so") {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let plant = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/etc/plants/fss.toml");
    for (fmi, version) in [("2", fss_fmu::model::Fmi::Two), ("3", fss_fmu::model::Fmi::Three)] {
        let out = place.path().join(format!("vehicle-{fmi}.fmu"));
        succeed(&["plant", "export-fmu", path(&plant), "--out", path(&out), "--fmi", fmi]);
        let model = fss_fmu::model::Model::read(&out).unwrap();
        assert_eq!(model.fmi, version);
        let folder = place.path().join(format!("unpacked-{fmi}"));
        let library = model.unpack(&folder).unwrap();
        let instance = fss_fmu::instance::Instance::start(&model, &library, &folder).unwrap();
        instance.begin(version).unwrap();
        let value = |name: &str| {
            let variable = &model.variables[name];
            instance.get(variable.reference, variable.kind.unwrap()).unwrap()
        };
        let valve = &model.variables["valve_1"];
        instance.set(valve.reference, valve.kind.unwrap(), 1.0).unwrap();
        let plant = fss_plant::Plant::parse(&std::fs::read_to_string(&plant).unwrap()).unwrap();
        let mut simulation = fss_plant::Simulation::new(&plant, 1).unwrap();
        (0..plant.link_count())
            .for_each(|i| simulation.set_joint(i, fss_plant::JointCommand::Current { current_a: 0.0 }));
        simulation.set_valve(0, true, 0.0);
        for step in 0..200 {
            instance.step(f64::from(step) * 0.01, 0.01).unwrap();
            (0..10).for_each(|_| simulation.step(1e-3));
        }
        let truth = simulation.truth();
        assert!(truth.base_pose[0].abs() > 1e-3, "the thruster moves the base");
        let poses = ["base.x_m", "base.y_m", "base.theta_rad"].map(value);
        assert_eq!(poses, truth.base_pose, "the same bits");
        assert_eq!(value("link_2.q_rad"), simulation.encoder_rad(1));
    }
}
