//! Roulette and learned light selection change no mean.

use super::code::{ENVIRONMENT, ROULETTE, SEVERAL_LIGHTS};
use super::{FixedSelector, LearnedSelector, LightSelector, NoVertexLight, PathTracer};
use crate::World;
use crate::camera::Pinhole;
use crate::light::LightSelection;
use dapple_core::samplers::Uniform;
use dapple_core::{Frame, Integrator, Limits, Render};
use dapple_low_discrepancy::Sobol;
use dapple_scene::image::Image;
use dapple_scene::{
    Camera, Color, Emission, EnvironmentRadiance, Geometry, Light, LightKind, Material, MaterialId, MaterialKind,
    Projection, Scene, Shape, Source,
};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

const SIZE: u32 = 16;
const SPP: u64 = 64;
const REPLICATES: u64 = 16;

/// Inside a closed ball of albedo .8, with a lamp in it.
fn closed(depth: u32) -> World {
    let mut scene = Scene { max_depth: Some(depth), ..Scene::default() };
    scene.film.resolution = [SIZE; 2];
    scene.camera = Camera { projection: Projection::Perspective { fov: 80.0 }, ..Camera::default() };
    let kind = |rho| MaterialKind::Diffuse { reflectance: Color::Constant([rho; 3]) };
    for (name, rho) in [("wall", 0.8), ("bulb", 0.0)] {
        scene.materials.push(Material::new(name, kind(rho), Source::default()));
    }
    let ball = |radius, at, material| {
        let to_world = DAffine3::from_translation(at);
        Shape::new(Geometry::Sphere { radius }, to_world, MaterialId(material), Source::default())
    };
    scene.shapes.push(ball(1.0, DVec3::ZERO, 0));
    let emission = Some(Emission { radiance: [10.0; 3], two_sided: false });
    scene.shapes.push(Shape { emission, ..ball(0.2, DVec3::new(0.3, 0.5, 0.2), 1) });
    World::new(&scene).unwrap_or_else(|e| panic!("{e}"))
}

/// Mean and squared standard error of the image's halves, left and right, and rays a sample.
fn rendered(mut integrator: impl Integrator) -> ([[f64; 2]; 2], f64) {
    let frame = Frame::new(SIZE, SIZE).expect("not empty");
    let limits = Limits::samples(SPP * frame.pixels() as u64);
    let (mut sums, mut squares, mut rays) = ([0.0; 2], [0.0; 2], 0);
    for seed in 0..REPLICATES {
        let mut sampler = Uniform::new(Sobol::new(400 + seed));
        let film = Render::new(frame, &limits).run(&mut integrator, &mut sampler);
        let film = film.unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(film.record().rejected, 0);
        rays += film.record().rays;
        let mut halves = [0.0; 2];
        for i in 0..frame.pixels() {
            halves[usize::from(i % SIZE as usize >= SIZE as usize / 2)] += film.mean(i)[1];
        }
        (0..2).for_each(|h| {
            sums[h] += halves[h];
            squares[h] += halves[h] * halves[h];
        });
    }
    let n = REPLICATES as f64;
    let of = |h: usize| {
        let mean = sums[h] / n;
        [mean, (squares[h] / n - mean * mean) / (n - 1.0)]
    };
    ([of(0), of(1)], rays as f64 / (SPP as f64 * n) / frame.pixels() as f64)
}

/// In standard errors of the difference, the larger of both halves'.
fn deviation(a: [[f64; 2]; 2], b: [[f64; 2]; 2]) -> f64 {
    (0..2).map(|h| (a[h][0] - b[h][0]).abs() / (a[h][1] + b[h][1]).sqrt()).fold(0.0, f64::max)
}

/// Two tests at 1e-6: Student's t of 15 degrees of freedom stays below 8.
#[test]
fn roulette_changes_no_mean_l13() {
    const CRITICAL: f64 = 8.0;
    let world = closed(24);
    let (with, few) = rendered(PathTracer::<Pinhole, FixedSelector, ROULETTE>::new(&world, NoVertexLight));
    let (without, many) = rendered(PathTracer::<Pinhole, FixedSelector, 0>::new(&world, NoVertexLight));
    assert!(few < 0.8 * many, "roulette ends paths: {few} and {many} rays a sample");
    let found = deviation(with, without);
    assert!(found < CRITICAL, "{found} standard errors: {with:?}, {without:?}");
    // Negative control: what paths of more than 12 events find is missed where they are cut, 7 % by then.
    let (cut, _) = rendered(PathTracer::<Pinhole, FixedSelector, 0>::new(&closed(12), NoVertexLight));
    let found = deviation(cut, with);
    assert!(found > CRITICAL, "{found} standard errors: {cut:?}, {with:?}");
}

