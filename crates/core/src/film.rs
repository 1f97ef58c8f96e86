//! What a render has found out so far: planes of per-pixel statistics, and the record of how it went.

mod bank;

pub use bank::luminance;
pub(crate) use bank::{Bank, Range, index, widen};

use crate::{Combine, Error, FirstHit, Frame, Needs, RgbMoments, SampleId, streams};
use bank::join;

/// Running mean and squared deviations of the first hits of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FeatureMoments {
    pub(crate) samples: u32,
    pub(crate) hits: u32,
    pub(crate) mean: [f32; 10],
    pub(crate) m2: [f32; 10],
}

impl FeatureMoments {
    pub(crate) fn push(&mut self, hit: Option<&FirstHit>) {
        self.samples = self.samples.saturating_add(1);
        let Some(hit) = hit else { return };
        self.hits = self.hits.saturating_add(1);
        let share = 1.0 / self.hits as f32;
        let (n, a, p) = (hit.shading_normal, hit.albedo, hit.position);
        let values = [n[0], n[1], n[2], a[0], a[1], a[2], p[0], p[1], p[2], hit.depth];
        for ((mean, m2), x) in self.mean.iter_mut().zip(&mut self.m2).zip(values) {
            let delta = x - *mean;
            *mean += delta * share;
            *m2 += delta * (x - *mean);
        }
    }
}

/// Mean and sample variance of the first hits of one pixel. Means are over the samples that hit
/// something; variances are `None` below two hits.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    /// Samples seen.
    pub samples: u32,
    /// Samples of them that hit a surface.
    pub hits: u32,
    /// Mean shading normal (shorter than 1 where normals differ).
    pub normal: [f32; 3],
    /// Mean albedo.
    pub albedo: [f32; 3],
    /// Mean position.
    pub position: [f32; 3],
    /// Mean depth.
    pub depth: f32,
    /// Variance of normal (3), albedo (3), position (3) and depth, in this order.
    pub variance: Option<[f32; 10]>,
}

/// Why a sample was rejected.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RejectedReason {
    /// A channel was NaN or infinite.
    NotFinite,
    /// A channel was negative.
    Negative,
}

impl RejectedReason {
    /// What a film does before it takes a sample in: why this is no radiance; `None` if it is one.
    #[inline]
    pub fn of(radiance: [f32; 3]) -> Option<Self> {
        reason_to_reject(radiance)
    }
}

/// A sample that was no radiance. It counts as zero and in `n`; `sample` and the point set replay it.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rejected {
    /// Which sample.
    pub sample: SampleId,
    /// What was wrong with it.
    pub reason: RejectedReason,
}

/// What one round asked for and took.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoundRecord {
    /// Samples traced.
    pub samples: u64,
    /// Whether they were kept.
    pub kept: bool,
    /// Wall seconds of planning.
    pub plan_seconds: f64,
    /// Wall seconds of tracing.
    pub trace_seconds: f64,
}

/// How a render went.
#[non_exhaustive]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// The budget shown at each barrier: [`Budget::Recorded`](crate::Budget::Recorded) replays it.
    pub budgets: Vec<u64>,
    /// The rounds.
    pub rounds: Vec<RoundRecord>,
    /// Samples traced, discarded ones included.
    pub samples: u64,
    /// Rays cast, as the integrator counts them.
    pub rays: u64,
    /// Blocks of coordinates asked for.
    pub blocks: u64,
    /// Samples rejected.
    pub rejected: u64,
    /// Whether a monitor stopped the render before its limits.
    pub interrupted: bool,
}

impl Record {
    /// Wall seconds of planning.
    pub fn plan_seconds(&self) -> f64 {
        self.rounds.iter().map(|r| r.plan_seconds).sum()
    }

    /// Wall seconds of tracing.
    pub fn trace_seconds(&self) -> f64 {
        self.rounds.iter().map(|r| r.trace_seconds).sum()
    }
}

/// Per-pixel statistics of a render, row by row over its window, and how it went.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    pub(crate) frame: Frame,
    pub(crate) needs: Needs,
    pub(crate) combine: Combine,
    /// One bank, or one a half.
    pub(crate) kept: Vec<Bank>,
    /// Empty until samples are discarded; then as `kept`.
    pub(crate) discarded: Vec<Bank>,
    pub(crate) features: Vec<FeatureMoments>,
    pub(crate) first_hits: Vec<Option<FirstHit>>,
    pub(crate) costs: Vec<u64>,
    pub(crate) rejected: Vec<Rejected>,
    pub(crate) record: Record,
}

/// How many rejected samples are listed; all are counted.
pub(crate) const REJECTED_LISTED: usize = 1024;

