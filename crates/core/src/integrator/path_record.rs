//! What a renderer's own loop notes of a path, so that no ray is traced twice.

use super::{Estimate, FirstHit, SurfaceFeatures};

/// A path as a renderer's own loop follows it: the first hit, the features of what mirrors and glass show, the light, and which part of it
/// is emission seen directly and which is indirect.
///
/// The loop reports each surface, then the light that the surface emits and the light that reaches it.
///
/// ```
/// use dapple_core::{FirstHit, PathRecord};
///
/// # struct Hit { at: [f32; 3], normal: [f32; 3], t: f32, emission: [f32; 3] }
/// # let mut hits = vec![Hit { at: [0.0; 3], normal: [0.0, 1.0, 0.0], t: 2.0, emission: [0.0; 3] }].into_iter();
/// # let (direct, sky) = ([0.1; 3], [0.5; 3]);
/// let (mut path, mut weight) = (PathRecord::new(), [1.0; 3]);
/// while let Some(hit) = hits.next() {
///     path.surface(FirstHit::new(hit.at, hit.normal, hit.t).with_albedo([0.6; 3]), weight);
///     path.emits(weight, hit.emission);
///     weight = weight.map(|w| 0.6 * w); // the surface's reflectance
///     path.receives(weight, direct);    // a sample of a lamp, where it is not hidden
/// }
/// path.receives(weight, sky);           // the last ray met no surface
/// let estimate = path.estimate();
/// assert_eq!((estimate.radiance, estimate.emission), ([0.36; 3], [0.0; 3]));
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct PathRecord {
    first_hit: Option<FirstHit>,
    features: Option<SurfaceFeatures>,
    /// The length of the path so far.
    depth: f32,
    /// The numbers of rough surfaces before the last surface, and with it.
    rough: [u32; 2],
    radiance: [f32; 3],
    emission: [f32; 3],
    indirect: [f32; 3],
}

impl PathRecord {
    /// A path that has met nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Notes the next surface, with the share of its light that reaches the camera, linear RGB: the product of the weights of all surfaces
    /// before it.
    ///
    /// A roughness of 0 stands for a mirror, clear glass or the smooth coat that reflected the path: the features are then those of the next
    /// surface. `depth` is the distance from the last surface.
    #[inline]
    pub fn surface(&mut self, hit: FirstHit, weight: [f32; 3]) {
        self.depth += hit.depth;
        let is_rough = hit.roughness > 0.0;
        if self.first_hit.is_none() {
            self.first_hit = Some(hit);
        } else if is_rough && self.rough[1] == 0 {
            let albedo = [0, 1, 2].map(|c| (weight[c] * hit.albedo[c]).clamp(0.0, 1.0));
            let features = SurfaceFeatures::new(hit.position, hit.shading_normal, self.depth);
            self.features = Some(features.with_albedo(albedo));
        }
        self.rough = [self.rough[1], self.rough[1] + u32::from(is_rough)];
    }

    /// Adds the light that the last surface emits, times the weight of the path before it.
    #[inline]
    pub fn emits(&mut self, weight: [f32; 3], light: [f32; 3]) {
        self.add(weight, light, self.rough[0]);
    }

    /// Adds light that reaches the last surface, times the weight of the path with it: from a lamp that was sampled there, or from the
    /// background that the next ray meets. Before the first surface it is the background that the camera sees.
    #[inline]
    pub fn receives(&mut self, weight: [f32; 3], light: [f32; 3]) {
        self.add(weight, light, self.rough[1]);
    }

    /// Adds light that this number of rough surfaces have scattered.
    #[inline]
    fn add(&mut self, weight: [f32; 3], light: [f32; 3], scattered: u32) {
        for c in 0..3 {
            let light = weight[c] * light[c];
            self.radiance[c] += light;
            self.emission[c] += if scattered == 0 { light } else { 0.0 };
            self.indirect[c] += if scattered >= 2 { light } else { 0.0 };
        }
    }

    /// The sample of this path. Without a surface it is a miss.
    #[inline]
    pub fn estimate(&self) -> Estimate {
        let light = Estimate::new(self.radiance).with_emission(self.emission).with_indirect(self.indirect);
        light.with_first_hit(self.first_hit).with_features(self.features)
    }
}
