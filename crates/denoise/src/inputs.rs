//! A film's halves, features and clusters as planes, the form in which filters read them, and guides computed from them.

use crate::features::{Features, UNKNOWN};
use crate::graph::{Graph, Reach, all};
use crate::light::{BRIGHTEST, Bounds, Light, Part};
use crate::one_sample::{Halves, Surroundings};
use crate::planes::{
    Colours, Pair, Plane, box_mean, combined, map, map_to_one, per_pixel, planes_of, quantile, raised, sum_pixels,
};
use dapple_core::film::RgbMoments;
pub(crate) use dapple_core::integrator::BACKGROUND;
use dapple_core::{Film, Needs, options::Options};
use std::fmt;
use std::sync::Arc;

/// A function from the shape number and the primitive number of a first hit to a cluster number; `None` for the background.
pub type ClusterLookup = Arc<dyn Fn(u32, u32) -> Option<u32> + Send + Sync>;

/// A filter's description: its name, its parameters, and the parameters of its clusters, if any.
pub(crate) fn describe(name: &str, options: &impl Options, clusters: &str) -> String {
    let comma = if clusters.is_empty() { "" } else { "," };
    format!("{name}:{}{comma}{clusters}", options.describe())
}

/// The statistics that a filter reads besides halves and variance.
#[derive(Clone, Default)]
pub(crate) struct Reads {
    /// If `true`, every pixel counts as a miss.
    pub(crate) without_features: bool,
    /// The function that returns the cluster of a surface.
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
    /// The statistics that the film must record, except surfaces. Films without emission are filtered too.
    pub(crate) fn recorded(&self) -> Needs {
        let recorded = Needs::none().with_variance().with_halves().with_emission();
        if self.without_features { recorded } else { recorded.with_features() }
    }

    /// The description of a filter that reads these statistics.
    pub(crate) fn describe(&self, name: &str, options: &impl Options) -> String {
        describe(name, options, &self.described) + if self.without_features { ",features=none" } else { "" }
    }
}

/// The variance added to the variance of a sample, in squared levels. At one sample per pixel, differences of 2 % of the level
/// then count as noise. The limit falls as samples are added, so filters stay consistent.
const FLOOR: f32 = 4e-4;

/// The weight, in degrees of freedom, of the mean variance over 5x5 pixels. A pixel's own variance, computed from `n` samples,
/// has the weight `n - 1`.
const POOLED: f32 = 6.0;

/// One half of a film's samples.
#[derive(Clone, Copy)]
pub(crate) struct Half {
    /// The mean colours, divided by the level of the image ([`Inputs::level`]).
    pub(crate) colour: Colours,
    /// The variances of the mean colours, in squared levels. They follow from the variance of one sample, which is shrunk
    /// towards the mean over 5x5 pixels.
    pub(crate) variance: Colours,
    /// The number of samples in each pixel.
    pub(crate) count: Plane,
}

/// A film's halves, features and clusters as planes, which the filters read.
#[derive(Clone, Copy)]
pub(crate) struct Inputs {
    /// The radiance that is scaled to 1 in these planes, and the bounds above which light is withheld.
    levels: Levels,
    pub(crate) part: Part,
    pub(crate) halves: [Half; 2],
    pub(crate) features: Features,
    /// The cluster of each pixel's first sample, modulo 2^24 - 3 so that an `f32` holds it; `None` without clusters.
    pub(crate) labels: Option<Plane>,
}

