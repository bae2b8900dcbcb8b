//! What a real-time loop asks of the operating system.

use crate::launch::Schedule;
use crate::{BusError, Time};
use std::io;

/// The least of `SCHED_FIFO`.
const LEAST_PRIORITY: u8 = 1;

/// What the process was granted; what it was not is said in `missing`.
#[derive(Clone, Debug, Default)]
pub struct Privileges {
    /// `SCHED_FIFO` at the launch file's priority.
    pub real_time: bool,
    /// All memory locked.
    pub memory_locked: bool,
    /// What was asked for and refused, with the system's word.
    pub missing: Vec<String>,
}

/// Asks for what the schedule wants: memory locked, core pinned, FIFO priority. Goes on without what is refused.
pub fn enter(schedule: &Schedule) -> Privileges {
    let mut granted = Privileges::default();
    if let Some(core) = schedule.core
        && let Err(e) = pin_to_core(core)
    {
        granted.missing.push(format!("core {core}: {e}"));
    }
    if let Some(priority) = schedule.priority {
        match lock_memory() {
            Ok(()) => granted.memory_locked = true,
            Err(e) => granted.missing.push(format!("locked memory: {e} (raise LimitMEMLOCK or grant CAP_IPC_LOCK)")),
        }
        match set_fifo_priority(priority) {
            Ok(()) => granted.real_time = true,
            Err(e) => granted.missing.push(format!("SCHED_FIFO {priority}: {e} (grant CAP_SYS_NICE)")),
        }
    }
    granted
}

/// The monotonic clock.
///
/// # Errors
/// Where the system has none.
#[allow(unsafe_code)]
pub fn now() -> Result<Time, BusError> {
    let mut t = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `t` is a valid timespec that the call only writes.
    let code = unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut t) };
    if code != 0 {
        return Err(BusError::System { what: "reading the monotonic clock", source: io::Error::last_os_error() });
    }
    Ok(Time::from_ns(t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64))
}

/// Sleeps until `wake`, or returns at once where that is past; a signal may end the sleep early.
#[allow(unsafe_code)]
pub fn sleep_until(wake: Time) {
    let t = libc::timespec {
        tv_sec: (wake.ns() / 1_000_000_000) as libc::time_t,
        tv_nsec: (wake.ns() % 1_000_000_000) as libc::c_long,
    };
    // SAFETY: `t` is a valid timespec that the call only reads; no remainder is asked for.
    unsafe { libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &raw const t, std::ptr::null_mut()) };
}

/// The core that the calling thread runs on; `u32::MAX` where the system does not tell.
#[allow(unsafe_code)]
pub(crate) fn this_core() -> u32 {
    // SAFETY: the call takes nothing and writes nothing.
    u32::try_from(unsafe { libc::sched_getcpu() }).unwrap_or(u32::MAX)
}

/// Pins the calling thread to a core.
///
/// # Errors
/// Where there is no such core, or the system refuses it.
#[allow(unsafe_code)]
pub fn pin_to_core(core: usize) -> io::Result<()> {
    if core >= libc::CPU_SETSIZE as usize {
        return Err(io::Error::from(io::ErrorKind::InvalidInput));
    }
    // SAFETY: an all-zero cpu_set_t is an empty set, `core` lies within it, and the call reads exactly its size.
    let code = unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        libc::CPU_SET(core, &mut set);
        libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &raw const set)
    };
    if code == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Puts the calling thread under `SCHED_FIFO`.
///
/// # Errors
/// Where the system refuses it.
#[allow(unsafe_code)]
pub fn set_fifo_priority(priority: u8) -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: i32::from(priority) };
    // SAFETY: `parameters` is valid and only read; 0 names the calling thread.
    let code = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) };
    if code == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Puts the calling thread, which serves a device of a real-time service, before everything that is not real time and behind
/// every loop: what a busy host does delays no measurement, and a flood of datagrams delays no loop. Where the system refuses
/// it, it stays under normal scheduling.
pub fn enter_device() {
    let _refused = set_fifo_priority(LEAST_PRIORITY);
}

#[allow(unsafe_code)]
fn lock_memory() -> io::Result<()> {
    // SAFETY: the call takes flags only.
    let code = unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) };
    if code == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}
