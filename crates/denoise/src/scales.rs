//! Corrections at coarse scales, after [Delbracio 2014; Boughida and Boubekeur 2017].
//!
//! Windows of 41x41 pixels average less of a large image than of a small one, and so leave faint patches. Means of 2x2
//! pixels make an image of half the size, on which the same windows reach twice as far. Its result replaces the low
//! frequencies of the finer image.
//!
//! The two papers filter each scale by itself. Here a coarse scale starts from the finer result, and moves as far from
//! it as their difference is noise ([`shrink`]). The published step up has no features; across edges it leaves halos.

use crate::error_map::{Radii, shrink};
use crate::features::{Features, slopes};
use crate::inputs::{Half, Inputs, residual_guide};
use crate::outliers;
use crate::planes::{Colours, Pair, Plane, map_to_one, parts, planes_of, raised, sum_pixels, update};
use crate::tile::exp_minus;
use crate::wide::wide;
use dapple_core::OptionValue;

/// The number of coarse scales of a [`ClusterRegression`](crate::ClusterRegression) in three passes. Each has half the
/// width and height of the one before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Scales {
    /// One scale, two from 115,200 pixels on, three from 921,600 on (1280x720), and one more per factor of 4: 4 at
    /// 3840x2160.
    #[default]
    Auto,
    /// This number of scales, at most [`Scales::MOST`]; 0 for none.
    Fixed(u32),
}

/// The number of pixels from which there is a second scale. With 230,400, a room lit through a slit has 6 % more error at
/// 480x360. With 57,600, three scenes have 0 to 2 % more at 320x240, and one has 4 % less.
const SECOND: usize = 115_200;
/// The least number of pixels at the coarsest scale from the third on.
const PIXELS: usize = 14_400;

impl Scales {
    /// The largest number of scales.
    pub const MOST: u32 = 8;

    /// The number of scales for an image of this size.
    pub(crate) fn of(self, [width, height]: [usize; 2]) -> usize {
        if let Self::Fixed(scales) = self {
            return scales as usize;
        }
        let pixels = width * height;
        let more = (3..=Self::MOST).filter(|n| pixels >> (2 * n) >= PIXELS).count();
        1 + usize::from(pixels >= SECOND) + more
    }
}

/// Parses `auto` and numbers.
impl OptionValue for Scales {
    fn from_text(text: &str) -> Option<Self> {
        if text == "auto" { Some(Self::Auto) } else { text.parse().ok().map(Self::Fixed) }
    }

    fn text(&self) -> String {
        if let Self::Fixed(scales) = self { scales.to_string() } else { "auto".into() }
    }

    fn wanted(allowed: Option<&str>) -> String {
        allowed.unwrap_or("auto or a number").to_owned()
    }
}

/// The ratio of an outlier to its surroundings, per scale. With 6 for three scales, a room lit through a slit has 6 % more
/// error at 1280x720: coarse scales spread light better than a blob does. With 20 for one scale, a lit room has 2 % more
/// at 160x120.
const RATIO: f32 = 7.0;

/// The ratio of an outlier to its surroundings if this many coarse scales follow. Without them, with 3 in place of 6, a room lit
/// through a slit has 10 % more error and 0.3 % more of its light at 8 spp; with 12, 4 % less error and 0.3 % less light.
pub(crate) fn ratio(scales: usize) -> f32 {
    if scales == 0 { 6.0 } else { RATIO * scales as f32 }
}

/// The factor on that ratio at a coarse scale, whose pixels have less noise. With 1, the light of a single outlier grows
/// by 3 %.
const COARSER: f32 = 0.4;
/// The factor on the squared difference of normals in the step up.
const TURNED: f32 = 20.0;
/// The standard deviation of the log depth in the step up, in units of its slope between neighbouring pixels.
const SLOPE: f32 = 4.0;
/// The weight of no correction in the step up, relative to 1 for a pixel of the same surface. With 0.001, a room lit
/// through a slit has 2 % more error: halos.
const NONE: f32 = 0.1;

