//! A film's halves and features as planes (one value per pixel), in the form that the filters read.

use crate::among::{Among, Place};
use crate::cluster_gaussian::ClusterLookup;
use crate::error_map::Channels;
use crate::light::Light;
use crate::maps::{box_mean, map, parts, update};
use crate::membership::BACKGROUND;
use crate::single::{self, Halves, Lamps};
use crate::withheld::Bounds;
use dapple_core::{Error, Film, Filtered, RgbMoments};
use rayon::prelude::*;
use std::ops::Range;

/// One value per pixel, row by row.
pub(crate) type Plane = Vec<f32>;

/// The red, green and blue of each pixel, a plane each.
pub(crate) type Colours = [Plane; 3];

/// The number of feature channels: shading normal (3), albedo (3), logarithm of depth (1).
pub(crate) const FEATURES: usize = 7;

/// The largest radiance in units of the image's level (its mean brightness). Its fourth power fits `f32`.
pub(crate) const BRIGHTEST: f32 = 1e9;

/// The variance assumed for an unknown value, in units of the squared level (the image's mean brightness).
const UNKNOWN: f32 = 1e6;

/// The variance added to the variance of a sample, in units of the squared level. At one sample, differences of 2 % of
/// the level then count as noise. With more samples, that limit falls, so filters stay consistent.
const FLOOR: f32 = 4e-4;

/// The least albedo that colours are divided by.
const LEAST_ALBEDO: f32 = 0.02;

/// An albedo that a colour can be divided by: at least [`LEAST_ALBEDO`].
#[inline(always)]
pub(crate) fn raised(albedo: f32) -> f32 {
    albedo.max(LEAST_ALBEDO)
}

/// The weight, in degrees of freedom, of the variance over 5x5 pixels. A pixel's own variance of `n` samples has the
/// weight `n - 1`.
const POOLED: f32 = 6.0;

/// The rows of a film that [`Inputs::new`] reads above and below its own: features that neighbours fill in, slopes over 3x3 of
/// their steps, halves interpolated by both, and variances over 5x5 of these.
pub(crate) const ROWS_READ: usize = 7;

/// One half of a film's samples.
pub(crate) struct Half {
    /// The mean colours, divided by the level of the image ([`Inputs::level`]).
    pub(crate) colour: Colours,
    /// The variances of the mean colours, in squared levels. The variance of a sample is shrunk towards that of 5x5
    /// pixels.
    pub(crate) variance: Colours,
    /// The number of samples in each pixel.
    pub(crate) count: Plane,
}

/// The features of each pixel: those of the first rough surface. A miss has a zero normal, an albedo of 1 and a large depth.
pub(crate) struct Features {
    /// The mean normal (3 planes), albedo (3) and logarithm of depth (1).
    pub(crate) mean: [Plane; FEATURES],
    /// The variances of the mean normal, of the mean albedo (each summed over its channels) and of the mean logarithm
    /// of depth.
    pub(crate) variance: [Plane; 3],
    /// The variance of the mean position, summed over its coordinates.
    pub(crate) scatter: Plane,
    /// The change of the log depth per pixel, the smallest among 3x3 pixels.
    pub(crate) slope: Plane,
    /// The mean position, relative to the mean over the image.
    pub(crate) position: Colours,
    /// The reciprocal of the width that 24 pixels have at the pixel's depth.
    pub(crate) scale: Plane,
}

/// The statistics that a filter reads besides halves and variance.
#[derive(Clone, Copy)]
pub(crate) struct Reads<'a> {
    /// Features. Without, every pixel counts as a miss.
    pub(crate) features: bool,
    /// The cluster of each first hit, by this function.
    pub(crate) label: Option<&'a ClusterLookup>,
}

/// A film's halves, features and clusters as planes, which the filters read.
pub(crate) struct Inputs {
    /// Width and height of the planes: the own rows and their halo.
    pub(crate) size: [usize; 2],
    /// The rows of the planes in the whole image.
    pub(crate) place: Place,
    /// The image's level: the radiance (near the mean of the image) that is scaled to 1 in these planes.
    pub(crate) level: f32,
    /// The factor on bandwidths ([`Light::smoothness`]).
    pub(crate) smoothness: f32,
    /// True if a first regression precedes two wider ones ([`Light::has_first_pass`]).
    pub(crate) has_first_pass: bool,
    /// The largest light in these planes; the rest is withheld ([`Inputs::restored`]).
    bounds: Bounds,
    pub(crate) halves: [Half; 2],
    pub(crate) features: Features,
    /// The cluster of each pixel's first sample, modulo 2^24 - 3 so that an `f32` holds it; `None` without clusters.
    pub(crate) labels: Option<Plane>,
}

