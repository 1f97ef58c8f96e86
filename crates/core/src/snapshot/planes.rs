//! The planes of a film's pixels as bytes, in the order of a snapshot: whole planes, or some pixels of them.
//! `decode.rs` reads them.

use super::bytes::{Number, Writer};
use crate::film::Bank;
use crate::{Film, FirstHit, Needs, Trajectory};
use std::ops::Range;

/// A plane of a bank, or one beside the banks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Plane {
    Counts,
    Means,
    M2,
    Ranges,
    Emission,
    Channels,
    ChannelsM2,
    Sums,
    Samples,
    Trajectories,
    /// A flag precedes it. Without it, no samples were withdrawn.
    Ahead,
    Features,
    HalfFeatures,
    FirstHits,
    Costs,
}

/// The planes of a bank, in the order of their bytes.
pub(crate) const OF_BANK: [Plane; 11] = [
    Plane::Counts,
    Plane::Means,
    Plane::M2,
    Plane::Ranges,
    Plane::Emission,
    Plane::Channels,
    Plane::ChannelsM2,
    Plane::Sums,
    Plane::Samples,
    Plane::Trajectories,
    Plane::Ahead,
];
/// The planes beside the banks, in the order of their bytes.
pub(crate) const BESIDE: [Plane; 4] = [Plane::Features, Plane::HalfFeatures, Plane::FirstHits, Plane::Costs];

impl Plane {
    /// True if all pixels have the same number of bytes, and the plane is there if it is recorded.
    pub(crate) fn is_fixed(self) -> bool {
        !matches!(self, Self::Ahead | Self::Samples | Self::Trajectories)
    }

    /// The encoded bytes of a pixel, 0 in a plane that is not recorded; of a single sample for [`Plane::Samples`] and
    /// [`Plane::Trajectories`].
    pub(crate) fn bytes(self, needs: &Needs) -> usize {
        let of = |recorded: bool, bytes: usize| if recorded { bytes } else { 0 };
        let channels = 4 * needs.values();
        match self {
            Self::Counts | Self::Ahead => 8,
            Self::Means => 24,
            Self::M2 => of(needs.variance, 24),
            Self::Ranges => of(needs.extrema, 32),
            Self::Emission => of(needs.emission, 12),
            Self::Channels => channels,
            Self::ChannelsM2 => of(needs.variance, channels),
            Self::Sums => 24 * needs.sums.values(),
            Self::Samples => of(needs.samples > 0, 12),
            Self::Trajectories => of(needs.samples > 0 && needs.trajectories, 16),
            Self::Features => of(needs.features, FEATURES),
            Self::HalfFeatures => FEATURES * needs.feature_planes(),
            Self::FirstHits => FIRST_HIT * usize::from(needs.first_hits),
            Self::Costs => of(needs.cost, 8),
        }
    }
}

/// The encoded bytes of a pixel's features: two counts, ten means and ten sums of squared deviations; the numbers and the mean
/// emission of two parts of the samples of features alone.
pub(super) const FEATURES: usize = 120;
/// The encoded bytes of a first hit.
pub(crate) const FIRST_HIT: usize = 73;

/// Writes a bank of a film.
pub(crate) fn put_bank(to: &mut Writer, bank: &Bank) {
    put_planes_of_bank(to, bank, |_| true, &(0..bank.counts.len()));
}

/// Writes some pixels of the planes of a bank that are `wanted`, by their places.
pub(crate) fn put_planes_of_bank(to: &mut Writer, bank: &Bank, wanted: impl Fn(Plane) -> bool, pixels: &Range<usize>) {
    for plane in OF_BANK {
        if plane == Plane::Ahead {
            to.flag(!bank.ahead.is_empty());
        }
        if wanted(plane) {
            put_of_bank(to, bank, plane, pixels);
        }
    }
}

