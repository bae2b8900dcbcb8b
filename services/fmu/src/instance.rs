//! A running FMU: the C functions of its shared library.
//!
//! What an FMU does wrong in its own memory nobody can stop: it runs in this process, which flies nothing else.
#![allow(unsafe_code)] // a foreign library: each use says why it holds

use crate::model::{Fmi, Kind, Model};
use libloading::Library;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::Path;
use std::ptr;

/// `fmi2Status` and `fmi3Status`: up to here a call has done what it was asked.
const WARNING: c_int = 1;

type Component = *mut c_void;
type Simple = unsafe extern "C" fn(Component) -> c_int;
type Free = unsafe extern "C" fn(Component);
type Get2<T> = unsafe extern "C" fn(Component, *const u32, usize, *mut T) -> c_int;
type Set2<T> = unsafe extern "C" fn(Component, *const u32, usize, *const T) -> c_int;
type Get3<T> = unsafe extern "C" fn(Component, *const u32, usize, *mut T, usize) -> c_int;
type Set3<T> = unsafe extern "C" fn(Component, *const u32, usize, *const T, usize) -> c_int;
type Step2 = unsafe extern "C" fn(Component, f64, f64, c_int) -> c_int;
type Step3 = unsafe extern "C" fn(Component, f64, f64, bool, *mut bool, *mut bool, *mut bool, *mut f64) -> c_int;

/// `fmi2CallbackFunctions`.
#[repr(C)]
struct Callbacks {
    logger: unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char),
    allocate: unsafe extern "C" fn(usize, usize) -> *mut c_void,
    free: unsafe extern "C" fn(*mut c_void),
    step_finished: Option<unsafe extern "C" fn(*mut c_void, c_int)>,
    environment: *mut c_void,
}

/// The functions that are called after the start, by version.
enum Functions {
    Two {
        step: Step2,
        get_real: Get2<f64>,
        set_real: Set2<f64>,
        get_integer: Get2<c_int>,
        set_integer: Set2<c_int>,
        get_boolean: Get2<c_int>,
        set_boolean: Set2<c_int>,
    },
    Three {
        step: Step3,
        get_real: Get3<f64>,
        set_real: Set3<f64>,
        get_integer: Get3<i32>,
        set_integer: Set3<i32>,
        get_boolean: Get3<bool>,
        set_boolean: Set3<bool>,
    },
}

/// A running FMU.
pub struct Instance {
    component: Component,
    functions: Functions,
    terminate: Simple,
    free: Free,
    _callbacks: Box<Callbacks>,
    // Last: its code is in use until everything else is gone.
    library: Library,
}

/// `fmi2Instantiate`.
type InstantiateTwo = unsafe extern "C" fn(
    *const c_char,
    c_int,
    *const c_char,
    *const c_char,
    *const Callbacks,
    c_int,
    c_int,
) -> Component;

/// `fmi3InstantiateCoSimulation`.
type InstantiateThree = unsafe extern "C" fn(
    *const c_char,
    *const c_char,
    *const c_char,
    bool,
    bool,
    bool,
    bool,
    *const u32,
    usize,
    *mut c_void,
    unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char),
    *const c_void,
) -> Component;

/// Calls the FMU's instantiate function: the instance, its functions, and what their names begin with.
///
/// # Safety
/// The callbacks outlive the instance.
unsafe fn instantiate(
    model: &Model,
    library: &Library,
    folder: &Path,
    callbacks: &Callbacks,
) -> Result<(Component, Functions, &'static str), String> {
    let text = |text: String| CString::new(text).map_err(|_| "a name of it holds a NUL".to_owned());
    let (name, token) = (text("fss".to_owned())?, text(model.token.clone())?);
    let resources = folder.join("resources");
    // SAFETY: the symbols have the types that the standard gives them; all arguments outlive the calls.
    unsafe {
        match model.fmi {
            Fmi::Two => {
                let resources = text(format!("file://{}", resources.display()))?;
                let make: InstantiateTwo = symbol(library, "fmi2Instantiate")?;
                let component = make(name.as_ptr(), 1, token.as_ptr(), resources.as_ptr(), callbacks, 0, 0);
                Ok((component, Functions::two(library)?, "fmi2"))
            }
            Fmi::Three => {
                let resources = text(format!("{}/", resources.display()))?;
                let make: InstantiateThree = symbol(library, "fmi3InstantiateCoSimulation")?;
                let (named, path) = (name.as_ptr(), resources.as_ptr());
                let component = make(
                    named,
                    token.as_ptr(),
                    path,
                    false,
                    false,
                    false,
                    false,
                    ptr::null(),
                    0,
                    ptr::null_mut(),
                    log3,
                    ptr::null(),
                );
                Ok((component, Functions::three(library)?, "fmi3"))
            }
        }
    }
}

