//! The shared library: found and loaded at run time, and called through its C interface.
//!
//! All `unsafe` code of the crate is in this file. Types and signatures follow `oidn.h` of OIDN 2. The calls rely on
//! these facts:
//!
//! * The signatures hold for every version 2. [`Library::open`] refuses other versions.
//! * A loaded library is never unloaded, so its functions live as long as the process.
//! * Devices and filters are freed exactly once, by the `Drop` of [`Handle`].
//! * Images are shared with OIDN only within [`Library::denoise`], which borrows them until the filter is freed.
#![allow(unsafe_code, reason = "a C library is called")]

use crate::{LoadError, RunError};
use std::error::Error as _;
use std::ffi::{CStr, OsStr, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::ptr::{self, NonNull};
use std::sync::OnceLock;

/// The environment variable with the path of the library, or of a folder that holds it.
pub const VARIABLE: &str = "DAPPLE_OIDN";

/// File names of the library, the preferred one first.
const NAMES: &[&str] = if cfg!(windows) {
    &["OpenImageDenoise.dll"]
} else if cfg!(target_vendor = "apple") {
    &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib"]
} else {
    &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so"]
};

const MAJOR: c_int = 2;
const DEVICE_CPU: c_int = 1;
const FORMAT_FLOAT3: c_int = 3;
const QUALITY_HIGH: c_int = 6;
/// The memory in MiB above which OIDN cuts the image into overlapping tiles. It is fixed, so that neither the image nor
/// the memory forecast depends on the machine's memory. Images above about 5 million pixels are cut.
pub(crate) const MEMORY_LIMIT_MB: u64 = 3000;
/// The code of "no error".
const NO_ERROR: c_int = 0;

/// `OIDNDevice` and `OIDNFilter`: pointers to opaque types of the library.
type Raw = *mut c_void;

/// Declares the table of C functions, and loads each by its name.
macro_rules! functions {
    ($($field:ident = $name:literal: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions of the C interface.
        struct Functions {
            $($field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            /// Looks up all functions; fails with the name of the first that is missing.
            fn of(library: &libloading::Library) -> Result<Self, &'static str> {
                Ok(Self {
                    $($field: {
                        // SAFETY: the type is the signature of the function of this name in oidn.h of version 2. A
                        // function of an older version has another name, and `Library::open` refuses newer ones before
                        // any call that depends on the signature.
                        let found = unsafe {
                            library.get::<unsafe extern "C" fn($($argument),*) $(-> $result)?>($name.as_bytes())
                        };
                        *found.map_err(|_| $name)?
                    },)*
                })
            }
        }
    };
}

functions! {
    new_device = "oidnNewDevice": fn(c_int) -> Raw;
    set_device_bool = "oidnSetDeviceBool": fn(Raw, *const c_char, bool);
    set_device_int = "oidnSetDeviceInt": fn(Raw, *const c_char, c_int);
    get_device_int = "oidnGetDeviceInt": fn(Raw, *const c_char) -> c_int;
    get_device_error = "oidnGetDeviceError": fn(Raw, *mut *const c_char) -> c_int;
    commit_device = "oidnCommitDevice": fn(Raw);
    release_device = "oidnReleaseDevice": fn(Raw);
    new_filter = "oidnNewFilter": fn(Raw, *const c_char) -> Raw;
    set_shared_image = "oidnSetSharedFilterImage":
        fn(Raw, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    set_filter_bool = "oidnSetFilterBool": fn(Raw, *const c_char, bool);
    set_filter_int = "oidnSetFilterInt": fn(Raw, *const c_char, c_int);
    commit_filter = "oidnCommitFilter": fn(Raw);
    execute_filter = "oidnExecuteFilter": fn(Raw);
    release_filter = "oidnReleaseFilter": fn(Raw);
}

/// The loaded library. It stays loaded until the process ends.
pub struct Library {
    functions: Functions,
    name: String,
    /// Minor version and patch.
    version: [c_int; 2],
}

impl Library {
    /// Loads the library that [`VARIABLE`] names. Without the variable, searches the system's library path. Then, for each
    /// folder `DIR` of `PATH` and for `~/.local/bin`, searches `DIR/../lib` and the folders into which pip installs `pyoidn`.
    /// The first call determines the result of all later calls.
    ///
    /// # Errors
    ///
    /// [`LoadError`], with the ways to install the library and the variable to set.
    pub fn load() -> Result<&'static Self, LoadError> {
        static LOADED: OnceLock<Result<Library, LoadError>> = OnceLock::new();
        let loaded = LOADED.get_or_init(|| {
            let programs = std::env::var_os("PATH").unwrap_or_default();
            let home = std::env::home_dir().map(|home| home.join(".local/bin"));
            let programs = std::env::split_paths(&programs).chain(home).collect::<Vec<_>>();
            Self::search(std::env::var_os(VARIABLE).as_deref(), &programs)
        });
        loaded.as_ref().map_err(LoadError::clone)
    }

    /// Loads the library from the path `named` (a file or a folder). If `named` is `None` or empty, searches the system's
    /// path, then the folders that belong to `programs`.
    pub(crate) fn search(named: Option<&OsStr>, programs: &[PathBuf]) -> Result<Self, LoadError> {
        if let Some(path) = named.filter(|path| !path.is_empty()) {
            let path = Path::new(path);
            return Self::open(&in_folder(path))?.map_err(|why| LoadError::NotLoaded { path: path.to_owned(), why });
        }
        let beside = programs.iter().flat_map(|folder| beside(folder)).map(|folder| in_folder(&folder));
        let names = NAMES.iter().map(PathBuf::from).chain(beside.filter(|path| path.is_file()));
        let (mut missing, mut refused) = (None, None);
        for path in names {
            match Self::open(&path) {
                Ok(Ok(library)) => return Ok(library),
                Ok(Err(why)) => missing = missing.or(Some(why)),
                // It may be an older version; another may lie elsewhere.
                Err(error) => refused = refused.or(Some(error)),
            }
        }
        let not_found = || LoadError::NotFound { names: NAMES.join(" or "), why: missing.unwrap_or_default() };
        Err(refused.unwrap_or_else(not_found))
    }

    /// Loads the library at `path`, and checks its functions, version and CPU device. The inner error is the system's
    /// message if the file is missing or not a library.
    fn open(path: &Path) -> Result<Result<Self, String>, LoadError> {
        // SAFETY: loading runs the library's initialisers. The file is named by the user or installed in the system, and
        // trusted like any other library of the process; those of OIDN have no preconditions.
        let loaded = unsafe { libloading::Library::new(path) };
        let loaded = match loaded {
            Ok(loaded) => loaded,
            // The system's message is the source; the error itself only names the failed call.
            Err(e) => return Ok(Err(e.source().unwrap_or(&e).to_string())),
        };
        let name = path.display().to_string();
        let functions = match Functions::of(&loaded) {
            Ok(functions) => functions,
            Err(function) => return Err(LoadError::Lacks { library: name, function }),
        };
        // Never unloaded: the functions above, and threads that the library starts, stay valid.
        std::mem::forget(loaded);
        let mut library = Self { functions, name, version: [0; 2] };
        library.version = library.check()?;
        Ok(Ok(library))
    }

    /// Checks that the version is 2, and that a device can be made; returns the minor version and the patch.
    fn check(&self) -> Result<[c_int; 2], LoadError> {
        let no_device = |why: String| LoadError::NoDevice { library: self.name.clone(), why };
        let device = Device::new(self).map_err(no_device)?;
        let version = device.get(c"versionMajor");
        if version != MAJOR {
            return Err(LoadError::Version { library: self.name.clone(), version });
        }
        device.commit(1).map_err(no_device)?;
        Ok([device.get(c"versionMinor"), device.get(c"versionPatch")])
    }

    /// Runs OIDN's ray tracing filter ("RT") at its highest quality, on `threads` threads.
    pub(crate) fn denoise(&self, images: &mut Images<'_>, threads: usize) -> Result<(), RunError> {
        images.check()?;
        let device = Device::new(self).map_err(RunError::Reported)?;
        device.commit(threads).map_err(RunError::Reported)?;
        let filter = Filter::new(&device)?;
        for (name, values) in &images.inputs {
            // SAFETY: `check` has found as many values as `set` requires. They are borrowed until this function ends,
            // after `filter` is freed, and OIDN only reads images with these names.
            unsafe { filter.set(name, values.as_ptr().cast_mut(), images.size) };
        }
        // SAFETY: as above. The output is borrowed mutably until this function ends, so that nothing else reads or writes
        // it while OIDN writes.
        unsafe { filter.set(c"output", images.output.as_mut_ptr(), images.size) };
        filter.switch(c"hdr", images.hdr);
        filter.switch(c"cleanAux", images.clean);
        filter.execute(&device)
    }
}

/// Name or path, and version.
impl std::fmt::Display for Library {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, version {MAJOR}.{}.{}", self.name, self.version[0], self.version[1])
    }
}

impl std::fmt::Debug for Library {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Library({})", self.name)
    }
}

