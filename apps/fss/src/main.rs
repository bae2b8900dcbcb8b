//! The program `fss`.
fn main() {
    eprintln!("fss: no command is built yet");
    std::process::exit(2);
}
