//! The film of an image that is given as buffers.

use super::split::{split, variance_of_halves};
use super::{Denoise, Feature, Samples, Variance, camera, checks};
use dapple_core::{Error, Film, FirstHit, Frame, PixelStatistics, RgbMoments, SurfaceFeatures};

/// The depth from which on a pixel counts as a miss: renderers write numbers like this for the background.
const FAR: f32 = 1e10;

/// Makes a film of the buffers, after checking them.
pub(super) fn film(image: &Denoise<'_>) -> Result<Film, Error> {
    let [width, height] = image.size;
    let frame = Frame::new(width, height)?;
    checks::check(image)?;
    let size = image.size.map(|n| n as usize);
    let halves = Halves::new(size, &image.samples);
    let surfaces = Surfaces::new(image);
    Film::from_pixels(frame, |i| {
        let halves = halves.of(i);
        let mut pixel = PixelStatistics::new(halves);
        if let Some(emission) = image.emission {
            pixel = pixel.with_emission(emission[i]);
        }
        let Some(features) = surfaces.of(i) else { return pixel };
        let count = halves[0].count + halves[1].count;
        let coverage = image.coverage.map_or(1.0, |share| share[i]);
        pixel = pixel.with_features(features, surfaces.variance(i, count), coverage);
        match image.ids {
            Some(ids) => {
                let SurfaceFeatures { position, normal, depth, .. } = features;
                pixel.with_first_hit(FirstHit::new(position, normal, depth).with_material(ids[i]))
            }
            None => pixel,
        }
    })
}

/// The halves of the samples, with a variance for each.
struct Halves<'a> {
    samples: &'a Samples<'a>,
    /// The variance of a sample from the difference of the halves, if neither has one.
    found: Option<Vec<[f32; 3]>>,
}

impl<'a> Halves<'a> {
    fn new(size: [usize; 2], samples: &'a Samples<'a>) -> Self {
        let found = match samples {
            Samples::Halves(halves) if halves.iter().all(|half| half.variance.is_none()) => {
                Some(variance_of_halves(size, halves))
            }
            _ => None,
        };
        Self { samples, found }
    }

    fn of(&self, i: usize) -> [RgbMoments; 2] {
        let halves = match self.samples {
            Samples::Whole(all) => return split(all, i),
            Samples::Halves(halves) => halves,
        };
        let found = self.found.as_ref().map(|found| found[i].map(f64::from));
        let own = halves.map(|half| half.variance.map(|v| v.of_sample(i, half.count.of(i))));
        [0, 1].map(|h: usize| {
            let (count, mean) = (halves[h].count.of(i), halves[h].mean[i].map(f64::from));
            let variance = own[h].or(own[1 - h]).or(found).unwrap_or_default();
            if count > 0 { RgbMoments::new(count, mean, variance) } else { RgbMoments::default() }
        })
    }
}

/// The features of each pixel, with those that follow from others.
struct Surfaces<'a> {
    image: &'a Denoise<'a>,
    width: usize,
    /// The depth of each pixel, if positions are given without.
    depth: Option<Vec<f32>>,
    /// The reciprocal of the longer side in pixels, for positions from depths.
    unit: f32,
}

impl<'a> Surfaces<'a> {
    fn new(image: &'a Denoise<'a>) -> Self {
        let size = image.size.map(|n| n as usize);
        let depth = match (image.position, image.depth) {
            (Some(position), None) => Some(camera::depths(size, position.mean, |i| hit(image, i))),
            _ => None,
        };
        Self { image, width: size[0], depth, unit: 1.0 / size[0].max(size[1]) as f32 }
    }

    /// The features of pixel `i`; `None` for a miss.
    fn of(&self, i: usize) -> Option<SurfaceFeatures> {
        let image = self.image;
        if !hit(image, i) {
            return None;
        }
        let of = |feature: Option<Feature<'_>>, missing: [f32; 3]| feature.map_or(missing, |f| f.mean[i]);
        let depth = match (&self.depth, image.depth) {
            (Some(depth), _) => depth[i],
            (None, Some(depth)) => depth.mean[i].min(FAR),
            (None, None) => 1.0,
        };
        let position = match image.position {
            Some(position) => position.mean[i],
            None if image.depth.is_some() => self.behind(i, depth),
            None => [0.0; 3],
        };
        let features = SurfaceFeatures::new(position, of(image.normal, [0.0; 3]), depth);
        Some(features.with_albedo(of(image.albedo, [1.0; 3])))
    }

    /// A point at this depth behind pixel `i`, for a camera at the origin. Its field of view is unknown; another one
    /// stretches all positions alike, which changes no linear function of them.
    fn behind(&self, i: usize, depth: f32) -> [f32; 3] {
        let [width, height] = self.image.size.map(|n| n as f32);
        let [x, y] = [(i % self.width) as f32 + 0.5 - 0.5 * width, (i / self.width) as f32 + 0.5 - 0.5 * height];
        [x * self.unit * depth, y * self.unit * depth, depth]
    }

    /// The sample variances of normal (3), albedo (3), position (3) and depth (1) in pixel `i`, which has `count` samples.
    fn variance(&self, i: usize, count: u64) -> [f32; 10] {
        let three = |feature: Option<Feature<'_>>| {
            let variance = feature.and_then(|f| f.variance);
            variance.map_or([0.0; 3], |v| v.of_sample(i, count).map(|v| v as f32))
        };
        let [[nx, ny, nz], [r, g, b], [x, y, z]] =
            [self.image.normal, self.image.albedo, self.image.position].map(three);
        let depth = match self.image.depth.and_then(|f| f.variance) {
            Some(Variance::OfSamples(values)) => values[i],
            Some(Variance::OfMean(values)) => values[i] * count as f32,
            None => 0.0,
        };
        [nx, ny, nz, r, g, b, x, y, z, depth]
    }
}

/// Returns true if pixel `i` shows a surface: a buffer of its geometry is neither 0 nor far away.
fn hit(image: &Denoise<'_>, i: usize) -> bool {
    if let Some(share) = image.coverage {
        return share[i] > 0.0;
    }
    let some = |feature: Option<Feature<'_>>| feature.map(|f| f.mean[i] != [0.0; 3]);
    let depth = image.depth.map(|f| f.mean[i] > 0.0 && f.mean[i] < FAR);
    let known = [some(image.normal), some(image.position), depth];
    known.contains(&Some(true)) || (known == [None; 3] && image.albedo.is_some())
}
