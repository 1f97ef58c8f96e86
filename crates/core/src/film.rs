//! Films: planes of per-pixel statistics, and the record of a render.

mod add;
mod estimates;
mod features;
mod lamps;
mod parts;
mod planes;
mod record;
mod splats;

pub use add::luminance;
pub(crate) use add::{Strip, record_first_hit};
pub(crate) use features::FeatureMoments;
pub use features::Features;
pub(crate) use lamps::{EmissionAlone, LampEdges};
pub use parts::PixelStatistics;
pub(crate) use planes::{Beside, Half, Layout, Spread, Window};
pub(crate) use record::{REJECTED_LISTED, keep_first};
pub use record::{Record, Rejected, RejectedReason, RoundRecord};
pub(crate) use splats::Splats;

pub use crate::moments::{Moments, RgbMoments};
pub use crate::recorder::{RecordedSample, Recorder};

use crate::plan::{Combine, Retention};
use crate::{Error, FirstHit, Frame, Needs, SampleId, point_set::streams, recorder::Recorders};
use std::sync::Arc;

/// The per-pixel statistics of a render's window, in row-major order, and the render's [`Record`].
///
/// Samplers and filters read films. A renderer with its own loop fills one with [`Film::push_estimate`]. Tests can push
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
    /// Statistics of kept samples (those in the image): one entry for all, or one per half.
    pub(crate) kept: Vec<Half>,
    /// Statistics of discarded samples (those not in the image): one entry for all, or one per half. Empty until samples
    /// are discarded.
    pub(crate) discarded: Vec<Half>,
    /// Squared deviations of kept samples.
    pub(crate) spread: Spread,
    /// Squared deviations of discarded samples. Empty until samples are discarded.
    pub(crate) discarded_spread: Spread,
    /// For each half and pixel, the number of withdrawn samples, which were in the image before they were discarded.
    /// Empty until samples are withdrawn.
    pub(crate) withdrawn: Vec<Vec<u32>>,
    pub(crate) beside: Beside,
    pub(crate) lamp_edges: LampEdges,
    pub(crate) recorders: Recorders,
    pub(crate) splats: Splats,
    pub(crate) rejected: Vec<Rejected>,
    pub(crate) record: Record,
    /// The number of samples that report neither a hit nor a miss. Only [`Film::require`] reads it.
    pub(crate) unreported: u64,
    /// The half that this film was made from by [`Film::half_film`].
    pub(crate) half_of: Option<usize>,
}

impl Film {
    /// An empty film of `frame` that records the statistics listed in `needs`.
    pub fn new(frame: Frame, needs: Needs) -> Self {
        Self::with_recorders(frame, needs, [])
    }

    /// An empty film of `frame`. It records the statistics listed in `needs` and those of `recorders`.
    pub fn with_recorders(frame: Frame, needs: Needs, recorders: impl IntoIterator<Item = Arc<dyn Recorder>>) -> Self {
        let mut film = Self::without_planes(frame, needs);
        film.recorders = Recorders::new(recorders);
        let (pixels, halves, layout) = (frame.pixels(), if needs.halves { 2 } else { 1 }, film.layout());
        film.kept = (0..halves).map(|_| Half::new(pixels, &layout)).collect();
        film.spread = Spread::new(pixels, &layout);
        film.beside = Beside::new(pixels, &layout);
        film.splats = if needs.splats { Splats::new(frame, halves) } else { Splats::default() };
        film
    }

    /// A film with empty planes, for code that fills them.
    pub(crate) fn without_planes(frame: Frame, needs: Needs) -> Self {
        Self {
            frame,
            needs,
            combine: Combine::ByCount,
            kept: Vec::new(),
            discarded: Vec::new(),
            spread: Spread::default(),
            discarded_spread: Spread::default(),
            withdrawn: Vec::new(),
            beside: Beside::default(),
            lamp_edges: LampEdges::default(),
            recorders: Recorders::default(),
            splats: Splats::default(),
            rejected: Vec::new(),
            record: Record::default(),
            unreported: 0,
            half_of: None,
        }
    }

    pub(crate) fn layout(&self) -> Layout {
        Layout { needs: self.needs, recorders: self.recorders.names.len() }
    }

    /// The bytes per pixel of a film with these `needs`. Discarded samples and the data of [`Recorder`]s are not included.
    pub fn bytes_per_pixel(needs: &Needs) -> usize {
        let halves = if needs.halves { 2 } else { 1 };
        let splats = if needs.splats { halves * size_of::<[i128; 3]>() } else { 0 };
        Self::halves_bytes_per_pixel(needs) + Beside::bytes_per_pixel(&Layout { needs: *needs, recorders: 0 }) + splats
    }

