//! Hashes against those that ROS 2 itself gives its standard messages (distributions Jazzy and later).
#![allow(clippy::unwrap_used)]

use fss_ros2::standard::{DIAGNOSTICS, JOINT_STATE, ODOMETRY, POSE_STAMPED, STRING, TF_MESSAGE};
use fss_ros2::type_hash::rihs01;

#[test]
fn standard_messages_have_the_hashes_that_ros_2_gives_them() {
    let known = [
        (&STRING, "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        (&TF_MESSAGE, "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"),
        (&JOINT_STATE, "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"),
        (&ODOMETRY, "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"),
        (&DIAGNOSTICS, "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"),
        (&POSE_STAMPED, "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"),
    ];
    for (definition, hash) in known {
        assert_eq!(definition.hash(), format!("RIHS01_{hash}"), "{}", definition.name);
    }
}

#[test]
fn a_type_that_is_not_given_is_named() {
    let refused = rihs01("a_msgs/msg/A", "std_msgs/Header header\n", &[]).unwrap_err();
    assert_eq!(refused.0, "std_msgs/msg/Header");
    assert!(rihs01("a_msgs/msg/A", "complex128 z\n", &[]).is_err());
}
