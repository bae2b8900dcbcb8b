//! Where a process of a stack runs: its stack, its schedule, shared memory, and the devices that it waits for.

use crate::member::BIRTH_TIME;
use crate::stack::Stack;
use fss_service::{Process, SiteArgs};
use miette::{Result, miette};
use std::path::Path;
use std::time::{Duration, Instant};

/// A process's stack, and where it runs.
pub(crate) struct Seat {
    pub(crate) stack: Stack,
    /// What the process before it published last, in hexadecimal digits.
    pub(crate) resume: Option<String>,
    process: Process,
}

impl std::ops::Deref for Seat {
    type Target = Process;

    fn deref(&self) -> &Process {
        &self.process
    }
}

impl Seat {
    /// Joins the stack of a run's folder as the service `name`.
    pub(crate) fn open(name: &str, args: &SiteArgs) -> Result<Self> {
        let stack = Stack::in_folder(&args.run)?;
        let process = Process::of(name, args, stack.launch.clone())?;
        Ok(Self { stack, resume: args.resume.clone(), process })
    }

    /// The file with the key that authenticates commands to the links.
    pub(crate) fn link_key(&self) -> Result<&Path> {
        self.launch.devices.link_key.as_deref().ok_or_else(|| miette!("the launch file names no link_key"))
    }
}

/// How long a device may be on its way: where the host is busy, the laboratory that makes it starts late. Less than what a
/// launcher waits for a sign of life, so that it hears the reason.
const DEVICE_PATIENCE: Duration = Duration::from_secs(4);
const _: () = assert!(DEVICE_PATIENCE.as_millis() < BIRTH_TIME.as_millis());

/// Opens a device that another process of the stack may be about to make.
pub(crate) fn wait_for_device<T>(path: &Path, mut open: impl FnMut() -> Result<T>) -> Result<T> {
    let asked = Instant::now();
    while asked.elapsed() < DEVICE_PATIENCE {
        if path.exists()
            && let Ok(device) = open()
        {
            return Ok(device);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    open()
}
