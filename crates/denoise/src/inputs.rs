//! A film's halves, features and clusters as planes, in the form that the filters read, and the guides made of them.

use crate::features::{FEATURES, Features, UNKNOWN};
use crate::light::{BRIGHTEST, Bounds, Light, Part};
use crate::one_sample::{self, Halves, Surroundings};
use crate::planes::{
    Channels, Colours, Pair, Plane, box_mean, combined, found, map_to_one, per_pixel, planes_of, quantile, raised,
    sum_pixels, update,
};
use dapple_core::film::RgbMoments;
pub(crate) use dapple_core::integrator::BACKGROUND;
use dapple_core::{Film, Filtered, Needs, options::Options};
use std::fmt;
use std::sync::Arc;

/// A function from shape and primitive of a first hit to its cluster; `None` for the background.
pub type ClusterLookup = Arc<dyn Fn(u32, u32) -> Option<u32> + Send + Sync>;

/// A filter's description: its name, its parameters and those of its clusters, if any.
pub(crate) fn describe(name: &str, options: &impl Options, clusters: &str) -> String {
    let comma = if clusters.is_empty() { "" } else { "," };
    format!("{name}:{}{comma}{clusters}", options.describe())
}

/// The statistics that a filter reads besides halves and variance.
#[derive(Clone, Default)]
pub(crate) struct Reads {
    /// Without features, every pixel counts as a miss.
    pub(crate) without_features: bool,
    /// The cluster of each surface, by this function.
    pub(crate) label: Option<ClusterLookup>,
    /// The description of the clusters.
    pub(crate) described: String,
}

impl fmt::Debug for Reads {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Reads(features={},clusters={:?})", !self.without_features, self.described)
    }
}

impl Reads {
    /// The statistics that the film records, but for surfaces. Films without emission are filtered too.
    pub(crate) fn recorded(&self) -> Needs {
        let recorded = Needs::none().with_variance().with_halves().with_emission();
        if self.without_features { recorded } else { recorded.with_features() }
    }

    /// The description of a filter that reads these statistics.
    pub(crate) fn describe(&self, name: &str, options: &impl Options) -> String {
        describe(name, options, &self.described) + if self.without_features { ",features=none" } else { "" }
    }
}

/// The variance added to the variance of a sample, in units of the squared level. At one sample, differences of 2 % of
/// the level then count as noise. With more samples, that limit falls, so filters stay consistent.
const FLOOR: f32 = 4e-4;

/// The weight, in degrees of freedom, of the variance over 5x5 pixels. A pixel's own variance of `n` samples has the
/// weight `n - 1`.
const POOLED: f32 = 6.0;

/// One half of a film's samples.
pub(crate) struct Half {
    /// The mean colours, divided by the level of the image ([`Inputs::level`]).
    pub(crate) colour: Colours,
    /// The variances of the mean colours, in squared levels. The variance of a sample is shrunk towards that of 5x5
    /// pixels.
    pub(crate) variance: Colours,
    /// The number of samples in each pixel.
    pub(crate) count: Plane,
}

/// A film's halves, features and clusters as planes, which the filters read.
pub(crate) struct Inputs {
    /// Width and height of the planes.
    pub(crate) size: [usize; 2],
    /// The radiance that is 1 in these planes, and the largest light in them; the rest is withheld ([`Inputs::restored`]).
    levels: Levels,
    pub(crate) part: Part,
    pub(crate) halves: [Half; 2],
    pub(crate) features: Features,
    /// The cluster of each pixel's first sample, modulo 2^24 - 3 so that an `f32` holds it; `None` without clusters.
    pub(crate) labels: Option<Plane>,
}

