//! Effects of lights: soft shadows, several lights, environments. Sizes and powers of lights. Caustics from small lights,
//! which a path tracer finds only by chance.

use super::visible::{Visible, worn};
use super::{CalledEffect, Effect, FirstCause, found};
use crate::{Emission, Geometry, Light, LightKind, Material, Scene, Shape, Source, SpotFalloff, Texture};
use dapple_core::film::luminance;
use glam::{DAffine3, DMat3, DVec3};
use std::f64::consts::PI;

/// The smallest length of the mean normal of a flat area light, which spots replace. A point replaces any other light.
const FLAT: f64 = 0.9;

pub(super) fn find_lamps(visible: &Visible<'_>) -> FirstCause {
    let lamps = visible.scene.shapes.iter().filter_map(|shape| Some((shape, LampShape::of(shape)?)));
    found(lamps, |(shape, lamp)| {
        let sides = if lamp.emission.two_sided { " from both sides" } else { "" };
        let because = match &shape.geometry {
            Geometry::Mesh(mesh) => format!("a mesh of {} triangles emits light{sides}", mesh.triangles.len()),
            geometry => format!("a {} emits light{sides}", geometry.name()),
        };
        (because, shape.source.clone())
    })
}

/// Replaces each area light by lights without extent.
pub(super) fn shrink_lamps(scene: &mut Scene) {
    let lamp = |shape: &Shape| {
        let lamp = LampShape::of(shape)?;
        Some((LampShape { emission: lamp.emission.mean(&scene.textures), ..lamp }, shape.source.clone()))
    };
    let lamps: Vec<_> = scene.shapes.iter().filter_map(lamp).collect();
    scene.shapes.retain(|shape| LampShape::of(shape).is_none());
    for (lamp, source) in lamps {
        let points = point_lights(&lamp).into_iter();
        scene.lights.extend(points.map(|(kind, to_world)| Light { kind, to_world, source: source.clone() }));
    }
}

/// Returns the lights without extent that replace an area light, each with its light-to-world transform.
fn point_lights(lamp: &LampShape) -> Vec<(LightKind, DAffine3)> {
    if lamp.facing.length() < FLAT {
        let intensity = lamp.power(&[]).map(|p| (p / (4.0 * std::f64::consts::PI)) as f32);
        return vec![(LightKind::Point { intensity }, DAffine3::from_translation(lamp.centre))];
    }
    let intensity = lamp.emission.radiance.map(|l| (f64::from(l) * lamp.area) as f32);
    let kind = LightKind::Spot { intensity, cone: 90.0, falloff_start: 0.0, falloff: SpotFalloff::Smoothstep };
    let axis = lamp.facing.normalize();
    let directions = if lamp.emission.two_sided { vec![axis, -axis] } else { vec![axis] };
    directions.into_iter().map(|axis| (kind.clone(), along(axis, lamp.centre))).collect()
}

/// Returns the transform to world space from a space with this origin whose +z axis is the unit vector `axis`.
fn along(axis: DVec3, origin: DVec3) -> DAffine3 {
    let x = axis.any_orthonormal_vector();
    DAffine3 { matrix3: DMat3::from_cols(x, axis.cross(x), axis), translation: origin }
}

/// Finds all lights if there are several, and reports the second one.
pub(super) fn find_several(visible: &Visible<'_>) -> FirstCause {
    let lamps = visible.scene.shapes.iter().filter(|shape| LampShape::of(shape).is_some()).map(|shape| &shape.source);
    let lights = visible.scene.lights.iter().filter(|light| light.kind.shines()).map(|light| &light.source);
    let sources: Vec<&Source> = lamps.chain(lights).collect();
    let (count, second) = (sources.len(), Source::clone(sources.get(1)?));
    Some((format!("the second of {count} lights"), second, count))
}

pub(super) fn keep_strongest(scene: &mut Scene) {
    let stronger = |best: (LightNumber, f64), next: (LightNumber, f64)| if next.1 > best.1 { next } else { best };
    let kept = powers(scene).into_iter().reduce(stronger).map(|(light, _)| light);
    for (i, shape) in scene.shapes.iter_mut().enumerate() {
        if kept != Some(LightNumber::Shape(i)) {
            shape.emission = None;
        }
    }
    let mut number = 0..;
    scene.lights.retain(|_| kept == number.next().map(LightNumber::Light));
}

pub(super) fn find_environments(visible: &Visible<'_>) -> FirstCause {
    let shining = visible.scene.lights.iter().filter(|light| light.kind.shines());
    let environments = shining.filter_map(|light| Some((light, light.kind.environment()?)));
    found(environments, |(light, environment)| {
        let because = match environment.image() {
            Some(image) => format!("an environment map of {}x{} pixels", image.size[0], image.size[1]),
            None => "a uniform environment".into(),
        };
        (because, light.source.clone())
    })
}

