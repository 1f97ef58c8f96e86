//! LDR-FLIP: how different two images look to somebody who flips between them on a display.

mod colour;
mod convolution;

use crate::compare::check;
use crate::sum::Sum;
use crate::{Error, Pixels};
use convolution::{Kernel, Plane};
use std::f64::consts::PI;

/// Pixels per degree of visual angle of a display 0.7 m wide with 3840 pixels across, seen from 0.7 m: what the
/// published implementation takes by default [after Andersson 2020].
///
/// Of a display `w` metres wide with `n` pixels across, seen from `d` metres, it is `d n / w * pi / 180`.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// The fewest and most pixels per degree that [`flip`] takes: the eye tells about 60 apart, and kernels grow with
/// them.
const PIXELS_PER_DEGREE_RANGE: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

/// What [`flip`] finds.
#[derive(Clone, Debug, PartialEq)]
pub struct Flip {
    /// Mean of the map.
    pub mean: f64,
    /// The difference seen at each pixel, 0 (none) to 1, row by row from the top.
    pub map: Vec<f32>,
}

/// LDR-FLIP [after Andersson 2020; values checked against the published implementation] of linear RGB as
/// displayed: clamped to 0..=1, not rounded to bytes.
///
/// `pixels_per_degree` says how the images are looked at ([`PIXELS_PER_DEGREE`] is usual). Symmetric. A non-finite channel of the image counts as 0, as in [`compare`](crate::compare). A figure for
/// viewing: whoever judges bias or convergence needs the squared errors.
///
/// # Errors
/// [`Error::Sizes`], [`Error::NonFiniteReference`]; [`Error::PixelsPerDegree`] where those are not
/// within 1..=1000.
pub fn flip(image: Pixels<'_>, reference: Pixels<'_>, pixels_per_degree: f64) -> Result<Flip, Error> {
    check(image, reference)?;
    if !PIXELS_PER_DEGREE_RANGE.contains(&pixels_per_degree) {
        return Err(Error::PixelsPerDegree { value: pixels_per_degree });
    }
    let eye = Eye::new(pixels_per_degree);
    let [image, reference] = [image, reference].map(|image| eye.see(image));
    let map: Vec<f32> = (0..image.edges.len()).map(|i| difference(&image, &reference, i)).collect();
    let sum: Sum = map.iter().map(|&v| f64::from(v)).collect();
    Ok(Flip { mean: sum.value() / map.len() as f64, map })
}

/// Exponent that compresses colour differences [after Andersson 2020].
const COLOUR_EXPONENT: f32 = 0.7;

/// The share of the largest colour difference from which differences are compressed further, and what that share is
/// mapped to [after Andersson 2020].
const COLOUR_KNEE: [f32; 2] = [0.4, 0.95];

/// Exponent of feature differences [after Andersson 2020].
const FEATURE_EXPONENT: f32 = 0.5;

/// [after Andersson 2020]: a feature difference raises the colour difference.
fn difference(image: &Seen, reference: &Seen, at: usize) -> f32 {
    let colour = compress(colour::hyab(image.colours[at], reference.colours[at]));
    let edges = (image.edges[at] - reference.edges[at]).abs();
    let points = (image.points[at] - reference.points[at]).abs();
    let feature = libm::powf(edges.max(points) * std::f32::consts::FRAC_1_SQRT_2, FEATURE_EXPONENT);
    if colour > 0.0 { libm::powf(colour, 1.0 - feature.min(1.0)) } else { 0.0 }
}

/// A colour distance to 0..=1, large ones taking little of that range.
fn compress(distance: f32) -> f32 {
    // The largest distance of displayed colours lies between green and blue.
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

/// An image as the eye sees it.
struct Seen {
    /// Filtered by contrast sensitivity, in L*a*b* with Hunt's adjustment.
    colours: Vec<[f32; 3]>,
    /// Strength of edges in the unfiltered lightness.
    edges: Vec<f32>,
    /// Strength of points, in the same way.
    points: Vec<f32>,
}

/// The kernels that belong to a way of looking at a display.
struct Eye {
    /// Contrast sensitivity of lightness, red-green, and blue-yellow's narrow and wide part; the last two add up.
    sensitivity: [Kernel; 4],
    /// Smoothing across a feature; first and second derivative along it.
    smooth: Kernel,
    edge: Kernel,
    point: Kernel,
}

impl Eye {
    fn new(pixels_per_degree: f64) -> Self {
        // Weight and width of each Gaussian [after Andersson 2020]; lightness and red-green have one only.
        let [lightness, red_green, narrow, wide] = [(1.0, 0.0047), (1.0, 0.0053), (34.1, 0.04), (13.5, 0.025)];
        // Three standard deviations of the widest.
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
        let gaussian = |(_, b): (f64, f64)| {
            Kernel::sample(radius, |i| libm::exp(-(PI * PI / b) * (f64::from(i) / pixels_per_degree).powi(2)))
        };
        // In two dimensions the parts weigh a sqrt(pi / b) times the squared sum of their taps.
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

    fn see(&self, image: Pixels<'_>) -> Seen {
        let size = image.size.map(|s| s as usize);
        let [lightness, red_green, blue_yellow] = colour::opponent_planes(image, size);
        let [edges, points] = self.features(&lightness);
        let [y, x, narrow, wide] = &self.sensitivity;
        let filter = |plane: &Plane, kernel| plane.across(kernel).down(kernel).values;
        let mut blue_yellow_seen = filter(&blue_yellow, narrow);
        blue_yellow_seen.iter_mut().zip(filter(&blue_yellow, wide)).for_each(|(sum, v)| *sum += v);
        let [lightness, red_green] = [filter(&lightness, y), filter(&red_green, x)];
        let opponents = lightness.into_iter().zip(red_green).zip(blue_yellow_seen);
        let colours = opponents.map(|((y, cx), cz)| colour::perceived([y, cx, cz])).collect();
        Seen { colours, edges, points }
    }

    /// Lengths of the gradient and of its counterpart for points.
    fn features(&self, lightness: &Plane) -> [Vec<f32>; 2] {
        // Lightness 0..=1 instead of -16..=100; the derivatives do not see the shift.
        let smooth = lightness.across(&self.smooth);
        [&self.edge, &self.point].map(|derivative| {
            let across = lightness.across(derivative).down(&self.smooth).values;
            let down = smooth.down(derivative).values;
            across.iter().zip(&down).map(|(x, y)| (x * x + y * y).sqrt() / 116.0).collect()
        })
    }
}
