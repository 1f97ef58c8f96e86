//! A bank of filters, chosen per pixel by Stein's unbiased risk estimate; and the sampler that follows its error.

mod bank;
mod choice;
mod planes;
mod sampler;

pub use sampler::{Sure, SureOptions};

use choice::choose;
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, ImagePlanes, Needs, Options as _};

dapple_core::options! {
    /// The parameters of [`SureFilter`].
    pub struct SureFilterOptions {
        /// Pixels searched to each side, 0 to 20.
        pub window: usize = 20, |window| window <= 20, "0 to 20 pixels to each side";
        /// Search 5 pixels to each side at most: 14 times fewer pairs of pixels than with 20.
        pub fast: bool = false => "false";
        /// Standard deviation in pixels of the kernel that smooths estimated errors before the best filter is chosen.
        pub smooth: f64 = 4.0 => "4", |sigma| sigma > 0.0 && sigma <= 8.0, "above 0 and at most 8 pixels";
    }
}

/// A bank of cross non-local means filters; each pixel takes the one with the least estimated error [Li 2012].
///
/// The weight of a pixel `q` in the result of pixel `p` is `exp(-D / (2 sigma^2))` times a weight by features. `D` is the
/// mean squared difference between the 5x5 patches around both. The bank has `sigma` 0 (unfiltered) and 0.005, 0.01, … to
/// 0.64. Features are normal, albedo and depth over its maximum, with standard deviations 0.8, 0.25 and 0.6; their squared
/// differences are divided by the sum of both pixels' sample variances, at least 0.01.
///
/// The squared error of a filter is estimated by `(F - y)^2 + 2 v dF/dy - v` for a mean `y` of variance `v` [Stein 1981].
/// It needs no truth and no halves. That of `sigma` 0 is taken as `2 v`. Estimates are smoothed by a cross-bilateral
/// filter over the same features before the best filter is chosen.
///
/// # Differences from the authors' code
///
/// * Errors are estimated on the image itself, not on one blurred by a reconstruction filter.
/// * The derivative counts that patches compare three channels.
/// * Pixels without samples are filled, and pixels of one sample take the variance of 5x5 pixels.
///
/// # Weaknesses
///
/// The estimate assumes Gaussian noise, independent between pixels: under heavy tails, fireflies look exact and stay. Raw
/// estimates are noisy, hence the smoothing. Windows of 41x41 pixels cost as much as tens of samples.
///
/// # Result
///
/// Pixels without samples are filled from their window, or black if the window is empty. [`Filtered::error`] is the
/// smoothed estimate of the chosen filter, at least 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SureFilter {
    options: SureFilterOptions,
}

impl SureFilter {
    /// The filter with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(options: SureFilterOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { options })
    }
}

/// The radius of the search with `fast`.
const FAST: usize = 5;

impl Filter for SureFilter {
    fn name(&self) -> &str {
        "sure"
    }

    fn describe(&self) -> String {
        format!("sure:{}", self.options.describe())
    }

    fn needs(&self) -> Needs {
        planes::NEEDS
    }

    fn memory(&self, frame: &Frame, _: &Needs) -> FilterMemory {
        FilterMemory::new(frame, choice::BYTES, ImagePlanes::RadianceAndError)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let SureFilterOptions { window, fast, smooth } = self.options;
        let radius = if fast { window.min(FAST) } else { window };
        let chosen = choose(film, radius, smooth);
        let error = chosen.iter().map(|pixel| pixel.error.max(0.0) as f32).collect::<Vec<_>>();
        let radiance = chosen.iter().map(|pixel| pixel.radiance).collect();
        Ok(Filtered::new(film.frame().size(), radiance).with_error(error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{Field, frame, run};
    use dapple_core::samplers::Uniform;
    use dapple_core::{Limits, Render, Unfiltered};
    use dapple_low_discrepancy::Random;

    #[test]
    fn the_filter_conforms() {
        dapple_conformance::filter(|| {
            Box::new(SureFilter::with_options(SureFilterOptions::default().fast(true)).unwrap())
        });
    }

    /// Noise of deviation 0.1 about an edge, whose features do not show it.
    fn edge_with_noise() -> Film {
        let mut field = Field(|[x, _]: [u32; 2], u: [f32; 4]| {
            let noise = u.iter().map(|u| u - 0.5).sum::<f32>() * 0.346;
            [if x < 16 { 0.5 } else { 1.0 } + noise; 3]
        });
        let needs = planes::NEEDS;
        let (mut sampler, limits) = (Uniform::new(Random::new(3)), Limits::spp(16.0));
        Render::new(frame(32, 32), &limits).needs(needs).run(&mut field, &mut sampler).unwrap()
    }

    #[test]
    fn the_best_filter_keeps_edges_and_removes_noise() {
        let film = edge_with_noise();
        let squared_error = |image: &Filtered| {
            let each = image.radiance.iter().enumerate();
            each.map(|(i, c)| (c[0] - if i % 32 < 16 { 0.5 } else { 1.0 }).powi(2)).sum::<f32>() / 1024.0
        };
        let filter = SureFilter::with_options(SureFilterOptions::default().window(7)).unwrap();
        let (filtered, raw) = (filter.apply(&film).unwrap(), Unfiltered.apply(&film).unwrap());
        let (error, before) = (squared_error(&filtered), squared_error(&raw));
        assert!(error < 0.1 * before, "{error} of {before}");
        // The reported error is that of the image.
        let reported = filtered.error.unwrap().iter().sum::<f32>() / 1024.0;
        assert!((reported / error - 1.0).abs() < 0.7, "{reported} for {error}");
    }

    #[test]
    fn fast_searches_five_pixels() {
        let of = |options: SureFilterOptions| SureFilter::with_options(options).unwrap();
        let film = edge_with_noise();
        let fast = of(SureFilterOptions::default().fast(true)).apply(&film).unwrap();
        assert_eq!(fast, of(SureFilterOptions::default().window(5)).apply(&film).unwrap());
        assert_ne!(fast, of(SureFilterOptions::default().window(4)).apply(&film).unwrap());
        assert!(SureFilter::with_options(SureFilterOptions::default().window(21)).is_err());
        let unused =
            run(&mut Field(|_, _| [0.0; 3]), &mut Uniform::new(Random::new(1)), frame(2, 2), &Limits::spp(1.0));
        assert!(matches!(SureFilter::default().apply(&unused), Err(Error::NotRecorded { .. })));
    }
}