impl Film {
    /// An empty film that records what `needs` asks for.
    pub fn new(frame: Frame, needs: Needs) -> Self {
        let pixels = frame.pixels();
        let halves = if needs.halves { 2 } else { 1 };
        Self {
            frame,
            needs,
            combine: Combine::ByCount,
            kept: (0..halves).map(|_| Bank::new(pixels, &needs)).collect(),
            discarded: Vec::new(),
            features: if needs.features { vec![FeatureMoments::default(); pixels] } else { Vec::new() },
            first_hits: vec![None; pixels * usize::from(needs.first_hits)],
            costs: if needs.cost { vec![0; pixels] } else { Vec::new() },
            rejected: Vec::new(),
            record: Record::default(),
        }
    }

    /// Bytes per pixel of a film that records `needs`, before any sample is discarded.
    pub fn bytes_per_pixel(needs: &Needs) -> usize {
        Self::bank_bytes_per_pixel(needs)
            + if needs.features { size_of::<FeatureMoments>() } else { 0 }
            + usize::from(needs.first_hits) * size_of::<Option<FirstHit>>()
            + if needs.cost { 8 } else { 0 }
    }

    /// Bytes per pixel of the statistics of all kept samples, or of all discarded ones.
    pub(crate) fn bank_bytes_per_pixel(needs: &Needs) -> usize {
        let bank = 8 + 24 + if needs.variance { 24 } else { 0 } + if needs.extrema { 32 } else { 0 };
        bank * if needs.halves { 2 } else { 1 }
    }

    /// Takes in one sample by hand, as a round with `retention` kept would: for tests of samplers and
    /// filters on made-up statistics. It is number `count` of its stream, and rejected if it is no
    /// radiance. `half` is ignored without halves.
    ///
    /// # Panics
    ///
    /// When `pixel` is outside the window.
    pub fn push(&mut self, pixel: usize, half: usize, radiance: [f32; 3]) {
        let halves = self.kept.len() == 2;
        let half = if halves { half & 1 } else { 0 };
        let bank = &mut self.kept[half];
        let index = bank.next_index(pixel);
        let reason = reason_to_reject(radiance);
        let radiance = if reason.is_some() { [0.0; 3] } else { radiance };
        let mut moments = bank.moments(pixel);
        moments.push(radiance);
        bank.counts[pixel] = moments.count;
        bank.means[pixel] = moments.mean;
        if let Some(m2) = bank.m2.get_mut(pixel) {
            *m2 = moments.m2;
        }
        if let Some(range) = bank.ranges.get_mut(pixel) {
            widen(range, radiance);
        }
        self.record.samples += 1;
        if let Some(reason) = reason {
            let stream = if halves { streams::HALVES[half] } else { streams::WHOLE };
            let sample = SampleId { pixel: self.frame.pixel(pixel), stream, index };
            self.list_rejected(1, vec![Rejected { sample, reason }]);
        }
    }

    /// The image's size and window.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// What is recorded.
    pub fn needs(&self) -> &Needs {
        &self.needs
    }

    /// How it went.
    pub fn record(&self) -> &Record {
        &self.record
    }

    /// How the halves are combined.
    pub fn combine(&self) -> Combine {
        self.combine
    }

    /// Rejected samples, the first 1024 in order of pixel, stream and index;
    /// [`Record::rejected`] counts all.
    pub fn rejected(&self) -> &[Rejected] {
        &self.rejected
    }

    /// Kept samples of pixel `i`.
    pub fn count(&self, i: usize) -> u64 {
        self.kept.iter().map(|b| b.counts[i]).sum()
    }

    /// The mean of pixel `i`'s kept samples, the halves combined as the sampler's plan says; black
    /// without samples.
    pub fn mean(&self, i: usize) -> [f64; 3] {
        let [a, b] = match &self.kept[..] {
            [a, b] => [a, b],
            banks => return banks[0].means[i],
        };
        let w = self.first_half_weight(i);
        std::array::from_fn(|c| w * a.means[i][c] + (1.0 - w) * b.means[i][c])
    }

    /// The weight of the first half in pixel `i`. A half without samples gets none.
    fn first_half_weight(&self, i: usize) -> f64 {
        let (a, b) = (self.kept[0].counts[i] as f64, self.kept[1].counts[i] as f64);
        match self.combine {
            _ if a == 0.0 => 0.0,
            _ if b == 0.0 => 1.0,
            Combine::ByCount => a / (a + b),
            Combine::Equally => 0.5,
            Combine::Fixed(w) => w.clamp(0.0, 1.0),
        }
    }

    /// Count, mean and deviations of all kept samples of pixel `i`, whatever half they belong to.
    /// Without [`Needs::variance`] the deviations are NaN.
    pub fn moments(&self, i: usize) -> RgbMoments {
        merged(&self.kept, i)
    }

    /// The same of one half's kept samples; `None` without halves.
    pub fn half(&self, half: usize, i: usize) -> Option<RgbMoments> {
        (self.kept.len() == 2).then(|| self.kept[half & 1].moments(i))
    }

