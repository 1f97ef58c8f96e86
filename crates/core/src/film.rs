//! Films: planes of per-pixel statistics, and the record of a render.

mod bank;
mod error;
mod gather;
mod half;
mod held;
mod pick;
mod pixels;
mod push;
mod record;
mod refined;
mod samples;
mod splats;
mod sums;
mod window;

pub use bank::luminance;
pub(crate) use bank::{Bank, BankRows, first_hits_of, record_first_hit};
pub(crate) use gather::both;
pub(crate) use held::HeldRows;
pub(crate) use pick::Picked;
pub use pixels::PixelStatistics;
pub(crate) use record::{REJECTED_LISTED, keep_first, reason_to_reject};
pub use record::{Record, Rejected, RejectedReason, RoundRecord};
pub(crate) use refined::EmissionAlone;
pub(crate) use samples::{SamplePlane, SampleRows, reserve_samples};
pub(crate) use splats::Splats;
pub use sums::{SampleSums, ThirdMoments};
pub(crate) use sums::{SumPlane, SumRows};

use crate::{Combine, Error, FirstHit, Frame, Needs, RgbMoments, Sums, SurfaceFeatures};
use bank::{Range, join};

/// Running means and sums of squared deviations of a pixel's features: shading normal, albedo, position, depth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FeatureMoments {
    pub(crate) samples: u32,
    pub(crate) hits: u32,
    pub(crate) mean: [f32; 10],
    pub(crate) m2: [f32; 10],
    pub(crate) emission: EmissionAlone,
}

impl FeatureMoments {
    pub(crate) fn push(&mut self, features: Option<SurfaceFeatures>) {
        if self.samples > 0 && features.is_some_and(|f| f.rare) {
            return;
        }
        self.samples = self.samples.saturating_add(1);
        let Some(SurfaceFeatures { normal: n, albedo: a, position: p, depth, .. }) = features else { return };
        self.hits = self.hits.saturating_add(1);
        let share = 1.0 / self.hits as f32;
        let values = [n[0], n[1], n[2], a[0], a[1], a[2], p[0], p[1], p[2], depth];
        for ((mean, m2), x) in self.mean.iter_mut().zip(&mut self.m2).zip(values) {
            let delta = x - *mean;
            *mean += delta * share;
            *m2 += delta * (x - *mean);
        }
    }

    /// Returns `true` if samples of features alone would help: there are few, or they vary and there are not many.
    pub(crate) fn wants_more(&self) -> bool {
        /// The number of samples after which equal features count as those of the whole pixel.
        const FEW: u32 = 4;
        /// The number of samples at which features count as known.
        const MANY: u32 = 12;
        /// The variances of normal and albedo, summed over channels, below which they count as equal.
        const EQUAL: [f32; 2] = [1e-3, 1e-4];
        let sum = |k: usize| self.m2[k] + self.m2[k + 1] + self.m2[k + 2];
        let hits = self.hits as f32;
        let varies =
            self.hits > 0 && (self.hits < self.samples || sum(0) > EQUAL[0] * hits || sum(3) > EQUAL[1] * hits);
        self.samples < FEW || self.samples < MANY && varies
    }
}

/// Mean and sample variance of one pixel's [`SurfaceFeatures`], or of its first hits for samples that have none. Means are
/// over the samples that hit a surface.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    /// The number of samples of the pixel, with those of [features alone](crate::Integrator::features_alone) and without those
    /// whose features are left out as [rare](SurfaceFeatures::rare).
    pub samples: u32,
    /// The number of samples that hit a surface.
    pub hits: u32,
    /// Mean shading normal; its length is below 1 if normals differ.
    pub normal: [f32; 3],
    /// Mean albedo, linear RGB in `[0, 1]`.
    pub albedo: [f32; 3],
    /// Mean position, in the integrator's units.
    pub position: [f32; 3],
    /// Mean length of the path to the surface, in the integrator's units.
    pub depth: f32,
    /// Sample variances of normal (3), albedo (3), position (3) and depth (1), in this order; `None` below two hits.
    pub variance: Option<[f32; 10]>,
}

impl From<&FeatureMoments> for Features {
    fn from(f: &FeatureMoments) -> Self {
        let v = |k: usize| [f.mean[k], f.mean[k + 1], f.mean[k + 2]];
        Self {
            samples: f.samples,
            hits: f.hits,
            normal: v(0),
            albedo: v(3),
            position: v(6),
            depth: f.mean[9],
            variance: (f.hits >= 2).then(|| f.m2.map(|m| m / (f.hits - 1) as f32)),
        }
    }
}

