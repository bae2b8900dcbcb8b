//! libfss: services in C, and in whatever calls C. `include/fss.h` documents it.
//!
//! Everything a pointer of the caller's can do wrong is looked at once, before the first step ([`Declared`]). The loop copies samples
//! between shared memory and buffers of its own; it allocates no more than a Rust service's does, and takes no lock.
#![allow(unsafe_code)] // a language binding: each use says why it holds

mod declared;
mod options;
mod own_loop;

use declared::Declared;
use fss_bus::{Bus, RawPorts, RawService, Time};
use fss_service::{Description, RawProgram, Refusal, Site, run_raw};
use options::Options;
pub use own_loop::{fss_close, fss_error, fss_open, fss_take};
use std::ffi::{CStr, OsStr, OsString, c_char, c_int, c_void};
use std::os::unix::ffi::OsStrExt;
use std::process::ExitCode;
use std::ptr;

/// `fss_topic`.
#[repr(C)]
pub struct CTopic {
    topic: *const c_char,
    schema: *const c_char,
    definition: *const c_char,
    size: usize,
}

/// `fss_service`.
#[repr(C)]
pub struct CService {
    name: *const c_char,
    inputs: *const CTopic,
    input_count: usize,
    outputs: *const CTopic,
    output_count: usize,
    keys: *const *const c_char,
    key_count: usize,
    create: Option<unsafe extern "C" fn(*mut Ports, *const f64, f64) -> *mut c_void>,
    step: Option<unsafe extern "C" fn(*mut c_void, *mut Ports, u64)>,
    destroy: Option<unsafe extern "C" fn(*mut c_void)>,
    every: *const usize,
    every_count: usize,
    options: *const *const c_char,
    option_count: usize,
}

/// `fss_ports`: what a function of the service may ask for while it runs.
pub struct Ports {
    /// The ports; none while the service is made.
    raw: Option<ptr::NonNull<RawPorts>>,
    refused: Option<String>,
    /// What the service is told beside the numbers of its keys.
    options: Options,
    /// Sizes of the outputs' samples, bytes.
    output_sizes: Vec<usize>,
    /// Of a program with a loop of its own: the stack that it has joined.
    joined: Option<Bus>,
}

impl Ports {
    fn new(options: Options, output_sizes: Vec<usize>) -> Self {
        Self { raw: None, refused: None, options, output_sizes, joined: None }
    }
}

/// The functions of a service, with what they work on.
struct Stepper {
    itself: *mut c_void,
    step: unsafe extern "C" fn(*mut c_void, *mut Ports, u64),
    destroy: Option<unsafe extern "C" fn(*mut c_void)>,
    ports: Ports,
}

impl RawService for Stepper {
    fn step(&mut self, now: Time, ports: &mut RawPorts) {
        self.ports.raw = Some(ptr::NonNull::from(ports));
        // SAFETY: the function is the service's own and gets what its `create` returned; the ports live until it returns, and nobody
        // else uses them meanwhile.
        unsafe { (self.step)(self.itself, &raw mut self.ports, now.ns()) };
        self.ports.raw = None;
    }
}

impl Drop for Stepper {
    fn drop(&mut self) {
        if let Some(destroy) = self.destroy {
            // SAFETY: as for `step`; it is called once, and no step follows.
            unsafe { destroy(self.itself) };
        }
    }
}

/// A declared service as the front door takes it.
struct Program<'a> {
    declared: &'a Declared,
    service: &'a CService,
}

