//! Shrinkage of wavelet coefficients.

use crate::method::{FilterMethod, MethodFilter};
use crate::variances::filled_means;
use crate::wavelets::{Basis, coefficient_variances, high_band, restore, transform};
use dapple_core::{Error, Film, FilterMemory, Filtered, Frame, ImagePlanes};
use rayon::prelude::*;

dapple_core::options! {
    /// The parameters of [`Wavelet`].
    pub struct WaveletOptions {
        /// Wavelets: cdf97 or cdf53 (Cohen, Daubechies and Feauveau) or haar.
        pub basis: Basis = Basis::Cdf97 => "cdf97";
        /// Number of levels.
        pub levels: usize = 5, |levels| (1..=10).contains(&levels), "1 to 10";
        /// Coefficients shrink by this many standard errors; 0 keeps the image.
        pub gamma: f64 = 1.0 => "1", |gamma| (0.0..=100.0).contains(&gamma), "0 to 100 standard errors";
    }
}

/// Wavelet shrinkage, the reconstruction of adaptive wavelet rendering [after Overbeck, Donner and Ramamoorthi 2009].
///
/// The image of pixel means is transformed. Each wavelet coefficient `w` becomes `sign(w) max(0, |w| - gamma SE)`, and the
/// image is transformed back. `SE` is the coefficient's standard error: the root of the pixels' variances through the
/// squared filter. Pixels without samples are filled from their neighbours first.
///
/// The shrinkage by one standard error is stated by the authors. The basis, the levels and the variance of pixels, that of
/// their samples, are ours.
///
/// *Error*: not estimated. *Bias*: coefficients are shrunk even where they are detail, and shrinkage depends on the samples.
/// Radiance below 0 becomes 0.
/// *Weaknesses*: ringing and blotches at few samples, texture of low contrast vanishes, fireflies leave smeared traces.
/// It knows no features.
pub type Wavelet = MethodFilter<WaveletOptions>;

impl WaveletOptions {
    /// Shrinks the coefficients of an image whose pixels have these variances.
    fn shrink(&self, size: [usize; 2], image: &mut Vec<[f64; 3]>, variances: &[f64]) {
        let Self { basis, levels, gamma } = *self;
        transform(basis, size, 0..levels, image);
        for (below, filters) in basis.cascade(levels).iter().enumerate() {
            let level = below + 1;
            let columns = size[0].div_ceil(1 << level);
            let [_, bands @ ..] = coefficient_variances(filters, level, size, variances);
            for (band, variances) in bands.iter().enumerate() {
                let [xs, ys] = high_band(size, level, band);
                let rows = image.par_chunks_mut(size[0]).skip(ys.start).take(ys.len());
                rows.zip(variances.par_chunks(columns)).for_each(|(row, variances)| {
                    for (colour, variance) in row[xs.clone()].iter_mut().zip(variances) {
                        let threshold = gamma * variance.sqrt();
                        *colour = colour.map(|w| (w.abs() - threshold).max(0.0).copysign(w));
                    }
                });
            }
        }
        restore(basis, size, levels, image);
    }
}

impl FilterMethod for WaveletOptions {
    const NAME: &'static str = "wavelet";

    fn applying(&self, frame: &Frame) -> FilterMemory {
        // The image and its transposed copy, variances, and half of three planes along an axis with their copies.
        FilterMemory::new(frame, 2 * 24 + 8 + 4 * 8 + 12, ImagePlanes::Radiance)
    }

