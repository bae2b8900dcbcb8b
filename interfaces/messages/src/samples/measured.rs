//! What sensors and navigation say.

use crate::MAX_LINKS;
use crate::define::samples;

samples! {
    /// Pose of a tracked body in the table frame.
    MocapPose {
        consts {
            /// a good measurement
            VALID = 0;
            /// the tracker repeated its last frame
            REPEATED = 1;
            /// exact zeros: the tracker does not see the body
            OCCLUDED = 2;
            /// the tracker's frame number went backwards
            OUT_OF_ORDER = 3;
        }
        /// position along the table's x axis, m
        x_m: f64,
        /// position along the table's y axis, m
        y_m: f64,
        /// heading, counter-clockwise from the table's x axis, rad
        theta_rad: f64,
        /// time of receipt, ns, monotonic clock; stamp_ns is this less the nominal latency
        received_ns: u64,
        /// the tracker's frame number
        frame: u32,
        /// quality, one of the constants
        quality: u8,
        /// zero
        reserved0: [u8; 3],
    }

    /// Angular rate of the base from the fibre-optic gyro.
    GyroRate {
        /// rate about the vertical, counter-clockwise positive, rad/s; the mean since the last reading
        omega_rad_s: f64,
        /// time of receipt, ns, monotonic clock
        received_ns: u64,
        /// 1 where the unit calls its reading valid
        valid: u8,
        /// zero
        reserved0: [u8; 7],
    }

    /// Navigation state of the base: pose in the table frame, rates, uncertainty and the filter's health.
    NavState {
        consts {
            /// no measurement of the pose yet
            INITIALISING = 0;
            /// gyro and motion capture are both used
            TRACKING = 1;
            /// motion capture is missing: gyro and model carry the state
            COASTING = 2;
            /// coasted for too long to be trusted
            LOST = 3;
            /// motion capture only: the gyro is missing or faulty
            NO_GYRO = 4;
        }
        /// position of the base frame's origin, m
        x_m: f64,
        /// position of the base frame's origin, m
        y_m: f64,
        /// heading, unwrapped, rad
        theta_rad: f64,
        /// velocity in table axes, m/s
        vx_m_s: f64,
        /// velocity in table axes, m/s
        vy_m_s: f64,
        /// angular rate, rad/s
        omega_rad_s: f64,
        /// estimated gyro bias, rad/s
        gyro_bias_rad_s: f64,
        /// standard deviations of x, y, theta, vx, vy, omega, bias
        std: [f64; 7],
        /// last innovation of motion capture: x m, y m, theta rad
        innovation: [f64; 3],
        /// squared Mahalanobis distance of the last innovation, 3 degrees of freedom
        innovation_d2: f64,
        /// age of the last used motion capture measurement, ns
        mocap_age_ns: u64,
        /// age of the last used gyro reading, ns
        gyro_age_ns: u64,
        /// motion capture measurements refused by the innovation gate since the start
        rejected: u32,
        /// one of the constants
        mode: u8,
        /// zero
        reserved0: [u8; 3],
    }

    /// Telemetry of all links: extrapolated to `stamp_ns`, with the measurement it came from and its age.
    LinksState {
        consts {
            /// driver mode: off, the joint turns freely
            DRIVER_OFF = 0;
            /// driver mode: holds or approaches an angle
            DRIVER_POSITION = 1;
            /// driver mode: follows a rate
            DRIVER_VELOCITY = 2;
            /// driver mode: gives a current
            DRIVER_CURRENT = 3;
            /// fault bit: the driver reports a fault
            FAULT_DRIVER = 1;
            /// fault bit: the torque sensor is saturated
            FAULT_TORQUE_SENSOR = 2;
            /// fault bit: the joint stands at its limit
            FAULT_JOINT_LIMIT = 4;
            /// fault bit: commands stopped and the link shut its driver off
            FAULT_COMMAND_TIMEOUT = 8;
            /// fault bit: the battery is low
            FAULT_BATTERY_LOW = 16;
            /// fault bit: the driver gives less torque than it would need
            FAULT_TORQUE_LIMIT = 32;
            /// no fault: the gripper at this link's end holds something
            GRIPPING = 64;
        }
        /// encoder angles extrapolated to stamp_ns, rad
        q_rad: [f64; MAX_LINKS],
        /// joint rates as last measured, rad/s
        qd_rad_s: [f64; MAX_LINKS],
        /// motor currents as last measured, A
        current_a: [f64; MAX_LINKS],
        /// torque sensors as last measured, N m
        torque_nm: [f64; MAX_LINKS],
        /// encoder angles as last measured, rad
        measured_q_rad: [f64; MAX_LINKS],
        /// when these were measured, ns, monotonic clock
        measured_ns: [u64; MAX_LINKS],
        /// age of the measurement at stamp_ns, ns
        age_ns: [u64; MAX_LINKS],
        /// battery voltages, V
        battery_v: [f64; MAX_LINKS],
        /// sequence of each link's last accepted telemetry datagram
        telemetry_sequence: [u64; MAX_LINKS],
        /// sequence of the last command sent to each link
        command_sequence: [u64; MAX_LINKS],
        /// sequence of the last command each link has acknowledged
        acknowledged_sequence: [u64; MAX_LINKS],
        /// telemetry datagrams lost since the start, by gaps in their sequence
        lost: [u32; MAX_LINKS],
        /// how many links there are
        link_count: u32,
        /// telemetry datagrams refused (damaged, repeated, out of order) since the start
        refused: u32,
        /// 1 where the link's telemetry is younger than its maximum age
        alive: [u8; MAX_LINKS],
        /// the driver's mode, one of DRIVER_*
        driver_mode: [u8; MAX_LINKS],
        /// fault bits, FAULT_*
        fault: [u8; MAX_LINKS],
    }

    /// A datagram of telemetry as a link sent it, whatever is in it.
    LinkDatagram {
        /// time of receipt, ns, monotonic clock
        received_ns: u64,
        /// how many bytes it has
        len: u32,
        /// the bytes, filled with zeros
        bytes: [u8; 64],
        /// zero
        reserved0: [u8; 4],
    }

    /// A posture in which the arm stands still, as seen so far: the last sample of each `since_ns` says all of it.
    Posture {
        /// when the arm came to rest, ns, monotonic clock
        since_ns: u64,
        /// encoder angles, mean of the reports, rad
        q_rad: [f64; MAX_LINKS],
        /// end-effector in the base frame, mean of the frames: x m, y m, angle rad
        tip: [f64; 3],
        /// standard deviations of single frames about that mean: x m, y m, angle rad
        scatter: [f64; 3],
        /// reports of every link that count
        reports: u32,
        /// frames of motion capture that count
        frames: u32,
        /// how many links there are
        link_count: u32,
        /// postures that this process has seen, this one included
        number: u32,
    }
}
