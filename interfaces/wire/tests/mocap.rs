//! Motion capture of three makers, seen from outside: what one side says, the other reads.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_wire::mocap::{Axes, Body, MAX_FRAME_LEN, Protocol, Reader, Sighting, Tracker};
use fss_wire::natnet::{self, NatnetError, Request, ServerInfo, Version};
use fss_wire::vrpn::{self, Message};
use proptest::prelude::*;

fn axes(names: [&str; 3]) -> Axes {
    Axes::parse(&names.map(str::to_owned)).unwrap()
}

fn natnet(major: u8, minor: u8) -> Tracker {
    let protocol = Protocol::Natnet { version: Version { major, minor }, ids: [11, 12, 13] };
    Tracker { protocol, axes: axes(["x", "-z", "y"]), ..Tracker::default() }
}

fn vrpn_tracker() -> Tracker {
    Tracker { protocol: Protocol::Vrpn, axes: axes(["-y", "x", "z"]), unit_m: 1e-3, ..Tracker::default() }
}

/// All that one side makes of what the other sends.
fn heard(tracker: &Tracker, number: u32, time_ns: u64, bodies: &[Body]) -> Vec<Sighting> {
    let mut reader = Reader::new(tracker.clone());
    let mut bytes = tracker.introduction();
    let mut buffer = [0; MAX_FRAME_LEN];
    let len = tracker.encode(number, time_ns, bodies, &mut buffer).unwrap();
    bytes.extend(&buffer[..len]);
    let mut sightings = Vec::new();
    assert_eq!(reader.read(&bytes, |sighting| sightings.push(sighting)).unwrap(), bytes.len());
    sightings
}

fn body(index: usize, x: f64, y: f64, theta_rad: f64) -> Body {
    Body { index, position_m: [x, y, 0.2], theta_rad, is_seen: true }
}

proptest! {
    #[test]
    fn whoever_made_the_cameras_the_poses_are_the_same(
        x in -3.0..3.0_f64, y in -3.0..3.0_f64, theta in -3.1..3.1_f64, index in 0..3_usize,
    ) {
        // NatNet sends single precision: at 3 m that is 0.2 um.
        for (tracker, most) in
            [(Tracker::default(), 1e-12), (natnet(3, 0), 1e-6), (natnet(4, 1), 1e-6), (vrpn_tracker(), 1e-12)]
        {
            let sightings = heard(&tracker, 7, 5_000_000_000, &[body(index, x, y, theta)]);
            prop_assert_eq!(sightings.len(), 1);
            let pose = sightings[0].poses[index].unwrap();
            for (read, sent) in pose.iter().zip([x, y, theta]) {
                prop_assert!((read - sent).abs() < most, "{:?}: {} for {}", tracker.protocol, read, sent);
            }
            prop_assert_eq!(sightings[0].poses.iter().flatten().count(), 1);
        }
    }
}

#[test]
fn a_body_that_the_cameras_have_lost_is_no_pose() {
    let lost = [Body { is_seen: false, ..body(0, 1.0, 2.0, 0.3) }, body(1, 0.5, 0.5, 0.0)];
    for tracker in [Tracker::default(), natnet(3, 1), natnet(4, 1)] {
        let sighting = heard(&tracker, 1, 1, &lost)[0];
        assert_eq!(sighting.poses[0], Some([0.0; 3]), "{:?}", tracker.protocol);
        assert!(sighting.poses[1].unwrap()[0] > 0.4);
    }
    let sightings = heard(&vrpn_tracker(), 1, 1, &lost);
    assert!(sightings.iter().all(|s| s.poses[0].is_none()) && sightings.len() == 1, "VRPN says nothing of it");
}

#[test]
fn axes_are_a_right_handed_frame() {
    for names in [["x", "y", "z"], ["x", "-z", "y"], ["-x", "-y", "z"], ["z", "x", "y"]] {
        Axes::parse(&names.map(str::to_owned)).unwrap();
    }
    for (names, why) in
        [(["x", "z", "y"], "right-handed"), (["x", "x", "z"], "right-handed"), (["x", "y", "up"], "'up'")]
    {
        let refused = Axes::parse(&names.map(str::to_owned)).unwrap_err().to_string();
        assert!(refused.contains(why), "{refused}");
    }
}

/// A frame as Motive writes it when somebody streams more than rigid bodies.
fn motive_frame(has_sizes: bool) -> Vec<u8> {
    let list = |count: u32, body: &[u8]| {
        let size = (body.len() as u32).to_le_bytes();
        [count.to_le_bytes().as_slice(), if has_sizes { &size[..] } else { &[] }, body].concat()
    };
    let marker: Vec<u8> = [0.1_f32, 0.2, 0.3].iter().flat_map(|v| v.to_le_bytes()).collect();
    let marker_set = [b"all\0".as_slice(), &2_u32.to_le_bytes(), &marker, &marker].concat();
    let numbers = [1.5_f32, 0.25, -0.5, 0.0, 0.6, 0.0, 0.8, 0.0002].iter().flat_map(|v| v.to_le_bytes());
    let rigid: Vec<u8> = 12_u32.to_le_bytes().into_iter().chain(numbers).chain([1, 0]).collect();
    let payload = [
        77_u32.to_le_bytes().to_vec(),
        list(1, &marker_set),
        list(3, &marker.repeat(3)),
        list(1, &rigid),
        list(0, &[]),
        vec![9; 300],
    ]
    .concat();
    [&7_u16.to_le_bytes(), &(payload.len() as u16).to_le_bytes(), payload.as_slice()].concat()
}

