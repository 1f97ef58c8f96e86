//! The camera, light and ground of files that have none.

mod view;

use super::UpAxis;
use crate::image::Image;
use crate::{
    Camera, Color, EnvironmentRadiance, FilmSettings, Geometry, Light, LightKind, Material, MaterialKind, Projection,
    Scene, Shape, Source,
};
use glam::{DAffine3, DMat3, DVec3};
use std::sync::{Arc, LazyLock};

/// Full angle of view along the shorter side of the image, in degrees: about that of a portrait lens.
const FOV: f64 = 35.0;
/// The tangent of half of `FOV`, a literal so that it is the same on every machine.
const TAN_HALF_FOV: f64 = 0.315_298_788_878_984;
/// The part of the image's width or height that the model fills.
const FILLED: f64 = 0.88;
/// The largest number of scattering events per path. Grey surfaces leave little light after this number.
const MAX_DEPTH: u32 = 6;
/// Height of the image in pixels; the default width is a third more.
const HEIGHT: u32 = 720;
/// The reflectance of the ground.
const GROUND: [f32; 3] = [0.32, 0.31, 0.30];
/// The ground's radius over the model's: beyond the horizon of the default image.
const GROUND_RADIUS: f64 = 300.0;
/// The gap between the ground and the model's lowest point, over the model's radius. Without it, faces on the ground
/// would lie in it.
const GAP: f64 = 1e-4;

/// The parts that a file lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wanted {
    pub(crate) camera: bool,
    pub(crate) sky: bool,
    pub(crate) ground: bool,
}

/// The setting of a bare model: the axis that points up, and width over height of the image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    pub(crate) up: UpAxis,
    pub(crate) aspect: Option<f64>,
}

/// Sets camera, film, light and ground of a scene, as far as they are wanted.
///
/// # Errors
/// Returns a message if all vertices coincide, or if the size overflows.
pub(crate) fn set(scene: &mut Scene, stage: Stage, wanted: Wanted, source: &Source) -> Result<(), &'static str> {
    if !(wanted.camera || wanted.sky || wanted.ground) {
        return Ok(());
    }
    let (centre, radius) = bounds(scene)?;
    let (front, right, up) = stage.up.axes();
    let view = if wanted.camera { view::choose(scene, [front, right, up], centre, radius) } else { view::USUAL };
    let towards = view::direction(view, [front, right, up]);
    if wanted.camera {
        let aspect = stage.aspect.unwrap_or(4.0 / 3.0);
        let camera_right = (-towards).cross(up).normalize();
        let axes = [camera_right, camera_right.cross(-towards), -towards];
        let tangents = [aspect.max(1.0), (1.0 / aspect).max(1.0)].map(|side| FILLED * TAN_HALF_FOV * side);
        let eye = centre + radius * frame(scene, centre, radius, axes, tangents);
        scene.camera = Camera {
            to_world: DAffine3 {
                matrix3: DMat3::from_cols_array_2d(&axes.map(|axis| axis.to_array())),
                translation: eye,
            },
            projection: Projection::Perspective { fov: FOV },
            source: source.clone(),
            ..Camera::default()
        };
        let width = (f64::from(HEIGHT) * aspect.clamp(0.1, 10.0)).round() as u32;
        scene.film = FilmSettings { resolution: [width, HEIGHT], ..FilmSettings::default() };
    }
    if wanted.ground {
        add_ground(scene, radius, up, source);
    }
    if wanted.sky {
        scene.max_depth = scene.max_depth.or(Some(MAX_DEPTH));
        let radiance = EnvironmentRadiance::LatLong { image: STUDIO.clone(), scale: 1.0 };
        // The environment is turned with the camera: its x axis points horizontally to the viewer.
        let level = (towards - up * towards.dot(up)).normalize();
        let to_world = DAffine3::from_mat3(DMat3::from_cols(level, up.cross(level), up));
        scene.lights = vec![Light { kind: LightKind::Infinite { radiance }, to_world, source: source.clone() }];
    }
    Ok(())
}

/// The centre and half the diagonal of the scene's bounds.
fn bounds(scene: &Scene) -> Result<(DVec3, f64), &'static str> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    each_triangle(scene, |corners| corners.iter().for_each(|p| (low, high) = (low.min(*p), high.max(*p))));
    let centre = low + 0.5 * (high - low);
    let radius = (0.5 * (high - low)).length();
    if !(centre.is_finite() && radius.is_finite()) {
        return Err("the model is too large to be seen; its size overflows; scale it down");
    }
    if radius == 0.0 {
        return Err("all corners of the model lie in one point; there is nothing to see");
    }
    Ok((centre, radius))
}

/// The place of the camera relative to `centre`, in units of `radius`, from which all corners just fit into the image.
/// `axes` are its directions to the right, up and forward, `tangents` those of half the angles of view.
fn frame(scene: &Scene, centre: DVec3, radius: f64, axes: [DVec3; 3], tangents: [f64; 2]) -> DVec3 {
    let [right, up, forward] = axes;
    // The largest of x - t z and -x - t z over all corners, and the same for y: the corners that touch each edge.
    let mut most = [[f64::NEG_INFINITY; 2]; 2];
    let mut nearest = f64::INFINITY;
    each_triangle(scene, |corners| {
        for corner in corners {
            let p = (corner - centre) / radius;
            let z = p.dot(forward);
            nearest = nearest.min(z);
            for (k, (axis, tangent)) in [(right, tangents[0]), (up, tangents[1])].into_iter().enumerate() {
                let x = p.dot(axis);
                most[k] = [most[k][0].max(x - tangent * z), most[k][1].max(-x - tangent * z)];
            }
        }
    });
    let depth = |k: usize| -(most[k][0] + most[k][1]) / (2.0 * tangents[k]);
    // In front of the nearest corner, also for a model that is seen edge on.
    let z = depth(0).min(depth(1)).min(nearest - 0.05);
    let across = |k: usize| 0.5 * (most[k][0] - most[k][1]);
    right * across(0) + up * across(1) + forward * z
}

