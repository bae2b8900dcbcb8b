//! What is said to a viewer: WebSocket frames (RFC 6455, 5.2) with the words of the Foxglove protocol
//! (<https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>). A server does not mask its frames.

use serde_json::Value;

const FINAL: u8 = 0x80;
const TEXT: u8 = 1;
const BINARY: u8 = 2;
const CLOSE: u8 = 8;
/// The server goes away (RFC 6455, 7.4.1).
const GOING_AWAY: u16 = 1001;
/// First byte of a sample ("message data").
const MESSAGE_DATA: u8 = 1;
/// First byte of the answer of a command ("service call response").
const SERVICE_CALL_RESPONSE: u8 = 3;

/// Words.
pub(crate) fn text(words: &Value) -> Vec<u8> {
    frame(TEXT, &[words.to_string().as_bytes()])
}

/// A sample for this subscription.
pub(crate) fn sample(subscription: u32, time_ns: u64, message: &[u8]) -> Vec<u8> {
    frame(BINARY, &[&[MESSAGE_DATA], &subscription.to_le_bytes(), &time_ns.to_le_bytes(), message])
}

/// What a command answers.
pub(crate) fn response(service: u32, call: u32, encoding: &str, body: &[u8]) -> Vec<u8> {
    let length = (encoding.len() as u32).to_le_bytes();
    let head = [&service.to_le_bytes()[..], &call.to_le_bytes(), &length].concat();
    frame(BINARY, &[&[SERVICE_CALL_RESPONSE], &head, encoding.as_bytes(), body])
}

/// Goodbye.
pub(crate) fn close() -> Vec<u8> {
    frame(CLOSE, &[&GOING_AWAY.to_be_bytes()])
}

fn frame(opcode: u8, parts: &[&[u8]]) -> Vec<u8> {
    let length: usize = parts.iter().map(|part| part.len()).sum();
    let mut frame = Vec::with_capacity(10 + length);
    frame.push(FINAL | opcode);
    match length {
        0..=125 => frame.push(length as u8),
        126..=0xffff => {
            frame.push(126);
            frame.extend((length as u16).to_be_bytes());
        }
        _ => {
            frame.push(127);
            frame.extend((length as u64).to_be_bytes());
        }
    }
    for part in parts {
        frame.extend_from_slice(part);
    }
    frame
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use std::io::Cursor;
    use tungstenite::protocol::Role;
    use tungstenite::{Message, WebSocket};

    #[test]
    fn frames_of_any_length_are_read_by_others() {
        for length in [0, 112, 113, 125, 126, 300, 65_535, 65_536, 200_000] {
            let message = vec![7; length];
            let mut viewer = WebSocket::from_raw_socket(Cursor::new(sample(3, 5, &message)), Role::Client, None);
            let Message::Binary(read) = viewer.read().unwrap() else { panic!("no sample") };
            assert_eq!(read[..], [&[1, 3, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0][..], &message].concat());
        }
    }
}
