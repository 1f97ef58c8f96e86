//! The nodes of a glTF scene with their places in the world, and the lights and cameras among them.

use super::{Fault, Reader, named};
use crate::{Camera, FilmSettings, Light, LightKind, Projection, SpotFalloff};
use ::gltf::json::camera::{Orthographic, Perspective};
use ::gltf::khr_lights_punctual::Kind;
use ::gltf::scene::Transform;
use ::gltf::{Document, Node, Scene, json};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};

/// The deepest nesting of nodes.
const DEEPEST: usize = 256;
/// Lumens per watt: the luminous efficacy that defines the candela. Blender uses it, too.
const LUMENS_PER_WATT: f32 = 683.0;
/// Image height in pixels if the file has a camera.
const HEIGHT: f64 = 720.0;
/// The allowed range of the aspect ratio, so that both sides of the image have pixels.
const ASPECTS: [f64; 2] = [0.05, 20.0];

/// A node and its transform to world space.
pub(super) struct Placed<'a> {
    pub(super) node: Node<'a>,
    pub(super) to_world: DAffine3,
}

/// The default scene, else the first.
pub(super) fn first_scene(document: &Document) -> Option<Scene<'_>> {
    document.default_scene().or_else(|| document.scenes().next())
}

/// The scene that is read: the default scene if it has nodes, else the first scene with nodes.
pub(super) fn shown_scene(document: &Document) -> Option<Scene<'_>> {
    first_scene(document).into_iter().chain(document.scenes()).find(|scene| scene.nodes().len() > 0)
}

/// Returns the nodes of the default scene (else of the first that has nodes, else all), parents before children.
pub(super) fn place(document: &Document) -> Result<Vec<Placed<'_>>, Fault> {
    let mut placed = Vec::new();
    let mut seen = vec![false; document.nodes().len()];
    let roots: Vec<Node<'_>> = match shown_scene(document) {
        Some(scene) => scene.nodes().collect(),
        None => {
            let mut child = vec![false; seen.len()];
            document.nodes().flat_map(|node| node.children()).for_each(|c| child[c.index()] = true);
            document.nodes().filter(|node| !child[node.index()]).collect()
        }
    };
    let mut open: Vec<(Node<'_>, DAffine3, usize)> =
        roots.into_iter().rev().map(|node| (node, DAffine3::IDENTITY, 0)).collect();
    while let Some((node, parent, depth)) = open.pop() {
        let fault = |what: &str| Err(format!("{}: {what}", named("node", node.index(), node.name())).into());
        if std::mem::replace(&mut seen[node.index()], true) {
            return fault("has two parents; export the file again");
        }
        if depth > DEEPEST {
            return fault(&format!("nodes are nested more than {DEEPEST} levels deep; flatten the scene"));
        }
        let to_world = parent * local(&node);
        if !to_world.is_finite() {
            return fault("its transform is not finite; export the file again");
        }
        let children: Vec<_> = node.children().map(|child| (child, to_world, depth + 1)).collect();
        open.extend(children.into_iter().rev());
        placed.push(Placed { node, to_world });
    }
    Ok(placed)
}

fn local(node: &Node<'_>) -> DAffine3 {
    match node.transform() {
        Transform::Matrix { matrix } => {
            DAffine3::from_mat4(DMat4::from_cols_array_2d(&matrix.map(|column| column.map(f64::from))))
        }
        Transform::Decomposed { translation, rotation, scale } => {
            let [scale, translation] = [scale, translation].map(|v| DVec3::from_array(v.map(f64::from)));
            let rotation = DQuat::from_array(rotation.map(f64::from));
            let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
            DAffine3::from_scale_rotation_translation(scale, rotation, translation)
        }
    }
}

/// The transform without its scale and shear, for cameras and lights. The -z axis keeps its direction; the y axis stays in
/// the plane of these two axes.
pub(super) fn rigid(to_world: DAffine3) -> Option<DAffine3> {
    let back = to_world.matrix3.z_axis.try_normalize()?;
    let right = to_world.matrix3.y_axis.cross(back).try_normalize()?;
    Some(DAffine3 { matrix3: DMat3::from_cols(right, back.cross(right), back), translation: to_world.translation })
}

