//! LDR-FLIP: the visible difference of two images that alternate on a display.

mod colour;
mod convolution;

use crate::compare::check;
use crate::sum::Sum;
use crate::{MetricsError, Pixels};
use convolution::{Kernel, Plane};
use std::f64::consts::PI;

/// The pixels per degree of visual angle of a display 0.7 m wide with 3840 pixels across, seen from 0.7 m. This is the
/// default of the published implementation [after Andersson 2020].
///
/// A display `w` metres wide with `n` pixels across, seen from `d` metres, has `d n / w * pi / 180` pixels per degree.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// The range of pixels per degree that [`flip`] accepts. The eye resolves about 60; filter kernels grow with the value.
const PIXELS_PER_DEGREE_RANGE: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

/// A difference map and its mean, from [`flip`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Flip {
    /// The mean of the difference map, 0 to 1.
    pub mean: f64,
    /// The visible difference at each pixel, 0 (none) to 1, row by row from the top.
    pub map: Vec<f32>,
}

/// LDR-FLIP of an image against its reference, both linear RGB, clamped to 0..=1 and not rounded to bytes [after
/// Andersson 2020].
///
/// Tested against the published implementation. Exchanging image and reference does not change the result.
/// `pixels_per_degree` describes the display and its distance ([`PIXELS_PER_DEGREE`] is usual). A non-finite channel of
/// the image counts as 0, as in [`compare`](crate::compare). FLIP measures visibility; use squared errors for bias and
/// convergence.
///
/// ```
/// # use dapple_metrics::{PIXELS_PER_DEGREE, Pixels, flip};
/// let (black, white) = ([[0.0; 3]; 4], [[1.0; 3]; 4]);
/// let found = flip(Pixels::new([2, 2], &white)?, Pixels::new([2, 2], &black)?, PIXELS_PER_DEGREE)?;
/// assert!((found.mean - 0.967).abs() < 1e-3);
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
///
/// # Errors
/// [`MetricsError::Sizes`]; [`MetricsError::NonFiniteReference`]; [`MetricsError::PixelsPerDegree`] outside 1..=1000.
pub fn flip(image: Pixels<'_>, reference: Pixels<'_>, pixels_per_degree: f64) -> Result<Flip, MetricsError> {
    check(image, reference)?;
    if !PIXELS_PER_DEGREE_RANGE.contains(&pixels_per_degree) {
        return Err(MetricsError::PixelsPerDegree { value: pixels_per_degree });
    }
    let kernels = VisionKernels::new(pixels_per_degree);
    let [image, reference] = [image, reference].map(|image| kernels.apply(image));
    let map: Vec<f32> = (0..image.edges.len()).map(|i| pixel_difference(&image, &reference, i)).collect();
    let sum: Sum = map.iter().map(|&v| f64::from(v)).collect();
    Ok(Flip { mean: sum.value() / map.len() as f64, map })
}

/// Exponent that compresses colour differences [after Andersson 2020].
const COLOUR_EXPONENT: f32 = 0.7;

/// The knee of the compression of colour differences: its place as a fraction of the largest difference, and its
/// compressed value [after Andersson 2020].
const COLOUR_KNEE: [f32; 2] = [0.4, 0.95];

/// Exponent of feature differences [after Andersson 2020].
const FEATURE_EXPONENT: f32 = 0.5;

/// The FLIP difference of the pixel at index `at`, 0 to 1: a feature difference raises the colour difference [after
/// Andersson 2020].
fn pixel_difference(image: &PerceivedImage, reference: &PerceivedImage, at: usize) -> f32 {
    let colour = compress(colour::hyab(image.colours[at], reference.colours[at]));
    let edges = (image.edges[at] - reference.edges[at]).abs();
    let points = (image.points[at] - reference.points[at]).abs();
    let feature = libm::powf(edges.max(points) * std::f32::consts::FRAC_1_SQRT_2, FEATURE_EXPONENT);
    if colour > 0.0 { libm::powf(colour, 1.0 - feature.min(1.0)) } else { 0.0 }
}

/// Maps a colour distance to 0..=1 and compresses large distances.
fn compress(distance: f32) -> f32 {
    // The largest distance of displayed colours, that of green and blue.
    let largest = libm::powf(colour::LARGEST_DISTANCE, COLOUR_EXPONENT);
    let distance = libm::powf(distance, COLOUR_EXPONENT);
    let [share, value] = COLOUR_KNEE;
    let knee = share * largest;
    if distance < knee {
        value / knee * distance
    } else {
        (value + (distance - knee) / (largest - knee) * (1.0 - value)).min(1.0)
    }
}