#[test]
fn markers_in_front_of_the_rigid_bodies_do_not_hide_them() {
    for (version, has_sizes) in
        [(Version { major: 3, minor: 0 }, false), (Version { major: 4, minor: 0 }, false), (Version::NEWEST, true)]
    {
        let bytes = motive_frame(has_sizes);
        let frame = natnet::Frame::decode(&bytes, version).unwrap().unwrap();
        assert_eq!(frame.number(), 77);
        let rigid = frame.rigid_bodies().next().unwrap();
        assert_eq!((rigid.id, rigid.position, rigid.is_tracked), (12, [1.5, 0.25, -0.5], true));
        // Cameras whose y is up turn about it.
        let mut poses = None;
        let mut reader = Reader::new(natnet(version.major, version.minor));
        reader.read(&bytes, |sighting| poses = Some(sighting.poses)).unwrap();
        let [x, y, theta] = poses.unwrap()[1].unwrap();
        assert!((x - 1.5).abs() < 1e-6 && (y - 0.5).abs() < 1e-6);
        assert!((theta - 2.0 * 0.6_f64.atan2(0.8)).abs() < 1e-6);
    }
}

#[test]
fn every_shortened_frame_is_called_truncated() {
    let bytes = motive_frame(true);
    let whole = bytes.len() - 300 - 8;
    for len in 0..whole {
        assert_eq!(natnet::Frame::decode(&bytes[..len], Version::NEWEST).unwrap_err(), NatnetError::Truncated(len));
    }
}

#[test]
fn a_server_says_its_version_and_where_its_frames_go() {
    let mut buffer = [0; 512];
    for group in [None, Some(natnet::MULTICAST_GROUP)] {
        let info = ServerInfo { version: Version { major: 3, minor: 1 }, group, data_port: 1511 };
        let len = info.encode(&mut buffer).unwrap();
        assert_eq!(ServerInfo::decode(&buffer[..len]).unwrap(), Some(info));
        assert!(ServerInfo::decode(&buffer[..len - 1]).is_err());
    }
    let old = ServerInfo { version: Version { major: 2, minor: 9 }, group: None, data_port: 1511 };
    let len = old.encode(&mut buffer).unwrap();
    let refused = ServerInfo::decode(&buffer[..len]).unwrap_err();
    assert_eq!(refused, NatnetError::Version(2));
    for request in [Request::Connect, Request::ModelDefinition, Request::KeepAlive, Request::Disconnect] {
        assert_eq!(Request::decode(&request.encode()), Some(request));
    }
}

#[test]
fn a_vrpn_stream_may_break_anywhere() {
    let tracker = vrpn_tracker();
    let mut bytes = tracker.introduction();
    let mut buffer = [0; MAX_FRAME_LEN];
    let len = tracker.encode(1, 3_500_000_000, &[body(0, 1.0, 2.0, 0.5), body(2, 0.1, 0.2, 0.3)], &mut buffer).unwrap();
    bytes.extend(&buffer[..len]);
    for cut in 0..bytes.len() {
        let mut reader = Reader::new(tracker.clone());
        let mut sightings = Vec::new();
        let used = reader.read(&bytes[..cut], |sighting| sightings.push(sighting)).unwrap();
        reader.read(&bytes[used..], |sighting| sightings.push(sighting)).unwrap();
        assert_eq!(sightings.iter().map(|s| s.number).collect::<Vec<_>>(), [3_500_000; 2], "cut at {cut}");
    }
}

#[test]
fn numbers_of_a_lost_connection_mean_nothing() {
    let tracker = vrpn_tracker();
    let mut reader = Reader::new(tracker.clone());
    reader.read(&tracker.introduction(), |_| ()).unwrap();
    reader.forget();
    let mut buffer = [0; MAX_FRAME_LEN];
    let len = tracker.encode(1, 1, &[body(0, 1.0, 2.0, 0.5)], &mut buffer).unwrap();
    reader.read(&buffer[..len], |_| panic!("nobody has said who is 0")).unwrap();
}

#[test]
fn a_vrpn_message_without_sense_is_refused() {
    let mut bytes = [0; 64];
    for len in [0_u32, 23, 5000, u32::MAX] {
        bytes[..4].copy_from_slice(&len.to_be_bytes());
        assert!(Message::decode(&bytes).is_err(), "{len}");
    }
    assert!(vrpn::check_cookie(&vrpn::cookie()).is_ok());
    assert!(vrpn::check_cookie(b"vrpn: ver. 06.00  0\0\0\0\0\0").is_err());
    assert_eq!(vrpn::call_back_port(vrpn::call_back([127, 0, 0, 1].into(), 4242).as_bytes()), Some(4242));
    for nonsense in [b"".as_slice(), b"host", b"host 99999\0", &[0xff; 9]] {
        assert_eq!(vrpn::call_back_port(nonsense), None);
    }
}
