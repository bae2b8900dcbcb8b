//! Valves on the lines of a Linux GPIO chip.

use super::Valves;
use fss_messages::MAX_THRUSTERS;
use gpiocdev::line::{Offset, Value, Values};
use gpiocdev::request::Request;
use std::io;
use std::path::Path;

/// All valves' lines in one request, so that they switch together. What a line does when its process dies is the board's
/// business: it needs a pull-down that shuts the valve.
#[derive(Debug)]
pub struct GpioLines {
    request: Request,
    offsets: Vec<Offset>,
    values: Values,
}

impl GpioLines {
    /// Takes the lines of a chip (`/dev/gpiochip0`), thruster 1 first, and shuts all valves.
    ///
    /// # Errors
    /// Where a line is named twice, where there are more of them than thrusters can be, and where the kernel does not give
    /// them; the error names the chip.
    pub fn open(chip: &Path, offsets: &[u32]) -> io::Result<Self> {
        let refuse = |what: &str| Err(io::Error::new(io::ErrorKind::InvalidInput, what.to_owned()));
        if offsets.is_empty() || offsets.len() > MAX_THRUSTERS {
            return refuse("a vehicle has 1 to 16 valve lines");
        }
        if offsets.iter().enumerate().any(|(i, offset)| offsets[..i].contains(offset)) {
            return refuse("two valves cannot share a line");
        }
        let request = Request::builder()
            .on_chip(chip)
            .with_consumer("fss valves")
            .as_output(Value::Inactive)
            .with_lines(offsets)
            .request()
            .map_err(|error| io::Error::other(format!("{}: {error}", chip.display())))?;
        let mut lines = Self { request, offsets: offsets.to_vec(), values: Values::default() };
        lines.set(0)?;
        Ok(lines)
    }
}

impl Valves for GpioLines {
    fn set(&mut self, mask: u16) -> io::Result<()> {
        for (i, offset) in self.offsets.iter().enumerate() {
            let value = if mask >> i & 1 == 1 { Value::Active } else { Value::Inactive };
            self.values.set(*offset, value);
        }
        self.request.set_values(&self.values).map_err(io::Error::other)
    }
}
