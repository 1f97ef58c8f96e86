//! Nonlinearly weighted first-order regression.

mod regression;

use crate::method::{FilterMethod, MethodFilter};
use crate::windows::{FEATURES, Means, feature_moments, per_pixel, unit_of_depth};
use dapple_core::{Error, Film, Filtered, ImagePlanes, Needs};
use regression::{Data, Guide, Kernel, nl_average, regress};

dapple_core::options! {
    /// The parameters of [`Nfor`]. Defaults are those of the authors' pseudo-code.
    pub struct NforOptions {
        /// Pixels to each side whose colours are fitted, 1 to 12.
        pub window: usize = 9, |window| (1..=12).contains(&window), "1 to 12 pixels to each side";
        /// Pixels compared to each side, 0 to 4.
        pub patch: usize = 3, |patch| patch <= 4, "0 to 4 pixels to each side";
        /// Second pass over the result of the first.
        pub second: bool = true => "true";
    }
}

/// First-order regression on features with weights of non-local means, and the better of two bandwidths [Bitterli 2016].
///
/// Normal, albedo and depth of each half are first filtered by non-local means, with weights from the other half. In the
/// window of each pixel, the colours of one half are then fitted by an affine function of the other half's features.
/// Weights come from the other half's colours. All fitted values of a pixel are averaged with the weights of their windows.
/// This is done with bandwidths 0.5 and 1. The halves' images `F_A` and `F_B` of each bandwidth show its squared error,
/// the mean of `(B - F_A)^2 - v_B` and `(A - F_B)^2 - v_A`, less `(F_A - F_B)^2 / 4`. Errors are smoothed by non-local means,
/// and the map of the better bandwidth is smoothed likewise. A second regression, with variances from the difference of
/// the halves, removes what noise is left.
///
/// # Differences from the authors' pseudo-code
///
/// * Normal equations in double precision with pivots stand in for a QR decomposition with pivots.
/// * Variances are those of unequal counts. Both halves count alike.
/// * Pixels without samples take part in fits as results only.
///
/// # Weaknesses
///
/// Five regressions over 361 pixels for each pixel cost as much as tens of samples on scenes that trace fast. Sample
/// variances are too large for low-discrepancy points, and widen the weights. Negative fits become black.
///
/// # Result
///
/// Pixels without samples are filled from the fits around them, or black if there are none. [`Filtered::error`] is the
/// smoothed error of the first pass, at least 0.
pub type Nfor = MethodFilter<NforOptions>;

/// The bandwidths of the first pass.
const BANDWIDTHS: [f64; 2] = [0.5, 1.0];

/// Non-local means of features in the first pass, and in the second.
const FEATURE_KERNELS: [Kernel; 2] = [Kernel { radius: 5, patch: 3, k: 0.5 }, Kernel { radius: 2, patch: 3, k: 0.5 }];

/// Non-local means of error estimates and of selection maps.
const ERROR_KERNEL: Kernel = Kernel { radius: 9, patch: 1, k: 1.0 };

impl NforOptions {
    fn kernel(&self, k: f64) -> Kernel {
        Kernel { radius: self.window, patch: self.patch, k }
    }

    /// The regression of the mean of both images on features filtered once more.
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

/// The features of both halves, each filtered with weights from the other.
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

/// The error of each bandwidth's image, smoothed, and the smoothed share of the first bandwidth in the result.
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
    // Both halves, filtered features and regressors, four images, sums of a regression and of its bands.
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
        let error = pixels.map(|i| (map[i][0] * errors[i][0] + (1.0 - map[i][0]) * errors[i][1]).max(0.0) as f32);
        Ok(Filtered::new(film.frame().size(), radiance).with_error(error.collect::<Vec<_>>()))
    }
}

/// Three channels per pixel.
type Rgb = Vec<[f64; 3]>;

/// The feature buffers: normal, albedo, and depth in the first channel.
type Buffers = [Rgb; 3];

/// The number of channels of each feature buffer.
const CHANNELS: [usize; 3] = [3, 3, 1];