/// The path of the library in the folder `path` or its `lib`; `path` itself if it is not a folder, or lacks the library.
fn in_folder(path: &Path) -> PathBuf {
    let folders = [path.to_owned(), path.join("lib")];
    let files = NAMES.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    files.into_iter().find(|file| file.is_file()).unwrap_or_else(|| path.to_owned())
}

/// Folders that may contain the library if programs are in `folder`: the `lib` beside it, and `pyoidn` in the packages of
/// its Python.
fn beside(folder: &Path) -> Vec<PathBuf> {
    let Some(root) = folder.parent() else { return Vec::new() };
    let pythons = std::fs::read_dir(root.join("lib")).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut pythons: Vec<_> = pythons
        .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("python3")))
        .collect();
    pythons.sort();
    pythons.push(root.join("Lib"));
    let packages = ["site-packages", "dist-packages"].map(|packages| Path::new(packages).join("pyoidn/oidn"));
    let packages = pythons.iter().flat_map(|python| packages.each_ref().map(|packages| python.join(packages)));
    std::iter::once(root.join("lib")).chain(packages).collect()
}

/// Images of one run: three floats per pixel, row by row.
pub(crate) struct Images<'a> {
    /// Width and height in pixels.
    pub(crate) size: [usize; 2],
    /// OIDN's name of each input, and its values.
    pub(crate) inputs: Vec<(&'static CStr, &'a [f32])>,
    /// The denoised image.
    pub(crate) output: &'a mut [f32],
    /// `true` if the main input is radiance, whose values may exceed 1.
    pub(crate) hdr: bool,
    /// `true` if albedo and normals are free of noise.
    pub(crate) clean: bool,
}

