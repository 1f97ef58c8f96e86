//! Warnings about buffers and films that look wrong, found by comparing numbers that should agree.

use super::film::brightness;
use super::{ALBEDO, Denoise, Feature, NORMAL, SampleBuffers, Variance};
use dapple_core::{Film, film::Features};
use std::collections::BTreeMap;
use std::fmt;

/// A likely mistake in the buffers of an image or in a film; [`Denoise::warnings`] and [`warnings_of`] list them.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum Warning {
    /// Noise between pixels that contradicts the given variance.
    Noise {
        /// The variance measured between neighbouring pixels, divided by the given variance.
        factor: f64,
        /// The median number of samples per pixel.
        count: u64,
        /// `true` if the given variance is the variance of the mean.
        of_mean: bool,
    },
    /// Variances that are all 0, although pixels differ.
    NoVariance,
    /// Halves that differ less than their variances imply.
    AlikeHalves {
        /// The squared difference of the halves, divided by the sum of their variances.
        factor: f64,
    },
    /// Width and height that seem swapped: rows of `height` pixels fit better than rows of `width` pixels.
    ExchangedSize,
    /// Normals longer than 1, or too few of unit length.
    Normals,
    /// Albedos outside 0 to 1.
    Albedo {
        /// The affected fraction of the pixels.
        share: f64,
    },
    /// Emission above the radiance that should contain it.
    Emission {
        /// The fraction of the pixels with emission.
        share: f64,
    },
    /// Normals that look like albedo, and albedo that looks like normals.
    ExchangedFeatures,
    /// Depths of 0 or less where a surface was hit.
    Depth {
        /// The fraction of the pixels with hits.
        share: f64,
    },
    /// Pixels whose mean is NaN or infinite, or whose samples were all rejected. They are filled from their neighbours.
    Filled {
        /// The number of pixels.
        pixels: usize,
    },
    /// A pixel that is brighter than all others together.
    Huge {
        /// The column and row of the pixel.
        pixel: [u32; 2],
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Noise { factor, count, of_mean } => {
                let n = *count as f64;
                let is_near = |x: f64| n > 2.0 && (0.4..2.5).contains(&(factor / x));
                let why = if is_near(n * n) {
                    "as if the means were sums over samples; divide the means by the sample counts"
                } else if is_near(n) && !of_mean {
                    "as if the variance of the mean were given, not that of one sample; use Variance::OfMean"
                } else if is_near(1.0 / n) && *of_mean {
                    "as if the variance of one sample were given, not that of the mean; use Variance::OfSamples"
                } else if *factor < 1.0 {
                    "as if pixels shared samples (a wide pixel filter); render with a box filter one pixel wide"
                } else {
                    "so the variance may belong to another image; pass the variance of this image's samples"
                };
                write!(f, "the noise between pixels has {factor:.3} times the given variance, {why}")
            }
            Self::NoVariance => write!(f, "all variances are 0, but pixels differ; pass the variance of the samples"),
            Self::AlikeHalves { factor } => write!(
                f,
                "the squared difference of the halves is {factor:.3} times what their variances imply; render the halves with different seeds"
            ),
            Self::ExchangedSize => write!(f, "width and height seem swapped; pass the size as [width, height]"),
            Self::Normals => write!(
                f,
                "normals are not of unit length; pass unit vectors, or shorter ones where normals vary within a pixel"
            ),
            Self::Albedo { share } => {
                write!(f, "the albedo is outside 0 to 1 in {:.1} % of the pixels; pass reflectances", 100.0 * share)
            }
            Self::Emission { share } => write!(
                f,
                "the emission is above the radiance in {:.1} % of the emitting pixels, as if both came from different samples; pass the emission of the image's own samples, or none",
                100.0 * share
            ),
            Self::ExchangedFeatures => {
                write!(f, "the normals look like albedo, and the albedo looks like normals; swap the two buffers")
            }
            Self::Depth { share } => {
                write!(f, "the depth is 0 or less in {:.1} % of the hits; pass distances above 0", 100.0 * share)
            }
            Self::Filled { pixels } => {
                write!(f, "pixels without a finite sample are filled from their neighbours: {pixels}")
            }
            Self::Huge { pixel: [x, y] } => {
                write!(f, "pixel ({x}, {y}) is brighter than all others together; check the samples of this pixel")
            }
        }
    }
}

