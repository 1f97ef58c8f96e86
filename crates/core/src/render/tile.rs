//! Tiles of a round: the samples that one task traces, in any order.

use super::feature_samples::{self, Turn};
use super::repeats::{self, Firsts};
use super::state::OpenRound;
use super::turns::{Order, Tally, Turns, streams_of};
use crate::{
    Draws, Estimate, Film, Needs, PointSet, SampleId, film::Rejected, film::RejectedReason, film::Window,
    plan::Retention,
};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// The samples of one tile, as planned: shared by the tile and its iterators.
pub(super) struct Planned<'r> {
    points: &'r dyn PointSet,
    needs: Needs,
    features: Turn,
    pub(super) area: [u32; 4],
    streams: [u32; 2],
    order: Order,
    pixels: Vec<Turns>,
    /// The address of the open round, which stays in place as long as the tile lives.
    pub(super) owner: usize,
}

impl<'r> Planned<'r> {
    fn pixel(&self, local: usize) -> [u32; 2] {
        let width = (self.area[2] - self.area[0]) as usize;
        [self.area[0] + (local % width) as u32, self.area[1] + (local / width) as u32]
    }

    /// The pixel's number in the tile; `None` outside it.
    #[inline]
    fn local(&self, [column, row]: [u32; 2]) -> Option<usize> {
        let [x0, y0, x1, y1] = self.area;
        let inside = (x0..x1).contains(&column) && (y0..y1).contains(&row);
        inside.then(|| (row - y0) as usize * (x1 - x0) as usize + (column - x0) as usize)
    }

    /// The half and the identity of sample `turn` of `pixel`, whose number in the tile is `local`.
    #[inline]
    fn sample(&self, pixel: [u32; 2], local: usize, turn: u32) -> (usize, SampleId) {
        let (half, index) = self.pixels[local].sample(self.order, turn);
        (half, SampleId::new(pixel, self.streams[half], index))
    }

    fn total(&self) -> u64 {
        self.pixels.iter().map(|p| u64::from(p.total())).sum()
    }
}

/// A rectangle of pixels of a [`Round`](crate::Round), with the samples to trace and the results so far.
///
/// Results may be added in any order; the tile sorts them. The film contains the results only after
/// [`Round::submit`](crate::Round::submit) has accepted the complete tile.
pub struct Tile<'r> {
    pub(super) planned: Arc<Planned<'r>>,
    pub(super) retention: Retention,
    pub(super) film: Film,
    /// The number of each pixel's samples already in the film.
    taken: Vec<u32>,
    left: u64,
    /// Results that wait for earlier ones, by pixel and turn.
    waiting: BTreeMap<(usize, u32), Waiting>,
    pub(super) tally: Tally,
    /// The first samples of watched pixels.
    pub(super) firsts: Firsts,
    /// The first incorrect use of the tile, in words.
    pub(super) fault: Option<String>,
}

/// A result that was added before an earlier sample's, and the number of blocks of random numbers that it took.
struct Waiting {
    estimate: Estimate,
    blocks: u32,
}

impl<'r> Tile<'r> {
    /// Makes the tile `frame` of a round, with a copy of that part of the film.
    pub(super) fn new(
        points: &'r dyn PointSet,
        film: &Film,
        (open, features): (&OpenRound, Turn),
        frame: crate::Frame,
    ) -> Self {
        let (plan, halves) = (&open.plan, film.kept.len() == 2);
        let mut part = film.part(frame, plan.retention);
        let (mut strip, order) = (part.strip(plan.retention), Order::of(plan, halves));
        let turns = |(local, whole)| {
            let turns = Turns::new(plan, whole, [0, u32::MAX], &strip, local);
            if strip.has_recorders() {
                strip.reserve(local, turns.halves(order));
            }
            turns
        };
        let planned = Planned {
            points,
            needs: film.needs,
            features: features.of_film(&film.needs, plan.retention),
            area: area(&frame),
            streams: streams_of(plan.retention, halves),
            order,
            pixels: Window::new(&film.frame, &frame).runs(1).flatten().enumerate().map(turns).collect(),
            owner: std::ptr::from_ref(open).addr(),
        };
        let (taken, left) = (vec![0; frame.pixels()], planned.total());
        let (retention, waiting, tally) = (plan.retention, BTreeMap::new(), Tally::default());
        let firsts = Firsts::new();
        Self { planned: Arc::new(planned), retention, film: part, tally, firsts, taken, left, waiting, fault: None }
    }

