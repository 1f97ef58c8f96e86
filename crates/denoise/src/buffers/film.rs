//! Conversion of image buffers into a film.

use super::{ALBEDO, DEPTH, Denoise, Feature, NORMAL, POSITION, SampleBuffers, check};
use crate::planes::{beside, box_mean_of};
use dapple_core::film::{PixelStatistics, RgbMoments};
use dapple_core::{Error, Film, Frame, SurfaceFeatures, point_set::mix};

/// The smallest depth that counts as a miss. Renderers write such depths for the background.
const FAR: f32 = 1e10;

/// Creates a film from the buffers, after checking them.
pub(super) fn film(image: &Denoise<'_>) -> Result<Film, Error> {
    let [width, height] = image.size;
    let frame = Frame::new(width, height)?;
    check(image)?;
    let size = image.size.map(|n| n as usize);
    // If neither half has a variance, it is estimated from the difference of the halves.
    let halves = image.second.map(|second| [image.first, second]);
    let unknown = halves.as_ref().filter(|halves| halves.iter().all(|half| half.variance.is_none()));
    let found = unknown.map(|halves| variance_of_halves(size, halves));
    let surfaces = Surfaces::new(image);
    Film::from_pixels(frame, |i| {
        let halves = match &halves {
            None => split(&image.first, i),
            Some(halves) => with_variances(halves, found.as_ref().map(|found| found[i]), i),
        };
        let mut pixel = PixelStatistics::new(halves);
        if let Some(emission) = image.emission {
            pixel = pixel.with_emission(emission[i]);
        }
        let Some(features) = surfaces.of(i) else { return pixel };
        let count = halves[0].count + halves[1].count;
        let coverage = image.coverage.map_or(1.0, |share| share[i]);
        pixel = pixel.with_features(features, surfaces.variance(i, count), coverage);
        image.ids.map_or(pixel, |ids| pixel.with_surface(ids[i], 0))
    })
}

/// The moments of both halves of pixel `i`. A half without variance uses the other half's, or else the estimate `found`.
fn with_variances(halves: &[SampleBuffers<'_>; 2], found: Option<[f32; 3]>, i: usize) -> [RgbMoments; 2] {
    let own = halves.map(|half| half.variance.map(|v| v.of_sample(i, half.samples(i))));
    [0, 1].map(|h: usize| {
        let (count, mean) = (halves[h].samples(i), halves[h].mean[i].map(f64::from));
        let variance = own[h].or(own[1 - h]).or(found.map(|v| v.map(f64::from))).unwrap_or_default();
        if count > 0 { RgbMoments::new(count, mean, variance) } else { RgbMoments::default() }
    })
}

/// The features of each pixel, including depths and positions derived from each other.
struct Surfaces<'a> {
    image: &'a Denoise<'a>,
    /// The depth of each pixel, estimated if only positions are given.
    depth: Option<Vec<f32>>,
}

impl<'a> Surfaces<'a> {
    fn new(image: &'a Denoise<'a>) -> Self {
        let size = image.size.map(|n| n as usize);
        let position = image.features[POSITION].filter(|_| image.features[DEPTH].is_none());
        let depth = position.map(|position| depths(size, position.colours(), |i| hit(image, i)));
        Self { image, depth }
    }

    /// The features of pixel `i`; `None` for a miss.
    fn of(&self, i: usize) -> Option<SurfaceFeatures> {
        let image = self.image;
        if !hit(image, i) {
            return None;
        }
        let of = |place: usize, missing: [f32; 3]| image.features[place].map_or(missing, |f| f.colours()[i]);
        let known = image.features[DEPTH];
        let depth = self.depth.as_ref().map_or_else(|| known.map_or(1.0, |f| f.mean[i].min(FAR)), |depth| depth[i]);
        let behind = if known.is_some() { self.behind(i, depth) } else { [0.0; 3] };
        let features = SurfaceFeatures::new(of(POSITION, behind), of(NORMAL, [0.0; 3]), depth);
        Some(features.with_albedo(of(ALBEDO, [1.0; 3])))
    }

    /// The point that pixel `i` sees at this depth, for a camera at the origin. The field of view is assumed; the true one
    /// would only stretch the coordinates, which does not change a linear fit.
    fn behind(&self, i: usize, depth: f32) -> [f32; 3] {
        let [width, height] = self.image.size;
        let (columns, unit) = (width as usize, 1.0 / width.max(height) as f32);
        let [x, y] = [(i % columns, width), (i / columns, height)].map(|(k, n)| k as f32 + 0.5 - 0.5 * n as f32);
        [x * unit * depth, y * unit * depth, depth]
    }

    /// The sample variances in pixel `i`, which has `count` samples: of normal, albedo and position (each summed over its
    /// channels) and of depth.
    fn variance(&self, i: usize, count: u64) -> [f32; 4] {
        [(NORMAL, 3), (ALBEDO, 3), (POSITION, 3), (DEPTH, 1)].map(|(place, channels)| {
            let variance = self.image.features[place].and_then(|f| f.variance);
            let entries = channels * i..channels * (i + 1);
            variance.map_or(0.0, |v| entries.map(|k| v.of_sample(k, count) as f32).sum())
        })
    }
}

/// The mean of pixel `i` over all its samples and channels; 0 without samples.
pub(super) fn brightness(image: &Denoise<'_>, i: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for set in std::iter::once(image.first).chain(image.second).filter(|set| set.samples(i) > 0) {
        sum += set.samples(i) as f64 * set.mean[i].iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0;
        count += set.samples(i);
    }
    sum / count.max(1) as f64
}

