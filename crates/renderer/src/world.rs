//! A scene made ready for rays.

mod build;

pub use build::WorldError;

use crate::camera::CameraView;
use crate::light::{LightChoice, Lights};
use crate::material::Surface;
use crate::pixel_filter::FilterSampler;
use crate::scene::Scene;
use crate::shading::Frame;
use crate::space::Space;
use crate::texture::Textures;
use dapple_geometry::{Geometry, Hit, Ray, Shape, SurfacePoint};
use glam::Vec3;

/// Everything that rays need, built from a [`Scene`]: geometry in a tree, lights with their
/// probabilities, materials with their tables, the camera.
#[derive(Clone, Debug)]
pub struct World {
    pub(crate) geometry: Geometry,
    pub(crate) parts: Vec<Part>,
    pub(crate) surfaces: Vec<Surface>,
    pub(crate) textures: Textures,
    pub(crate) lights: Lights,
    pub(crate) camera: CameraView,
    pub(crate) filter: FilterSampler,
    pub(crate) max_depth: u32,
    pub(crate) space: Space,
    pub(crate) dropped_triangles: usize,
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
}

pub(crate) const NO_LIGHT: u32 = u32::MAX;

/// A hit with its orientation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Interaction<'w> {
    pub(crate) part: &'w Part,
    pub(crate) hit: Hit,
    /// The point; its normal turned to the side that shines.
    pub(crate) point: SurfacePoint,
    /// Interpolated vertex normal, on the side of the geometric one; the geometric one without.
    pub(crate) shading_normal: Vec3,
}

impl World {
    /// Builds a world from a scene, for pictures of the scene's resolution.
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

    /// The closest hit of a ray, with its orientation.
    #[inline(always)]
    pub(crate) fn closest(&self, ray: &Ray) -> Option<Interaction<'_>> {
        let hit = self.geometry.closest(ray)?;
        let mut point = self.geometry.surface(ray, &hit);
        let part = &self.parts[hit.shape as usize];
        point.normal *= part.flip;
        let mut shading_normal = point.normal;
        if !part.normals.is_empty()
            && let Shape::Mesh(mesh) = &self.geometry.shapes()[hit.shape as usize]
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
        Some(Interaction { part, hit, point, shading_normal })
    }

    /// Texture coordinates of a hit.
    #[inline]
    pub(crate) fn uv(&self, at: &Interaction<'_>) -> [f32; 2] {
        let Shape::Mesh(mesh) = &self.geometry.shapes()[at.hit.shape as usize] else {
            return self.geometry.parametric(&at.hit, at.point.position);
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

    /// The shading frame of a hit; its x axis follows u where the material asks for it.
    #[inline(always)]
    pub(crate) fn frame(&self, at: &Interaction<'_>, surface: &Surface) -> Frame {
        let tangent = if surface.anisotropic { Some(self.tangent(at)) } else { None };
        if at.part.normals.is_empty() && tangent.is_none() {
            return Frame::from_normal(at.point.normal);
        }
        Frame::from_shading_normal(at.shading_normal, at.point.normal, tangent)
    }

    /// The direction in which u grows. Spheres and disks: around their axis is not followed, only a
    /// mesh's texture coordinates are; others get a tangent of their own.
    fn tangent(&self, at: &Interaction<'_>) -> Vec3 {
        let Shape::Mesh(mesh) = &self.geometry.shapes()[at.hit.shape as usize] else { return Vec3::ZERO };
        let [p0, p1, p2] = mesh.corners(at.hit.primitive);
        let [t0, t1, t2] = match at.part.uvs.is_empty() {
            true => [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]],
            false => mesh.triangles()[at.hit.primitive as usize].map(|v| at.part.uvs[v as usize]),
        };
        let (du1, dv1, du2, dv2) = (t1[0] - t0[0], t1[1] - t0[1], t2[0] - t0[0], t2[1] - t0[1]);
        let determinant = du1 * dv2 - dv1 * du2;
        if determinant == 0.0 {
            return Vec3::ZERO;
        }
        ((p1 - p0) * dv2 - (p2 - p0) * dv1) / determinant
    }
}
