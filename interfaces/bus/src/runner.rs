//! A service with its ports: what all three ways to run it share.

use crate::{Bus, BusError, InputPorts, Output, OutputPort, OutputPorts, Time};
use fss_messages::{Step, text, topic};

/// A pure step: no clock, no socket, no shared memory, no allocation in `step`.
pub trait Service {
    /// What it reads.
    type Inputs: InputPorts;
    /// What it writes.
    type Outputs: OutputPorts;
    /// Its name in launch files, health and events.
    const NAME: &'static str;
    /// Whether it steps once more when it is asked to stop, so that nothing that came since its last step is lost.
    const TAKES_THE_LAST: bool = false;

    /// One step at `now`.
    fn step(&mut self, now: Time, inputs: &Self::Inputs, outputs: &mut Self::Outputs);

    /// How long the device's measurement that came with the last step had waited for it since its receipt, ns; `None` where
    /// none came, or the service follows no device. Where the launch file allows two phases, this chooses.
    fn waited_ns(&self) -> Option<u64> {
        None
    }
}

/// A service with its open ports, in whatever language its step is written: what a clock runs.
pub trait Run {
    /// Its name in launch files, health and events.
    fn name(&self) -> &str;
    /// Takes what has come, without a step.
    fn refresh(&mut self);
    /// Takes what has come and steps at `now`; what it published waits for [`Self::flush`].
    fn step(&mut self, now: Time);
    /// Sends what was published, and then the step's record, at `now`; returns how many samples could not be sent.
    fn flush(&mut self, now: Time) -> u64;
    /// The ages of the inputs' newest samples, ns.
    fn ages_ns(&self, now: Time, ages: &mut [u64]);
    /// As [`Service::waited_ns`].
    fn waited_ns(&self) -> Option<u64> {
        None
    }
    /// As [`Service::TAKES_THE_LAST`].
    fn takes_the_last(&self) -> bool {
        false
    }
}

/// A service and its open ports.
pub struct Runner<S: Service> {
    /// The core.
    pub service: S,
    /// Its inputs, as of the last step.
    pub inputs: S::Inputs,
    /// Its outputs.
    pub outputs: S::Outputs,
    record: Step,
    records: Output<Step>,
}

impl<S: Service> Runner<S> {
    /// Opens the service's ports.
    ///
    /// # Errors
    /// Where the bus refuses one.
    pub fn new(service: S, bus: &Bus) -> Result<Self, BusError> {
        Ok(Self {
            service,
            inputs: S::Inputs::open(bus)?,
            outputs: S::Outputs::open(bus)?,
            record: Step { service: text(S::NAME), ..Step::default() },
            records: Output::open(bus, topic::STEPS)?,
        })
    }

    /// Takes new inputs and steps at `now`; what it published waits for [`Self::flush`].
    pub fn step(&mut self, now: Time) {
        self.inputs.refresh();
        self.service.step(now, &self.inputs, &mut self.outputs);
        self.record.step += 1;
        self.record.stamp_ns = now.ns();
        if self.inputs.record(&mut self.record) {
            self.records.publish(self.record);
        }
    }

    /// Sends what was published, and then the step's record, at `now`; returns how many samples could not be sent.
    pub fn flush(&mut self, now: Time) -> u64 {
        self.outputs.flush(now) + self.records.flush(now)
    }
}

impl<S: Service> Run for Runner<S> {
    fn name(&self) -> &str {
        S::NAME
    }

    fn refresh(&mut self) {
        self.inputs.refresh();
    }

    fn step(&mut self, now: Time) {
        self.step(now);
    }

    fn flush(&mut self, now: Time) -> u64 {
        self.flush(now)
    }

    fn ages_ns(&self, now: Time, ages: &mut [u64]) {
        self.inputs.ages_ns(now, ages);
    }

    fn waited_ns(&self) -> Option<u64> {
        self.service.waited_ns()
    }

    fn takes_the_last(&self) -> bool {
        S::TAKES_THE_LAST
    }
}
