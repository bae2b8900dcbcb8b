//! What nodes of ROS 2 want of base and arm. Any bytes are read or refused; what is read is finite.

use crate::cdr::Reader;
use crate::robot::TABLE;
use fss_messages::{MAX_LINKS, MissionGoal};

/// How far the length of a quaternion may be from 1.
const UNIT_TOLERANCE: f64 = 0.01;
/// How far a rotation may lean from the vertical: the quaternion's x and y.
const TILT_TOLERANCE: f64 = 0.01;

/// Why a message is no goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// Not the bytes of such a message.
    #[error("it is no CDR of its type")]
    Cdr,
    /// Infinite, or not a number.
    #[error("a number of it is not finite")]
    NotFinite,
    /// In another frame than the table's.
    #[error("its frame is not '{TABLE}'")]
    Frame,
    /// Not a unit quaternion about the vertical.
    #[error("its orientation is no rotation about z")]
    Orientation,
    /// A joint that the arm does not have, or that is named twice.
    #[error("it names a joint twice, or one that the arm does not have")]
    Joint,
    /// Not an angle for each joint that is named.
    #[error("it does not give each joint that it names a position")]
    Positions,
}

/// A goal that says nothing, of this time.
fn silent(stamp_ns: u64) -> MissionGoal {
    let (base_goal, q_goal_rad) = ([f64::NAN; 3], [f64::NAN; MAX_LINKS]);
    MissionGoal { stamp_ns, base_goal, q_goal_rad, ..MissionGoal::default() }
}

fn of_base(stamp_ns: u64, base_goal: [f64; 3]) -> Result<MissionGoal, Malformed> {
    let is_finite = base_goal.iter().all(|value| value.is_finite());
    if is_finite { Ok(MissionGoal { base_goal, ..silent(stamp_ns) }) } else { Err(Malformed::NotFinite) }
}

/// `geometry_msgs/PoseStamped` in the table's frame, or in none. The goal's stamp is the header's, ns since 1970.
///
/// # Errors
/// Where it is no such message, or not finite, in another frame, or leans.
pub fn pose_stamped(message: &[u8]) -> Result<MissionGoal, Malformed> {
    let read = || {
        let mut reader = Reader::new(message)?;
        let header = reader.header()?;
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = reader.f64()?;
        }
        reader.is_at_end().then_some((header, numbers))
    };
    let ((stamp_ns, frame), [x_m, y_m, z_m, qx, qy, qz, qw]) = read().ok_or(Malformed::Cdr)?;
    let length = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
    if !(length.is_finite() && z_m.is_finite()) {
        return Err(Malformed::NotFinite);
    }
    if !frame.is_empty() && frame != TABLE {
        return Err(Malformed::Frame);
    }
    if (length - 1.0).abs() > UNIT_TOLERANCE || qx.abs().max(qy.abs()) > TILT_TOLERANCE {
        return Err(Malformed::Orientation);
    }
    of_base(stamp_ns, [x_m, y_m, 2.0 * qz.atan2(qw)])
}

/// `geometry_msgs/Pose2D` on the table. It has no stamp: the goal's is 0.
///
/// # Errors
/// Where it is no such message, or not finite.
pub fn pose_2d(message: &[u8]) -> Result<MissionGoal, Malformed> {
    let read = || {
        let mut reader = Reader::new(message)?;
        let pose = [reader.f64()?, reader.f64()?, reader.f64()?];
        reader.is_at_end().then_some(pose)
    };
    of_base(0, read().ok_or(Malformed::Cdr)?)
}

/// `sensor_msgs/JointState`, whose positions are goals of the joints that it names, in any order; velocities and efforts are
/// not looked at. The goal's stamp is the header's, ns since 1970.
///
/// # Errors
/// Where it is no such message, not finite, or does not fit `joints`.
pub fn joint_state(message: &[u8], joints: &[String]) -> Result<MissionGoal, Malformed> {
    let mut reader = Reader::new(message).ok_or(Malformed::Cdr)?;
    let (stamp_ns, _) = reader.header().ok_or(Malformed::Cdr)?;
    let mut goal = silent(stamp_ns);
    let mut named = [usize::MAX; MAX_LINKS];
    let count = reader.u32().ok_or(Malformed::Cdr)? as usize;
    for i in 0..count {
        let name = reader.text().ok_or(Malformed::Cdr)?;
        let joint = joints.iter().position(|joint| joint == name).ok_or(Malformed::Joint)?;
        if named[..i.min(MAX_LINKS)].contains(&joint) {
            return Err(Malformed::Joint);
        }
        *named.get_mut(i).ok_or(Malformed::Joint)? = joint;
    }
    let positions = reader.u32().ok_or(Malformed::Cdr)? as usize;
    if positions != count || count == 0 {
        return Err(Malformed::Positions);
    }
    for joint in named.into_iter().take(count) {
        let q_rad = reader.f64().ok_or(Malformed::Cdr)?;
        if !q_rad.is_finite() {
            return Err(Malformed::NotFinite);
        }
        *goal.q_goal_rad.get_mut(joint).ok_or(Malformed::Joint)? = q_rad;
    }
    for _velocities_then_efforts in 0..2 {
        for _ in 0..reader.u32().ok_or(Malformed::Cdr)? {
            reader.f64().ok_or(Malformed::Cdr)?;
        }
    }
    if reader.is_at_end() { Ok(goal) } else { Err(Malformed::Cdr) }
}
