//! Topics in shared memory, through iceoryx2.
//!
//! State goes by publish/subscribe with a small overflowing buffer: a stalled or dead reader never blocks a writer. Each
//! stack has a prefix of its own for everything that iceoryx2 makes, so that stacks, tests and users do not meet.

use crate::BusError;
use fss_messages::{Sample, topic};
use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use std::fs::{DirEntry, Permissions};
use std::os::unix::fs::PermissionsExt;

/// A sample borrowed from shared memory.
pub(crate) type SharedSample<T> = iceoryx2::sample::Sample<ipc::Service, T, ()>;

/// The most publishers of a topic on which every service speaks.
const MAX_SPEAKERS: usize = 32;
/// The most publishers of any other topic: its one, and dead ones that nobody has cleared away yet. Each place costs every
/// reader a look.
const MAX_PUBLISHERS: usize = 4;
/// The most subscribers of one topic.
const MAX_SUBSCRIBERS: usize = 10;
/// The deepest buffer that a subscriber may ask for (the recorder's).
pub(crate) const MAX_BUFFER: usize = 256;

/// How a process joins a stack's shared memory.
#[derive(Clone, Debug)]
pub struct SharedConfig {
    /// The process's name, for diagnosis.
    pub node: String,
    /// Prefix of everything the stack makes in shared memory: letters, digits and underscores.
    pub prefix: String,
}

/// One process's access to the stack's shared memory.
pub(crate) struct SharedTopics {
    node: Node<ipc::Service>,
}

impl SharedTopics {
    pub(crate) fn join(config: &SharedConfig) -> Result<Self, BusError> {
        let refused = |reason: String| BusError::Node { node: config.node.clone(), reason };
        let iox = iox_config(&config.prefix).map_err(refused)?;
        let name = NodeName::new(&config.node).map_err(|e| refused(format!("{e:?}")))?;
        set_log_level(LogLevel::Fatal);
        let node = NodeBuilder::new()
            .name(&name)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .config(&iox)
            .create::<ipc::Service>()
            .map_err(|e| refused(format!("{e:?}")))?;
        keep_to_owner(&config.prefix).map_err(|e| refused(e.to_string()))?;
        Ok(Self { node })
    }

    pub(crate) fn subscribe<T: Sample>(
        &self,
        name: &str,
        capacity: usize,
    ) -> Result<Subscriber<ipc::Service, T, ()>, BusError> {
        let refused = |reason: String| BusError::Topic { topic: name.to_owned(), sample: T::NAME, reason };
        self.service::<T>(name)?
            .subscriber_builder()
            .buffer_size(capacity.min(MAX_BUFFER))
            .create()
            .map_err(|e| refused(format!("{e:?}")))
    }

    pub(crate) fn publisher<T: Sample>(&self, name: &str) -> Result<Publisher<ipc::Service, T, ()>, BusError> {
        let refused = |reason: String| BusError::Topic { topic: name.to_owned(), sample: T::NAME, reason };
        self.service::<T>(name)?.publisher_builder().create().map_err(|e| refused(format!("{e:?}")))
    }

    fn service<T: Sample>(
        &self,
        name: &str,
    ) -> Result<iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, T, ()>, BusError> {
        let refused = |reason: String| BusError::Topic { topic: name.to_owned(), sample: T::NAME, reason };
        let max_publishers = if topic::is_shared(name) { MAX_SPEAKERS } else { MAX_PUBLISHERS };
        let service_name = ServiceName::new(name).map_err(|e| refused(format!("{e:?}")))?;
        self.node
            .service_builder(&service_name)
            .publish_subscribe::<T>()
            .enable_safe_overflow(true)
            .subscriber_max_buffer_size(MAX_BUFFER)
            .subscriber_max_borrowed_samples(4)
            .max_publishers(max_publishers)
            .max_subscribers(MAX_SUBSCRIBERS)
            .max_nodes(MAX_SPEAKERS + MAX_SUBSCRIBERS)
            .open_or_create()
            .map_err(|e| refused(format!("{e:?}")))
    }
}

fn iox_config(prefix: &str) -> Result<Config, String> {
    let mut config = Config::default();
    config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|e| format!("bad prefix '{prefix}': {e:?}"))?;
    Ok(config)
}

/// Removes what dead processes of this stack left in shared memory, and says how many dead nodes there were. When no
/// process of the stack lives any more (`stack_has_ended`), iceoryx2's own management files of this prefix go too.
///
/// # Errors
/// Where the list of nodes cannot be read.
pub fn remove_dead_nodes(prefix: &str, stack_has_ended: bool) -> Result<usize, BusError> {
    let refused = |reason: String| BusError::Node { node: "cleanup".to_owned(), reason };
    set_log_level(LogLevel::Fatal);
    let config = iox_config(prefix).map_err(refused)?;
    let mut removed = 0;
    Node::<ipc::Service>::list(&config, |state| {
        if let NodeState::Dead(view) = state
            && view.try_remove_stale_resources().is_ok()
        {
            removed += 1;
        }
        CallbackProgression::Continue
    })
    .map_err(|e| refused(format!("{e:?}")))?;
    if stack_has_ended {
        remove_files(prefix).map_err(|e| refused(e.to_string()))?;
    }
    Ok(removed)
}

/// Takes from others what iceoryx2 lets them read and write: its own management of a prefix.
fn keep_to_owner(prefix: &str) -> std::io::Result<()> {
    for_each_file(prefix, |file| {
        let is_open = file.metadata().is_ok_and(|meta| meta.permissions().mode() & 0o077 != 0);
        if is_open { std::fs::set_permissions(file.path(), Permissions::from_mode(0o600)) } else { Ok(()) }
    })
}

/// Removes the files of a prefix from where Linux keeps shared memory.
fn remove_files(prefix: &str) -> std::io::Result<()> {
    for_each_file(prefix, |file| std::fs::remove_file(file.path()))
}

/// Does something to each file of a prefix; one that is gone by then is done with.
fn for_each_file(prefix: &str, work: impl Fn(&DirEntry) -> std::io::Result<()>) -> std::io::Result<()> {
    for entry in std::fs::read_dir("/dev/shm")? {
        let entry = entry?;
        if entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes()) {
            match work(&entry) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(e),
                _ => {}
            }
        }
    }
    Ok(())
}
