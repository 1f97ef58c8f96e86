//! Pixels from cosines fitted to the samples of blocks.

use super::cosines::{CosineOptions, Fit, SIDE};
use crate::method::{SamplesFilter, SamplesMethod};
use crate::recorders::FilmSamples;
use crate::tree::Cells;
use crate::{Domain, FilmPoints};
use dapple_core::Filtered;

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
pub type DctFilter = SamplesFilter<CosineOptions>;

impl SamplesMethod for CosineOptions {
    const NAME: &'static str = "dct";

    fn dimensions(&self, domain: &Domain) -> Domain {
        domain.place()
    }

    fn image(&self, samples: &FilmSamples<'_>, points: &FilmPoints) -> Filtered {
        Cells::new(samples.film.frame(), SIDE).image(samples, points, |block, image| {
            let Some(fit) = Fit::new(block, self) else { return };
            let width = block.size[0] as usize;
            for (i, pixel) in image.iter_mut().enumerate() {
                *pixel = self.scale.radiance(fit.over_pixel([i % width, i / width]));
            }
        })
    }
}
