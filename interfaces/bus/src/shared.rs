//! Topics in shared memory, through iceoryx2.
//!
//! State goes by publish/subscribe with a small overflowing buffer: a stalled or dead reader never blocks a writer. Each
//! stack has a prefix of its own for everything that iceoryx2 makes, so that stacks, tests and users do not meet.

use crate::BusError;
use fss_messages::{Sample, topic};
use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::prelude::*;
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use std::collections::BTreeSet;
use std::fs::Permissions;
use std::io::ErrorKind;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// A sample borrowed from shared memory.
pub(crate) type SharedSample<T> = iceoryx2::sample::Sample<ipc::Service, T, ()>;

/// Subscribes to samples of which only name, size and alignment of their type are known.
pub(crate) type RawSubscriber = Subscriber<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;
/// Publishes such samples.
pub(crate) type RawPublisher = Publisher<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;

/// The most publishers of a topic on which every service speaks.
const MAX_SPEAKERS: usize = 32;
/// The most publishers of any other topic: its one, and dead ones that nobody has cleared away yet. Each place costs every
/// reader a look.
const MAX_PUBLISHERS: usize = 4;
/// The most subscribers of one topic, where the launch file does not say it.
pub(crate) const READERS: usize = 10;
/// The deepest buffer that a subscriber may ask for (the recorder's).
pub(crate) const MAX_BUFFER: usize = 256;

/// Where Linux keeps shared memory.
const SHARED_MEMORY: &str = "/dev/shm";
/// Where iceoryx2 keeps its lists of nodes and services, in folders.
const MANAGEMENT: &str = "/tmp/iceoryx2";
/// There, each node has a folder.
const NODES: &str = "/tmp/iceoryx2/nodes";

/// How a process joins a stack's shared memory.
#[derive(Clone, Debug)]
pub struct SharedConfig {
    /// The process's name, for diagnosis.
    pub node: String,
    /// Prefix of everything the stack makes in shared memory: letters, digits and underscores.
    pub prefix: String,
}

/// A service's builder with the limits that all who open it agree on.
macro_rules! with_limits {
    ($builder:expr, $name:expr, $readers:expr) => {
        $builder
            .enable_safe_overflow(true)
            .subscriber_max_buffer_size(MAX_BUFFER)
            .subscriber_max_borrowed_samples(4)
            .max_publishers(if topic::is_shared($name) { MAX_SPEAKERS } else { MAX_PUBLISHERS })
            .max_subscribers($readers)
            .max_nodes(MAX_SPEAKERS + $readers)
    };
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
        readers: usize,
    ) -> Result<Subscriber<ipc::Service, T, ()>, BusError> {
        let service = self.service::<T>(name, readers)?;
        let builder = service.subscriber_builder().buffer_size(capacity.min(MAX_BUFFER));
        builder.create().map_err(|e| cannot_read(name, T::TYPE_NAME, e))
    }

    pub(crate) fn publisher<T: Sample>(
        &self,
        name: &str,
        readers: usize,
    ) -> Result<Publisher<ipc::Service, T, ()>, BusError> {
        self.service::<T>(name, readers)?.publisher_builder().create().map_err(|e| refused(name, T::TYPE_NAME, &e))
    }

    pub(crate) fn subscribe_raw(
        &self,
        name: &str,
        kind: (&str, usize),
        capacity: usize,
        readers: usize,
    ) -> Result<RawSubscriber, BusError> {
        let service = self.raw_service(name, kind, readers)?;
        let builder = service.subscriber_builder().buffer_size(capacity.min(MAX_BUFFER));
        builder.create().map_err(|e| cannot_read(name, kind.0, e))
    }

    pub(crate) fn publisher_raw(
        &self,
        name: &str,
        kind: (&str, usize),
        readers: usize,
    ) -> Result<RawPublisher, BusError> {
        self.raw_service(name, kind, readers)?.publisher_builder().create().map_err(|e| refused(name, kind.0, &e))
    }

    fn service<T: Sample>(&self, name: &str, readers: usize) -> Result<PortFactory<ipc::Service, T, ()>, BusError> {
        let builder = self.node.service_builder(&service_name(name, T::TYPE_NAME)?).publish_subscribe::<T>();
        with_limits!(builder, name, readers).open_or_create().map_err(|e| refused(name, T::TYPE_NAME, &e))
    }

    /// The same service as [`Self::service`] opens for the type of this name and size.
    #[allow(unsafe_code)]
    fn raw_service(
        &self,
        name: &str,
        (type_name, size): (&str, usize),
        readers: usize,
    ) -> Result<PortFactory<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>, BusError> {
        let payload = TypeDetail::__internal_new_from_parts(TypeVariant::FixedSize, type_name, size, SAMPLE_ALIGNMENT)
            .map_err(|e| refused(name, type_name, &e))?;
        let header = TypeDetail::new::<()>(TypeVariant::FixedSize);
        let builder = self
            .node
            .service_builder(&service_name(name, type_name)?)
            .publish_subscribe::<[CustomPayloadMarker]>()
            .user_header::<CustomHeaderMarker>();
        // SAFETY: a sample is plain bytes of the size and alignment that are said here, and without a header of the user.
        let builder = unsafe {
            builder.__internal_set_payload_type_details(&payload).__internal_set_user_header_type_details(&header)
        };
        with_limits!(builder, name, readers).open_or_create().map_err(|e| refused(name, type_name, &e))
    }
}