    /// The same of discarded samples, withdrawn ones included; all zero while there are none.
    pub fn discarded(&self, i: usize) -> RgbMoments {
        if self.discarded.is_empty() { RgbMoments::default() } else { merged(&self.discarded, i) }
    }

    /// Smallest and largest kept sample of pixel `i` per channel; `None` without samples or without
    /// [`Needs::extrema`].
    pub fn range(&self, i: usize) -> Option<[[f32; 3]; 2]> {
        joined(&self.kept, i).map(colours)
    }

    /// Smallest and largest [`luminance`] of pixel `i`'s kept samples; `None` as for [`Film::range`].
    pub fn luminance_range(&self, i: usize) -> Option<[f32; 2]> {
        joined(&self.kept, i).map(|range| range.map(|v| v[3]))
    }

    /// [`Film::range`] of discarded samples.
    pub fn discarded_range(&self, i: usize) -> Option<[[f32; 3]; 2]> {
        joined(&self.discarded, i).map(colours)
    }

    /// [`Film::luminance_range`] of discarded samples.
    pub fn discarded_luminance_range(&self, i: usize) -> Option<[f32; 2]> {
        joined(&self.discarded, i).map(|range| range.map(|v| v[3]))
    }

    /// First-hit features of pixel `i`; `None` without [`Needs::features`].
    pub fn features(&self, i: usize) -> Option<Features> {
        let f = self.features.get(i)?;
        let v = |k: usize| [f.mean[k], f.mean[k + 1], f.mean[k + 2]];
        Some(Features {
            samples: f.samples,
            hits: f.hits,
            normal: v(0),
            albedo: v(3),
            position: v(6),
            depth: f.mean[9],
            variance: (f.hits >= 2).then(|| f.m2.map(|m| m / (f.hits - 1) as f32)),
        })
    }

    /// The first hits of pixel `i`'s first samples, [`Needs::first_hits`] of them; `None` for a sample
    /// that hit nothing or was not traced.
    pub fn first_hits(&self, i: usize) -> &[Option<FirstHit>] {
        let k = usize::from(self.needs.first_hits);
        &self.first_hits[i * k..(i + 1) * k]
    }

    /// What pixel `i` cost, in rays; `None` without [`Needs::cost`].
    pub fn cost(&self, i: usize) -> Option<u64> {
        self.costs.get(i).copied()
    }

    /// The unfiltered image: each pixel the mean of its own samples.
    pub fn image(&self) -> Vec<[f32; 3]> {
        (0..self.frame.pixels()).map(|i| self.mean(i).map(|x| x as f32)).collect()
    }

    /// Kept samples per pixel.
    pub fn counts(&self) -> Vec<u64> {
        (0..self.frame.pixels()).map(|i| self.count(i)).collect()
    }

    /// The estimated squared error of pixel `i`'s mean, per channel, from the difference of its two
    /// independently scrambled halves: `E (A - B)^2 = var A + var B`, shared out by count, for a
    /// mean `w A + (1 - w) B`. One degree of freedom a pixel: average over pixels before use.
    /// `None` without halves, or where a half is empty.
    pub fn squared_error(&self, i: usize) -> Option<[f64; 3]> {
        let [a, b] = &self.kept[..] else { return None };
        let (na, nb) = (a.counts[i] as f64, b.counts[i] as f64);
        if na == 0.0 || nb == 0.0 {
            return None;
        }
        let w = self.first_half_weight(i);
        let share = w * w * (nb / (na + nb)) + (1.0 - w) * (1.0 - w) * (na / (na + nb));
        let mut error = [0.0; 3];
        for (c, e) in error.iter_mut().enumerate() {
            let d = a.means[i][c] - b.means[i][c];
            *e = d * d * share;
        }
        Some(error)
    }

    /// [`Film::squared_error`] of every pixel, averaged over the channels; `None` without halves.
    pub fn squared_errors(&self) -> Option<Vec<f32>> {
        if self.kept.len() != 2 {
            return None;
        }
        let mean = |e: [f64; 3]| ((e[0] + e[1] + e[2]) / 3.0) as f32;
        Some((0..self.frame.pixels()).map(|i| self.squared_error(i).map_or(f32::INFINITY, mean)).collect())
    }

