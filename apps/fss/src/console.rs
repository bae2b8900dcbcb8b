//! What the program says to who started it.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write};

/// Says a line, as `println!` does.
macro_rules! say {
    () => {
        $crate::console::put(format_args!("\n"))
    };
    ($($words:tt)*) => {
        $crate::console::put(format_args!("{}\n", format_args!($($words)*)))
    };
}

/// Says part of a line, as `print!` does.
macro_rules! say_part {
    ($($words:tt)*) => {
        $crate::console::put(format_args!($($words)*))
    };
}

/// Writes to standard output. Output that nobody reads any more (`| head`) is no failure: the command goes on, and its files are
/// written. Any other failure is told.
pub fn put(words: Arguments<'_>) {
    match std::io::stdout().lock().write_fmt(words) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => eprintln!("cannot write to standard output: {e}"),
        _ => {}
    }
}
