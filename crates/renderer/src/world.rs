//! A scene prepared for tracing rays.

mod build;
mod bump;
mod first_hit;
#[cfg(test)]
mod frame_tests;
mod instances;
mod shutter;
#[cfg(test)]
mod tests;

pub use build::WorldError;

use crate::blocks;
use crate::camera::CameraView;
use crate::light::{LightSelection, Lights};
use crate::material::{self, Surface};
use crate::medium::Media;
use crate::pixel_filter::FilterSampler;
use crate::shading::{Bsdf, ShadingFrame};
use crate::space::Space;
use crate::texture::Textures;
use dapple_core::Draws;
use dapple_geometry::{Geometry, Hit, Ray, Shape, SurfacePoint};
use dapple_scene::Effects;
use dapple_scene::{MediumInterface, Scalar, Scene};
use glam::Vec3;

/// A scene prepared for tracing rays: geometry in a tree, lights with their probabilities, materials with their tables,
/// and the camera.
///
/// An [`Integrator`](dapple_core::Integrator) is built from its queries: [camera rays](Self::camera_ray), the
/// [closest hit](Self::closest_hit), [occlusion](Self::occluded), [scattering](Self::bsdf), [emission](Self::emitted), and
/// [lights](Self::lights) to sample.
///
/// # Examples
///
/// An integrator of direct light: emission, and one light sampled at the first hit.
///
/// ```
/// use dapple_core::{Draws, Estimate, Frame, Integrator, Limits, Render, TrainingLog};
/// use dapple_core::samplers::Uniform;
/// use dapple_low_discrepancy::Sobol;
/// use dapple_renderer::{World, blocks};
/// use dapple_scene::bundled;
/// use glam::Vec3;
///
/// struct DirectLight<'w>(&'w World);
///
/// impl DirectLight<'_> {
///     fn radiance(&self, draws: &Draws<'_>) -> Vec3 {
///         let world = self.0;
///         let (ray, time) = world.camera_ray(draws);
///         let Some(at) = world.closest_hit(&ray, time) else {
///             return world.lights().environment(ray.direction);
///         };
///         let (wo, emitted) = (-ray.direction, world.emitted(&at, -ray.direction));
///         let (u, [choice, lobe, ..]) = (draws.block(blocks::scatter(0)), draws.block(blocks::choose(0)));
///         let Some(light) = world.lights().sample(at.point().position, choice, [u[0], u[1]]) else { return emitted };
///         if world.occluded(&light.shadow_ray(at.point()), time) {
///             return emitted;
///         }
///         let (bsdf, frame) = world.bsdf(&at, lobe);
///         let wi = frame.to_local(light.wi);
///         emitted + bsdf.evaluate(frame.to_local(wo), wi) * light.radiance * (wi.z.abs() / light.pdf)
///     }
/// }
///
/// impl Integrator for DirectLight<'_> {
///     fn estimate(&self, draws: &Draws<'_>, _: &mut TrainingLog) -> Estimate {
///         Estimate::new(self.radiance(draws).to_array()).with_cost(2)
///     }
/// }
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let scene = bundled::files("cornell").ok_or("no such scene")?.read()?;
/// let world = World::with_resolution(&scene, [16, 12])?;
/// let frame = Frame::new(16, 12)?;
/// let limits = Limits::samples(4 * frame.pixels() as u64);
/// let mut sampler = Uniform::new(Sobol::new(7));
/// let film = Render::new(frame, &limits).run(&mut DirectLight(&world), &mut sampler)?;
/// assert!((0..frame.pixels()).any(|pixel| film.mean(pixel)[1] > 0.0));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct World {
    pub(crate) effects: Effects,
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
    /// True if anything moves while the shutter is open: the camera, or something it sees.
    pub(crate) moves: bool,
    /// The media that fill space.
    pub(crate) media: Media,
    /// The medium around the camera.
    pub(crate) camera_medium: u32,
    has_transmission: bool,
    has_passable_surfaces: bool,
    /// The part of the motion during which the shutter is open, in `[0, 1]`.
    pub(crate) open: [f32; 2],
}

/// A point of a lamp, found by following a ray.
#[derive(Clone, Copy, Debug)]
pub struct Emitter {
    /// Number of the light, as [`Lights::pdf`] takes it.
    pub light: u32,
    /// The point. Its normal lies on the side that emits.
    pub point: SurfacePoint,
    /// Radiance towards the ray's origin; black on the dark side.
    pub radiance: Vec3,
}

/// The properties of one shape besides its geometry.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    pub(crate) material: u32,
    /// Number of its light; `NO_LIGHT` if it emits none.
    pub(crate) light: u32,
    /// 1, or -1 where the geometric normal is opposite to the tree's.
    pub(crate) flip: f32,
    /// Vertex normals, transformed and unit length, or none.
    pub(crate) normals: Vec<Vec3>,
    /// Texture coordinates, or none.
    pub(crate) uvs: Vec<[f32; 2]>,
    /// Opacity, where it is not 1 throughout.
    pub(crate) alpha: Option<Scalar>,
    /// The media on both sides: `outside` is the side of an [`Interaction`]'s normal.
    pub(crate) media: Option<MediumInterface>,
    /// True if rays may pass it unscattered, or its material is a mix, which may be an interface.
    pub(crate) passable: bool,
}