/// Per-pixel statistics of a render, row by row over its window, and its [`Record`].
///
/// A process of several may hold its rows only ([`Film::is_whole`]). Reading another pixel panics, as one outside the window does.
///
/// Samplers and filters read films. A renderer with a loop of its own fills one by [`Film::push_estimate`]. Tests can push
/// radiance alone:
///
/// ```
/// use dapple_core::{Film, Frame, Needs};
///
/// let mut film = Film::new(Frame::new(2, 1)?, Needs::none().with_variance());
/// film.push(0, 0, [1.0, 0.5, 0.0]);
/// film.push(0, 0, [3.0, 0.5, 0.0]);
/// assert_eq!(film.count(0), 2);
/// assert_eq!(film.mean(0), [2.0, 0.5, 0.0]);
/// assert_eq!(film.moments(0).variance(), Some([2.0, 0.0, 0.0]));
///
/// // A NaN is rejected, counts as zero and is listed.
/// film.push(1, 0, [f32::NAN; 3]);
/// assert_eq!((film.mean(1), film.rejected().len()), ([0.0; 3], 1));
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    pub(crate) frame: Frame,
    pub(crate) needs: Needs,
    pub(crate) combine: Combine,
    /// Statistics of kept samples (those in the image): one bank, or one per half.
    pub(crate) kept: Vec<Bank>,
    /// Statistics of discarded samples (those not in the image): one bank, or one per half. Empty until samples are
    /// discarded.
    pub(crate) discarded: Vec<Bank>,
    pub(crate) features: Vec<FeatureMoments>,
    /// The features of each half's samples: two per pixel, or none.
    pub(crate) half_features: Vec<FeatureMoments>,
    pub(crate) first_hits: Vec<Option<FirstHit>>,
    pub(crate) costs: Vec<u64>,
    pub(crate) splats: Splats,
    pub(crate) rejected: Vec<Rejected>,
    pub(crate) record: Record,
    /// The number of samples that report neither a hit nor a miss. Only [`Film::require`] reads it.
    pub(crate) unreported: u64,
    /// The half of another film that this film holds alone.
    pub(crate) half_of: Option<usize>,
    pub(crate) held: HeldRows,
}

impl Film {
    /// An empty film of `frame` that records the statistics `needs`.
    pub fn new(frame: Frame, needs: Needs) -> Self {
        Self::of_held(frame, needs, HeldRows::default())
    }

    /// An empty film that holds some rows of the window.
    pub(crate) fn of_held(frame: Frame, needs: Needs, held: HeldRows) -> Self {
        let pixels = held.pixels(&frame);
        let halves = if needs.halves { 2 } else { 1 };
        let mut film = Self {
            kept: (0..halves).map(|_| Bank::new(pixels, &needs)).collect(),
            splats: if needs.splats { Splats::new(pixels, halves) } else { Splats::default() },
            held,
            ..Self::without_planes(frame, needs)
        };
        film.clear_beside(pixels);
        film
    }

    /// Gives the planes beside the banks `pixels` pixels without samples.
    pub(crate) fn clear_beside(&mut self, pixels: usize) {
        let needs = self.needs;
        self.features = vec![FeatureMoments::default(); if needs.features { pixels } else { 0 }];
        self.half_features = vec![FeatureMoments::default(); pixels * needs.feature_planes()];
        self.first_hits = vec![None; pixels * usize::from(needs.first_hits)];
        self.costs = vec![0; if needs.cost { pixels } else { 0 }];
    }

    /// A film without a pixel in any plane, for code that fills the planes.
    pub(crate) fn without_planes(frame: Frame, needs: Needs) -> Self {
        Self {
            frame,
            needs,
            combine: Combine::ByCount,
            kept: Vec::new(),
            discarded: Vec::new(),
            features: Vec::new(),
            half_features: Vec::new(),
            first_hits: Vec::new(),
            costs: Vec::new(),
            splats: Splats::default(),
            rejected: Vec::new(),
            record: Record::default(),
            unreported: 0,
            half_of: None,
            held: HeldRows::default(),
        }
    }