    /// Columns and rows `[x0, y0, x1, y1]` of the tile in the full image; `x1` and `y1` are excluded.
    pub fn area(&self) -> [u32; 4] {
        self.planned.area
    }

    /// The samples to trace, pixel by pixel. Each has its identity and its random numbers.
    pub fn samples(&self) -> Samples<'r> {
        let [x, y, ..] = self.planned.area;
        Samples { planned: self.planned.clone(), pixel: [x, y], local: 0, turn: 0 }
    }

    /// Column and row of each pixel in the full image, and the range of sample numbers to trace in it.
    ///
    /// Renderers with their own random numbers trace these samples and pass the results to [`Tile::push`]. Sample numbers
    /// run on over all rounds: use them in the seed, or as indices into a pixel's sequence. Samples that are used only for
    /// planning have numbers from 2^32 on.
    pub fn pixels(&self) -> impl Iterator<Item = ([u32; 2], Range<u64>)> + use<'r> {
        let (planned, discarded) = (self.planned.clone(), self.retention == Retention::Discard);
        (0..planned.pixels.len()).map(move |local| {
            let turns = &planned.pixels[local];
            let first = turns.next.iter().sum::<u64>() + (u64::from(discarded) << 32);
            (planned.pixel(local), first..first + u64::from(turns.total()))
        })
    }

    /// The number of samples that are not added yet.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// The number of samples without a result. Waiting results count as present.
    pub(super) fn missing(&self) -> u64 {
        self.left - self.waiting.len() as u64
    }

    /// Adds the result of one sample: an [`Estimate`], or linear RGB.
    ///
    /// A sample of another tile or round, or one that was added before, is a mistake that
    /// [`Round::submit`](crate::Round::submit) reports.
    #[inline]
    pub fn add(&mut self, sample: &Draws<'_>, estimate: impl Into<Estimate>) {
        let (id, turn) = (sample.id(), sample.turn);
        let local = self.planned.local(id.pixel).filter(|&local| turn < self.planned.pixels[local].total());
        let planned = local.map(|local| (local, self.planned.sample(id.pixel, local, turn)));
        match planned.filter(|(_, (_, planned))| *planned == id) {
            Some((local, named)) => self.place((local, turn), named, &estimate.into(), sample.blocks_requested()),
            None => self.wrong(id, "belongs to another tile or round; add each sample to the tile that it came from"),
        }
    }

    /// Traces all samples in order, without the look-ups of [`Tile::add`].
    pub(super) fn trace<E: Into<Estimate>>(&mut self, mut trace: impl FnMut(&Draws<'_>) -> E) {
        let (planned, retention) = (self.planned.clone(), self.retention);
        let (film, mut books) = self.books();
        let mut strip = film.strip(retention);
        for (local, turns) in planned.pixels.iter().enumerate() {
            let pixel = planned.pixel(local);
            for turn in 0..turns.total() {
                let (half, id) = planned.sample(pixel, local, turn);
                let draws = Draws::for_film(planned.points, id, planned.needs);
                let estimate = trace(&draws).into();
                let rejected = strip.add(half, local, &estimate);
                books.enter(local, (half, id), &estimate, draws.blocks_requested(), rejected);
            }
        }
    }

    /// The film, and the counts that accompany it.
    #[inline]
    fn books(&mut self) -> (&mut Film, Books<'_>) {
        let Self { film, tally, firsts, taken, left, planned, .. } = self;
        let books = Books { frame: film.frame, tally, firsts, taken, left, wants_hit: planned.needs.wants_first_hit() };
        (film, books)
    }

    /// Takes feature-only samples ([`Integrator::features_alone`](crate::Integrator::features_alone)), which reduce noise at
    /// edges. `sample` returns an estimate with first hit, features and emission; its radiance is not used. If `sample`
    /// returns `None`, the pixel gets no more feature-only samples.
    ///
    /// Without a time limit, only pixels without kept samples get feature-only samples. With a time limit, all pixels get
    /// them in the second round, and only if the limit allows at least 4 samples per pixel.
    ///
    /// Call this once, before samples are added.
    pub fn sample_features(&mut self, mut sample: impl FnMut(&Draws<'_>) -> Option<Estimate>) {
        let planned = self.planned.clone();
        if self.left < planned.total() {
            let what = "features were sampled after samples of the tile were added; sample features first";
            self.fault.get_or_insert(what.into());
        }
        if self.fault.is_some() || planned.features == Turn::Never {
            return;
        }
        for (local, pixel) in planned.pixels.iter().enumerate() {
            let kept = self.film.count(local);
            let moments = &mut self.film.beside.features[local];
            if pixel.total() > 0 && planned.features.is_now(moments, kept, true) {
                let place = planned.pixel(local);
                let added = feature_samples::add(moments, planned.points, place, &planned.needs, &mut sample);
                self.tally.add_features(place, added);
            }
        }
    }

    /// Adds light of a sample to another pixel, as [`Worker::splat`](crate::Worker::splat) does.
    pub fn splat(&mut self, sample: &Draws<'_>, pixel: [u32; 2], radiance: [f32; 3]) {
        if self.planned.needs.splats && self.retention == Retention::Keep {
            let half = usize::from(sample.id().stream != self.planned.streams[0]);
            self.tally.splat(sample.id(), half, pixel, radiance);
        }
    }

    /// Adds the results of several samples, in the order of the samples.
    ///
    /// If the numbers of results and samples differ, [`Round::submit`](crate::Round::submit) reports the mistake.
    pub fn add_all<E: Into<Estimate>>(&mut self, samples: &[Draws<'_>], estimates: impl IntoIterator<Item = E>) {
        // One more than fits, so that an endless iterator is a mistake like any other.
        let estimates: Vec<E> = estimates.into_iter().take(samples.len() + 1).collect();
        let (wanted, given) = (samples.len(), estimates.len());
        samples.iter().zip(estimates).for_each(|(sample, estimate)| self.add(sample, estimate));
        if wanted != given {
            let what = format!(
                "{wanted} samples have {given} results{}; return one result per sample",
                if given > wanted { " or more" } else { "" }
            );
            self.fault.get_or_insert(what);
        }
    }

    /// Adds the result of the pixel's next sample, for renderers with their own random numbers. `pixel` is column and row
    /// in the full image.
    ///
    /// More samples than [`Tile::pixels`] requests are a mistake that [`Round::submit`](crate::Round::submit) reports.
    #[inline]
    pub fn push(&mut self, pixel: [u32; 2], estimate: impl Into<Estimate>) {
        let local = self.planned.local(pixel);
        match local.filter(|&local| self.taken[local] < self.planned.pixels[local].total()) {
            Some(local) => {
                let turn = self.taken[local];
                self.place((local, turn), self.planned.sample(pixel, local, turn), &estimate.into(), 0);
            }
            None => {
                let [column, row] = pixel;
                let asked = local.map_or(0, |local| self.planned.pixels[local].total());
                let what = format!(
                    "pixel ({column}, {row}) got more than the {asked} requested samples; trace as many samples as Tile::pixels requests"
                );
                self.fault.get_or_insert(what);
            }
        }
    }

    /// Records a result, or keeps it until the pixel's earlier results are recorded.
    #[inline]
    fn place(&mut self, (local, turn): (usize, u32), named: (usize, SampleId), estimate: &Estimate, blocks: u32) {
        if turn != self.taken[local] {
            self.keep((local, turn), named.1, Waiting { estimate: *estimate, blocks });
            return;
        }
        self.record(local, named, estimate, blocks);
        while !self.waiting.is_empty()
            && let Some(Waiting { estimate, blocks }) = self.waiting.remove(&(local, self.taken[local]))
        {
            let named = self.planned.sample(named.1.pixel, local, self.taken[local]);
            self.record(local, named, &estimate, blocks);
        }
    }

    #[cold]
    fn keep(&mut self, (local, turn): (usize, u32), id: SampleId, waiting: Waiting) {
        let again = turn < self.taken[local] || self.waiting.insert((local, turn), waiting).is_some();
        if again {
            self.wrong(id, "was added twice; add each sample once");
        }
    }

    /// Records the next result of a pixel in the film.
    #[inline]
    fn record(&mut self, local: usize, (half, sample): (usize, SampleId), estimate: &Estimate, blocks: u32) {
        let retention = self.retention;
        let (film, mut books) = self.books();
        let rejected = film.add(retention, (half, local), estimate);
        books.enter(local, (half, sample), estimate, blocks, rejected);
    }

    #[cold]
    fn wrong(&mut self, id: SampleId, what: &str) {
        let SampleId { pixel: [column, row], stream, index } = id;
        let what = format!("sample {index} of stream {stream} in pixel ({column}, {row}) {what}");
        self.fault.get_or_insert(what);
    }
}

/// The counts of a tile, updated with each sample.
struct Books<'a> {
    frame: crate::Frame,
    tally: &'a mut Tally,
    firsts: &'a mut Firsts,
    taken: &'a mut [u32],
    left: &'a mut u64,
    wants_hit: bool,
}

impl Books<'_> {
    /// Counts a sample that was added to the film.
    #[inline]
    fn enter(
        &mut self,
        local: usize,
        (half, sample): (usize, SampleId),
        estimate: &Estimate,
        blocks: u32,
        rejected: Option<RejectedReason>,
    ) {
        self.tally.count(half, estimate.cost, blocks);
        self.tally.unreported += u64::from(self.wants_hit && !estimate.reports_hit());
        let taken = &mut self.taken[local];
        if *taken < repeats::KEPT {
            repeats::watch(self.firsts, &self.frame, sample.pixel, estimate.radiance);
        }
        *taken += 1;
        *self.left -= 1;
        if let Some(reason) = rejected {
            self.tally.reject(Rejected { sample, reason }, estimate.radiance);
        }
    }
}

/// Columns and rows of a frame's window in the full image.
pub(super) fn area(frame: &crate::Frame) -> [u32; 4] {
    let ([x, y], [width, height]) = (frame.origin(), frame.size());
    [x, y, x + width, y + height]
}

/// An iterator over the samples of a [`Tile`].
pub struct Samples<'r> {
    planned: Arc<Planned<'r>>,
    pixel: [u32; 2],
    local: usize,
    turn: u32,
}

impl<'r> Iterator for Samples<'r> {
    type Item = Draws<'r>;

    #[inline]
    fn next(&mut self) -> Option<Draws<'r>> {
        while self.turn >= self.planned.pixels.get(self.local)?.total() {
            (self.local, self.turn) = (self.local + 1, 0);
            self.pixel = self.planned.pixel(self.local);
        }
        let (_, id) = self.planned.sample(self.pixel, self.local, self.turn);
        let mut draws = Draws::for_film(self.planned.points, id, self.planned.needs);
        draws.turn = self.turn;
        self.turn += 1;
        Some(draws)
    }
}