impl Inputs {
    /// Reads the halves and the sample variance of a film's light, and what else `reads` lists. The film's rows begin with
    /// row `top` of the whole image.
    pub(crate) fn new(light: Light<'_>, reads: Reads<'_>, top: usize, among: &mut Among<'_>) -> Result<Self, Error> {
        let film = light.film;
        let size = film.frame().size().map(|n| n as usize);
        let place = among.place(0, top);
        let features = features(film, reads.features, &place, among)?;
        let (level, bounds, halves) = colours(light, &features, &place, among)?;
        let labels = reads.label.filter(|_| film.needs().first_hits > 0).map(|label| {
            let of = |i: usize| film.first_hits(i).first()?.as_ref().and_then(|hit| label(hit));
            per_pixel(film, |i| (of(i).unwrap_or(BACKGROUND) % 0xff_fffd) as f32)
        });
        let (smoothness, has_first_pass) = (light.smoothness(), light.has_first_pass());
        Ok(Self { size, place, level, smoothness, has_first_pass, bounds, halves, features, labels })
    }

    /// Reads the colours of another part of the film's light. Features and clusters stay.
    pub(crate) fn read(&mut self, light: Light<'_>, among: &mut Among<'_>) -> Result<(), Error> {
        (self.level, self.bounds, self.halves) = colours(light, &self.features, &self.place, among)?;
        (self.smoothness, self.has_first_pass) = (light.smoothness(), light.has_first_pass());
        Ok(())
    }

    /// Planes of another scale for the same image, without clusters. Their number of rows follows from their length.
    pub(crate) fn with_planes(&self, place: Place, halves: [Half; 2], features: Features) -> Self {
        let width = self.size[0].div_ceil(2);
        let size = [width, features.scale.len() / width];
        let Self { level, smoothness, has_first_pass, bounds, .. } = *self;
        Self { size, place, level, smoothness, has_first_pass, bounds, halves, features, labels: None }
    }

    /// The number of bytes per pixel that these planes occupy, and the largest number while they are computed.
    pub(crate) const fn bytes_per_pixel(labels: bool) -> [usize; 2] {
        let (halves, labels) = (2 * 7, if labels { 1 } else { 0 });
        let features = FEATURES + 3 + 1 + 1 + 3 + 1;
        let kept = halves + features + labels;
        // The planes of halves are made after those of features, and their variances last.
        [4 * kept, 4 * (kept + single::PLANES)]
    }

    /// Adds the light that the filter did not get to the image that it made. Returns the own rows.
    pub(crate) fn restored(&self, light: Light<'_>, filtered: Filtered) -> Filtered {
        self.place.own_rows(self.bounds.restore(light, filtered))
    }

    /// Adds `light` to the colours of both halves.
    pub(crate) fn add(&mut self, light: &[Colours; 2]) {
        for (half, light) in self.halves.iter_mut().zip(light) {
            for (plane, light) in half.colour.iter_mut().zip(light) {
                update(plane, [light], |value, [light]| value + light);
            }
        }
    }

    /// The number of pixels.
    pub(crate) fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// The share of the first half in the samples of pixel `i`; 0.5 if the pixel has no samples.
    pub(crate) fn first_share(&self, i: usize) -> f32 {
        first_share(self.counts().map(|count| count[i]))
    }

    /// The number of samples in each pixel of both halves.
    pub(crate) fn counts(&self) -> [&[f32]; 2] {
        self.halves.each_ref().map(|half| &half.count[..])
    }

    /// The colours of both halves.
    pub(crate) fn unfiltered(&self) -> Channels<'_> {
        let [[ra, ga, ba], [rb, gb, bb]] = self.halves.each_ref().map(|half| &half.colour);
        [ra, ga, ba, rb, gb, bb]
    }
}