/// The samples of one half.
struct HalfPlanes {
    means: Means,
    /// The mean of each feature, and its variance. Depths are relative to the largest.
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
            // A half without samples takes the features of both, and its variances are those of all samples.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::{frame, image};
    use dapple_core::{Estimate, Filter as _, FirstHit, PointSet as _, SampleId};

    const SIDE: usize = 40;

    /// A nearly normal number of mean 0 and variance 1, a sum of twelve uniform ones, named by `seed` and `k`.
    fn near_normal(seed: u64, k: u64) -> f64 {
        let points = dapple_low_discrepancy::Random::new(seed);
        let block = |b: u32| points.block(SampleId::new([k as u32, 0], 0, k >> 32), b).map(|u| f64::from(u) - 0.5);
        (0..3).flat_map(block).sum()
    }

    /// A film of 16 samples per pixel, of deviation 0.1 about `truth`, whose features are exact.
    fn film(truth: impl Fn(usize) -> f64, hit: impl Fn(usize) -> FirstHit) -> Film {
        let mut film = Film::new(frame([SIDE as u32; 2]), Nfor::default().needs());
        for i in 0..SIDE * SIDE {
            for k in 0..16 {
                let value = truth(i) + 0.1 * near_normal(7, (i * 16 + k) as u64);
                film.push_estimate(i, k, &Estimate::new([value as f32; 3]).with_first_hit(hit(i)));
            }
        }
        film
    }

    /// The mean squared error of the filtered image, away from the border, relative to that of the samples.
    fn relative_error(options: NforOptions, film: &Film, truth: impl Fn(usize) -> f64) -> f64 {
        let image = image(&Nfor::with_options(options).unwrap(), film);
        let inner = |i: &usize| (8..SIDE - 8).contains(&(i % SIDE)) && (8..SIDE - 8).contains(&(i / SIDE));
        let pixels: Vec<usize> = (0..SIDE * SIDE).filter(inner).collect();
        let error = |value: &dyn Fn(usize) -> f64| pixels.iter().map(|&i| (value(i) - truth(i)).powi(2)).sum::<f64>();
        error(&|i| f64::from(image[i][0])) / error(&|i| film.mean(i)[0])
    }

    /// An albedo that differs from pixel to pixel.
    fn albedo(i: usize) -> [f64; 3] {
        [0, 1, 2].map(|c| 0.5 + 0.02 * near_normal(3, (3 * i + c) as u64))
    }

    fn wall(albedo: [f64; 3]) -> FirstHit {
        FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0).with_albedo(albedo.map(|a| a as f32))
    }

    #[test]
    fn images_that_are_affine_in_features_are_reproduced() {
        let truth = |i: usize| 0.3 + albedo(i)[0] - 0.5 * albedo(i)[2];
        let found = relative_error(NforOptions::default(), &film(truth, |i| wall(albedo(i))), truth);
        // The control: without the albedo, the texture is not in the features.
        let without = relative_error(NforOptions::default(), &film(truth, |_| wall([0.5; 3])), truth);
        assert!(found < 0.006 && without > 0.5, "{found} {without}");
    }

    #[test]
    fn noise_on_constant_features_is_averaged_over_windows() {
        let flat = film(|_| 0.5, |_| wall([0.5; 3]));
        let speckled = film(|_| 0.5, |i| wall(albedo(i)));
        let of = |film: &Film, second| relative_error(NforOptions::default().second(second), film, |_| 0.5);
        // A fit of 4 unknowns to 361 pixels alone leaves 4 / 361; fits of all windows around a pixel are averaged.
        for (found, limit) in [
            (of(&flat, false), 0.0007),
            (of(&flat, true), 0.0005),
            (of(&speckled, false), 0.006),
            (of(&speckled, true), 0.003),
        ] {
            assert!(found < limit && limit < 4.0 / 361.0, "{found} {limit}");
        }
        // The control: a window of one pixel to each side removes less.
        assert!(relative_error(NforOptions::default().window(1).second(false), &flat, |_| 0.5) > 0.02);
    }
}
