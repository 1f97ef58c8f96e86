//! Pixels from cosines fitted to the samples of blocks.

use super::cosines::{CosineOptions, Fit, SIDE};
use crate::tree::Cells;
use dapple_core::{
    Domain, Error, Film, FilmPoints, Filter, FilterMemory, Filtered, Frame, ImagePlanes, Needs, Options as _,
};

/// Cosines fitted to the samples of each block of 8x8 pixels [after Bolin and Meyer 1995].
///
/// The fit is by least squares, at the samples' places in the image, so that unequal densities do not move edges. Luminance
/// has half as many cosines as the block has samples, the lowest frequencies first. Red and blue differences from it have
/// half as many as luminance. Large coefficients of high frequencies are penalised by `lambda`. A pixel is the mean of the
/// cosines over its area, and 0 where they are negative.
///
/// It is made for the sampler `dct`, and works on the samples of any sampler: coordinates come from [`FilmPoints`]. Blocks
/// without samples are black. There is no error estimate. Opponent space, penalty and the share of chroma are ours.
///
/// *Bias*: of the frequencies that are left out. *Weaknesses*: blocks show; cosines ring at edges and around lamps.
#[derive(Clone, Debug)]
pub struct DctFilter {
    points: FilmPoints,
    domain: Domain,
    options: CosineOptions,
}

impl DctFilter {
    /// Makes a filter for films with these points.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn new(points: FilmPoints, options: CosineOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        let domain = points.domain().place();
        Ok(Self { points, domain, options })
    }
}

impl Filter for DctFilter {
    fn name(&self) -> &str {
        "dct"
    }

    fn describe(&self) -> String {
        format!("{}:{}", self.name(), self.options.describe())
    }

    fn needs(&self) -> Needs {
        Needs::none().with_samples(u32::MAX)
    }

    fn memory(&self, frame: &Frame, _: &Needs) -> FilterMemory {
        FilterMemory::new(frame, 12, ImagePlanes::Radiance)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let (points, blocks) = (self.points.now(), Cells::new(film.frame(), SIDE));
        Ok(blocks.image(film, &points, &self.domain, |block, image| {
            let Some(fit) = Fit::new(block, &self.options) else { return };
            let width = block.size[0] as usize;
            for (i, pixel) in image.iter_mut().enumerate() {
                *pixel = self.options.scale.radiance(fit.over_pixel([i % width, i / width]));
            }
        }))
    }
}