pub(crate) const NO_LIGHT: u32 = u32::MAX;
/// Empty space.
pub(crate) const NO_MEDIUM: u32 = u32::MAX;

/// A hit with its orientation, found by [`World::closest_hit`].
#[derive(Clone, Copy, Debug)]
pub struct Interaction<'w> {
    pub(crate) part: &'w Part,
    pub(crate) hit: Hit,
    /// The point. Its normal lies on the side that emits.
    pub(crate) point: SurfacePoint,
    /// Interpolated vertex normal, on the side of the geometric one; the geometric one without.
    pub(crate) shading_normal: Vec3,
    pub(crate) time: f32,
}

impl Interaction<'_> {
    /// The point, with its geometric normal. Lamps emit on the side of the normal.
    #[inline]
    pub fn point(&self) -> &SurfacePoint {
        &self.point
    }

    /// The interpolated vertex normal, on the side of the geometric one; the geometric one without vertex normals.
    #[inline]
    pub fn shading_normal(&self) -> Vec3 {
        self.shading_normal
    }

    /// The hit in the geometry's terms: shape, primitive and coordinates on it.
    #[inline]
    pub fn hit(&self) -> &Hit {
        &self.hit
    }

    /// The ray parameter of the hit: its distance, for a direction of unit length.
    #[inline]
    pub fn distance(&self) -> f32 {
        self.hit.t
    }

    /// The number of the light that the surface is, as [`Lights::pdf`] takes it. `None` if it emits nothing.
    #[inline]
    pub fn light(&self) -> Option<u32> {
        (self.part.light != NO_LIGHT).then_some(self.part.light)
    }

    /// The medium behind the hit, for a ray that leaves it along `direction` and came through `medium`.
    #[inline]
    pub(crate) fn medium_beyond(&self, direction: Vec3, medium: u32) -> u32 {
        match &self.part.media {
            None => medium,
            Some(media) => {
                let outside = self.point.normal.dot(direction) > 0.0;
                if outside { media.outside } else { media.inside }.map_or(NO_MEDIUM, |medium| medium.0)
            }
        }
    }
}

impl World {
    /// Builds a world from a scene, for images of the scene's resolution.
    ///
    /// # Errors
    ///
    /// Every problem found, each with the line of its object.
    pub fn new(scene: &Scene) -> Result<Self, WorldError> {
        build::build(scene, scene.film.resolution)
    }

    /// Builds a world for images of another resolution.
    ///
    /// # Errors
    ///
    /// As [`World::new`].
    pub fn with_resolution(scene: &Scene, resolution: [u32; 2]) -> Result<Self, WorldError> {
        build::build(scene, resolution)
    }

    /// Limits the scattering events between camera and light, in place of the scene's limit.
    pub fn set_max_depth(&mut self, max_depth: u32) {
        self.max_depth = max_depth;
    }

    /// Sets the distribution by which one of several lights is selected. Until then it is [`LightSelection::Power`].
    pub fn set_light_selection(&mut self, selection: LightSelection) {
        self.lights.set_selection(selection);
    }

    /// The effects of the scene that the world was built from.
    pub fn effects(&self) -> &Effects {
        &self.effects
    }

    /// The most scattering events between camera and light.
    pub fn max_depth(&self) -> u32 {
        self.max_depth
    }

    /// The geometry.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The lights: [`Lights::sample`] for next-event estimation, [`Lights::environment`] for rays that leave the scene.
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// The camera.
    pub fn camera(&self) -> &CameraView {
        &self.camera
    }

    /// Triangles without area, which were left out.
    pub fn dropped_triangles(&self) -> usize {
        self.dropped_triangles
    }

    /// The map from the file's world space to the space of hits.
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// The camera ray of one sample, and its time within the motion.
    ///
    /// Draws the position in the pixel by the pixel filter, the position on the lens, and the time:
    /// [`blocks::CAMERA`] and, where something moves, [`blocks::TIME`].
    pub fn camera_ray(&self, draws: &Draws<'_>) -> (Ray, f32) {
        let u = draws.block(blocks::CAMERA);
        let offset = self.filter.sample([u[0], u[1]]);
        let time = if self.moves { self.time(draws.block(blocks::TIME)[0]) } else { 0.0 };
        let place = self.camera.place(draws.pixel(), offset);
        (self.camera.ray_at(place, [u[2], u[3]], time), time)
    }