/// Adds a large disk on which the model stands.
fn add_ground(scene: &mut Scene, radius: f64, up: DVec3, source: &Source) {
    let mut lowest = f64::INFINITY;
    let mut middle = DVec3::ZERO;
    each_triangle(scene, |corners| {
        for corner in corners {
            if corner.dot(up) < lowest {
                (lowest, middle) = (corner.dot(up), corner);
            }
        }
    });
    let material =
        Material::new("ground", MaterialKind::Diffuse { reflectance: Color::Constant(GROUND) }, source.clone());
    let id = scene.add_material(material);
    let (x, y) = up.any_orthonormal_pair();
    let to_world = DAffine3 { matrix3: DMat3::from_cols(x, y, up), translation: middle - up * (GAP * radius) };
    let geometry = Geometry::Disk { height: 0.0, radius: GROUND_RADIUS * radius, inner_radius: 0.0 };
    scene.shapes.push(Shape::new(geometry, to_world, id, source.clone()));
}

/// Calls `f` with the corners of every triangle of a scene in world space, counter-clockwise as seen from its front.
fn each_triangle(scene: &Scene, mut f: impl FnMut([DVec3; 3])) {
    let mut shape = |shape: &Shape, to_world: DAffine3| {
        let Geometry::Mesh(mesh) = &shape.geometry else { return };
        let to_world = to_world * shape.to_world;
        let turned = (to_world.matrix3.determinant() < 0.0) != shape.reversed;
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|corner| to_world.transform_point3(mesh.positions[corner as usize]));
            f(if turned { [a, c, b] } else { [a, b, c] });
        }
    };
    scene.shapes.iter().for_each(|s| shape(s, DAffine3::IDENTITY));
    for instance in &scene.instances {
        let object = &scene.objects[instance.object.0 as usize];
        object.shapes.iter().for_each(|s| shape(s, instance.to_world));
    }
}

/// The environment map of model scenes. It is made once, since that takes longer than reading a small model.
static STUDIO: LazyLock<Arc<Image>> = LazyLock::new(|| Arc::new(studio()));

/// Makes the environment map of model scenes: brighter above than below, with a round lamp over the viewer's left
/// shoulder. z is up, and x points to the viewer.
fn studio() -> Image {
    const SIZE: [u32; 2] = [512, 256];
    const FLOOR: DVec3 = DVec3::new(0.16, 0.15, 0.14);
    const HORIZON: DVec3 = DVec3::new(0.34, 0.34, 0.35);
    const ZENITH: DVec3 = DVec3::new(0.55, 0.60, 0.68);
    const LAMP: DVec3 = DVec3::new(13.0, 12.2, 11.0);
    /// Cosines of the angular radii of the lamp's outer edge (17 degrees) and of its fully bright part (13 degrees).
    const EDGE: [f64; 2] = [0.956, 0.974];
    let lamp = DVec3::new(0.62, -0.62, 0.72).normalize();
    let mix = |a: DVec3, b: DVec3, [from, to]: [f64; 2], x: f64| {
        let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
        let t = t * t * (3.0 - 2.0 * t);
        a * (1.0 - t) + b * t
    };
    let radiance = |x: u32, y: u32| {
        let [sin_phi, cos_phi] = sin_cos((f64::from(x) + 0.5) / f64::from(SIZE[0]));
        let [sin_theta, cos_theta] = sin_cos(0.5 * (f64::from(y) + 0.5) / f64::from(SIZE[1]));
        let direction = DVec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta);
        let sky = mix(HORIZON, ZENITH, [0.0, 1.0], cos_theta);
        let room = mix(sky, FLOOR, [0.0, 0.35], -cos_theta);
        mix(room, LAMP, EDGE, direction.dot(lamp)).as_vec3().to_array()
    };
    let pixels = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))).map(|(x, y)| radiance(x, y)).collect();
    Image { size: SIZE, pixels, alpha: Vec::new() }
}

/// Returns the sine and the cosine of an angle of `turns` full turns, within 1e-12, for `turns` in `[0, 1]`.
///
/// Uses Taylor polynomials about the nearest quarter turn: the platform's functions differ in the last bit between
/// machines.
fn sin_cos(turns: f64) -> [f64; 2] {
    let quarter = (4.0 * turns).round();
    let x = (turns - 0.25 * quarter) * (2.0 * std::f64::consts::PI);
    let square = x * x;
    let (mut sine, mut cosine) = (0.0, 0.0);
    for k in (0..8).rev() {
        let k = f64::from(k);
        sine = 1.0 - square / ((2.0 * k + 2.0) * (2.0 * k + 3.0)) * sine;
        cosine = 1.0 - square / ((2.0 * k + 1.0) * (2.0 * k + 2.0)) * cosine;
    }
    let sine = x * sine;
    match quarter as u32 % 4 {
        0 => [sine, cosine],
        1 => [cosine, -sine],
        2 => [-sine, -cosine],
        _ => [-cosine, sine],
    }
}

#[cfg(test)]
mod tests;
