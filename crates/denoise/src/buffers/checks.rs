//! Checks of buffers. Each error names the buffer, and what to do.

use super::{Counts, Denoise, Feature, SampleBuffers, Samples, Variance};
use dapple_core::Error;

/// The names of the buffers of a set of samples: mean, count and variance.
const WHOLE: [&str; 3] = ["mean", "count", "variance"];
const HALVES: [[&str; 3]; 2] = [
    ["mean of half a", "count of half a", "variance of half a"],
    ["mean of half b", "count of half b", "variance of half b"],
];

/// The names of the features and of their variances, the number of channels, and what their numbers must be.
const FEATURES: [(&str, &str, usize, Rule); 4] = [
    ("normal", "variance of the normal", 3, FINITE),
    ("albedo", "variance of the albedo", 3, FINITE),
    ("position", "variance of the position", 3, FINITE),
    ("depth", "variance of the depth", 1, DEPTH),
];

/// The condition that a number must meet, and the fault of another one.
type Rule = (fn(f32) -> bool, &'static str);

const FINITE: Rule = (f32::is_finite, "is NaN or infinite; give a finite number, or count 0 samples there to fill it");
const SQUARE: Rule = (|v| v >= 0.0, "is negative; give squares of standard deviations");
const DEPTH: Rule = (|d| d >= 0.0, "is NaN or negative; give 0 or infinity for a miss");
const SHARE: Rule =
    (|share| (0.0..=1.0).contains(&share), "is not in 0 to 1; give the share of the samples that hit a surface");

const EQUAL: &str = "it equals that of half a, so the halves show no noise; give two renders with different seeds, or one with its variance to denoise_whole()";
const ALONE: &str = "it is missing, and one image alone does not show its noise; give its variance, or two halves (renders with different seeds) to denoise()";

fn bad(buffer: &'static str, what: impl Into<String>) -> Error {
    Error::BadBuffer { buffer, what: what.into() }
}

/// Checks all buffers of an image.
pub(super) fn check(image: &Denoise<'_>) -> Result<(), Error> {
    let (size, every) = (image.size, Counts::All(1));
    match &image.samples {
        Samples::Whole(all) => {
            samples(size, all, WHOLE)?;
            if all.variance.is_none() {
                return Err(bad("variance", ALONE));
            }
        }
        Samples::Halves(halves) => {
            halves.iter().zip(HALVES).try_for_each(|(half, names)| samples(size, half, names))?;
            independent(halves)?;
        }
    }
    for (feature, (name, variance_name, channels, rule)) in image.features.iter().zip(FEATURES) {
        let Some(Feature { mean, variance }) = feature else { continue };
        numbers(size, name, (mean, channels), &[rule], every)?;
        spread(size, variance_name, (*variance, channels), every)?;
    }
    if let Some(share) = image.coverage {
        numbers(size, "coverage", (share, 1), &[SHARE], every)?;
    }
    if let Some(emission) = image.emission {
        numbers(size, "emission", (emission.as_flattened(), 3), &[FINITE], every)?;
    }
    image.ids.map_or(Ok(()), |ids| length(size, ids.len(), "ids"))
}

fn samples(size: [u32; 2], set: &SampleBuffers<'_>, [mean, count, variance]: [&'static str; 3]) -> Result<(), Error> {
    if let Counts::Each(counts) = set.count {
        length(size, counts.len(), count)?;
    }
    length(size, set.mean.len(), mean)?;
    if (0..set.mean.len()).all(|i| set.count.of(i) == 0) {
        return Err(bad(count, "no pixel has a sample; give the number of samples of each pixel, or one for all"));
    }
    numbers(size, mean, (set.mean.as_flattened(), 3), &[FINITE], set.count)?;
    spread(size, variance, (set.variance.map(Variance::flat), 3), set.count)
}

/// Refuses halves that are one buffer. A black image and one of a single colour may come twice without noise.
fn independent([a, b]: &[SampleBuffers<'_>; 2]) -> Result<(), Error> {
    let first = a.mean.first();
    let plain = a.mean.len() == 1 || a.mean.iter().all(|colour| Some(colour) == first);
    let same = std::ptr::eq(a.mean, b.mean) || (!plain && a.mean == b.mean);
    if same { Err(bad(HALVES[1][0], EQUAL)) } else { Ok(()) }
}

fn spread(
    size: [u32; 2],
    name: &'static str,
    (variance, channels): (Option<Variance<'_, f32>>, usize),
    counts: Counts<'_>,
) -> Result<(), Error> {
    let Some(Variance::OfSamples(values) | Variance::OfMean(values)) = variance else { return Ok(()) };
    numbers(size, name, (values, channels), &[FINITE, SQUARE], counts)
}

/// Checks the numbers of a buffer in the pixels with samples.
fn numbers(
    size: [u32; 2],
    name: &'static str,
    (values, channels): (&[f32], usize),
    rules: &[Rule],
    counts: Counts<'_>,
) -> Result<(), Error> {
    length(size, values.len() / channels, name)?;
    for (holds, what) in rules {
        let is_wrong = |(i, value): (usize, &[f32])| counts.of(i) > 0 && !value.iter().all(|v| holds(*v));
        if let Some(pixel) = values.chunks_exact(channels).enumerate().position(is_wrong) {
            let [x, y] = [pixel % size[0] as usize, pixel / size[0] as usize];
            return Err(bad(name, format!("pixel ({x}, {y}) {what}")));
        }
    }
    Ok(())
}

fn length([width, height]: [u32; 2], found: usize, name: &'static str) -> Result<(), Error> {
    let expected = u64::from(width) * u64::from(height);
    if found as u64 == expected {
        return Ok(());
    }
    let what = format!("it has {found} values, and {width}x{height} pixels need {expected}; give one for each pixel");
    Err(bad(name, what))
}