impl Features {
    /// One channel of the albedo of pixel `i`, [raised].
    pub(crate) fn divisor(&self, channel: usize, i: usize) -> f32 {
        raised(self.mean[3 + channel][i])
    }
}

/// The share of the first half in a pixel's samples; 0.5 if the pixel has no samples.
#[inline(always)]
pub(crate) fn first_share([a, b]: [f32; 2]) -> f32 {
    if a + b > 0.0 { a / (a + b) } else { 0.5 }
}

/// Computes `N` values for every pixel, each into a plane of its own.
pub(crate) fn planes_of<const N: usize>(pixels: usize, of: impl Fn(usize) -> [f32; N] + Sync + Send) -> [Plane; N] {
    const CHUNK: usize = 1024;
    let one = |(): &mut (), number: usize, mut part: [&mut [f32]; N]| {
        for k in 0..part[0].len() {
            let values = of(number * CHUNK + k);
            part.iter_mut().zip(values).for_each(|(plane, value)| plane[k] = value);
        }
    };
    parts(pixels, CHUNK, || (), one)
}

/// Computes a value for every pixel.
pub(crate) fn per_pixel<T: Send>(film: &Film, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..film.frame().pixels()).into_par_iter().with_min_len(1024).map(f).collect()
}

/// The image's level: the mean brightness of its pixels, each capped at eight times the median of pixels that are not
/// black. It is 1 for a black image.
pub(crate) fn level(light: Light<'_>, place: &Place, among: &mut Among<'_>) -> Result<f32, Error> {
    let width = light.film.frame().size()[0] as usize;
    let grey = per_pixel(light.film, |i| (light.mean(i).iter().sum::<f64>() / 3.0) as f32);
    let lit: Vec<f32> = grey[place.own_pixels(width)].iter().copied().filter(|g| *g > 0.0).collect();
    let Some(median) = among.in_order(&lit, |n| n / 2)? else { return Ok(1.0) };
    let cap = 8.0 * median;
    let [sum] = among.sum_pixels(place, width, |i| [f64::from(grey[i].min(cap))])?;
    // Not so small that a division by it overflows.
    Ok(((sum / (width * place.height) as f64) as f32).clamp(1e-18, 1e18))
}

/// The level of the light, the bounds of what filters get of it, and its halves.
fn colours(
    light: Light<'_>,
    features: &Features,
    place: &Place,
    among: &mut Among<'_>,
) -> Result<(f32, Bounds, [Half; 2]), Error> {
    let level = level(light, place, among)?;
    let bounds = Bounds::new(light, level, place, among)?;
    let mut halves = halves(light, level, bounds);
    let lamps = Lamps { light, bounds, level };
    let samples = halves.complete(features, &lamps, [light.film.frame().size()[0] as usize, place.top]);
    let mut halves = with_variances(light.film, halves, samples);
    refine(light, &mut halves);
    Ok((level, bounds, halves))
}

/// Lowers the variances of pixels whose emission samples of features alone refine. Variances over 5x5 pixels are made before:
/// beside such pixels lie some of the same edge that have none.
fn refine(light: Light<'_>, halves: &mut [Half; 2]) {
    let left = |i: usize| light.variance_left(i).map(|left| (i, left));
    let pixels = (0..light.film.frame().pixels()).into_par_iter().with_min_len(1024);
    let all: Vec<(usize, [f32; 3])> = pixels.filter_map(left).collect();
    for (i, left) in all {
        halves.iter_mut().for_each(|half| (0..3).for_each(|c| half.variance[c][i] *= left[c]));
    }
}

