//! A scene made ready for rays.

mod build;
#[cfg(test)]
mod frame_tests;
mod placed;
mod query;
mod relief;
#[cfg(test)]
mod tests;
mod time;

pub use build::WorldError;

use crate::camera::CameraView;
use crate::light::{LightChoice, Lights};
use crate::material::Surface;
use crate::medium::Media;
use crate::pixel_filter::FilterSampler;
use crate::shading::{Bsdf, Frame};
use crate::space::Space;
use crate::texture::Textures;
use dapple_geometry::{Geometry, Hit, Ray, Shape, SurfacePoint};
use dapple_scene::{MediumInterface, Scalar, Scene};
use glam::Vec3;

/// Everything that rays need, built from a [`Scene`]: geometry in a tree, lights with their
/// probabilities, materials with their tables, the camera.
#[derive(Clone, Debug)]
pub struct World {
    pub(crate) geometry: Geometry,
    /// Of the base shapes.
    pub(crate) parts: Vec<Part>,
    /// Of all objects' shapes, object by object.
    pub(crate) object_parts: Vec<Part>,
    pub(crate) surfaces: Vec<Surface>,
    pub(crate) textures: Textures,
    pub(crate) lights: Lights,
    pub(crate) camera: CameraView,
    pub(crate) filter: FilterSampler,
    pub(crate) max_depth: u32,
    pub(crate) space: Space,
    pub(crate) dropped_triangles: usize,
    /// Whether anything moves while the shutter is open: the camera, or what it sees.
    pub(crate) moves: bool,
    /// What fills space.
    pub(crate) media: Media,
    /// What fills it around the camera.
    pub(crate) camera_medium: u32,
    /// Whether light passes any surface.
    clear: bool,
    /// Whether a part is [unusual](Part::unusual).
    unusual: bool,
    /// The part of the motion during which the shutter is open, in `[0, 1]`.
    pub(crate) open: [f32; 2],
}

/// A point of a lamp, found by following a ray.
#[derive(Clone, Copy, Debug)]
pub struct Emitter {
    /// Number of the light, as [`Lights::pdf`] takes it.
    pub light: u32,
    /// The point; its normal turned to the side that shines.
    pub point: SurfacePoint,
    /// Radiance towards the ray's origin; black on the dark side.
    pub radiance: Vec3,
}

/// What belongs to one shape besides its geometry.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    pub(crate) material: u32,
    /// Number of its light; `NO_LIGHT` if it does not shine.
    pub(crate) light: u32,
    /// 1, or -1 where the geometric normal points the other way than the tree's.
    pub(crate) flip: f32,
    /// Vertex normals, transformed and unit length, or none.
    pub(crate) normals: Vec<Vec3>,
    /// Texture coordinates, or none.
    pub(crate) uvs: Vec<[f32; 2]>,
    /// Opacity, where it is not 1 throughout.
    pub(crate) alpha: Option<Scalar>,
    /// What fills space on its sides: `outside` is where an [`Interaction`]'s normal points.
    pub(crate) media: Option<MediumInterface>,
    /// Whether rays may pass it unscattered, or its material is a mix: see where it is hit.
    pub(crate) unusual: bool,
}

pub(crate) const NO_LIGHT: u32 = u32::MAX;
/// Empty space.
pub(crate) const NO_MEDIUM: u32 = u32::MAX;

/// A hit with its orientation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Interaction<'w> {
    pub(crate) part: &'w Part,
    pub(crate) hit: Hit,
    /// The point; its normal turned to the side that shines.
    pub(crate) point: SurfacePoint,
    /// Interpolated vertex normal, on the side of the geometric one; the geometric one without.
    pub(crate) shading_normal: Vec3,
    /// When it was hit.
    pub(crate) time: f32,
}

impl World {
    /// Builds a world from a scene, for images of the scene's resolution.
    ///
    /// # Errors
    ///
    /// Every problem found, with the objects' lines.
    pub fn new(scene: &Scene) -> Result<Self, WorldError> {
        build::build(scene, scene.film.resolution)
    }

    /// The same for another resolution.
    ///
    /// # Errors
    ///
    /// As [`World::new`].
    pub fn with_resolution(scene: &Scene, resolution: [u32; 2]) -> Result<Self, WorldError> {
        build::build(scene, resolution)
    }

    /// Limits the scattering events between camera and light, whatever the scene says.
    pub fn set_max_depth(&mut self, max_depth: u32) {
        self.max_depth = max_depth;
    }

    /// Sets how a light is chosen among several: by power, unless this says otherwise.
    pub fn set_light_choice(&mut self, choice: LightChoice) {
        self.lights.set_choice(choice);
    }

    /// Most scattering events between camera and light.
    pub fn max_depth(&self) -> u32 {
        self.max_depth
    }

    /// The geometry.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The lights.
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// The camera.
    pub fn camera(&self) -> &CameraView {
        &self.camera
    }

    /// What shines where a ray meets its first surface: the other half, besides [`Lights::sample`], of an
    /// estimator of one's own. `None` where it meets nothing, or something dark.
    pub fn emitter(&self, ray: &Ray) -> Option<Emitter> {
        let at = self.closest(ray)?;
        let lamp = self.lights.lamp(at.part.light)?;
        let radiance = lamp.radiance(-at.point.normal.dot(ray.direction));
        Some(Emitter { light: at.part.light, point: at.point, radiance })
    }

    /// Triangles without area, which were left out.
    pub fn dropped_triangles(&self) -> usize {
        self.dropped_triangles
    }

