//! One viewer: what it asks for, and what waits for it.
//!
//! One thread hears it, another speaks; both end with the connection. What it does not fetch waits in its [`Outbox`].

use crate::channels::Channel;
use crate::frame;
use crate::outbox::{Outbox, Put};
use crate::server::{Shared, lock};
use crate::uplink::{Asked, Told};
use fss_messages::{Event, PARAMETERS};
use rustix::net::sockopt::set_socket_send_buffer_size;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Message, WebSocket};

/// What the kernel holds for a viewer, bytes: what waits longer waits where it is counted.
const IN_THE_KERNEL: usize = 1 << 18;
/// No viewer says more at once, bytes.
const LONGEST_MESSAGE: usize = 1 << 20;
/// A slow viewer is told of no more often.
const BETWEEN_COMPLAINTS: Duration = Duration::from_secs(30);
/// For the last words to a viewer.
pub(crate) const FAREWELL: Duration = Duration::from_millis(500);
/// First byte of a call of a command ("service call request").
const SERVICE_CALL_REQUEST: u8 = 2;
/// The encoding of commands and their answers.
const JSON: &str = "json";
/// Level of a status.
const WARNING: u8 = 1;
/// Level of a status.
const ERROR: u8 = 2;

/// A viewer.
pub(crate) struct Viewer {
    address: SocketAddr,
    stream: TcpStream,
    outbox: Outbox,
    /// Its own numbers of the channels that it wants.
    subscriptions: Mutex<BTreeMap<u64, u32>>,
    /// The parameters of which it wants to be told.
    parameters: Mutex<BTreeSet<&'static str>>,
    missed: Mutex<Missed>,
}

/// Samples that it was too slow for.
#[derive(Default)]
struct Missed {
    count: u64,
    told: Option<Instant>,
}

/// What a viewer says in words.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
enum Words {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    GetParameters {
        parameter_names: Vec<String>,
        id: Option<String>,
    },
    SetParameters {
        parameters: Vec<Asked>,
        id: Option<String>,
    },
    SubscribeParameterUpdates {
        parameter_names: Vec<String>,
    },
    UnsubscribeParameterUpdates {
        parameter_names: Vec<String>,
    },
    #[serde(other)]
    Other,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: u64,
}

/// Serves who was let in, until it goes; `read` has come behind its request.
pub(crate) fn serve(stream: TcpStream, read: Vec<u8>, shared: &Shared) -> io::Result<()> {
    set_socket_send_buffer_size(&stream, IN_THE_KERNEL)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(None)?;
    let viewer = Arc::new(Viewer {
        address: stream.peer_addr()?,
        stream,
        outbox: Outbox::default(),
        subscriptions: Mutex::default(),
        parameters: Mutex::default(),
        missed: Mutex::default(),
    });
    shared.greet(&viewer);
    std::thread::scope(|threads| {
        threads.spawn(|| {
            while viewer.outbox.take().is_some_and(|frame| (&viewer.stream).write_all(&frame).is_ok()) {}
            viewer.outbox.leave();
            let _ = viewer.stream.shutdown(Shutdown::Read);
        });
        viewer.listen(read, shared);
        viewer.outbox.close(FAREWELL);
        // Where the viewer does not read, this ends the wait for it.
        let _ = viewer.stream.shutdown(Shutdown::Both);
    });
    shared.part(&viewer);
    let missed = lock(&viewer.missed).count;
    if missed > 0 {
        let words = format!("the slow viewer at {} has gone: {missed} of its messages were dropped", viewer.address);
        shared.say(Event::WARNING, words);
    }
    Ok(())
}

impl Viewer {
    fn listen(&self, read: Vec<u8>, shared: &Shared) {
        let config = WebSocketConfig::default()
            .read_buffer_size(1 << 12)
            .max_message_size(Some(LONGEST_MESSAGE))
            .max_frame_size(Some(LONGEST_MESSAGE));
        let ear = Ear { viewer: self, answer: Vec::new() };
        let mut socket = WebSocket::from_partially_read(ear, read, Role::Server, Some(config));
        loop {
            match socket.read() {
                Ok(Message::Text(words)) => match serde_json::from_str(&words) {
                    Ok(words) => self.hear(words, shared),
                    Err(e) => self.status(ERROR, &format!("this is no message: {e}")),
                },
                Ok(Message::Binary(bytes)) => self.hear_call(&bytes, shared),
                Ok(_) => {}
                Err(_) => return,
            }
        }
    }

    /// Says this; one that lets too much of it wait is left.
    pub(crate) fn say(&self, frame: Vec<u8>) {
        if self.outbox.put_words(frame) == Put::Closed {
            let _ = self.stream.shutdown(Shutdown::Read);
        }
    }

    fn status(&self, level: u8, message: &str) {
        self.say(frame::text(&json!({ "op": "status", "level": level, "message": message })));
    }