/// The factor between measured and given variance that causes a warning. Differences of neighbours also contain texture, but
/// the 20 % of the pixels with the smallest differences contain little.
const OFF: f64 = 4.0;
/// The 20 % quantile of squared standard normal numbers.
const FIFTH: f64 = 0.0642;
/// The factor by which the steps between rows must shrink when width and height are swapped.
const FITS: f64 = 0.6;

/// The smallest number of distinct means for which halves are compared.
const MEANS: usize = 100;

impl std::error::Error for Warning {}

/// Lists the warnings about an image.
pub(super) fn warnings(image: &Denoise<'_>) -> Vec<Warning> {
    let mut found = Vec::new();
    found.extend(of_samples(image));
    found.extend(of_halves(image));
    found.extend(of_size(image));
    found.extend(of_buffers(image));
    found.extend(of_emission(image));
    found
}

fn grey([r, g, b]: [f32; 3]) -> f64 {
    (f64::from(r) + f64::from(g) + f64::from(b)) / 3.0
}

/// The variance of a pixel's grey mean, if all channels have the same noise; `None` if it is unknown.
fn variance(set: &SampleBuffers<'_>, i: usize) -> Option<f64> {
    let count = set.samples(i);
    let [r, g, b] = set.variance?.of_sample(i, count);
    (count > 0).then(|| (r + g + b) / 3.0 / count as f64)
}

/// The 20 % quantile of the finite values; `None` for fewer than 100.
fn fifth(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    let place = values.len() / 5;
    (values.len() >= 100).then(|| *values.select_nth_unstable_by(place, f64::total_cmp).1)
}

fn of_samples(image: &Denoise<'_>) -> Vec<Warning> {
    let (mut found, set, width) = (Vec::new(), &image.first, image.size[0] as usize);
    let pixels = set.mean.len();
    let is_filled = |set: &SampleBuffers<'_>, i: usize| set.count.of(i) > 0 && set.samples(i) == 0;
    let filled =
        (0..pixels).filter(|i| is_filled(set, *i) || image.second.is_some_and(|set| is_filled(&set, *i))).count();
    if filled > 0 {
        found.push(Warning::Filled { pixels: filled });
    }
    let bright = |i: usize| {
        let sets = std::iter::once(*set).chain(image.second);
        sets.map(|set| grey(set.mean[i])).filter(|x| x.is_finite()).sum::<f64>()
    };
    found.extend(huge(([0; 2], width), pixels, bright));
    let Some(given) = set.variance else { return found };
    let differ = set.mean.iter().any(|colour| Some(colour) != set.mean.first());
    if differ && given.flat().values().iter().all(|v| *v == 0.0) {
        found.push(Warning::NoVariance);
        return found;
    }
    // The second difference of three pixels in a row, and its variance.
    let ratio = |i: usize| {
        let [left, own, right] = [i - 1, i, i + 1].map(|k| Some([grey(set.mean[k]), variance(set, k)?]));
        let ([a, va], [b, vb], [c, vc]) = (left?, own?, right?);
        let of_three = 0.25 * va + vb + 0.25 * vc;
        (of_three > 0.0).then(|| (b - 0.5 * (a + c)).powi(2) / of_three)
    };
    let inner = (0..pixels).filter(|i| i % width > 0 && (i + 1) % width > 0);
    if let Some(factor) = fifth(inner.filter_map(ratio)).map(|value| value / FIFTH)
        && !(1.0 / OFF..OFF).contains(&factor)
    {
        let mut counts: Vec<u64> = (0..pixels).map(|i| set.samples(i)).collect();
        let count = *counts.select_nth_unstable(pixels / 2).1;
        found.push(Warning::Noise { factor, count, of_mean: matches!(given, Variance::OfMean(_)) });
    }
    found
}

