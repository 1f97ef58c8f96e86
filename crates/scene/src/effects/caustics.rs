//! Caustics of small lights, which a path tracer finds by chance only.

use super::lights::{Bounds, LampShape, LightNumber, powers};
use super::visible::Visible;
use super::{Called, Effect};
use crate::{Geometry, MaterialId, MaterialKind, Scene, Shape, Source};
use glam::DVec3;

/// Solid angle in steradians below which a lamp is small: fewer than one diffusely scattered ray in 3000 (`1e-3 / pi`)
/// hits it. At 64 to 1024 samples most pixels miss such a lamp.
const SMALL: f64 = 1e-3;
/// Fraction of the total power of all lights below which a light does not count.
const WORTH: f64 = 0.01;

pub(super) fn found_by_chance(visible: &Visible<'_>) -> Option<Called> {
    let scene = visible.scene;
    // One event is the refraction; another one scatters the light to the camera.
    if scene.max_depth.is_some_and(|d| d < 2) {
        return None;
    }
    let refracting = refracting(visible);
    let lights = powers(scene);
    let least = WORTH * lights.iter().map(|(_, power)| power).sum::<f64>();
    let mut found: Option<Called> = None;
    for (light, _) in lights.iter().filter(|(_, power)| *power >= least) {
        // The glass from which the lamp looks smallest.
        let seen = refracting.iter().filter_map(|glass| Some((glass, solid_angle(scene, *light, glass.centre)?)));
        let Some((glass, angle)) = seen.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, angle)| *angle < SMALL) else {
            continue;
        };
        match &mut found {
            Some(called) => called.objects += 1,
            None => {
                let (name, at) = (glass.name, glass.source);
                let what = match angle {
                    0.0 => "a light without extent, so that what it sends through is not found at all".to_owned(),
                    angle => format!("a lamp of {angle:.1e} sr"),
                };
                let because = format!("material \"{name}\" ({at}) refracts the light of {what}");
                let source = match light {
                    LightNumber::Shape(i) => &scene.shapes[*i].source,
                    LightNumber::Light(i) => &scene.lights[*i].source,
                };
                found = Some(Called { effect: Effect::Refraction, because, source: source.clone(), objects: 1 });
            }
        }
    }
    found
}

/// A smooth refracting shape. Light sampling cannot connect through it.
struct Glass<'s> {
    name: &'s str,
    source: &'s Source,
    centre: DVec3,
}

fn refracting<'s>(visible: &Visible<'s>) -> Vec<Glass<'s>> {
    let scene = visible.scene;
    let mut found = Vec::new();
    let mut look = |shape: &'s Shape, to_world| {
        let Some(name) = smooth_glass(scene, shape.material) else { return };
        let mut bounds = Bounds::default();
        bounds.grow(&shape.geometry, to_world);
        found.push(Glass { name, source: &shape.source, centre: bounds.centre() });
    };
    scene.shapes.iter().for_each(|s| look(s, s.to_world));
    for instance in &visible.instances {
        let object = &scene.objects[instance.object.0 as usize];
        object.shapes.iter().for_each(|s| look(s, instance.to_world * s.to_world));
    }
    found
}

/// Returns the name of the first smooth refracting material in a material or, for a mix, among its parts; `None` if
/// there is none.
fn smooth_glass(scene: &Scene, id: MaterialId) -> Option<&str> {
    let mut waiting = vec![id];
    // Mixes may be circular: visit each material once.
    let mut seen = vec![false; scene.materials.len()];
    while let Some(id) = waiting.pop() {
        let number = id.0 as usize;
        let Some(material) = scene.materials.get(number).filter(|_| !std::mem::replace(&mut seen[number], true)) else {
            continue;
        };
        if material.kind.lobes().iter().any(|lobe| lobe.refracts && lobe.smooth_or_rough()[0]) {
            return Some(&material.name);
        }
        if let MaterialKind::Mix { materials, .. } = &material.kind {
            waiting.extend(materials);
        }
    }
    None
}

/// Returns an upper bound of the solid angle, in steradians, of a light seen from a point; `None` for an environment.
fn solid_angle(scene: &Scene, light: LightNumber, from: DVec3) -> Option<f64> {
    match light {
        LightNumber::Light(i) => match scene.lights[i].kind.environment() {
            Some(_) => None,
            None => Some(0.0),
        },
        LightNumber::Shape(i) => {
            let shape = &scene.shapes[i];
            let lamp = LampShape::of(shape)?;
            // A sphere shows a quarter of its area.
            let shown = if matches!(shape.geometry, Geometry::Sphere { .. }) { 0.25 } else { 1.0 };
            Some(shown * lamp.area / lamp.centre.distance_squared(from))
        }
    }
}