    /// The closest hit of a ray, with its orientation, at a time of a [camera ray](Self::camera_ray): 0 where nothing moves.
    ///
    /// Surfaces with holes (alpha) and interfaces between media are hit, too: passing them is left to the integrator.
    #[inline(always)]
    pub fn closest_hit(&self, ray: &Ray, time: f32) -> Option<Interaction<'_>> {
        let hit = self.geometry.closest_at(ray, time)?;
        let Some(part) = self.parts.get(hit.shape as usize) else {
            return Some(self.instance_interaction(ray, hit, time));
        };
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

    /// [`Self::closest_hit`] in a world without [varied surfaces](Self::has_varied_surfaces).
    #[inline(always)]
    pub(crate) fn closest_hit_plain(&self, ray: &Ray) -> Option<Interaction<'_>> {
        let hit = self.geometry.closest(ray)?;
        let part = self.parts.get(hit.shape as usize)?;
        let mut point = self.geometry.surface(ray, &hit);
        point.normal *= part.flip;
        Some(Interaction { part, hit, point, shading_normal: point.normal, time: 0.0 })
    }

    /// Tells whether anything is in the way of a ray, up to its `tmax`, at a time of a [camera ray](Self::camera_ray).
    ///
    /// [`LightSample::shadow_ray`](crate::light::LightSample::shadow_ray) makes the ray to a light.
    #[inline(always)]
    pub fn occluded(&self, ray: &Ray, time: f32) -> bool {
        self.geometry.occluded_at(ray, time)
    }

    /// The radiance that a surface emits towards the unit direction `wo`; black on its dark side.
    #[inline]
    pub fn emitted(&self, at: &Interaction<'_>, wo: Vec3) -> Vec3 {
        let lamp = self.lights.lamp(at.part.light);
        lamp.map_or(Vec3::ZERO, |lamp| lamp.radiance(at.point.normal.dot(wo)))
    }

    /// The lamp at the closest hit of a ray. `None` where the ray hits nothing, or something that emits nothing.
    pub fn emitter(&self, ray: &Ray) -> Option<Emitter> {
        let at = self.closest_hit(ray, 0.0)?;
        at.light().map(|light| Emitter { light, point: at.point, radiance: self.emitted(&at, -ray.direction) })
    }

    /// The scattering at a hit, and the frame that its directions are given in.
    ///
    /// `u` in `[0, 1)` selects a material where several are mixed. An interface between media scatters nothing.
    pub fn bsdf(&self, at: &Interaction<'_>, u: f32) -> (Bsdf<'_>, ShadingFrame) {
        let surface = self.surface(at, u);
        (self.bsdf_of(at, surface), self.frame_of(at, surface))
    }

    /// The surface at a hit; `u` in `[0, 1)` selects one where several are mixed.
    fn surface(&self, at: &Interaction<'_>, u: f32) -> &Surface {
        let surface = &self.surfaces[at.part.material as usize];
        if !surface.mixes {
            return surface;
        }
        material::resolve(&self.surfaces, at.part.material, &self.textures, self.uv(at), u).0
    }

    /// Tells whether there is more than flat diffuse surfaces of one color each: other materials, vertex normals, instances.
    pub(crate) fn has_varied_surfaces(&self) -> bool {
        !self.object_parts.is_empty()
            || self.parts.iter().any(|part| !part.normals.is_empty())
            || !self.surfaces.iter().all(Surface::is_plain)
    }

    /// Tells whether light passes through any surface.
    pub(crate) fn has_transmission(&self) -> bool {
        self.has_transmission
    }

    /// Tells whether any surface is [passable](Part::passable).
    pub(crate) fn has_passable_surfaces(&self) -> bool {
        self.has_passable_surfaces
    }

    /// Opacity at a hit, in `[0, 1]`.
    #[inline]
    #[expect(clippy::manual_clamp, reason = "NaN counts as 0, which `clamp` would let through")]
    pub(crate) fn alpha(&self, at: &Interaction<'_>) -> f32 {
        at.part.alpha.map_or(1.0, |alpha| self.textures.look_up_scalar(alpha, self.uv(at)).max(0.0).min(1.0))
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

    /// The scattering of a surface at a hit.
    #[inline(always)]
    pub(crate) fn bsdf_of<'s>(&self, at: &Interaction<'_>, surface: &'s Surface) -> Bsdf<'s> {
        let uv = if surface.textured { self.uv(at) } else { [0.0; 2] };
        surface.bsdf(&self.textures, uv)
    }

    /// The shading frame of a hit. Its x axis follows u where the material is anisotropic.
    #[inline(always)]
    pub(crate) fn frame_of(&self, at: &Interaction<'_>, surface: &Surface) -> ShadingFrame {
        if surface.bumped {
            return self.bumped_frame(at, surface);
        }
        let tangent = if surface.anisotropic { Some(self.derivatives(at)[0]) } else { None };
        if at.part.normals.is_empty() && tangent.is_none() {
            return ShadingFrame::from_normal(at.point.normal);
        }
        ShadingFrame::from_shading_normal(at.shading_normal, at.point.normal, tangent)
    }
}