/// The size and emission of a shape that emits light.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LampShape {
    /// The emitted radiance, and the number of emitting sides.
    emission: Emission,
    /// Area of one emitting side, in square units of the file's world space.
    area: f64,
    /// Area-weighted centroid of the shape, in the file's world space.
    centre: DVec3,
    /// Area-weighted mean of the unit normals: of length 1 for a flat shape, 0 for a closed one.
    facing: DVec3,
}

impl LampShape {
    /// Returns the size and emission of a shape in its first pose; `None` if the shape emits no light or has no area.
    fn of(shape: &Shape) -> Option<Self> {
        let emission = shape.emission.filter(|e| e.radiance != [0.0; 3])?;
        let (area, centre, facing) = match &shape.geometry {
            Geometry::Mesh(_) => mesh(shape)?,
            Geometry::Sphere { radius } => {
                // Validation refuses stretched spheres elsewhere.
                let scale = shape.to_world.matrix3.determinant().abs().cbrt();
                (4.0 * PI * (radius * scale).powi(2), shape.to_world.translation, DVec3::ZERO)
            }
            Geometry::Disk { height, radius, inner_radius } => {
                let matrix = shape.to_world.matrix3;
                let across = matrix.x_axis.cross(matrix.y_axis);
                let area = PI * (radius * radius - inner_radius * inner_radius) * across.length();
                let side = side(shape) * matrix.determinant().signum();
                let centre = shape.to_world.transform_point3(DVec3::new(0.0, 0.0, *height));
                (area, centre, across.normalize_or_zero() * side)
            }
        };
        // NaN passes here; validation rejects it later.
        (area != 0.0).then_some(Self { emission, area, centre, facing })
    }

    /// Returns the radiant power, RGB: `pi * area * radiance` for each emitting side, with the mean of a texture.
    fn power(&self, textures: &[Texture]) -> [f64; 3] {
        let sides = if self.emission.two_sided { 2.0 } else { 1.0 };
        self.emission.mean(textures).radiance.map(|l| PI * self.area * f64::from(l) * sides)
    }
}

fn side(shape: &Shape) -> f64 {
    if shape.reversed { -1.0 } else { 1.0 }
}

/// Returns area, centroid and mean normal of a mesh in world space; `None` for area 0.
fn mesh(shape: &Shape) -> Option<(f64, DVec3, DVec3)> {
    let Geometry::Mesh(mesh) = &shape.geometry else { return None };
    let (mut area, mut moment, mut facing) = (0.0, DVec3::ZERO, DVec3::ZERO);
    // A mirroring transform reverses the winding, but not the normal.
    let side = side(shape) * shape.to_world.matrix3.determinant().signum();
    let turn = shape.to_world.matrix3.inverse().transpose();
    for triangle in &mesh.triangles {
        let corner = |i: usize| mesh.positions.get(triangle[i] as usize).copied().unwrap_or(DVec3::NAN);
        let [a, b, c] = [0, 1, 2].map(|i| shape.to_world.transform_point3(corner(i)));
        let mut normal = (b - a).cross(c - a) * 0.5 * side;
        let shading = triangle.iter().filter_map(|&v| mesh.normals.get(v as usize));
        let shading: DVec3 = shading.map(|n| turn * DVec3::from(n.map(f64::from)) * self::side(shape)).sum();
        if normal.dot(shading) < 0.0 {
            normal = -normal;
        }
        let size = normal.length();
        area += size;
        moment += (a + b + c) / 3.0 * size;
        facing += normal;
    }
    (area != 0.0).then(|| (area, moment / area, facing / area))
}

/// The index of a light in its scene: an emitting shape, or a light that is not a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LightNumber {
    /// An emitting shape, by its index in [`Scene::shapes`].
    Shape(usize),
    /// A light that is not a shape, by its index in [`Scene::lights`].
    Light(usize),
}

/// Returns every light that is not black, with the luminance of its radiant power. The power of an infinitely far light is
/// the power that enters the scene's bounding sphere. The renderer's light selection by power uses the same weights up to
/// rounding.
pub(super) fn powers(scene: &Scene) -> Vec<(LightNumber, f64)> {
    let lamp =
        |(i, shape)| LampShape::of(shape).map(|lamp| (LightNumber::Shape(i), luminance(lamp.power(&scene.textures))));
    let mut found: Vec<_> = scene.shapes.iter().enumerate().filter_map(lamp).collect();
    let [low, high] = bounds(scene.placed());
    let diagonal = Some((high - low).length()).filter(|length| length.is_finite());
    let disk = PI * (diagonal.unwrap_or(0.0) * 0.5).powi(2);
    let lights = scene.lights.iter().enumerate().filter(|(_, l)| l.kind.shines());
    found.extend(lights.map(|(i, light)| (LightNumber::Light(i), light.kind.power(disk))));
    found
}

