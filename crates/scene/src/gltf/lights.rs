//! Lights and cameras of a glTF file.

use super::nodes::{Placed, rigid};
use super::{Fault, named};
use crate::{Camera, FilmSettings, Light, LightKind, Projection, Scene, Source, SpotFalloff};
use ::gltf::json::camera::{Orthographic, Perspective};
use ::gltf::khr_lights_punctual::Kind;
use ::gltf::{Document, json};
use glam::{DAffine3, DMat3, DVec3};

/// Lumens per watt: the luminous efficacy in the definition of the candela, by which Blender converts lights too.
const LUMENS_PER_WATT: f32 = 683.0;
/// Height in pixels of images by a camera of the file.
const HEIGHT: f64 = 720.0;
/// The range of the aspect ratio, so that the image keeps both sides.
const ASPECTS: [f64; 2] = [0.05, 20.0];

/// Adds the lights of `KHR_lights_punctual`.
pub(super) fn add(scene: &mut Scene, document: &Document, placed: &[Placed<'_>], source: &Source) {
    if document.lights().is_none() {
        return;
    }
    for Placed { node, to_world } in placed {
        let Some(light) = node.light() else { continue };
        let name = named("light", light.index(), light.name());
        let power = light.color().map(|c| c * light.intensity() / LUMENS_PER_WATT);
        let lit = power.iter().all(|c| c.is_finite() && *c >= 0.0) && power.iter().any(|c| *c > 0.0);
        let (Some(pose), true) = (rigid(*to_world), lit) else {
            scene.warn(source, format!("{name} has no light or no direction; left out"));
            continue;
        };
        let (kind, to_world) = match light.kind() {
            Kind::Directional => (LightKind::Distant { irradiance: power }, pose),
            Kind::Point => (LightKind::Point { intensity: power }, pose),
            Kind::Spot { inner_cone_angle, outer_cone_angle } => {
                let cone = outer_cone_angle.to_degrees().clamp(0.01, 90.0);
                let falloff_start = inner_cone_angle.to_degrees().clamp(0.0, cone);
                let falloff = SpotFalloff::Smoothstep;
                // glTF's spots shine along -z, ours along +z.
                let turn = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)));
                (LightKind::Spot { intensity: power, cone, falloff_start, falloff }, pose * turn)
            }
        };
        scene.lights.push(Light { kind, to_world, source: source.clone() });
    }
}

/// Sets camera and film from the file's first camera; `false` if it has none.
pub(super) fn set_camera(
    scene: &mut Scene,
    document: &Document,
    placed: &[Placed<'_>],
    source: &Source,
) -> Result<bool, Fault> {
    let mut cameras = placed.iter().filter_map(|p| p.node.camera().map(|camera| (camera, p)));
    let Some((camera, at)) = cameras.next() else { return Ok(false) };
    let name = named("camera", camera.index(), camera.name());
    let others: Vec<String> = cameras.map(|(c, _)| named("camera", c.index(), c.name())).collect();
    if !others.is_empty() {
        scene.warn(source, format!("{name} is used; left out: {}", others.join(", ")));
    }
    let pose = rigid(at.to_world).ok_or_else(|| format!("{name}: its node has no direction; export the file again"))?;
    let json: &json::Camera = &document.as_json().cameras[camera.index()];
    let view = match (&json.perspective, &json.orthographic) {
        (Some(perspective), _) => of_perspective(perspective),
        (None, Some(orthographic)) => of_orthographic(orthographic),
        (None, None) => None,
    };
    let View { projection, aspect, window } =
        view.ok_or_else(|| format!("{name}: its angle of view is invalid; export the file again"))?;
    let aspect = aspect.clamp(ASPECTS[0], ASPECTS[1]);
    let flip = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0)));
    let to_world = pose * flip;
    scene.camera = Camera { to_world, projection, screen_window: window, source: source.clone(), ..Camera::default() };
    let size = if aspect < 1.0 { [HEIGHT * aspect, HEIGHT] } else { [(HEIGHT * aspect).min(16.0 * HEIGHT), HEIGHT] };
    scene.film = FilmSettings { resolution: size.map(|n| n.round().max(1.0) as u32), ..FilmSettings::default() };
    Ok(true)
}

/// A camera's projection, width over height, and window.
struct View {
    projection: Projection,
    aspect: f64,
    window: Option<[f64; 4]>,
}

fn of_perspective(camera: &Perspective) -> Option<View> {
    let aspect = camera.aspect_ratio.map_or(16.0 / 9.0, f64::from);
    let half = (0.5 * f64::from(camera.yfov)).tan();
    if !(aspect > 0.0 && aspect.is_finite() && half > 0.0 && half < 1e3) {
        return None;
    }
    // The angle of view along the shorter side.
    let fov = 2.0 * (half * aspect.min(1.0)).atan().to_degrees();
    Some(View { projection: Projection::Perspective { fov }, aspect, window: None })
}

fn of_orthographic(camera: &Orthographic) -> Option<View> {
    let [x, y] = [camera.xmag, camera.ymag].map(|m| f64::from(m).abs());
    let valid = [x, y].iter().all(|m| *m > 0.0 && m.is_finite());
    valid.then(|| View { projection: Projection::Orthographic, aspect: x / y, window: Some([-x, x, -y, y]) })
}