/// A value for every 2x2 pixels. `of` gets the four values of each plane; beyond the frame the border repeats.
fn down<const N: usize>(size: [usize; 2], planes: [&[f32]; N], of: impl Fn([[f32; 4]; N]) -> f32 + Sync) -> Plane {
    let [width, height] = size;
    let columns = width.div_ceil(2);
    let row = |(): &mut (), y: usize, [to]: [&mut [f32]; 1]| {
        let rows = [2 * y, (2 * y + 1).min(height - 1)];
        let planes = planes.map(|plane| rows.map(|y| &plane[y * width..][..width]));
        for (x, to) in to.iter_mut().enumerate() {
            let [left, right] = [2 * x, (2 * x + 1).min(width - 1)];
            *to = of(planes.map(|[above, below]| [above[left], above[right], below[left], below[right]]));
        }
    };
    let [plane] = parts(columns * height.div_ceil(2), columns, || (), row);
    plane
}

/// The mean of four pixels.
fn mean([[a, b, c, d]]: [[f32; 4]; 1]) -> f32 {
    0.25 * ((a + b) + (c + d))
}

/// The mean of four pixels without their albedo.
fn demodulated([colour, albedo]: [[f32; 4]; 2]) -> f32 {
    let [a, b, c, d] = std::array::from_fn(|k| colour[k] / raised(albedo[k]));
    0.25 * ((a + b) + (c + d))
}

/// [`demodulated`] over the pixels with samples, or over all if none has any. The last plane has their numbers of samples.
fn sampled([colour, albedo, count]: [[f32; 4]; 3]) -> f32 {
    let known = count.map(|count| if count > 0.0 { 1.0 } else { 0.0 });
    let total = known.iter().sum::<f32>();
    let weights = if total > 0.0 { known.map(|k| k / total) } else { [0.25; 4] };
    let [a, b, c, d] = std::array::from_fn(|k| weights[k] * (colour[k] / raised(albedo[k])));
    (a + b) + (c + d)
}

/// The standard errors by which a bias of the wide pass at the finest scale must exceed 0 to count, if this many coarse scales
/// follow: 0.5, 1.25, 2 and so on. With 4 for three scales, walls at 1280x720 have no patches of noise, but refractions
/// have 5 to 8 % more error; with 2 for one scale, five scenes have 3 % more at 192x144 (docs/results/default-image.md).
pub(crate) fn evidence(scales: usize) -> f32 {
    0.75 * scales.max(1) as f32 - 0.25
}

/// These standard errors at coarse scales.
const COARSE_EVIDENCE: f32 = 0.25;

/// The radii of the blend of a scale's image with that of the wide pass.
pub(crate) const BLEND: Radii = Radii { bias: 8, noise: 20, alike: 2 };

/// The planes of the next coarser scale. Colours are averaged without their albedo.
///
/// All pixels with samples have the same count there. Counts follow the brightness that a pilot met, so weights by counts
/// over wide windows add light: 0.6 % of a room lit through a slit.
pub(crate) fn coarser(fine: &Inputs) -> Inputs {
    let size = fine.size.map(|n| n.div_ceil(2));
    let (f, plane) = (&fine.features, |plane: &Plane| down(fine.size, [plane], mean));
    let quarter = |plane: &Plane| down(fine.size, [plane], |[four]| mean([four.map(|value| 0.25 * value)]));
    let mean_of_raised = |[four]: [[f32; 4]; 1]| mean([four.map(raised)]);
    let features: [Plane; 7] = std::array::from_fn(|k| match k {
        3..6 => down(fine.size, [&f.mean[k]], mean_of_raised),
        _ => plane(&f.mean[k]),
    });
    let samples = |i: usize| fine.halves.each_ref().map(|half| f64::from(half.count[i]));
    let counts = sum_pixels(fine.size, samples).map(|sum| 4.0 * (sum / fine.pixels() as f64) as f32);
    let halves = [0, 1].map(|h: usize| {
        let own = &fine.halves[h];
        let colour: Colours = std::array::from_fn(|c| {
            let mut colour = down(fine.size, [&own.colour[c], &f.mean[3 + c], &own.count], sampled);
            update(&mut colour, [&features[3 + c]], |value, [albedo]| value * albedo);
            colour
        });
        let of = |[four]: [[f32; 4]; 1]| if four.iter().any(|count| *count > 0.0) { counts[h] } else { 0.0 };
        Half { colour, variance: own.variance.each_ref().map(quarter), count: down(fine.size, [&own.count], of) }
    });
    let features = Features {
        variance: f.variance.each_ref().map(quarter),
        scatter: quarter(&f.scatter),
        slope: slopes(&features[6], size),
        mean: features,
        position: f.position.each_ref().map(plane),
        scale: down(fine.size, [&f.scale], |[four]| mean([four.map(|scale| 0.5 * scale)])),
    };
    fine.with_planes(halves, features)
}