impl RawProgram for Program<'_> {
    type Service = Stepper;

    fn description(&self) -> &Description {
        &self.declared.description
    }

    fn check(&self, config: &str) -> Result<(), Refusal> {
        self.declared.config(config).map(|_| ())
    }

    fn make(&self, config: &str, site: &Site) -> Result<Stepper, Refusal> {
        let (config, options) = self.declared.config(config)?;
        let options = Options::new(&options)?;
        let (Some(create), Some(step)) = (self.service.create, self.service.step) else {
            return Err("create and step are functions that a service has".into());
        };
        let mut ports = Ports::new(options, self.declared.output_sizes.clone());
        // SAFETY: the function is the service's own; the values are as many as it has keys, and outlive the call.
        let itself = unsafe { create(&raw mut ports, config.as_ptr(), site.rate_hz) };
        match ports.refused.take() {
            Some(reason) => Err(reason.into()),
            None => Ok(Stepper { itself, step, destroy: self.service.destroy, ports }),
        }
    }
}

/// Runs the service as the launcher's command line says.
///
/// # Safety
/// As `fss.h` says: `argv` holds `argc` strings, and `service` and all that it points to stay until this returns.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_main(argc: c_int, argv: *const *const c_char, service: *const CService) -> c_int {
    // SAFETY: the caller keeps the contract above.
    let (arguments, service) = unsafe { (arguments(argc, argv), service.as_ref()) };
    let Some(service) = service else {
        eprintln!("fss_main: there is no service");
        return 1;
    };
    // SAFETY: as above.
    match unsafe { Declared::read(service) } {
        Ok(declared) => {
            let code = run_raw(&Program { declared: &declared, service }, arguments);
            c_int::from(code != ExitCode::SUCCESS)
        }
        Err(reason) => {
            eprintln!("{reason}");
            1
        }
    }
}

/// # Safety
/// `argv` holds `argc` strings.
unsafe fn arguments(argc: c_int, argv: *const *const c_char) -> Vec<OsString> {
    let count = if argv.is_null() { 0 } else { usize::try_from(argc).unwrap_or(0) };
    // SAFETY: the caller says so; a null among them is passed over.
    let each = (0..count).map(|i| unsafe { *argv.add(i) }).filter(|argument| !argument.is_null());
    // SAFETY: as above: each ends with a zero.
    each.map(|argument| OsStr::from_bytes(unsafe { CStr::from_ptr(argument) }.to_bytes()).to_owned()).collect()
}

/// The service cannot fly, and why.
///
/// # Safety
/// `ports` is what `create` was given, `reason` a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_refuse(ports: *mut Ports, reason: *const c_char) {
    // SAFETY: the caller keeps the contract above; null pointers are looked for.
    if let (Some(ports), Some(reason)) = unsafe { (ports.as_mut(), text(reason)) } {
        ports.refused = Some(reason);
    }
}

/// # Safety
/// `string` is null or ends with a zero.
unsafe fn text(string: *const c_char) -> Option<String> {
    // SAFETY: the caller says so.
    (!string.is_null()).then(|| unsafe { CStr::from_ptr(string) }.to_string_lossy().into_owned())
}

/// # Safety
/// `ports` is null, or what the running function of the service was given.
unsafe fn raw<'a>(ports: *const Ports) -> Option<&'a mut RawPorts> {
    // SAFETY: the ports live while the function runs, and the caller uses what this gives before it returns to C.
    unsafe { ports.as_ref().and_then(|ports| ports.raw).map(|mut raw| raw.as_mut()) }
}

/// The newest sample of an input.
///
/// # Safety
/// `ports` is what `step` was given.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_latest(ports: *const Ports, input: usize) -> *const c_void {
    // SAFETY: the caller keeps the contract above.
    let sample = unsafe { raw(ports) }.and_then(|ports| ports.input(input)).and_then(|input| input.get());
    sample.map_or(ptr::null(), |sample| sample.as_ptr().cast())
}

/// The newest sample of an input, if it came since the last step.
///
/// # Safety
/// `ports` is what `step` was given.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_fresh(ports: *const Ports, input: usize) -> *const c_void {
    // SAFETY: the caller keeps the contract above.
    let sample = unsafe { raw(ports) }.and_then(|ports| ports.input(input)).and_then(|input| input.fresh());
    sample.map_or(ptr::null(), |sample| sample.as_ptr().cast())
}