impl Inputs {
    /// Reads the halves and the sample variance of a film's light, and what else `reads` lists.
    pub(crate) fn new(light: Light<'_>, reads: &Reads) -> Self {
        let film = light.film;
        let features = Features::new(film, !reads.without_features);
        let levels = Levels::of(light);
        let halves = colours(light, &features, levels);
        let labels = reads.label.as_ref().filter(|_| film.needs().surfaces).map(|label| {
            let of = |i: usize| film.surface(i).and_then(|[shape, primitive]| label(shape, primitive));
            per_pixel(film.frame().pixels(), |i| (of(i).unwrap_or(BACKGROUND) % 0xff_fffd) as f32)
        });
        let size = film.frame().size().map(|n| n as usize);
        Self { size, levels, part: light.part, halves, features, labels }
    }

    /// Reads the colours of another part of the film's light. Features and clusters stay.
    pub(crate) fn read(&mut self, light: Light<'_>) {
        (self.levels, self.part) = (Levels::of(light), light.part);
        self.halves = colours(light, &self.features, self.levels);
    }

    /// The number of bytes per pixel that these planes occupy, and the largest number while they are computed.
    pub(crate) const fn bytes_per_pixel(labels: bool) -> [usize; 2] {
        let (halves, labels) = (2 * 7, if labels { 1 } else { 0 });
        let features = FEATURES + 3 + 1 + 1 + 3 + 1;
        let kept = halves + features + labels;
        // The planes of halves are made after those of features, and their variances last.
        [4 * kept, 4 * (kept + one_sample::PLANES)]
    }

    /// Adds the light that the filter did not get to the image that it made.
    pub(crate) fn restored(&self, light: Light<'_>, filtered: Filtered) -> Filtered {
        self.levels.bounds.restore(light, filtered)
    }

    /// The albedo, [prefiltered](crate::averaging::prefilter) where the features are.
    pub(crate) fn into_albedo(self) -> Colours {
        let [_, _, _, red, green, blue, _] = self.features.mean;
        [red, green, blue]
    }

    /// The image's level: the radiance (near the mean of the image) that is scaled to 1 in these planes.
    pub(crate) fn level(&self) -> f32 {
        self.levels.level
    }

    /// The number of pixels.
    pub(crate) fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// The number of samples in each pixel of both halves.
    pub(crate) fn counts(&self) -> [&[f32]; 2] {
        self.halves.each_ref().map(|half| &half.count[..])
    }

    /// The colours of both halves.
    pub(crate) fn unfiltered(&self) -> Channels<'_> {
        let [[ra, ga, ba], [rb, gb, bb]] = self.halves.each_ref().map(|half| &half.colour);
        [ra, ga, ba, rb, gb, bb]
    }
}

/// The brightness of a film's light.
#[derive(Clone, Copy)]
pub(crate) struct Levels {
    /// The image's level: the mean brightness of its pixels, each within 0 and eight times the median of pixels that are not
    /// black. It is 1 for a black image.
    pub(crate) level: f32,
    /// The largest light that filters get from a pixel.
    pub(crate) bounds: Bounds,
}

impl Levels {
    /// The level and the bounds of a film's light.
    pub(crate) fn of(light: Light<'_>) -> Self {
        let (size, pixels) = (light.film.frame().size().map(|n| n as usize), light.film.frame().pixels());
        let grey = per_pixel(pixels, |i| (light.mean(i).iter().sum::<f64>() / 3.0) as f32);
        let level = level(&grey, size);
        Self { level, bounds: Bounds::new(light, level) }
    }
}

/// The level of an image from the brightness of its pixels ([`Levels::level`]).
pub(crate) fn level(grey: &[f32], size: [usize; 2]) -> f32 {
    let lit: Vec<f32> = grey.iter().copied().filter(|g| *g > 0.0).collect();
    quantile(lit, 2).map_or(1.0, |median| {
        let [sum] = sum_pixels(size, |i| [f64::from(grey[i].clamp(0.0, 8.0 * median))]);
        // Not so small that a division by it overflows.
        ((sum / grey.len() as f64) as f32).clamp(1e-18, 1e18)
    })
}

/// The halves of a film's light.
fn colours(light: Light<'_>, features: &Features, Levels { level, bounds }: Levels) -> [Half; 2] {
    let mut halves = halves(light, level, bounds);
    let size = light.film.frame().size().map(|n| n as usize);
    let samples = halves.complete(&Surroundings { features, light, bounds, level, size });
    let mut halves = with_variances(light.film, halves, samples);
    refine(light, &mut halves);
    halves
}