    /// The bytes per pixel for radiance, emission and indirect lighting of the kept samples. Discarded ones need as many again.
    pub fn halves_bytes_per_pixel(needs: &Needs) -> usize {
        let halves = if needs.halves { 2 } else { 1 };
        halves * Self::half_bytes_per_pixel(needs) + Spread::bytes_per_pixel(&Layout { needs: *needs, recorders: 0 })
    }

    /// The bytes per pixel for the statistics of one half alone, without squared deviations.
    pub fn half_bytes_per_pixel(needs: &Needs) -> usize {
        Half::bytes_per_pixel(&Layout { needs: *needs, recorders: 0 })
    }

    /// The names of the film's recorders.
    pub fn recorder_names(&self) -> &[String] {
        &self.recorders.names
    }

    /// The data of the [`Recorder`] called `name`: a list of 32-bit words per pixel. `None` if the film lacks this recorder.
    pub fn recorded(&self, name: &str) -> Option<Recorded<'_>> {
        Some(Recorded { film: self, number: self.recorders.position(name)? })
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

    /// The rule that combines the means of the two halves into the pixel's mean.
    pub fn combine(&self) -> Combine {
        self.combine
    }

    /// The first 1024 rejected samples in order of pixel, stream and index. [`Record::rejected`] counts all.
    pub fn rejected(&self) -> &[Rejected] {
        &self.rejected
    }

    /// The number of kept samples of pixel `i`, both halves together.
    pub fn count(&self, i: usize) -> u64 {
        self.kept.iter().map(|half| u64::from(half.counts[i])).sum()
    }

    /// Returns `true` if pixel `i` has kept samples and all were rejected. Its mean is then black;
    /// [`filled`](crate::filter::filled) replaces it by a neighbour's.
    pub fn is_rejected(&self, i: usize) -> bool {
        self.count(i) > 0 && self.kept.iter().all(|half| half.counts[i] == 0 || planes::is_none_valid(half.means[i]))
    }

    /// The mean radiance of pixel `i`'s kept samples plus splats, linear RGB. Halves are combined by [`Film::combine`]. A
    /// pixel without samples and splats is black.
    pub fn mean(&self, i: usize) -> [f64; 3] {
        let [a, b] = match &self.kept[..] {
            [a, b] => [a, b],
            halves => return plus(halves[0].means[i], self.splats.mean(0, i)),
        };
        let w = self.first_half_weight(i);
        let own = std::array::from_fn(|c| w * a.means[i][c] + (1.0 - w) * b.means[i][c]);
        if self.splats.sums.is_empty() { own } else { plus(own, self.splatted(w, i)) }
    }

    /// The mean radiance that splats add to pixel `i`, if the first half has weight `w`.
    fn splatted(&self, w: f64, i: usize) -> [f64; 3] {
        let [a, b] = [0, 1].map(|half| self.splats.mean(half, i));
        std::array::from_fn(|c| w * a[c] + (1.0 - w) * b[c])
    }

    /// The weight, in `[0, 1]`, of the first half in the mean of pixel `i`. A half without samples has weight 0.
    fn first_half_weight(&self, i: usize) -> f64 {
        let (a, b) = (f64::from(self.kept[0].counts[i]), f64::from(self.kept[1].counts[i]));
        match self.combine {
            _ if a == 0.0 => 0.0,
            _ if b == 0.0 => 1.0,
            Combine::ByCount => a / (a + b),
            Combine::Equally => 0.5,
            Combine::Fixed(w) => w.clamp(0.0, 1.0),
        }
    }

    /// Count, mean and sum of squared deviations of all kept samples of pixel `i`, both halves together. Without
    /// [`Needs::variance`] the deviations are NaN. The mean excludes splats.
    ///
    /// Squared deviations are summed in `f32`, with a relative error below 1e-4 for a million samples.
    pub fn moments(&self, i: usize) -> RgbMoments {
        self.merged(&self.kept, |half| half.means[i], &self.spread.m2, i)
    }

    /// Count, mean and sum of squared deviations of pixel `i`'s kept samples in half 0 or 1; `None` in a film without
    /// halves. Without [`Needs::half_variance`] the deviations are NaN.
    pub fn half(&self, half: usize, i: usize) -> Option<RgbMoments> {
        (self.kept.len() == 2).then(|| {
            let (half, planes) = (half & 1, &self.kept[half & 1]);
            let mean = plus(planes.means[i], self.splats.mean(half, i));
            RgbMoments { count: planes.counts[i].into(), mean, m2: self.own_m2(&self.spread.m2, half, i) }
        })
    }

