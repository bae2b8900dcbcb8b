//! What the functions of both versions have in common.
#![allow(unsafe_code)] // pointers of the importer's: each use says why it holds

use crate::Instance;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::Path;

pub(crate) const OK: c_int = 0;
pub(crate) const ERROR: c_int = 3;

/// # Safety
/// `instance` is null, or what the FMU's instantiate function gave, and nobody else uses it meanwhile.
pub(crate) unsafe fn own<'a>(instance: *mut c_void) -> Option<&'a mut Instance> {
    // SAFETY: the caller says so.
    unsafe { instance.cast::<Instance>().as_mut() }
}

pub(crate) fn code(is_done: bool) -> c_int {
    if is_done { OK } else { ERROR }
}

/// # Safety
/// As [`own`]; `references` and `values` point to `count` elements, or are not looked at where that is 0.
pub(crate) unsafe fn get(instance: *mut c_void, references: *const u32, count: usize, values: *mut f64) -> c_int {
    // SAFETY: the caller says so.
    let Some(own) = (unsafe { own(instance) }) else { return ERROR };
    code((0..count).all(|i| {
        // SAFETY: `i` is less than `count`.
        let found = own.get(unsafe { *references.add(i) });
        found.inspect(|value| unsafe { *values.add(i) = *value }).is_some()
    }))
}

/// # Safety
/// As [`get`].
pub(crate) unsafe fn set(instance: *mut c_void, references: *const u32, count: usize, values: *const f64) -> c_int {
    // SAFETY: the caller says so.
    let Some(own) = (unsafe { own(instance) }) else { return ERROR };
    // SAFETY: `i` is less than `count`.
    code((0..count).all(|i| unsafe { own.set(*references.add(i), *values.add(i)) }))
}

/// # Safety
/// `path` is null or ends with a zero.
#[expect(clippy::print_stderr, reason = "importers show what an FMU says there")]
pub(crate) unsafe fn open(path: *const c_char) -> *mut c_void {
    if path.is_null() {
        return std::ptr::null_mut();
    }
    // SAFETY: the caller says so.
    let text = unsafe { CStr::from_ptr(path) }.to_string_lossy();
    let folder = text.strip_prefix("file://").unwrap_or(&text);
    match Instance::open(Path::new(folder)) {
        Ok(instance) => Box::into_raw(Box::new(instance)).cast(),
        Err(why) => {
            eprintln!("fss plant: {why}");
            std::ptr::null_mut()
        }
    }
}

/// Functions that an FMU does not have: they fail, as the standard wants it.
macro_rules! refused {
    ($($name:ident)*) => {$(
        /// A function that this FMU does not have.
        #[unsafe(no_mangle)]
        pub extern "C" fn $name() -> std::ffi::c_int {
            $crate::abi::ERROR
        }
    )*};
}

pub(crate) use refused;
