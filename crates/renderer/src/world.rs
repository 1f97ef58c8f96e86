//! A scene prepared for ray tracing.

mod build;
mod bump;
mod first_hit;
mod instances;
mod segment;
#[cfg(test)]
mod tests;

pub use build::{SceneError, WorldError};
pub use first_hit::{BlockDimensions, SampleDimensions};
pub(crate) use segment::{MOST_PASSED, PassedThrough};

use crate::blocks;
use crate::camera::CameraView;
use crate::light::{LightSelection, Lights};
use crate::material::{self, Surface};
use crate::medium::Media;
use crate::pixel_filter::FilterSampler;
use crate::shading::{Bsdf, ShadingFrame};
use crate::space::Space;
use crate::texture::{TexturePoint, Textures};
use dapple_core::Draws;
use dapple_geometry::{Geometry, Hit, Ray, Shape, SurfacePoint};
use dapple_scene::Effects;
use dapple_scene::{MediumInterface, Scalar};
use glam::{Vec2, Vec3};

/// A scene prepared for ray tracing: geometry with a bounding volume hierarchy, lights with selection probabilities,
/// materials with tables, and the camera.
///
/// The functions that an [`Integrator`](dapple_core::Integrator) needs are [camera rays](Self::camera_ray), the
/// [closest hit](Self::closest_hit), [occlusion](Self::occluded), [scattering](Self::bsdf), [emission](Self::emitted)
/// and the [lights](Self::lights) to sample.
///
/// # Examples
///
/// An integrator of direct light adds the emission at the first hit and the light from one sampled light.
///
/// ```
/// use dapple_core::{Draws, Estimate, Frame, Integrator, Limits, Render, Worker};
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
///     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
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
    /// The properties of the base shapes, which belong to no object.
    pub(crate) parts: Vec<Part>,
    /// The properties of the shapes of all objects, object by object.
    pub(crate) object_parts: Vec<Part>,
    pub(crate) surfaces: Vec<Surface>,
    pub(crate) textures: Textures,
    pub(crate) lights: Lights,
    pub(crate) camera: CameraView,
    pub(crate) filter: FilterSampler,
    pub(crate) max_depth: u32,
    pub(crate) space: Space,
    pub(crate) dropped_triangles: usize,
    /// True if the camera or a shape moves while the shutter is open.
    pub(crate) moves: bool,
    /// The media of the scene, in the renderer's units of length.
    pub(crate) media: Media,
    /// The index of the medium around the camera, or `NO_MEDIUM`.
    pub(crate) camera_medium: u32,
    /// True if a surface transmits light, by refraction or diffusely.
    pub(crate) has_transmission: bool,
    /// True if a surface may let rays pass without scattering; see [`Part::passable`].
    pub(crate) has_passable_surfaces: bool,
    /// The opening and closing time of the shutter within the motion, in `[0, 1]`.
    pub(crate) open: [f32; 2],
}

/// The point at which a ray hits an area light.
#[derive(Clone, Copy, Debug)]
pub struct Emitter {
    /// The index of the light, for [`Lights::pdf`].
    pub light: u32,
    /// The point hit, with its normal on the emitting side.
    pub point: SurfacePoint,
    /// The linear RGB radiance towards the ray's origin; black on a side that does not emit.
    pub radiance: Vec3,
}

/// The properties of a shape besides its geometry.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    pub(crate) material: u32,
    /// The index of the shape's light; `NO_LIGHT` if the shape emits nothing.
    pub(crate) light: u32,
    /// -1 if the shape's normal is opposite to the geometry's normal, else 1.
    pub(crate) flip: f32,
    /// The unit vertex normals, in world space or in the space of the shape's object; empty if there are none.
    pub(crate) normals: Vec<Vec3>,
    /// The texture coordinates, one pair per vertex; empty if there are none.
    pub(crate) uvs: Vec<[f32; 2]>,
    /// The vertex colours; empty if there are none.
    pub(crate) colors: Vec<[f32; 3]>,
    /// The opacity; `None` if it is 1 everywhere.
    pub(crate) alpha: Option<Scalar>,
    /// The media on the two sides; `None` if the shape does not separate media. `outside` is the side of an [`Interaction`]'s
    /// normal.
    pub(crate) media: Option<MediumInterface>,
    /// True if rays may pass the shape without scattering: it has an opacity, an interface or unlit material, or a mix (which
    /// may include an interface).
    pub(crate) passable: bool,
}