    /// Count, mean and sum of squared deviations of the indirect lighting in all kept samples of pixel `i`. Without
    /// [`Needs::variance`] the deviations are NaN. `None` if the film lacks [`Needs::indirect`].
    pub fn indirect(&self, i: usize) -> Option<RgbMoments> {
        let mean = |half: &Half| half.indirect[i].map(f64::from);
        self.needs.indirect.then(|| self.merged(&self.kept, mean, &self.spread.indirect_m2, i))
    }

    /// Count, mean and sum of squared deviations of the indirect lighting in pixel `i`'s kept samples: of half 0 or 1, or of
    /// all samples in a film without halves. In a film with halves and without [`Needs::half_variance`] the deviations are NaN.
    /// `None` if the film lacks [`Needs::indirect`].
    pub fn half_indirect(&self, half: usize, i: usize) -> Option<RgbMoments> {
        let half = half % self.kept.len();
        let (planes, m2) = (&self.kept[half], self.own_m2(&self.spread.indirect_m2, half, i));
        Some(RgbMoments { count: planes.counts[i].into(), mean: planes.indirect.get(i)?.map(f64::from), m2 })
    }

    /// The squared deviations of pixel `i` in one half; NaN if they are recorded for both halves together, or not at all.
    fn own_m2(&self, m2: &[[f32; 3]], half: usize, i: usize) -> [f64; 3] {
        let is_own = self.kept.len() == 1 || self.needs.splits_variance();
        m2.get(self.needs.sum_at(half, i)).filter(|_| is_own).map_or([f64::NAN; 3], |m2| m2.map(f64::from))
    }

    /// The moments of pixel `i` over both halves, from the mean and the squared deviations of each.
    fn merged(&self, halves: &[Half], mean: impl Fn(&Half) -> [f64; 3], m2: &[[f32; 3]], i: usize) -> RgbMoments {
        let mut all = RgbMoments::default();
        for half in halves {
            all.merge(&RgbMoments { count: half.counts[i].into(), mean: mean(half), m2: [0.0; 3] });
        }
        let sums = self.needs.sums();
        for c in 0..3 {
            let own = m2.get(sums * i..sums * (i + 1)).filter(|own| !own.is_empty());
            all.m2[c] += own.map_or(f64::NAN, |own| own.iter().map(|m2| f64::from(m2[c])).sum());
        }
        all
    }

    /// The mean emission of light sources that pixel `i`'s kept samples saw directly: of half 0 or 1, or of all samples in a
    /// film without halves. 0 for a pixel without samples; `None` if the film lacks [`Needs::emission`].
    pub fn emission(&self, half: usize, i: usize) -> Option<[f32; 3]> {
        self.kept[half % self.kept.len()].emission.get(i).copied()
    }

    /// Count, mean and sum of squared deviations of pixel `i`'s discarded samples; zero if there are none. Includes samples
    /// that a [plan](crate::plan::Plan::withdraw) has withdrawn.
    pub fn discarded(&self, i: usize) -> RgbMoments {
        match self.discarded.is_empty() {
            true => RgbMoments::default(),
            false => self.merged(&self.discarded, |half| half.means[i], &self.discarded_spread.m2, i),
        }
    }

    /// Mean and variance of normal, albedo, position and depth of pixel `i`'s samples; `None` if the film lacks
    /// [`Needs::features`].
    pub fn features(&self, i: usize) -> Option<Features> {
        self.beside.features.get(i).map(Into::into)
    }

    /// The first hits of pixel `i`'s first `k` samples, with `k` = [`Needs::first_hits`]. An element is `None` if its sample
    /// missed or was not traced.
    pub fn first_hits(&self, i: usize) -> &[Option<FirstHit>] {
        let k = usize::from(self.needs.first_hits);
        &self.beside.first_hits[i * k..(i + 1) * k]
    }

    /// Shape and primitive of the first hit of pixel `i`'s first sample. `None` if the sample missed or was not traced, or if
    /// the film lacks [`Needs::surfaces`].
    pub fn surface(&self, i: usize) -> Option<[u32; 2]> {
        self.beside.surfaces.get(i).copied().filter(|surface| *surface != planes::NO_SURFACE)
    }

    /// The number of rays traced for pixel `i`'s kept and discarded samples; `None` if the film lacks [`Needs::cost`].
    pub fn cost(&self, i: usize) -> Option<u64> {
        self.beside.costs.get(i).copied()
    }

