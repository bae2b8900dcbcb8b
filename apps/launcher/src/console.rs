//! What the program says to who started it.

use std::cell::RefCell;
use std::fmt::{Arguments, Write as _};
use std::io::{ErrorKind, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether something that should have been said could not be.
static UNSAID: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// What this thread says is collected here in place of standard output, where there is such a text.
    static COLLECTED: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Does something whose words are collected in place of standard output: for those who show them elsewhere.
pub fn collecting<T>(work: impl FnOnce() -> T) -> (T, String) {
    let outer = COLLECTED.replace(Some(String::new()));
    let done = work();
    (done, COLLECTED.replace(outer).unwrap_or_default())
}

/// Says a line, as `println!` does.
#[macro_export]
macro_rules! say {
    () => {
        $crate::console::put(format_args!("\n"))
    };
    ($($words:tt)*) => {
        $crate::console::put(format_args!("{}\n", format_args!($($words)*)))
    };
}

/// Says part of a line, as `print!` does.
#[macro_export]
macro_rules! say_part {
    ($($words:tt)*) => {
        $crate::console::put(format_args!($($words)*))
    };
}

/// Writes to standard output. Output that nobody reads any more (`| head`) is no failure: the command goes on, and its files are
/// written. Any other failure is told, once, and by the exit code.
pub fn put(words: Arguments<'_>) {
    let is_collected = COLLECTED.with_borrow_mut(|text| text.as_mut().map(|text| text.write_fmt(words)).is_some());
    if is_collected {
        return;
    }
    let Err(e) = std::io::stdout().lock().write_fmt(words) else { return };
    if e.kind() != ErrorKind::BrokenPipe && !UNSAID.swap(true, Ordering::Relaxed) {
        eprintln!("cannot write to standard output: {e}");
    }
}

/// How a command ends that has done what it should.
pub fn exit_code() -> ExitCode {
    if UNSAID.load(Ordering::Relaxed) { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
