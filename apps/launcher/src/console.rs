//! What the program says to who started it.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether something that should have been said could not be.
static UNSAID: AtomicBool = AtomicBool::new(false);

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
    let Err(e) = std::io::stdout().lock().write_fmt(words) else { return };
    if e.kind() != ErrorKind::BrokenPipe && !UNSAID.swap(true, Ordering::Relaxed) {
        eprintln!("cannot write to standard output: {e}");
    }
}

/// How a command ends that has done what it should.
pub fn exit_code() -> ExitCode {
    if UNSAID.load(Ordering::Relaxed) { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