/// The halves of the samples, without the light that is withheld.
fn halves(light: Light<'_>, level: f32, bounds: Bounds) -> Halves {
    let unit = 1.0 / f64::from(level);
    let value = |x: f64| ((x * unit) as f32).min(BRIGHTEST);
    let most = f64::from(BRIGHTEST) * f64::from(BRIGHTEST);
    let of = |i: usize| {
        let halves = [0, 1].map(|half| light.half(half, i));
        let withheld = bounds.withheld_of_halves(light, i, &halves);
        let [[ra, ga, ba], [rb, gb, bb]] = [0, 1].map(|h: usize| {
            // A missing half takes the film's mean. Its variance is UNKNOWN.
            let mean = if halves[h].count > 0 { halves[h].mean } else { light.mean(i) };
            std::array::from_fn(|c| value(mean[c] - withheld[h][c]))
        });
        let [na, nb] = halves.map(|half| half.count as f32);
        let variance = light.variance(i);
        let known = f32::from(u8::from(variance.is_some()));
        let variance = variance.map_or([0.0; 3], |variance| without_withheld(&halves, &withheld, variance));
        let [vr, vg, vb] = variance.map(|v| (v * unit * unit).min(most) as f32);
        [ra, ga, ba, rb, gb, bb, na, nb, known, vr, vg, vb]
    };
    let [ra, ga, ba, rb, gb, bb, na, nb, known, vr, vg, vb] = planes_of(light.film.frame().pixels(), of);
    Halves { colours: [[ra, ga, ba], [rb, gb, bb]], counts: [na, nb], variance: [vr, vg, vb], known }
}

/// The halves with the variances of their colours: those of means of so many `samples`, or of the counts.
fn with_variances(film: &Film, halves: Halves, samples: Option<[Plane; 2]>) -> [Half; 2] {
    let Halves { colours: [first, second], counts: [na, nb], variance, known } = halves;
    let sample = pooled_variance(film, variance, &known);
    let variance = |samples: &Plane, sample: &Plane| -> Plane {
        let [plane] = map([sample, samples], |[v, n]| [if n > 0.0 { (v + FLOOR) / n } else { UNKNOWN }]);
        plane
    };
    let half = |h: usize, colour: Colours, count: Plane| {
        let samples = samples.as_ref().map_or(&count, |samples| &samples[h]);
        let variance = sample.each_ref().map(|sample| variance(samples, sample));
        Half { colour, variance, count }
    };
    [half(0, first, na), half(1, second, nb)]
}

/// The variance of one sample in each pixel, shrunk towards the variance over 5x5 pixels, in squared levels. `own` is the
/// variance where it is `known`.
fn pooled_variance(film: &Film, own: Colours, known: &Plane) -> Colours {
    let size = film.frame().size().map(|n| n as usize);
    let near = box_mean(known, size, 2);
    let freedom: Plane = per_pixel(film, |i| (film.count(i).max(1) - 1) as f32 * known[i]);
    own.map(|mut own| {
        let sums = box_mean(&own, size, 2);
        update(&mut own, [&sums, &near, &freedom], |own, [sum, near, freedom]| {
            let pooled = (freedom * own + POOLED * sum / near) / (freedom + POOLED);
            if near > 0.0 { pooled } else { UNKNOWN }
        });
        own
    })
}

/// The variance of one sample of a pixel without the light that is withheld, from the sample `variance`.
///
/// Withheld light varies at the edges of lamps. There the difference of the halves bounds the variance of the rest.
fn without_withheld([a, b]: &[RgbMoments; 2], withheld: &[[f64; 3]; 2], variance: [f64; 3]) -> [f64; 3] {
    if *withheld == [[0.0; 3]; 2] {
        return variance;
    }
    let share = a.count as f64 * b.count as f64 / (a.count + b.count).max(1) as f64;
    std::array::from_fn(|c| {
        let rest = a.mean[c] - withheld[0][c] - b.mean[c] + withheld[1][c];
        variance[c].min(rest * rest * share)
    })
}

/// The features of one pixel: means (normal, albedo, logarithm of depth, position), their variances, depth.
#[derive(Clone, Copy, Default)]
struct Feature {
    mean: [f32; 10],
    variance: [f32; 3],
    scatter: f32,
    depth: f32,
}

impl Feature {
    /// The features of a pixel that sees no surface.
    fn miss(far: f32) -> Self {
        let mean = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, ln(far), 0.0, 0.0, 0.0];
        Self { mean, depth: far, ..Self::default() }
    }
}

