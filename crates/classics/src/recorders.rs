//! Statistics that methods record for themselves: sums of functions of the samples, and samples one by one.

use dapple_core::{Error, Film, Needs, Recorded, RecordedSample, Recorder, Trajectory};
use std::sync::Arc;

fn recorded<'f>(film: &'f Film, who: &str, name: &str, what: &'static str) -> Result<Recorded<'f>, Error> {
    film.recorded(name).ok_or_else(|| Error::NotRecorded { who: who.to_owned(), what })
}

/// The number of sets of words that a pixel has.
fn halves(film: &Film) -> usize {
    if film.needs().halves { 2 } else { 1 }
}

/// The recorder of a sum over a pixel's samples, per channel. Splats are not in it.
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

    /// The sums of a film for the reader `who`.
    pub(crate) fn of<'f>(self, film: &'f Film, who: &str) -> Result<FilmSums<'f>, Error> {
        Ok(FilmSums { film, recorded: recorded(film, who, self.name(), "sums of functions of the samples")? })
    }

    /// The number of triples of values: one per channel in each.
    fn triples(self) -> usize {
        if self == Self::RootMoments { 3 } else { 1 }
    }
}

/// The words of a triple of numbers.
const TRIPLE: usize = 6;

/// Triple `k` of the numbers in some words; 0 if there are none.
fn triple(words: &[u32], k: usize) -> [f64; 3] {
    let number = |at: usize| f64::from_bits(u64::from(words[at]) | u64::from(words[at + 1]) << 32);
    if words.is_empty() { [0.0; 3] } else { [0, 2, 4].map(|at| number(TRIPLE * k + at)) }
}

fn put_triple(words: &mut [u32], k: usize, values: [f64; 3]) {
    let halves = values.map(f64::to_bits).into_iter().flat_map(|bits| [bits as u32, (bits >> 32) as u32]);
    words[TRIPLE * k..].iter_mut().zip(halves).for_each(|(word, half)| *word = half);
}

/// `x ln x`, continued to 0 at 0. The same bits on every machine.
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

/// Adds a sample to the moments of `n` samples, this one included.
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

/// Count, mean, and sums of squared and cubed deviations of three channels [Pébay 2008].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ThirdMoments {
    pub(crate) count: u64,
    pub(crate) mean: [f64; 3],
    pub(crate) m2: [f64; 3],
    pub(crate) m3: [f64; 3],
}

impl ThirdMoments {
    /// Adds all values of `other`.
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

/// The sums of a film, over the kept samples of both halves together.
#[derive(Clone, Copy)]
pub(crate) struct FilmSums<'f> {
    film: &'f Film,
    recorded: Recorded<'f>,
}

impl FilmSums<'_> {
    /// The sum of pixel `i`.
    pub(crate) fn sum(&self, i: usize) -> [f64; 3] {
        let of = |half| triple(self.recorded.kept(half, i), 0);
        (1..halves(self.film)).map(of).fold(of(0), |sum, more| std::array::from_fn(|c| sum[c] + more[c]))
    }

    /// The moments of pixel `i`.
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

/// The recorder of a pixel's samples one by one, in the order of tracing. A rejected sample is 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Singles {
    /// All samples.
    All,
    /// All samples with their trajectories. Those without a sound one have inverse depth 0 and no motion.
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

    /// The words of a sample.
    fn each(self) -> usize {
        if self == Self::Moving { 7 } else { 3 }
    }

    /// The most samples of a pixel in a half.
    fn most(self) -> usize {
        if self == Self::First { Self::FIRST } else { usize::MAX }
    }

    /// The samples of a film for the reader `who`.
    pub(crate) fn of<'f>(self, film: &'f Film, who: &str) -> Result<FilmSamples<'f>, Error> {
        let recorded = recorded(film, who, self.name(), "samples one by one")?;
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

/// The kept samples of a film, one by one.
#[derive(Clone, Copy)]
pub(crate) struct FilmSamples<'f> {
    pub(crate) film: &'f Film,
    recorded: Recorded<'f>,
    each: usize,
}