    /// The unfiltered image, linear RGB row by row: each pixel is the mean of its own samples.
    pub fn image(&self) -> Vec<[f32; 3]> {
        (0..self.frame.pixels()).map(|i| self.mean(i).map(|x| x as f32)).collect()
    }

    /// The number of kept samples per pixel, row by row.
    pub fn counts(&self) -> Vec<u64> {
        (0..self.frame.pixels()).map(|i| self.count(i)).collect()
    }

    /// Checks that the film records the statistics in `needs`. Emission, indirect lighting and trajectories are not checked.
    /// A filter calls this first.
    ///
    /// # Errors
    ///
    /// [`Error::NotRecorded`], with the name `who` of the filter and the missing statistics. [`Error::NoneReported`] if
    /// `needs` include features or first hits, but no sample reports a hit or a miss.
    pub fn require(&self, who: &str, needs: &Needs) -> Result<(), Error> {
        if let Some(what) = self.needs.lacking(needs) {
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

    /// Allocates the planes of discarded samples.
    pub(crate) fn open_discarded(&mut self) {
        if self.discarded.is_empty() {
            let (pixels, layout) = (self.frame.pixels(), self.layout());
            self.discarded = self.kept.iter().map(|_| Half::new(pixels, &layout)).collect();
            self.discarded_spread = Spread::new(pixels, &layout);
        }
    }

    /// Removes the samples of the marked pixels from the image. They count as discarded, and keep their indices in the
    /// pixel's point sequence.
    pub(crate) fn withdraw(&mut self, marked: &[bool]) {
        self.open_discarded();
        self.withdrawn.resize(self.kept.len(), vec![0; self.frame.pixels()]);
        for ((kept, other), withdrawn) in self.kept.iter_mut().zip(&mut self.discarded).zip(&mut self.withdrawn) {
            let moved = withdrawn.iter_mut().zip(&kept.counts).zip(marked);
            moved
                .filter(|(_, marked)| **marked)
                .for_each(|((withdrawn, count), _)| *withdrawn = withdrawn.saturating_add(*count));
            kept.exchange(other, marked);
        }
        self.spread.exchange(&mut self.discarded_spread, marked);
    }

    /// The index of the next kept or discarded sample of pixel `i` in one half.
    #[inline]
    pub(crate) fn next_index(&self, retention: Retention, half: usize, i: usize) -> u64 {
        let withdrawn = self.withdrawn.get(half).map_or(0, |withdrawn| withdrawn[i].into());
        match retention {
            Retention::Keep => u64::from(self.kept[half].counts[i]) + withdrawn,
            Retention::Discard => u64::from(self.discarded[half].counts[i]) - withdrawn,
        }
    }

    /// The identity of pixel `i`'s kept sample `number` (from 0): of half 0 or 1, or of all samples in a film without halves.
    pub fn sample_id(&self, half: usize, i: usize, number: usize) -> SampleId {
        let half = half % self.kept.len();
        let stream = match (self.kept.len(), self.half_of) {
            (1, None) => streams::WHOLE,
            (1, Some(half)) => streams::HALVES[half & 1],
            _ => streams::HALVES[half],
        };
        let withdrawn = self.withdrawn.get(half).map_or(0, |withdrawn| withdrawn[i]);
        SampleId::new(self.frame.pixel(i), stream, u64::from(withdrawn) + number as u64)
    }

    /// Counts newly rejected samples and lists the first of them in order of pixel, stream and index.
    pub(crate) fn list_rejected(&mut self, count: u64, first: Vec<Rejected>) {
        self.record.rejected += count;
        self.rejected.extend(first);
        keep_first(&mut self.rejected);
    }
}

/// The data of one [`Recorder`] in a film: a list of 32-bit words for each pixel and half.
#[derive(Clone, Copy)]
pub struct Recorded<'a> {
    film: &'a Film,
    number: usize,
}

impl<'a> Recorded<'a> {
    /// The recorder's words for the kept samples of pixel `i`: of half 0 or 1, or of all samples in a film without halves.
    pub fn kept(&self, half: usize, i: usize) -> &'a [u32] {
        self.of(&self.film.kept[half % self.film.kept.len()], i)
    }

    /// The recorder's words for pixel `i`'s discarded samples, with `half` as in [`Recorded::kept`]. Empty if there are none.
    pub fn discarded(&self, half: usize, i: usize) -> &'a [u32] {
        self.film.discarded.get(half % self.film.kept.len()).map_or(&[], |planes| self.of(planes, i))
    }

    fn of(&self, planes: &'a Half, i: usize) -> &'a [u32] {
        &planes.words[i * self.film.recorders.names.len() + self.number]
    }
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|c| a[c] + b[c])
}
