//! Nonlinearly weighted first-order regression.

mod regression;

use crate::method::{FilterMethod, MethodFilter};
use crate::windows::{FEATURES, Means, feature_moments, per_pixel, stored, unit_of_depth};
use dapple_core::{Error, Film, Filtered, Needs, filter::ImagePlanes};
use regression::{Data, Guide, Kernel, nl_average, regress};

dapple_core::options! {
    /// The parameters of [`Nfor`]. Defaults are those of the authors' pseudo-code.
    pub struct NforOptions {
        /// Regression window radius in pixels, 1 to 12.
        pub window: usize = 9, |window| (1..=12).contains(&window), "1 to 12 pixels to each side";
        /// Patch radius in pixels, 0 to 4.
        pub patch: usize = 3, |patch| patch <= 4, "0 to 4 pixels to each side";
        /// true: a second pass filters the result of the first; false: one pass.
        pub second: bool = true => "true";
    }
}

/// First-order regression on features with weights of non-local means, and the better of two bandwidths [Bitterli 2016].
///
/// Normal, albedo and depth of each half are first filtered by non-local means, with weights from the other half. In the window
/// of each pixel, the colours of one half are then fitted by an affine function of the other half's features. Weights come from
/// the other half's colours. All fitted values of a pixel are averaged with the weights of their windows. There is one fit with
/// bandwidth 0.5 and one with bandwidth 1. Let `A` and `B` be the means of the halves, `v_A` and `v_B` the variances of the
/// means, and `F_A` and `F_B` the fitted images. The squared error of a bandwidth is estimated as the mean of `(B - F_A)^2 -
/// v_B` and `(A - F_B)^2 - v_A`, minus `(F_A - F_B)^2 / 4`. Errors are smoothed by non-local means; so is the map that selects
/// each pixel's bandwidth. A second regression removes the remaining noise, with variances from the difference of the halves.
///
/// # Differences from the authors' pseudo-code
///
/// * Normal equations in double precision with pivoting replace a pivoted QR decomposition.
/// * Variances take unequal counts into account. Both halves have equal weight.
/// * Pixels without samples receive fitted values but do not contribute to fits.
///
/// # Weaknesses
///
/// Five regressions over 361 pixels for each pixel cost as much as tens of samples in scenes that are fast to trace. Sample
/// variances are too large for low-discrepancy points, so the weights include too many pixels. Negative fits become black.
///
/// # Result
///
/// Pixels without samples are filled from the fits around them, or black without such fits. [`Filtered::error`] is the smoothed
/// error of the first pass, at least 0.
pub type Nfor = MethodFilter<NforOptions>;

/// The bandwidths of the first pass.
const BANDWIDTHS: [f64; 2] = [0.5, 1.0];

/// The non-local means kernels for features, in the first and in the second pass.
const FEATURE_KERNELS: [Kernel; 2] = [Kernel { radius: 5, patch: 3, k: 0.5 }, Kernel { radius: 2, patch: 3, k: 0.5 }];

/// The non-local means kernel for error estimates and selection maps.
const ERROR_KERNEL: Kernel = Kernel { radius: 9, patch: 1, k: 1.0 };

impl NforOptions {
    fn kernel(&self, k: f64) -> Kernel {
        Kernel { radius: self.window, patch: self.patch, k }
    }

    /// The second regression: of the mean of both images, on features that are filtered once more.
    fn second_pass(&self, size: [usize; 2], images: &[Rgb; 2], features: &[Buffers; 2], known: &[bool]) -> Rgb {
        let filtered: Buffers = std::array::from_fn(|k| {
            let (mean, variance) = mean_and_variance(&features[0][k], &features[1][k]);
            let guide = Guide { size, value: &mean, variance: &variance, channels: CHANNELS[k] };
            nl_average(&guide, FEATURE_KERNELS[1], &mean, known)
        });
        let (mean, variance) = mean_and_variance(&images[0], &images[1]);
        let guide = Guide { size, value: &mean, variance: &variance, channels: 3 };
        let data = Data { colour: &mean, known, features: &regressors(&filtered) };
        regress(&guide, self.kernel(1.0), &data)
    }
}