impl<'f> FilmSamples<'f> {
    /// The samples of pixel `i`, each with its half and its number there.
    pub(crate) fn of_pixel(
        &self,
        i: usize,
    ) -> impl Iterator<Item = (usize, (usize, ([f32; 3], Trajectory)))> + use<'f> {
        let [a, b] = [0, 1].map(|half| self.of_half(half, i).enumerate().map(move |sample| (half, sample)));
        a.chain(b)
    }

    /// The samples of pixel `i` in a half, each with its trajectory if there are such. A film without halves has them in half 0.
    pub(crate) fn of_half(&self, half: usize, i: usize) -> impl Iterator<Item = ([f32; 3], Trajectory)> + use<'f> {
        let words = if half < halves(self.film) { self.recorded.kept(half, i) } else { &[] };
        words.chunks_exact(self.each).map(|words| {
            let at = |k: usize| words.get(k).map_or(0.0, |&word| f32::from_bits(word));
            ([at(0), at(1), at(2)], Trajectory { inverse_depth: at(3), motion: [at(4), at(5), at(6)] })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::{Traced, frame};
    use dapple_core::samplers::Uniform;
    use dapple_core::{Block, Draws, Estimate, Limits, PointSet, Render, Worker, mix};
    use dapple_low_discrepancy::Random;

    const KINDS: [SampleSums; 3] = [SampleSums::Logs, SampleSums::Roots, SampleSums::RootMoments];

    /// Recorders of everything.
    fn everything() -> Vec<Arc<dyn Recorder>> {
        let singles = [Singles::All, Singles::Moving, Singles::First].into_iter().flat_map(Singles::list);
        KINDS.into_iter().flat_map(SampleSums::list).chain(singles).collect()
    }

    /// All values of the sums in two passes: of `x ln x`, of roots, and the moments of transformed roots.
    fn two_passes(samples: &[[f32; 3]]) -> [[f64; 3]; 5] {
        let of = |f: &dyn Fn(f64) -> f64| -> [f64; 3] {
            [0, 1, 2].map(|c: usize| samples.iter().map(|x| f(f64::from(x[c]))).sum::<f64>())
        };
        let root = |x: f64| 2.0 * (x.sqrt() - 1.0);
        let mean = of(&root).map(|sum| sum / samples.len().max(1) as f64);
        let power = |k: i32| {
            [0, 1, 2].map(|c: usize| samples.iter().map(|x| (root(f64::from(x[c])) - mean[c]).powi(k)).sum::<f64>())
        };
        [of(&|x| if x > 0.0 { x * x.ln() } else { 0.0 }), of(&f64::sqrt), mean, power(2), power(3)]
    }

    #[track_caller]
    fn close(film: &Film, i: usize, samples: &[[f32; 3]]) {
        let [logs, roots, moments] = KINDS.map(|kind| kind.of(film, "a test").unwrap());
        let ThirdMoments { count, mean, m2, m3 } = moments.moments(i);
        assert_eq!(count, samples.len() as u64);
        let found = [logs.sum(i), roots.sum(i), mean, m2, m3];
        for (k, (a, b)) in found.as_flattened().iter().zip(two_passes(samples).as_flattened()).enumerate() {
            assert!((a - b).abs() <= 1e-11 * (1.0 + b.abs()), "value {k}: {a} is not {b}");
        }
    }

    /// Values over a wide range, some of them 0.
    fn values(count: u64) -> Vec<[f32; 3]> {
        let unit = |k: u64| (mix(11 + k) >> 40) as f32 / (1 << 24) as f32;
        let of = |k: u64| [unit(3 * k), 40.0 * unit(3 * k + 1).powi(5), if unit(3 * k + 2) < 0.5 { 0.0 } else { 2.0 }];
        (0..count).map(of).collect()
    }

    fn film(needs: Needs, samples: &[[f32; 3]], half: impl Fn(usize) -> usize) -> Film {
        let mut film = Film::with_recorders(frame([2, 1]), needs, everything());
        samples.iter().enumerate().for_each(|(k, &x)| film.push(1, half(k), x));
        film
    }

    #[test]
    fn sums_agree_with_two_passes_for_any_number_of_samples() {
        for count in [0, 1, 2, 3, 7, 500] {
            let all = values(count);
            close(&film(Needs::none(), &all, |_| 0), 1, &all);
            close(&film(Needs::none(), &all, |_| 0), 0, &[]);
            for cut in [0, 1, count / 2, count] {
                close(&film(Needs::none().with_halves(), &all, |k| usize::from(k as u64 >= cut)), 1, &all);
            }
        }
    }

    #[test]
    fn rejected_samples_count_as_zero() {
        let film = film(Needs::none(), &[[0.25; 3], [f32::NAN; 3], [4.0; 3], [-1.0; 3]], |_| 0);
        close(&film, 1, &[[0.25; 3], [0.0; 3], [4.0; 3], [0.0; 3]]);
        let samples = Singles::All.of(&film, "a test").unwrap();
        assert!(samples.of_half(0, 1).map(|(x, _)| x[0]).eq([0.25, 0.0, 4.0, 0.0]));
    }

    #[test]
    fn films_without_a_recorder_are_refused() {
        let film = Film::with_recorders(frame([1, 1]), Needs::none(), Singles::First.list());
        assert!(Singles::First.of(&film, "reader").is_ok());
        for refused in [Singles::All, Singles::Moving].map(|singles| singles.of(&film, "reader").err()) {
            assert!(refused.is_some_and(|error| error.to_string().starts_with("reader reads samples one by one")));
        }
        assert!(matches!(SampleSums::Logs.of(&film, "reader"), Err(Error::NotRecorded { .. })));
    }

    /// Noise, which is NaN in one sample of eight.
    fn noise(u: [f32; 4]) -> [f32; 3] {
        if u[3] < 0.125 { [f32::NAN, 1.0, 1.0] } else { [u[0], 8.0 * u[1], u[2] * u[3]] }
    }

    fn trajectory(u: [f32; 4]) -> Trajectory {
        Trajectory { inverse_depth: if u[3] < 0.125 { f32::NAN } else { u[0] }, motion: [u[1], -u[2], u[3]] }
    }

    /// The words that are recorded of a sample with these random numbers.
    fn expected(u: [f32; 4]) -> ([f32; 3], Trajectory) {
        if u[3] < 0.125 { ([0.0; 3], Trajectory::default()) } else { (noise(u), trajectory(u)) }
    }

    #[test]
    fn samples_are_those_of_the_points_in_either_half() {
        for halves in [false, true] {
            let needs = Singles::Moving.needs();
            let needs = if halves { needs.with_halves() } else { needs };
            let limits = Limits::samples(40 * 19 + 7);
            let render = Render::new(frame([8, 5]), &limits).needs(needs).recorders(everything());
            let mut moving = Traced(|draws: &Draws<'_>, _: &mut Worker| {
                let u = draws.block(Block::new(0));
                let mut estimate = Estimate::new(noise(u));
                estimate.trajectory = draws.wants_trajectory().then(|| trajectory(u));
                estimate
            });
            let film = render.run(&mut moving, &mut Uniform::new(Random::new(3))).unwrap();
            let of = |singles: Singles| singles.of(&film, "a test").unwrap();
            let mut read = 0;
            for (i, (half, (number, sample))) in
                (0..40).flat_map(|i| of(Singles::Moving).of_pixel(i).map(move |s| (i, s)))
            {
                let id = film.sample_id(half, i, number);
                assert_eq!(sample, expected(Random::new(3).block(id, 0)), "{id:?}");
                assert_eq!(of(Singles::All).of_half(half, i).nth(number), Some((sample.0, Trajectory::default())));
                let first = of(Singles::First).of_half(half, i).nth(number).map(|(x, _)| x);
                assert_eq!(first, (number < 8).then_some(sample.0));
                read += 1;
            }
            assert_eq!(read, film.record().samples);
        }
    }
}
