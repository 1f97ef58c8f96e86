//! The smallest and the largest samples of each pixel.

use dapple_core::{Error, Film, Recorded, RecordedSample, Recorder, Retention, luminance};
use std::sync::Arc;

/// The smallest and the largest red, green, blue and [`luminance`] of a pixel's samples.
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

/// The extremes that these words hold; `None` without samples.
fn extremes(words: &[u32]) -> Option<Extremes> {
    let at = |k: usize| f32::from_bits(words[k]);
    (words.len() == 8).then(|| [0, 4].map(|k| [at(k), at(k + 1), at(k + 2), at(k + 3)]))
}

fn joined(a: Extremes, b: Extremes) -> Extremes {
    [std::array::from_fn(|c| a[0][c].min(b[0][c])), std::array::from_fn(|c| a[1][c].max(b[1][c]))]
}

impl Extrema {
    /// The bytes of a pixel's words in one half, with their list.
    pub(crate) const BYTES: usize = size_of::<Extremes>() + size_of::<Vec<u32>>();

    /// The recorder as a list, for [`Sampler::recorders`](dapple_core::Sampler::recorders).
    pub fn list() -> Vec<Arc<dyn Recorder>> {
        vec![Arc::new(Self)]
    }

    /// The extremes in a film.
    ///
    /// # Errors
    ///
    /// [`Error::NotRecorded`], with the name `who` of the reader, if the film has no such recorder.
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
    /// The extremes of pixel `i`'s kept or discarded samples, both halves together; `None` without such samples. Withdrawn
    /// samples are discarded ones.
    pub fn of_pixel(&self, retention: Retention, i: usize) -> Option<Extremes> {
        let words = |half: usize| match retention {
            Retention::Discard => self.recorded.discarded(half, i),
            _ => self.recorded.kept(half, i),
        };
        (0..self.halves).filter_map(|half| extremes(words(half))).reduce(joined)
    }
}