pub(crate) const NO_LIGHT: u32 = u32::MAX;
/// The medium index for vacuum.
pub(crate) const NO_MEDIUM: u32 = u32::MAX;

/// A hit with its surface properties and oriented normals, returned by [`World::closest_hit`].
#[derive(Clone, Copy, Debug)]
pub struct Interaction<'w> {
    pub(crate) part: &'w Part,
    pub(crate) hit: Hit,
    /// The hit point. Its geometric normal is on the emitting side.
    pub(crate) point: SurfacePoint,
    /// The interpolated vertex normal, on the side of the geometric normal. Without vertex normals, it is the
    /// geometric normal.
    pub(crate) shading_normal: Vec3,
    pub(crate) time: f32,
}

impl Interaction<'_> {
    /// Returns the hit point. Its geometric normal points to the side on which the shape would emit; see
    /// [`dapple_scene::Shape`].
    #[inline]
    pub fn point(&self) -> &SurfacePoint {
        &self.point
    }

    /// Returns the interpolated vertex normal, on the side of the geometric normal. Without vertex normals, returns
    /// the geometric normal.
    #[inline]
    pub fn shading_normal(&self) -> Vec3 {
        self.shading_normal
    }

    /// Returns the hit as reported by the geometry: ray parameter, shape index, triangle index and barycentric weights.
    #[inline]
    pub fn hit(&self) -> &Hit {
        &self.hit
    }

    /// Returns the ray parameter of the hit, which is its distance if the ray's direction has unit length.
    #[inline]
    pub fn distance(&self) -> f32 {
        self.hit.t
    }

    /// Returns the time of the hit: 0 at the start of the scene's motion, 1 at its end.
    #[inline]
    pub fn time(&self) -> f32 {
        self.time
    }

    /// Returns the index of the surface's light, for [`Lights::pdf`]; `None` if the surface emits nothing.
    #[inline]
    pub fn light(&self) -> Option<u32> {
        (self.part.light != NO_LIGHT).then_some(self.part.light)
    }

    /// Returns the index of the medium that a ray enters if it leaves the hit along `direction`. `medium` is the
    /// medium through which it arrived.
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
    /// Sets the largest number of scattering events on a path from the camera to a light. It replaces the scene's value.
    pub fn set_max_depth(&mut self, max_depth: u32) {
        self.max_depth = max_depth;
    }

    /// Sets the distribution by which lights are selected. The default is [`LightSelection::Power`].
    pub fn set_light_selection(&mut self, selection: LightSelection) {
        self.lights.set_selection(selection);
    }

    /// Returns the rendering effects that the scene contains, such as environments or motion blur.
    pub fn effects(&self) -> &Effects {
        &self.effects
    }

    /// Returns the largest number of scattering events on a path from the camera to a light; `u32::MAX` for no limit.
    pub fn max_depth(&self) -> u32 {
        self.max_depth
    }

    /// Returns the geometry, in the renderer's space (see [`space`](Self::space)).
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Returns the lights. Use [`Lights::sample`] for next-event estimation, and [`Lights::environment`] for rays that leave
    /// the scene.
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// Returns the camera, prepared for the resolution of the images.
    pub fn camera(&self) -> &CameraView {
        &self.camera
    }

    /// Returns the number of triangles without area, which no ray can hit.
    pub fn dropped_triangles(&self) -> usize {
        self.dropped_triangles
    }

    /// Returns the map from the scene file's world space to the renderer's space, in which hits are reported.
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// Returns the camera ray of a sample and its time: 0 at the start of the scene's motion, 1 at its end.
    ///
    /// [`blocks::CAMERA`] samples the pixel filter and the lens. In scenes with motion, [`blocks::TIME`] samples the time.
    pub fn camera_ray(&self, draws: &Draws<'_>) -> (Ray, f32) {
        let u = draws.block(blocks::CAMERA);
        let offset = self.filter.sample([u[0], u[1]]);
        let time = if self.moves { self.time(draws.block(blocks::TIME)[0]) } else { 0.0 };
        let place = self.camera.place(draws.pixel(), offset);
        (self.camera.ray_at(place, [u[2], u[3]], time), time)
    }

    /// Returns true if light at a position of the image contributes to any pixel. The position is in pixels from the top left
    /// corner.
    pub fn is_in_image(&self, place: Vec2) -> bool {
        let (radius, size) = (self.filter.radius() - 0.5, self.camera.resolution());
        place.cmpge(-radius).all() && place.cmple(size + radius).all()
    }

    /// Calls `add` with the column, row and weight of each pixel to which light at a position of the image contributes. The
    /// position is in pixels from the top left corner.
    ///
    /// The weight is the pixel filter's density per square pixel. Splats with a density of one position per square pixel give
    /// the same expected image as one [`camera_ray`](Self::camera_ray) per pixel.
    pub fn splat_at(&self, place: Vec2, mut add: impl FnMut([u32; 2], f32)) {
        let (radius, size) = (self.filter.radius(), self.camera.resolution());
        let first = (place - radius - 0.5).ceil().max(Vec2::ZERO);
        let last = (place + radius - 0.5).floor().min(size - 1.0);
        if !(first.x <= last.x && first.y <= last.y) {
            return;
        }
        for row in first.y as u32..=last.y as u32 {
            for column in first.x as u32..=last.x as u32 {
                let weight = self.filter.density(place - Vec2::new(column as f32, row as f32) - 0.5);
                if weight > 0.0 {
                    add([column, row], weight);
                }
            }
        }
    }

    /// Returns the closest hit of a ray; `None` if it hits nothing. `time` is the time returned by
    /// [`camera_ray`](Self::camera_ray), which is 0 without motion.
    ///
    /// Surfaces with holes (alpha) and interfaces between media count as hits. The integrator must continue rays that
    /// pass them.
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
            // Shading normals determine the side [Pharr et al. 2023, sec. 6.5.3].
            if normal.dot(point.normal) < 0.0 {
                point.normal = -point.normal;
            }
            shading_normal = normal;
        }
        Some(Interaction { part, hit, point, shading_normal, time })
    }

    /// Returns the closest hit as [`Self::closest_hit`] does, in a world without [varied
    /// surfaces](Self::has_varied_surfaces) and without motion.
    #[inline(always)]
    pub(crate) fn closest_hit_plain(&self, ray: &Ray) -> Option<Interaction<'_>> {
        let hit = self.geometry.closest(ray)?;
        let part = self.parts.get(hit.shape as usize)?;
        let mut point = self.geometry.surface(ray, &hit);
        point.normal *= part.flip;
        Some(Interaction { part, hit, point, shading_normal: point.normal, time: 0.0 })
    }

    /// Returns true if any surface blocks the ray before its `tmax`. `time` is the time returned by
    /// [`camera_ray`](Self::camera_ray).
    ///
    /// [`LightSample::shadow_ray`](crate::light::LightSample::shadow_ray) returns the ray to a sampled light.
    #[inline(always)]
    pub fn occluded(&self, ray: &Ray, time: f32) -> bool {
        self.geometry.occluded_at(ray, time)
    }

    /// Returns the radiance that a surface emits towards the unit direction `wo`; black on a side that does not emit.
    #[inline]
    pub fn emitted(&self, at: &Interaction<'_>, wo: Vec3) -> Vec3 {
        self.lights.emitted(at.part.light, &at.point, at.point.normal.dot(wo))
    }

    /// Returns the area light at the closest hit of a ray at time 0. Returns `None` if the ray hits nothing or a
    /// surface that emits nothing.
    pub fn emitter(&self, ray: &Ray) -> Option<Emitter> {
        let at = self.closest_hit(ray, 0.0)?;
        at.light().map(|light| Emitter { light, point: at.point, radiance: self.emitted(&at, -ray.direction) })
    }

    /// Returns the BSDF at a hit, and the shading frame in which its directions are given.
    ///
    /// `u` in `[0, 1)` selects one material if the surface is a mix. An interface between media scatters nothing.
    pub fn bsdf(&self, at: &Interaction<'_>, u: f32) -> (Bsdf<'_>, ShadingFrame) {
        let surface = self.surface(at, u);
        (self.bsdf_of(at, surface), self.frame_of(at, surface))
    }

    /// Returns the material at a hit. `u` in `[0, 1)` selects one material if the surface is a mix.
    fn surface(&self, at: &Interaction<'_>, u: f32) -> &Surface {
        let surface = &self.surfaces[at.part.material as usize];
        if !surface.mixes {
            return surface;
        }
        material::resolve(&self.surfaces, at.part.material, &self.textures, self.texture_point(at), u).0
    }

    /// Returns true if the scene has vertex normals, instances, or a material other than diffuse reflection of constant color.
    pub(crate) fn has_varied_surfaces(&self) -> bool {
        !self.object_parts.is_empty()
            || self.parts.iter().any(|part| !part.normals.is_empty())
            || !self.surfaces.iter().all(Surface::is_plain)
    }

    /// Returns true if any material of the scene is an interface between media, which rays pass without scattering.
    pub fn has_interfaces(&self) -> bool {
        self.surfaces.iter().any(|surface| surface.interface)
    }

    /// Returns true if any material of the scene is unlit: visible only to the camera, with its colour as radiance.
    pub fn has_unlit_surfaces(&self) -> bool {
        self.surfaces.iter().any(|surface| surface.unlit)
    }

    /// Returns the opacity at a hit, in `[0, 1]`. NaN counts as 0.
    #[inline]
    #[expect(clippy::manual_clamp, reason = "NaN counts as 0, which `clamp` would let through")]
    pub(crate) fn alpha(&self, at: &Interaction<'_>) -> f32 {
        at.part.alpha.map_or(1.0, |alpha| self.textures.look_up_scalar(alpha, self.texture_point(at)).max(0.0).min(1.0))
    }

    /// Returns the texture coordinates `(u, v)` of a hit.
    #[inline]
    pub(crate) fn uv(&self, at: &Interaction<'_>) -> [f32; 2] {
        let Shape::Mesh(mesh) = self.geometry.shape(at.hit.shape) else {
            return self.geometry.parametric_at(&at.hit, at.point.position, at.time);
        };
        let [v, w] = at.hit.barycentrics;
        if at.part.uvs.is_empty() {
            // pbrt-v4's default texture coordinates of the corners: (0, 0), (1, 0), (1, 1).
            return [v + w, w];
        }
        let [a, b, c] = mesh.triangles()[at.hit.primitive as usize].map(|v| at.part.uvs[v as usize]);
        let u = 1.0 - v - w;
        [u * a[0] + v * b[0] + w * c[0], u * a[1] + v * b[1] + w * c[1]]
    }

    /// Returns the texture coordinates and the vertex colour of a hit.
    #[inline]
    pub(crate) fn texture_point(&self, at: &Interaction<'_>) -> TexturePoint {
        let point = TexturePoint::from(self.uv(at));
        if at.part.colors.is_empty() { point } else { self.colored(point, at) }
    }

    #[inline(never)]
    fn colored(&self, point: TexturePoint, at: &Interaction<'_>) -> TexturePoint {
        let Shape::Mesh(mesh) = self.geometry.shape(at.hit.shape) else { return point };
        let [a, b, c] =
            mesh.triangles()[at.hit.primitive as usize].map(|v| Vec3::from_array(at.part.colors[v as usize]));
        let [v, w] = at.hit.barycentrics;
        TexturePoint { color: a * (1.0 - v - w) + b * v + c * w, ..point }
    }

    /// Returns the BSDF of the material `surface` at a hit.
    #[inline(always)]
    pub(crate) fn bsdf_of<'s>(&self, at: &Interaction<'_>, surface: &'s Surface) -> Bsdf<'s> {
        let point = if surface.textured { self.texture_point(at) } else { [0.0; 2].into() };
        surface.bsdf(&self.textures, point)
    }

    /// Returns the shading frame of a hit. For anisotropic materials, its x axis follows the direction of increasing
    /// u.
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
