//! Programs in other languages that send back what comes: made here, from sources that this program holds.

use fss_launcher::files::{this_program, write_silently};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;

const HEADER: &str = include_str!("../../../../interfaces/c/include/fss.h");
const SERVICE: &str = include_str!("../../../../interfaces/python/fss/service.py");

/// A program to be started with the prefix in shared memory.
#[derive(Clone)]
pub(crate) struct Peer {
    program: OsString,
    arguments: Vec<PathBuf>,
    folder: PathBuf,
    library: PathBuf,
}

impl Peer {
    /// The command that starts it.
    pub(crate) fn command(&self, prefix: &str) -> Command {
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).arg(prefix);
        command.env("PYTHONPATH", &self.folder).env("FSS_LIBRARY", &self.library).env("PYTHONDONTWRITEBYTECODE", "1");
        command
    }
}

/// The folder in which they are made; it goes with this.
pub(crate) struct Workshop(PathBuf);

impl Workshop {
    /// Makes it.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub(crate) fn open() -> Result<Self> {
        let folder = std::env::temp_dir().join(format!("fss-bench-ipc-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("fss")).into_diagnostic()?;
        Ok(Self(folder))
    }

    /// In C, on libfss.
    ///
    /// # Errors
    /// Where this computer cannot build it.
    pub(crate) fn c(&self) -> Result<Peer> {
        let library = library()?;
        self.write("fss.h", HEADER)?;
        self.write("fss_messages.h", &messages("--c")?)?;
        self.write("echo.c", include_str!("echo.c"))?;
        let program = self.0.join("echo");
        let mut compiler = Command::new("cc");
        compiler.args(["-std=c11", "-O2", "-o"]).arg(&program).arg("-I").arg(&self.0).arg(self.0.join("echo.c"));
        // By its path, which a library without a name of its own is found by again.
        said(compiler.arg(&library)).wrap_err("the C compiler refuses")?;
        Ok(self.peer(program.into_os_string(), Vec::new(), library))
    }

    /// In Python, on `fss.service`.
    ///
    /// # Errors
    /// Where there is no Python.
    pub(crate) fn python(&self) -> Result<Peer> {
        let library = library()?;
        self.write("fss/__init__.py", "")?;
        self.write("fss/service.py", SERVICE)?;
        self.in_python("ctypes", "echo.py", include_str!("echo.py"), library)
    }

    /// In Python, on iceoryx2's package.
    ///
    /// # Errors
    /// Where there is no Python that has it.
    pub(crate) fn python_on_iceoryx2(&self) -> Result<Peer> {
        let text = include_str!("echo_iceoryx2.py");
        self.in_python("iceoryx2", "echo_iceoryx2.py", text, PathBuf::new())
    }

    fn in_python(&self, module: &str, name: &str, text: &str, library: PathBuf) -> Result<Peer> {
        let python = std::env::var_os("FSS_PYTHON").unwrap_or_else(|| "python3".into());
        said(Command::new(&python).arg("-c").arg(format!("import {module}"))).map_err(|_| {
            miette!("{} has no module {module} (FSS_PYTHON names a Python that has it)", python.display())
        })?;
        self.write("fss_messages.py", &messages("--python")?)?;
        self.write(name, text)?;
        Ok(self.peer(python, vec![self.0.join(name)], library))
    }

    fn peer(&self, program: OsString, arguments: Vec<PathBuf>, library: PathBuf) -> Peer {
        Peer { program, arguments, folder: self.0.clone(), library }
    }

    fn write(&self, name: &str, text: &str) -> Result<()> {
        write_silently(&self.0.join(name), text)
    }
}

impl Drop for Workshop {
    fn drop(&mut self) {
        let _best_effort = std::fs::remove_dir_all(&self.0);
    }
}

/// libfss, which lies beside this program or where `FSS_LIBRARY` says.
fn library() -> Result<PathBuf> {
    let beside = std::env::current_exe().into_diagnostic()?.with_file_name("libfss.so");
    let library = std::env::var_os("FSS_LIBRARY").map_or(beside, PathBuf::from);
    if library.is_file() {
        return Ok(library);
    }
    Err(miette!("there is no {}; `cargo build --release -p fss-c` makes it", library.display()))
}

/// The messages of this build for a language.
fn messages(language: &str) -> Result<String> {
    said(this_program().args(["messages", language]))
}

/// What a command says that succeeds.
fn said(command: &mut Command) -> Result<String> {
    let output = command.output().into_diagnostic()?;
    if !output.status.success() {
        return Err(miette!("{}", String::from_utf8_lossy(&output.stderr).trim()));
    }
    String::from_utf8(output.stdout).into_diagnostic()
}
