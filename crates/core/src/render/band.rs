//! Bands of rows, the parts of a film that tasks write.

use crate::film::{Bank, BankRows, FeatureMoments, SampleRows, SumRows};
use crate::{Film, FirstHit, Retention};
use std::ops::Range;
use std::slice::ChunksMut;

/// A band of rows: the pixels that one task writes.
pub(super) struct Band<'a> {
    /// The index, in the window, of the band's first pixel.
    pub(super) first: usize,
    /// The samples that the task traces in each pixel: first index and end, counted from the start of the round.
    pub(super) samples: [u32; 2],
    pub(super) banks: Vec<BankRows<'a>>,
    pub(super) features: &'a mut [FeatureMoments],
    /// Two per pixel, one for each half.
    pub(super) half_features: &'a mut [FeatureMoments],
    pub(super) first_hits: &'a mut [Option<FirstHit>],
    pub(super) costs: &'a mut [u64],
}

/// Splits the given pixels of the film into bands of `size` pixels each: whole rows, of which it holds all or the own ones of
/// a process. Each pixel gets the given `samples` of the round.
pub(super) fn bands(
    film: &mut Film,
    retention: Retention,
    (pixels, samples): (Range<usize>, [u32; 2]),
    size: usize,
) -> Vec<Band<'_>> {
    let (held, pixels) = (&film.held, film.held.own_places(&pixels));
    let k = usize::from(film.needs.first_hits);
    let banks = if retention == Retention::Keep { &mut film.kept } else { &mut film.discarded };
    let each = film.needs.values();
    let wide = pixels.start * each..pixels.end * each;
    let (kinds, indirect) = (film.needs.sums.values(), film.needs.indirect);
    let wider = pixels.start * kinds..pixels.end * kinds;
    let mut banks: Vec<_> = banks
        .iter_mut()
        .map(|bank| {
            let Bank { counts, means, m2, ranges, emission, channels, channels_m2, sums, samples, ahead, .. } = bank;
            let (kind, values) = (sums.kinds, &mut sums.values);
            let sums = (chunks(counts, &pixels, size), chunks(means, &pixels, size), chunks(m2, &pixels, size));
            let ahead = if ahead.is_empty() { &[][..] } else { &ahead[pixels.clone()] };
            let more = (chunks(ranges, &pixels, size), chunks(emission, &pixels, size));
            let beside = (chunks(channels, &wide, size * each.max(1)), chunks(channels_m2, &wide, size * each.max(1)));
            let plane = (kind, chunks(values, &wider, size * kinds.max(1)));
            let paths = chunks(&mut samples.trajectories, &pixels, size);
            let samples = (samples.limit, chunks(&mut samples.rows, &pixels, size), paths);
            (sums, more, beside, (plane, samples), ahead.chunks(size))
        })
        .collect();
    let mut features = chunks(&mut film.features, &pixels, size);
    let mut half_features = chunks(&mut film.half_features, &(2 * pixels.start..2 * pixels.end), 2 * size);
    let mut first_hits = chunks(&mut film.first_hits, &(pixels.start * k..pixels.end * k), size * k.max(1));
    let mut costs = chunks(&mut film.costs, &pixels, size);
    pixels
        .step_by(size)
        .map(|place| Band {
            first: held.pixel(place),
            samples,
            banks: banks
                .iter_mut()
                .map(|((counts, means, m2), (ranges, emission), (channels, channels_m2), (sums, samples), ahead)| {
                    BankRows {
                        counts: counts.next().unwrap_or_default(),
                        means: means.next().unwrap_or_default(),
                        m2: m2.next().unwrap_or_default(),
                        ranges: ranges.next().unwrap_or_default(),
                        emission: emission.next().unwrap_or_default(),
                        channels: channels.next().unwrap_or_default(),
                        channels_m2: channels_m2.next().unwrap_or_default(),
                        indirect,
                        sums: SumRows { kinds: sums.0, values: sums.1.next().unwrap_or_default() },
                        samples: SampleRows::next(samples.0, &mut samples.1, &mut samples.2),
                        ahead: ahead.next().unwrap_or_default(),
                    }
                })
                .collect(),
            features: features.next().unwrap_or_default(),
            half_features: half_features.next().unwrap_or_default(),
            first_hits: first_hits.next().unwrap_or_default(),
            costs: costs.next().unwrap_or_default(),
        })
        .collect()
}

/// Splits the given pixels of a plane into chunks of `size`; no chunks if the film does not record the plane.
fn chunks<'a, T>(plane: &'a mut [T], pixels: &Range<usize>, size: usize) -> ChunksMut<'a, T> {
    let share = if plane.is_empty() { plane } else { &mut plane[pixels.clone()] };
    share.chunks_mut(size)
}