    /// The bytes per pixel of a film that records `needs`, before any sample is discarded. Each sample stored one by one takes
    /// 12 bytes more, and 28 with its trajectory.
    pub fn bytes_per_pixel(needs: &Needs) -> usize {
        Self::bank_bytes_per_pixel(needs)
            + if needs.features { size_of::<FeatureMoments>() } else { 0 }
            + needs.feature_planes() * size_of::<FeatureMoments>()
            + usize::from(needs.first_hits) * size_of::<Option<FirstHit>>()
            + if needs.cost { 8 } else { 0 }
            + if needs.splats { size_of::<[i128; 3]>() * if needs.halves { 2 } else { 1 } } else { 0 }
    }

    /// The bytes per pixel for the statistics of all kept samples, or of all discarded samples.
    pub(crate) fn bank_bytes_per_pixel(needs: &Needs) -> usize {
        let bank = 8 + 24 + if needs.variance { 24 } else { 0 } + if needs.extrema { 32 } else { 0 };
        let bank = bank + if needs.emission { 12 } else { 0 };
        let bank = bank + needs.values() * if needs.variance { 8 } else { 4 };
        let bank = bank + needs.sums.values() * size_of::<[f64; 3]>();
        let rows = usize::from(needs.samples > 0) + usize::from(needs.samples > 0 && needs.trajectories);
        let bank = bank + rows * size_of::<Vec<[f32; 3]>>();
        bank * if needs.halves { 2 } else { 1 }
    }

    /// The image's resolution and its rendered window.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The statistics that the film records besides counts and means.
    pub fn needs(&self) -> &Needs {
        &self.needs
    }

    /// The budgets, rounds, totals and timings of the render.
    pub fn record(&self) -> &Record {
        &self.record
    }

    /// The rule by which the means of the two halves become the pixel's mean.
    pub fn combine(&self) -> Combine {
        self.combine
    }

    /// The first 1024 rejected samples in order of pixel, stream and index. [`Record::rejected`] counts all.
    pub fn rejected(&self) -> &[Rejected] {
        &self.rejected
    }

    /// The number of kept samples of pixel `i`, both halves together.
    pub fn count(&self, i: usize) -> u64 {
        let i = self.held.at(i);
        self.kept.iter().map(|b| b.counts[i]).sum()
    }

    /// The mean radiance of pixel `i`'s kept samples, linear RGB. Halves are combined by [`Film::combine`]; without
    /// samples it is black.
    pub fn mean(&self, i: usize) -> [f64; 3] {
        let i = self.held.at(i);
        let [a, b] = match &self.kept[..] {
            [a, b] => [a, b],
            banks => return plus(banks[0].means[i], self.splats.mean(&self.frame, 0, i)),
        };
        let w = self.first_half_weight(i);
        let own = std::array::from_fn(|c| w * a.means[i][c] + (1.0 - w) * b.means[i][c]);
        if self.splats.sums.is_empty() { own } else { plus(own, self.splatted(w, i)) }
    }

    /// The mean radiance that splats add at place `i`, if the first half has weight `w`.
    fn splatted(&self, w: f64, i: usize) -> [f64; 3] {
        let [a, b] = [0, 1].map(|half| self.splats.mean(&self.frame, half, i));
        std::array::from_fn(|c| w * a[c] + (1.0 - w) * b[c])
    }

    /// The weight, in `[0, 1]`, of the first half in the mean at place `i`. A half without samples has weight 0.
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

    /// Count, mean and sum of squared deviations of all kept samples of pixel `i`, both halves together. Without
    /// [`Needs::variance`] the deviations are NaN. The mean is without splats.
    pub fn moments(&self, i: usize) -> RgbMoments {
        merged(&self.kept, self.held.at(i))
    }

    /// Count, mean and sum of squared deviations of pixel `i`'s kept samples in half 0 or 1; `None` in a film without
    /// halves.
    pub fn half(&self, half: usize, i: usize) -> Option<RgbMoments> {
        (self.kept.len() == 2).then(|| {
            let i = self.held.at(i);
            let moments = self.kept[half & 1].moments(i);
            RgbMoments { mean: plus(moments.mean, self.splats.mean(&self.frame, half & 1, i)), ..moments }
        })
    }

    /// The means of the values beside the radiance over pixel `i`'s kept samples: of half 0 or 1, or of all samples in a
    /// film without halves. As many as [`Needs::channels`].
    pub fn channels(&self, half: usize, i: usize) -> &[f32] {
        let (i, each) = (self.held.at(i), self.needs.values());
        &self.kept[half % self.kept.len()].channels[i * each..][..usize::from(self.needs.channels)]
    }

