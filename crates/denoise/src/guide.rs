//! Guides: the images by which filters compare pixels.

use crate::inputs::Inputs;
use crate::planes::{Colours, Pair, Plane, box_mean, combined, map_to_one, raised, update};

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