/// Returns `true` if pixel `i` shows a surface: its coverage is above 0 or, without coverage, one of its geometry buffers is
/// neither 0 nor far away.
fn hit(image: &Denoise<'_>, i: usize) -> bool {
    if let Some(share) = image.coverage {
        return share[i] > 0.0;
    }
    let some = |feature: Option<Feature<'_>>| feature.map(|f| f.colours()[i] != [0.0; 3]);
    let [normal, albedo, position, depth] = image.features;
    let depth = depth.map(|f| f.mean[i] > 0.0 && f.mean[i] < FAR);
    let known = [some(normal), some(position), depth];
    known.contains(&Some(true)) || (known == [None; 3] && albedo.is_some())
}

/// The moments of both halves of pixel `i`, made by splitting a single image with random noise of its own variance.
///
/// For normal noise with standard deviation `s`, `x + s z` and `x - s z` with a normal number `z` are independent [after
/// Rasines and Young 2022; Leiner et al. 2023]. A random sign for `z` leaves about as much error. As with true halves, one half
/// alone then holds all the light of a bright sample, so that the filter detects it.
///
/// With `n = p + q` samples, the halves get `p` and `q` samples, and their means are moved by `s sqrt(q / p)` and `s sqrt(p /
/// q)`. Each half then has the variance of the mean of its samples, and the count-weighted mean of both is `x`.
fn split(all: &SampleBuffers<'_>, i: usize) -> [RgbMoments; 2] {
    let count = all.samples(i);
    if count == 0 {
        return [RgbMoments::default(); 2];
    }
    let (p, q) = ((count - count / 2).max(1), (count / 2).max(1));
    let variance = all.variance.map_or([0.0; 3], |v| v.of_sample(i, count));
    let mean = all.mean[i].map(f64::from);
    let z = sign(i);
    let half = |own: u64, other: u64, sign: f64| {
        let step = |c: usize| sign * (variance[c] / count as f64 * other as f64 / own as f64).sqrt();
        RgbMoments::new(own, std::array::from_fn(|c| mean[c] + step(c)), variance)
    };
    [half(p, q, z), half(q, p, -z)]
}

/// A random sign for pixel `i`.
fn sign(i: usize) -> f64 {
    if mix((i as u64).wrapping_add(0x9e37_79b9_7f4a_7c15)) & 1 == 0 { 1.0 } else { -1.0 }
}

/// The variance of one sample per pixel and channel, estimated from the difference of two halves over 5x5 pixels.
///
/// The difference in a single pixel has one degree of freedom, too few for an estimate.
fn variance_of_halves(size: [usize; 2], [a, b]: &[SampleBuffers<'_>; 2]) -> Vec<[f32; 3]> {
    let pixels = size[0] * size[1];
    let share = |i: usize| {
        let (p, q) = (a.samples(i) as f64, b.samples(i) as f64);
        if p + q > 0.0 { p * q / (p + q) } else { 0.0 }
    };
    let known: Vec<f32> = (0..pixels).map(|i| f32::from(u8::from(share(i) > 0.0))).collect();
    let near = box_mean_of(&known, size, 2);
    let planes = [0, 1, 2].map(|c: usize| {
        let own = |i: usize| {
            let apart = f64::from(a.mean[i][c]) - f64::from(b.mean[i][c]);
            if known[i] > 0.0 { (apart * apart * share(i)).min(1e30) as f32 } else { 0.0 }
        };
        box_mean_of(&(0..pixels).map(own).collect::<Vec<_>>(), size, 2)
    });
    (0..pixels).map(|i| [0, 1, 2].map(|c| if near[i] > 0.0 { planes[c][i] / near[i] } else { 0.0 })).collect()
}

/// The depth as a multiple of the distance between neighbouring points. Only the ratios of depths matter.
pub(crate) const STEPS: f32 = 1e3;
/// The radius in pixels over which steps are averaged.
const NEAR: usize = 3;
/// The distance up to which another pixel belongs to the same surface, in steps per pixel.
const SAME: f32 = 3.0;

/// The depth of each pixel, estimated from positions: the smallest distance (step) to a neighbour, averaged over the surface,
/// times [`STEPS`]. Steps grow with the distance from the camera; its position is not needed.
///
/// Positions are means over points within their pixels, so single steps are noisy. A noisy depth would separate pixels of one
/// surface.
pub(crate) fn depths([width, height]: [usize; 2], position: &[[f32; 3]], hit: impl Fn(usize) -> bool) -> Vec<f32> {
    let apart = |i: usize, k: usize| (0..3).map(|c| (position[i][c] - position[k][c]).powi(2)).sum::<f32>().sqrt();
    let step = |i: usize| {
        let hits = beside(i, [width, height]).filter(|&k| hit(k));
        hits.map(|k| apart(i, k)).filter(|&step| step > 0.0).reduce(f32::min).unwrap_or(1.0 / STEPS)
    };
    let steps: Vec<f32> = (0..position.len()).map(|i| if hit(i) { step(i) } else { 0.0 }).collect();
    let average = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (mut sum, mut count) = (0.0, 0.0);
        for row in y.saturating_sub(NEAR)..(y + NEAR + 1).min(height) {
            for column in x.saturating_sub(NEAR)..(x + NEAR + 1).min(width) {
                let k = row * width + column;
                let pixels = (column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2)) as f32;
                if steps[k] > 0.0 && apart(i, k) <= SAME * steps[i] * pixels.sqrt() {
                    sum += steps[k];
                    count += 1.0;
                }
            }
        }
        STEPS * sum / count
    };
    (0..position.len()).map(|i| if steps[i] > 0.0 { average(i) } else { 0.0 }).collect()
}
