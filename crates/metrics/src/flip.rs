//! LDR-FLIP: the visible difference of two images that alternate on a display.

use crate::compare::check;
use crate::sum::Sum;
use crate::{MetricsError, Pixels};
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
        return Err(MetricsError::PixelsPerDegree(pixels_per_degree));
    }
    let kernels = VisionKernels::new(pixels_per_degree);
    let [image, reference] = [image, reference].map(|image| kernels.apply(image));
    let map: Vec<f32> = (0..image.edges.len()).map(|i| pixel_difference(&image, &reference, i)).collect();
    let sum: Sum = map.iter().map(|&v| f64::from(v)).collect();
    Ok(Flip { mean: sum.value() / map.len() as f64, map })
}

/// Exponent that compresses colour differences [after Andersson 2020].
const COLOUR_EXPONENT: f32 = 0.7;

/// The knee of the curve that compresses colour differences: its input, as a fraction of the largest difference, and its
/// output [after Andersson 2020].
const COLOUR_KNEE: [f32; 2] = [0.4, 0.95];

/// Exponent of feature differences [after Andersson 2020].
const FEATURE_EXPONENT: f32 = 0.5;

/// The FLIP difference of the pixel at index `at`, 0 to 1: a feature difference raises the colour difference [after
/// Andersson 2020].
fn pixel_difference(image: &PerceivedImage, reference: &PerceivedImage, at: usize) -> f32 {
    let colour = compress(hyab(image.colours[at], reference.colours[at]));
    let edges = (image.edges[at] - reference.edges[at]).abs();
    let points = (image.points[at] - reference.points[at]).abs();
    let feature = libm::powf(edges.max(points) * std::f32::consts::FRAC_1_SQRT_2, FEATURE_EXPONENT);
    if colour > 0.0 { libm::powf(colour, 1.0 - feature.min(1.0)) } else { 0.0 }
}

