//! A stand-in for OIDN, compiled by the tests into a shared library of its own: it checks its inputs and copies them.
//!
//! Reads `--cfg version3`, `--cfg no_device` and `--cfg nan`. Not part of any crate.
#![allow(non_snake_case)]

use std::collections::HashMap;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ptr::null_mut;

#[derive(Default)]
struct Device {
    threads: c_int,
    message: Option<CString>,
    last: Option<CString>,
}

struct Filter {
    device: *mut Device,
    images: HashMap<String, (usize, usize)>,
    switches: HashMap<String, bool>,
    quality: c_int,
    committed: bool,
}

unsafe fn text(name: *const c_char) -> String {
    unsafe { CStr::from_ptr(name) }.to_string_lossy().into_owned()
}

#[unsafe(no_mangle)]
extern "C" fn oidnNewDevice(kind: c_int) -> *mut c_void {
    if cfg!(no_device) || kind != 1 { null_mut() } else { Box::into_raw(Box::<Device>::default()).cast() }
}

#[unsafe(no_mangle)]
extern "C" fn oidnSetDeviceBool(_: *mut c_void, _: *const c_char, _: bool) {}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnSetDeviceInt(device: *mut c_void, name: *const c_char, value: c_int) {
    assert_eq!(unsafe { text(name) }, "numThreads");
    unsafe { (*device.cast::<Device>()).threads = value };
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnGetDeviceInt(_: *mut c_void, name: *const c_char) -> c_int {
    match unsafe { text(name) }.as_str() {
        "versionMajor" => 2 + c_int::from(cfg!(version3)),
        "versionMinor" => 7,
        name => c_int::from(name == "versionPatch"),
    }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnGetDeviceError(device: *mut c_void, out: *mut *const c_char) -> c_int {
    let Some(device) = (unsafe { device.cast::<Device>().as_mut() }) else {
        unsafe { *out = c"no such device".as_ptr() };
        return 1;
    };
    let Some(message) = device.message.take() else { return 0 };
    unsafe { *out = device.last.insert(message).as_ptr() };
    1
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnCommitDevice(device: *mut c_void) {
    let device = unsafe { &mut *device.cast::<Device>() };
    if device.threads < 1 {
        device.message = CString::new("no threads").ok();
    }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnReleaseDevice(device: *mut c_void) {
    drop(unsafe { Box::from_raw(device.cast::<Device>()) });
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnNewFilter(device: *mut c_void, name: *const c_char) -> *mut c_void {
    assert_eq!(unsafe { text(name) }, "RT");
    let (images, switches) = Default::default();
    Box::into_raw(Box::new(Filter { device: device.cast(), images, switches, quality: 0, committed: false })).cast()
}

#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments)]
unsafe extern "C" fn oidnSetSharedFilterImage(
    filter: *mut c_void,
    name: *const c_char,
    data: *mut c_void,
    format: c_int,
    width: usize,
    height: usize,
    offset: usize,
    pixel_stride: usize,
    row_stride: usize,
) {
    assert_eq!((format, offset, pixel_stride, row_stride), (3, 0, 0, 0));
    let filter = unsafe { &mut *filter.cast::<Filter>() };
    filter.images.insert(unsafe { text(name) }, (data as usize, 3 * width * height));
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnSetFilterBool(filter: *mut c_void, name: *const c_char, value: bool) {
    let filter = unsafe { &mut *filter.cast::<Filter>() };
    filter.switches.insert(unsafe { text(name) }, value);
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnSetFilterInt(filter: *mut c_void, name: *const c_char, value: c_int) {
    match unsafe { text(name) }.as_str() {
        "quality" => unsafe { (*filter.cast::<Filter>()).quality = value },
        name => assert_eq!((name, value), ("maxMemoryMB", 3000)),
    }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnCommitFilter(filter: *mut c_void) {
    unsafe { (*filter.cast::<Filter>()).committed = true };
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnExecuteFilter(filter: *mut c_void) {
    let filter = unsafe { &*filter.cast::<Filter>() };
    let input = |name: &str| {
        let &(data, length) = filter.images.get(name)?;
        Some(unsafe { std::slice::from_raw_parts(data as *const f32, length) })
    };
    let within = |name: &str, least: f32| input(name).is_none_or(|v| v.iter().all(|v| (least..=1.0).contains(v)));
    let hdr = filter.switches["hdr"];
    let fail = |what: &str| unsafe { (*filter.device).message = CString::new(what).ok() };
    let main = if hdr { input("color") } else { input("albedo").or(input("normal")) };
    match main {
        _ if !filter.committed || filter.quality != 6 => fail("not prepared"),
        _ if !(within("albedo", 0.0) && within("normal", -1.0)) => fail("features out of range"),
        _ if filter.switches["cleanAux"] && !hdr => fail("guides of a guide"),
        None => fail("no input"),
        Some(main) => {
            let (data, length) = filter.images["output"];
            let output = unsafe { std::slice::from_raw_parts_mut(data as *mut f32, length) };
            output.copy_from_slice(main);
            if cfg!(nan) && hdr {
                output[1] = f32::NAN;
            }
        }
    }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnReleaseFilter(filter: *mut c_void) {
    drop(unsafe { Box::from_raw(filter.cast::<Filter>()) });
}
