//! Who asks: whose page it is, and whether it speaks the protocol.

use std::net::IpAddr;
use tungstenite::handshake::derive_accept_key;

/// The protocol that viewers must offer to speak.
const PROTOCOL: &str = "foxglove.sdk.v1";

const MOST_HEADERS: usize = 64;
/// So much of a foreign page's name is repeated, characters.
const LONGEST_NAME: usize = 80;

/// What becomes of a request.
#[derive(Debug, PartialEq)]
pub(crate) enum Verdict {
    /// A program, or a page that may come in.
    Welcome {
        /// What opens the WebSocket.
        accept: String,
        /// Length of the request, bytes.
        length: usize,
    },
    /// Who asks for [`crate::metrics`].
    Metrics,
    /// It does not ask for what is here.
    Stranger,
    /// A page of this origin, which may not.
    Foreign(String),
    /// More than a request may have.
    TooLong,
    /// Not HTTP.
    Nonsense,
}

impl Verdict {
    /// Status and reason of a refusal.
    pub(crate) fn refusal(&self) -> (&'static str, String) {
        match self {
            Self::Foreign(origin) => (
                "403 Forbidden",
                format!("pages of {origin} may not look here; the launch file can name them under [ground] origins\n"),
            ),
            Self::TooLong => ("431 Request Header Fields Too Large", "the request is too long\n".to_owned()),
            Self::Nonsense => ("400 Bad Request", "this is no request\n".to_owned()),
            Self::Stranger | Self::Metrics | Self::Welcome { .. } => {
                ("400 Bad Request", format!("viewers open a WebSocket with Sec-WebSocket-Protocol: {PROTOCOL}\n"))
            }
        }
    }
}

/// What becomes of the request; nothing while there is more to come. `named` are the pages that may come in beside those
/// of this computer.
pub(crate) fn judge(request: &[u8], named: &[String]) -> Option<Verdict> {
    let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    match parsed.parse(request) {
        Ok(httparse::Status::Partial) => None,
        Ok(httparse::Status::Complete(length)) => Some(match judge_headers(parsed.headers, named, length) {
            Verdict::Stranger if (parsed.method, parsed.path) == (Some("GET"), Some("/metrics")) => Verdict::Metrics,
            verdict => verdict,
        }),
        Err(httparse::Error::TooManyHeaders) => Some(Verdict::TooLong),
        Err(_) => Some(Verdict::Nonsense),
    }
}

fn judge_headers(headers: &[httparse::Header<'_>], named: &[String], length: usize) -> Verdict {
    let all = |name: &'static str| {
        headers.iter().filter(move |header| header.name.eq_ignore_ascii_case(name)).map(|header| header.value)
    };
    if let Some(foreign) = all("origin").find(|origin| !may_look(origin, named)) {
        return Verdict::Foreign(printable(foreign));
    }
    let mut offered = all("sec-websocket-protocol").flat_map(|list| list.split(|byte| *byte == b','));
    let speaks = offered.any(|protocol| protocol.trim_ascii() == PROTOCOL.as_bytes());
    let upgrades = all("upgrade").any(|to| to.eq_ignore_ascii_case(b"websocket"));
    let is_known = all("sec-websocket-version").any(|version| version == b"13");
    let Some(key) = all("sec-websocket-key").next().filter(|_| speaks && upgrades && is_known) else {
        return Verdict::Stranger;
    };
    let accept = format!(
        "HTTP/1.1 101 Switching Protocols\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Accept: {}\r\nSec-WebSocket-Protocol: {PROTOCOL}\r\n\r\n",
        derive_accept_key(key)
    );
    Verdict::Welcome { accept, length }
}

fn may_look(origin: &[u8], named: &[String]) -> bool {
    let Ok(origin) = std::str::from_utf8(origin) else { return false };
    is_of_this_computer(origin) || named.iter().any(|named| named.eq_ignore_ascii_case(origin))
}

/// A page that a server on the viewer's own computer served, or a desktop program's: those built with Electron say `file://`. A
/// file that a browser shows says `null`, as any page can from within a frame, so it is foreign.
fn is_of_this_computer(origin: &str) -> bool {
    if origin == "file://" {
        return true;
    }
    let Some(authority) = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://")) else {
        return false;
    };
    let host = match authority.rsplit_once(':') {
        Some((host, port)) if !port.is_empty() && port.bytes().all(|digit| digit.is_ascii_digit()) => host,
        _ => authority,
    };
    let address = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    host == "localhost" || address.parse().is_ok_and(|address: IpAddr| address.is_loopback())
}

fn printable(origin: &[u8]) -> String {
    origin.escape_ascii().to_string().chars().take(LONGEST_NAME).collect()
}

#[cfg(test)]
mod tests {
    use super::is_of_this_computer;

    #[test]
    fn only_the_loopback_and_desktop_programs_are_of_this_computer() {
        for origin in ["http://localhost:8080", "https://localhost", "http://127.0.0.1:1", "http://[::1]:80", "file://"]
        {
            assert!(is_of_this_computer(origin), "{origin}");
        }
        for origin in [
            "null",
            "",
            "http://localhost.evil.example",
            "http://localhost@evil.example",
            "http://evil.example:127",
            "http://127.0.0.1.evil.example",
            "http://localhost:80:evil",
            "http://192.168.1.4:8080",
            "ftp://localhost",
        ] {
            assert!(!is_of_this_computer(origin), "{origin}");
        }
    }
}