/// Maps a colour distance to 0..=1 and compresses large distances.
fn compress(distance: f32) -> f32 {
    // The largest distance of displayed colours, that of green and blue.
    let largest = libm::powf(LARGEST_DISTANCE, COLOUR_EXPONENT);
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
    /// The Gaussian that smooths at right angles to a derivative. `edge` is the kernel of first derivatives, `point` of
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
        let [lightness, red_green, blue_yellow] = opponent_planes(image, size);
        let [edges, points] = self.features(&lightness);
        let [y, x, narrow, wide] = &self.sensitivity;
        let filter = |plane: &Plane, kernel| plane.across(kernel).down(kernel).values;
        let mut blue_yellow_filtered = filter(&blue_yellow, narrow);
        blue_yellow_filtered.iter_mut().zip(filter(&blue_yellow, wide)).for_each(|(sum, v)| *sum += v);
        let [lightness, red_green] = [filter(&lightness, y), filter(&red_green, x)];
        let opponents = lightness.into_iter().zip(red_green).zip(blue_yellow_filtered);
        let colours = opponents.map(|((y, cx), cz)| perceived([y, cx, cz])).collect();
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

/// The matrix from linear sRGB to CIE XYZ, rounded as in the published implementation.
const XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// The matrix from linear sRGB to XYZ relative to white; each row adds up to 1.
const RELATIVE_XYZ: [[f32; 3]; 3] = {
    let mut rows = [[0.0; 3]; 3];
    let mut i = 0;
    while i < 9 {
        let [row, c] = [i / 3, i % 3];
        rows[row][c] = (XYZ[row][c] / (XYZ[row][0] + XYZ[row][1] + XYZ[row][2])) as f32;
        i += 1;
    }
    rows
};

/// The inverse of [`RELATIVE_XYZ`]: from XYZ relative to white to linear sRGB. Its columns are cross products of two rows,
/// divided by the determinant.
const RGB: [[f32; 3]; 3] = {
    const fn cross(a: [f32; 3], b: [f32; 3], c: usize) -> f64 {
        let [i, j] = [(c + 1) % 3, (c + 2) % 3];
        a[i] as f64 * b[j] as f64 - a[j] as f64 * b[i] as f64
    }
    let m = RELATIVE_XYZ;
    let first = [cross(m[1], m[2], 0), cross(m[1], m[2], 1), cross(m[1], m[2], 2)];
    let determinant = m[0][0] as f64 * first[0] + m[0][1] as f64 * first[1] + m[0][2] as f64 * first[2];
    let mut inverse = [[0.0; 3]; 3];
    let mut i = 0;
    while i < 9 {
        let [row, c] = [i / 3, i % 3];
        inverse[c][row] = (cross(m[(row + 1) % 3], m[(row + 2) % 3], c) / determinant) as f32;
        i += 1;
    }
    inverse
};

/// The largest distance of displayable colours: [`hyab`] between [`perceived`] green and blue.
const LARGEST_DISTANCE: f32 = 203.301_62;

fn times(matrix: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Converts linear RGB to YCxCz, the linear version of L*a*b*: lightness, red-green and blue-yellow.
fn opponent(rgb: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = times(&RELATIVE_XYZ, rgb);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Clamps an image to 0..=1 and converts it to YCxCz ([`opponent`]), one plane per channel.
fn opponent_planes(image: Pixels<'_>, size: [usize; 2]) -> [Plane; 3] {
    let mut planes = [(); 3].map(|()| Plane { size, values: Vec::with_capacity(image.values.len()) });
    for rgb in image.values {
        let displayed = rgb.map(|v| if v.is_finite() { v.clamp(0.0, 1.0) } else { 0.0 });
        planes.iter_mut().zip(opponent(displayed)).for_each(|(plane, v)| plane.values.push(v));
    }
    planes
}

/// Converts a YCxCz colour (from [`opponent`]), clamped to the display's gamut, to L*a*b*. Chroma is scaled by
/// lightness (the Hunt effect) [after Andersson 2020].
fn perceived([lightness, red_green, blue_yellow]: [f32; 3]) -> [f32; 3] {
    let y = (lightness + 16.0) / 116.0;
    let rgb = times(&RGB, [y + red_green / 500.0, y, y - blue_yellow / 200.0]);
    let [x, y, z] = times(&RELATIVE_XYZ, rgb.map(|v| v.clamp(0.0, 1.0))).map(response);
    let lightness = 116.0 * y - 16.0;
    let chroma = 0.01 * lightness;
    [lightness, chroma * 500.0 * (x - y), chroma * 200.0 * (y - z)]
}

/// The nonlinear curve of L*a*b* [after CIE 15:2004]: a cube root, and a line below (6/29)^3.
fn response(t: f32) -> f32 {
    const KNEE: f32 = 6.0 / 29.0;
    if t > KNEE * KNEE * KNEE { libm::cbrtf(t) } else { t / (3.0 * KNEE * KNEE) + 4.0 / 29.0 }
}

/// The HyAB distance of two L*a*b* colours, meant for large differences: the sum of the lightness difference and the
/// Euclidean chroma difference [after Abasi 2020].
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [lightness, red_green, blue_yellow] = std::array::from_fn(|c| a[c] - b[c]);
    lightness.abs() + (red_green * red_green + blue_yellow * blue_yellow).sqrt()
}

/// A one-dimensional convolution kernel, with taps at the offsets `-radius..=radius`.
struct Kernel {
    taps: Vec<f64>,
}

impl Kernel {
    fn sample(radius: i32, value: impl Fn(i32) -> f64) -> Self {
        Self { taps: (-radius..=radius).map(value).collect() }
    }

    fn sum(&self) -> f64 {
        self.taps.iter().sum()
    }

    fn scale(&mut self, by: f64) {
        self.taps.iter_mut().for_each(|tap| *tap *= by);
    }

    /// Scales the kernel so that positive taps add up to 1 and negative ones to -1.
    fn normalised(mut self) -> Self {
        let sum = |sign: f64| self.taps.iter().map(|tap| (tap * sign).max(0.0)).sum::<f64>();
        let [positive, negative] = [sum(1.0), sum(-1.0)];
        self.taps
            .iter_mut()
            .for_each(|tap| *tap /= if *tap > 0.0 { positive } else { negative.max(f64::MIN_POSITIVE) });
        self
    }

    fn radius(&self) -> usize {
        self.taps.len() / 2
    }

    /// The taps larger than 1e-12 times the largest tap, with their offsets from the first tap. Smaller taps do not change an
    /// f32 sum.
    fn effective(&self) -> impl Iterator<Item = (usize, f32)> {
        let largest = self.taps.iter().fold(0.0, |m: f64, t| m.max(t.abs()));
        self.taps.iter().map(|&t| t as f32).enumerate().filter(move |(_, t)| f64::from(t.abs()) > 1e-12 * largest)
    }
}

/// One f32 value per pixel, row by row.
struct Plane {
    size: [usize; 2],
    values: Vec<f32>,
}

impl Plane {
    /// Returns the plane convolved along its rows.
    fn across(&self, kernel: &Kernel) -> Plane {
        let [width, radius] = [self.size[0], kernel.radius()];
        let mut values = vec![0.0; self.values.len()];
        let mut padded = vec![0.0; width + 2 * radius];
        for (row, out) in self.values.chunks_exact(width).zip(values.chunks_exact_mut(width)) {
            padded[..radius].fill(row[0]);
            padded[radius..radius + width].copy_from_slice(row);
            padded[radius + width..].fill(row[width - 1]);
            for (first, tap) in kernel.effective() {
                add(out, &padded[first..first + width], tap);
            }
        }
        Plane { size: self.size, values }
    }

    /// Returns the plane convolved along its columns.
    fn down(&self, kernel: &Kernel) -> Plane {
        let [width, height] = self.size;
        let mut values = vec![0.0; self.values.len()];
        for (y, out) in values.chunks_exact_mut(width).enumerate() {
            for (offset, tap) in kernel.effective() {
                let from = (y + offset).saturating_sub(kernel.radius()).min(height - 1);
                add(out, &self.values[from * width..][..width], tap);
            }
        }
        Plane { size: self.size, values }
    }
}

fn add(out: &mut [f32], row: &[f32], tap: f32) {
    out.iter_mut().zip(row).for_each(|(out, v)| *out += tap * v);
}