/// Every sample is aligned so, as `define_messages!` asserts.
const SAMPLE_ALIGNMENT: usize = 8;

fn service_name(name: &str, type_name: &str) -> Result<ServiceName, BusError> {
    ServiceName::new(name).map_err(|e| refused(name, type_name, &e))
}

/// Why a topic cannot be read: mostly because it has all the readers that it may have.
fn cannot_read(name: &str, type_name: &str, reason: SubscriberCreateError) -> BusError {
    match reason {
        SubscriberCreateError::ExceedsMaxSupportedSubscribers => BusError::Readers(name.to_owned()),
        other => refused(name, type_name, &other),
    }
}

fn refused(name: &str, type_name: &str, reason: &impl std::fmt::Debug) -> BusError {
    BusError::Topic { topic: name.to_owned(), sample: type_name.to_owned(), reason: format!("{reason:?}") }
}

/// Appends the bytes of a sample.
#[allow(unsafe_code)]
pub(crate) fn append(bytes: &mut Vec<u8>, sample: &[CustomPayloadMarker]) {
    // SAFETY: a marker is one byte of the sample (iceoryx2 asserts its size), and a sample has no padding.
    bytes.extend_from_slice(unsafe { std::slice::from_raw_parts(sample.as_ptr().cast(), sample.len()) });
}

/// Sends the bytes of a sample, which are as many as its type has; false where that cannot be.
#[allow(unsafe_code)]
pub(crate) fn send_bytes(publisher: &RawPublisher, sample: &[u8]) -> bool {
    // SAFETY: the type is of fixed size, of which one is loaned.
    let Ok(mut loan) = (unsafe { publisher.loan_custom_payload(1) }) else { return false };
    let room = loan.payload_mut();
    if room.len() != sample.len() {
        return false;
    }
    // SAFETY: as many bytes are written as the sample has, so that it is initialised then; a marker is one byte.
    let loan = unsafe {
        std::ptr::copy_nonoverlapping(sample.as_ptr(), room.as_mut_ptr().cast::<u8>(), sample.len());
        loan.assume_init()
    };
    loan.send().is_ok()
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
    set_log_level(LogLevel::Fatal);
    let config = iox_config(prefix).map_err(|e| cannot_clean(&e))?;
    let mut removed = 0;
    Node::<ipc::Service>::list(&config, |state| {
        if let NodeState::Dead(view) = state
            && view.try_remove_stale_resources().is_ok()
        {
            removed += 1;
        }
        CallbackProgression::Continue
    })
    .map_err(|e| cannot_clean(&format!("{e:?}")))?;
    if stack_has_ended {
        remove_files(prefix).map_err(|e| cannot_clean(&e))?;
    }
    Ok(removed)
}

