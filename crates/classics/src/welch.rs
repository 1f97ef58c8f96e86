//! Means over the pixels that a statistical test cannot distinguish, and critical values of Student's t distribution,
//! bit-identical on every machine.

use crate::method::{FilterMethod, MethodFilter};
use crate::recorders::{SampleSums, ThirdMoments};
use crate::windows::{beside, feature_moments, per_pixel};
use dapple_core::film::{Recorder, RgbMoments};
use dapple_core::{Error, Film, Filtered, Needs, filter::ImagePlanes, parallel};
use std::f64::consts::{FRAC_PI_2, SQRT_2};
use std::sync::Arc;

/// The degrees of freedom in the test of [`Welch`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TestDegrees {
    /// The degrees of freedom of Welch and Satterthwaite, for unequal variances and counts.
    #[default]
    Welch,
    /// The sum of both counts minus 2, as published for equal counts.
    Counts,
}

dapple_core::choices!(TestDegrees { Welch = "welch", Counts = "counts" });

dapple_core::options! {
    /// The parameters of [`Welch`]. Defaults are those of the authors' code.
    pub struct WelchOptions {
        /// Radius of the neighbourhood in pixels.
        pub radius: u32 = 20, |radius| radius <= 32, "at most 32 pixels";
        /// Standard deviation of the distance weight, in pixels.
        pub sigma: f64 = 10.0 => "10", |sigma| sigma > 0.0 && sigma.is_finite(), "above 0 pixels";
        /// Standard deviation of the albedo weight.
        pub albedo: f64 = 0.02, |sigma| sigma > 0.0 && sigma.is_finite(), "above 0";
        /// Standard deviation of the normal weight.
        pub normal: f64 = 0.1, |sigma| sigma > 0.0 && sigma.is_finite(), "above 0";
        /// Significance level of the per-channel test.
        pub level: f64 = 0.005, |level| (1e-6..=0.5).contains(&level), "a probability from 1e-6 to 0.5";
        /// Degrees of freedom of the test: welch (unequal variances) or counts (sum of both counts minus 2, as published).
        pub df: TestDegrees = TestDegrees::Welch => "welch";
        /// Factor on variances of means; below 1 suits low-discrepancy points, whose means vary less.
        pub shrink: f64 = 1.0 => "1", |shrink| shrink > 0.0 && shrink <= 1.0, "above 0 and at most 1";
    }
}

/// The mean of the pixels in a circle, except those that differ significantly from the central pixel [after Sakai 2024].
///
/// Samples `x` are transformed to `y = 2 (sqrt x - 1)`, which makes their distribution more normal [Box and Cox 1964]. The mean
/// of `n` values `y` with sample variance `s^2` is corrected for skewness: `m = mean + sum (y - mean)^3 / (6 s^2 n^2)` [Johnson
/// 1978]. Its variance is `v = s^2 / n`. Two pixels are joined unless `(m_i - m_j)^2 > t^2 (v_i + v_j)` in some channel. Here
/// `t` is the two-sided critical value of Student's distribution [Welch 1947].
///
/// The weight of a joined pixel is its sample count times Gaussian weights of distance, albedo and normal. The mean is taken
/// over `x`, not `y`. No halves are needed, so each pixel can use a single low-discrepancy net.
///
/// # Differences from the authors' code
///
/// * Pixels are weighted by their counts, and the degrees of freedom allow for unequal variances. In the authors' code, counts
///   are equal.
/// * The circle is symmetric. In the authors' code, it lacks its last row and column.
///
/// # Weaknesses
///
/// A pixel with few samples is joined with neighbours of different brightness, since the test cannot distinguish them. This
/// bias falls with the count. Sample variances are too large for low-discrepancy points, so the test joins more pixels;
/// `shrink` corrects for this. Pixels with one sample have no variance and are not joined with others.
///
/// # Result
///
/// Pixels without samples become the weighted mean of the circle, or black if it has no samples. [`Filtered::error`] is the
/// variance of the weighted mean, without the bias. The error of pixels with fewer than two samples is infinite.
pub type Welch = MethodFilter<WelchOptions>;