/// Inside a closed ball with three lamps of unlike power that fill much of what is seen from some places: light is met by
/// chance as often as it is chosen.
fn three_lamps() -> World {
    let mut scene = Scene { max_depth: Some(3), ..Scene::default() };
    scene.film.resolution = [SIZE; 2];
    scene.camera = Camera { projection: Projection::Perspective { fov: 80.0 }, ..Camera::default() };
    let kind = |rho| MaterialKind::Diffuse { reflectance: Color::Constant([rho; 3]) };
    for (name, rho) in [("wall", 0.5), ("bulb", 0.0)] {
        scene.materials.push(Material::new(name, kind(rho), Source::default()));
    }
    let ball = |radius, at, material| {
        let to_world = DAffine3::from_translation(at);
        Shape::new(Geometry::Sphere { radius }, to_world, MaterialId(material), Source::default())
    };
    scene.shapes.push(ball(1.0, DVec3::ZERO, 0));
    for (radius, at, radiance) in
        [(0.3, [0.5, 0.4, 0.3], 1.0), (0.15, [-0.7, 0.3, 0.3], 3.0), (0.25, [0.1, -0.6, 0.4], 0.4)]
    {
        let emission = Some(Emission { radiance: [radiance; 3], two_sided: false });
        scene.shapes.push(Shape { emission, ..ball(radius, DVec3::from(at), 1) });
    }
    let mut world = World::new(&scene).unwrap_or_else(|e| panic!("{e}"));
    world.set_light_selection(LightSelection::Learned);
    world
}

/// Two balls, the nearer in the light of an image that is bright on a side and black on another.
fn under_a_sky() -> World {
    let mut scene = Scene { max_depth: Some(3), ..Scene::default() };
    scene.film.resolution = [SIZE; 2];
    scene.camera = Camera { projection: Projection::Perspective { fov: 50.0 }, ..Camera::default() };
    let kind = MaterialKind::Diffuse { reflectance: Color::Constant([0.7; 3]) };
    scene.materials.push(Material::new("ball", kind, Source::default()));
    for (radius, at) in [(0.6, [0.2, 0.0, 1.6]), (0.9, [-0.8, 0.3, 3.0])] {
        let to_world = DAffine3::from_translation(DVec3::from(at));
        scene.shapes.push(Shape::new(Geometry::Sphere { radius }, to_world, MaterialId(0), Source::default()));
    }
    let value = |i: u32| match i % 16 {
        0..3 => 0.0,
        3..6 => 4.0,
        _ => 0.1 + 0.2 * (i / 16) as f32,
    };
    let image = Image::new([16, 8], (0..128).map(|i| [value(i); 3]).collect()).expect("as many");
    let radiance = EnvironmentRadiance::LatLong { image: Arc::new(image), scale: 1.0 };
    let kind = LightKind::Infinite { radiance };
    scene.lights.push(Light { kind, to_world: DAffine3::IDENTITY, source: Source::default() });
    let mut world = World::new(&scene).unwrap_or_else(|e| panic!("{e}"));
    world.set_light_selection(LightSelection::Learned);
    world
}

#[test]
fn learned_selection_of_lights_changes_no_mean() {
    changes_no_mean::<SEVERAL_LIGHTS>(&three_lamps());
}

#[test]
fn learned_selection_of_an_environment_maps_tiles_changes_no_mean() {
    changes_no_mean::<{ SEVERAL_LIGHTS | ENVIRONMENT }>(&under_a_sky());
}

fn changes_no_mean<const CODE: u32>(world: &World) {
    const CRITICAL: f64 = 8.0;
    let (by_power, _) = rendered(PathTracer::<Pinhole, FixedSelector, CODE>::new(world, NoVertexLight));
    let learning = || PathTracer::<Pinhole, LearnedSelector, CODE>::new(world, NoVertexLight);
    assert!(learning().selector.wants_training());
    let (learned, _) = rendered(learning());
    let found = deviation(by_power, learned);
    assert!(found < CRITICAL, "{found} standard errors: {by_power:?}, {learned:?}");
    // Negative control: light met by chance weighted with the wrong probability.
    let mut forgetful = learning();
    forgetful.selector.forgets = true;
    let (wrong, _) = rendered(forgetful);
    let found = deviation(by_power, wrong);
    assert!(found > CRITICAL, "{found} standard errors: {by_power:?}, {wrong:?}");
}

