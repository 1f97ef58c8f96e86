//! Checks of buffers. Each error names the buffer, and what to do.

use super::{Counts, Denoise, Feature, SampleBuffers, Samples, Variance};
use dapple_core::Error;

fn bad(buffer: &'static str, what: impl Into<String>) -> Error {
    Error::BadBuffer { buffer, what: what.into() }
}

/// The names of the buffers of a set of samples: mean, count and variance.
struct Names([&'static str; 3]);

const WHOLE: Names = Names(["mean", "count", "variance"]);
const HALVES: [Names; 2] = [
    Names(["mean of half a", "count of half a", "variance of half a"]),
    Names(["mean of half b", "count of half b", "variance of half b"]),
];

/// A value of a buffer, as its channels.
trait Value: Copy {
    fn channels(&self) -> &[f32];
}

impl Value for f32 {
    fn channels(&self) -> &[f32] {
        std::slice::from_ref(self)
    }
}

impl Value for [f32; 3] {
    fn channels(&self) -> &[f32] {
        self
    }
}

/// Checks all buffers of an image.
pub(super) fn check(image: &Denoise<'_>) -> Result<(), Error> {
    let size = image.size;
    match &image.samples {
        Samples::Whole(all) => {
            samples(size, all, &WHOLE)?;
            if all.variance.is_none() {
                return Err(bad(
                    "variance",
                    "it is missing, and one image alone does not show its noise; give its variance, or two halves (renders with different seeds) to denoise()",
                ));
            }
        }
        Samples::Halves(halves) => {
            samples(size, &halves[0], &HALVES[0])?;
            samples(size, &halves[1], &HALVES[1])?;
            independent(halves)?;
        }
    }
    feature(size, image.normal, "normal", "variance of the normal")?;
    feature(size, image.albedo, "albedo", "variance of the albedo")?;
    feature(size, image.position, "position", "variance of the position")?;
    if let Some(depth) = image.depth {
        length(size, depth.mean.len(), "depth")?;
        let wrong = |d: &f32| d.is_nan() || *d < 0.0;
        at(size, depth.mean.iter().position(wrong), "depth", "is NaN or negative; give 0 or infinity for a miss")?;
        spread(size, depth.variance, "variance of the depth", |_| true)?;
    }
    if let Some(share) = image.coverage {
        length(size, share.len(), "coverage")?;
        let wrong = share.iter().position(|share| !(0.0..=1.0).contains(share));
        at(size, wrong, "coverage", "is not in 0 to 1; give the share of the samples that hit a surface")?;
    }
    if let Some(emission) = image.emission {
        finite(size, emission, "emission", |_| true)?;
    }
    image.ids.map_or(Ok(()), |ids| length(size, ids.len(), "ids"))
}

fn samples(size: [u32; 2], set: &SampleBuffers<'_>, Names([mean, count, variance]): &Names) -> Result<(), Error> {
    if let Counts::Each(counts) = set.count {
        length(size, counts.len(), count)?;
    }
    length(size, set.mean.len(), mean)?;
    if (0..set.mean.len()).all(|i| set.count.of(i) == 0) {
        return Err(bad(count, "no pixel has a sample; give the number of samples of each pixel, or one for all"));
    }
    finite(size, set.mean, mean, |i| set.count.of(i) > 0)?;
    spread(size, set.variance, variance, |i| set.count.of(i) > 0)
}

/// Refuses halves that are one buffer. A black image and one of a single colour may come twice without noise.
fn independent([a, b]: &[SampleBuffers<'_>; 2]) -> Result<(), Error> {
    let first = a.mean.first();
    let plain = a.mean.len() == 1 || a.mean.iter().all(|colour| Some(colour) == first);
    if std::ptr::eq(a.mean, b.mean) || (!plain && a.mean == b.mean) {
        return Err(bad(
            "mean of half b",
            "it equals that of half a, so the halves show no noise; give two renders with different seeds, or one with its variance to denoise_whole()",
        ));
    }
    Ok(())
}

fn feature(
    size: [u32; 2],
    feature: Option<Feature<'_>>,
    name: &'static str,
    variance: &'static str,
) -> Result<(), Error> {
    let Some(feature) = feature else { return Ok(()) };
    finite(size, feature.mean, name, |_| true)?;
    spread(size, feature.variance, variance, |_| true)
}

fn spread<T: Value>(
    size: [u32; 2],
    variance: Option<Variance<'_, T>>,
    name: &'static str,
    counts: impl Fn(usize) -> bool,
) -> Result<(), Error> {
    let Some(Variance::OfSamples(values) | Variance::OfMean(values)) = variance else { return Ok(()) };
    finite(size, values, name, &counts)?;
    let negative = (0..values.len()).find(|&i| counts(i) && values[i].channels().iter().any(|v| *v < 0.0));
    at(size, negative, name, "is negative; give squares of standard deviations")
}

fn finite<T: Value>(
    size: [u32; 2],
    values: &[T],
    name: &'static str,
    counts: impl Fn(usize) -> bool,
) -> Result<(), Error> {
    length(size, values.len(), name)?;
    let wrong = (0..values.len()).find(|&i| counts(i) && !values[i].channels().iter().all(|v| v.is_finite()));
    at(size, wrong, name, "is NaN or infinite; give a finite number, or count 0 samples there to fill it")
}

fn at([width, _]: [u32; 2], pixel: Option<usize>, name: &'static str, what: &str) -> Result<(), Error> {
    let Some(pixel) = pixel else { return Ok(()) };
    let [x, y] = [pixel % width as usize, pixel / width as usize];
    Err(bad(name, format!("pixel ({x}, {y}) {what}")))
}

fn length([width, height]: [u32; 2], found: usize, name: &'static str) -> Result<(), Error> {
    let expected = u64::from(width) * u64::from(height);
    if found as u64 == expected {
        return Ok(());
    }
    let what = format!("it has {found} values, and {width}x{height} pixels need {expected}; give one for each pixel");
    Err(bad(name, what))
}
