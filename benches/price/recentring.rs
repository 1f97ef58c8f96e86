//! Recentring: scenes are moved to the origin and scaled in f64, before conversion to f32.

use super::image::scene;
use super::pairs::{in_turn, of_whole, pairs, seconds};
use super::{Break, Effort, Error, Result, Row};
use dapple_geometry::{Disk, Geometry, Mesh, Ray, Shape, Sphere};
use dapple_renderer::{Space, World};
use dapple_scene::{Geometry as Described, Scene};
use glam::{DAffine3, DVec3, Vec2, Vec3};

/// The scene of the timing: half a million corners.
const LOADED: &str = "terrain";
/// The scene that is moved away.
const MOVED: &str = "teapot";

pub(crate) fn row(effort: Effort) -> Result<Row> {
    let count = match effort {
        Effort::Quick => 6,
        Effort::Full => 11,
    };
    let loaded = scene(LOADED)?;
    let price = pairs(count, |number| {
        let [with, without] = in_turn(
            number,
            || Ok::<_, Error>(seconds(|| recentred(&loaded))),
            || Ok(seconds(|| as_they_are(&loaded))),
        )?;
        let whole = seconds(|| World::with_resolution(&loaded, [16; 2]).map(|world| world.geometry().triangle_count()));
        Ok::<_, Error>(of_whole(whole, with - without))
    })?;
    Ok(Row {
        safeguard: "recentring",
        does: "scenes are moved to the origin and scaled by a power of two in f64, before they become f32",
        price,
        price_of: format!("making {LOADED} ready for rays, once; no ray is slower"),
        breaks: vec![broken(&scene(MOVED)?)?],
    })
}

/// The corners of all meshes in the renderer's space.
fn recentred(scene: &Scene) -> Vec<Vec3> {
    let space = Space::of(scene);
    corners(scene, |p| space.point(p).as_vec3())
}

/// The corners of all meshes in the file's space.
fn as_they_are(scene: &Scene) -> Vec<Vec3> {
    corners(scene, |p| p.as_vec3())
}

fn corners(scene: &Scene, to_f32: impl Fn(DVec3) -> Vec3) -> Vec<Vec3> {
    let mut all = Vec::new();
    for shape in &scene.shapes {
        if let Described::Mesh(mesh) = &shape.geometry {
            all.extend(mesh.positions.iter().map(|p| to_f32(shape.to_world.transform_point3(*p))));
        }
    }
    all
}

const SIDE: u32 = 64;

/// The distance from which more than one in a hundred pixels sees something else, in powers of ten.
fn broken(scene: &Scene) -> Result<Break> {
    let wrong = |e: dapple_renderer::WorldError| Error::Scene { name: MOVED, why: e.to_string() };
    let near = World::with_resolution(scene, [SIDE; 2]).map_err(wrong)?;
    let rays = camera_rays(&near);
    let near_raw = geometry(scene)?;
    let (seen, seen_raw) = (seen(near.geometry(), &rays), seen(&near_raw, &in_the_file(&near, &rays)));
    let pixels = rays.len();
    let [low, high] = near.geometry().bounds().unwrap_or([Vec3::ZERO; 2]);
    let width = f64::from((high - low).max_element()) / near.space().scale();
    let mut found = (0, 0, 0);
    for power in 3..=8 {
        let scene = moved(scene, DVec3::new(1.0, -0.6, 0.8) * 10.0_f64.powi(power));
        let far = World::with_resolution(&scene, [SIDE; 2]).map_err(wrong)?;
        let rays = camera_rays(&far);
        let with = differ(&seen, &self::seen(far.geometry(), &rays));
        let without = differ(&seen_raw, &self::seen(&geometry(&scene)?, &in_the_file(&far, &rays)));
        found = (power, without, with);
        if without * 100 > pixels {
            break;
        }
    }
    let (power, without, with) = found;
    Ok(Break {
        input: format!("{MOVED} ({width:.0} wide), 10^{power} from the origin: primary rays that see another triangle"),
        seen: "walls crumble and holes open in scenes with the coordinates of maps",
        of: pixels as u64,
        without: without as u64,
        with: with as u64,
    })
}

/// The scene, moved.
fn moved(scene: &Scene, by: DVec3) -> Scene {
    let by = DAffine3::from_translation(by);
    let mut scene = scene.clone();
    scene.shapes.iter_mut().for_each(|shape| shape.to_world = by * shape.to_world);
    scene.camera.to_world = by * scene.camera.to_world;
    scene
}

fn camera_rays(world: &World) -> Vec<Ray> {
    let pixels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| [x, y]));
    pixels.map(|pixel| world.camera().ray(pixel, Vec2::ZERO, [0.5; 2])).collect()
}

/// Rays of the renderer's space in the file's, as in a renderer without recentring.
fn in_the_file(world: &World, rays: &[Ray]) -> Vec<Ray> {
    let origin = |ray: &Ray| DVec3::from_array(world.space().world(ray.origin.to_array())).as_vec3();
    rays.iter().map(|ray| Ray::new(origin(ray), ray.direction)).collect()
}

/// The scene's shapes in f32 in the file's space.
fn geometry(scene: &Scene) -> Result<Geometry> {
    let mut shapes = Vec::with_capacity(scene.shapes.len());
    for shape in &scene.shapes {
        let to_world = shape.to_world;
        shapes.push(match &shape.geometry {
            Described::Mesh(mesh) => {
                let corners = mesh.positions.iter().map(|p| to_world.transform_point3(*p).as_vec3().to_array());
                Shape::from(Mesh::new(corners.collect(), mesh.triangles.clone())?)
            }
            Described::Sphere { radius } => Shape::from(Sphere::transformed(to_world, *radius)?),
            Described::Disk { height, radius, inner_radius } => {
                Shape::from(Disk::transformed(to_world, *height, *radius, *inner_radius)?)
            }
        });
    }
    Ok(Geometry::build(shapes)?)
}

/// The hit of each ray.
fn seen(geometry: &Geometry, rays: &[Ray]) -> Vec<Option<(u32, u32)>> {
    rays.iter().map(|ray| geometry.closest(ray).map(|hit| (hit.shape, hit.primitive))).collect()
}

fn differ<T: PartialEq>(a: &[T], b: &[T]) -> usize {
    a.iter().zip(b).filter(|(a, b)| a != b).count()
}
