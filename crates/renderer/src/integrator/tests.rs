//! Tests that roulette and learned light selection leave means unchanged, and that ambient occlusion has its closed form.

use super::code::{ENVIRONMENT, ROULETTE, SEVERAL_LIGHTS};
use super::{AmbientOcclusion, FixedSelector, LearnedSelector, LightSelector, NoVertexLight, PathTracer};
use crate::camera::Pinhole;
use crate::light::LightSelection;
use crate::support::*;

/// Returns a world inside a closed sphere of albedo `rho` with spherical lights, each given by radius, position and radiance.
fn closed(rho: f32, depth: u32, lamps: &[(f64, [f64; 3], f32)]) -> World {
    let mut scene = scene([16; 2], 80.0, DVec3::ZERO, DVec3::Z);
    scene.max_depth = Some(depth);
    let [wall, bulb] = [rho, 0.0].map(|rho| add_material(&mut scene, diffuse(rho)));
    ball(&mut scene, DVec3::ZERO, 1.0, wall, None);
    for &(radius, at, radiance) in lamps {
        ball(&mut scene, DVec3::from(at), radius, bulb, Some(radiance));
    }
    world(&scene)
}

/// Returns the mean radiance of the image's left and right half over 16 seeds, and the number of rays per sample.
fn rendered(mut integrator: impl Integrator) -> ([Mean; 2], f64) {
    let frame = Frame::new(16, 16).expect("not empty");
    let limits = Limits::samples(64 * frame.pixels() as u64);
    let mut film = |seed| {
        let film = Render::new(frame, &limits).run(&mut integrator, &mut Uniform::new(Sobol::new(seed)));
        film.unwrap_or_else(|e| panic!("{e}"))
    };
    let films: Vec<Film> = (400..416).map(&mut film).collect();
    assert!(films.iter().all(|film| film.record().rejected == 0));
    let sum = |film: &Film, half: usize| (0..256).filter(|i| i % 16 / 8 == half).map(|i| film.mean(i)[1]).sum();
    let rays = films.iter().map(|film| film.record().rays as f64 / film.record().samples as f64).sum::<f64>();
    ([0, 1].map(|half| films.iter().map(|film| sum(film, half)).collect()), rays / films.len() as f64)
}

/// Asserts that two images agree and that a third, the negative control, differs: two tests at a level of 1e-6, for which
/// Student's t with 15 degrees of freedom stays below 8.
fn assert_alike(one: [Mean; 2], other: [Mean; 2], control: [Mean; 2]) {
    let [found, wrong] =
        [other, control].map(|b| (0..2).map(|h| one[h].against_estimate(&b[h]).t().abs()).fold(0.0, f64::max));
    assert!(found < 8.0 && wrong > 8.0, "{found} standard errors, {wrong} of the control: {one:?}, {other:?}");
}

/// Negative control: cutting paths at 12 scattering events loses 7 % of the light.
#[test]
fn roulette_changes_no_mean_l13() {
    let [long, short] = [24, 12].map(|depth| closed(0.8, depth, &[(0.2, [0.3, 0.5, 0.2], 10.0)]));
    let (with, few) = rendered(PathTracer::<Pinhole, FixedSelector, ROULETTE>::new(&long, NoVertexLight));
    let (without, many) = rendered(PathTracer::<Pinhole, FixedSelector, 0>::new(&long, NoVertexLight));
    assert!(few < 0.8 * many, "roulette ends paths: {few} and {many} rays a sample");
    let (cut, _) = rendered(PathTracer::<Pinhole, FixedSelector, 0>::new(&short, NoVertexLight));
    assert_alike(with, without, cut);
}

/// Negative control: light found by BSDF sampling is weighted with the wrong probability.
fn learning_changes_no_mean<const CODE: u32>(mut world: World) {
    world.set_light_selection(LightSelection::Learned);
    let learning = || PathTracer::<Pinhole, LearnedSelector, CODE>::new(&world, NoVertexLight);
    assert!(learning().selector.wants_training());
    let mut forgetful = learning();
    forgetful.selector.forgets = true;
    let (by_power, _) = rendered(PathTracer::<Pinhole, FixedSelector, CODE>::new(&world, NoVertexLight));
    assert_alike(by_power, rendered(learning()).0, rendered(forgetful).0);
}

