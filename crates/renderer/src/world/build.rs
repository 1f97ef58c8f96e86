//! Preparation of a world from a scene.

use super::instances::{Placements, Shutter, empty_mesh};
use super::{NO_LIGHT, NO_MEDIUM, Part, World};
use crate::camera::CameraView;
use crate::light::{
    DiskLight, Lamp, Light, Lights, MeshLight, SceneSphere, SphereLight, TexturedEmission, TexturedLight,
};
use crate::material::{Surface, check_mixes};
use crate::medium::Media;
use crate::pixel_filter::FilterSampler;
use crate::space::{Space, even_scale};
use crate::texture::Textures;
use dapple_geometry::{Disk, Geometry, Mesh, Shape, Sphere};
use dapple_scene::Effects;
use dapple_scene::{Emission, Geometry as Described, MeshData, Scene, Shape as DescribedShape, Source};
use glam::{DAffine3, DVec3, Vec3};
use std::cell::LazyCell;
use std::sync::Arc;

/// The reason why a camera, a light or a medium of a scene was rejected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{at}: {what}")]
pub struct SceneError {
    /// The line of the scene file that defines the object.
    pub at: Source,
    /// The problem and its remedy.
    pub what: String,
}

impl SceneError {
    pub(crate) fn new(at: &Source, what: impl Into<String>) -> Self {
        Self { at: at.clone(), what: what.into() }
    }
}

/// The reasons why a scene cannot be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{}", problems.join("\n"))]
pub struct WorldError {
    /// The problems, one sentence each, starting with the line of the object in the scene file.
    pub problems: Vec<String>,
}

/// A list of problems. All problems of a scene are reported together.
#[derive(Default)]
pub(super) struct Problems(Vec<String>);

impl Problems {
    pub(super) fn add(&mut self, at: &Source, what: String) {
        self.0.push(format!("{at}: {what}"));
    }

    fn note<T>(&mut self, result: Result<T, impl ToString>) -> Option<T> {
        result.map_err(|e| self.0.push(e.to_string())).ok()
    }

    pub(super) fn note_at<T>(&mut self, at: &Source, result: Result<T, impl ToString>) -> Option<T> {
        self.note(result.map_err(|e| format!("{at}: {}", e.to_string())))
    }
}

impl World {
    /// Prepares a scene for images of the scene's own resolution.
    ///
    /// # Errors
    ///
    /// [`WorldError`] with all problems found, each with the line of its object.
    pub fn new(scene: &Scene) -> Result<Self, WorldError> {
        Self::with_resolution(scene, scene.film.resolution)
    }

    /// Prepares a scene for images of another resolution (width and height in pixels).
    ///
    /// # Errors
    ///
    /// The errors of [`World::new`].
    pub fn with_resolution(scene: &Scene, resolution: [u32; 2]) -> Result<Self, WorldError> {
        let mut problems = Problems::default();
        let space = Space::of(scene);
        let shutter = problems.note(Shutter::of(scene)).unwrap_or(Shutter { open: [0.0; 2] });
        let camera = problems.note(CameraView::new(&scene.camera, resolution, &space));
        let camera = camera.map(|view| view.while_open(shutter.open));
        let surfaces = scene.materials.iter().filter_map(|material| problems.note(Surface::new(material)));
        let surfaces: Vec<Surface> = surfaces.collect();
        problems.0.extend(check_mixes(&scene.materials).iter().map(ToString::to_string));
        let mut shapes = Vec::with_capacity(scene.shapes.len());
        let mut parts = Vec::with_capacity(scene.shapes.len());
        let mut placements = Placements::of(scene, &space, &shutter, &mut problems);
        for shape in &scene.shapes {
            problems.check_material(scene, shape);
            if shape.moves_to.is_some_and(|end| end != shape.to_world) {
                placements.add_moving(shape, &mut problems);
                shapes.extend(empty_mesh());
                parts.push(part(shape));
            } else if let Some((geometry, part)) = problems.note_at(&shape.source, convert(shape, &space)) {
                shapes.push(geometry);
                parts.push(part);
            }
        }
        let media = Media::new(&scene.media, space.scale()).unwrap_or_else(|errors| {
            problems.0.extend(errors.iter().map(ToString::to_string));
            Media::default()
        });
        problems.check_media(scene);
        let without_shape =
            scene.lights.iter().filter_map(|light| problems.note(Light::of(light, &space)).flatten()).collect();
        if !problems.0.is_empty() {
            return Err(WorldError { problems: problems.0 });
        }
        let dropped =
            shapes.iter().map(|s| if let Shape::Mesh(mesh) = s { mesh.degenerate() } else { 0 }).sum::<usize>();
        let dropped_triangles = dropped + placements.dropped_triangles;
        let mut object_parts = std::mem::take(&mut placements.parts);
        let moves = placements.moves;
        let geometry = problems.note(placements.build(shapes));
        let (Some(camera), Some(geometry)) = (camera, geometry) else {
            return Err(WorldError { problems: problems.0 });
        };
        let textures = Textures::new(&scene.textures);
        let lights = lights(scene, (&space, &geometry, &textures), &mut parts, without_shape, &mut problems);
        if !problems.0.is_empty() {
            return Err(WorldError { problems: problems.0 });
        }
        let moves = moves || camera.moves();
        let [has_transmission, has_passable_surfaces] = mark_passable(&mut parts, &mut object_parts, &surfaces);
        Ok(Self {
            effects: Effects::of(scene),
            geometry,
            parts,
            object_parts,
            surfaces,
            textures,
            lights,
            camera,
            filter: FilterSampler::new(&scene.film.pixel_filter),
            max_depth: scene.max_depth.unwrap_or(u32::MAX),
            space,
            dropped_triangles,
            moves,
            media,
            camera_medium: scene.camera.medium.map_or(NO_MEDIUM, |medium| medium.0),
            has_transmission,
            has_passable_surfaces,
            open: shutter.open,
        })
    }
}