/// An image at the next coarser scale.
fn down_pair(fine: &Inputs, coarse: &Inputs, image: &Pair) -> Pair {
    let albedo = fine.features.albedo();
    let mut image = Pair(std::array::from_fn(|k| down(fine.size, [&image.0[k], &albedo[k % 3]], demodulated)));
    image.modulate(coarse.features.albedo());
    image
}

/// Corrects `image`, made from the planes `fine`, by `scales` scales. `coarse` is the first of them, its outliers not taken
/// out.
pub(crate) fn correct(fine: &Inputs, mut coarse: Inputs, image: &mut Pair, scales: usize) {
    let next = (scales > 1 && coarse.pixels() > 1).then(|| coarser(&coarse));
    let found = outliers::take(&mut coarse, COARSER * ratio(scales), true);
    let before = down_pair(fine, &coarse, image);
    let mut smooth = wide(&coarse, &residual_guide(&coarse, &before), &before);
    if !found.is_empty() {
        smooth.add(&outliers::spread_halves(&coarse, found));
    }
    let mut after = shrink(&coarse, before.channels(), &smooth, BLEND, COARSE_EVIDENCE);
    drop(smooth);
    if let Some(next) = next {
        correct(&coarse, next, &mut after, scales - 1);
    }
    add_up(fine, &coarse, image, [&before, &after]);
}

/// Adds the change of a coarse image from `before` to `after` to a fine one.
///
/// A pixel takes the change of the four nearest coarse pixels, weighted by distance and by likeness of normal and depth.
/// Its change is small if none is alike.
fn add_up(fine: &Inputs, coarse: &Inputs, image: &mut Pair, [before, after]: [&Pair; 2]) {
    let ([width, _], [columns, rows]) = (fine.size, coarse.size);
    let change: [Plane; 6] = std::array::from_fn(|k| {
        let planes = [&after.0[k][..], &before.0[k], &coarse.features.albedo()[k % 3]];
        map_to_one(planes, |[after, before, albedo]| (after - before) / raised(albedo))
    });
    // The coarse pixel that holds a pixel, then the next one on the pixel's side.
    let near = |x: usize, end: usize| {
        let (own, left) = (x / 2, x.is_multiple_of(2));
        [own, if left { own.saturating_sub(1) } else { (own + 1).min(end - 1) }]
    };
    let of = |i: usize| -> [f32; 6] {
        let xs = near(i % width, columns);
        let ys = near(i / width, rows);
        let (f, g) = (&fine.features, &coarse.features);
        let depth = SLOPE * f.slope[i];
        let (mut sums, mut total) = ([0.0; 6], NONE);
        for corner in 0..4 {
            let j = ys[corner / 2] * columns + xs[corner % 2];
            let square = |k: usize| (f.mean[k][i] - g.mean[k][j]) * (f.mean[k][i] - g.mean[k][j]);
            let distance = TURNED * (square(0) + square(1) + square(2)) + square(6) / (depth * depth + 1e-4);
            let weight = [0.5625, 0.1875, 0.1875, 0.0625][corner] * exp_minus(distance);
            total += weight;
            sums.iter_mut().zip(&change).for_each(|(sum, change)| *sum += weight * change[j]);
        }
        sums.map(|sum| sum / total)
    };
    let all = planes_of(fine.pixels(), of);
    for (k, plane) in image.0.iter_mut().enumerate() {
        update(plane, [&all[k], &fine.features.albedo()[k % 3]], |value, [change, albedo]| {
            (value + change * raised(albedo)).max(0.0)
        });
    }
}
