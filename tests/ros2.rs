//! What the launch file lets nodes of ROS 2 see.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::refused;

const LAB: &str = include_str!("../deploy/etc/launch/lab.toml");
const BRIDGE: &str = "\n[[service]]\nname = \"bridge\"\nrate_hz = 50\nphase_us = 4500\n";

#[test]
fn topics_that_nobody_publishes_and_a_bridge_that_is_not_launched_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (share, service, words) in [
        ("/nav/mood", BRIDGE, vec!["launch.toml:", "no topic /nav/mood", "/nav/state"]),
        ("/nav/state", "", vec!["[ros2] is there", "name = \"bridge\""]),
    ] {
        let path = folder.path().join("launch.toml");
        let ros2 = format!("[ros2]\nshare = [\"{share}\"]\n\n[devices]");
        std::fs::write(&path, LAB.replace("[devices]", &ros2) + service).unwrap();
        let out = folder.path().join("out");
        refused(&["run", "--fast", "--launch", path.to_str().unwrap(), "--out", out.to_str().unwrap()], &words);
    }
}
