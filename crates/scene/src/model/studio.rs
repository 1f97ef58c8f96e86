//! The camera, light and ground of files that have none.

use super::UpAxis;
use crate::image::Image;
use crate::{
    Camera, Color, EnvironmentRadiance, FilmSettings, Geometry, Light, LightKind, Projection, Scene, Shape, Source,
};
use glam::{DAffine3, DMat3, DVec2, DVec3};
use std::f64::consts::TAU;
use std::sync::{Arc, LazyLock};

/// Full angle of view along the shorter side of the image, in degrees: about that of a portrait lens.
const FOV: f64 = 35.0;
/// The tangent of half of `FOV`, a literal so that it is the same on every machine.
const TAN_HALF_FOV: f64 = 0.315_298_788_878_984;
/// The fraction of the image's width or height that the model fills.
const FILLED: f64 = 0.88;
/// The largest number of scattering events per path. Grey surfaces leave little light after 6 events.
const MAX_DEPTH: u32 = 6;
/// Height of the image in pixels; the default width is a third more.
const HEIGHT: u32 = 720;
/// The reflectance of the ground.
const GROUND: [f32; 3] = [0.32, 0.31, 0.30];
/// The ground's radius divided by the model's, so that the ground reaches beyond the horizon of the default image.
const GROUND_RADIUS: f64 = 300.0;
/// The gap between the ground and the model's lowest point, divided by the model's radius. Without a gap, the lowest faces
/// would coincide with the ground.
const GAP: f64 = 1e-4;

/// The parts that a file lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wanted {
    pub(crate) camera: bool,
    pub(crate) sky: bool,
    pub(crate) ground: bool,
}

/// The axis of a bare model that points up, and the width of the image divided by its height.
pub(crate) type Stage = (UpAxis, Option<f64>);

/// Sets the camera with its film, the light and the ground of a scene, each only if `wanted` requests it.
///
/// # Errors
/// Returns a message if all vertices coincide, or if the size overflows.
pub(crate) fn set(scene: &mut Scene, (up, aspect): Stage, wanted: Wanted, source: &Source) -> Result<(), &'static str> {
    if !(wanted.camera || wanted.sky || wanted.ground) {
        return Ok(());
    }
    let (centre, radius) = bounds(scene)?;
    let (front, right, up) = up.axes();
    let view = if wanted.camera { choose_view(scene, [front, right, up], centre, radius) } else { USUAL };
    let towards = view_direction(view, [front, right, up]);
    if wanted.camera {
        let aspect = aspect.unwrap_or(4.0 / 3.0);
        let camera_right = (-towards).cross(up).normalize();
        let axes = [camera_right, camera_right.cross(-towards), -towards];
        let tangents = [aspect.max(1.0), (1.0 / aspect).max(1.0)].map(|side| FILLED * TAN_HALF_FOV * side);
        let eye = centre + radius * frame(scene, centre, radius, axes, tangents);
        let matrix3 = DMat3::from_cols_array_2d(&axes.map(|axis| axis.to_array()));
        let to_world = DAffine3 { matrix3, translation: eye };
        let projection = Projection::Perspective { fov: FOV };
        scene.camera = Camera { to_world, projection, source: source.clone(), ..Camera::default() };
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
        return Err("the size of the model overflows; scale the model down");
    }
    if radius == 0.0 {
        return Err("all vertices of the model coincide; there is nothing to render");
    }
    Ok((centre, radius))
}

/// The position of the camera relative to `centre`, in units of `radius`, from which all corners just fit into the image.
/// `axes` are the camera's directions to the right, up and forward; `tangents` are those of half the angles of view.
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
    let id = super::add_material(scene, "ground", Some(Color::Constant(GROUND)), false, source);
    let (x, y) = up.any_orthonormal_pair();
    let to_world = DAffine3 { matrix3: DMat3::from_cols(x, y, up), translation: middle - up * (GAP * radius) };
    let geometry = Geometry::Disk { height: 0.0, radius: GROUND_RADIUS * radius, inner_radius: 0.0 };
    scene.shapes.push(Shape::new(geometry, to_world, id, source.clone()));
}