fn features(film: &Film, read: bool, place: &Place, among: &mut Among<'_>) -> Result<Features, Error> {
    let size = film.frame().size().map(|n| n as usize);
    let own = place.own_pixels(size[0]);
    let depths = per_pixel(film, |i| film.features(i).filter(|f| f.hits > 0).map(|f| f.depth.clamp(1e-18, 1e18)));
    let far = 2.0 * among.largest(depths[own.clone()].iter().flatten().copied().fold(0.5, f32::max))?;
    let middle = centre(film, place, among)?;
    let miss = (!read || !film.needs().features).then(|| Feature::miss(far));
    let of = |i: usize| miss.or_else(|| feature(film, i, far, middle));
    let filled = |i: usize| of(i).or_else(|| from_neighbours(of, size, i)).unwrap_or_default();
    let [nx, ny, nz, r, g, b, depth, x, y, z, vn, va, vd, scatter, mut scale] = planes_of(film.frame().pixels(), |i| {
        let Feature { mean: m, variance: [vn, va, vd], scatter, depth } = filled(i);
        [m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9], vn, va, vd, scatter, depth]
    });
    let position = [x, y, z];
    let unit = 24.0 * pixel_angle(&position, &scale, own, size[0], among)?;
    update(&mut scale, [], |depth, []| 1.0 / (unit * depth.max(1e-18)));
    let slope = slopes(&depth, size);
    let (mean, variance) = ([nx, ny, nz, r, g, b, depth], [vn, va, vd]);
    Ok(Features { mean, variance, scatter, slope, position, scale })
}

/// The mean of all positions, in f64 because they may lie far from the origin.
fn centre(film: &Film, place: &Place, among: &mut Among<'_>) -> Result<[f64; 3], Error> {
    let of = |i: usize| match film.features(i).filter(|f| f.hits > 0) {
        Some(feature) => {
            let [x, y, z] = feature.position.map(f64::from);
            [x, y, z, 1.0]
        }
        None => [0.0; 4],
    };
    let [x, y, z, count] = among.sum_pixels(place, film.frame().size()[0] as usize, of)?;
    Ok([x, y, z].map(|sum| sum / f64::max(count, 1.0)))
}

/// The features of pixel `i` with its misses blended in at the depth `far`, and positions relative to `middle`; `None`
/// without samples.
fn feature(film: &Film, i: usize, far: f32, middle: [f64; 3]) -> Option<Feature> {
    let f = film.features(i).filter(|f| f.samples > 0)?;
    let share = f.hits as f32 / f.samples as f32;
    let depth = if f.hits > 0 { f.depth.clamp(1e-18, far) } else { far };
    let [nx, ny, nz] = f.normal;
    let [r, g, b] = f.albedo;
    let position: [f32; 3] = std::array::from_fn(|k| (f64::from(f.position[k]) - middle[k]) as f32);
    let hit = [nx, ny, nz, r, g, b, ln(depth), position[0], position[1], position[2]];
    let miss = Feature::miss(far).mean;
    let mean: [f32; 10] =
        std::array::from_fn(|k| if f.hits > 0 { miss[k] + share * (hit[k] - miss[k]) } else { miss[k] });
    let mut within = f.variance.unwrap_or_default();
    let places = [within[6], within[7], within[8]];
    within[6] = within[9] / (depth * depth);
    (0..3).for_each(|k| within[7 + k] = places[k]);
    let spread = |k: usize| {
        let gap = if f.hits > 0 { hit[k] - miss[k] } else { 0.0 };
        (share * within[k] + share * (1.0 - share) * gap * gap) / f.samples as f32
    };
    let variance = [spread(0) + spread(1) + spread(2), spread(3) + spread(4) + spread(5), spread(6)];
    // Bounds that valid normals and albedos never reach; positions keep finite squares.
    let within = |k: usize| if k < 6 { mean[k].clamp(-16.0, 16.0) } else { mean[k].clamp(-1e18, 1e18) };
    let scatter = (spread(7) + spread(8) + spread(9)).min(1e30);
    Some(Feature { mean: std::array::from_fn(within), variance: variance.map(|v| v.min(UNKNOWN)), scatter, depth })
}

/// The natural logarithm of a positive normal number, with the same bits on every machine (the standard library's may
/// differ). Its error is at most 2 units in the last place of `max(1, |ln x|)`.
///
/// `x = 2^e m` with `m` in about 0.7 .. 1.4, and `ln m = 2 artanh((m - 1) / (m + 1))`. The series ends after the ninth
/// power; the remainder is below 1e-9.
fn ln(x: f32) -> f32 {
    /// The bits of the square root of 1/2, the least mantissa.
    const LEAST: u32 = 0x3f35_04f3;
    let exponent = (x.to_bits().wrapping_sub(LEAST) as i32) >> 23;
    let m = f32::from_bits(x.to_bits().wrapping_sub((exponent << 23) as u32));
    let s = (m - 1.0) / (m + 1.0);
    let q = s * s;
    let series = 2.0 * s * (1.0 + q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0)))));
    exponent as f32 * std::f32::consts::LN_2 + series
}

