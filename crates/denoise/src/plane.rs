//! Planes, which hold one value per pixel, and pairs of images of them.

use crate::loops::update;

/// One value per pixel, row by row.
pub(crate) type Plane = Vec<f32>;

/// The red, green and blue of each pixel, a plane each.
pub(crate) type Colours = [Plane; 3];

/// Two images, one from each half of the samples.
#[derive(Clone)]
pub(crate) struct Pair(pub(crate) [Colours; 2]);

/// Red, green and blue of the first half, then of the second.
pub(crate) type Channels<'a> = [&'a [f32]; 6];

/// The places of channel `k` of [`Channels`] and of its weights, among planes of which every fourth holds weights.
pub(crate) const fn beside_weights(k: usize) -> [usize; 2] {
    [k + k / 3, k / 3 * 4 + 3]
}

impl Pair {
    /// Two images from their channels.
    pub(crate) fn new([ra, ga, ba, rb, gb, bb]: [Plane; 6]) -> Self {
        Self([[ra, ga, ba], [rb, gb, bb]])
    }

    /// The channels of both images.
    pub(crate) fn channels(&self) -> Channels<'_> {
        let [[ra, ga, ba], [rb, gb, bb]] = &self.0;
        [ra, ga, ba, rb, gb, bb]
    }

    /// Multiplies both halves by each pixel's `albedo`, [raised].
    pub(crate) fn modulate(&mut self, albedo: &[Plane]) {
        for (plane, albedo) in self.0.iter_mut().flat_map(|half| half.iter_mut().zip(albedo)) {
            update(plane, [albedo], |value, [albedo]| value * raised(albedo));
        }
    }

    /// Adds `light` to both halves.
    pub(crate) fn add(&mut self, light: &[Colours; 2]) {
        for (plane, light) in self.0.iter_mut().flatten().zip(light.iter().flatten()) {
            update(plane, [light], |value, [light]| value + light);
        }
    }
}

/// A channel of the mean of both halves `a` and `b`, weighted by their sample counts `na` and `nb`.
#[inline(always)]
pub(crate) fn combined([a, b]: [f32; 2], [na, nb]: [f32; 2]) -> f32 {
    b + first_share([na, nb]) * (a - b)
}

/// The share of the first half in a pixel's samples; 0.5 if the pixel has no samples.
#[inline(always)]
pub(crate) fn first_share([a, b]: [f32; 2]) -> f32 {
    if a + b > 0.0 { a / (a + b) } else { 0.5 }
}

/// The least albedo that colours are divided by.
const LEAST_ALBEDO: f32 = 0.02;

/// An albedo that a colour can be divided by: at least [`LEAST_ALBEDO`].
#[inline(always)]
pub(crate) fn raised(albedo: f32) -> f32 {
    albedo.max(LEAST_ALBEDO)
}