/// Three lights of different power that fill much of the view from some points, so that BSDF sampling finds them as often as
/// light sampling.
#[test]
fn learned_selection_of_lights_changes_no_mean() {
    let lamps = [(0.3, [0.5, 0.4, 0.3], 1.0), (0.15, [-0.7, 0.3, 0.3], 3.0), (0.25, [0.1, -0.6, 0.4], 0.4)];
    learning_changes_no_mean::<SEVERAL_LIGHTS>(closed(0.5, 3, &lamps));
}

/// Two spheres in an environment map that is bright on one side and black on the other.
#[test]
fn learned_selection_of_an_environment_maps_tiles_changes_no_mean() {
    let mut scene = scene([16; 2], 50.0, DVec3::ZERO, DVec3::Z);
    scene.max_depth = Some(3);
    let grey = add_material(&mut scene, diffuse(0.7));
    ball(&mut scene, DVec3::new(0.2, 0.0, 1.6), 0.6, grey, None);
    ball(&mut scene, DVec3::new(-0.8, 0.3, 3.0), 0.9, grey, None);
    let radiance = lat_long([16, 8], |x, y| match x {
        0..3 => 0.0,
        3..6 => 8.0,
        _ => 0.2 + 0.4 * y as f32,
    });
    add_light(&mut scene, LightKind::Infinite { radiance }, DAffine3::IDENTITY);
    learning_changes_no_mean::<{ SEVERAL_LIGHTS | ENVIRONMENT }>(world(&scene));
}

/// A sphere of radius r at height h hides (r / h)^2 of the cosine-weighted hemisphere of the point below: its form factor.
#[test]
fn ambient_occlusion_below_a_sphere_is_one_minus_its_form_factor() {
    // The only pixel shows the point of the floor below the sphere.
    let mut scene = scene([1; 2], 0.01, DVec3::new(3.0, 0.0, 0.5), DVec3::ZERO);
    let clay = add_material(&mut scene, diffuse(0.5));
    let disk = Geometry::Disk { height: 0.0, radius: 50.0, inner_radius: 0.0 };
    add(&mut scene, disk, DAffine3::IDENTITY, clay, None);
    ball(&mut scene, DVec3::Z * 2.0, 1.0, clay, None);
    let world = world(&scene);
    let mean = |integrator: &mut dyn Integrator, spp: u64| {
        let limits = Limits::samples(spp);
        let film =
            Render::new(Frame::new(1, 1).expect("a frame"), &limits).run(integrator, &mut Uniform::new(Sobol::new(5)));
        film.unwrap_or_else(|e| panic!("{e}")).mean(0)[1]
    };
    let share = |request: &str| mean(&mut *super::make(request, &world).unwrap_or_else(|e| panic!("{e}")), 1 << 14);
    // The error of Sobol' points is far below the 0.0034 of as many random points.
    assert!((share("ambient-occlusion") - 0.75).abs() < 1e-3, "{}", share("ambient-occlusion"));
    // Nothing is closer than the sphere's lowest point.
    assert_eq!(share("ambient-occlusion:distance=0.99"), 1.0);
    // Inside a closed sphere, every direction is occluded.
    assert_eq!(mean(&mut AmbientOcclusion::new(&closed(0.8, 1, &[]), f64::INFINITY), 1024), 0.0);
}

/// The effects of a scene select all code that its world uses. A path tracer without that code would lose light silently.
#[test]
fn effects_call_for_all_code_that_a_world_uses() {
    for name in bundled::names() {
        let world = world(&bundle(name));
        let needed = super::code::needed(&world);
        let uses = |used: bool, bit: u32| assert!(!used || needed & bit != 0, "{name}: {needed:b} lacks {bit:b}");
        uses(world.lights.len() > 1, SEVERAL_LIGHTS);
        uses(world.lights.has_environment(), ENVIRONMENT);
        uses(world.moves || world.has_passable_surfaces, super::code::RARE);
    }
}
