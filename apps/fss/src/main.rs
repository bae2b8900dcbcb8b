//! The program `fss`.

use std::process::ExitCode;

fn main() -> ExitCode {
    fss::main(fss::Services::of_fss())
}
