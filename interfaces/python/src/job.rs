//! Long work beside the interpreter: it says how far it is, and Ctrl-C ends it.

use crate::error;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::any::Any;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

/// How often signals are looked for.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// How far work is: its share, where that is known, and words.
type Progress = (Option<f64>, String);

/// What unwinds through work that nobody waits for any more.
struct Cancelled;

/// What work tells who waits for it.
pub(crate) struct Teller {
    told: Sender<Progress>,
    cancelled: Arc<AtomicBool>,
}

impl Teller {
    /// Says how far the work is. Work that nobody waits for any more ends here: it unwinds.
    pub(crate) fn say(&self, share: Option<f64>, words: &str) {
        if self.cancelled.load(Ordering::Relaxed) || self.told.send((share, words.to_owned())).is_err() {
            resume_unwind(Box::new(Cancelled));
        }
    }
}

/// Does work on a thread of its own while the interpreter runs on; `progress` is called with a share and words.
///
/// # Errors
/// The work's, as an exception; what a signal's handler or `progress` raises. The work then ends the next time it tells
/// something; what it has written stays.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&Teller) -> miette::Result<T> + Send + 'static,
) -> PyResult<T> {
    let (told, hear) = channel();
    let cancelled = Arc::new(AtomicBool::new(false));
    let teller = Teller { told, cancelled: cancelled.clone() };
    let worker = thread::spawn(move || work(&teller));
    if let Err(raised) = attend(py, progress.as_ref(), hear) {
        cancelled.store(true, Ordering::Relaxed);
        return Err(raised);
    }
    match py.detach(|| worker.join()) {
        Ok(done) => done.map_err(|report| error::from_report(&report)),
        Err(panic) => Err(PyRuntimeError::new_err(format!("a fault in fss: {}", words_of(panic.as_ref())))),
    }
}

/// Passes on what is told until the work has ended.
fn attend(py: Python<'_>, progress: Option<&Py<PyAny>>, mut hear: Receiver<Progress>) -> PyResult<()> {
    loop {
        let (receiver, heard) = py.detach(move || {
            let heard = hear.recv_timeout(LOOK_EVERY);
            (hear, heard)
        });
        hear = receiver;
        py.check_signals()?;
        match (heard, progress) {
            (Ok(told), Some(progress)) => {
                progress.call1(py, told)?;
            }
            (Err(RecvTimeoutError::Disconnected), _) => return Ok(()),
            _ => {}
        }
    }
}

fn words_of(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    owned.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no words")
}
