//! Making events without allocation.

use crate::{Event, text};
use core::fmt;

/// Writes formatted text into a fixed field; what does not fit is cut at a character's border.
struct Field<const N: usize> {
    bytes: [u8; N],
    len: usize,
}

impl<const N: usize> fmt::Write for Field<N> {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        let mut room = s.len().min((N - 1).saturating_sub(self.len));
        while !s.is_char_boundary(room) {
            room -= 1;
        }
        self.bytes[self.len..self.len + room].copy_from_slice(&s.as_bytes()[..room]);
        self.len += room;
        if room == s.len() { Ok(()) } else { Err(fmt::Error) }
    }
}

impl Event {
    /// What `service` says at `stamp_ns`, with one of the severities of [`Event`]; allocates nothing, so that a step may
    /// say `Event::new(now.ns(), Self::NAME, Event::WARNING, format_args!("link {i} is silent"))`.
    pub fn new(stamp_ns: u64, service: &str, severity: u8, message: fmt::Arguments<'_>) -> Self {
        let mut field = Field { bytes: [0; 160], len: 0 };
        // A message that does not fit is cut, which is all that can be done about it.
        let _ = fmt::write(&mut field, message);
        Self { stamp_ns, severity, service: text(service), text: field.bytes, ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Event, text_of};

    #[test]
    fn a_long_message_is_cut_between_characters() {
        let event = Event::new(5, "arm", Event::WARNING, format_args!("{}{}", "a".repeat(158), "é"));
        assert_eq!(text_of(&event.text), "a".repeat(158));
        assert_eq!((text_of(&event.service), event.severity, event.stamp_ns), ("arm", Event::WARNING, 5));
    }
}