/// The mean of two images, and its variance from their difference.
fn mean_and_variance(a: &[[f64; 3]], b: &[[f64; 3]]) -> (Rgb, Rgb) {
    let mean = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|c| 0.5 * (a[c] + b[c]));
    let variance = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|c| (a[c] - b[c]) * (a[c] - b[c]) * 0.25);
    (a.iter().zip(b).map(mean).collect(), a.iter().zip(b).map(variance).collect())
}

/// The features of both halves, each filtered with weights from the other half.
fn filtered_features(size: [usize; 2], halves: &[HalfPlanes; 2]) -> [Buffers; 2] {
    [0, 1].map(|h: usize| {
        let (own, other) = (&halves[h], &halves[1 - h]);
        std::array::from_fn(|k| {
            let (value, variance) = (&other.features[k], &other.spread[k]);
            let guide = Guide { size, value, variance, channels: CHANNELS[k] };
            nl_average(&guide, FEATURE_KERNELS[0], &own.features[k], &own.means.known)
        })
    })
}

/// The estimated squared error of the mean of the halves' filtered images, averaged over the channels.
fn squared_error(halves: &[HalfPlanes; 2], images: &[Rgb; 2], i: usize) -> f64 {
    let of_channel = |c: usize| {
        let of = |h: usize| {
            let other = &halves[1 - h];
            (other.means.colour[i][c] - images[h][i][c]).powi(2) - other.means.variance[i][c]
        };
        0.5 * (of(0) + of(1)) - 0.25 * (images[0][i][c] - images[1][i][c]).powi(2)
    };
    (of_channel(0) + of_channel(1) + of_channel(2)) / 3.0
}

/// The smoothed error of each bandwidth's image, and the smoothed weight of the first bandwidth in the result.
fn selected(size: [usize; 2], halves: &[HalfPlanes; 2], images: &[[Rgb; 2]; 2]) -> (Vec<[f64; 2]>, Vec<[f64; 1]>) {
    let [a, b] = halves.each_ref().map(|half| &half.means);
    let known: Vec<bool> = a.known.iter().zip(&b.known).map(|(a, b)| *a && *b).collect();
    let (colour, _) = mean_and_variance(&a.colour, &b.colour);
    let quarter = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|c| 0.25 * (a[c] + b[c]));
    let variance: Rgb = a.variance.iter().zip(&b.variance).map(quarter).collect();
    let guide = Guide { size, value: &colour, variance: &variance, channels: 3 };
    let errors: Vec<[f64; 2]> =
        (0..known.len()).map(|i| [0, 1].map(|k: usize| squared_error(halves, &images[k], i))).collect();
    let errors = nl_average(&guide, ERROR_KERNEL, &errors, &known);
    let map: Vec<[f64; 1]> = errors.iter().map(|e| [f64::from(u8::from(e[0] < e[1]))]).collect();
    let map = nl_average(&guide, ERROR_KERNEL, &map, &known);
    (errors, map)
}

impl FilterMethod for NforOptions {
    const NAME: &'static str = "nfor";
    // Both halves, filtered features and regressors, four images, the sums of a regression and of its bands.
    const BYTES: usize = 2 * HalfPlanes::BYTES + 2 * 3 * 24 + 2 * 8 * FEATURES + 4 * 24 + 32 + 96;
    const PLANES: ImagePlanes = ImagePlanes::RadianceAndError;

    fn needs(&self) -> Needs {
        Needs::none().with_variance().with_halves().with_features().with_feature_halves()
    }