/// How many samples of an input came since the last step: of one that takes every sample, at most 64; of another, 0 or 1.
///
/// # Safety
/// `ports` is what `step` was given.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_count(ports: *const Ports, input: usize) -> usize {
    // SAFETY: the caller keeps the contract above.
    let input = unsafe { raw(ports) }.and_then(|ports| ports.input(input));
    input.map_or(0, |input| input.samples().len())
}

/// One of the samples that [`fss_count`] counts, the oldest first.
///
/// # Safety
/// `ports` is what `step` was given.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_sample(ports: *const Ports, input: usize, place: usize) -> *const c_void {
    // SAFETY: the caller keeps the contract above.
    let input = unsafe { raw(ports) }.and_then(|ports| ports.input(input));
    let sample = input.and_then(|input| input.samples().nth(place));
    sample.map_or(ptr::null(), |sample| sample.as_ptr().cast())
}

/// The text at a place of the options.
///
/// # Safety
/// `ports` is what `create` was given, `path` a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_option_text(ports: *const Ports, path: *const c_char) -> *const c_char {
    // SAFETY: the caller keeps the contract above; null pointers are looked for.
    let (ports, path) = unsafe { (ports.as_ref(), text(path)) };
    let text = ports.zip(path).and_then(|(ports, path)| ports.options.text(&path));
    text.map_or(ptr::null(), CStr::as_ptr)
}

/// The number at a place of the options.
///
/// # Safety
/// `ports` is what `create` was given, `path` a string, `value` a place for a number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_option_number(ports: *const Ports, path: *const c_char, value: *mut f64) -> c_int {
    // SAFETY: the caller keeps the contract above; null pointers are looked for.
    let (ports, path, value) = unsafe { (ports.as_ref(), text(path), value.as_mut()) };
    let number = ports.zip(path).and_then(|(ports, path)| ports.options.number(&path));
    match (number, value) {
        (Some(number), Some(value)) => {
            *value = number;
            0
        }
        _ => -1,
    }
}

/// All options, as JSON.
///
/// # Safety
/// `ports` is what `create` was given.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_options(ports: *const Ports) -> *const c_char {
    // SAFETY: the caller keeps the contract above.
    unsafe { ports.as_ref() }.map_or(ptr::null(), |ports| ports.options.json().as_ptr())
}

/// Publishes a sample.
///
/// # Safety
/// `ports` is what `step` was given; `sample` points to a struct of the output's message.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_publish(ports: *mut Ports, output: usize, sample: *const c_void) -> c_int {
    // SAFETY: the caller keeps the contract above.
    let size = unsafe { ports.as_ref() }.and_then(|ports| ports.output_sizes.get(output).copied());
    let (Some(size), false) = (size, sample.is_null()) else { return -1 };
    // SAFETY: the struct has the size that was declared for the output, and checked against its definition.
    let bytes = unsafe { std::slice::from_raw_parts(sample.cast::<u8>(), size) };
    // SAFETY: the caller keeps the contract above.
    let is_published = unsafe { raw(ports) }.is_some_and(|raw| raw.publish(output, bytes));
    // SAFETY: as above.
    if is_published && unsafe { own_loop::send(ports) } { 0 } else { -1 }
}

/// Says that something happened.
///
/// # Safety
/// `ports` is what `step` was given, `text` a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fss_event(ports: *mut Ports, severity: u8, text: *const c_char) {
    if text.is_null() {
        return;
    }
    // SAFETY: the caller keeps the contract above.
    let (raw, text) = unsafe { (raw(ports), CStr::from_ptr(text)) };
    if let (Some(raw), Ok(text)) = (raw, text.to_str()) {
        raw.event(severity, text);
        // SAFETY: as above. An event that cannot be sent is lost, as in a step.
        let _sent = unsafe { own_loop::send(ports) };
    }
}