/// An image filtered by a model of human vision.
struct PerceivedImage {
    /// Colours in L*a*b* with Hunt's adjustment, after filtering by contrast sensitivity.
    colours: Vec<[f32; 3]>,
    /// Strength of edges in each pixel of the unfiltered lightness.
    edges: Vec<f32>,
    /// Strength of points in each pixel of the unfiltered lightness.
    points: Vec<f32>,
}

/// The filter kernels for a given number of pixels per degree.
struct VisionKernels {
    /// The kernels of contrast sensitivity for lightness, red-green and blue-yellow. The last two both filter
    /// blue-yellow, and their results are added.
    sensitivity: [Kernel; 4],
    /// The Gaussian that smooths at right angles to a derivative. `edge` takes the first derivative, `point` the
    /// second.
    smooth: Kernel,
    edge: Kernel,
    point: Kernel,
}

impl VisionKernels {
    fn new(pixels_per_degree: f64) -> Self {
        // Weight and width of each Gaussian [after Andersson 2020]; lightness and red-green have one each.
        let [lightness, red_green, narrow, wide] = [(1.0, 0.0047), (1.0, 0.0053), (34.1, 0.04), (13.5, 0.025)];
        // Three standard deviations of the widest.
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
        let gaussian = |(_, b): (f64, f64)| {
            Kernel::sample(radius, |i| libm::exp(-(PI * PI / b) * (f64::from(i) / pixels_per_degree).powi(2)))
        };
        // In two dimensions a part weighs a sqrt(pi / b) times the squared sum of its taps.
        let weight = |(a, b), kernel: &Kernel| a * f64::sqrt(PI / b) * kernel.sum().powi(2);
        let [mut one, mut other] = [gaussian(narrow), gaussian(wide)];
        let [first, second] = [weight(narrow, &one), weight(wide, &other)];
        for (kernel, weight) in [(&mut one, first), (&mut other, second)] {
            kernel.scale(((weight / (first + second)).sqrt()) / kernel.sum());
        }
        let sensitivity = [gaussian(lightness).normalised(), gaussian(red_green).normalised(), one, other];
        // Features are as wide as 0.082 degrees [after Andersson 2020].
        let deviation = 0.5 * 0.082 * pixels_per_degree;
        let radius = (3.0 * deviation).ceil() as i32;
        let bell = |x: f64| libm::exp(-x * x / (2.0 * deviation * deviation));
        let feature = |f: &dyn Fn(f64) -> f64| Kernel::sample(radius, |i| f(i.into()) * bell(i.into())).normalised();
        Self {
            sensitivity,
            smooth: feature(&|_| 1.0),
            edge: feature(&|x| -x),
            point: feature(&|x| x * x / (deviation * deviation) - 1.0),
        }
    }

    fn apply(&self, image: Pixels<'_>) -> PerceivedImage {
        let size = image.size.map(|s| s as usize);
        let [lightness, red_green, blue_yellow] = colour::opponent_planes(image, size);
        let [edges, points] = self.features(&lightness);
        let [y, x, narrow, wide] = &self.sensitivity;
        let filter = |plane: &Plane, kernel| plane.across(kernel).down(kernel).values;
        let mut blue_yellow_filtered = filter(&blue_yellow, narrow);
        blue_yellow_filtered.iter_mut().zip(filter(&blue_yellow, wide)).for_each(|(sum, v)| *sum += v);
        let [lightness, red_green] = [filter(&lightness, y), filter(&red_green, x)];
        let opponents = lightness.into_iter().zip(red_green).zip(blue_yellow_filtered);
        let colours = opponents.map(|((y, cx), cz)| colour::perceived([y, cx, cz])).collect();
        PerceivedImage { colours, edges, points }
    }

    /// The strength of edges (length of the gradient) and of points (length of the second derivatives) in each pixel.
    fn features(&self, lightness: &Plane) -> [Vec<f32>; 2] {
        // The division by 116 scales lightness from -16..=100 to a range of 1; derivatives ignore the shift.
        let smooth = lightness.across(&self.smooth);
        [&self.edge, &self.point].map(|derivative| {
            let across = lightness.across(derivative).down(&self.smooth).values;
            let down = smooth.down(derivative).values;
            across.iter().zip(&down).map(|(x, y)| (x * x + y * y).sqrt() / 116.0).collect()
        })
    }
}