impl WelchOptions {
    /// The offsets of the circle, row by row, each with the logarithm of its weight.
    fn circle(&self) -> Vec<([isize; 2], f32)> {
        let (r, sigma) = (self.radius as isize, self.sigma);
        let all = (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| [dx, dy]));
        let inside = all.filter(|[dx, dy]| dx * dx + dy * dy <= r * r);
        inside.map(|[dx, dy]| ([dx, dy], (-0.5 * (dx * dx + dy * dy) as f64 / (sigma * sigma)) as f32)).collect()
    }

    /// The filtered pixel `i` followed by its error.
    fn pixel(&self, planes: &[WelchPixel], size: [usize; 2], i: usize, around: &Around) -> [f64; 4] {
        let own = &planes[i];
        let scale = [self.albedo, self.normal].map(|sigma| (-0.5 / (sigma * sigma)) as f32);
        let (mut weight, mut sums, mut error) = (0.0, [0.0; 3], 0.0);
        for (offset, near) in &around.circle {
            let Some(j) = beside(size, i, *offset) else { continue };
            let other = &planes[j];
            // Pixels without samples are joined with all pixels in the circle.
            if other.count == 0.0 || (i != j && own.count > 0.0 && !around.criticals.join(own, other, self.df)) {
                continue;
            }
            let log =
                near + scale[0] * squared(own.albedo, other.albedo) + scale[1] * squared(own.normal, other.normal);
            if log < UNLIKE && own.count > 0.0 {
                continue;
            }
            let w = f64::from(other.count) * if own.count > 0.0 { f64::from(libm::expf(log)) } else { 1.0 };
            weight += w;
            (0..3).for_each(|c| sums[c] += w * f64::from(other.colour[c]));
            error += w * w * f64::from(other.error);
        }
        if weight == 0.0 {
            return [0.0, 0.0, 0.0, f64::INFINITY];
        }
        let error = if own.count < 2.0 { f64::INFINITY } else { error / (weight * weight) };
        [sums[0] / weight, sums[1] / weight, sums[2] / weight, error]
    }
}

/// Values shared by all pixels: the circle and the critical values.
struct Around {
    circle: Vec<([isize; 2], f32)>,
    criticals: Criticals,
}

/// The logarithm of the weight below which a pixel is left out.
const UNLIKE: f32 = -20.0;

fn squared(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [x, y, z] = std::array::from_fn(|c| (a[c] - b[c]) * (a[c] - b[c]));
    x + y + z
}

/// The filter's inputs of one pixel.
#[derive(Clone, Copy, Debug, Default)]
struct WelchPixel {
    count: f32,
    colour: [f32; 3],
    /// The corrected mean of the transformed samples; `variance` is the variance of that mean.
    mean: [f32; 3],
    variance: [f32; 3],
    albedo: [f32; 3],
    normal: [f32; 3],
    /// The variance of the mean radiance, averaged over the channels.
    error: f32,
}

impl WelchPixel {
    fn new(film: &Film, i: usize, sums: &ThirdMoments, shrink: f64) -> Self {
        let (n, mut pixel) = (film.count(i) as f64, Self::default());
        pixel.count = n as f32;
        pixel.colour = film.mean(i).map(|x| x as f32);
        for c in 0..3 {
            let [mean, variance] = corrected(n, sums.mean[c], sums.m2[c], sums.m3[c]);
            (pixel.mean[c], pixel.variance[c]) = (mean as f32, (shrink * variance) as f32);
        }
        if let Some(f) = film.features(i).filter(|f| f.hits > 0) {
            let [[nx, ny, nz, r, g, b, _], _] = feature_moments(&f, 1.0);
            (pixel.normal, pixel.albedo) = ([nx, ny, nz], [r, g, b]);
        }
        let of_mean = |moments: RgbMoments| Some(moments.variance()?.iter().sum::<f64>() / 3.0 / n);
        pixel.error = of_mean(film.moments(i)).unwrap_or(0.0).min(f64::from(f32::MAX)) as f32;
        pixel
    }
}

/// The mean of `n` values corrected for skewness, and the variance of the mean; 0 for fewer than two values.
fn corrected(n: f64, mean: f64, m2: f64, m3: f64) -> [f64; 2] {
    if n < 2.0 {
        return [mean, 0.0];
    }
    let variance = m2 / (n - 1.0);
    let skew = if variance > LEAST_VARIANCE { m3 / (6.0 * variance * n * n) } else { 0.0 };
    [mean + skew, variance / n]
}

/// The largest sample variance for which means are not corrected.
const LEAST_VARIANCE: f64 = 1e-12;

/// The squared critical values of Student's distribution, by integer degrees of freedom.
#[derive(Clone, Debug)]
struct Criticals(Vec<f32>);

/// The largest degrees of freedom in the table. With more, the critical value is at most 0.3 % smaller.
const MOST_DEGREES: usize = 1024;

impl Criticals {
    fn new(level: f64) -> Self {
        Self((1..=MOST_DEGREES).map(|n| two_sided_critical(level, n as f64).powi(2) as f32).collect())
    }

    /// The squared critical value for these degrees of freedom, rounded down.
    fn squared(&self, freedom: f32) -> f32 {
        self.0[(freedom as usize).clamp(1, MOST_DEGREES) - 1]
    }