/// Lowers the variances of pixels whose emission samples of features alone refine. Variances over 5x5 pixels are made before:
/// beside such pixels lie some of the same edge that have none.
fn refine(light: Light<'_>, halves: &mut [Half; 2]) {
    let left = |i: usize| light.variance_left(i).map(|left| (i, left));
    for (i, left) in found(light.film.frame().pixels(), left) {
        halves.iter_mut().for_each(|half| (0..3).for_each(|c| half.variance[c][i] *= left[c]));
    }
}

/// The halves of the samples, without the light that is withheld.
fn halves(light: Light<'_>, level: f32, bounds: Bounds) -> Halves {
    let unit = 1.0 / f64::from(level);
    let value = |x: f64| ((x * unit) as f32).min(BRIGHTEST);
    let most = f64::from(BRIGHTEST) * f64::from(BRIGHTEST);
    let of = |i: usize| {
        let halves = [0, 1].map(|half| light.half(half, i));
        let withheld = bounds.withheld_of_halves(light, i, &halves);
        let [[ra, ga, ba], [rb, gb, bb]] = [0, 1].map(|h: usize| {
            // A missing half takes the film's mean. Its variance is UNKNOWN.
            let mean = if halves[h].count > 0 { halves[h].mean } else { light.mean(i) };
            std::array::from_fn(|c| value(mean[c] - withheld[h][c]))
        });
        let [na, nb] = halves.map(|half| half.count as f32);
        let variance = light.variance(i);
        let known = f32::from(u8::from(variance.is_some()));
        let variance = variance.map_or([0.0; 3], |variance| without_withheld(&halves, &withheld, variance));
        let [vr, vg, vb] = variance.map(|v| (v * unit * unit).min(most) as f32);
        [ra, ga, ba, rb, gb, bb, na, nb, known, vr, vg, vb]
    };
    let [ra, ga, ba, rb, gb, bb, na, nb, known, vr, vg, vb] = planes_of(light.film.frame().pixels(), of);
    Halves { colours: [[ra, ga, ba], [rb, gb, bb]], counts: [na, nb], variance: [vr, vg, vb], known }
}

/// The halves with the variances of their colours: those of means of so many `samples`, or of the counts.
fn with_variances(film: &Film, halves: Halves, samples: Option<[Plane; 2]>) -> [Half; 2] {
    let Halves { colours: [first, second], counts: [na, nb], variance, known } = halves;
    let sample = pooled_variance(film, variance, &known);
    let variance = |samples: &Plane, sample: &Plane| -> Plane {
        map_to_one([sample, samples], |[v, n]| if n > 0.0 { (v + FLOOR) / n } else { UNKNOWN })
    };
    let half = |h: usize, colour: Colours, count: Plane| {
        let samples = samples.as_ref().map_or(&count, |samples| &samples[h]);
        let variance = sample.each_ref().map(|sample| variance(samples, sample));
        Half { colour, variance, count }
    };
    [half(0, first, na), half(1, second, nb)]
}

/// The variance of one sample in each pixel, shrunk towards the variance over 5x5 pixels, in squared levels. `own` is the
/// variance where it is `known`.
fn pooled_variance(film: &Film, own: Colours, known: &Plane) -> Colours {
    let size = film.frame().size().map(|n| n as usize);
    let near = box_mean(known, size, 2);
    let freedom: Plane = per_pixel(film.frame().pixels(), |i| (film.count(i).max(1) - 1) as f32 * known[i]);
    own.map(|mut own| {
        let sums = box_mean(&own, size, 2);
        update(&mut own, [&sums, &near, &freedom], |own, [sum, near, freedom]| {
            let pooled = (freedom * own + POOLED * sum / near) / (freedom + POOLED);
            if near > 0.0 { pooled } else { UNKNOWN }
        });
        own
    })
}