    /// Count, mean and sum of squared deviations of the indirect light of pixel `i`'s kept samples: of half 0 or 1, or of all
    /// samples in a film without halves. Without [`Needs::variance`] the deviations are NaN. `None` without
    /// [`Needs::indirect`].
    pub fn indirect(&self, half: usize, i: usize) -> Option<RgbMoments> {
        if !self.needs.indirect {
            return None;
        }
        let (bank, i) = (&self.kept[half % self.kept.len()], self.held.at(i));
        let first = i * self.needs.values() + usize::from(self.needs.channels);
        let of = |plane: &[f32]| [0, 1, 2].map(|c| f64::from(plane[first + c]));
        let m2 = if self.needs.variance { of(&bank.channels_m2) } else { [f64::NAN; 3] };
        Some(RgbMoments { count: bank.counts[i], mean: of(&bank.channels), m2 })
    }

    /// A film whose radiance is three of the values beside the radiance, so that any filter can be applied to them: three
    /// bands of a spectrum, for example. Features and counts stay; splats, emission, indirect light, sums and single samples are
    /// left out.
    ///
    /// # Errors
    ///
    /// [`Error::NotRecorded`] for a channel that the film does not record.
    pub fn with_channels_as_colour(&self, channels: [u16; 3]) -> Result<Self, Error> {
        if channels.iter().any(|&c| c >= self.needs.channels) {
            return Err(Error::NotRecorded { who: "with_channels_as_colour".into(), what: "so many channels" });
        }
        let mut film = self.clone();
        film.needs = Needs {
            emission: false,
            indirect: false,
            splats: false,
            extrema: false,
            channels: 0,
            sums: Sums::NONE,
            samples: 0,
            trajectories: false,
            ..film.needs
        };
        film.splats = Splats::default();
        film.kept.iter_mut().chain(&mut film.discarded).for_each(|bank| bank.take_colour(channels.map(usize::from)));
        Ok(film)
    }

    /// The mean emission of light sources that pixel `i`'s kept samples saw directly: of half 0 or 1, or of all samples in
    /// a film without halves. `None` without [`Needs::emission`].
    pub fn emission(&self, half: usize, i: usize) -> Option<[f32; 3]> {
        self.kept[half % self.kept.len()].emission.get(self.held.at(i)).copied()
    }

    /// Count, mean and sum of squared deviations of pixel `i`'s discarded samples, withdrawn ones included; zero if
    /// there are none.
    pub fn discarded(&self, i: usize) -> RgbMoments {
        if self.discarded.is_empty() { RgbMoments::default() } else { merged(&self.discarded, self.held.at(i)) }
    }

    /// The smallest and the largest value per channel of pixel `i`'s kept samples. `None` without samples or without
    /// [`Needs::extrema`].
    pub fn range(&self, i: usize) -> Option<[[f32; 3]; 2]> {
        joined(&self.kept, self.held.at(i)).map(colours)
    }

    /// The smallest and the largest [`luminance`] of pixel `i`'s kept samples. `None` without samples or without
    /// [`Needs::extrema`].
    pub fn luminance_range(&self, i: usize) -> Option<[f32; 2]> {
        joined(&self.kept, self.held.at(i)).map(|range| range.map(|v| v[3]))
    }

    /// The smallest and the largest value per channel of pixel `i`'s discarded samples. `None` without such samples or
    /// without [`Needs::extrema`].
    pub fn discarded_range(&self, i: usize) -> Option<[[f32; 3]; 2]> {
        joined(&self.discarded, self.held.at(i)).map(colours)
    }

    /// The smallest and the largest [`luminance`] of pixel `i`'s discarded samples. `None` without such samples or
    /// without [`Needs::extrema`].
    pub fn discarded_luminance_range(&self, i: usize) -> Option<[f32; 2]> {
        joined(&self.discarded, self.held.at(i)).map(|range| range.map(|v| v[3]))
    }

    /// Mean and variance of normal, albedo, position and depth of pixel `i`'s samples; `None` without
    /// [`Needs::features`].
    pub fn features(&self, i: usize) -> Option<Features> {
        self.features.get(self.held.at(i)).map(Into::into)
    }

    /// The first hits of the first samples of pixel `i`, as many as [`Needs::first_hits`]. An element is `None` if its
    /// sample missed or was not traced.
    pub fn first_hits(&self, i: usize) -> &[Option<FirstHit>] {
        let (i, k) = (self.held.at(i), usize::from(self.needs.first_hits));
        &self.first_hits[i * k..(i + 1) * k]
    }