/// Calls `f` with the corners of every triangle of a scene in world space, counter-clockwise as seen from its front.
fn each_triangle(scene: &Scene, mut f: impl FnMut([DVec3; 3])) {
    for (shape, to_world) in scene.placed() {
        let Geometry::Mesh(mesh) = &shape.geometry else { continue };
        let turned = (to_world.matrix3.determinant() < 0.0) != shape.reversed;
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|corner| to_world.transform_point3(mesh.positions[corner as usize]));
            f(if turned { [a, c, b] } else { [a, b, c] });
        }
    }
}

/// The environment map of model scenes. It is computed once, since this takes longer than reading a small model.
static STUDIO: LazyLock<Arc<Image>> = LazyLock::new(|| Arc::new(studio()));

/// Creates the environment map of model scenes: brighter above than below, with a round light over the viewer's left
/// shoulder. z is up, and x points to the viewer.
fn studio() -> Image {
    const SIZE: [u32; 2] = [512, 256];
    const FLOOR: DVec3 = DVec3::new(0.16, 0.15, 0.14);
    const HORIZON: DVec3 = DVec3::new(0.34, 0.34, 0.35);
    const ZENITH: DVec3 = DVec3::new(0.55, 0.60, 0.68);
    const LAMP: DVec3 = DVec3::new(13.0, 12.2, 11.0);
    /// Cosines of the angular radii of the light's outer edge (17 degrees) and of its fully bright part (13 degrees).
    const EDGE: [f64; 2] = [0.956, 0.974];
    let lamp = DVec3::new(0.62, -0.62, 0.72).normalize();
    let mix = |a: DVec3, b: DVec3, [from, to]: [f64; 2], x: f64| {
        let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
        let t = t * t * (3.0 - 2.0 * t);
        a * (1.0 - t) + b * t
    };
    let radiance = |x: u32, y: u32| {
        // The same on every machine, which the standard library's functions aren't.
        let (sin_phi, cos_phi) = libm::sincos((f64::from(x) + 0.5) / f64::from(SIZE[0]) * TAU);
        let (sin_theta, cos_theta) = libm::sincos(0.5 * (f64::from(y) + 0.5) / f64::from(SIZE[1]) * TAU);
        let direction = DVec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta);
        let sky = mix(HORIZON, ZENITH, [0.0, 1.0], cos_theta);
        let room = mix(sky, FLOOR, [0.0, 0.35], -cos_theta);
        mix(room, LAMP, EDGE, direction.dot(lamp)).as_vec3().to_array()
    };
    let pixels = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))).map(|(x, y)| radiance(x, y)).collect();
    Image { size: SIZE, pixels, alpha: Vec::new() }
}

// The direction from which a model is seen.
//
// A bare model is seen from the front, the right and above. A room without a front wall, such as a Cornell box, would show
// the outsides of its walls from there. Small images therefore show the fraction of visible triangles that face away, and the
// first view with few of them is chosen.

/// A view: the direction to the camera, by its components to the front, to the right and up. It is normalized on use.
type View = [f64; 3];

/// The usual view.
const USUAL: View = [1.0, 0.6, 0.45];
/// Other views, in the order of preference.
const OTHERS: [View; 6] =
    [[1.0, 0.0, 0.08], [-1.0, 0.0, 0.08], [0.0, 1.0, 0.08], [0.0, -1.0, 0.08], [1.0, 0.0, 1.2], [-1.0, -0.6, 0.45]];
/// The fraction of back faces among visible ones above which other views are tried.
const ENOUGH: f64 = 0.3;
/// The largest fraction of the usual view's back faces that another view may have.
const BETTER: f64 = 0.5;
/// Width and height of the small images in pixels.
const VIEW: usize = 48;
/// The largest number of triangles drawn; of a larger model, that many evenly spaced triangles are drawn.
const MOST: usize = 300_000;

