//! Definitions of the standard messages that fss makes or takes, as ROS 2 has them.

const HEADER: (&str, &str) = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n");
const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const QUATERNION: (&str, &str) = ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n");
const VECTOR: (&str, &str) = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
const POINT: (&str, &str) = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n");

/// A message with all that it is made of.
pub struct Definition {
    /// Its name, `package/msg/Name`.
    pub name: &'static str,
    /// Its own fields.
    pub body: &'static str,
    /// What it contains.
    pub parts: &'static [(&'static str, &'static str)],
}

/// Transforms between frames.
pub const TF_MESSAGE: Definition = Definition {
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
pub const JOINT_STATE: Definition = Definition {
    name: "sensor_msgs/msg/JointState",
    body: "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    parts: &[HEADER, TIME],
};

/// A pose in a frame.
pub const POSE_STAMPED: Definition = Definition {
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

/// A pose in the plane.
pub const POSE_2D: Definition =
    Definition { name: "geometry_msgs/msg/Pose2D", body: "float64 x\nfloat64 y\nfloat64 theta\n", parts: &[] };

/// Text.
pub const STRING: Definition = Definition { name: "std_msgs/msg/String", body: "string data\n", parts: &[] };

/// Pose and velocity of a body.
pub const ODOMETRY: Definition = Definition {
    name: "nav_msgs/msg/Odometry",
    body: "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
        geometry_msgs/TwistWithCovariance twist\n",
    parts: &[
        ("geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose pose\nfloat64[36] covariance\n"),
        ("geometry_msgs/TwistWithCovariance", "geometry_msgs/Twist twist\nfloat64[36] covariance\n"),
        ("geometry_msgs/Twist", "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"),
        ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"),
        POINT,
        VECTOR,
        QUATERNION,
        HEADER,
        TIME,
    ],
};

/// How services are.
pub const DIAGNOSTICS: Definition = Definition {
    name: "diagnostic_msgs/msg/DiagnosticArray",
    body: "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
    parts: &[
        (
            "diagnostic_msgs/DiagnosticStatus",
            "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring message\nstring hardware_id\n\
             diagnostic_msgs/KeyValue[] values\n",
        ),
        ("diagnostic_msgs/KeyValue", "string key\nstring value\n"),
        HEADER,
        TIME,
    ],
};

impl Definition {
    /// Its RIHS01; empty for a definition that lacks a part.
    pub fn hash(&self) -> String {
        crate::type_hash::rihs01(self.name, self.body, self.parts).unwrap_or_default()
    }

    /// The text, its parts joined as recordings have them.
    pub fn text(&self) -> String {
        let rule = "=".repeat(80);
        let part = |(name, body): &(&str, &str)| format!("{rule}\nMSG: {name}\n{body}");
        self.parts.iter().map(part).fold(self.body.to_owned(), |text, part| text + &part)
    }
}
