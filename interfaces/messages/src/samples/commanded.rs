//! What is wanted of the vehicle, and what its valves do.

use crate::define::samples;
use crate::{MAX_LINKS, MAX_SINES, MAX_THRUSTERS};

samples! {
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
            /// lead the joints to q_goal_rad, which may change at any time
            ARM_FOLLOW = 9;
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
        /// target as its own navigation or motion capture shows it, brought to stamp_ns: x m, y m, theta rad
        target: [f64; 3],
        /// its rates, m/s, m/s, rad/s
        target_rate: [f64; 3],
        /// where the base carries the target in this phase: x m, y m, theta rad in the table frame
        target_goal: [f64; 3],
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
        /// 1 where the base carries the target to target_goal
        carrying: u8,
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
}
