//! The Gaussian filter.

mod weights;

use self::weights::gaussian_weights;
use crate::among::{Among, rows_around};
use crate::parameters::describe;
use crate::pixel_means::{emission, mean_and_presence, normalised, squared_error, variances};
use crate::separable::separable;
use dapple_core::{
    Band, Error, Exchange, Film, Filter, FilterMemory, Filtered, Frame, ImagePlanes, Needs, Options as _,
};
use rayon::prelude::*;
use std::ops::Range;

dapple_core::options! {
    /// The parameters of [`Gaussian`].
    pub struct GaussianOptions {
        /// The kernel is exp(-alpha r^2) - exp(-alpha radius^2) along each axis.
        ///
        /// The standard deviation is `sqrt(0.5 / alpha)` pixels.
        pub alpha: f64 = 0.5, |alpha| alpha > 0.0 && alpha.is_finite(), "a finite number above 0; 0.5 is usual";
        /// Half its width in pixels.
        pub radius: f64 = 4.0 => "4",
            |radius| radius > 0.0 && radius <= 64.0, "above 0 and at most 64 pixels, from the centre to the edge";
    }
}

/// A Gaussian blur of the pixel means, with weights integrated over each pixel.
///
/// ```
/// use dapple_core::{Film, Filter, Frame, Needs};
/// use dapple_denoise::Gaussian;
///
/// let filter = Gaussian::new(0.5, 4.0)?; // the default
/// let mut film = Film::new(Frame::new(9, 9)?, Needs::none());
/// film.push(40, 0, [1.0; 3]); // the only sample of the image
/// let image = filter.apply(&film)?;
/// assert_eq!(image.radiance[0], [1.0; 3], "empty pixels are filled");
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// # Kernel
///
/// Along each axis the kernel is `max(0, exp(-alpha x^2) - exp(-alpha radius^2))` with `x` in pixels.
/// This is the form of pbrt's Gaussian filter [after Pharr and Humphreys 2010, chapter 7]. In two dimensions it is the
/// product.
///
/// The weight of pixel `j` in the result of pixel `i` is the integral of the kernel over the square of `j`.
/// The kernel is centred on the centre of `i`. Weights are normalised over the pixels that exist and have samples.
///
/// The result equals splatting infinitely many samples, spread evenly over every pixel.
/// Sample counts affect only its noise: an edge stays in place even if its two sides have different counts.
/// Splatting the actual samples, `sum(w f) / sum(w)`, would move the edge.
///
/// # Default
///
/// `alpha` is 0.5 and `radius` is 4 pixels. This reads "kernel 0.5, width 8 px" of the cluster-adaptive thesis as a
/// full support of 8 pixels.
/// The `xwidth` of pbrt-v2 is a half-width, which would make the radius 8. The two filters are nearly the same:
///
/// * No weight differs by more than 0.0003, of a largest weight of 0.147.
/// * The wider kernel's weights beyond 4.5 pixels add up to 7e-6 per axis.
/// * The remaining noise variance differs by 0.3 %.
/// * The narrower kernel has 9 weights per axis, the wider one 17.
///
/// # Lamps
///
/// Bright light sources seen directly stay in their pixels, if the film recorded their emission. The published blur
/// spreads them too. A film without [`Needs::emission`] gives that.
///
/// # Pixels without samples
///
/// They are filled from their neighbours. If no pixel in reach has samples, they are black with an infinite error.
///
/// # Error
///
/// [`Filtered::error`] is the sum of squared normalised weights times the variances of the pixel means.
/// The variances come from the film's halves, or else from its sample variance. The error is `None` if the film has
/// neither.
///
/// It is the variance only: **the blur of edges is bias and not included**. It treats the noise of different pixels as
/// independent.
/// It is infinite where a pixel in reach has samples but an unknown variance.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussian {
    options: GaussianOptions,
    weights: Vec<f64>,
}

impl Default for Gaussian {
    fn default() -> Self {
        Self::of(GaussianOptions::default())
    }
}

impl Gaussian {
    /// A Gaussian with the falloff `alpha` per square pixel, cut off `radius` pixels from the centre along each axis.
    ///
    /// # Errors
    ///
    /// As [`Gaussian::with_options`].
    pub fn new(alpha: f64, radius: f64) -> Result<Self, Error> {
        Self::with_options(GaussianOptions { alpha, radius })
    }

    /// A Gaussian with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `alpha` is finite and positive and `radius` in `(0, 64]`.
    pub fn with_options(options: GaussianOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self::of(options))
    }

    fn of(options: GaussianOptions) -> Self {
        Self { options, weights: gaussian_weights(options.alpha, options.radius) }
    }

    /// The parameters.
    pub fn options(&self) -> GaussianOptions {
        self.options
    }

    /// The weights of the pixels along one axis: `2 n + 1` of them, the pixel itself in the middle. They are positive,
    /// symmetric and sum to 1. A pixel's weight is the product of its column's and its row's.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
}

impl Filter for Gaussian {
    fn name(&self) -> &str {
        "gaussian"
    }

    fn describe(&self) -> String {
        describe(self.name(), &self.options, "")
    }

    fn needs(&self) -> Needs {
        Needs::none().with_emission()
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        // Four sums along rows, and four along columns; emission.
        let known = needs.variance || needs.halves;
        let image = if known { ImagePlanes::RadianceAndError } else { ImagePlanes::Radiance };
        FilterMemory::new(frame, 2 * size_of::<[f64; 4]>() + if needs.emission { 24 } else { 0 }, image)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        self.run(film, 0, &mut Among::alone(film.frame().size()[1] as usize))
    }

    fn rows_read(&self, frame: &Frame, rows: Range<u32>) -> Option<Range<u32>> {
        Some(rows_around(frame, rows, self.weights.len() / 2, 1))
    }

    fn apply_to_rows(&self, film: &Film, band: &Band, exchange: &mut dyn Exchange) -> Result<Filtered, Error> {
        let (mut among, top) = Among::new(self, film, band, exchange)?;
        self.run(film, top, &mut among)
    }
}

impl Gaussian {
    fn run(&self, film: &Film, top: usize, among: &mut Among<'_>) -> Result<Filtered, Error> {
        let size = film.frame().size();
        let plane = size.map(|n| n as usize);
        let emission = emission(film, top, among)?;
        let emission = emission.as_deref();
        let sums = separable(plane, &self.weights, |i| mean_and_presence(film, emission, i), |_, sum| sum);
        let error = variances(film).map(|variances| {
            let squares: Vec<f64> = self.weights.iter().map(|w| w * w).collect();
            separable(plane, &squares, |i| [variances[i]], |i, [sum]| squared_error(sum, sums[i][3]))
        });
        let own = |i| emission.map_or([0.0; 3], |emission| emission[i]);
        let finish = |(i, sum)| normalised(sum, own(i));
        let radiance = sums.into_par_iter().enumerate().with_min_len(1024).map(finish).collect();
        Ok(among.place(0, top).own_rows(Filtered::new(size, radiance).with_error(error)))
    }
}
