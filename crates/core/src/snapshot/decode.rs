//! The planes of a film's pixels from the bytes that `planes.rs` writes: whole planes, or some pixels of them.

use super::Broken;
use super::bytes::{Number, Reader};
use super::planes::{BESIDE, FEATURES, FIRST_HIT, OF_BANK, Plane};
use crate::film::{Bank, EmissionAlone, FeatureMoments};
use crate::{Film, FirstHit, Needs, Trajectory};
use std::ops::Range;

/// The encoded bytes of a pixel of a bank, at least.
pub(crate) fn least_of_bank(needs: &Needs) -> usize {
    OF_BANK.iter().filter(|plane| plane.is_fixed()).map(|plane| plane.bytes(needs)).sum()
}

/// The encoded bytes of a pixel in the planes beside the banks.
pub(crate) fn bytes_beside(needs: &Needs) -> usize {
    BESIDE.iter().map(|plane| plane.bytes(needs)).sum()
}

/// Reads a bank of `pixels` pixels.
pub(crate) fn take_bank(from: &mut Reader<'_>, pixels: usize, needs: &Needs) -> Result<Bank, Broken> {
    // Memory is made for pixels only that the bytes may hold.
    from.expect(pixels, least_of_bank(needs))?;
    let mut bank = Bank::new(pixels, needs);
    for plane in OF_BANK {
        if plane != Plane::Ahead || from.flag()? {
            take_of_bank(from, &mut bank, plane, &(0..pixels))?;
        }
    }
    Ok(bank)
}

/// Reads the planes beside the banks into a film of `pixels` pixels.
pub(crate) fn take_beside(from: &mut Reader<'_>, film: &mut Film, pixels: usize) -> Result<(), Broken> {
    from.expect(pixels, bytes_beside(&film.needs))?;
    film.clear_beside(pixels);
    BESIDE.into_iter().try_for_each(|plane| take_of_film(from, film, plane, &(0..pixels)))
}

/// Reads some pixels of a bank's plane into their places; nothing if it is not recorded. Counts come before samples.
pub(crate) fn take_of_bank(
    from: &mut Reader<'_>,
    bank: &mut Bank,
    plane: Plane,
    pixels: &Range<usize>,
) -> Result<(), Broken> {
    let all = bank.counts.len();
    fn take<T: Number>(
        from: &mut Reader<'_>,
        plane: &mut [T],
        all: usize,
        pixels: &Range<usize>,
    ) -> Result<(), Broken> {
        let each = plane.len() / all.max(1);
        from.fill(&mut plane[pixels.start * each..pixels.end * each])
    }
    match plane {
        Plane::Counts => take(from, &mut bank.counts, all, pixels),
        Plane::Means => take(from, &mut bank.means, all, pixels),
        Plane::M2 => take(from, &mut bank.m2, all, pixels),
        Plane::Ranges => take(from, &mut bank.ranges, all, pixels),
        Plane::Emission => take(from, &mut bank.emission, all, pixels),
        Plane::Channels => take(from, &mut bank.channels, all, pixels),
        Plane::ChannelsM2 => take(from, &mut bank.channels_m2, all, pixels),
        Plane::Sums => take(from, &mut bank.sums.values, all, pixels),
        Plane::Ahead => {
            bank.ahead.resize(all, 0);
            take(from, &mut bank.ahead, all, pixels)
        }
        Plane::Samples => {
            let recorded = !bank.samples.rows.is_empty();
            for i in pixels.clone().filter(|_| recorded) {
                bank.samples.rows[i] = from.numbers(kept(bank.counts[i], bank.samples.limit))?;
            }
            Ok(())
        }
        Plane::Trajectories => {
            let path = |[inverse_depth, x, y, z]: [f32; 4]| Trajectory::new(inverse_depth, [x, y, z]);
            let recorded = !bank.samples.trajectories.is_empty();
            for i in pixels.clone().filter(|_| recorded) {
                let paths = from.numbers(kept(bank.counts[i], bank.samples.limit))?;
                bank.samples.trajectories[i] = paths.into_iter().map(path).collect();
            }
            Ok(())
        }
        Plane::Features | Plane::HalfFeatures | Plane::FirstHits | Plane::Costs => Ok(()),
    }
}

/// The number of samples that are kept one by one of a pixel with `count` samples.
pub(crate) fn kept(count: u64, limit: u32) -> usize {
    count.min(u64::from(limit)) as usize
}

/// Reads some pixels of a plane beside the banks into their places; nothing if it is not recorded.
pub(crate) fn take_of_film(
    from: &mut Reader<'_>,
    film: &mut Film,
    plane: Plane,
    pixels: &Range<usize>,
) -> Result<(), Broken> {
    fn cut<'p, T>(plane: &'p mut [T], each: usize, pixels: &Range<usize>) -> &'p mut [T] {
        if plane.is_empty() { plane } else { &mut plane[pixels.start * each..pixels.end * each] }
    }
    let needs = film.needs;
    match plane {
        Plane::Features => take_features(from, cut(&mut film.features, 1, pixels)),
        Plane::HalfFeatures => take_features(from, cut(&mut film.half_features, needs.feature_planes(), pixels)),
        Plane::FirstHits => take_hits(from, cut(&mut film.first_hits, usize::from(needs.first_hits), pixels)),
        Plane::Costs => from.fill(cut(&mut film.costs, 1, pixels)),
        _ => Ok(()),
    }
}

fn take_features(from: &mut Reader<'_>, to: &mut [FeatureMoments]) -> Result<(), Broken> {
    let mut from = from.part(to.len(), FEATURES)?;
    for one in to {
        let [samples, hits] = from.number()?;
        let [mean, m2] = from.number()?;
        let emission = EmissionAlone { samples: from.number()?, mean: from.number()? };
        if !emission.mean.as_flattened().iter().all(|v| v.is_finite()) {
            return Err(Broken("a mean emission is NaN or infinite"));
        }
        *one = FeatureMoments { samples, hits, mean, m2, emission };
    }
    Ok(())
}

fn take_hits(from: &mut Reader<'_>, to: &mut [Option<FirstHit>]) -> Result<(), Broken> {
    let mut from = from.part(to.len(), FIRST_HIT)?;
    for one in to {
        let there = from.flag()?;
        let [position, geometric_normal, shading_normal, albedo] = from.number()?;
        let [depth, footprint, roughness] = from.number()?;
        let [material, shape, primitive] = from.number()?;
        let hit = FirstHit {
            position,
            geometric_normal,
            shading_normal,
            albedo,
            depth,
            footprint,
            roughness,
            material,
            shape,
            primitive,
        };
        if !hit.is_finite() {
            return Err(Broken("a first hit is NaN or infinite"));
        }
        *one = there.then_some(hit);
    }
    Ok(())
}
