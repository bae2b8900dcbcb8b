//! A laboratory's own program: every command of fss, with a service of the laboratory linked in. Its launch file has the service as
//! a table without `program`:
//!
//! ```toml
//! [[service]]
//! name = "turn_meter"
//! config = { smoothing_s = 0.5 }
//! rate_hz = 50
//! ```

use fss::Services;
use turn_meter::TurnMeter;

fn main() -> std::process::ExitCode {
    fss::main(Services::of_fss().with::<TurnMeter>())
}

/// The service, as one that is a program of its own; there it would lie in a file.
#[allow(unreachable_pub)]
mod turn_meter {
    use fss_service::messages::NavState;
    use fss_service::{Batch, Output, Program, Refusal, Service, Site, Time, inputs, message, outputs, topic, topics};
    use serde::Deserialize;

    message! {
        package turn_meter_msgs;
        /// How fast the base turns.
        TurnState {
            /// smoothed rate of the base, rad/s
            omega_rad_s: f64,
        }
    }

    topic! {
        /// How fast the base turns; published once a step.
        STATE: TurnState = "/turn_meter/state",
    }

    inputs! {
        /// What it reads.
        pub struct Inputs {
            /// How the base moves: every sample since the step before.
            nav: Batch<NavState> = topics::NAV_STATE,
        }
    }

    outputs! {
        /// What it writes.
        pub struct Outputs {
            /// Once a step.
            state: Output<TurnState> = STATE,
        }
    }

    /// What `config` of its table says.
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Config {
        /// Time constant of the smoothing, s.
        smoothing_s: f64,
    }

    /// The service.
    pub struct TurnMeter {
        /// Share of a new rate in the smoothed one.
        gain: f64,
        omega_rad_s: f64,
    }

    impl Program for TurnMeter {
        type Config = Config;

        fn new(config: Config, site: &Site) -> Result<Self, Refusal> {
            if config.smoothing_s < 0.0 {
                return Err("smoothing_s is a time of zero or more".into());
            }
            Ok(Self { gain: 1.0 / (1.0 + config.smoothing_s * site.rate_hz), omega_rad_s: 0.0 })
        }
    }

    impl Service for TurnMeter {
        type Inputs = Inputs;
        type Outputs = Outputs;
        const NAME: &'static str = "turn_meter";

        fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
            for nav in inputs.nav.samples() {
                self.omega_rad_s += self.gain * (nav.omega_rad_s - self.omega_rad_s);
            }
            let omega_rad_s = self.omega_rad_s;
            outputs.state.publish(TurnState { stamp_ns: now.ns(), omega_rad_s, ..TurnState::default() });
        }
    }
}
