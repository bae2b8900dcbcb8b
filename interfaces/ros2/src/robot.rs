//! Where the vehicle is, as standard messages.

use crate::cdr::Cdr;
use fss_messages::{Health, LinksState, NavState};

/// Name of the table's frame: its origin is the middle of the granite.
pub const TABLE: &str = "map";

/// A vehicle's frames and joints, as its URDF names them.
#[derive(Debug, Clone)]
pub struct Robot {
    /// Vehicle's name in front of its frames, with a slash; empty for one alone.
    pub prefix: String,
    /// The base's frame.
    pub base: String,
    /// The target's frame.
    pub target: String,
    /// The joints.
    pub joints: Vec<String>,
    /// The frames that the joints move, then the end-effector's.
    pub links: Vec<String>,
    /// Joint by joint, where it is with its encoder at zero; then the end-effector.
    pub origins: Vec<[f64; 3]>,
    /// Height of the first joint above the base, m.
    pub arm_height_m: f64,
}

/// One transform of `/tf`.
#[derive(Debug, Clone)]
pub struct Transform {
    time_ns: u64,
    parent: String,
    child: String,
    pose: [f64; 3],
    z_m: f64,
}

impl Robot {
    /// The vehicle's own frame of this name.
    fn own(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    fn transform(&self, time_ns: u64, parent: String, child: &str, pose: [f64; 3], z_m: f64) -> Transform {
        Transform { time_ns, parent, child: self.own(child), pose, z_m }
    }

    /// The base on the table.
    pub fn base(&self, time_ns: u64, pose: [f64; 3]) -> Transform {
        self.transform(time_ns, TABLE.to_owned(), &self.base, pose, 0.0)
    }

    /// The target on the table.
    pub fn target(&self, time_ns: u64, pose: [f64; 3]) -> Transform {
        self.transform(time_ns, TABLE.to_owned(), &self.target, pose, 0.0)
    }

    /// The arm's frames.
    pub fn arm(&self, time_ns: u64, q_rad: &[f64]) -> impl Iterator<Item = Transform> {
        self.origins.iter().zip(&self.links).enumerate().map(move |(i, ([x_m, y_m, angle_rad], child))| {
            let parent = i.checked_sub(1).and_then(|before| self.links.get(before)).unwrap_or(&self.base);
            let q_rad = if i < self.joints.len() { q_rad.get(i).copied().unwrap_or(0.0) } else { 0.0 };
            let z_m = if i == 0 { self.arm_height_m } else { 0.0 };
            self.transform(time_ns, self.own(parent), child, [*x_m, *y_m, angle_rad + q_rad], z_m)
        })
    }

    /// `sensor_msgs/JointState`.
    pub fn joint_states(&self, time_ns: u64, links: &LinksState) -> Vec<u8> {
        let numbers = |cdr: Cdr, values: &[f64]| cdr.list(values, |cdr, value| cdr.f64(*value));
        let cdr = Cdr::default().header(time_ns, "").list(&self.joints, |cdr, name| cdr.text(name));
        [&links.q_rad, &links.qd_rad_s, &links.torque_nm]
            .into_iter()
            .fold(cdr, |cdr, values| numbers(cdr, values.get(..self.joints.len()).unwrap_or_default()))
            .message()
    }

    /// `nav_msgs/Odometry`: the pose on the table, the velocity in the base's frame, variances as navigation states them.
    pub fn odometry(&self, time_ns: u64, nav: &NavState) -> Vec<u8> {
        let (sin, cos) = nav.theta_rad.sin_cos();
        let forward = [cos * nav.vx_m_s + sin * nav.vy_m_s, cos * nav.vy_m_s - sin * nav.vx_m_s];
        let [x, y, theta, vx, vy, omega, ..] = nav.std;
        let cdr = Cdr::default().header(time_ns, TABLE).text(&self.own(&self.base));
        let cdr = cdr.pose([nav.x_m, nav.y_m, nav.theta_rad], 0.0);
        let cdr = covariance(cdr, [x, y, theta]);
        let cdr = [forward[0], forward[1], 0.0, 0.0, 0.0, nav.omega_rad_s].into_iter().fold(cdr, Cdr::f64);
        covariance(cdr, [vx, vy, omega]).message()
    }
}

/// A covariance of 6 x 6, x y z and the rotations about them, of a planar motion with these standard deviations.
fn covariance(cdr: Cdr, [x, y, rotation]: [f64; 3]) -> Cdr {
    let diagonal = [x * x, y * y, 0.0, 0.0, 0.0, rotation * rotation];
    (0..36).fold(cdr, |cdr, i| cdr.f64(if i % 7 == 0 { diagonal[i / 7] } else { 0.0 }))
}

/// `tf2_msgs/TFMessage`.
pub fn tf_message(transforms: &[Transform]) -> Vec<u8> {
    let each = |cdr: Cdr, t: &Transform| cdr.header(t.time_ns, &t.parent).text(&t.child).pose(t.pose, t.z_m);
    Cdr::default().list(transforms, each).message()
}

/// `diagnostic_msgs/DiagnosticArray` of one service: a warning where steps since the start ended late or samples were lost.
pub fn diagnostics(time_ns: u64, health: &Health) -> Vec<u8> {
    let end = health.service.iter().position(|byte| *byte == 0).unwrap_or(health.service.len());
    let name = String::from_utf8_lossy(&health.service[..end]).into_owned();
    let is_fine = health.overruns + health.skipped + health.dropped == 0;
    let (level, message) =
        if is_fine { (0, "in time") } else { (1, "steps were late or skipped, or samples were lost") };
    let values = [
        ("rate_hz", health.rate_hz.to_string()),
        ("cycles", health.cycles.to_string()),
        ("overruns", health.overruns.to_string()),
        ("skipped", health.skipped.to_string()),
        ("dropped", health.dropped.to_string()),
        ("wake_p99_ns", health.wake_p99_ns.to_string()),
        ("step_p99_ns", health.step_p99_ns.to_string()),
        ("starts", health.starts.to_string()),
    ];
    let cdr = Cdr::default().header(time_ns, "").u32(1).u8(level).text(&name).text(message).text("");
    cdr.list(&values, |cdr, (key, value)| cdr.text(key).text(value)).message()
}
