//! What a viewer says, and what it is answered.
//!
//! One thread hears it, another writes to it; both end with the connection.

use crate::channels::Channel;
use crate::frame;
use crate::uplink::{Asked, Told};
use crate::viewer::{Viewer, lock};
use crate::viewers::Viewers;
use fss_messages::{Event, PARAMETERS};
use rustix::net::sockopt::set_socket_send_buffer_size;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Message, WebSocket};

/// What the kernel holds for a viewer, bytes: what waits longer waits where it is counted.
const IN_THE_KERNEL: usize = 1 << 18;
/// No viewer says more at once, bytes.
const LONGEST_MESSAGE: usize = 1 << 20;
/// First byte of a call of a command ("service call request").
const SERVICE_CALL_REQUEST: u8 = 2;
/// The encoding of commands and their answers.
const JSON: &str = "json";
/// Level of a status.
const WARNING: u8 = 1;
/// Level of a status.
const ERROR: u8 = 2;

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
pub(crate) fn serve(stream: TcpStream, read: Vec<u8>, viewers: &Viewers) -> io::Result<()> {
    set_socket_send_buffer_size(&stream, IN_THE_KERNEL)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(None)?;
    let viewer = Arc::new(Viewer::new(stream)?);
    viewers.greet(&viewer);
    std::thread::scope(|threads| {
        threads.spawn(|| viewer.write());
        Session { viewer: &viewer, viewers }.listen(read);
        viewer.close();
    });
    viewers.part(&viewer);
    if let Some(words) = viewer.losses() {
        viewers.say(Event::WARNING, words);
    }
    Ok(())
}

/// A viewer among the others.
struct Session<'a> {
    viewer: &'a Viewer,
    viewers: &'a Viewers,
}

impl Session<'_> {
    fn listen(&self, read: Vec<u8>) {
        let config = WebSocketConfig::default()
            .read_buffer_size(1 << 12)
            .max_message_size(Some(LONGEST_MESSAGE))
            .max_frame_size(Some(LONGEST_MESSAGE));
        let ear = Ear { viewer: self.viewer, answer: Vec::new() };
        let mut socket = WebSocket::from_partially_read(ear, read, Role::Server, Some(config));
        loop {
            match socket.read() {
                Ok(Message::Text(words)) => match serde_json::from_str(&words) {
                    Ok(words) => self.hear(words),
                    Err(e) => self.viewer.status(ERROR, &format!("this is no message: {e}")),
                },
                Ok(Message::Binary(bytes)) => self.hear_call(&bytes),
                Ok(_) => {}
                Err(_) => return,
            }
        }
    }

    fn hear(&self, words: Words) {
        match words {
            Words::Subscribe { subscriptions } => {
                for Subscription { id, channel_id } in subscriptions {
                    if self.viewers.channels.has(Channel(channel_id)) {
                        lock(&self.viewer.subscriptions).insert(channel_id, id);
                    } else {
                        self.viewer.status(WARNING, &format!("there is no channel {channel_id}"));
                    }
                }
            }
            Words::Unsubscribe { subscription_ids } => {
                lock(&self.viewer.subscriptions).retain(|_, id| !subscription_ids.contains(id));
            }
            Words::GetParameters { parameter_names, id } => self.answer(&self.viewers.desk.get(&parameter_names), id),
            Words::SetParameters { parameters, id } => {
                let (answer, refusals) = self.viewers.desk.set(&parameters);
                for why in refusals {
                    self.viewer.status(WARNING, &why);
                }
                if id.is_some() {
                    self.answer(&answer, id);
                }
            }
            Words::SubscribeParameterUpdates { parameter_names } => {
                lock(&self.viewer.parameters).extend(named(&parameter_names));
            }
            Words::UnsubscribeParameterUpdates { parameter_names } => {
                let unwanted: BTreeSet<_> = named(&parameter_names).collect();
                lock(&self.viewer.parameters).retain(|name| !unwanted.contains(name));
            }
            Words::Other => self.viewer.status(ERROR, "this server takes no such message"),
        }
    }

    fn answer(&self, parameters: &[Told], id: Option<String>) {
        let mut answer = json!({ "op": "parameterValues", "parameters": parameters });
        if let Some(id) = id {
            answer["id"] = Value::String(id);
        }
        self.viewer.say(frame::text(&answer));
    }

    /// A command: service, call, encoding with its length, body.
    fn hear_call(&self, bytes: &[u8]) {
        let Some((&SERVICE_CALL_REQUEST, rest)) = bytes.split_first() else {
            return self.viewer.status(ERROR, "this server takes no such message");
        };
        let Some((head, rest)) = rest.split_first_chunk::<12>() else {
            return self.viewer.status(ERROR, "this call is cut off");
        };
        let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let (service, call, length) = (word(0), word(4), word(8));
        let answer = match rest.get(..length as usize) {
            None => return self.viewer.status(ERROR, "this call is cut off"),
            Some(encoding) if encoding != JSON.as_bytes() => Err("commands are called with json"),
            Some(_) => self.viewers.desk.call(service),
        };
        self.viewer.say(match answer {
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
