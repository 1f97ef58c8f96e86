//! Filters (denoisers), which make images from films.

mod filled;

pub use filled::filled;

pub use crate::memory::{FilterMemory, ImagePlanes};

use crate::{Error, Film, Frame, Needs, film::Recorder, macros::forward};
use std::fmt;
use std::sync::Arc;

/// An image that a filter (denoiser) made from a film.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub struct Filtered {
    /// Width and height of the frame's rendered window, in pixels.
    pub size: [u32; 2],
    /// Linear RGB radiance, row by row from the top.
    pub radiance: Vec<[f32; 3]>,
    /// The estimated squared error of each pixel (mean over the channels), if the filter estimates one.
    pub error: Option<Vec<f32>>,
    /// The fireflies that the filter handles separately: pixels that get most of their light from a few samples.
    pub fireflies: Fireflies,
}

/// Fireflies in a filtered image: the number of pixels, and their excess light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fireflies {
    /// The number of pixels that are fireflies.
    pub pixels: u64,
    /// The luminance by which fireflies exceed their surroundings, summed over all fireflies.
    pub light: f64,
    /// `true` if this excess light is left out of the image; `false` if it stays in the pixels that are fireflies.
    pub dropped: bool,
}

impl fmt::Display for Fireflies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pixels, light, dropped } = *self;
        let place = if dropped { "is left out of the image" } else { "stays in these pixels" };
        write!(
            f,
            "fireflies in {pixels} pixel{}: their excess luminance, {light:.3e} in total, {place}",
            if pixels == 1 { "" } else { "s" }
        )
    }
}

impl Filtered {
    /// An image of width and height `size` with these pixels, without error estimates.
    pub fn new(size: [u32; 2], radiance: Vec<[f32; 3]>) -> Self {
        Self { size, radiance, error: None, fireflies: Fireflies::default() }
    }

    /// Sets the estimated squared error of each pixel, or removes it (`None`).
    #[must_use]
    pub fn with_error(self, error: impl Into<Option<Vec<f32>>>) -> Self {
        Self { error: error.into(), ..self }
    }
}

/// A filter (the denoiser; not the pixel filter): turns a film into an image, and may estimate the error of each pixel.
///
/// Filters read the film's per-pixel statistics. Implementations must pass `dapple_conformance::filter`.
///
/// ```
/// use dapple_core::{Error, Film, Filter, Filtered, Frame, Needs, Unfiltered};
///
/// /// Shows which share of the samples each pixel got.
/// struct Density;
///
/// impl Filter for Density {
///     fn name(&self) -> &str {
///         "density"
///     }
///
///     fn apply(&self, film: &Film) -> Result<Filtered, Error> {
///         let all = film.record().samples.max(1) as f32;
///         let radiance = film.counts().iter().map(|&n| [n as f32 / all; 3]).collect();
///         Ok(Filtered::new(film.frame().size(), radiance))
///     }
/// }
///
/// let mut film = Film::new(Frame::new(2, 1)?, Needs::none());
/// (0..3).for_each(|_| film.push(0, 0, [0.5; 3]));
/// film.push(1, 0, [0.25; 3]);
/// assert_eq!(Density.apply(&film)?.radiance, [[0.75; 3], [0.25; 3]]);
/// assert_eq!(Unfiltered.apply(&film)?.radiance, [[0.5; 3], [0.25; 3]]);
/// # Ok::<(), Error>(())
/// ```
pub trait Filter: Send + Sync {
    /// The filter's short name on the command line.
    fn name(&self) -> &str;

    /// The filter's name and every parameter, for headers and reports.
    fn describe(&self) -> String {
        self.name().to_owned()
    }

    /// The statistics that the filter reads from the film.
    fn needs(&self) -> Needs {
        Needs::none()
    }

    /// The recorders of statistics that this filter alone reads from the film.
    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        Vec::new()
    }

    /// The memory in bytes that [`Filter::apply`] takes for a film of this frame with these `needs`. The default assumes
    /// a filter that holds only its image and an error per pixel.
    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let _ = needs;
        FilterMemory::new(frame, 0, ImagePlanes::RadianceAndError)
    }

    /// The number of passes that [`Filter::apply`] makes over a film with these `needs` and `spp` samples per pixel.
    /// Under a time limit, the filter is timed on few samples; the reserved time grows in proportion to the passes.
    fn runs(&self, needs: &Needs, spp: f64) -> u32 {
        let _ = (needs, spp);
        1
    }

    /// Makes the filtered image. Pixels without samples are black.
    ///
    /// # Errors
    ///
    /// If the film lacks statistics that the filter reads.
    fn apply(&self, film: &Film) -> Result<Filtered, Error>;
}

forward!(Filter for &T, Box<T>, Arc<T>; {
    ref name() -> &str;
    ref describe() -> String;
    ref needs() -> Needs;
    ref recorders() -> Vec<Arc<dyn Recorder>>;
    ref memory(frame: &Frame, needs: &Needs) -> FilterMemory;
    ref runs(needs: &Needs, spp: f64) -> u32;
    ref apply(film: &Film) -> Result<Filtered, Error>;
});

/// The identity filter: each pixel is the mean of its own samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unfiltered;

impl Filter for Unfiltered {
    fn name(&self) -> &str {
        "none"
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let planes = if needs.halves { ImagePlanes::RadianceAndError } else { ImagePlanes::Radiance };
        FilterMemory::new(frame, 0, planes)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        Ok(Filtered::new(film.frame().size(), film.image()).with_error(film.squared_errors()))
    }
}