/// Marks the parts that rays may pass without scattering. Returns two flags: true if a surface transmits light, and true if
/// rays may pass a part.
fn mark_passable(parts: &mut [Part], object_parts: &mut [Part], surfaces: &[Surface]) -> [bool; 2] {
    let (mut has_transmission, mut has_passable_surfaces) = (false, false);
    for part in parts.iter_mut().chain(object_parts) {
        let surface = &surfaces[part.material as usize];
        part.passable = part.alpha.is_some() || surface.mixes || surface.interface || surface.unlit;
        has_transmission |= surface.transmits;
        has_passable_surfaces |= part.passable;
    }
    // The materials of a mix belong to no part, so all materials are checked.
    has_transmission |= has_passable_surfaces && surfaces.iter().any(|surface| surface.transmits);
    [has_transmission, has_passable_surfaces]
}

/// Returns a shape's properties besides its geometry, without vertex normals and texture coordinates.
fn part(shape: &DescribedShape) -> Part {
    Part {
        material: shape.material.0,
        light: NO_LIGHT,
        flip: if shape.reversed { -1.0 } else { 1.0 },
        normals: Vec::new(),
        uvs: Vec::new(),
        colors: Vec::new(),
        alpha: shape.alpha,
        media: shape.media,
        passable: false,
    }
}

/// Returns a shape's geometry in the renderer's space and its other properties. Returns a message if the geometry is invalid.
pub(super) fn convert(shape: &DescribedShape, space: &Space) -> Result<(Shape, Part), String> {
    let to_world = space.apply(shape.to_world);
    let mirrors = shape.to_world.matrix3.determinant() < 0.0;
    let mut part = part(shape);
    let reversed = part.flip;
    let geometry = match &shape.geometry {
        Described::Mesh(mesh) => {
            // The geometry's normal follows the winding in world space, which a mirroring transform reverses.
            part.flip = if mirrors { -reversed } else { reversed };
            part.normals = world_normals(mesh, shape.to_world, reversed);
            part.uvs.clone_from(&mesh.uvs);
            part.colors.clone_from(&mesh.colors);
            let moved = |p: &DVec3| space.point(shape.to_world.transform_point3(*p)).as_vec3().to_array();
            let positions = mesh.positions.iter().map(moved).collect();
            Mesh::new(positions, mesh.triangles.clone()).map(Shape::from)
        }
        Described::Sphere { radius } => Sphere::transformed(to_world, *radius).map(Shape::from),
        Described::Disk { height, radius, inner_radius } => {
            Disk::transformed(to_world, *height, *radius, *inner_radius).map(Shape::from)
        }
    };
    Ok((geometry.map_err(|e| e.to_string())?, part))
}

/// Returns the mesh's unit vertex normals in world space, multiplied by `sign`. Normals of length 0 stay zero.
fn world_normals(mesh: &MeshData, to_world: DAffine3, sign: f32) -> Vec<Vec3> {
    let turn = to_world.matrix3.inverse().transpose();
    let unit = |n: &[f32; 3]| (turn * Vec3::from_array(*n).as_dvec3()).normalize_or_zero().as_vec3() * sign;
    mesh.normals.iter().map(unit).collect()
}

