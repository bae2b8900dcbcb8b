//! What a researcher may tune in flight, and what the ground may command.

use crate::MAX_LINKS;
use crate::define::samples;
use crate::parameter::Parameter;

/// Defines the parameters that can be tuned in flight: name with unit, whose it is, default, bounds, meaning. From that come
/// the sample that carries them, a field each, and the table [`PARAMETERS`].
macro_rules! parameters {
    ($(
        #[doc = $doc:literal]
        $name:ident of $service:literal: $default:literal within [$least:literal, $most:literal];
    )*) => {
        samples! {
            /// Values of parameters that can be tuned in flight; not a number where the sample says nothing of one.
            Parameters {
                /// who says it, UTF-8, filled with zeros
                service: [u8; 16],
                $( #[doc = $doc] $name: f64, )*
            }

            /// What the ground wants of the mission.
            MissionCommand {
                consts {
                    /// leave the phases: on the way out that the phase has, else as STOP
                    ABORT = 1;
                    /// end at once: thrusters shut, joints held
                    STOP = 2;
                }
                /// one of the constants
                command: u8,
                /// zero
                reserved0: [u8; 7],
            }

            /// Where a controller outside the stack wants base and arm; not a number where it says nothing.
            MissionGoal {
                /// pose of the base: x m, y m, theta rad in the table frame
                base_goal: [f64; 3],
                /// encoder angles of the joints, rad
                q_goal_rad: [f64; MAX_LINKS],
            }
        }

        /// Every parameter that can be tuned in flight.
        pub const PARAMETERS: &[Parameter] = &[$(
            Parameter {
                name: stringify!($name),
                doc: $doc.trim_ascii(),
                service: $service,
                default: $default,
                least: $least,
                most: $most,
                get: |values| values.$name,
                set: |values, value| values.$name = value,
            },
        )*];
    };
}

parameters! {
    /// bandwidth of the base's pose loop, rad/s
    base_bandwidth_rad_s of "base": 0.45 within [0.1, 1.2];
    /// damping ratio of the base's pose loop
    base_damping_ratio of "base": 1.0 within [0.4, 2.0];
    /// wanted accelerations of the base below which nothing is done, m/s2
    base_dead_band_m_s2 of "base": 5e-4 within [0.0, 5e-3];
    /// wanted angular acceleration of the base below which nothing is done, rad/s2
    base_dead_band_rad_s2 of "base": 1e-3 within [0.0, 1e-2];
    /// feedback of the end-effector's position and angle on lines, 1/s
    arm_line_gain_1_s of "arm": 0.8 within [0.0, 2.0];
    /// feedback of the base's attitude in zero-reaction maneuvers, 1/s
    arm_attitude_gain_1_s of "arm": 1.0 within [0.0, 2.0];
    /// how strongly a line's freedom keeps joints from their limits, rad2/s
    arm_centring_gain_rad2_s of "arm": 0.06 within [0.0, 0.2];
    /// rate limit of the joints where their servos allow as much, rad/s
    arm_max_rate_rad_s of "arm": 0.3 within [0.02, 0.3];
}
