//! The front door: the one crate that a service written elsewhere depends on.
//!
//! A service is a pure step ([`Service`]): it reads its input ports, writes its output ports, and knows neither clock, socket nor
//! shared memory. [`Program`] says how it is made from the launch file, and [`main!`] makes the program that a launcher starts,
//! watches, restarts and stops, records and replays as it does fss's own services.
//!
//! ```no_run
//! use fss_service::{Latest, Output, Program, Refusal, Service, Site, Time, inputs, main, message, outputs, topic, topics};
//! use fss_service::messages::NavState;
//! use serde::Deserialize;
//!
//! message! {
//!     package damper_msgs;
//!     /// What the damper wants.
//!     DamperState {
//!         /// torque on the base, N m
//!         torque_nm: f64,
//!     }
//! }
//!
//! topic! {
//!     /// What the damper wants; published by `damper`.
//!     STATE: DamperState = "/damper/state",
//! }
//!
//! inputs! {
//!     /// What it reads.
//!     pub struct Inputs {
//!         /// Where the base is, and how it moves.
//!         nav: Latest<NavState> = topics::NAV_STATE,
//!     }
//! }
//!
//! outputs! {
//!     /// What it writes.
//!     pub struct Outputs {
//!         /// Once a step.
//!         state: Output<DamperState> = STATE,
//!     }
//! }
//!
//! /// `config = { gain_nm_s_rad = 0.5 }` in the launch file.
//! #[derive(Deserialize)]
//! #[serde(deny_unknown_fields)]
//! pub struct Config {
//!     gain_nm_s_rad: f64,
//! }
//!
//! pub struct Damper(Config);
//!
//! impl Service for Damper {
//!     type Inputs = Inputs;
//!     type Outputs = Outputs;
//!     const NAME: &'static str = "damper";
//!
//!     fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
//!         // Navigation that is older than 100 ms counts as none.
//!         let Some(nav) = inputs.nav.within(now, 100_000_000) else { return };
//!         let torque_nm = -self.0.gain_nm_s_rad * nav.omega_rad_s;
//!         outputs.state.publish(DamperState { stamp_ns: now.ns(), torque_nm, ..DamperState::default() });
//!     }
//! }
//!
//! impl Program for Damper {
//!     type Config = Config;
//!
//!     fn new(config: Config, _site: &Site) -> Result<Self, Refusal> {
//!         if config.gain_nm_s_rad < 0.0 {
//!             return Err("gain_nm_s_rad: a damper takes energy out; give a gain of zero or more".into());
//!         }
//!         Ok(Self(config))
//!     }
//! }
//!
//! main!(Damper);
//! ```
//!
//! A program with a loop of its own, which no launcher starts, joins a stack that runs by its prefix in shared memory (`fss_N_` where N is
//! the process number of `fss run`):
//!
//! ```no_run
//! use fss_service::{Bus, InputPort, Latest, SharedConfig, realtime, topics};
//!
//! let bus = Bus::shared(&SharedConfig { node: "display".to_owned(), prefix: "fss_1234_".to_owned() })?;
//! let mut nav = Latest::open(&bus, topics::NAV_STATE)?;
//! loop {
//!     nav.refresh();
//!     if let Some(nav) = nav.within(realtime::now()?, 100_000_000) {
//!         println!("{:.3} m", nav.x_m);
//!     }
//!     std::thread::sleep(std::time::Duration::from_millis(100));
//! }
//! # #[allow(unreachable_code)]
//! # Ok::<(), fss_service::Refusal>(())
//! ```
//!
//! [`Process`] is what [`main!`] stands on: a process's stack, for programs that come with fss. [`RawProgram`] is what bindings to other
//! languages stand on.

mod description;
mod explain;
mod process;
mod program;
mod site;

pub use description::{Description, FORMAT, PROGRAMS_FILE, PortDescription, ProgramEntry, read_programs, topics_of};
pub use explain::explain_errors;
pub use fss_bus::{
    Batch, Bus, InputPort, Latest, Output, OutputPort, Service, SharedConfig, Time, inputs, outputs, realtime,
};
pub use fss_messages as messages;
pub use fss_messages::topic as topics;
pub use process::{LAUNCH_FILE, MISSION_FILE, PLANT_FILE, Process, STOP_TIME, SiteArgs, stop_on_signal};
pub use program::{NoConfig, Program, RawProgram, config_of, run, run_raw};
pub use site::{Refusal, Site};

/// Defines messages of a package: of each the struct, its ROS 2 definition and the hash of its layout.
///
/// Each begins with `sequence`, `stamp_ns` and `published_ns`; the fields follow by size (8 bytes first), filled with `reserved0:
/// [u8; N]` up to a multiple of 8 bytes. A field is a `u8`, `u16`, `u32`, `u64`, `i64`, `f64` or an array of them. Its documentation
/// says the unit, and goes into the definition.
///
/// ```
/// fss_service::message! {
///     package damper_msgs;
///     /// What the damper wants.
///     DamperState {
///         /// torque on the base, N m
///         torque_nm: f64,
///         /// 1 while it acts
///         active: u8,
///         /// zero
///         reserved0: [u8; 7],
///     }
/// }
///
/// use fss_service::messages::Sample;
/// assert_eq!(DamperState::FIELDS[3].name, "torque_nm");
/// assert!(DamperState::TYPE_NAME.starts_with("damper_msgs/DamperState@"));
/// ```
#[macro_export]
macro_rules! message {
    (package $package:ident; $($messages:tt)+) => {
        $crate::messages::define_messages! {
            zerocopy "fss_service::messages::private::zerocopy";
            package $package;
            $($messages)+
        }
    };
}

/// Defines topics: a name for the program, the message, and the name for the world.
///
/// A topic's name is ROS style: `/NAME/state`, of lower-case letters, digits and underscores.
#[macro_export]
macro_rules! topic {
    ($( #[doc = $doc:literal] $vis:vis $name:ident: $message:ty = $topic:literal ),* $(,)?) => {$(
        #[doc = $doc]
        $vis const $name: $crate::topics::Topic<$message> = {
            assert!($crate::topics::is_name($topic), "a topic's name reads /word/word, of lower-case letters, digits and underscores");
            $crate::topics::Topic::new($topic)
        };
    )*};
}

/// Makes the program of a service: `main!(MyService);` stands for `fn main`.
#[macro_export]
macro_rules! main {
    ($service:ty) => {
        fn main() -> std::process::ExitCode {
            $crate::run::<$service>()
        }
    };
}
