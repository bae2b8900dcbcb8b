//! Definitions of the standard messages that `ground` makes, as ROS 2 has them.

const HEADER: (&str, &str) = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n");
const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const QUATERNION: (&str, &str) = ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n");
const VECTOR: (&str, &str) = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
const POINT: (&str, &str) = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n");

/// A message with all that it is made of.
pub(crate) struct Definition {
    /// Its name.
    pub(crate) name: &'static str,
    body: &'static str,
    parts: &'static [(&'static str, &'static str)],
}

/// Transforms between frames.
pub(crate) const TF_MESSAGE: Definition = Definition {
    name: "tf2_msgs/msg/TFMessage",
    body: "geometry_msgs/TransformStamped[] transforms\n",
    parts: &[
        (
            "geometry_msgs/TransformStamped",
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
        ),
        ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"),
        VECTOR,
        QUATERNION,
        HEADER,
        TIME,
    ],
};

/// Angles, rates and efforts of joints.
pub(crate) const JOINT_STATE: Definition = Definition {
    name: "sensor_msgs/msg/JointState",
    body: "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    parts: &[HEADER, TIME],
};

/// A pose in a frame.
pub(crate) const POSE_STAMPED: Definition = Definition {
    name: "geometry_msgs/msg/PoseStamped",
    body: "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    parts: &[
        ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"),
        POINT,
        QUATERNION,
        HEADER,
        TIME,
    ],
};

/// Text.
pub(crate) const STRING: Definition = Definition { name: "std_msgs/msg/String", body: "string data\n", parts: &[] };

impl Definition {
    /// The text, its parts joined as recordings have them.
    pub(crate) fn text(&self) -> String {
        let rule = "=".repeat(80);
        let part = |(name, body): &(&str, &str)| format!("{rule}\nMSG: {name}\n{body}");
        self.parts.iter().map(part).fold(self.body.to_owned(), |text, part| text + &part)
    }
}
