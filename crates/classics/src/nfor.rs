//! Nonlinearly weighted first-order regression.

mod collaborative;
mod weights;

use crate::method::{FilterMethod, MethodFilter};
use crate::windows::{per_pixel, window_sums};
use collaborative::{Data, regress};
use dapple_core::{Error, Features, Film, FilterMemory, Filtered, Frame, ImagePlanes, Needs};
use weights::{Guide, Kernel, TILE, nl_average};

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

    /// The images of both halves by the first regression with this bandwidth.
    fn first_pass(
        &self,
        size: [usize; 2],
        halves: &[HalfPlanes; 2],
        features: &[Vec<[f64; FEATURES]>; 2],
        k: f64,
    ) -> [Rgb; 2] {
        [0, 1].map(|h: usize| {
            let (own, other) = (&halves[h], &halves[1 - h]);
            let guide = Guide { size, value: &other.colour, variance: &other.variance, channels: 3 };
            let data = Data { colour: &own.colour, known: &own.known, features: &features[1 - h] };
            regress(&guide, self.kernel(k), &data)
        })
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
            nl_average(&guide, FEATURE_KERNELS[0], &own.features[k], &own.known)
        })
    })
}

/// The estimated squared error of the mean of the halves' filtered images, averaged over the channels.
fn squared_error(halves: &[HalfPlanes; 2], images: &[Rgb; 2], i: usize) -> f64 {
    let of_channel = |c: usize| {
        let of = |h: usize| {
            let other = &halves[1 - h];
            (other.colour[i][c] - images[h][i][c]).powi(2) - other.variance[i][c]
        };
        0.5 * (of(0) + of(1)) - 0.25 * (images[0][i][c] - images[1][i][c]).powi(2)
    };
    (of_channel(0) + of_channel(1) + of_channel(2)) / 3.0
}

