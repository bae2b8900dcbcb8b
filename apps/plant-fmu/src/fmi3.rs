//! The functions of FMI 3.0. This FMU has no states to store, no derivatives, no clocks and no binaries.
#![allow(unsafe_code, non_snake_case, unreachable_pub)] // C functions by the standard's names: each use says why it holds

use crate::Instance;
use crate::abi::{ERROR, code, get, open, own, refused, set};
use std::ffi::{c_char, c_int, c_void};

/// The version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// # Safety
/// `resources` is a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    _name: *const c_char,
    _token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    _event_mode: bool,
    _early_return: bool,
    _intermediate: *const u32,
    _intermediate_count: usize,
    _environment: *mut c_void,
    _log: *const c_void,
    _update: *const c_void,
) -> *mut c_void {
    // SAFETY: the standard says that it is a string.
    unsafe { open(resources) }
}

/// This FMU is for co-simulation only.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateModelExchange() -> *mut c_void {
    std::ptr::null_mut()
}

/// This FMU is for co-simulation only.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateScheduledExecution() -> *mut c_void {
    std::ptr::null_mut()
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(instance: *mut c_void) {
    if !instance.is_null() {
        // SAFETY: it was made by `open`, and is not used after this.
        drop(unsafe { Box::from_raw(instance.cast::<Instance>()) });
    }
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetDebugLogging(
    instance: *mut c_void,
    _on: bool,
    _count: usize,
    _categories: *const c_void,
) -> c_int {
    code(!instance.is_null())
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterInitializationMode(
    instance: *mut c_void,
    _has_tolerance: bool,
    _tolerance: f64,
    _start_s: f64,
    _has_stop: bool,
    _stop_s: f64,
) -> c_int {
    code(!instance.is_null())
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Terminate(instance: *mut c_void) -> c_int {
    code(!instance.is_null())
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3ExitInitializationMode(instance: *mut c_void) -> c_int {
    // SAFETY: the caller keeps the contract above.
    code(unsafe { own(instance) }.is_some_and(|own| {
        own.begin();
        true
    }))
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Reset(instance: *mut c_void) -> c_int {
    // SAFETY: the caller keeps the contract above.
    code(unsafe { own(instance) }.is_some_and(|own| {
        own.reset();
        true
    }))
}

/// # Safety
/// As the standard has it: `instance` is what the instantiate function gave.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DoStep(
    instance: *mut c_void,
    t_s: f64,
    h_s: f64,
    _no_state: bool,
    event: *mut bool,
    terminate: *mut bool,
    early: *mut bool,
    last_s: *mut f64,
) -> c_int {
    // SAFETY: the caller keeps the contract above; each answer has its place, or is not wanted.
    unsafe {
        for answer in [event, terminate, early] {
            if let Some(answer) = answer.as_mut() {
                *answer = false;
            }
        }
        if let Some(last_s) = last_s.as_mut() {
            *last_s = t_s + h_s;
        }
        code(own(instance).is_some_and(|own| own.step(h_s)))
    }
}

/// # Safety
/// As [`get`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFloat64(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *mut f64,
    value_count: usize,
) -> c_int {
    // SAFETY: the caller keeps the contract above.
    if count == value_count { unsafe { get(instance, references, count, values) } } else { ERROR }
}

/// # Safety
/// As [`set`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFloat64(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *const f64,
    value_count: usize,
) -> c_int {
    // SAFETY: the caller keeps the contract above.
    if count == value_count { unsafe { set(instance, references, count, values) } } else { ERROR }
}

refused!(
    fmi3GetFloat32 fmi3GetInt8 fmi3GetUInt8 fmi3GetInt16 fmi3GetUInt16 fmi3GetInt32 fmi3GetUInt32 fmi3GetInt64
    fmi3GetUInt64 fmi3GetBoolean fmi3GetString fmi3GetBinary fmi3GetClock fmi3SetFloat32 fmi3SetInt8 fmi3SetUInt8
    fmi3SetInt16 fmi3SetUInt16 fmi3SetInt32 fmi3SetUInt32 fmi3SetInt64 fmi3SetUInt64 fmi3SetBoolean fmi3SetString
    fmi3SetBinary fmi3SetClock fmi3EnterEventMode fmi3GetNumberOfVariableDependencies fmi3GetVariableDependencies
    fmi3GetFMUState fmi3SetFMUState fmi3FreeFMUState fmi3SerializedFMUStateSize fmi3SerializeFMUState
    fmi3DeserializeFMUState fmi3GetDirectionalDerivative fmi3GetAdjointDerivative fmi3EnterConfigurationMode
    fmi3ExitConfigurationMode fmi3GetIntervalDecimal fmi3GetIntervalFraction fmi3GetShiftDecimal fmi3GetShiftFraction
    fmi3SetIntervalDecimal fmi3SetIntervalFraction fmi3SetShiftDecimal fmi3SetShiftFraction fmi3EvaluateDiscreteStates
    fmi3UpdateDiscreteStates fmi3EnterContinuousTimeMode fmi3CompletedIntegratorStep fmi3SetTime fmi3SetContinuousStates
    fmi3GetContinuousStateDerivatives fmi3GetEventIndicators fmi3GetContinuousStates fmi3GetNominalsOfContinuousStates
    fmi3GetNumberOfEventIndicators fmi3GetNumberOfContinuousStates fmi3EnterStepMode fmi3GetOutputDerivatives
    fmi3ActivateModelPartition
);