fn of_halves(image: &Denoise<'_>) -> Option<Warning> {
    let [a, b] = [image.first, image.second?];
    let ratio = |i: usize| {
        let both = variance(&a, i)? + variance(&b, i)?;
        (both > 0.0).then(|| (grey(a.mean[i]) - grey(b.mean[i])).powi(2) / both)
    };
    let factor = fifth((0..a.mean.len()).filter_map(ratio))? / FIFTH;
    (factor < 1.0 / OFF).then_some(Warning::AlikeHalves { factor })
}

/// Compares the steps from row to row with the steps that rows of `height` pixels would have.
fn of_size(image: &Denoise<'_>) -> Option<Warning> {
    let [width, height] = image.size.map(|n| n as usize);
    let step = |stride: usize| {
        let of = |values: &dyn Fn(usize) -> f64| {
            let steps = (0..(width * height).saturating_sub(stride)).map(|i| (values(i) - values(i + stride)).abs());
            steps.filter(|step| step.is_finite()).sum::<f64>() / (width * height - stride).max(1) as f64
        };
        let guide = [NORMAL, ALBEDO].iter().find_map(|place| image.features[*place]);
        match guide {
            Some(feature) => of(&|i| feature.colours()[i].map(f64::from)[i % 3]),
            None => of(&|i| grey(image.first.mean[i])),
        }
    };
    (width != height && step(height) < FITS * step(width)).then_some(Warning::ExchangedSize)
}

/// Compares the emission with the radiance that should contain it. At a light's edge, other samples hit the light more or less
/// often.
fn of_emission(image: &Denoise<'_>) -> Option<Warning> {
    let emission: Vec<f64> = image.emission?.iter().map(|colour| grey(*colour)).collect();
    let lit = emission.iter().filter(|emission| **emission > 0.0).count();
    let is_above = |(i, own): (usize, &f64)| image.first.samples(i) > 0 && *own > 1.01 * brightness(image, i);
    let above = emission.iter().enumerate().filter(|pixel| *pixel.1 > 0.0 && is_above(*pixel)).count();
    let share = above as f64 / lit.max(1) as f64;
    (share > 0.01).then_some(Warning::Emission { share })
}

/// Finds a pixel that is brighter than all others together. `origin` is the first pixel's column and row.
fn huge((origin, width): ([u32; 2], usize), pixels: usize, bright: impl Fn(usize) -> f64) -> Option<Warning> {
    let total: f64 = (0..pixels).map(|i| bright(i).max(0.0)).sum();
    let i = (0..pixels).find(|i| pixels > 1 && bright(*i) > 0.5 * total)?;
    Some(Warning::Huge { pixel: [origin[0] + (i % width) as u32, origin[1] + (i / width) as u32] })
}

fn length(v: [f32; 3]) -> f32 {
    v.iter().map(|x| x * x).sum::<f32>().sqrt()
}

fn of_buffers(image: &Denoise<'_>) -> Vec<Warning> {
    let known = |feature: Option<Feature<'_>>| {
        let colours = feature.map(|feature| feature.colours()).unwrap_or_default();
        colours.iter().copied().filter(|v| *v != [0.0; 3]).collect::<Vec<_>>()
    };
    let [normal, albedo, ..] = image.features;
    let normals: Vec<_> = known(normal).into_iter().map(|v| (v, length(v))).collect();
    of_features(&normals, &known(albedo), 0.1)
}

