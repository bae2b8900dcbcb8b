//! A flight does not care whose motion capture it has: VICON's, OptiTrack's, or what stands behind a VRPN server.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{json, refused, succeed};
use serde_json::Value;
use std::path::{Path, PathBuf};

const LAB: &str = include_str!("../deploy/etc/launch/lab.toml");
const VICON: &str = r#"{ kind = "vicon", listen = "127.0.0.1:51001" }"#;
const NATNET_3: &str = r#"{ kind = "natnet", server = "127.0.0.1:51001", version = "3.1", axes = ["x", "-z", "y"] }"#;
const NATNET_4: &str =
    r#"{ kind = "natnet", server = "127.0.0.1:51001", multicast = "239.255.42.99:51002", ids = { base = 7 } }"#;
const VRPN_TCP: &str = r#"{ kind = "vrpn", server = "127.0.0.1:51001", unit = "mm" }"#;
const VRPN_UDP: &str =
    r#"{ kind = "vrpn", server = "127.0.0.1:51001", transport = "udp", names = { base = "Chaser" } }"#;

/// A launch file with this motion capture, whose ports no other test uses.
fn launch_file(folder: &Path, mocap: &str, first_port: u16) -> PathBuf {
    let text = LAB.replace(VICON, mocap);
    assert!(text.contains(mocap), "the launch file has no line for motion capture");
    let text = text
        .replace("51001", &first_port.to_string())
        .replace("51002", &(first_port + 1).to_string())
        .replace("5110", &(first_port / 10 + 1).to_string());
    let path = folder.join(format!("launch-{first_port}.toml"));
    std::fs::write(&path, text).unwrap();
    path
}

fn fly(folder: &Path, arguments: &[&str], mocap: &str, first_port: u16) -> Value {
    let (launch, out) = (launch_file(folder, mocap, first_port), folder.join(format!("out-{first_port}")));
    let files = ["--quiet", "--launch", launch.to_str().unwrap(), "--out", out.to_str().unwrap()];
    succeed(&[&["run"], arguments, &files].concat());
    json(&out.join("summary.json"))
}

fn navigation(summary: &Value) -> [f64; 2] {
    assert_eq!(summary["outcome"], "done", "{summary}");
    ["position_rms_m", "heading_rms_deg"].map(|key| summary["navigation"][key].as_f64().unwrap())
}

fn is_equal(one: [f64; 2], other: [f64; 2]) -> bool {
    one.iter().zip(other).all(|(a, b)| (a / b - 1.0).abs() < 0.02)
}

#[test]
fn every_tracker_navigates_a_zero_reaction_maneuver_and_a_capture_as_well() {
    let folder = tempfile::tempdir().unwrap();
    for (mission, trackers) in
        [("zero-reaction", [NATNET_3, NATNET_4, VRPN_TCP].as_slice()), ("capture", &[NATNET_4, VRPN_UDP])]
    {
        let folder = folder.path().join(mission);
        std::fs::create_dir(&folder).unwrap();
        let vicon = navigation(&fly(&folder, &[mission, "--fast"], VICON, 52_900));
        for (tracker, port) in trackers.iter().zip((52_910..).step_by(10)) {
            let other = navigation(&fly(&folder, &[mission, "--fast"], tracker, port));
            println!("{mission}: {other:?} by {tracker}, {vicon:?} by VICON");
            assert!(is_equal(other, vicon), "{mission} by {tracker}: {other:?}, by VICON {vicon:?}");
        }
    }
}

#[test]
fn frames_lost_late_and_reordered_and_bodies_lost_and_found_are_survived_alike() {
    let folder = tempfile::tempdir().unwrap();
    let faults = folder.path().join("faults.toml");
    let network = "[network.mocap]\nloss = 0.1\nduplicate = 0.1\ndelay_s = 0.01\njitter_s = 0.02\n";
    let lost = "[[fault]]\nfrom_s = 5\nto_s = 6\nkind = { mocap_zeros = { object = \"base\" } }\n\
        [[fault]]\nfrom_s = 8\nto_s = 8.5\nkind = \"mocap_silent\"\n\
        [[fault]]\nfrom_s = 10\nto_s = 10.5\nkind = \"mocap_frozen\"\n";
    std::fs::write(&faults, format!("{network}{lost}")).unwrap();
    let arguments = ["hold", "--fast", "--faults", faults.to_str().unwrap()];
    let vicon = navigation(&fly(folder.path(), &arguments, VICON, 52_950));
    for (tracker, port) in [(NATNET_3, 52_960), (VRPN_TCP, 52_970)] {
        let other = navigation(&fly(folder.path(), &arguments, tracker, port));
        println!("{other:?} by {tracker}, {vicon:?} by VICON");
        // A body that VRPN does not name is not refused as zeros are: the same measurements, other times of a restart.
        let ratios = [other[0] / vicon[0], other[1] / vicon[1]];
        assert!(ratios.iter().all(|r| (0.8..1.25).contains(r)), "{other:?} by {tracker}, {vicon:?} by VICON");
    }
}

/// As processes, through servers and sockets: unicast, multicast, TCP, and UDP with a call back.
#[test]
fn every_tracker_is_heard_over_the_network() {
    for (tracker, port) in [(NATNET_3, 53_010), (NATNET_4, 53_030), (VRPN_TCP, 53_050), (VRPN_UDP, 53_070)] {
        let folder = tempfile::tempdir().unwrap();
        let mission = folder.path().join("short.toml");
        let text = "name = \"short\"\ndescription = \"Holds for four seconds.\"\n[[phase]]\nname = \"hold\"\nduration_s = 4\n\
            base = { goal = \"hold\" }\narm = { goal = \"hold\" }\n";
        std::fs::write(&mission, text).unwrap();
        let summary = fly(folder.path(), &[mission.to_str().unwrap()], tracker, port);
        let [position_m, heading_deg] = navigation(&summary);
        println!("{position_m} m, {heading_deg} deg by {tracker}");
        assert!(position_m < 1e-3 && heading_deg < 0.1, "{summary}");
    }
}

#[test]
fn a_tracker_that_makes_no_sense_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (mocap, words) in [
        (VICON.replace("vicon", "phasespace"), vec!["phasespace", "natnet"]),
        (NATNET_3.replace("\"-z\"", "\"z\""), vec!["axes", "right-handed"]),
        (NATNET_3.replace("3.1", "2.9"), vec!["'2.9'", "4.1"]),
        (NATNET_4.replace("239.255", "192.168"), vec!["multicast", "239.255.42.99:1511"]),
        (NATNET_4.replace("base = 7", "base = 2"), vec!["two bodies", "streaming id"]),
        (VRPN_TCP.replace("\"mm\"", "\"inch\""), vec!["inch", "mm"]),
        (VRPN_TCP.replace("unit", "units"), vec!["units"]),
    ] {
        let launch = launch_file(folder.path(), &mocap, 52_990);
        let launch = launch.to_str().unwrap();
        refused(&["run", "--fast", "--launch", launch, "--out", out.to_str().unwrap()], &words);
    }
    let both = LAB.replace("gyro =", "vicon = \"127.0.0.1:51001\"\ngyro =");
    let path = folder.path().join("both.toml");
    std::fs::write(&path, both).unwrap();
    refused(&["run", "--fast", "--launch", path.to_str().unwrap()], &["both.toml:", "both mocap and vicon"]);
}
