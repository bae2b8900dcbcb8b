//! The functions of FMI 2.0. This FMU has no states to store, no derivatives, no clocks and no binaries.
#![allow(unsafe_code, non_snake_case, unreachable_pub)] // C functions by the standard's names: each use says why it holds

use crate::Instance;
use crate::abi::{code, get, open, own, refused, set};
use std::ffi::{c_char, c_int, c_void};

/// The version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

/// The platform's types.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

/// # Safety
/// `resources` is a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Instantiate(
    _name: *const c_char,
    kind: c_int,
    _guid: *const c_char,
    resources: *const c_char,
    _callbacks: *const c_void,
    _visible: c_int,
    _logging: c_int,
) -> *mut c_void {
    // 1 is co-simulation.
    // SAFETY: the standard says that it is a string.
    if kind == 1 { unsafe { open(resources) } } else { std::ptr::null_mut() }
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeInstance(instance: *mut c_void) {
    if !instance.is_null() {
        // SAFETY: it was made by `open`, and is not used after this.
        drop(unsafe { Box::from_raw(instance.cast::<Instance>()) });
    }
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetDebugLogging(
    instance: *mut c_void,
    _on: c_int,
    _count: usize,
    _categories: *const c_void,
) -> c_int {
    code(!instance.is_null())
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetupExperiment(
    instance: *mut c_void,
    _has_tolerance: c_int,
    _tolerance: f64,
    _start_s: f64,
    _has_stop: c_int,
    _stop_s: f64,
) -> c_int {
    code(!instance.is_null())
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2EnterInitializationMode(instance: *mut c_void) -> c_int {
    code(!instance.is_null())
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Terminate(instance: *mut c_void) -> c_int {
    code(!instance.is_null())
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2ExitInitializationMode(instance: *mut c_void) -> c_int {
    // SAFETY: the caller keeps the contract above.
    code(unsafe { own(instance) }.is_some_and(|own| {
        own.begin();
        true
    }))
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Reset(instance: *mut c_void) -> c_int {
    // SAFETY: the caller keeps the contract above.
    code(unsafe { own(instance) }.is_some_and(|own| {
        own.reset();
        true
    }))
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2DoStep(instance: *mut c_void, _t_s: f64, h_s: f64, _no_state: c_int) -> c_int {
    // SAFETY: the caller keeps the contract above.
    code(unsafe { own(instance) }.is_some_and(|own| own.step(h_s)))
}

/// # Safety
/// As [`get`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetReal(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *mut f64,
) -> c_int {
    // SAFETY: the caller keeps the contract above.
    unsafe { get(instance, references, count, values) }
}

/// # Safety
/// As [`set`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetReal(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *const f64,
) -> c_int {
    // SAFETY: the caller keeps the contract above.
    unsafe { set(instance, references, count, values) }
}

refused!(
    fmi2GetInteger fmi2GetBoolean fmi2GetString fmi2SetInteger fmi2SetBoolean fmi2SetString fmi2GetFMUstate fmi2SetFMUstate
    fmi2FreeFMUstate fmi2SerializedFMUstateSize fmi2SerializeFMUstate fmi2DeSerializeFMUstate fmi2GetDirectionalDerivative
    fmi2SetRealInputDerivatives fmi2GetRealOutputDerivatives fmi2CancelStep fmi2GetStatus fmi2GetRealStatus
    fmi2GetIntegerStatus fmi2GetBooleanStatus fmi2GetStringStatus
);
