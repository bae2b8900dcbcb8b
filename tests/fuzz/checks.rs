//! What must hold of any bytes, for every decoder and every reader of a file. Fuzzers and plain tests ask the same.

use fss_bus::launch::Launch;
use fss_lab::{Faults, LabConfig};
use fss_mission::Mission;
use fss_plant::Plant;
use fss_records::experiment::{Experiment, Table};
use fss_records::log::Log;
use fss_ros2::incoming::{joint_state, pose_2d, pose_stamped};
use fss_ros2::rmw_zenoh::Attachment;
use fss_wire::mocap::{Axes, Protocol, Reader, Tracker};
use fss_wire::{bridge, dsp3000, link, natnet, shared_table, valves, vicon, vrpn};
use std::path::{Path, PathBuf};

/// A reader's name, whose corpus lies in the folder of that name, and what must hold of it.
pub type Check = (&'static str, fn(&[u8]));

/// Every reader.
pub const CHECKS: &[Check] = &[
    ("vicon", check_vicon),
    ("natnet", check_natnet),
    ("vrpn", check_vrpn),
    ("dsp3000", check_dsp3000),
    ("link", check_link),
    ("valves", check_valves),
    ("bridge", check_bridge),
    ("ros2", check_ros2),
    ("granite", check_granite),
    ("log", check_log),
    ("table", check_table),
    ("experiment", check_experiment),
    ("plant", check_plant),
    ("mission", check_mission),
    ("launch", check_launch),
    ("faults", check_faults),
];

/// A VICON datagram is read or refused, and holds every object that it gives.
pub fn check_vicon(datagram: &[u8]) {
    if let Ok(frame) = vicon::Frame::decode(datagram) {
        assert!(frame.objects().count() * vicon::OBJECT_LEN + vicon::HEADER_LEN <= datagram.len());
    }
}

/// A NatNet message of either version is read or refused, gives finite poses, and holds every body that it gives.
pub fn check_natnet(datagram: &[u8]) {
    for version in [natnet::Version { major: 3, minor: 0 }, natnet::Version::NEWEST] {
        if let Ok(Some(frame)) = natnet::Frame::decode(datagram, version) {
            assert!(frame.rigid_bodies().count() * 38 < datagram.len());
        }
        let protocol = Protocol::Natnet { version, ids: [1, 2, 3] };
        sightings_are_poses(&mut Reader::new(Tracker { protocol, ..Tracker::default() }), datagram);
    }
    if let Ok(Some(info)) = natnet::ServerInfo::decode(datagram) {
        let mut buffer = [0; 512];
        let len = info.encode(&mut buffer).unwrap();
        assert_eq!(natnet::ServerInfo::decode(&buffer[..len]), Ok(Some(info)));
    }
    let _asked_or_not = natnet::Request::decode(datagram);
}

/// A VRPN stream is read or refused, never beyond its end, and gives finite poses.
pub fn check_vrpn(stream: &[u8]) {
    let axes = Axes::parse(&["x", "-z", "y"].map(str::to_owned)).unwrap();
    let mut reader = Reader::new(Tracker { protocol: Protocol::Vrpn, axes, ..Tracker::default() });
    sightings_are_poses(&mut reader, stream);
    if let Ok(Some((message, len))) = vrpn::Message::decode(stream) {
        let mut buffer = [0; vrpn::MAX_MESSAGE_LEN];
        let again = message.encode(0, &mut buffer).unwrap();
        assert_eq!((again, vrpn::Message::decode(&buffer[..again])), (len, Ok(Some((message, len)))));
    }
    let _named_or_not = vrpn::call_back_port(stream);
}

fn sightings_are_poses(reader: &mut Reader, bytes: &[u8]) {
    let read = reader.read(bytes, |sighting| {
        assert!(sighting.poses.iter().flatten().flatten().all(|value| value.is_finite()));
    });
    assert!(read.is_err() || read.is_ok_and(|used| used <= bytes.len()));
}

/// What goes with a sample from another vehicle is read or refused; what is read encodes to the same bytes.
pub fn check_bridge(bytes: &[u8]) {
    if let Ok(envelope) = bridge::Envelope::decode(bytes) {
        assert_eq!(envelope.encode(), bytes);
    }
}

/// A goal of a node of ROS 2 is read, finite where it says something, or refused; so is what goes with it.
pub fn check_ros2(bytes: &[u8]) {
    let joints = ["joint_1", "joint_2", "joint_3", "joint_4"].map(str::to_owned);
    for goal in [pose_stamped(bytes), pose_2d(bytes)].into_iter().flatten() {
        assert!(goal.base_goal.iter().all(|value| value.is_finite()) && goal.q_goal_rad.iter().all(|q| q.is_nan()));
    }
    if let Ok(goal) = joint_state(bytes, &joints) {
        assert!(goal.base_goal.iter().chain(&goal.q_goal_rad[4..]).all(|value| value.is_nan()));
        assert!(goal.q_goal_rad.iter().any(|q| q.is_finite()) && goal.q_goal_rad.iter().all(|q| !q.is_infinite()));
    }
    if let Some(attachment) = Attachment::decode(bytes) {
        assert_eq!(attachment.encode(), bytes);
    }
}

/// The word of another vehicle's laboratory is read, all numbers finite, or refused; what is read is read again as it was.
pub fn check_granite(datagram: &[u8]) {
    if let Some(state) = shared_table::State::decode(datagram) {
        assert!(state.pose.iter().chain(&state.velocity).all(|number| number.is_finite()));
        assert_eq!(shared_table::State::decode(&state.encode()), Some(state));
    }
}

/// A gyro stream gives finite readings, and the line after it is read.
pub fn check_dsp3000(stream: &[u8]) {
    let mut decoder = dsp3000::Decoder::new();
    for reading in stream.iter().filter_map(|byte| decoder.push(*byte)) {
        assert!(reading.value_rad.is_finite());
    }
    assert!(b"\n001.500000 1\r\n".iter().filter_map(|byte| decoder.push(*byte)).last().is_some());
}

/// A link datagram is read or refused; what is read encodes to the same bytes. Checksum and tag keep a fuzzer out of the
/// body, so the datagram is also tried with its checksum repaired.
pub fn check_link(datagram: &[u8]) {
    let Ok(key) = link::Key::new(&[7; 32]) else { return };
    let check = |datagram: &[u8]| {
        if let Ok(command) = link::Command::decode(datagram, &key) {
            assert_eq!(command.encode(&key), datagram);
        }
        if let Ok(telemetry) = link::Telemetry::decode(datagram) {
            assert_eq!(telemetry.encode(), datagram);
        }
    };
    check(datagram);
    if let Some((body, _)) = datagram.split_last_chunk::<4>() {
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(body);
        check(&[body, &crc.to_le_bytes()].concat());
    }
}

/// A valve line gives no more frames than it has room for, and a frame sent twice after it arrives.
pub fn check_valves(stream: &[u8]) {
    let mut decoder = valves::Decoder::new();
    let frames = stream.iter().filter(|byte| decoder.push(**byte).is_some()).count();
    assert!(frames * valves::FRAME_LEN <= stream.len());
    let shut = valves::ValveFrame { mask: 0, counter: 1 }.encode();
    let last = shut.iter().chain(&shut).filter_map(|byte| decoder.push(*byte)).last();
    assert_eq!(last.map(|frame| frame.mask), Some(0));
}

/// A folder of this thread's own, where files are tried; in memory.
fn folder() -> PathBuf {
    let thread = std::thread::current();
    let name = format!("fuzz-{}-{}", std::process::id(), thread.name().unwrap_or("main").replace(':', "-"));
    let folder = Path::new("/dev/shm").join(name);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A log is read or refused; what is recovered of it is a whole log of as many messages.
pub fn check_log(bytes: &[u8]) {
    let folder = folder();
    let (path, whole) = (folder.join("run.mcap"), folder.join("whole.mcap"));
    std::fs::write(&path, bytes).unwrap();
    if let Ok(log) = Log::open(&path) {
        let _refused_or_not = (log.attachment("plant.toml"), log.metadata("fss"));
        if let (Ok((topics, _)), Ok(recovered)) = (log.survey(), log.recover_to(&whole)) {
            let messages: u64 = topics.iter().map(|topic| topic.count).sum();
            assert_eq!(recovered.messages, messages);
            let (again, damage) = Log::open(&whole).unwrap().survey().unwrap();
            assert_eq!((again.iter().map(|topic| topic.count).sum::<u64>(), damage.places), (messages, 0));
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// A table is refused, or has finite numbers in rows of one length, in the order of time.
pub fn check_table(bytes: &[u8]) {
    if let Ok(table) = Table::parse(Path::new("fuzz.csv"), &String::from_utf8_lossy(bytes)) {
        assert!(table.t_s.windows(2).all(|t| t[0] < t[1]));
        assert!(table.column("x_m").is_none_or(|x| x.len() == table.len() && x.iter().all(|x| x.is_finite())));
    }
}

/// An experiment's description and one table behind it.
pub fn check_experiment(bytes: &[u8]) {
    let folder = folder();
    let text = String::from_utf8_lossy(bytes);
    let (description, table) = text.split_once("---\n").unwrap_or((&text, "t_s,x_m,y_m,theta_rad\n"));
    std::fs::write(folder.join("run.toml"), description).unwrap();
    std::fs::write(folder.join("base_pose.csv"), table).unwrap();
    let _refused_or_not = Experiment::read(&folder);
    std::fs::remove_dir_all(folder).unwrap();
}

/// A plant is refused, or has a model.
pub fn check_plant(bytes: &[u8]) {
    if let Ok(plant) = Plant::parse(&String::from_utf8_lossy(bytes)) {
        assert!(plant.model().is_ok());
    }
}

/// A mission is refused, or has phases that end.
pub fn check_mission(bytes: &[u8]) {
    let plant = Plant::default_laboratory().unwrap();
    let text = String::from_utf8_lossy(bytes);
    if let Ok(mission) = Mission::parse_for(&text, &plant) {
        assert!(mission.duration_s().is_finite() && mission.duration_s() > 0.0 && !mission.phases.is_empty());
    }
    let _refused_or_not = Faults::in_mission(&text);
}

/// A launch file is refused, or every service of it has a period.
pub fn check_launch(bytes: &[u8]) {
    let known = ["recorder", "lab", "thrusters", "fusion", "links", "arm", "base", "mission"];
    if let Ok(launch) = Launch::parse(&String::from_utf8_lossy(bytes), &known) {
        assert!(launch.services.iter().all(|s| s.period_ns() > 0 && s.phase_ns() < s.period_ns()));
    }
}

/// Faults are refused, or a laboratory can have them.
pub fn check_faults(bytes: &[u8]) {
    let Ok(faults) = toml::from_str::<Faults>(&String::from_utf8_lossy(bytes)) else { return };
    let config = LabConfig::new(0, link::Key::new(&[1; 32]).unwrap());
    let _refused_or_not = faults.check(&Plant::default_laboratory().unwrap(), &config);
}
