//! Errors of loading and running the library.

use crate::VARIABLE;
use std::path::PathBuf;

/// The advice at the end of each error of loading.
const ADVICE: &str = "install Open Image Denoise 2 (`pip install pyoidn`, your system's package, or an archive of \
                      https://www.openimagedenoise.org), and set DAPPLE_OIDN to the path of the library if Dapple \
                      still does not find it";

/// The reason why Open Image Denoise cannot be loaded or used.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LoadError {
    /// No library with one of the searched names.
    #[error("the library {names} was not found: {why}; {ADVICE}")]
    NotFound {
        /// The names, as a list for messages.
        names: String,
        /// The system's message for the first of the names.
        why: String,
    },
    /// A path in `DAPPLE_OIDN` that is not a loadable library.
    #[error("{VARIABLE} = \"{}\" cannot be loaded: {why}; {ADVICE}", path.display())]
    NotLoaded {
        /// The path in `DAPPLE_OIDN`.
        path: PathBuf,
        /// The system's message.
        why: String,
    },
    /// A library that is not OIDN 2.
    #[error("{library} lacks the function {function}; the library is not OIDN or is older than version 2; {ADVICE}")]
    Lacks {
        /// The library's path or name.
        library: String,
        /// The first missing function.
        function: &'static str,
    },
    /// A version other than 2.
    #[error("{library} is version {version} of OIDN, but version 2 is required; {ADVICE}")]
    Version {
        /// The library's path or name.
        library: String,
        /// The library's major version.
        version: i32,
    },
    /// A library without a usable CPU device.
    #[error("{library} cannot run on this processor: {why}; {ADVICE}")]
    NoDevice {
        /// The library's path or name.
        library: String,
        /// The library's message.
        why: String,
    },
}

/// The reason why Open Image Denoise has not denoised an image.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RunError {
    /// An error that the library reports.
    #[error("Open Image Denoise reports: {0}; update Open Image Denoise, or choose another filter")]
    Reported(String),
    /// An image with the wrong number of values; a bug of this crate.
    #[error("the image \"{name}\" has {found} values instead of {expected}; this is a bug in dapple-oidn")]
    Size {
        /// The image's name.
        name: &'static str,
        /// The number of values.
        found: usize,
        /// The required number of values.
        expected: usize,
    },
    /// An output image with NaN or infinity.
    #[error(
        "Open Image Denoise returned NaN or infinite values ({0}); update Open Image Denoise, or choose another filter"
    )]
    NotFinite(usize),
}

impl From<LoadError> for dapple_core::Error {
    fn from(error: LoadError) -> Self {
        Self::Method(Box::new(error))
    }
}