/// Compares normals, given with their lengths, with albedos. At least the fraction `unit` of the normals must be of unit
/// length.
fn of_features(normals: &[([f32; 3], f32)], albedos: &[[f32; 3]], unit: f64) -> Vec<Warning> {
    let (is_unit, is_within) =
        (|l: f32| (l - 1.0).abs() < 0.02, |v: &[f32; 3]| v.iter().all(|x| (-1e-3..=1.0 + 1e-3).contains(x)));
    let units = share(normals, |(_, l)| is_unit(*l));
    let outside = share(albedos, |v| !is_within(v));
    let is_like_normals = outside > Some(0.01) && share(albedos, |v| is_unit(length(*v))) > Some(0.9);
    if is_like_normals && share(normals, |(v, _)| is_within(v)) > Some(0.99) {
        return vec![Warning::ExchangedFeatures];
    }
    let wrong_normals = share(normals, |(_, l)| *l > 1.02) > Some(0.01) || units.is_some_and(|units| units < unit);
    let albedo = outside.filter(|share| *share > 0.01).map(|share| Warning::Albedo { share });
    wrong_normals.then_some(Warning::Normals).into_iter().chain(albedo).collect()
}

/// The fraction of the values for which `holds` returns `true`; `None` without values.
fn share<T>(values: &[T], holds: impl Fn(&T) -> bool) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().filter(|v| holds(v)).count() as f64 / values.len() as f64)
}

/// Lists likely mistakes in a film, such as the film of a [`Session`](dapple_core::Session). Examples: pixels without a valid
/// sample, a pixel brighter than all others together, the same samples in both halves, and features out of range.
///
/// ```
/// use dapple_core::{Estimate, Film, FirstHit, Frame, Needs};
/// use dapple_denoise::{Warning, warnings_of};
///
/// let mut film = Film::new(Frame::new(4, 1)?, Needs::none().with_features());
/// let hit = FirstHit::new([0.0; 3], [0.0, 0.0, 3.0], 1.0);
/// (0..4).for_each(|i| film.push_estimate(i, 0, &Estimate::new([0.5; 3]).with_first_hit(hit)));
/// assert_eq!(warnings_of(&film), [Warning::Normals]);
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub fn warnings_of(film: &Film) -> Vec<Warning> {
    let (pixels, place) = (film.frame().pixels(), (film.frame().origin(), film.frame().size()[0] as usize));
    let mut found = Vec::new();
    let filled = (0..pixels).filter(|i| film.is_rejected(*i)).count();
    found.extend((filled > 0).then_some(Warning::Filled { pixels: filled }));
    // A light seen directly may be brighter than everything else.
    let lamps = |i: usize| [0, 1].iter().filter_map(|half| film.emission(*half, i)).map(grey).fold(0.0, f64::max);
    found.extend(huge(place, pixels, |i| grey(film.mean(i).map(|x| x as f32)) - lamps(i)));
    found.extend(of_streams(film));
    let hits: Vec<Features> = (0..pixels).filter_map(|i| film.features(i)).filter(|f| f.hits > 0).collect();
    // The root mean square length, which is 1 even where unit normals vary within a pixel.
    let spread = |f: &Features| f.variance.map_or(0.0, |[normal, ..]| normal * (f.hits - 1) as f32 / f.hits as f32);
    let normals: Vec<_> = hits.iter().map(|f| (f.normal, (length(f.normal).powi(2) + spread(f)).sqrt())).collect();
    let known: Vec<_> = normals.into_iter().filter(|(_, length)| *length > 0.0).collect();
    let albedos: Vec<_> = hits.iter().map(|f| f.albedo).collect();
    found.extend(of_features(&known, &albedos, 0.5));
    found.extend(share(&hits, |f| f.depth <= 0.0).filter(|share| *share > 0.01).map(|share| Warning::Depth { share }));
    found
}

/// Compares the halves of noisy pixels. Samples with few possible values often have equal means by chance, so each distinct
/// mean counts once.
fn of_streams(film: &Film) -> Option<Warning> {
    let mut means = BTreeMap::new();
    for i in 0..film.frame().pixels() {
        let (a, b) = (film.half(0, i)?, film.half(1, i)?);
        if a.count == b.count && film.moments(i).m2.iter().sum::<f64>() > 0.0 {
            means.insert(a.mean.map(f64::to_bits), a.mean == b.mean);
        }
    }
    let same: Vec<bool> = means.into_values().collect();
    (same.len() >= MEANS && share(&same, |same| *same) > Some(0.9)).then_some(Warning::AlikeHalves { factor: 0.0 })
}
