//! Meshes whose emission is a texture.

use super::mesh::MeshLight;
use super::source::{
    EmissionPdf, EmittedLight, Expectation, Lamp, LightSample, LightSource, SceneSphere, Target, luminance,
};
use crate::texture::Textures;
use dapple_geometry::{Geometry, Shape, SurfacePoint};
use dapple_scene::TextureId;
use glam::Vec3;
use std::sync::Arc;

/// The total number of points at which a light's texture is averaged.
const POINTS: usize = 1 << 18;
/// The largest number of points along a side of one triangle.
const MOST_ALONG: usize = 64;
/// The smallest selection weight of a triangle, as a fraction of the light's mean emission. The points may miss a bright
/// texel.
const LEAST: f32 = 0.01;

/// A mesh whose emission is a texture. Triangles are selected by their mean emission; a sampled point emits the colour of its
/// texel.
#[derive(Clone, Debug)]
pub(crate) struct TexturedLight {
    /// The mesh, with the mean emission.
    mesh: MeshLight,
    emission: TexturedEmission,
    /// The texture coordinates of each triangle's corners.
    uvs: Vec<[[f32; 2]; 3]>,
    /// The area of each triangle divided by the probability of its selection.
    areas: Vec<f32>,
}

/// An emission that varies with a texture.
#[derive(Clone, Debug)]
pub(crate) struct TexturedEmission {
    /// The factor of the texture's values, and the emitting sides.
    pub(crate) lamp: Lamp,
    pub(crate) texture: TextureId,
    pub(crate) textures: Arc<Textures>,
}

impl TexturedEmission {
    /// Returns the radiance at texture coordinates. Invalid values (negative or not finite) become black.
    fn at(&self, uv: [f32; 2]) -> Vec3 {
        let radiance = self.lamp.radiance * self.textures.look_up(self.texture, uv);
        if radiance.is_finite() { radiance.max(Vec3::ZERO) } else { Vec3::ZERO }
    }

    /// Returns the mean emission of a triangle, on a grid of `along` points per side.
    fn mean(&self, uvs: &[[f32; 2]; 3], along: usize) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for (i, j) in (0..along).flat_map(|i| (0..along - i).map(move |j| (i, j))) {
            sum += self.at(between(uvs, [i, j].map(|k| (k as f32 + 1.0 / 3.0) / along as f32)));
        }
        sum / (along * (along + 1) / 2) as f32
    }
}

impl TexturedLight {
    /// Makes the light of the mesh with index `shape` in `geometry`, as [`MeshLight::new`] does. `uvs` holds the texture
    /// coordinates of the vertices; it may be empty.
    pub(crate) fn new(
        (geometry, shape): (&Geometry, u32),
        emission: TexturedEmission,
        sides: &[f32],
        uvs: &[[f32; 2]],
    ) -> Option<Self> {
        let Shape::Mesh(mesh) = &geometry.shapes()[shape as usize] else { return None };
        // pbrt-v4's default texture coordinates of the corners: (0, 0), (1, 0), (1, 1).
        let default = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
        let corners = |t: &[u32; 3]| if uvs.is_empty() { default } else { t.map(|v| uvs[v as usize]) };
        let uvs: Vec<[[f32; 2]; 3]> = mesh.triangles().iter().map(corners).collect();
        let along = ((2 * POINTS / uvs.len().max(1)) as f64).sqrt() as usize;
        let means: Vec<Vec3> = uvs.iter().map(|uvs| emission.mean(uvs, along.clamp(2, MOST_ALONG))).collect();
        let plain = MeshLight::new(geometry, shape, emission.lamp, sides)?;
        let number = |facet: usize| plain.facets[facet].primitive.number() as usize;
        let mean: Vec3 = (0..plain.facets.len()).map(|facet| means[number(facet)] * plain.facets[facet].share).sum();
        // If all points are black, the light keeps a tiny power, since texels between them may emit.
        let mean = mean.max(emission.lamp.radiance * f32::EPSILON);
        let least = LEAST * luminance(mean) as f32;
        let weight = |triangle: u32| least + luminance(means[triangle as usize]) as f32;
        let mesh = MeshLight::weighted(geometry, shape, Lamp { radiance: mean, ..emission.lamp }, sides, weight)?;
        let facets = mesh.facets.iter().zip(&plain.facets);
        let areas = facets.map(|(of, by_area)| (plain.area * f64::from(by_area.share / of.share)) as f32).collect();
        let uvs = plain.facets.iter().map(|facet| uvs[facet.primitive.number() as usize]).collect();
        Some(Self { mesh, emission, uvs, areas })
    }

    /// Returns the radiance that a point of the light emits on its emitting sides.
    #[cold]
    #[inline(never)]
    pub(super) fn radiance(&self, point: &SurfacePoint) -> Vec3 {
        let Some(facet) = self.mesh.facet_at(point) else { return Vec3::ZERO };
        let along_edges = self.mesh.facets[facet].coordinates(point.position);
        let [corner, first, second] = self.uvs[facet];
        self.emission.at(between(&[first, second, corner], along_edges))
    }

    /// Returns the area of the point's triangle divided by the probability of selecting it; infinite for a point that is not
    /// on the light.
    fn area_at(&self, point: &SurfacePoint) -> f32 {
        self.mesh.facet_at(point).map_or(f32::INFINITY, |facet| self.areas[facet])
    }
}

// These functions are marked cold, so that integrators keep the values of other lights in registers.
impl LightSource for TexturedLight {
    #[cold]
    #[inline(never)]
    fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let sample = self.mesh.sample_by(from, u, |facet| self.areas[facet])?;
        let Target::Surface(point) = &sample.target else { return None };
        let radiance = self.radiance(point);
        (radiance != Vec3::ZERO).then_some(LightSample { radiance, ..sample })
    }

    #[cold]
    #[inline(never)]
    fn pdf(&self, from: Vec3, point: &SurfacePoint) -> f32 {
        self.mesh.pdf_by(from, point, || self.area_at(point))
    }

    fn lamp(&self) -> Option<&Lamp> {
        self.mesh.lamp()
    }

    fn emit(&self, _: &SceneSphere, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        let emitted = self.mesh.emit_by(place, towards, |facet| self.areas[facet])?;
        let Target::Surface(point) = &emitted.source else { return None };
        Some(EmittedLight { radiance: self.radiance(point), ..emitted })
    }

    fn emission_pdf(&self, _: &SceneSphere, point: &SurfacePoint, direction: Vec3) -> EmissionPdf {
        self.mesh.lamp.emission_pdf(point.normal.dot(direction), self.area_at(point))
    }

    fn area(&self) -> f64 {
        self.mesh.area
    }

    fn expectation(&self) -> Expectation {
        self.mesh.expectation()
    }
}

/// Returns the texture coordinates at barycentric weights; `a` and `b` are the weights of the first two corners.
fn between(uvs: &[[f32; 2]; 3], [a, b]: [f32; 2]) -> [f32; 2] {
    [0, 1].map(|i| a * uvs[0][i] + b * uvs[1][i] + (1.0 - a - b) * uvs[2][i])
}
