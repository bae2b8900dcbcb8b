//! The samples themselves.

use crate::schema::samples;
use crate::{MAX_LINKS, MAX_PORTS, MAX_SINES, MAX_THRUSTERS};

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

    /// Where the mission stands and what it wants of base and arm.
    MissionState {
        consts {
            /// waits for navigation and telemetry
            WAITING = 0;
            /// flies its phases
            RUNNING = 1;
            /// all phases done
            DONE = 2;
            /// gave up; the safe thing is done
            ABORTED = 3;
            /// thrusters shut, base floats freely
            BASE_FREE = 0;
            /// hold or reach base_goal
            BASE_HOLD = 1;
            /// open the valves of `valves`, whatever the base does
            BASE_VALVES = 2;
            /// stop turning and drifting with the least gas, wherever that is
            BASE_STOP = 3;
            /// drivers off
            ARM_OFF = 0;
            /// hold the joints where they are
            ARM_HOLD = 1;
            /// move the joints to q_goal_rad
            ARM_JOINTS = 2;
            /// straight line of the end-effector, minimum-norm joint rates
            ARM_LINE = 3;
            /// the same, base kept from turning by the arm alone; position of the end-effector only
            ARM_ZERO_REACTION = 4;
            /// the same, position and orientation of the end-effector
            ARM_ZERO_REACTION_POSE = 5;
            /// straight line of the end-effector with its orientation kept
            ARM_LINE_POSE = 6;
            /// move the joints in sines about q_goal_rad
            ARM_SINES = 7;
            /// end-effector to the target's handle, base kept from turning by the arm alone
            ARM_CAPTURE = 8;
        }
        /// when the phase began, ns, monotonic clock
        phase_start_ns: u64,
        /// base goal: x m, y m, theta rad in the table frame
        base_goal: [f64; 3],
        /// how fast base_goal itself moves: m/s, m/s, rad/s; base_goal is where it is at phase_start_ns
        base_goal_rate: [f64; 3],
        /// time over which the base goal is approached, s
        base_duration_s: f64,
        /// joint goal, encoder angles, rad
        q_goal_rad: [f64; MAX_LINKS],
        /// amplitudes of the joints' sines, MAX_SINES for joint 1, then for joint 2 and so on, rad
        sine_amplitude_rad: [f64; MAX_LINKS * MAX_SINES],
        /// their frequencies, Hz
        sine_frequency_hz: [f64; MAX_LINKS * MAX_SINES],
        /// their phases at the start of the phase, rad
        sine_phase_rad: [f64; MAX_LINKS * MAX_SINES],
        /// length of the line, m
        line_length_m: f64,
        /// direction of the line in the table frame, rad
        line_direction_rad: f64,
        /// time over which the arm's goal is reached, s
        arm_duration_s: f64,
        /// target as motion capture shows it, brought to stamp_ns: x m, y m, theta rad
        target: [f64; 3],
        /// its rates, m/s, m/s, rad/s
        target_rate: [f64; 3],
        /// phase, counted from 0
        phase: u32,
        /// how many phases the mission has
        phase_count: u32,
        /// valves to open, 1 for open
        valves: [u8; MAX_THRUSTERS],
        /// 0 waiting, 1 running, 2 done, 3 aborted
        state: u8,
        /// what the base does, one of BASE_*
        base_mode: u8,
        /// what the arm does, one of ARM_*
        arm_mode: u8,
        /// 1 where base_goal counts from where the base is at the start of the phase
        base_goal_relative: u8,
        /// 1 where target and target_rate are good
        target_seen: u8,
        /// 1 where the gripper shall be closed
        gripper: u8,
        /// 1 where the arm holds the target
        target_held: u8,
        /// zero
        reserved0: u8,
    }

    /// What the arm controller tells the joints, and how its task goes.
    ArmCommand {
        consts {
            /// drivers off
            OFF = 0;
            /// follow q_rad
            POSITION = 1;
            /// follow qd_rad_s
            VELOCITY = 2;
            /// give current_a
            CURRENT = 3;
        }
        /// commanded encoder angles, rad
        q_rad: [f64; MAX_LINKS],
        /// commanded joint rates, rad/s
        qd_rad_s: [f64; MAX_LINKS],
        /// commanded currents, A
        current_a: [f64; MAX_LINKS],
        /// where the task wants the end-effector now: x m, y m, angle rad, table frame
        ee_goal: [f64; 3],
        /// where the controller believes it is
        ee: [f64; 3],
        /// smallest singular value of the task's Jacobian
        sigma_min: f64,
        /// share of the task done, 0 to 1
        progress: f64,
        /// how many links there are
        link_count: u32,
        /// one of the constants
        mode: u8,
        /// 1: the controller holds because an input is stale
        holding: u8,
        /// 1: the task met a singularity or joint limits it cannot pass, and stopped there
        blocked: u8,
        /// 1: the gripper shall be closed
        gripper: u8,
        /// 1 where a joint stands at its limit
        limited: [u8; MAX_LINKS],
    }

    /// The wrench that the base controller wants, and its errors.
    BaseCommand {
        consts {
            /// thrusters shut
            OFF = 0;
            /// controlled
            CONTROL = 1;
            /// an input is stale: thrusters shut
            STALE = 2;
            /// the mission's own valves
            OPEN_LOOP = 3;
        }
        /// wanted force in body axes, N
        force_x_n: f64,
        /// wanted force in body axes, N
        force_y_n: f64,
        /// wanted torque, N m
        torque_nm: f64,
        /// reference pose now: x m, y m, theta rad
        reference: [f64; 3],
        /// pose less reference: x m, y m, theta rad
        error: [f64; 3],
        /// wanted share of open time of each thruster, 0 to 1
        duty_cycle: [f64; MAX_THRUSTERS],
        /// one of the constants
        mode: u8,
        /// 1: the wanted wrench is more than the thrusters have
        saturated: u8,
        /// zero
        reserved0: [u8; 6],
    }

    /// Which valves shall be open.
    ThrustersCommand {
        /// 1 for open
        valves: [u8; MAX_THRUSTERS],
        /// how many valves there are
        valve_count: u32,
        /// zero
        reserved0: u32,
    }

    /// Which valves are commanded open at the driver.
    ThrustersState {
        consts {
            /// waits for the first command: valves shut
            IDLE = 0;
            /// applies commands
            ACTIVE = 1;
            /// commands stopped: valves shut by the dead-man
            DEAD_MAN = 2;
            /// the driver does not answer
            DRIVER_FAULT = 3;
        }
        /// time that each valve has been commanded open since the start, ns
        open_time_ns: [u64; MAX_THRUSTERS],
        /// age of the last command, ns
        command_age_ns: u64,
        /// measurement whose age this is when its command leaves: stamp of the command, ns
        command_stamp_ns: u64,
        /// 1 for open
        valves: [u8; MAX_THRUSTERS],
        /// how many valves there are
        valve_count: u32,
        /// one of the constants
        mode: u8,
        /// 1 where the driver's last word was that it could set the valves, or it has not said anything yet
        driver_works: u8,
        /// zero
        reserved0: [u8; 2],
    }

    /// Something that happened.
    Event {
        consts {
            /// for those who look for a fault
            DEBUG = 0;
            /// normal
            INFO = 1;
            /// a limit is near or something is degraded
            WARNING = 2;
            /// something failed and was handled
            ERROR = 3;
            /// the vehicle goes to safe mode
            CRITICAL = 4;
        }
        /// who says it, UTF-8, filled with zeros
        service: [u8; 16],
        /// what, UTF-8, filled with zeros
        text: [u8; 160],
        /// one of the constants
        severity: u8,
        /// zero
        reserved0: [u8; 7],
    }

    /// How a service keeps its rate.
    Health {
        /// the service, UTF-8, filled with zeros
        service: [u8; 16],
        /// steps since the start
        cycles: u64,
        /// steps that ended after their deadline
        overruns: u64,
        /// boundaries missed and skipped
        skipped: u64,
        /// samples that could not be published or queued
        dropped: u64,
        /// wake-up latency, median since the last report, ns
        wake_p50_ns: u64,
        /// wake-up latency, 99th percentile, ns
        wake_p99_ns: u64,
        /// wake-up latency, largest, ns
        wake_max_ns: u64,
        /// step time, median, ns
        step_p50_ns: u64,
        /// step time, 99th percentile, ns
        step_p99_ns: u64,
        /// step time, largest, ns
        step_max_ns: u64,
        /// age of each input at the last step, in the order of the service's ports, ns; all ones where never received
        input_age_ns: [u64; 8],
        /// the rate that the launch file gives, Hz
        rate_hz: f64,
        /// times that this service has been started in this run
        starts: u32,
        /// 1 with real-time scheduling
        real_time: u8,
        /// 1 with locked memory
        memory_locked: u8,
        /// zero
        reserved0: [u8; 2],
    }

    /// One step of a service at stamp_ns, with what it used; all that it published has this sample's published_ns.
    Step {
        /// the service, UTF-8, filled with zeros
        service: [u8; 16],
        /// at each port the sequence of the sample in hand, or how many messages came from a device
        input: [u64; MAX_PORTS],
        /// steps since the service was started, counted from 1
        step: u64,
        /// 1 where something came at this port since the step before
        fresh: [u8; MAX_PORTS],
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

    /// What the simulated laboratory knows.
    TruthState {
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
        /// joint angles (encoder zero), rad
        q_rad: [f64; MAX_LINKS],
        /// joint rates, rad/s
        qd_rad_s: [f64; MAX_LINKS],
        /// motor currents, A
        current_a: [f64; MAX_LINKS],
        /// torque through each joint, N m
        torque_nm: [f64; MAX_LINKS],
        /// end-effector: x m, y m, angle rad
        ee: [f64; 3],
        /// target body: x m, y m, theta rad
        target: [f64; 3],
        /// target body: vx m/s, vy m/s, omega rad/s
        target_rate: [f64; 3],
        /// thrust of each thruster, N
        thrust_n: [f64; MAX_THRUSTERS],
        /// linear momentum in table axes, kg m/s
        momentum: [f64; 2],
        /// angular momentum about the system's centre of mass, kg m2/s
        angular_momentum: f64,
        /// pressure in the tank, Pa
        tank_pressure_pa: f64,
        /// gas used since the start, kg
        gas_used_kg: f64,
        /// when the gripper took hold of the target, ns, monotonic clock; 0 before
        grasp_ns: u64,
        /// momentum of vehicle and target together just before: kg m/s, kg m/s, kg m2/s about the table's middle
        grasp_momentum_before: [f64; 3],
        /// the same just after
        grasp_momentum_after: [f64; 3],
        /// distance of the end-effector from the target's handle when it took hold, m
        grasp_miss_m: f64,
        /// speed of the end-effector past the handle then, m/s
        grasp_speed_m_s: f64,
        /// 1 while the target is held
        target_held: u64,
        /// how many links there are
        link_count: u32,
        /// how many thrusters there are
        valve_count: u32,
        /// valve commands that the laboratory sees
        valves: [u8; MAX_THRUSTERS],
    }
}