/// The variance of one sample of a pixel without the light that is withheld, from the sample `variance`.
///
/// Withheld light varies at the edges of lamps. There the difference of the halves bounds the variance of the rest.
fn without_withheld([a, b]: &[RgbMoments; 2], withheld: &[[f64; 3]; 2], variance: [f64; 3]) -> [f64; 3] {
    if *withheld == [[0.0; 3]; 2] {
        return variance;
    }
    let share = a.count as f64 * b.count as f64 / (a.count + b.count).max(1) as f64;
    std::array::from_fn(|c| {
        let rest = a.mean[c] - withheld[0][c] - b.mean[c] + withheld[1][c];
        variance[c].min(rest * rest * share)
    })
}

/// An image by which a filter compares pixels: a colour per pixel and its variance.
pub(crate) struct Guide {
    /// The colour of each pixel.
    pub(crate) colour: Colours,
    /// The variance of each pixel's colour: one plane with the sum over the channels, or three planes to compare each
    /// channel by itself [after Rousselle 2012].
    pub(crate) variance: Vec<Plane>,
}

/// Makes a guide from the mean colours of one half of the samples. `pooled` adds the variances of the three channels;
/// `demodulated` divides colours by albedo.
pub(crate) fn guide(inputs: &Inputs, half: usize, pooled: bool, demodulated: bool) -> Guide {
    let (own, albedo) = (&inputs.halves[half], inputs.features.albedo());
    let colour: Colours = std::array::from_fn(|c| match demodulated {
        true => map_to_one([&own.colour[c], &albedo[c]], |[v, albedo]| v / raised(albedo)),
        false => own.colour[c].clone(),
    });
    let variance: Colours = std::array::from_fn(|c| match demodulated {
        true => map_to_one([&own.variance[c], &albedo[c]], |[v, albedo]| v / (raised(albedo) * raised(albedo))),
        false => own.variance[c].clone(),
    });
    if !pooled {
        return Guide { colour, variance: variance.into() };
    }
    let sum = map_to_one(variance.each_ref().map(|plane| &plane[..]), |[r, g, b]| r + g + b);
    Guide { colour, variance: vec![sum] }
}

/// The radius over which the noise of a residual guide is averaged.
const RESIDUAL: usize = 3;

/// The guide of wider passes: a filtered image without its albedo, and its remaining noise from the difference of
/// the halves over 7x7 pixels.
///
/// The variance is that of one half, `(a - b)^2 / 2`. The variance of the whole image, `(a - b)^2 / 4`, left more
/// error. One guide serves both halves. It keeps little of their noise and costs half as much as two guides.
pub(crate) fn residual_guide(inputs: &Inputs, image: &Pair) -> Guide {
    let ([ra, ga, ba, rb, gb, bb], [na, nb]) = (image.channels(), inputs.counts());
    let [_, _, _, ar, ag, ab, _] = &inputs.features.mean;
    let difference = map_to_one([ra, ga, ba, rb, gb, bb, ar, ag, ab], |[ra, ga, ba, rb, gb, bb, ar, ag, ab]| {
        let apart = |a: f32, b: f32, albedo: f32| a / raised(albedo) - b / raised(albedo);
        let [r, g, b] = [apart(ra, rb, ar), apart(ga, gb, ag), apart(ba, bb, ab)];
        0.5 * (r * r + g * g + b * b)
    });
    let mut variance = box_mean(&difference, inputs.size, RESIDUAL);
    // The floor under the variance, as in the first pass: it is not 0 and keeps the filter consistent.
    update(&mut variance, [na, nb], |noise, [na, nb]| noise + 3.0 * 4e-4 / (na + nb).max(1.0));
    let colour = [[ra, rb, ar], [ga, gb, ag], [ba, bb, ab]].map(|[a, b, albedo]| {
        map_to_one([a, b, albedo, na, nb], |[a, b, albedo, na, nb]| combined([a, b], [na, nb]) / raised(albedo))
    });
    Guide { colour, variance: vec![variance] }
}