/// The mean of the known features among 5x5 pixels around pixel `i`; `None` if none are known.
fn from_neighbours(known: impl Fn(usize) -> Option<Feature>, [width, height]: [usize; 2], i: usize) -> Option<Feature> {
    let (x, y) = (i % width, i / width);
    let mut sum = Feature::default();
    let mut count = 0.0f32;
    for row in y.saturating_sub(2)..(y + 3).min(height) {
        for f in (x.saturating_sub(2)..(x + 3).min(width)).filter_map(|x| known(row * width + x)) {
            (0..10).for_each(|k| sum.mean[k] += f.mean[k]);
            (0..3).for_each(|k| sum.variance[k] += f.variance[k]);
            sum.scatter += f.scatter;
            sum.depth += f.depth;
            count += 1.0;
        }
    }
    let mean = Feature {
        mean: sum.mean.map(|m| m / count),
        variance: sum.variance,
        scatter: sum.scatter,
        depth: sum.depth / count,
    };
    (count > 0.0).then_some(mean)
}

/// The approximate width of a pixel at distance 1: the lower quartile of the steps between neighbouring positions.
fn pixel_angle(
    position: &Colours,
    depth: &[f32],
    own: Range<usize>,
    width: usize,
    among: &mut Among<'_>,
) -> Result<f32, Error> {
    let step = |i: usize| {
        let apart = position.iter().map(|p| (p[i + 1] - p[i]).powi(2)).sum::<f32>().sqrt();
        (apart > 0.0).then(|| apart / depth[i])
    };
    let steps: Vec<f32> = own.filter(|i| !(i + 1).is_multiple_of(width)).filter_map(step).collect();
    Ok(among.in_order(&steps, |n| n / 4)?.map_or(1e-3, |quarter| quarter.clamp(1e-9, 1e9)))
}

/// The smallest change of the log `depth` per pixel among 3x3 pixels.
pub(crate) fn slopes(depth: &[f32], size: [usize; 2]) -> Plane {
    let [width, height] = size;
    let near = |k: usize, end: usize| [k.saturating_sub(1), (k + 1).min(end - 1)];
    let gradient = |y: usize, row: &mut [f32]| {
        let [above, below] = near(y, height).map(|row| &depth[row * width..][..width]);
        let own = &depth[y * width..][..width];
        for (x, value) in row.iter_mut().enumerate() {
            let [left, right] = near(x, width);
            *value = 0.5 * (own[right] - own[left]).abs().max((below[x] - above[x]).abs());
        }
    };
    let mut all = vec![0.0; depth.len()];
    all.par_chunks_mut(width).enumerate().for_each(|(y, row)| gradient(y, row));
    let mut smallest = vec![0.0; depth.len()];
    smallest.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let [above, below] = near(y, height).map(|row| &all[row * width..][..width]);
        let own = &all[y * width..][..width];
        let least: Plane = above.iter().zip(own).zip(below).map(|((a, o), b)| a.min(*o).min(*b)).collect();
        for (x, value) in row.iter_mut().enumerate() {
            let [left, right] = near(x, width);
            *value = least[left].min(least[x]).min(least[right]);
        }
    });
    smallest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_are_accurate() {
        let near_one = (0..20_000).map(|k| 0.5 + k as f32 * 1e-4);
        let all =
            (-59..=59).map(|e| 2.0f32.powi(e) * 1.1).chain(near_one).chain([1e-18, 1e18, 2e18, f32::MIN_POSITIVE]);
        for x in all {
            let (got, wanted) = (f64::from(ln(x)), f64::from(x).ln());
            assert!((got - wanted).abs() <= 2.4e-7 * wanted.abs().max(1.0), "{x}: {got}, not {wanted}");
        }
        assert_eq!(ln(1.0), 0.0);
    }
}
