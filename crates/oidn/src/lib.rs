//! Intel Open Image Denoise (OIDN), a neural denoiser, as a filter of Dapple.
//!
//! * [`Oidn`]: OIDN on the film's means, guided by albedo and normals of first non-specular surfaces.
//! * [`OidnBlend`]: the plain mean of the images of OIDN and another filter.
//! * [`Library`]: the shared library, loaded at run time. The crate builds without it.
//!
//! ```
//! use dapple_core::{Estimate, Film, Filter, Frame};
//! use dapple_oidn::{Library, Oidn, OidnOptions};
//!
//! let library = match Library::load() {
//!     Ok(library) => library,
//!     Err(missing) => return println!("{missing}"), // names the package and the variable to set
//! };
//! let filter = Oidn::new(library, OidnOptions::default());
//! let mut film = Film::new(Frame::new(32, 32).expect("not empty"), filter.needs());
//! for i in 0..1024 {
//!     film.push_estimate(i, 0, &Estimate::new([if i % 2 == 0 { 0.0 } else { 1.0 }; 3]));
//! }
//! let image = filter.apply(&film).expect("an image");
//! assert!((0.2..0.8).contains(&image.radiance[500][0]));
//! ```
//!
//! # The library
//!
//! OIDN 2 is needed: `pip install pyoidn`, a package of the system, or an archive of <https://www.openimagedenoise.org>.
//! The variable `DAPPLE_OIDN` names the file, or a folder that holds it. Without the variable, `libOpenImageDenoise.so.2`,
//! `libOpenImageDenoise.dylib` or `OpenImageDenoise.dll` is searched for on the system's library path. After that, for each
//! folder in `PATH`, the search covers the `lib` beside it and the place where pip installs `pyoidn`. The library runs on
//! the CPU, on as many threads as rayon's pool.
//!
//! # What OIDN gets
//!
//! * Colour: the mean of all samples of a pixel, as high dynamic range, scaled by a power of two to a mean level of
//!   about 1.
//! * Albedo and normal: means over first non-specular surfaces, multiplied by the fraction of samples that hit. With
//!   `prefilter`, the default, OIDN first denoises each of them in a separate run.
//! * Pixels without samples: the mean of the nearest samples in a window of up to 9x9 pixels, else black.
//! * Images with a side below 32 pixels are mirrored up to that side.
//!
//! The quality is OIDN's highest.
//!
//! # Guarantees
//!
//! * Bit-identical images on any number of threads: measured with OIDN 2.5.1, not promised by OIDN. Other versions and
//!   other processors give different bits.
//! * Light is not clamped. Radiance above 10,000 times the image's mean level (the geometric mean over lit pixels) stays in
//!   its pixel, and OIDN gets the rest. Without this, OIDN doubles a light source of radiance 10^10, and a source of 10^30
//!   makes the whole image black.
//! * An image that is black everywhere stays black.
//!
//! # Limits
//!
//! * No error estimate: [`Filtered::error`](dapple_core::Filtered::error) is `None`, for [`OidnBlend`] as well. OIDN has none,
//!   and the errors of the two filters are not independent.
//! * The image is biased. OIDN treats a single bright pixel as an outlier: a pixel of 1000 in a wall of 0.5 keeps 0.3 % of
//!   its light. A light source of 4x4 pixels keeps its light.
//! * Constant images change by up to 5 %, and by up to a third where a side is below 64 pixels.

mod error;
mod filter;
mod images;
mod library;

#[cfg(test)]
mod tests;

pub use error::{LoadError, RunError};
pub use filter::{Oidn, OidnBlend, OidnOptions};
pub use library::{Library, VARIABLE};

/// Runs the README's example as a documentation test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