    /// The image's own estimate of its relMSE, `mean((x - truth)^2 / (truth^2 + 0.01))` over pixels
    /// and channels; `None` without halves, or while a pixel lacks a sample in one of them.
    ///
    /// For the truth stands the mean of the pixel and its neighbours, 3x3 of them: a pixel's own mean is high where its
    /// error is, and would hide it. On the bundled scenes with 8 and more samples per pixel what is predicted is .65 to
    /// 1.05 of what is so, with the pixel's own mean .07 to 1.11 (`examples/predicted_error.rs`).
    pub fn predicted_relmse(&self) -> Option<f64> {
        if self.kept.len() != 2 {
            return None;
        }
        let [width, height] = self.frame.size().map(|n| n as usize);
        // Three rows of means at a time: an image of them would be as much memory again as a film of samples.
        let mut means = vec![[0.0; 3]; 3 * width];
        let fill = |y: usize, means: &mut [[f64; 3]]| {
            let row = &mut means[y % 3 * width..][..width];
            row.iter_mut().enumerate().for_each(|(x, mean)| *mean = self.mean(y * width + x));
        };
        fill(0, &mut means);
        let mut sum = 0.0;
        for y in 0..height {
            if y + 1 < height {
                fill(y + 1, &mut means);
            }
            for x in 0..width {
                let error = self.squared_error(y * width + x)?;
                let (rows, columns) =
                    (y.saturating_sub(1)..(y + 2).min(height), x.saturating_sub(1)..(x + 2).min(width));
                let count = (rows.len() * columns.len()) as f64;
                let mut level = [0.0; 3];
                for row in rows {
                    for mean in &means[row % 3 * width..][columns.clone()] {
                        (0..3).for_each(|c| level[c] += mean[c] / count);
                    }
                }
                sum += (0..3).map(|c| error[c] / (level[c] * level[c] + 0.01)).sum::<f64>();
            }
        }
        Some(sum / (3 * width * height) as f64)
    }

    /// Refuses a film that lacks something: the first line of a filter.
    ///
    /// # Errors
    ///
    /// [`Error::NotRecorded`], naming `who` and what is missing.
    pub fn require(&self, who: &str, needs: &Needs) -> Result<(), Error> {
        let have = &self.needs;
        let missing = [
            (needs.variance && !have.variance, "the sample variance"),
            (needs.extrema && !have.extrema, "the extrema"),
            (needs.halves && !have.halves, "independent halves"),
            (needs.features && !have.features, "first-hit features"),
            (needs.first_hits > have.first_hits, "first hits"),
            (needs.cost && !have.cost, "costs"),
        ];
        match missing.iter().find(|m| m.0) {
            Some((_, what)) => Err(Error::NotRecorded { who: who.to_owned(), what }),
            None => Ok(()),
        }
    }

    /// Makes room for discarded samples.
    pub(crate) fn open_discarded(&mut self) {
        if self.discarded.is_empty() {
            let pixels = self.frame.pixels();
            self.discarded = self.kept.iter().map(|_| Bank::new(pixels, &self.needs)).collect();
        }
    }

    /// Takes the kept samples of the marked pixels out of the image, to the discarded ones.
    pub(crate) fn withdraw(&mut self, withdrawn: &[bool]) {
        self.open_discarded();
        for (kept, discarded) in self.kept.iter_mut().zip(&mut self.discarded) {
            kept.withdraw_into(discarded, withdrawn);
        }
    }

    /// Counts newly rejected samples and lists the first of them in order of pixel, stream and index.
    pub(crate) fn list_rejected(&mut self, count: u64, first: Vec<Rejected>) {
        self.record.rejected += count;
        self.rejected.extend(first);
        keep_first(&mut self.rejected);
    }
}

/// Why a sample is no radiance.
#[inline]
pub(crate) fn reason_to_reject([r, g, b]: [f32; 3]) -> Option<RejectedReason> {
    if r >= 0.0 && g >= 0.0 && b >= 0.0 && r < f32::INFINITY && g < f32::INFINITY && b < f32::INFINITY {
        None
    } else if r.is_finite() && g.is_finite() && b.is_finite() {
        Some(RejectedReason::Negative)
    } else {
        Some(RejectedReason::NotFinite)
    }
}

/// Sorts by pixel, stream and index, and keeps as many as are listed.
pub(crate) fn keep_first(rejected: &mut Vec<Rejected>) {
    rejected.sort_by_key(|r| (r.sample.pixel[1], r.sample.pixel[0], r.sample.stream, r.sample.index));
    rejected.truncate(REJECTED_LISTED);
}

fn colours(range: Range) -> [[f32; 3]; 2] {
    range.map(|[r, g, b, _]| [r, g, b])
}

/// The range over all banks that have samples of pixel `i`.
fn joined(banks: &[Bank], i: usize) -> Option<Range> {
    let mut ranges = banks.iter().filter(|b| b.counts[i] > 0).filter_map(|b| b.ranges.get(i));
    let mut all = *ranges.next()?;
    ranges.for_each(|range| join(&mut all, range));
    Some(all)
}

fn merged(banks: &[Bank], i: usize) -> RgbMoments {
    let mut moments = banks[0].moments(i);
    for bank in &banks[1..] {
        moments.merge(&bank.moments(i));
    }
    moments
}

#[cfg(test)]
mod tests;