impl Inputs {
    /// Reads the halves and the sample variance of a film's light, and the statistics that `reads` lists.
    pub(crate) fn new<'a>(graph: &Graph<'a>, light: Light<'a>, reads: &Reads) -> Self {
        let film = light.film;
        let features = Features::new(graph, film, !reads.without_features);
        let levels = Levels::of(light);
        let halves = colours(graph, light, features, levels);
        let labels = reads.label.clone().filter(|_| film.needs().surfaces).map(|label| {
            let of = move |i: usize| film.surface(i).and_then(|[shape, primitive]| label(shape, primitive));
            let [plane] = planes_of(graph, move |i| [(of(i).unwrap_or(BACKGROUND) % 0xff_fffd) as f32]);
            plane
        });
        Self { levels, part: light.part, halves, features, labels }
    }

    /// The same planes with the colours of another part of the film's light.
    pub(crate) fn of_part<'a>(self, graph: &Graph<'a>, light: Light<'a>) -> Self {
        let levels = Levels::of(light);
        let halves = colours(graph, light, self.features, levels);
        Self { levels, part: light.part, halves, ..self }
    }

    /// The bounds above which light is withheld from the planes.
    pub(crate) fn bounds(&self) -> Bounds {
        self.levels.bounds
    }

    /// The image's level: the radiance (near the mean of the image) that is scaled to 1 in these planes.
    pub(crate) fn level(&self) -> f32 {
        self.levels.level
    }

    /// The number of samples of each half in each pixel.
    pub(crate) fn counts(&self) -> [Plane; 2] {
        self.halves.map(|half| half.count)
    }

    /// The colours of both halves.
    pub(crate) fn unfiltered(&self) -> Pair {
        let [[ra, ga, ba], [rb, gb, bb]] = self.halves.map(|half| half.colour);
        Pair([ra, ga, ba, rb, gb, bb])
    }
}

/// The brightness level of a film's light, and the bounds that depend on it.
#[derive(Clone, Copy)]
pub(crate) struct Levels {
    /// The image's level: the mean brightness of its pixels, each clamped to 0 .. 8 times the median of the pixels that are not
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
        // Large enough that a division by it does not overflow.
        ((sum / grey.len() as f64) as f32).clamp(1e-18, 1e18)
    })
}

/// The halves of a film's light, with missing halves interpolated.
fn colours<'a>(graph: &Graph<'a>, light: Light<'a>, features: Features, Levels { level, bounds }: Levels) -> [Half; 2] {
    let halves = halves(graph, light, level, bounds);
    let (halves, samples) = halves.complete(graph, Surroundings { features, light, bounds, level });
    with_variances(graph, light, halves, samples)
}

/// The halves of the samples, without the withheld light.
fn halves<'a>(graph: &Graph<'a>, light: Light<'a>, level: f32, bounds: Bounds) -> Halves {
    let unit = 1.0 / f64::from(level);
    let value = move |x: f64| ((x * unit) as f32).min(BRIGHTEST);
    let most = f64::from(BRIGHTEST) * f64::from(BRIGHTEST);
    let of = move |i: usize| {
        let halves = [0, 1].map(|half| light.half(half, i));
        let withheld = bounds.withheld_of_halves(light, i, &halves);
        let [[ra, ga, ba], [rb, gb, bb]] = [0, 1].map(|h: usize| {
            // A half without samples uses the film's mean. Its variance is UNKNOWN.
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
    let [ra, ga, ba, rb, gb, bb, na, nb, known, vr, vg, vb] = planes_of(graph, of);
    Halves { colours: [[ra, ga, ba], [rb, gb, bb]], counts: [na, nb], variance: [vr, vg, vb], known }
}

/// Adds the variances of the colours to the halves. Each is the variance of a mean of `samples` samples.
///
/// Variances are lower in pixels whose emission is refined by feature-only samples. The average over 5x5 pixels is taken before
/// that, because neighbours on the same edge may not be refined.
fn with_variances<'a>(graph: &Graph<'a>, light: Light<'a>, halves: Halves, samples: [Plane; 2]) -> [Half; 2] {
    let Halves { colours: [first, second], counts: [na, nb], variance, known } = halves;
    let sample = pooled_variance(graph, light.film, variance, known);
    let reads = all(sample.into_iter().chain(samples), Reach::rows(0));
    let [ra, ga, ba, rb, gb, bb] = graph.rows(reads, move |rows, y, mut to: [&mut [f32]; 6]| {
        let width = to[0].len();
        for (k, to) in to.iter_mut().enumerate() {
            let [v, n] = [sample[k % 3], samples[k / 3]].map(|plane| rows.row(plane, y));
            let variance = |(v, n): (&f32, &f32)| if *n > 0.0 { (v + FLOOR) / n } else { UNKNOWN };
            to.iter_mut().zip(v.iter().zip(n).map(variance)).for_each(|(to, value)| *to = value);
        }
        for (x, left) in (0..width).filter_map(|x| Some((x, light.variance_left(y * width + x)?))) {
            to.iter_mut().enumerate().for_each(|(k, to)| to[x] *= left[k % 3]);
        }
    });
    let half = |colour, variance, count| Half { colour, variance, count };
    [half(first, [ra, ga, ba], na), half(second, [rb, gb, bb], nb)]
}

/// The variance of one sample in each pixel, shrunk towards the mean variance over 5x5 pixels, in squared levels. `own` is the
/// pixel's variance where `known` is 1.
fn pooled_variance<'a>(graph: &Graph<'a>, film: &'a Film, own: Colours, known: Plane) -> Colours {
    let near = box_mean(graph, known, 2);
    let [freedom] = planes_of(graph, |i| [(film.count(i).max(1) - 1) as f32]);
    own.map(|own| {
        let sum = box_mean(graph, own, 2);
        map_to_one(graph, [own, sum, near, freedom, known], |[own, sum, near, freedom, known]| {
            let freedom = freedom * known;
            let pooled = (freedom * own + POOLED * sum / near) / (freedom + POOLED);
            if near > 0.0 { pooled } else { UNKNOWN }
        })
    })
}