impl Reader<'_> {
    /// Adds the lights of `KHR_lights_punctual`.
    pub(super) fn add_lights(&mut self, placed: &[Placed<'_>]) {
        if self.document.lights().is_none() {
            return;
        }
        for Placed { node, to_world } in placed {
            let Some(light) = node.light() else { continue };
            let name = named("light", light.index(), light.name());
            let power = light.color().map(|c| c * light.intensity() / LUMENS_PER_WATT);
            let lit = power.iter().all(|c| c.is_finite() && *c >= 0.0) && power.iter().any(|c| *c > 0.0);
            if light.range().is_some() {
                self.warn(format!("{name}: its range is left out; light fades with the square of the distance"));
            }
            let (Some(pose), true) = (rigid(*to_world), lit) else {
                self.warn(format!("{name} has no intensity or no direction; left out"));
                continue;
            };
            let (kind, to_world) = match light.kind() {
                Kind::Directional => (LightKind::Distant { irradiance: power }, pose),
                Kind::Point => (LightKind::Point { intensity: power }, pose),
                Kind::Spot { inner_cone_angle, outer_cone_angle } => {
                    let cone = outer_cone_angle.to_degrees().clamp(0.01, 90.0);
                    let falloff_start = inner_cone_angle.to_degrees().clamp(0.0, cone);
                    let falloff = SpotFalloff::Smoothstep;
                    // glTF's spots shine along -z, Dapple's along +z.
                    let turn = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)));
                    (LightKind::Spot { intensity: power, cone, falloff_start, falloff }, pose * turn)
                }
            };
            self.scene.lights.push(Light { kind, to_world, source: self.source.clone() });
        }
    }

    /// Sets camera and film from the file's first camera; `false` if it has none.
    pub(super) fn set_camera(&mut self, placed: &[Placed<'_>]) -> Result<bool, Fault> {
        let mut cameras = placed.iter().filter_map(|p| p.node.camera().map(|camera| (camera, p)));
        let Some((camera, at)) = cameras.next() else { return Ok(false) };
        let name = named("camera", camera.index(), camera.name());
        let others: Vec<String> = cameras.map(|(c, _)| named("camera", c.index(), c.name())).collect();
        if !others.is_empty() {
            self.warn(format!("{name} is used; left out: {}", others.join(", ")));
        }
        let pose = rigid(at.to_world);
        let pose = pose.ok_or_else(|| format!("{name}: its node has no direction; export the file again"))?;
        let json: &json::Camera = &self.document.as_json().cameras[camera.index()];
        let view = match (&json.perspective, &json.orthographic) {
            (Some(perspective), _) => of_perspective(perspective),
            (None, Some(orthographic)) => of_orthographic(orthographic),
            (None, None) => None,
        };
        let (projection, aspect, window) =
            view.ok_or_else(|| format!("{name}: its angle of view is invalid; export the file again"))?;
        let aspect = aspect.clamp(ASPECTS[0], ASPECTS[1]);
        let flip = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0)));
        let to_world = pose * flip;
        self.scene.camera =
            Camera { to_world, projection, screen_window: window, source: self.source.clone(), ..Camera::default() };
        let size =
            if aspect < 1.0 { [HEIGHT * aspect, HEIGHT] } else { [(HEIGHT * aspect).min(16.0 * HEIGHT), HEIGHT] };
        self.scene.film =
            FilmSettings { resolution: size.map(|n| n.round().max(1.0) as u32), ..FilmSettings::default() };
        Ok(true)
    }
}

/// A camera's projection, width over height, and window.
type View = (Projection, f64, Option<[f64; 4]>);

fn of_perspective(camera: &Perspective) -> Option<View> {
    let aspect = camera.aspect_ratio.map_or(16.0 / 9.0, f64::from);
    let half = (0.5 * f64::from(camera.yfov)).tan();
    if !(aspect > 0.0 && aspect.is_finite() && half > 0.0 && half < 1e3) {
        return None;
    }
    // The angle of view along the shorter side.
    let fov = 2.0 * (half * aspect.min(1.0)).atan().to_degrees();
    Some((Projection::Perspective { fov }, aspect, None))
}

fn of_orthographic(camera: &Orthographic) -> Option<View> {
    let [x, y] = [camera.xmag, camera.ymag].map(|m| f64::from(m).abs());
    let valid = [x, y].iter().all(|m| *m > 0.0 && m.is_finite());
    valid.then(|| (Projection::Orthographic, x / y, Some([-x, x, -y, y])))
}
