//! `links` and its radio.

use super::linked::{Flight, Linked};
use crate::description::unix_time_ns;
use crate::link_key::{read_secret, secret_of};
use crate::replay::player::FromDevice;
use crate::replay::tape::Tape;
use crate::seat::Seat;
use crate::stack::Stack;
use fss_bus::{Bus, Feed, Queue};
use fss_links::{COMMAND_QUEUE, Config, LinksService, TELEMETRY_QUEUE, TelemetryDatagram};
use fss_messages::{Step, topic};
use fss_wire::link::first_sequence;
use miette::{IntoDiagnostic, Result, WrapErr};

pub(super) struct Radio;

impl Linked for Radio {
    type Service = LinksService;

    fn config(&self, _stack: &Stack, flight: &Flight<'_>) -> Result<Config> {
        Ok(match flight {
            Flight::RealTime(seat) => {
                Config { key: read_secret(seat.link_key()?)?, first_sequence: first_sequence(unix_time_ns()?) }
            }
            Flight::Virtual(seed) => Config { key: secret_of(*seed).to_vec(), first_sequence: 1 },
            // The signature goes out to the links only; no key is needed to compute the state again.
            Flight::Replay(tape, life) => {
                Config { key: secret_of(0).to_vec(), first_sequence: first_sent(tape, life)? }
            }
        })
    }

    fn fly(&self, seat: &Seat, service: LinksService) -> Result<()> {
        let devices = &seat.launch.devices;
        let (telemetry, commands) = (seat.queue(TELEMETRY_QUEUE)?, seat.queue(COMMAND_QUEUE)?);
        let (local, links, urgent) = (devices.links_local, devices.links.clone(), seat.is_real_time("links")?);
        let _device = fss_links::device::Device::start(local, links, telemetry, commands, urgent)
            .into_diagnostic()
            .wrap_err_with(|| format!("links: cannot speak from {} ([devices] links_local)", devices.links_local))?;
        seat.fly(service, || ()).map(|_| ())
    }

    fn devices<'a>(&self, bus: &Bus, tape: &'a Tape) -> Result<Vec<FromDevice<'a>>> {
        let telemetry: Queue<TelemetryDatagram> =
            bus.queue(TELEMETRY_QUEUE, Feed::<TelemetryDatagram>::CAPACITY).into_diagnostic()?;
        let received = tape.topic(topic::LINKS_TELEMETRY)?;
        let give = move |step: &Step, _| {
            let datagrams = received.at(step.published_ns);
            datagrams.iter().filter(|datagram| telemetry.push((*datagram).into()).is_ok()).count() as u64
        };
        let (queue, name) = (TELEMETRY_QUEUE, "telemetry datagrams");
        Ok(vec![FromDevice { queue, name, complete: true, give: Box::new(give) }])
    }
}

/// Commands are numbered from the calendar time of the start: the first number that the log shows.
fn first_sent(tape: &Tape, life: &[Step]) -> Result<u64> {
    let sent = tape.topic(topic::LINKS_STATE)?.since(life[0].published_ns).iter().map(|state| state.command_sequence);
    Ok(sent.flatten().find(|sequence| *sequence > 0).map_or(0, |sequence| sequence - 1))
}