    fn image(&self, film: &Film, (): &()) -> Result<Filtered, Error> {
        let size = film.frame().size().map(|n| n as usize);
        let halves = [0, 1].map(|half| HalfPlanes::new(film, half));
        let features = filtered_features(size, &halves);
        let rows = [0, 1].map(|h: usize| regressors(&features[h]));
        // The images of both halves by the first regression with each bandwidth.
        let images = BANDWIDTHS.map(|k| {
            [0, 1].map(|h: usize| {
                let (own, other) = (&halves[h].means, &halves[1 - h].means);
                let guide = Guide { size, value: &other.colour, variance: &other.variance, channels: 3 };
                let data = Data { colour: &own.colour, known: &own.known, features: &rows[1 - h] };
                regress(&guide, self.kernel(k), &data)
            })
        });
        let (errors, map) = selected(size, &halves, &images);
        let blend = |h: usize, i: usize| {
            let share = map[i][0];
            std::array::from_fn(|c| share * images[0][h][i][c] + (1.0 - share) * images[1][h][i][c])
        };
        let pixels = 0..film.frame().pixels();
        let blended: [Rgb; 2] = [0, 1].map(|h| pixels.clone().map(|i| blend(h, i)).collect());
        let known: Vec<bool> =
            halves[0].means.known.iter().zip(&halves[1].means.known).map(|(a, b)| *a || *b).collect();
        let result = if self.second {
            self.second_pass(size, &blended, &features, &known)
        } else {
            mean_and_variance(&blended[0], &blended[1]).0
        };
        let most = f64::from(f32::MAX);
        let radiance = result.iter().map(|colour| colour.map(|x| x.clamp(0.0, most) as f32)).collect();
        let error = pixels.map(|i| stored(map[i][0] * errors[i][0] + (1.0 - map[i][0]) * errors[i][1]));
        Ok(Filtered::new(film.frame().size(), radiance).with_error(error.collect::<Vec<_>>()))
    }
}

/// Three channels per pixel.
type Rgb = Vec<[f64; 3]>;

/// The feature buffers: normal, albedo, and depth in the first channel.
type Buffers = [Rgb; 3];

/// The number of channels of each feature buffer.
const CHANNELS: [usize; 3] = [3, 3, 1];

/// The pixel means and features of one half of the samples.
struct HalfPlanes {
    means: Means,
    /// The mean of each feature, and the variance of that mean in `spread`. Depths are relative to the largest.
    features: Buffers,
    spread: Buffers,
}

impl HalfPlanes {
    /// The bytes per pixel of one half.
    const BYTES: usize = Means::BYTES[0] + 6 * 24;

    fn new(film: &Film, half: usize) -> Self {
        let unit = unit_of_depth(film);
        let features = per_pixel(film, |i| {
            let (Some(own), Some(all)) = (film.half_features(half, i), film.features(i)) else {
                return [[[0.0; 3]; 3]; 2];
            };
            // A half without samples uses the features of both halves. Variances come from all samples.
            let [mean, _] = feature_moments(if own.samples > 0 { &own } else { &all }, unit);
            let [_, of_sample] = feature_moments(&all, unit);
            let buffers = |[x, y, z, r, g, b, depth]: [f64; FEATURES]| [[x, y, z], [r, g, b], [depth, 0.0, 0.0]];
            let samples = f64::from(own.samples.max(1));
            [buffers(mean.map(f64::from)), buffers(of_sample.map(|v| f64::from(v) / samples))]
        });
        let plane = |of: usize| std::array::from_fn(|k| features.iter().map(|f| f[of][k]).collect());
        Self { means: Means::new(film, Some(half)), features: plane(0), spread: plane(1) }
    }
}

/// The regressors of each pixel.
fn regressors(buffers: &Buffers) -> Vec<[f64; FEATURES]> {
    let [normal, albedo, depth] = buffers;
    let of = |((n, a), d): ((&[f64; 3], &[f64; 3]), &[f64; 3])| [n[0], n[1], n[2], a[0], a[1], a[2], d[0]];
    normal.iter().zip(albedo).zip(depth).map(of).collect()
}
