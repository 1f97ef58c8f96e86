//! Statistics that individual methods record: sums of functions of the samples, and the samples themselves.

use dapple_core::film::{Recorded, RecordedSample, Recorder};
use dapple_core::{Error, Film, Needs, integrator::Trajectory};
use std::sync::Arc;

fn recorded<'f>(film: &'f Film, who: &str, name: &str, what: &'static str) -> Result<Recorded<'f>, Error> {
    film.recorded(name).ok_or_else(|| Error::NotRecorded { who: who.to_owned(), what })
}

/// The number of sample sets that a film records per pixel: one, or one per half.
fn halves(film: &Film) -> usize {
    if film.needs().halves { 2 } else { 1 }
}

/// The recorder of a sum over a pixel's samples, per channel. Splats are not included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SampleSums {
    /// The sum of `x ln x`; 0 for a sample that is 0.
    Logs,
    /// The sum of `sqrt x`.
    Roots,
    /// The [moments](ThirdMoments) of `2 (sqrt x - 1)`.
    RootMoments,
}

impl SampleSums {
    pub(crate) fn list(self) -> Vec<Arc<dyn Recorder>> {
        vec![Arc::new(self)]
    }

    /// The recorded sums of a film; `who` is the reader in error messages.
    pub(crate) fn of<'f>(self, film: &'f Film, who: &str) -> Result<FilmSums<'f>, Error> {
        Ok(FilmSums { film, recorded: recorded(film, who, self.name(), "sums of functions of the samples")? })
    }

    /// The number of recorded triples; each has one value per channel.
    fn triples(self) -> usize {
        if self == Self::RootMoments { 3 } else { 1 }
    }
}

/// The number of words of a triple of numbers.
const TRIPLE: usize = 6;

/// Triple `k` of the numbers in `words`; 0 if `words` is empty.
fn triple(words: &[u32], k: usize) -> [f64; 3] {
    let number = |at: usize| f64::from_bits(u64::from(words[at]) | u64::from(words[at + 1]) << 32);
    if words.is_empty() { [0.0; 3] } else { [0, 2, 4].map(|at| number(TRIPLE * k + at)) }
}

fn put_triple(words: &mut [u32], k: usize, values: [f64; 3]) {
    let halves = values.map(f64::to_bits).into_iter().flat_map(|bits| [bits as u32, (bits >> 32) as u32]);
    words[TRIPLE * k..].iter_mut().zip(halves).for_each(|(word, half)| *word = half);
}

/// `x ln x`, and 0 at 0; bit-identical on every machine.
fn x_ln_x(x: f64) -> f64 {
    if x > 0.0 { x * libm::log(x) } else { 0.0 }
}

impl Recorder for SampleSums {
    fn name(&self) -> &str {
        match self {
            Self::Logs => "sums of x ln x",
            Self::Roots => "sums of roots",
            Self::RootMoments => "moments of roots",
        }
    }

    fn record(&self, words: &mut Vec<u32>, sample: &RecordedSample<'_>) {
        words.resize(TRIPLE * self.triples(), 0);
        let x = sample.radiance.map(f64::from);
        let of = match self {
            Self::Logs => x_ln_x,
            Self::Roots => f64::sqrt,
            Self::RootMoments => return add_moments(words, x, sample.count as f64),
        };
        let mut sum = triple(words, 0);
        (0..3).for_each(|c| sum[c] += of(x[c]));
        put_triple(words, 0, sum);
    }

    fn bytes(&self, _: u64) -> u64 {
        (self.triples() * size_of::<[f64; 3]>()) as u64
    }
}

/// Adds sample `x` to the moments; `n` is the number of samples including it.
fn add_moments(words: &mut [u32], x: [f64; 3], n: f64) {
    let [mut mean, mut m2, mut m3] = [0, 1, 2].map(|k| triple(words, k));
    for c in 0..3 {
        let delta = 2.0 * (x[c].sqrt() - 1.0) - mean[c];
        let share = delta / n;
        let square = delta * share * (n - 1.0);
        mean[c] += share;
        m3[c] += square * share * (n - 2.0) - 3.0 * share * m2[c];
        m2[c] += square;
    }
    [mean, m2, m3].into_iter().enumerate().for_each(|(k, values)| put_triple(words, k, values));
}

/// Count, mean, and sums of squared and of cubed deviations, for three channels [Pébay 2008].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ThirdMoments {
    pub(crate) count: u64,
    pub(crate) mean: [f64; 3],
    pub(crate) m2: [f64; 3],
    pub(crate) m3: [f64; 3],
}

impl ThirdMoments {
    /// Adds all samples of `other`.
    fn merge(&mut self, other: &Self) {
        match (self.count, other.count) {
            (_, 0) => return,
            (0, _) => return *self = *other,
            _ => {}
        }
        let (na, nb) = (self.count as f64, other.count as f64);
        for c in 0..3 {
            let delta = other.mean[c] - self.mean[c];
            let share = delta * (nb / (na + nb));
            let square = delta * share * na;
            let crossed = 3.0 * delta * ((na * other.m2[c] - nb * self.m2[c]) / (na + nb));
            let cubed = square * delta * ((na - nb) / (na + nb)) + crossed;
            self.mean[c] += share;
            self.m2[c] = self.m2[c] + other.m2[c] + square;
            self.m3[c] = self.m3[c] + other.m3[c] + cubed;
        }
        self.count += other.count;
    }
}