/// The variance of one sample of a pixel without the withheld light; `variance` includes that light.
///
/// Withheld light varies at the edges of light sources. There the difference of the halves bounds the variance of the rest.
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

/// An image by which a filter compares pixels: the colour of each pixel and its variance.
#[derive(Clone)]
pub(crate) struct Guide {
    /// The colour of each pixel.
    pub(crate) colour: Colours,
    /// The variance of each pixel's colour: one plane with the sum over the channels, or three planes to compare
    /// channels separately [after Rousselle 2012].
    pub(crate) variance: Vec<Plane>,
}

/// Creates a guide from the mean colours of one half of the samples. `pooled` adds the variances of the three channels;
/// `demodulated` divides colours by albedo.
pub(crate) fn guide(graph: &Graph<'_>, inputs: &Inputs, half: usize, pooled: bool, demodulated: bool) -> Guide {
    let (Half { mut colour, mut variance, .. }, albedo) = (inputs.halves[half], inputs.features.albedo());
    for c in (0..3).filter(|_| demodulated) {
        [colour[c], variance[c]] = map(graph, [colour[c], variance[c], albedo[c]], |[v, variance, albedo]| {
            [v / raised(albedo), variance / (raised(albedo) * raised(albedo))]
        });
    }
    let sum = || vec![map_to_one(graph, variance, |[r, g, b]| r + g + b)];
    Guide { colour, variance: if pooled { sum() } else { variance.into() } }
}

/// The radius over which the noise of a residual guide is averaged.
const RESIDUAL: usize = 3;

/// The guide of wider passes: a filtered image divided by its albedo, with its remaining noise from the difference of the
/// halves over 7x7 pixels.
///
/// The variance is that of one half, `(a - b)^2 / 2`. The variance of the whole image, `(a - b)^2 / 4`, leaves more error. One
/// guide serves both halves. It contains little of their noise and costs half as much as two guides.
pub(crate) fn residual_guide(graph: &Graph<'_>, inputs: &Inputs, image: Pair) -> Guide {
    let (Pair([ra, ga, ba, rb, gb, bb]), [na, nb]) = (image, inputs.counts());
    let [ar, ag, ab] = inputs.features.albedo();
    let difference = map_to_one(graph, [ra, ga, ba, rb, gb, bb, ar, ag, ab], |[ra, ga, ba, rb, gb, bb, ar, ag, ab]| {
        let apart = |a: f32, b: f32, albedo: f32| a / raised(albedo) - b / raised(albedo);
        let [r, g, b] = [apart(ra, rb, ar), apart(ga, gb, ag), apart(ba, bb, ab)];
        0.5 * (r * r + g * g + b * b)
    });
    let noise = box_mean(graph, difference, RESIDUAL);
    // A floor for the variance, as in the first pass. It is never 0 and falls as samples are added, so the filter stays
    // consistent.
    let variance = map_to_one(graph, [noise, na, nb], |[noise, na, nb]| noise + 3.0 * 4e-4 / (na + nb).max(1.0));
    let colour = [[ra, rb, ar], [ga, gb, ag], [ba, bb, ab]].map(|[a, b, albedo]| {
        map_to_one(graph, [a, b, albedo, na, nb], |[a, b, albedo, na, nb]| combined([a, b], [na, nb]) / raised(albedo))
    });
    Guide { colour, variance: vec![variance] }
}
