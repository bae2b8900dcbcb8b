//! How a stack flies a service that is linked into its program.

use crate::replay::player::{FromDevice, Player, Verdict, replay};
use crate::replay::tape::Tape;
use crate::seat::Seat;
use crate::stack::Stack;
use fss_bus::virtual_time::Tick;
use fss_bus::{Bus, Runner, Service};
use fss_messages::Step;
use fss_service::{Description, Program, config_of};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::marker::PhantomData;

/// On which clock a service flies, and what that knows.
pub(crate) enum Flight<'a> {
    /// In real time, as a process.
    RealTime(&'a Seat),
    /// On the virtual clock, with the seed of everything random.
    Virtual(u64),
    /// Again from a log: the steps of one of its lives.
    Replay(&'a Tape, &'a [Step]),
}

/// The config of the service that is linked so.
pub(crate) type ConfigOf<L> = <<L as Linked>::Service as Program>::Config;

/// A service, what it is told, and its devices.
pub(crate) trait Linked: Send + Sync {
    /// The service.
    type Service: Program + 'static;
    /// Whether the launch file says its config.
    const IS_GUEST: bool = false;

    /// What it is told.
    ///
    /// # Errors
    /// Where the stack's files do not say it.
    fn config(&self, stack: &Stack, flight: &Flight<'_>) -> Result<ConfigOf<Self>>;

    /// Runs it in real time with its devices, until it is told to stop.
    ///
    /// # Errors
    /// Where a device or a topic cannot be opened, or the loop fails.
    fn fly(&self, seat: &Seat, service: Self::Service) -> Result<()> {
        seat.fly(service, || ()).map(|_| ())
    }

    /// What stands for its devices in a log.
    ///
    /// # Errors
    /// Where the log does not have their topics.
    fn devices<'a>(&self, _bus: &Bus, _tape: &'a Tape) -> Result<Vec<FromDevice<'a>>> {
        Ok(Vec::new())
    }
}

/// A service that does not come with fss, and has no device that the launcher knows of.
pub(super) struct Guest<S>(PhantomData<fn() -> S>);

impl<S> Guest<S> {
    pub(super) fn new() -> Self {
        Self(PhantomData)
    }
}

impl<S: Program + 'static> Linked for Guest<S> {
    type Service = S;
    const IS_GUEST: bool = true;

    fn config(&self, stack: &Stack, _flight: &Flight<'_>) -> Result<S::Config> {
        config_of::<S>(&stack.schedule(S::NAME)?.config_text())
    }
}

/// A linked service, whatever its type.
pub(crate) trait Entry: Send + Sync {
    /// Its name in launch files.
    fn name(&self) -> &'static str;
    /// What it reads and writes.
    fn description(&self) -> Description;
    /// Whether it came from elsewhere: then the launch file says its config, and the log its description.
    fn is_guest(&self) -> bool;
    /// Whether it takes this config, TOML.
    ///
    /// # Errors
    /// Says what is wrong with it.
    fn check(&self, config: &str) -> Result<()>;
    /// Runs it as a process.
    ///
    /// # Errors
    /// Where it cannot be made, a device or a topic not be opened, or the loop fails.
    fn run(&self, seat: &Seat) -> Result<()>;
    /// Makes it for the virtual clock.
    ///
    /// # Errors
    /// Where it cannot be made, or the bus refuses a port.
    fn on_virtual_clock(&self, stack: &Stack, bus: &Bus, seed: u64) -> Result<Box<dyn Tick>>;
    /// Adds its topics to a tape.
    fn with_ports(&self, tape: Tape) -> Tape;
    /// Computes it again.
    ///
    /// # Errors
    /// Where it cannot be made.
    fn replay(&self, stack: &Stack, tape: &Tape) -> Result<Verdict>;
}

fn make<L: Linked>(linked: &L, stack: &Stack, flight: &Flight<'_>, starts: u32) -> Result<L::Service> {
    let (config, site) = (linked.config(stack, flight)?, stack.site(L::Service::NAME, starts)?);
    // By its trait's name: a service may have a `new` of its own.
    let made = <L::Service as Program>::new(config, &site);
    made.map_err(|e| miette!("{e}")).wrap_err(L::Service::NAME)
}

impl<L: Linked> Entry for L {
    fn name(&self) -> &'static str {
        L::Service::NAME
    }

    fn description(&self) -> Description {
        Description::of::<L::Service>()
    }

    fn is_guest(&self) -> bool {
        L::IS_GUEST
    }

    fn check(&self, config: &str) -> Result<()> {
        config_of::<L::Service>(config).map(|_| ())
    }

    fn run(&self, seat: &Seat) -> Result<()> {
        let service = make(self, &seat.stack, &Flight::RealTime(seat), seat.starts)?;
        self.fly(seat, service)
    }

    fn on_virtual_clock(&self, stack: &Stack, bus: &Bus, seed: u64) -> Result<Box<dyn Tick>> {
        let service = make(self, stack, &Flight::Virtual(seed), 1)?;
        Ok(Box::new(Runner::new(service, bus).into_diagnostic()?))
    }

    fn with_ports(&self, tape: Tape) -> Tape {
        tape.with_ports_of::<L::Service>()
    }

    fn replay(&self, stack: &Stack, tape: &Tape) -> Result<Verdict> {
        replay(tape, |life, start| {
            let bus = Bus::local().for_stack(&stack.launch);
            let service = make(self, stack, &Flight::Replay(tape, life), start)?;
            let devices = self.devices(&bus, tape)?;
            Player::new(service, &bus, tape, devices)
        })
    }
}
