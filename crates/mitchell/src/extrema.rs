//! The smallest and largest samples of each pixel, and the contrast of the samples of a pixel or window.

use dapple_core::film::{Recorded, RecordedSample, Recorder, luminance};
use dapple_core::{Error, Film, plan::Retention};
use std::sync::Arc;

/// The smallest and the largest red, green, blue and [`luminance`] among a pixel's samples.
pub type Extremes = [[f32; 4]; 2];

/// The recorder of the smallest and the largest samples of each pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extrema;

impl Recorder for Extrema {
    fn name(&self) -> &str {
        "extrema"
    }

    fn record(&self, words: &mut Vec<u32>, sample: &RecordedSample<'_>) {
        let [r, g, b] = sample.radiance;
        let value = [r, g, b, luminance(sample.radiance.map(f64::from)) as f32];
        let extremes = extremes(words).map_or([value; 2], |before| joined(before, [value; 2]));
        words.resize(8, 0);
        words.iter_mut().zip(extremes.as_flattened()).for_each(|(word, x)| *word = x.to_bits());
    }

    fn reserve(&self, words: &mut Vec<u32>, _: u64) {
        words.reserve_exact(8 - words.len());
    }

    fn bytes(&self, _: u64) -> u64 {
        size_of::<Extremes>() as u64
    }
}

/// The extremes stored in these words; `None` without samples.
fn extremes(words: &[u32]) -> Option<Extremes> {
    let at = |k: usize| f32::from_bits(words[k]);
    (words.len() == 8).then(|| [0, 4].map(|k| [at(k), at(k + 1), at(k + 2), at(k + 3)]))
}

fn joined(a: Extremes, b: Extremes) -> Extremes {
    [std::array::from_fn(|c| a[0][c].min(b[0][c])), std::array::from_fn(|c| a[1][c].max(b[1][c]))]
}

impl Extrema {
    /// The bytes of a pixel's words in one half, including their list.
    pub(crate) const BYTES: usize = size_of::<Extremes>() + size_of::<Vec<u32>>();

    /// The recorder as a list, for [`Sampler::recorders`](dapple_core::Sampler::recorders).
    pub fn list() -> Vec<Arc<dyn Recorder>> {
        vec![Arc::new(Self)]
    }

    /// The extremes recorded in a film.
    ///
    /// # Errors
    ///
    /// [`Error::NotRecorded`] if the film has not recorded extremes. The message names `who` as the method that reads them.
    pub fn of<'f>(film: &'f Film, who: &str) -> Result<FilmExtrema<'f>, Error> {
        let missing = || Error::NotRecorded { who: who.to_owned(), what: "the extrema" };
        let recorded = film.recorded(Self.name()).ok_or_else(missing)?;
        Ok(FilmExtrema { recorded, halves: if film.needs().halves { 2 } else { 1 } })
    }
}

/// The smallest and the largest samples of a film's pixels.
#[derive(Clone, Copy)]
pub struct FilmExtrema<'f> {
    recorded: Recorded<'f>,
    halves: usize,
}

impl FilmExtrema<'_> {
    /// The extremes of pixel `i` over both halves. [`Retention::Discard`] selects discarded samples, other values kept samples.
    /// `None` if the pixel has no selected samples.
    pub fn of_pixel(&self, retention: Retention, i: usize) -> Option<Extremes> {
        let words = |half: usize| match retention {
            Retention::Discard => self.recorded.discarded(half, i),
            _ => self.recorded.kept(half, i),
        };
        (0..self.halves).filter_map(|half| extremes(words(half))).reduce(joined)
    }
}

/// The contrast per channel of samples between `min` and `max`: `(max - min) / (max + min)`, in `[0, 1]` [after
/// Mitchell 1987].
///
/// Contrast does not change if all samples are multiplied by the same number. It is 0 if `min` and `max` are 0. Negative and
/// non-finite values are replaced by 0, like rejected samples in a film.
///
/// ```
/// // {0.2, 0.2, 0.2, 0.8}, {0.5, 0.6} and nothing at all.
/// let [r, g, b] = dapple_mitchell::contrast([[0.2, 0.5, 0.0], [0.8, 0.6, 0.0]]);
/// assert!((r - 0.6).abs() < 1e-6 && (g - 1.0 / 11.0).abs() < 1e-6 && b == 0.0);
/// ```
pub fn contrast([min, max]: [[f32; 3]; 2]) -> [f64; 3] {
    let radiance = |v: f32| if v > 0.0 && v < f32::INFINITY { f64::from(v) } else { 0.0 };
    std::array::from_fn(|c| {
        let (a, b) = (radiance(min[c]), radiance(max[c]));
        if a + b > 0.0 { (b - a).abs() / (a + b) } else { 0.0 }
    })
}

/// The largest deviation of a sample from the mean, relative to the mean: `max_i |Y_i - mean| / mean` [pbrt-v2,
/// `src/samplers/adaptive.cpp`]. The smallest and the largest sample determine it.
///
/// The result is 0 if all samples are equal, or if the mean is 0, negative, infinite or NaN.
///
/// ```
/// // {1, 1, 1, 1.9}
/// assert!((dapple_mitchell::deviation([1.0, 1.9], 1.225) - 0.551).abs() < 1e-3);
/// ```
pub fn deviation([min, max]: [f32; 2], mean: f64) -> f64 {
    let (min, max) = (f64::from(min), f64::from(max));
    let usable = mean > 0.0 && mean.is_finite() && min.is_finite() && max.is_finite();
    if usable && min < max { (max - mean).max(mean - min).max(0.0) / mean } else { 0.0 }
}

/// The range `[min, max]` per channel of an empty set of samples, which every other range contains.
pub(crate) const NOTHING: [[f32; 3]; 2] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// Returns, for each pixel, the smallest and largest values over the window around it. The window is `2 radius + 1`
/// pixels wide and high, cut off at the borders.
pub(crate) fn windowed(ranges: &[[[f32; 3]; 2]], [width, height]: [u32; 2], radius: u32) -> Vec<[[f32; 3]; 2]> {
    let [w, h, radius] = [width, height, radius].map(|n| n as usize);
    let across = |i: usize| {
        let (row, x) = (i / w * w, i % w);
        &ranges[row + x.saturating_sub(radius)..row + (x + radius + 1).min(w)]
    };
    let rows: Vec<_> = (0..ranges.len()).map(|i| across(i).iter().fold(NOTHING, join)).collect();
    let down = |i: usize| {
        let (y, x) = (i / w, i % w);
        (y.saturating_sub(radius)..(y + radius + 1).min(h)).map(move |y| y * w + x)
    };
    (0..ranges.len()).map(|i| down(i).fold(NOTHING, |all, k| join(all, &rows[k]))).collect()
}

fn join([min, max]: [[f32; 3]; 2], other: &[[f32; 3]; 2]) -> [[f32; 3]; 2] {
    [std::array::from_fn(|c| min[c].min(other[0][c])), std::array::from_fn(|c| max[c].max(other[1][c]))]
}