fn lights(
    scene: &Scene,
    (space, geometry, textures): (&Space, &Geometry, &Textures),
    parts: &mut [Part],
    without_shape: Vec<Light>,
    problems: &mut Problems,
) -> Lights {
    let mut lights = Vec::new();
    let shared = LazyCell::new(|| Arc::new(textures.clone()));
    for (number, shape) in scene.shapes.iter().enumerate() {
        let Some(emission) = shape.emission else { continue };
        let lamp = lamp(emission);
        let Some(Some(lamp)) = problems.note_at(&shape.source, lamp) else { continue };
        let light = match emission.texture {
            None => light(shape, number as u32, lamp, space, geometry, &parts[number]),
            Some(texture) => {
                let emission = TexturedEmission { lamp, texture, textures: LazyCell::force(&shared).clone() };
                textured_light(&shape.geometry, (geometry, number as u32), emission, &parts[number])
            }
        };
        if let Some(Some(light)) = problems.note_at(&shape.source, light) {
            parts[number].light = lights.len() as u32;
            lights.push(light);
        }
    }
    lights.extend(without_shape);
    let [low, high] = geometry.bounds().unwrap_or([Vec3::ZERO; 2]);
    let radius = if geometry.bounds().is_some() { (high - low).length() * 0.5 } else { 1.0 };
    Lights::new(lights, SceneSphere { centre: low + (high - low) * 0.5, radius })
}

/// Returns the emission of an area light; `None` if it is black. Returns a message if a number is invalid.
fn lamp(emission: Emission) -> Result<Option<Lamp>, String> {
    let Emission { radiance, two_sided, .. } = emission;
    if radiance.iter().any(|x| !(x.is_finite() && *x >= 0.0)) {
        return Err(format!("an emission of {radiance:?} is invalid; use finite numbers of at least 0"));
    }
    let radiance = Vec3::from_array(radiance);
    Ok((radiance != Vec3::ZERO).then_some(Lamp { radiance, two_sided }))
}

/// Returns the area light of a shape; `None` if the shape has no area.
fn light(
    shape: &DescribedShape,
    number: u32,
    lamp: Lamp,
    space: &Space,
    geometry: &Geometry,
    part: &Part,
) -> Result<Option<Light>, String> {
    let to_world = space.apply(shape.to_world);
    let round = "an emitting sphere or disk must not be stretched; only move, rotate, mirror or scale it uniformly";
    Ok(match &shape.geometry {
        Described::Mesh(_) => MeshLight::new(geometry, number, lamp, &sides(geometry, number, part)).map(Light::Mesh),
        Described::Sphere { radius } => {
            let scale = even_scale(&to_world.matrix3).ok_or(round)?;
            let radius = (radius * scale) as f32;
            (radius > 0.0)
                .then(|| Light::Sphere(SphereLight::new(lamp, to_world.translation.as_vec3(), radius, part.flip)))
        }
        Described::Disk { height, radius, inner_radius } => {
            let scale = even_scale(&to_world.matrix3).ok_or(round)?;
            let centre = to_world.transform_point3(DVec3::new(0.0, 0.0, *height)).as_vec3();
            let normal = (to_world.matrix3.inverse().transpose() * DVec3::Z).normalize().as_vec3() * part.flip;
            let [outer, inner] = [radius, inner_radius].map(|r| (r * scale) as f32);
            (outer > inner).then(|| Light::Disk(DiskLight::new(lamp, centre, normal, outer, inner)))
        }
    })
}

/// Returns the area light of a mesh whose emission is a texture; `None` if the mesh has no area.
fn textured_light(
    described: &Described,
    (geometry, number): (&Geometry, u32),
    emission: TexturedEmission,
    part: &Part,
) -> Result<Option<Light>, String> {
    let Described::Mesh(_) = described else {
        let name = described.name();
        return Err(format!("a {name} cannot emit a texture; use a mesh, or a constant radiance"));
    };
    let light = TexturedLight::new((geometry, number), emission, &sides(geometry, number, part), &part.uvs);
    Ok(light.map(|light| Light::Textured(Box::new(light))))
}

/// Returns one sign per triangle, or a single sign for all: -1 if the emitting side is opposite to the winding normal, else 1.
/// Vertex normals, if there are any, determine the emitting side.
fn sides(geometry: &Geometry, number: u32, part: &Part) -> Vec<f32> {
    let Shape::Mesh(mesh) = &geometry.shapes()[number as usize] else { return Vec::new() };
    if part.normals.is_empty() {
        return vec![part.flip];
    }
    (0..mesh.triangles().len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t as u32);
            let normal = (b - a).cross(c - a) * part.flip;
            // The mean vertex normal of the triangle decides. Area lights whose vertex normals point to both sides of
            // a triangle are not supported.
            let shading: Vec3 = mesh.triangles()[t].iter().map(|&v| part.normals[v as usize]).sum();
            if normal.dot(shading) < 0.0 { -part.flip } else { part.flip }
        })
        .collect()
}
