//! From samples to an image.

use crate::{Error, Film, FilterMemory, Frame, Needs};

/// An image made from a film.
#[derive(Clone, Debug, PartialEq)]
pub struct Filtered {
    /// Width and height of the frame's window.
    pub size: [u32; 2],
    /// Linear RGB radiance, row by row from the top.
    pub radiance: Vec<[f32; 3]>,
    /// The estimated squared error of each pixel (mean over the channels), where the filter knows it.
    pub error: Option<Vec<f32>>,
}

/// Makes an image, and an estimate of its error per pixel, from a film.
///
/// Each estimate belongs to one pixel: filters act on per-pixel means, with weights integrated over
/// the pixel, so that unequal sample counts do not move edges. Implementations must pass
/// `dapple_conformance::filter`.
pub trait Filter: Send + Sync {
    /// Its short name, as the command line knows it.
    fn name(&self) -> &str;

    /// The name and every parameter, for headers and reports.
    fn describe(&self) -> String {
        self.name().to_owned()
    }

    /// What it reads of the samples.
    fn needs(&self) -> Needs {
        Needs::none()
    }

    /// The memory that [`Filter::apply`] takes for a film of this frame with these needs. The default is that of a filter
    /// that holds its image only, with an error; one that works on planes of its own says more.
    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let _ = needs;
        FilterMemory::new(frame, 0, true)
    }

    /// Makes the image. Pixels without samples are black.
    ///
    /// # Errors
    ///
    /// When the film lacks what the filter reads.
    fn apply(&self, film: &Film) -> Result<Filtered, Error>;
}

/// No filter: each pixel is the mean of its own samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unfiltered;

impl Filter for Unfiltered {
    fn name(&self) -> &str {
        "none"
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        FilterMemory::new(frame, 0, needs.halves)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        Ok(Filtered { size: film.frame().size(), radiance: film.image(), error: film.squared_errors() })
    }
}