/// A ball above a floor, in empty space: one pixel that shows the point of the floor below the ball.
fn ball_over_a_floor() -> World {
    let mut scene = Scene::default();
    scene.film.resolution = [1; 2];
    // Looks down from the side onto the point of the floor below the ball.
    let eye = DVec3::new(3.0, 0.0, 0.5);
    let forward = -eye.normalize();
    let right = DVec3::Y.cross(forward).normalize_or_zero();
    let up = forward.cross(right);
    let to_world = DAffine3 { matrix3: glam::DMat3::from_cols(right, up, forward), translation: eye };
    scene.camera = Camera { projection: Projection::Perspective { fov: 0.01 }, to_world, ..Camera::default() };
    let kind = MaterialKind::Diffuse { reflectance: Color::Constant([0.5; 3]) };
    scene.materials.push(Material::new("clay", kind, Source::default()));
    let disk = Geometry::Disk { height: 0.0, radius: 50.0, inner_radius: 0.0 };
    scene.shapes.push(Shape::new(disk, DAffine3::IDENTITY, MaterialId(0), Source::default()));
    let to_world = DAffine3::from_translation(DVec3::Z * 2.0);
    scene.shapes.push(Shape::new(Geometry::Sphere { radius: 1.0 }, to_world, MaterialId(0), Source::default()));
    World::new(&scene).unwrap_or_else(|e| panic!("{e}"))
}

/// A sphere of radius r at height h hides (r / h)^2 of the hemisphere of the point below, cosine-weighted: its form factor.
#[test]
fn ambient_occlusion_below_a_sphere_is_one_minus_its_form_factor() {
    const SAMPLES: u64 = 1 << 14;
    let world = ball_over_a_floor();
    let share = |request: &str| {
        let mut integrator = super::make(request, &world).unwrap_or_else(|e| panic!("{e}"));
        let frame = Frame::new(1, 1).expect("not empty");
        let mut sampler = Uniform::new(Sobol::new(5));
        let limits = Limits::samples(SAMPLES);
        let film = Render::new(frame, &limits).run(&mut *integrator, &mut sampler);
        film.unwrap_or_else(|e| panic!("{e}")).mean(0)[1]
    };
    // Sobol' points: far below the 0.0034 of as many random ones.
    assert!((share("ambient-occlusion") - 0.75).abs() < 1e-3, "{}", share("ambient-occlusion"));
    // Nothing is closer than the sphere's lowest point.
    assert_eq!(share("ambient-occlusion:distance=0.99"), 1.0);
    // A furnace: every direction inside of a closed ball is occluded.
    let inside = closed(1);
    let mut integrator = super::AmbientOcclusion::new(&inside, f64::INFINITY);
    let frame = Frame::new(SIZE, SIZE).expect("not empty");
    let limits = Limits::samples(4 * frame.pixels() as u64);
    let mut sampler = Uniform::new(Sobol::new(6));
    let film = Render::new(frame, &limits).run(&mut integrator, &mut sampler);
    let film = film.unwrap_or_else(|e| panic!("{e}"));
    assert!((0..frame.pixels()).all(|pixel| film.mean(pixel) == [0.0; 3]));
}

/// The effects of a scene call for all code that its world uses: a form without it would lose light in silence.
#[test]
fn effects_call_for_all_code_that_a_world_uses() {
    for name in dapple_scene::bundled::names() {
        let scene = dapple_scene::bundled::files(name).expect("bundled").read().expect("it reads");
        let world = World::new(&scene).unwrap_or_else(|e| panic!("{name}: {e}"));
        let needed = super::code::needed(&world);
        let uses = |used: bool, bit: u32| assert!(!used || needed & bit != 0, "{name}: {needed:b} lacks {bit:b}");
        uses(world.lights.len() > 1, SEVERAL_LIGHTS);
        uses(world.lights.has_environment(), ENVIRONMENT);
        uses(world.moves || world.has_passable_surfaces(), super::code::RARE);
    }
}