    /// The map from the file's world space to the one that hits are reported in.
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// The closest hit of a ray, with its orientation, in a world in which nothing [moves](Self::moves); in one that
    /// does, at the start of the motion.
    #[inline(always)]
    pub(crate) fn closest(&self, ray: &Ray) -> Option<Interaction<'_>> {
        self.closest_at(ray, 0.0)
    }

    /// The closest hit of a ray at a [`time`](Self::time).
    #[inline(always)]
    pub(crate) fn closest_at(&self, ray: &Ray, time: f32) -> Option<Interaction<'_>> {
        let hit = self.geometry.closest_at(ray, time)?;
        let Some(part) = self.parts.get(hit.shape as usize) else { return Some(self.placed(ray, hit, time)) };
        let mut point = self.geometry.surface_at(ray, &hit, time);
        point.normal *= part.flip;
        let mut shading_normal = point.normal;
        if !part.normals.is_empty()
            && let Shape::Mesh(mesh) = self.geometry.shape(hit.shape)
        {
            let [a, b, c] = mesh.triangles()[hit.primitive as usize].map(|v| part.normals[v as usize]);
            let [v, w] = hit.barycentrics;
            let normal = a * (1.0 - v - w) + b * v + c * w;
            // Shading normals decide on the side [Pharr et al. 2023, sec. 6.5.3].
            if normal.dot(point.normal) < 0.0 {
                point.normal = -point.normal;
            }
            shading_normal = normal;
        }
        Some(Interaction { part, hit, point, shading_normal, time })
    }

    /// The same in a world that is not [varied](Self::is_varied).
    #[inline(always)]
    pub(crate) fn closest_plain(&self, ray: &Ray) -> Option<Interaction<'_>> {
        let hit = self.geometry.closest(ray)?;
        let part = self.parts.get(hit.shape as usize)?;
        let mut point = self.geometry.surface(ray, &hit);
        point.normal *= part.flip;
        Some(Interaction { part, hit, point, shading_normal: point.normal, time: 0.0 })
    }

    /// Whether there is more than surfaces of one colour each that scatter as Lambert says, as flat as they are.
    pub(crate) fn is_varied(&self) -> bool {
        !self.object_parts.is_empty()
            || self.parts.iter().any(|part| !part.normals.is_empty())
            || !self.surfaces.iter().all(Surface::is_plain)
    }

    /// Whether light passes any surface.
    pub(crate) fn has_clear_surfaces(&self) -> bool {
        self.clear
    }

    /// Whether there is anything of what few scenes have: media, surfaces that rays may pass unscattered, mixes, motion.
    pub(crate) fn is_rare(&self) -> bool {
        self.unusual || self.moves || self.parts().any(|part| part.media.is_some()) || self.camera_medium != NO_MEDIUM
    }

    /// Whether what is in the way of a ray may let a part of it through.
    pub(crate) fn hides_partly(&self) -> bool {
        self.unusual
    }

    fn parts(&self) -> impl Iterator<Item = &Part> {
        self.parts.iter().chain(&self.object_parts)
    }

    /// Opacity at a hit, in `[0, 1]`.
    #[inline]
    #[expect(clippy::manual_clamp, reason = "what is no number counts as 0, which `clamp` would let through")]
    pub(crate) fn alpha(&self, at: &Interaction<'_>) -> f32 {
        at.part.alpha.map_or(1.0, |alpha| self.textures.look_up_scalar(alpha, self.uv(at)).max(0.0).min(1.0))
    }

    /// Whether anything is in the way of a ray at a [`time`](Self::time).
    #[inline(always)]
    pub(crate) fn occluded_at(&self, ray: &Ray, time: f32) -> bool {
        self.geometry.occluded_at(ray, time)
    }

    /// Texture coordinates of a hit.
    #[inline]
    pub(crate) fn uv(&self, at: &Interaction<'_>) -> [f32; 2] {
        let Shape::Mesh(mesh) = self.geometry.shape(at.hit.shape) else {
            return self.geometry.parametric_at(&at.hit, at.point.position, at.time);
        };
        let [v, w] = at.hit.barycentrics;
        if at.part.uvs.is_empty() {
            // pbrt-v4's default corners (0, 0), (1, 0), (1, 1).
            return [v + w, w];
        }
        let [a, b, c] = mesh.triangles()[at.hit.primitive as usize].map(|v| at.part.uvs[v as usize]);
        let u = 1.0 - v - w;
        [u * a[0] + v * b[0] + w * c[0], u * a[1] + v * b[1] + w * c[1]]
    }

    /// The scattering at a hit.
    #[inline(always)]
    pub(crate) fn bsdf<'s>(&self, at: &Interaction<'_>, surface: &'s Surface) -> Bsdf<'s> {
        let uv = if surface.textured { self.uv(at) } else { [0.0; 2] };
        surface.bsdf(&self.textures, uv)
    }

    /// The shading frame of a hit; its x axis follows u where the material asks for it.
    #[inline(always)]
    pub(crate) fn frame(&self, at: &Interaction<'_>, surface: &Surface) -> Frame {
        if surface.bumped {
            return self.frame_in_relief(at, surface);
        }
        let tangent = if surface.anisotropic { Some(self.derivatives(at)[0]) } else { None };
        if at.part.normals.is_empty() && tangent.is_none() {
            return Frame::from_normal(at.point.normal);
        }
        Frame::from_shading_normal(at.shading_normal, at.point.normal, tangent)
    }
}