    fn image(&self, film: &Film) -> Result<Filtered, Error> {
        let size = film.frame().size();
        let (mut image, variances) = filled_means(film);
        self.shrink(size.map(|n| n as usize), &mut image, &variances);
        Ok(Filtered::new(size, image.into_iter().map(|colour| colour.map(|x| x.max(0.0) as f32)).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_films::{noisy_film, normal};
    use dapple_core::{Filter as _, Needs};

    fn wavelet(basis: Basis, gamma: f64) -> Wavelet {
        Wavelet::with_options(WaveletOptions::default().basis(basis).gamma(gamma)).expect("options in range")
    }

    #[test]
    fn wavelet_conforms() {
        for basis in [Basis::Cdf97, Basis::Cdf53, Basis::Haar] {
            dapple_conformance::filter(|| Box::new(wavelet(basis, 1.0)));
        }
    }

    #[test]
    fn without_shrinkage_the_image_is_kept() {
        for basis in [Basis::Cdf97, Basis::Cdf53, Basis::Haar] {
            let film =
                noisy_film([37, 22], 4, Needs::none().with_variance(), 1, |x, _| 10.0 + f64::from(x), |_, _| 2.0);
            let image = wavelet(basis, 0.0).apply(&film).expect("a film with variance").radiance;
            for (i, colour) in image.iter().enumerate() {
                assert!(
                    (f64::from(colour[0]) - film.mean(i)[0]).abs() < 1e-5 * film.mean(i)[0],
                    "{basis:?}, pixel {i}"
                );
            }
        }
    }

    /// The energy that shrinkage by g standard errors leaves of a coefficient of pure noise is 2 [(1 + g^2) Phi(-g) - g
    /// phi(g)].
    #[test]
    fn shrunk_noise_has_the_energy_of_the_closed_form() {
        let size = [256, 256];
        for (gamma, wanted) in [(1.0, 0.1507), (2.0, 0.0115)] {
            let mut image: Vec<[f64; 3]> = (0..65536).map(|i| [0, 1, 2].map(|c| normal(3 * i + c))).collect();
            WaveletOptions::default().basis(Basis::Haar).gamma(gamma).shrink(size, &mut image, &vec![1.0; 65536]);
            transform(Basis::Haar, size, 0..1, &mut image);
            // Each coefficient of the first level has a variance of 1/4.
            let finest = (0..65536).filter(|i| i % 256 >= 128 || i / 256 >= 128);
            let energy = finest.flat_map(|i| image[i]).map(|w| w * w).sum::<f64>() / (3.0 * 49152.0) / 0.25;
            // The standard error of 147456 squares is below 0.5 % and 2 %.
            assert!((energy / wanted - 1.0).abs() < 0.04, "{gamma}: {energy}, not {wanted}");
        }
    }

    #[test]
    fn noise_falls_beside_an_edge_that_stays() {
        let image = |x: u32, y: u32| if x + y < 64 { 10.0 } else { 20.0 };
        let film = noisy_film([64, 64], 8, Needs::none().with_variance(), 3, image, |_, _| 1.0);
        for basis in [Basis::Cdf97, Basis::Cdf53, Basis::Haar] {
            let filtered = wavelet(basis, 1.5).apply(&film).expect("a film with variance").radiance;
            let wrong = |i: usize| f64::from(filtered[i][0]) - image(i as u32 % 64, i as u32 / 64);
            let (flat, edge): (Vec<_>, Vec<_>) = (0..4096usize).partition(|i| (i % 64 + i / 64).abs_diff(64) > 20);
            let error = flat.iter().map(|&i| wrong(i) * wrong(i)).sum::<f64>() / flat.len() as f64;
            assert!(error < 0.25 / 8.0, "{basis:?}: {error} of {} is left", 1.0 / 8.0);
            assert!(edge.iter().all(|&i| wrong(i).abs() < 3.0), "{basis:?}: the edge is washed out");
        }
    }

    #[test]
    fn pixels_without_samples_are_filled() {
        let mut film = noisy_film([16, 16], 0, Needs::none().with_variance(), 0, |_, _| 1.0, |_, _| 0.0);
        for i in (0..256).filter(|i| i % 5 != 0) {
            (0..4).for_each(|s| film.push(i, 0, [1.0 + 0.1 * s as f32; 3]));
        }
        let image = wavelet(Basis::Cdf97, 1.0).apply(&film).expect("a film with variance").radiance;
        assert!(image.iter().all(|colour| (colour[0] - 1.15).abs() < 1e-5));
    }
}