/// The error of each bandwidth's image, smoothed, and the smoothed share of the first bandwidth in the result.
fn selected(size: [usize; 2], halves: &[HalfPlanes; 2], images: &[[Rgb; 2]; 2]) -> (Vec<[f64; 2]>, Vec<[f64; 1]>) {
    let [a, b] = halves;
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

    fn needs(&self) -> Needs {
        Needs::none().with_variance().with_halves().with_features().with_feature_halves()
    }

    fn applying(&self, frame: &Frame) -> FilterMemory {
        let [half, making] = HalfPlanes::BYTES;
        // Both halves, filtered features and regressors, four images, sums of a regression and of its bands.
        let bands = 32 * (TILE[1] + 2 * self.window) / TILE[1];
        let working = 2 * 3 * 24 + 2 * 8 * FEATURES + 4 * 24 + 32 + bands;
        let bytes = 2 * half + making.max(working);
        let side = 2 * self.window.max(ERROR_KERNEL.radius) + 1;
        let tiles = side * side * 8 * TILE[0] * TILE[1] * rayon::current_num_threads();
        let memory = FilterMemory::new(frame, bytes, ImagePlanes::RadianceAndError);
        memory.at_least(memory.applying.saturating_add(tiles as u64))
    }

    fn image(&self, film: &Film) -> Result<Filtered, Error> {
        let size = film.frame().size().map(|n| n as usize);
        let halves = [0, 1].map(|half| HalfPlanes::new(film, half));
        let features = filtered_features(size, &halves);
        let rows = [0, 1].map(|h: usize| regressors(&features[h]));
        let images = BANDWIDTHS.map(|k| self.first_pass(size, &halves, &rows, k));
        let (errors, map) = selected(size, &halves, &images);
        let blend = |h: usize, i: usize| {
            let share = map[i][0];
            std::array::from_fn(|c| share * images[0][h][i][c] + (1.0 - share) * images[1][h][i][c])
        };
        let pixels = 0..film.frame().pixels();
        let blended: [Rgb; 2] = [0, 1].map(|h| pixels.clone().map(|i| blend(h, i)).collect());
        let known: Vec<bool> = halves[0].known.iter().zip(&halves[1].known).map(|(a, b)| *a || *b).collect();
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

/// The number of regressors that features give: normal (3), albedo (3) and depth.
const FEATURES: usize = 7;

/// Three channels per pixel.
type Rgb = Vec<[f64; 3]>;

/// The feature buffers: normal, albedo, and depth in the first channel.
type Buffers = [Rgb; 3];

/// The number of channels of each feature buffer.
const CHANNELS: [usize; 3] = [3, 3, 1];

/// The samples of one half.
struct HalfPlanes {
    /// The mean radiance; where the half has no samples, that of the pixels around.
    colour: Rgb,
    /// The variance of that mean.
    variance: Rgb,
    /// `true` for pixels with samples.
    known: Vec<bool>,
    /// The mean of each feature, and its variance.
    features: Buffers,
    spread: Buffers,
}

/// The radius of the window from which pixels without samples or variance take them.
const NEAR: usize = 2;

impl HalfPlanes {
    /// The bytes per pixel of one half, and of the sums from which it is made.
    const BYTES: [usize; 2] = [2 * 24 + 1 + 6 * 24, 128];

    fn new(film: &Film, half: usize) -> Self {
        let size = film.frame().size().map(|n| n as usize);
        let of = |i: usize| film.half(half, i).unwrap_or_default();
        // Per pixel: a 1 if there are samples, the mean, degrees of freedom of both halves, and squared deviations.
        let sums = window_sums(size, NEAR, |i| {
            let (own, all) = (of(i), film.moments(i));
            let [r, g, b] = own.mean;
            let [vr, vg, vb] = all.m2;
            [f64::from(u8::from(own.count > 0)), r, g, b, all.count.saturating_sub(1) as f64, vr, vg, vb]
        });
        let near = |i: usize, c: usize| sums[i][c] / sums[i][if c > 4 { 4 } else { 0 }].max(1.0);
        let colour = |i: usize| match of(i) {
            own if own.count > 0 => own.mean,
            _ if film.count(i) > 0 => film.mean(i),
            _ => [1, 2, 3].map(|c| near(i, c)),
        };
        let variance = |i: usize| {
            let of_sample = film.moments(i).variance().unwrap_or_else(|| [5, 6, 7].map(|c| near(i, c)));
            of_sample.map(|v| v / of(i).count.max(1) as f64)
        };
        let features = features(film, half);
        Self {
            colour: per_pixel(film, colour),
            variance: per_pixel(film, variance),
            known: (0..film.frame().pixels()).map(|i| of(i).count > 0).collect(),
            features: std::array::from_fn(|k| features.iter().map(|f| f[0][k]).collect()),
            spread: std::array::from_fn(|k| features.iter().map(|f| f[1][k]).collect()),
        }
    }
}

/// The three features of each pixel, and their variances. Depths are relative to the largest.
fn features(film: &Film, half: usize) -> Vec<[[[f64; 3]; 3]; 2]> {
    let depths = (0..film.frame().pixels()).filter_map(|i| film.features(i)).map(|f| f.depth);
    let depth = depths.fold(0.0, f32::max);
    let unit = if depth > 0.0 { 1.0 / depth } else { 0.0 };
    per_pixel(film, |i| {
        let (Some(own), Some(all)) = (film.half_features(half, i), film.features(i)) else { return [[[0.0; 3]; 3]; 2] };
        // A half without samples takes the features of both.
        let own = if own.samples > 0 { own } else { all };
        let mean = |f: &Features| {
            let share = f.hits as f32 / f.samples.max(1) as f32;
            let bounded = |x: f32| f64::from((share * x).clamp(-1e9, 1e9));
            [f.normal.map(bounded), f.albedo.map(bounded), [bounded(f.depth * unit), 0.0, 0.0]]
        };
        [mean(&own), variances(&all, own.samples, unit)]
    })
}

/// The variance of the means of a half of `samples` samples, from the sample variance of all. Misses have features 0.
fn variances(all: &Features, samples: u32, unit: f32) -> [[f64; 3]; 3] {
    let v = all.variance.unwrap_or_default();
    let share = all.hits as f32 / all.samples.max(1) as f32;
    let spread = |variance: f32, mean: f32| {
        let of_sample = share * variance + share * (1.0 - share) * mean * mean;
        f64::from(of_sample.clamp(0.0, 1e18)) / f64::from(samples.max(1))
    };
    let [n, a] = [all.normal, all.albedo];
    let three = |at: usize, mean: [f32; 3]| [0, 1, 2].map(|c| spread(v[at + c], mean[c]));
    [three(0, n), three(3, a), [spread(v[9] * unit * unit, all.depth * unit), 0.0, 0.0]]
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
    use crate::test_scenes::{frame, near_normal};
    use dapple_core::{Estimate, Filter as _, FirstHit};

    const SIDE: usize = 40;

    /// A film of 16 samples per pixel, of deviation 0.1 about `truth`, whose features are exact.
    fn film(truth: impl Fn(usize) -> f64, hit: impl Fn(usize) -> FirstHit) -> Film {
        let mut film = Film::new(frame(SIDE as u32, SIDE as u32), Nfor::default().needs());
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
        let image = Nfor::with_options(options).unwrap().apply(film).unwrap();
        let inner = |i: &usize| (8..SIDE - 8).contains(&(i % SIDE)) && (8..SIDE - 8).contains(&(i / SIDE));
        let pixels: Vec<usize> = (0..SIDE * SIDE).filter(inner).collect();
        let error = |value: &dyn Fn(usize) -> f64| pixels.iter().map(|&i| (value(i) - truth(i)).powi(2)).sum::<f64>();
        error(&|i| f64::from(image.radiance[i][0])) / error(&|i| film.mean(i)[0])
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