    pub(crate) fn wants(&self, channel: Channel) -> Option<u32> {
        lock(&self.subscriptions).get(&channel.0).copied()
    }

    /// Gives it a sample where it wants the channel.
    pub(crate) fn give(&self, channel: Channel, time_ns: u64, message: &[u8], shared: &Shared) {
        let Some(subscription) = self.wants(channel) else { return };
        if self.outbox.put_sample(frame::sample(subscription, time_ns, message)) == Put::Dropped {
            shared.count_lost();
            let mut missed = lock(&self.missed);
            missed.count += 1;
            if missed.told.is_none_or(|last| last.elapsed() >= BETWEEN_COMPLAINTS) {
                missed.told = Some(Instant::now());
                let (address, count) = (self.address, missed.count);
                let words = format!("the viewer at {address} reads too slowly: {count} of its messages dropped");
                shared.say(Event::WARNING, words);
            }
        }
    }

    /// Tells it of those parameters that it wants to hear of.
    pub(crate) fn tell(&self, changed: &[Told]) {
        let wanted = lock(&self.parameters);
        let changed: Vec<_> = changed.iter().filter(|told| wanted.contains(told.name)).collect();
        if !changed.is_empty() {
            self.say(frame::text(&json!({ "op": "parameterValues", "parameters": changed })));
        }
    }

    /// Ends the connection, with a goodbye.
    pub(crate) fn dismiss(&self) {
        self.say(frame::close());
        let _ = self.stream.shutdown(Shutdown::Read);
    }

    fn hear(&self, words: Words, shared: &Shared) {
        match words {
            Words::Subscribe { subscriptions } => {
                for Subscription { id, channel_id } in subscriptions {
                    if shared.channels.has(Channel(channel_id)) {
                        lock(&self.subscriptions).insert(channel_id, id);
                    } else {
                        self.status(WARNING, &format!("there is no channel {channel_id}"));
                    }
                }
            }
            Words::Unsubscribe { subscription_ids } => {
                lock(&self.subscriptions).retain(|_, id| !subscription_ids.contains(id));
            }
            Words::GetParameters { parameter_names, id } => self.answer(&shared.desk.get(&parameter_names), id),
            Words::SetParameters { parameters, id } => {
                let (answer, refusals) = shared.desk.set(&parameters);
                for why in refusals {
                    self.status(WARNING, &why);
                }
                if id.is_some() {
                    self.answer(&answer, id);
                }
            }
            Words::SubscribeParameterUpdates { parameter_names } => {
                lock(&self.parameters).extend(named(&parameter_names));
            }
            Words::UnsubscribeParameterUpdates { parameter_names } => {
                let unwanted: BTreeSet<_> = named(&parameter_names).collect();
                lock(&self.parameters).retain(|name| !unwanted.contains(name));
            }
            Words::Other => self.status(ERROR, "this server takes no such message"),
        }
    }

    fn answer(&self, parameters: &[Told], id: Option<String>) {
        let mut answer = json!({ "op": "parameterValues", "parameters": parameters });
        if let Some(id) = id {
            answer["id"] = Value::String(id);
        }
        self.say(frame::text(&answer));
    }

    /// A command: service, call, encoding with its length, body.
    fn hear_call(&self, bytes: &[u8], shared: &Shared) {
        let Some((&SERVICE_CALL_REQUEST, rest)) = bytes.split_first() else {
            return self.status(ERROR, "this server takes no such message");
        };
        let Some((head, rest)) = rest.split_first_chunk::<12>() else {
            return self.status(ERROR, "this call is cut off");
        };
        let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let (service, call, length) = (word(0), word(4), word(8));
        let answer = match rest.get(..length as usize) {
            None => return self.status(ERROR, "this call is cut off"),
            Some(encoding) if encoding != JSON.as_bytes() => Err("commands are called with json"),
            Some(_) => shared.desk.call(service),
        };
        self.say(match answer {
            Ok(body) => frame::response(service, call, JSON, body),
            Err(why) => frame::text(
                &json!({ "op": "serviceCallFailure", "serviceId": service, "callId": call, "message": why }),
            ),
        });
    }
}

/// The parameters of these names; all where there is none.
fn named(names: &[String]) -> impl Iterator<Item = &'static str> {
    let all = PARAMETERS.iter().map(|parameter| parameter.name);
    all.filter(move |name| names.is_empty() || names.iter().any(|wanted| wanted == name))
}

/// Reads from the viewer; what the WebSocket answers by itself (pongs) is said in its turn.
struct Ear<'a> {
    viewer: &'a Viewer,
    answer: Vec<u8>,
}

impl Read for Ear<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        (&self.viewer.stream).read(bytes)
    }
}

impl Write for Ear<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.answer.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if !self.answer.is_empty() {
            self.viewer.say(std::mem::take(&mut self.answer));
        }
        Ok(())
    }
}
