//! `thrusters` and the valves.

use super::linked::{Flight, Linked};
use crate::replay::player::FromDevice;
use crate::replay::tape::Tape;
use crate::seat::{Seat, wait_for_device};
use crate::stack::Stack;
use fss_bus::{Bus, Feed, Queue};
use fss_messages::{Step, topic};
use fss_service::NoConfig;
use fss_thrusters::device::{Driver, GpioLines, LaboratoryLine, Valves};
use fss_thrusters::{DRIVER_QUEUE, Thrusters};
use miette::{IntoDiagnostic, Result, WrapErr};

pub(super) struct ValveLine;

impl Linked for ValveLine {
    type Service = Thrusters;

    fn config(&self, _stack: &Stack, _flight: &Flight<'_>) -> Result<NoConfig> {
        Ok(NoConfig {})
    }

    fn fly(&self, seat: &Seat, service: Thrusters) -> Result<()> {
        let path = &seat.launch.devices.valves;
        if let Some(offsets) = &seat.launch.devices.valve_lines {
            let lines = GpioLines::open(path, offsets)
                .into_diagnostic()
                .wrap_err_with(|| format!("valves: cannot take the lines of {} ([devices] valves)", path.display()))?;
            return drive(seat, service, lines);
        }
        let mut line = LaboratoryLine::new(path);
        wait_for_device(path, || line.set(0).into_diagnostic())
            .wrap_err_with(|| format!("valves: cannot open {} ([devices] valves)", path.display()))?;
        drive(seat, service, line)
    }

    fn devices<'a>(&self, bus: &Bus, tape: &'a Tape) -> Result<Vec<FromDevice<'a>>> {
        let driver: Queue<bool> = bus.queue(DRIVER_QUEUE, Feed::<bool>::CAPACITY).into_diagnostic()?;
        let states = tape.topic(topic::THRUSTERS_STATE)?;
        let give = move |step: &Step, had| {
            // Of several words of the driver only the last counts, and the state says which it was.
            let words = states.at(step.published_ns).iter().map(|state| state.driver_works != 0);
            if had > 0 && words.take(1).filter(|word| driver.push(*word).is_ok()).count() == 1 { had } else { 0 }
        };
        let (queue, name) = (DRIVER_QUEUE, "words of the valve driver");
        Ok(vec![FromDevice { queue, name, complete: true, give: Box::new(give) }])
    }
}

fn drive(seat: &Seat, service: Thrusters, valves: impl Valves) -> Result<()> {
    // The valve line is this service's device: it is written in the loop, so that nothing stands between step and valve.
    // A write that fails shuts the valves on the other side; the next step connects anew.
    let mut driver = Driver::new(valves, &seat.bus).into_diagnostic()?;
    seat.fly(service, || driver.apply())?;
    driver.shut().into_diagnostic().wrap_err("valves: cannot shut them at the end; a closed line shuts them")
}