    /// Returns `true` if no channel distinguishes the two pixels. Pixels with fewer than two samples are not joined.
    fn join(&self, a: &WelchPixel, b: &WelchPixel, degrees: TestDegrees) -> bool {
        if a.count < 2.0 || b.count < 2.0 {
            return false;
        }
        // The degrees of freedom lie between these bounds, so most channels need no division.
        let most = self.squared(a.count + b.count - 2.0);
        let least = self.squared(a.count.min(b.count) - 1.0);
        (0..3).all(|c| {
            let (d, v) = (a.mean[c] - b.mean[c], a.variance[c] + b.variance[c]);
            let square = d * d;
            if square <= most * v {
                return true;
            }
            if degrees == TestDegrees::Counts || square > least * v || v <= 0.0 {
                return false;
            }
            let share = a.variance[c] / v;
            let rest = 1.0 - share;
            square <= v * self.squared(1.0 / (share * share / (a.count - 1.0) + rest * rest / (b.count - 1.0)))
        })
    }
}

impl FilterMethod for WelchOptions {
    const NAME: &'static str = "welch";
    const BYTES: usize = size_of::<WelchPixel>() + 32 + 16;
    const PLANES: ImagePlanes = ImagePlanes::RadianceAndError;

    fn needs(&self) -> Needs {
        Needs::none().with_variance().with_features()
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        SampleSums::RootMoments.list()
    }

    fn image(&self, film: &Film, (): &()) -> Result<Filtered, Error> {
        let size = film.frame().size().map(|n| n as usize);
        let sums = SampleSums::RootMoments.of(film, Self::NAME)?;
        let planes = per_pixel(film, |i| WelchPixel::new(film, i, &sums.moments(i), self.shrink));
        let around = Around { circle: self.circle(), criticals: Criticals::new(self.level) };
        let all: Vec<[f64; 4]> = parallel::map(planes.len(), |i| self.pixel(&planes, size, i, &around));
        let radiance = all.iter().map(|&[r, g, b, _]| [r as f32, g as f32, b as f32]).collect();
        let error: Vec<f32> = all.iter().map(|p| p[3] as f32).collect();
        Ok(Filtered::new(film.frame().size(), radiance).with_error(error))
    }
}

/// The value that `|t|` exceeds with probability `level`, for `freedom` degrees of freedom [after Hill 1970].
///
/// `level` lies in `(0, 1)`. Degrees of freedom need not be whole; those below 1 count as 1. The relative error is
/// below 1e-4.
pub(crate) fn two_sided_critical(level: f64, freedom: f64) -> f64 {
    let n = freedom.max(1.0);
    if n == 1.0 {
        return libm::cos(level * FRAC_PI_2) / libm::sin(level * FRAC_PI_2);
    }
    if n == 2.0 {
        return (2.0 / (level * (2.0 - level)) - 2.0).sqrt();
    }
    let a = 1.0 / (n - 0.5);
    let b = 48.0 / (a * a);
    let c = ((20_700.0 * a / b - 98.0) * a - 16.0) * a + 96.36;
    let d = ((94.5 / (b + c) - 3.0) / b + 1.0) * (a * FRAC_PI_2).sqrt() * n;
    let y = libm::pow(d * level, 2.0 / n);
    let ratio = if y > 0.05 + a {
        // Around the normal distribution.
        let x = -normal_critical(level);
        let y = x * x;
        let c = if n < 5.0 { c + 0.3 * (n - 4.5) * (x + 0.6) } else { c };
        let c = (((0.05 * d * x - 5.0) * x - 7.0) * x - 2.0) * x + b + c;
        let y = (((((0.4 * y + 6.3) * y + 36.0) * y + 94.5) / c - y - 3.0) / b + 1.0) * x;
        libm::expm1(a * y * y)
    } else {
        // The far tail.
        let inner = 1.0 / (((n + 6.0) / (n * y) - 0.089 * d - 0.822) * (n + 2.0) * 3.0) + 0.5 / (n + 4.0);
        (inner * y - 1.0) * (n + 1.0) / (n + 2.0) + 1.0 / y
    };
    (n * ratio).sqrt()
}

/// The value that the absolute value of a standard normal number exceeds with probability `level`, by Newton's
/// iteration on the logarithm of the tail.
pub(crate) fn normal_critical(level: f64) -> f64 {
    // A start above the root: the tail is below exp(-z^2 / 2).
    let mut z = (-2.0 * libm::log(level)).sqrt();
    for _ in 0..12 {
        let tail = libm::erfc(z / SQRT_2);
        let slope = (2.0 / std::f64::consts::PI).sqrt() * libm::exp(-0.5 * z * z) / tail;
        z = (z + libm::log(tail / level) / slope).max(0.0);
    }
    z
}