impl Instance {
    /// Loads the library of an unpacked FMU and makes one, in its initialization mode.
    ///
    /// # Errors
    /// What is missing, or which call failed.
    pub fn start(model: &Model, library: &Path, folder: &Path) -> Result<Self, String> {
        // SAFETY: the library runs what it likes when it is loaded; the user has named it for that.
        let library = unsafe { Library::new(library) }.map_err(|e| format!("cannot be loaded: {e}"))?;
        let callbacks = Box::new(Callbacks {
            logger: log2,
            allocate: libc::calloc,
            free: libc::free,
            step_finished: None,
            environment: ptr::null_mut(),
        });
        // SAFETY: `callbacks` outlives the FMU; the symbols have the types that the standard gives them.
        unsafe {
            let (component, functions, prefix) = instantiate(model, &library, folder, &callbacks)?;
            if component.is_null() {
                return Err("does not start: its instantiate function gives nothing".to_owned());
            }
            let terminate = symbol(&library, &format!("{prefix}Terminate"))?;
            let free = symbol(&library, &format!("{prefix}FreeInstance"))?;
            let instance = Self { component, functions, terminate, free, _callbacks: callbacks, library };
            instance.initialize(model.fmi)?;
            Ok(instance)
        }
    }

    /// # Safety
    /// The library is of this version.
    unsafe fn initialize(&self, fmi: Fmi) -> Result<(), String> {
        // SAFETY: as for `start`.
        unsafe {
            match fmi {
                Fmi::Two => {
                    let set_up: unsafe extern "C" fn(Component, c_int, f64, f64, c_int, f64) -> c_int =
                        symbol(&self.library, "fmi2SetupExperiment")?;
                    done("fmi2SetupExperiment", set_up(self.component, 0, 0.0, 0.0, 0, 0.0))?;
                    let enter: Simple = symbol(&self.library, "fmi2EnterInitializationMode")?;
                    done("fmi2EnterInitializationMode", enter(self.component))
                }
                Fmi::Three => {
                    let enter: unsafe extern "C" fn(Component, bool, f64, f64, bool, f64) -> c_int =
                        symbol(&self.library, "fmi3EnterInitializationMode")?;
                    done("fmi3EnterInitializationMode", enter(self.component, false, 0.0, 0.0, false, 0.0))
                }
            }
        }
    }

    /// Leaves the initialization mode: parameters are set.
    ///
    /// # Errors
    /// Where the FMU refuses.
    pub fn begin(&self, fmi: Fmi) -> Result<(), String> {
        let name = if fmi == Fmi::Two { "fmi2ExitInitializationMode" } else { "fmi3ExitInitializationMode" };
        // SAFETY: as for `start`.
        let code = unsafe { symbol::<Simple>(&self.library, name)?(self.component) };
        done(name, code)
    }

    /// Lets the FMU step from `t_s` on by `h_s`.
    ///
    /// # Errors
    /// Where it refuses, fails or wants to end.
    pub fn step(&self, t_s: f64, h_s: f64) -> Result<(), &'static str> {
        // SAFETY: the functions are those of this component, and all pointers outlive the call.
        let (code, wants_to_end) = unsafe {
            match &self.functions {
                Functions::Two { step, .. } => (step(self.component, t_s, h_s, 1), false),
                Functions::Three { step, .. } => {
                    let (mut event, mut end, mut early, mut last_s) = (false, false, false, 0.0);
                    let code = step(
                        self.component,
                        t_s,
                        h_s,
                        true,
                        &raw mut event,
                        &raw mut end,
                        &raw mut early,
                        &raw mut last_s,
                    );
                    (code, end)
                }
            }
        };
        match code {
            _ if wants_to_end => Err("the FMU wants to end the simulation"),
            0 | WARNING => Ok(()),
            _ => Err("the FMU fails in its step"),
        }
    }

    /// A variable's value; false is 0 and true is 1.
    ///
    /// # Errors
    /// Where the FMU refuses.
    pub fn get(&self, reference: u32, kind: Kind) -> Result<f64, &'static str> {
        let (mut real, mut integer, mut truth) = (0.0, 0, false);
        let (c, r) = (self.component, &raw const reference);
        // SAFETY: as for `step`: one reference, one value.
        let code = unsafe {
            match (&self.functions, kind) {
                (Functions::Two { get_real, .. }, Kind::Real) => get_real(c, r, 1, &raw mut real),
                (Functions::Two { get_integer, .. }, Kind::Integer) => get_integer(c, r, 1, &raw mut integer),
                (Functions::Two { get_boolean, .. }, Kind::Boolean) => get_boolean(c, r, 1, &raw mut integer),
                (Functions::Three { get_real, .. }, Kind::Real) => get_real(c, r, 1, &raw mut real, 1),
                (Functions::Three { get_integer, .. }, Kind::Integer) => get_integer(c, r, 1, &raw mut integer, 1),
                (Functions::Three { get_boolean, .. }, Kind::Boolean) => get_boolean(c, r, 1, &raw mut truth, 1),
            }
        };
        if code > WARNING {
            return Err("the FMU does not give a variable");
        }
        Ok(if kind == Kind::Real { real } else { f64::from(integer) + f64::from(u8::from(truth)) })
    }

    /// Sets a variable, rounded where it is whole.
    ///
    /// # Errors
    /// Where the FMU refuses.
    pub fn set(&self, reference: u32, kind: Kind, value: f64) -> Result<(), &'static str> {
        let (integer, truth) = (value.round() as c_int, value.abs() >= 0.5);
        let as_integer = c_int::from(truth);
        let (c, r) = (self.component, &raw const reference);
        // SAFETY: as for `get`.
        let code = unsafe {
            match (&self.functions, kind) {
                (Functions::Two { set_real, .. }, Kind::Real) => set_real(c, r, 1, &raw const value),
                (Functions::Two { set_integer, .. }, Kind::Integer) => set_integer(c, r, 1, &raw const integer),
                (Functions::Two { set_boolean, .. }, Kind::Boolean) => set_boolean(c, r, 1, &raw const as_integer),
                (Functions::Three { set_real, .. }, Kind::Real) => set_real(c, r, 1, &raw const value, 1),
                (Functions::Three { set_integer, .. }, Kind::Integer) => set_integer(c, r, 1, &raw const integer, 1),
                (Functions::Three { set_boolean, .. }, Kind::Boolean) => set_boolean(c, r, 1, &raw const truth, 1),
            }
        };
        if code > WARNING { Err("the FMU does not take a variable") } else { Ok(()) }
    }
}