/// The recorded sums of a film, over the kept samples of both halves together.
#[derive(Clone, Copy)]
pub(crate) struct FilmSums<'f> {
    film: &'f Film,
    recorded: Recorded<'f>,
}

impl FilmSums<'_> {
    /// The recorded sum of pixel `i`.
    pub(crate) fn sum(&self, i: usize) -> [f64; 3] {
        let of = |half| triple(self.recorded.kept(half, i), 0);
        (1..halves(self.film)).map(of).fold(of(0), |sum, more| std::array::from_fn(|c| sum[c] + more[c]))
    }

    /// The recorded moments of pixel `i`.
    pub(crate) fn moments(&self, i: usize) -> ThirdMoments {
        let of = |half| {
            let words = self.recorded.kept(half, i);
            let [mean, m2, m3] = [0, 1, 2].map(|k| triple(words, k));
            let count = self.film.half(half, i).map_or_else(|| self.film.count(i), |moments| moments.count);
            ThirdMoments { count, mean, m2, m3 }
        };
        (1..halves(self.film)).map(of).fold(of(0), |mut all, more| {
            all.merge(&more);
            all
        })
    }
}

/// The recorder of a pixel's individual samples, in the order of tracing. A rejected sample is recorded as 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Singles {
    /// All samples.
    All,
    /// All samples with their trajectories. Samples without a valid trajectory have inverse depth 0 and no motion.
    Moving,
    /// The first 8 samples of each half.
    First,
}

impl Singles {
    /// The number of first samples.
    pub(crate) const FIRST: usize = 8;

    /// The statistics that integrators must deliver.
    pub(crate) fn needs(self) -> Needs {
        if self == Self::Moving { Needs::none().with_trajectories() } else { Needs::none() }
    }

    pub(crate) fn list(self) -> Vec<Arc<dyn Recorder>> {
        vec![Arc::new(self)]
    }

    /// The number of words per sample.
    fn each(self) -> usize {
        if self == Self::Moving { 7 } else { 3 }
    }

    /// The largest number of samples recorded per pixel and half.
    fn most(self) -> usize {
        if self == Self::First { Self::FIRST } else { usize::MAX }
    }

    /// The recorded samples of a film; `who` is the reader in error messages.
    pub(crate) fn of<'f>(self, film: &'f Film, who: &str) -> Result<FilmSamples<'f>, Error> {
        let recorded = recorded(film, who, self.name(), "individual samples")?;
        Ok(FilmSamples { film, recorded, each: self.each() })
    }
}

impl Recorder for Singles {
    fn name(&self) -> &str {
        match self {
            Self::All => "samples",
            Self::Moving => "samples with trajectories",
            Self::First => "first samples",
        }
    }

    fn record(&self, words: &mut Vec<u32>, sample: &RecordedSample<'_>) {
        if words.len() / self.each() < self.most() {
            words.extend(sample.radiance.map(f32::to_bits));
            if *self == Self::Moving {
                let is_sound = |t: &Trajectory| {
                    t.inverse_depth >= 0.0 && t.inverse_depth.is_finite() && t.motion.iter().all(|v| v.is_finite())
                };
                let Trajectory { inverse_depth, motion: [x, y, w] } =
                    sample.estimate.trajectory.filter(is_sound).unwrap_or_default();
                words.extend([inverse_depth, x, y, w].map(f32::to_bits));
            }
        }
    }

    fn reserve(&self, words: &mut Vec<u32>, more: u64) {
        let room = self.most().saturating_sub(words.len() / self.each());
        let more = usize::try_from(more).unwrap_or(usize::MAX).min(room);
        words.reserve_exact(more.saturating_mul(self.each()));
    }

    fn bytes(&self, samples: u64) -> u64 {
        samples.min(self.most() as u64).saturating_mul(4 * self.each() as u64)
    }
}

/// The kept samples of a film.
#[derive(Clone, Copy)]
pub(crate) struct FilmSamples<'f> {
    pub(crate) film: &'f Film,
    recorded: Recorded<'f>,
    each: usize,
}

impl<'f> FilmSamples<'f> {
    /// The samples of pixel `i`, each with its half and its number in that half.
    pub(crate) fn of_pixel(
        &self,
        i: usize,
    ) -> impl Iterator<Item = (usize, (usize, ([f32; 3], Trajectory)))> + use<'f> {
        let [a, b] = [0, 1].map(|half| self.of_half(half, i).enumerate().map(move |sample| (half, sample)));
        a.chain(b)
    }

    /// The samples of pixel `i` in a half, each with its trajectory if recorded. In a film without halves, all are in half 0.
    pub(crate) fn of_half(&self, half: usize, i: usize) -> impl Iterator<Item = ([f32; 3], Trajectory)> + use<'f> {
        let words = if half < halves(self.film) { self.recorded.kept(half, i) } else { &[] };
        words.chunks_exact(self.each).map(|words| {
            let at = |k: usize| words.get(k).map_or(0.0, |&word| f32::from_bits(word));
            ([at(0), at(1), at(2)], Trajectory { inverse_depth: at(3), motion: [at(4), at(5), at(6)] })
        })
    }
}