/// Writes the planes beside the banks.
pub(crate) fn put_beside(to: &mut Writer, film: &Film) {
    BESIDE.into_iter().for_each(|plane| put_of_film(to, film, plane, None));
}

/// Writes some pixels of a bank's plane, by their places; nothing if it is not recorded.
pub(crate) fn put_of_bank(to: &mut Writer, bank: &Bank, plane: Plane, pixels: &Range<usize>) {
    fn cut<'p, T>(plane: &'p [T], bank: &Bank, pixels: &Range<usize>) -> &'p [T] {
        let each = plane.len() / bank.counts.len().max(1);
        &plane[pixels.start * each..pixels.end * each]
    }
    fn put<T: Number>(to: &mut Writer, plane: &[T], bank: &Bank, pixels: &Range<usize>) {
        to.numbers(cut(plane, bank, pixels));
    }
    match plane {
        Plane::Counts => put(to, &bank.counts, bank, pixels),
        Plane::Means => put(to, &bank.means, bank, pixels),
        Plane::M2 => put(to, &bank.m2, bank, pixels),
        Plane::Ranges => put(to, &bank.ranges, bank, pixels),
        Plane::Emission => put(to, &bank.emission, bank, pixels),
        Plane::Channels => put(to, &bank.channels, bank, pixels),
        Plane::ChannelsM2 => put(to, &bank.channels_m2, bank, pixels),
        Plane::Sums => put(to, &bank.sums.values, bank, pixels),
        Plane::Samples => cut(&bank.samples.rows, bank, pixels).iter().for_each(|row| to.numbers(row)),
        Plane::Trajectories => {
            let paths = cut(&bank.samples.trajectories, bank, pixels);
            paths.iter().flatten().for_each(|path| to.number(path_numbers(path)));
        }
        Plane::Ahead => put(to, &bank.ahead, bank, pixels),
        Plane::Features | Plane::HalfFeatures | Plane::FirstHits | Plane::Costs => {}
    }
}

/// Writes some pixels of a plane beside the banks, by their places, or all; nothing if it is not recorded.
pub(crate) fn put_of_film(to: &mut Writer, film: &Film, plane: Plane, pixels: Option<&Range<usize>>) {
    fn cut<'p, T>(plane: &'p [T], each: usize, pixels: Option<&Range<usize>>) -> &'p [T] {
        match pixels {
            Some(pixels) if !plane.is_empty() => &plane[pixels.start * each..pixels.end * each],
            _ => plane,
        }
    }
    match plane {
        Plane::Features | Plane::HalfFeatures => {
            let (all, each) = match plane {
                Plane::Features => (&film.features, 1),
                _ => (&film.half_features, film.needs.feature_planes()),
            };
            for f in cut(all, each, pixels) {
                to.number([f.samples, f.hits]);
                to.number([f.mean, f.m2]);
                to.number(f.emission.samples);
                to.number(f.emission.mean);
            }
        }
        Plane::FirstHits => {
            let hits = cut(&film.first_hits, usize::from(film.needs.first_hits), pixels);
            hits.iter().for_each(|hit| put_hit(to, hit.as_ref()));
        }
        Plane::Costs => to.numbers(cut(&film.costs, 1, pixels)),
        _ => {}
    }
}

fn path_numbers(Trajectory { inverse_depth, motion: [x, y, z] }: &Trajectory) -> [f32; 4] {
    [*inverse_depth, *x, *y, *z]
}

/// Writes a first hit as a flag and 18 numbers, for hits and misses alike, so that every record has the same size.
fn put_hit(to: &mut Writer, hit: Option<&FirstHit>) {
    to.flag(hit.is_some());
    let Some(h) = hit else {
        to.number([0_u8; FIRST_HIT - 1]);
        return;
    };
    to.number([h.position, h.geometric_normal, h.shading_normal, h.albedo]);
    to.number([h.depth, h.footprint, h.roughness]);
    to.number([h.material, h.shape, h.primitive]);
}