    /// The number of rays traced for pixel `i`; `None` without [`Needs::cost`].
    pub fn cost(&self, i: usize) -> Option<u64> {
        self.costs.get(self.held.at(i)).copied()
    }

    /// The unfiltered image, linear RGB row by row: each pixel is the mean of its own samples.
    pub fn image(&self) -> Vec<[f32; 3]> {
        (0..self.frame.pixels()).map(|i| self.mean(i).map(|x| x as f32)).collect()
    }

    /// The number of kept samples per pixel, row by row.
    pub fn counts(&self) -> Vec<u64> {
        (0..self.frame.pixels()).map(|i| self.count(i)).collect()
    }

    /// Checks that the film records all of `needs` but emission and indirect light, without which filters work too. A filter
    /// calls this first.
    ///
    /// # Errors
    ///
    /// [`Error::NotRecorded`], with the name `who` of the filter and the missing statistics.
    /// [`Error::NoneReported`] if the film has room for features or first hits, but no sample reports a hit or a miss.
    pub fn require(&self, who: &str, needs: &Needs) -> Result<(), Error> {
        let have = &self.needs;
        let missing = [
            (needs.variance && !have.variance, "the sample variance"),
            (needs.extrema && !have.extrema, "the extrema"),
            (needs.halves && !have.halves, "independent halves"),
            (needs.features && !have.features, "first-hit features"),
            (needs.feature_halves && have.feature_planes() == 0, "first-hit features per half"),
            (needs.first_hits > have.first_hits, "first hits"),
            (needs.cost && !have.cost, "costs"),
            (needs.splats && !have.splats, "splats"),
            (needs.channels > have.channels, "values beside the radiance"),
            (!have.sums.contains(needs.sums), "sums of logarithms or roots"),
            (needs.samples > have.samples, "samples one by one"),
            (needs.trajectories && !have.trajectories, "the trajectories of samples"),
        ];
        if let Some((_, what)) = missing.iter().find(|m| m.0) {
            return Err(Error::NotRecorded { who: who.to_owned(), what });
        }
        if self.record.samples == 0 || self.unreported < self.record.samples || !needs.wants_first_hit() {
            return Ok(());
        }
        let what = match needs {
            Needs { features: true, .. } => "first-hit features",
            Needs { trajectories: true, .. } => "the trajectories of first hits",
            _ => "first hits",
        };
        Err(Error::NoneReported { who: who.to_owned(), what })
    }

    /// Allocates planes for discarded samples, if there are none.
    pub(crate) fn open_discarded(&mut self) {
        if self.discarded.is_empty() {
            let pixels = self.held.pixels(&self.frame);
            self.discarded = self.kept.iter().map(|_| Bank::new(pixels, &self.needs)).collect();
        }
    }

    /// Moves the kept samples of the marked pixels to the statistics of the discarded samples.
    pub(crate) fn withdraw(&mut self, withdrawn: &[bool]) {
        self.open_discarded();
        let marked = withdrawn.iter().enumerate().filter(|(_, marked)| **marked);
        let places: Vec<usize> = marked.map(|(i, _)| self.held.at(i)).collect();
        for (kept, discarded) in self.kept.iter_mut().zip(&mut self.discarded) {
            kept.withdraw_into(discarded, &places);
        }
    }

    /// Adds splats, by half, pixel and radiance.
    pub(crate) fn add_splats(&mut self, splats: Vec<(usize, [u32; 2], [f32; 3])>) {
        for (half, pixel, radiance) in splats {
            self.splats.add(&self.frame, half, pixel, radiance);
        }
    }

    /// Counts newly rejected samples and lists the first of them in order of pixel, stream and index.
    pub(crate) fn list_rejected(&mut self, count: u64, first: Vec<Rejected>) {
        self.record.rejected += count;
        self.rejected.extend(first);
        keep_first(&mut self.rejected);
    }
}

fn colours(range: Range) -> [[f32; 3]; 2] {
    range.map(|[r, g, b, _]| [r, g, b])
}

/// The smallest and the largest values of pixel `i`'s samples over all `banks`; `None` without samples.
fn joined(banks: &[Bank], i: usize) -> Option<Range> {
    let mut ranges = banks.iter().filter(|b| b.counts[i] > 0).filter_map(|b| b.ranges.get(i));
    let mut all = *ranges.next()?;
    ranges.for_each(|range| join(&mut all, range));
    Some(all)
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|c| a[c] + b[c])
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