impl Images<'_> {
    /// Checks that every image has three values per pixel.
    fn check(&self) -> Result<(), RunError> {
        let expected = 3 * self.size[0] * self.size[1];
        let inputs = self.inputs.iter().map(|(name, values)| (name.to_str().unwrap_or("input"), values.len()));
        match inputs.chain([("output", self.output.len())]).find(|(_, found)| *found != expected) {
            Some((name, found)) => Err(RunError::Size { name, found, expected }),
            None => Ok(()),
        }
    }
}

/// An object of the library, which is freed when this value is dropped.
struct Handle<'l> {
    library: &'l Functions,
    raw: NonNull<c_void>,
    release: unsafe extern "C" fn(Raw),
}

impl Drop for Handle<'_> {
    fn drop(&mut self) {
        // SAFETY: the object is alive, `release` is the function for its kind, and nobody uses it later: filters borrow
        // their device.
        unsafe { (self.release)(self.raw.as_ptr()) };
    }
}

/// A device of the library.
struct Device<'l>(Handle<'l>);

impl<'l> Device<'l> {
    /// Makes a CPU device, or returns the library's message.
    fn new(library: &'l Library) -> Result<Self, String> {
        let functions = &library.functions;
        // SAFETY: the function takes any number for the type of device.
        let raw = unsafe { (functions.new_device)(DEVICE_CPU) };
        match NonNull::new(raw) {
            Some(raw) => Ok(Self(Handle { library: functions, raw, release: functions.release_device })),
            // Without a device, the error is that of the thread.
            None => Err(error(functions, ptr::null_mut()).unwrap_or_else(|| "no device could be created".into())),
        }
    }

    /// Prepares the device for `threads` threads, which are not bound to cores.
    fn commit(&self, threads: usize) -> Result<(), String> {
        let threads = c_int::try_from(threads).unwrap_or(c_int::MAX);
        // SAFETY: the device is alive, and the name ends with a zero byte.
        unsafe { (self.0.library.set_device_int)(self.0.raw.as_ptr(), c"numThreads".as_ptr(), threads) };
        // SAFETY: as above.
        unsafe { (self.0.library.set_device_bool)(self.0.raw.as_ptr(), c"setAffinity".as_ptr(), false) };
        // SAFETY: the device is alive.
        unsafe { (self.0.library.commit_device)(self.0.raw.as_ptr()) };
        self.error().map_or(Ok(()), Err)
    }