/// Returns the direction of a view, given the directions to the front, to the right and up.
fn view_direction(view: View, [front, right, up]: [DVec3; 3]) -> DVec3 {
    (view[0] * front + view[1] * right + view[2] * up).normalize()
}

/// Chooses the view of a model with its centre and radius.
fn choose_view(scene: &Scene, axes: [DVec3; 3], centre: DVec3, radius: f64) -> View {
    let usual = back_faces(scene, view_direction(USUAL, axes), axes[2], centre, radius);
    if usual <= ENOUGH {
        return USUAL;
    }
    let others = OTHERS.map(|view| (back_faces(scene, view_direction(view, axes), axes[2], centre, radius), view));
    let better = |best: (f64, View), other: (f64, View)| if other.0 < best.0 { other } else { best };
    others.into_iter().fold((BETTER * usual, USUAL), better).1
}

/// The fraction of pixels that show the back of a triangle, among the pixels that show a triangle.
fn back_faces(scene: &Scene, towards: DVec3, up: DVec3, centre: DVec3, radius: f64) -> f64 {
    let right = (-towards).cross(up).normalize();
    let up = right.cross(-towards);
    let eye = centre + towards * (1.1 * radius / TAN_HALF_FOV);
    let mut total = 0;
    each_triangle(scene, |_| total += 1);
    let (every, mut number) = (total / MOST + 1, 0);
    // Depth, and true for a back face.
    let mut pixels = [(f64::INFINITY, false); VIEW * VIEW];
    each_triangle(scene, |corners| {
        number += 1;
        if number % every != 0 {
            return;
        }
        let back = (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(eye - corners[0]) < 0.0;
        let seen = corners.map(|p| (p - eye).dot(-towards));
        if seen.iter().any(|z| *z <= 0.0) {
            return;
        }
        let at = |k: usize| {
            let p = corners[k] - eye;
            (DVec2::new(p.dot(right), p.dot(up)) / (seen[k] * TAN_HALF_FOV) + 1.0) * (0.5 * VIEW as f64)
        };
        draw(&mut pixels, [at(0), at(1), at(2)], seen, back);
    });
    let shown = pixels.iter().filter(|p| p.0.is_finite()).count();
    pixels.iter().filter(|p| p.1).count() as f64 / shown.max(1) as f64
}

/// Draws a triangle with corners at `at`, in pixels, and depths `depth`. A triangle that covers no pixel's centre is drawn
/// as a point.
fn draw(pixels: &mut [(f64, bool); VIEW * VIEW], at: [DVec2; 3], depth: [f64; 3], back: bool) {
    let mut set = |x: usize, y: usize, z: f64| {
        let pixel = &mut pixels[y * VIEW + x];
        if z < pixel.0 {
            *pixel = (z, back);
        }
    };
    let (low, high) = (at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2]));
    let cell = |v: f64| v.clamp(0.0, VIEW as f64 - 1.0) as usize;
    let area = (at[1] - at[0]).perp_dot(at[2] - at[0]);
    let mut drawn = false;
    if area.abs() > 1e-9 {
        for y in cell(low.y)..=cell(high.y) {
            for x in cell(low.x)..=cell(high.x) {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let share = |k: usize| (at[(k + 1) % 3] - p).perp_dot(at[(k + 2) % 3] - p) / area;
                let shares = [share(0), share(1), share(2)];
                if shares.iter().all(|s| *s >= 0.0) {
                    drawn = true;
                    set(x, y, (0..3).map(|k| shares[k] * depth[k]).sum());
                }
            }
        }
    }
    if !drawn && low.min_element() >= 0.0 && high.max_element() < VIEW as f64 {
        set(cell(at[0].x), cell(at[0].y), depth[0]);
    }
}