/// Takes from others what iceoryx2 lets them read and write: its own management of a prefix.
fn keep_to_owner(prefix: &str) -> std::io::Result<()> {
    for_each_file(prefix, |path| {
        let is_open = path.metadata().is_ok_and(|meta| meta.permissions().mode() & 0o077 != 0);
        if is_open { std::fs::set_permissions(path, Permissions::from_mode(0o600)) } else { Ok(()) }
    })
}

/// Removes what stacks of this user left that nobody tidied up after: their prefix names a process that is gone
/// (`fssWORD_PROCESS_`), and none of theirs lives. Says of how many stacks.
///
/// # Errors
/// Where the list of nodes cannot be read, or a file cannot be removed.
pub fn remove_stale_stacks() -> Result<usize, BusError> {
    let own = std::fs::metadata("/proc/self").map(|meta| meta.uid()).ok();
    let mut prefixes = BTreeSet::new();
    for_each_file("fss", |path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if let Some((prefix, process)) = prefix_of(&name)
            && !Path::new("/proc").join(process).exists()
            && own == path.metadata().map(|meta| meta.uid()).ok()
        {
            prefixes.insert(prefix.to_owned());
        }
        Ok(())
    })
    .map_err(|e| cannot_clean(&e))?;
    let mut removed = 0;
    for prefix in prefixes {
        remove_dead_nodes(&prefix, false)?;
        if !stack_runs(&prefix)? {
            remove_files(&prefix).map_err(|e| cannot_clean(&e))?;
            removed += 1;
        }
    }
    Ok(removed)
}

/// The stack's prefix at the head of a file's name, and the number of the process in it.
fn prefix_of(name: &str) -> Option<(&str, &str)> {
    let (word, rest) = name.split_once('_')?;
    let (process, _) = rest.split_once('_')?;
    let is_number = !process.is_empty() && process.bytes().all(|b| b.is_ascii_digit());
    is_number.then(|| (&name[..word.len() + process.len() + 2], process))
}

/// Whether any process of a stack lives.
///
/// # Errors
/// Where the list of nodes cannot be read.
pub fn stack_runs(prefix: &str) -> Result<bool, BusError> {
    let mut any = false;
    let config = iox_config(prefix).map_err(|e| cannot_clean(&e))?;
    Node::<ipc::Service>::list(&config, |state| {
        any |= matches!(state, NodeState::Alive(_));
        CallbackProgression::Continue
    })
    .map_err(|e| cannot_clean(&format!("{e:?}")))?;
    Ok(any)
}

fn cannot_clean(reason: &impl ToString) -> BusError {
    BusError::Node { node: "cleanup".to_owned(), reason: reason.to_string() }
}

/// Removes the files of a prefix, and the folders of its nodes with them. Of a process that was killed while it joined or
/// tidied up after another, iceoryx2 itself cannot remove all.
fn remove_files(prefix: &str) -> std::io::Result<()> {
    for_each_file(prefix, |path| {
        std::fs::remove_file(path)?;
        let folder = path.parent().filter(|folder| folder.parent() == Some(Path::new(NODES)));
        // Fails until its last file is gone.
        folder.map_or(Ok(()), |folder| std::fs::remove_dir(folder).or(Ok(())))
    })
}

/// Does something to each file of a prefix; one that is gone by then is done with.
fn for_each_file(prefix: &str, mut work: impl FnMut(&Path) -> std::io::Result<()>) -> std::io::Result<()> {
    let mut folders = vec![PathBuf::from(SHARED_MEMORY), PathBuf::from(MANAGEMENT)];
    while let Some(folder) = folders.pop() {
        let entries = match std::fs::read_dir(&folder) {
            Err(e) if e.kind() == ErrorKind::NotFound => continue,
            entries => entries?,
        };
        for entry in entries {
            let entry = entry?;
            let outcome = match entry.file_type() {
                Ok(kind) if kind.is_dir() && folder != Path::new(SHARED_MEMORY) => {
                    folders.push(entry.path());
                    Ok(())
                }
                Ok(_) if entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes()) => work(&entry.path()),
                Ok(_) => Ok(()),
                Err(e) => Err(e),
            };
            match outcome {
                Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
                _ => {}
            }
        }
    }
    Ok(())
}