/// Returns the minimum and the maximum corner of the bounding box of shapes, each with its transform to world space.
fn bounds<'s>(shapes: impl IntoIterator<Item = (&'s Shape, DAffine3)>) -> [DVec3; 2] {
    let [mut low, mut high] = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for (shape, to_world) in shapes {
        let mut take = |p: DVec3| {
            let p = to_world.transform_point3(p);
            (low, high) = (low.min(p), high.max(p));
        };
        let (half, height) = match &shape.geometry {
            Geometry::Mesh(mesh) => {
                mesh.positions.iter().for_each(|&p| take(p));
                continue;
            }
            Geometry::Sphere { radius } => (DVec3::splat(*radius), 0.0),
            Geometry::Disk { height, radius, .. } => (DVec3::new(*radius, *radius, 0.0), *height),
        };
        for corner in 0..8 {
            let sign = |bit: u32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
            take(half * DVec3::new(sign(0), sign(1), sign(2)) + DVec3::new(0.0, 0.0, height));
        }
    }
    [low, high]
}

/// Solid angle in steradians below which a light is small: fewer than one diffusely scattered ray in 3000 (`1e-3 / pi`) hits
/// it. At 64 to 1024 samples most pixels miss such a light.
const SMALL: f64 = 1e-3;
/// Fraction of the total power of all lights below which a light does not count.
const WORTH: f64 = 0.01;

pub(super) fn found_by_chance(visible: &Visible<'_>) -> Option<CalledEffect> {
    let scene = visible.scene;
    // One event is the refraction; another one scatters the light to the camera.
    if scene.max_depth.is_some_and(|d| d < 2) {
        return None;
    }
    let refracting = refracting(scene);
    let lights = powers(scene);
    let least = WORTH * lights.iter().map(|(_, power)| power).sum::<f64>();
    // The glass from whose centre the light covers the smallest solid angle.
    let small = |light: LightNumber| {
        let seen = refracting.iter().filter_map(|glass| Some((glass, solid_angle(scene, light, glass.2)?)));
        let (glass, angle) = seen.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, angle)| *angle < SMALL)?;
        Some((light, glass, angle))
    };
    let counting = lights.iter().filter(|(_, power)| *power >= least);
    let found: Vec<_> = counting.filter_map(|(light, _)| small(*light)).collect();
    let &(light, (name, at, _), angle) = found.first()?;
    let what = match angle {
        0.0 => "a source without extent, which paths never hit".to_owned(),
        angle => format!("a small source ({angle:.1e} sr)"),
    };
    let because = format!("material \"{name}\" ({at}) refracts light from {what}");
    let source = match light {
        LightNumber::Shape(i) => scene.shapes[i].source.clone(),
        LightNumber::Light(i) => scene.lights[i].source.clone(),
    };
    Some(CalledEffect { effect: Effect::Refraction, because, source, objects: found.len() })
}

/// Returns the smooth refracting shapes, through which light sampling cannot connect: for each the material's name, the
/// shape's place in the file, and the shape's centre.
fn refracting(scene: &Scene) -> Vec<(&str, &Source, DVec3)> {
    let glass = |(shape, to_world): (&'_ Shape, DAffine3)| {
        let mut seen = vec![false; scene.materials.len()];
        let smooth = |m: &&Material| m.kind.lobes().iter().any(|lobe| lobe.refracts && lobe.smooth_or_rough()[0]);
        let material = worn(scene, shape.material, &mut seen).into_iter().find(smooth)?;
        let [low, high] = bounds([(shape, to_world)]);
        Some((material.name.as_str(), (low + high) * 0.5))
    };
    scene.placed().filter_map(|placed| glass(placed).map(|(name, centre)| (name, &placed.0.source, centre))).collect()
}

/// Returns an upper bound of the solid angle, in steradians, of a light seen from a point; `None` for an environment.
fn solid_angle(scene: &Scene, light: LightNumber, from: DVec3) -> Option<f64> {
    match light {
        LightNumber::Light(i) => scene.lights[i].kind.environment().is_none().then_some(0.0),
        LightNumber::Shape(i) => {
            let shape = &scene.shapes[i];
            let lamp = LampShape::of(shape)?;
            // The projected area of a sphere is a quarter of its surface.
            let shown = if matches!(shape.geometry, Geometry::Sphere { .. }) { 0.25 } else { 1.0 };
            Some(shown * lamp.area / lamp.centre.distance_squared(from))
        }
    }
}