impl Functions {
    /// # Safety
    /// The library is an FMU of FMI 2.
    unsafe fn two(library: &Library) -> Result<Self, String> {
        // SAFETY: the symbols have the types that the standard gives them.
        unsafe {
            Ok(Self::Two {
                step: symbol(library, "fmi2DoStep")?,
                get_real: symbol(library, "fmi2GetReal")?,
                set_real: symbol(library, "fmi2SetReal")?,
                get_integer: symbol(library, "fmi2GetInteger")?,
                set_integer: symbol(library, "fmi2SetInteger")?,
                get_boolean: symbol(library, "fmi2GetBoolean")?,
                set_boolean: symbol(library, "fmi2SetBoolean")?,
            })
        }
    }

    /// # Safety
    /// The library is an FMU of FMI 3.
    unsafe fn three(library: &Library) -> Result<Self, String> {
        // SAFETY: the symbols have the types that the standard gives them.
        unsafe {
            Ok(Self::Three {
                step: symbol(library, "fmi3DoStep")?,
                get_real: symbol(library, "fmi3GetFloat64")?,
                set_real: symbol(library, "fmi3SetFloat64")?,
                get_integer: symbol(library, "fmi3GetInt32")?,
                set_integer: symbol(library, "fmi3SetInt32")?,
                get_boolean: symbol(library, "fmi3GetBoolean")?,
                set_boolean: symbol(library, "fmi3SetBoolean")?,
            })
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: the component lives, and nothing is called after this.
        unsafe {
            (self.terminate)(self.component);
            (self.free)(self.component);
        }
    }
}

/// # Safety
/// The symbol has the type `T`, which outlives no library that it is from.
unsafe fn symbol<T: Copy>(library: &Library, name: &str) -> Result<T, String> {
    // SAFETY: the caller says so.
    let found = unsafe { library.get::<T>(name.as_bytes()) };
    found.map(|symbol| *symbol).map_err(|_| format!("lacks the function {name}"))
}

fn done(call: &str, code: c_int) -> Result<(), String> {
    if code > WARNING { Err(format!("{call} fails")) } else { Ok(()) }
}

/// What an FMU of FMI 2 says. The standard's logger has more arguments after these, which such a function leaves alone.
unsafe extern "C" fn log2(
    _: *mut c_void,
    _name: *const c_char,
    _status: c_int,
    _category: *const c_char,
    message: *const c_char,
) {
    // SAFETY: a message is a string, or null.
    unsafe { say(message) };
}

/// What an FMU of FMI 3 says.
unsafe extern "C" fn log3(_: *mut c_void, _status: c_int, _category: *const c_char, message: *const c_char) {
    // SAFETY: a message is a string, or null.
    unsafe { say(message) };
}

/// # Safety
/// `message` is null or ends with a zero.
#[expect(clippy::print_stderr, reason = "the launcher shows what a service says there")]
unsafe fn say(message: *const c_char) {
    if !message.is_null() {
        // SAFETY: the caller says so.
        eprintln!("fmu: {}", unsafe { CStr::from_ptr(message) }.to_string_lossy());
    }
}