    /// The number that the device holds under `name`.
    fn get(&self, name: &CStr) -> c_int {
        // SAFETY: the device is alive, and the name ends with a zero byte.
        unsafe { (self.0.library.get_device_int)(self.0.raw.as_ptr(), name.as_ptr()) }
    }

    /// The first error since the last call, if any.
    fn error(&self) -> Option<String> {
        error(self.0.library, self.0.raw.as_ptr())
    }
}

/// The first error of the device since the last call. With a null pointer, the calling thread's error.
fn error(library: &Functions, device: Raw) -> Option<String> {
    let mut message: *const c_char = ptr::null();
    // SAFETY: the device is alive or null, which the function allows; `message` is a place for one pointer.
    let code = unsafe { (library.get_device_error)(device, &raw mut message) };
    if code == NO_ERROR {
        return None;
    }
    if message.is_null() {
        return Some(format!("error {code}"));
    }
    // SAFETY: the library has written a pointer to text that ends with a zero byte and lives until the next call. The text
    // is copied here.
    let text = unsafe { CStr::from_ptr(message) };
    Some(text.to_string_lossy().into_owned())
}

/// A filter of the library.
struct Filter<'d>(Handle<'d>);

impl<'d> Filter<'d> {
    /// Makes a ray tracing filter of high quality.
    fn new(device: &'d Device<'_>) -> Result<Self, RunError> {
        let library = device.0.library;
        // SAFETY: the device is alive, and the name ends with a zero byte.
        let raw = unsafe { (library.new_filter)(device.0.raw.as_ptr(), c"RT".as_ptr()) };
        let Some(raw) = NonNull::new(raw) else {
            return Err(RunError::Reported(device.error().unwrap_or_else(|| "no filter could be created".into())));
        };
        let filter = Self(Handle { library, raw, release: library.release_filter });
        filter.number(c"quality", QUALITY_HIGH);
        filter.number(c"maxMemoryMB", MEMORY_LIMIT_MB as c_int);
        Ok(filter)
    }

    /// Shares an image of three floats per pixel with the filter.
    ///
    /// # Safety
    ///
    /// `values` points to `3 * size[0] * size[1]` floats that live until the filter is freed. If the name is "output",
    /// nothing else may use them until then; otherwise nothing may write them.
    unsafe fn set(&self, name: &CStr, values: *mut f32, [width, height]: [usize; 2]) {
        let (raw, values) = (self.0.raw.as_ptr(), values.cast());
        // SAFETY: the filter is alive, the name ends with a zero byte, and the caller answers for the values. Strides of 0
        // mean that pixels and rows follow one another.
        unsafe { (self.0.library.set_shared_image)(raw, name.as_ptr(), values, FORMAT_FLOAT3, width, height, 0, 0, 0) };
    }

    /// Sets a number of the filter.
    fn number(&self, name: &CStr, value: c_int) {
        // SAFETY: the filter is alive, and the name ends with a zero byte.
        unsafe { (self.0.library.set_filter_int)(self.0.raw.as_ptr(), name.as_ptr(), value) };
    }

    /// Turns an option of the filter on or off.
    fn switch(&self, name: &CStr, on: bool) {
        // SAFETY: the filter is alive, and the name ends with a zero byte.
        unsafe { (self.0.library.set_filter_bool)(self.0.raw.as_ptr(), name.as_ptr(), on) };
    }

    /// Runs the filter to its end.
    fn execute(&self, device: &Device<'_>) -> Result<(), RunError> {
        // SAFETY: the filter is alive.
        unsafe { (self.0.library.commit_filter)(self.0.raw.as_ptr()) };
        if let Some(message) = device.error() {
            return Err(RunError::Reported(message));
        }
        // SAFETY: the filter is alive, and so are its images (`set`). The function returns after the last access to them.
        unsafe { (self.0.library.execute_filter)(self.0.raw.as_ptr()) };
        device.error().map_or(Ok(()), |message| Err(RunError::Reported(message)))
    }
}
