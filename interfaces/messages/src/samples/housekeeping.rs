//! What the stack says of itself.

use crate::MAX_PORTS;
use crate::define::samples;

samples! {
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
        /// of the steps since the last report that ended after their deadline, the latest one's boundary, ns; 0 where none
        overrun_boundary_ns: u64,
        /// how long that one had ended after its boundary, ns
        overrun_end_ns: u64,
        /// how long it had ended after its deadline, ns
        overrun_excess_ns: u64,
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

    /// What the bridge of this host hears of another vehicle.
    PeerState {
        /// the other vehicle, or `ros2` for its nodes, UTF-8, filled with zeros
        vehicle: [u8; 16],
        /// what brings that vehicle's times to this host's clock when it is added, ns; late by the shortest way of a sample
        clock_offset_ns: i64,
        /// age of its newest sample when that came, by this offset, ns
        age_ns: u64,
        /// samples taken since the start of the bridge
        received: u64,
        /// refused: older than the launch file allows
        refused_age: u64,
        /// refused: doubled, or overtaken on the way
        refused_sequence: u64,
        /// refused: another build's layout, another type of message
        refused_layout: u64,
        /// refused: not readable at all
        refused_form: u64,
        /// refused: more samples a second than the launch file allows
        refused_rate: u64,
        /// refused: beyond the launch file's bounds
        refused_bounds: u64,
        /// refused: on a topic that the launch file does not name
        refused_topic: u64,
        /// lost on this host because a queue was full
        lost: u64,
        /// samples that this host's bridge has handed to the network, for whoever listens
        sent: u64,
        /// 1 while it is heard
        speaks: u8,
        /// zero
        reserved0: [u8; 7],
    }
}
