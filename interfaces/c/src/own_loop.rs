//! Ports for a program with a loop of its own, which no launcher starts.

use crate::declared::Declared;
use crate::options::Options;
use crate::{CService, Ports, raw, text};
use fss_bus::{Bus, RawPorts, SharedConfig, realtime, stack_runs};
use fss_service::Refusal;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::ptr::{self, NonNull};

thread_local! {
    /// Why this thread's last [`fss_open`] failed.
    static REASON: RefCell<CString> = RefCell::default();
}

/// Joins a stack with the ports of a service.
///
/// # Safety
/// As `fss.h` says: `service` and all that it points to are there during the call; `bus` and `vehicle` are strings.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_open(service: *const CService, bus: *const c_char, vehicle: *const c_char) -> *mut Ports {
    // SAFETY: the caller keeps the contract above; null pointers are looked for.
    let outcome = unsafe { open(service.as_ref(), text(bus), text(vehicle)) };
    outcome.map_or_else(
        |reason| {
            let reason = CString::new(reason.to_string().replace('\0', " ")).unwrap_or_default();
            REASON.with_borrow_mut(|last| *last = reason);
            ptr::null_mut()
        },
        |ports| Box::into_raw(Box::new(ports)),
    )
}

/// # Safety
/// All that `service` points to is there.
unsafe fn open(service: Option<&CService>, bus: Option<String>, vehicle: Option<String>) -> Result<Ports, Refusal> {
    let service = service.ok_or("fss_open: there is no service")?;
    let prefix = bus.ok_or("fss_open: name the stack's prefix in shared memory, such as fss_1234_")?;
    if !stack_runs(&prefix)? {
        return Err(format!("fss_open: no stack runs with the prefix '{prefix}' in shared memory").into());
    }
    // SAFETY: the caller says so.
    let declared = unsafe { Declared::read(service) }?;
    let name = &declared.description.service;
    let (inputs, outputs) = (declared.description.input_topics()?, declared.description.output_topics()?);
    let node = format!("{name}-{}", std::process::id());
    let joined = Bus::shared(&SharedConfig { node, prefix })?.for_vehicle(&vehicle.unwrap_or_default());
    let raw = Box::new(RawPorts::open(name, &inputs, &outputs, &joined)?);
    let mut ports = Ports::new(Options::new(&toml::Table::new())?, declared.output_sizes);
    ports.raw = NonNull::new(Box::into_raw(raw));
    ports.joined = Some(joined);
    Ok(ports)
}

/// Why the last [`fss_open`] of this thread failed.
#[unsafe(no_mangle)]
pub extern "C" fn fss_error() -> *const c_char {
    REASON.with_borrow(|reason| CStr::as_ptr(reason))
}

/// Takes what has come on the inputs, and tells the time.
///
/// # Safety
/// `ports` is null, or what [`fss_open`] gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_take(ports: *mut Ports) -> u64 {
    // SAFETY: the caller keeps the contract above.
    let joined = unsafe { ports.as_ref() }.filter(|ports| ports.joined.is_some());
    // SAFETY: as above.
    let (Some(_), Some(raw), Ok(now)) = (joined, unsafe { raw(ports) }, realtime::now()) else { return 0 };
    raw.take(now);
    now.ns()
}

/// Sends what was published, where no step ends that would send it; false where it could not be sent.
///
/// # Safety
/// `ports` is what the running function of the service was given, or what [`fss_open`] gave.
pub(crate) unsafe fn send(ports: *mut Ports) -> bool {
    // SAFETY: the caller says so.
    let (joined, raw) = unsafe { (ports.as_ref().is_some_and(|ports| ports.joined.is_some()), raw(ports)) };
    match (raw, realtime::now()) {
        _ if !joined => true,
        (Some(raw), Ok(now)) => raw.flush(now) == 0,
        _ => false,
    }
}

/// Leaves the stack.
///
/// # Safety
/// `ports` is null, or what [`fss_open`] gave, and is not used after this.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_close(ports: *mut Ports) {
    // SAFETY: the caller keeps the contract above.
    if ports.is_null() || unsafe { &*ports }.joined.is_none() {
        return;
    }
    // SAFETY: both were made by `fss_open` from boxes; nobody uses them after this.
    let ports = unsafe { Box::from_raw(ports) };
    if let Some(raw) = ports.raw {
        // SAFETY: as above. The ports leave shared memory before the stack is left.
        drop(unsafe { Box::from_raw(raw.as_ptr()) });
    }
}
