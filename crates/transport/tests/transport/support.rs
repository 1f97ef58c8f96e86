//! Small scenes made by hand, and short ways to render them.
#![allow(dead_code, unreachable_pub, unused_imports, reason = "each test file uses its own part")]

#[path = "../../../scene/tests/scene/support.rs"]
mod built;

pub use built::*;
pub use dapple_conformance::bits;
pub use dapple_conformance::statistics::{FAMILY, Mean, critical, images, sidak};
pub use dapple_core::point_set::streams;
pub use dapple_core::render::{Control, Monitor, Status};
pub use dapple_core::samplers::Uniform;
pub use dapple_core::{Draws, Film, Frame, Integrator, Limits, Needs, Render, SampleId, Snapshot, Worker};
pub use dapple_low_discrepancy::Sobol;
pub use dapple_renderer::{World, integrator};
pub use dapple_scene::*;
pub use dapple_transport::make_integrator;
pub use glam::{DAffine3, DMat3, DVec3, Vec3};

/// Returns `long` if `DAPPLE_THOROUGH` is set, else `short`.
pub fn thorough<T>(short: T, long: T) -> T {
    if std::env::var_os("DAPPLE_THOROUGH").is_some() { long } else { short }
}

pub fn world(scene: &Scene) -> World {
    World::new(scene).unwrap_or_else(|e| panic!("{e}"))
}

pub fn bundle(name: &str, size: [u32; 2]) -> World {
    let scene = bundled::files(name).expect("bundled").read().unwrap_or_else(|e| panic!("{name}: {e}"));
    World::with_resolution(&scene, size).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Returns the integrator of a request.
pub fn made<'w>(request: &str, world: &'w World) -> Box<dyn Integrator + 'w> {
    make_integrator(request, world).unwrap_or_else(|e| panic!("{e}"))
}

/// Renders `spp` Sobol' samples in every pixel.
pub fn film_by(integrator: &mut dyn Integrator, [width, height]: [u32; 2], spp: u64, seed: u64) -> Film {
    let frame = Frame::new(width, height).expect("a frame");
    let limits = Limits::samples(spp * u64::from(width * height));
    let render = Render::new(frame, &limits).needs(Needs::none().with_splats());
    let film = render.run(integrator, &mut Uniform::new(Sobol::new(seed))).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(film.record().rejected, 0);
    film
}

pub fn film(world: &World, request: &str, size: [u32; 2], spp: u64, seed: u64) -> Film {
    film_by(&mut *made(request, world), size, spp, seed)
}

/// Returns the mean over all pixels in the green channel, with one value per seed.
pub fn means_by(integrator: &mut dyn Integrator, size: [u32; 2], spp: u64, seeds: impl Iterator<Item = u64>) -> Mean {
    seeds.map(|seed| mean_of(&film_by(integrator, size, spp, seed))).collect()
}

pub fn means(scene: &Scene, request: &str, spp: u64, seeds: std::ops::Range<u64>) -> Mean {
    let world = world(scene);
    seeds.map(|seed| mean_of(&film(&world, request, scene.film.resolution, spp, seed))).collect()
}

pub fn pixels(film: &Film) -> Vec<[f64; 3]> {
    (0..film.frame().pixels()).map(|i| film.mean(i)).collect()
}

pub fn mean_of(film: &Film) -> f64 {
    pixels(film).iter().map(|p| p[1]).collect::<Mean>().mean
}

/// Asserts that the relative difference of two means is at most `tolerance`, and that the noise is below `noise`. All tests
/// together exceed 5.5 standard errors once in 10^6 runs.
pub fn assert_near(name: &str, found: &Mean, expected: &Mean, tolerance: f64, noise: f64) {
    let bias = found.mean / expected.mean - 1.0;
    let error = found.standard_error().hypot(expected.standard_error()) / expected.mean;
    assert!(bias.abs() < tolerance + 5.5 * error && error < noise, "{name}: {bias:+.5} +- {error:.5}");
}

/// A mean without error.
pub fn exactly(mean: f64) -> Mean {
    [mean; 2].into_iter().collect()
}

/// A diffuse room with a lamp below the ceiling, a sphere on the floor, and one wall of this material.
pub fn chamber(wall: MaterialKind) -> Scene {
    let mut scene = scene([12, 12], 60.0, DVec3::new(0.0, -0.9, 0.2), DVec3::new(0.0, 0.5, -0.2));
    let grey = add_material(&mut scene, diffuse(0.6));
    let other = add_material(&mut scene, wall);
    scene.max_depth = Some(6);
    add_walls(&mut scene, |centre| if centre == DVec3::X { other } else { grey }, None);
    add(&mut scene, rectangle(0.98 * DVec3::Z, 0.3 * DVec3::Y, 0.3 * DVec3::X), DAffine3::IDENTITY, grey, Some(10.0));
    add_sphere(&mut scene, DVec3::new(-0.3, 0.4, -0.6), 0.4, grey, 0.0);
    scene
}

/// The inside of the cube `[-1, 1]^3`.
pub fn add_walls(scene: &mut Scene, material: impl Fn(DVec3) -> MaterialId, shines: Option<f32>) {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    for (centre, u, v) in [(-z, x, y), (z, y, x), (y, x, z), (-y, z, x), (-x, y, z), (x, z, y)] {
        add(scene, rectangle(centre, u, v), DAffine3::IDENTITY, material(centre), shines);
    }
}

/// Returns the inside of a sphere or cube with albedo `rho` and emission 1, and its radiance.
pub fn furnace(rho: f32, depth: Option<u32>, is_cubic: bool) -> (Scene, Mean) {
    let mut scene = scene([8, 8], 70.0, DVec3::new(0.2, 0.3, -0.1), DVec3::new(-0.9, 0.5, 0.4));
    let wall = add_material(&mut scene, diffuse(rho));
    scene.max_depth = depth;
    if is_cubic {
        add_walls(&mut scene, |_| wall, Some(1.0));
    } else {
        add_sphere(&mut scene, DVec3::ZERO, 1.0, wall, 1.0);
        scene.shapes[0].reversed = true;
    }
    let rho = f64::from(rho);
    let lost = depth.map_or(0.0, |depth| rho.powi(depth as i32 + 1));
    (scene, exactly((1.0 - lost) / (1.0 - rho)))
}

/// Asserts that one and three threads give bit-identical results.
pub fn assert_same_bits_on_threads(world: &World, request: &str, size: [u32; 2]) {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        bits(&pool.install(|| film(world, request, size, 5, 2)))
    };
    assert!(on(1) == on(3), "{request}");
}

/// Asserts that one to three threads give bit-identical films of 5 spp in 48x40 pixels, with and without a resume after each
/// slice. Returns the film, and the numbers of samples after which it was resumed.
pub fn with_the_same_bits_on_any_threads_and_resumed(scene: &Scene, request: &str) -> (Film, Vec<u64>) {
    let world = World::with_resolution(scene, [48, 40]).unwrap_or_else(|e| panic!("{e}"));
    let (frame, limits) = (Frame::new(48, 40).expect("a frame"), Limits::samples(5 * 48 * 40));
    let render = |threads: usize, from: Option<Snapshot>, kept: &mut Vec<Vec<u8>>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let mut keep = |status: &Status<'_>| {
            kept.push(status.snapshot());
            Control::Continue
        };
        let run = || {
            let (mut integrator, mut sampler) = (made(request, &world), Uniform::new(Sobol::new(3)));
            let render = Render::new(frame, &limits).monitor(&mut keep);
            match from {
                Some(snapshot) => render.resume(snapshot, &mut *integrator, &mut sampler),
                None => render.run(&mut *integrator, &mut sampler),
            }
        };
        pool.install(run).expect("a film")
    };
    let mut kept = Vec::new();
    let whole = render(2, None, &mut kept);
    assert!(pixels(&whole).iter().all(|p| p[1] >= 0.0) && mean_of(&whole) > 0.0, "{request}");
    let snapshots: Vec<_> = kept.iter().map(|bytes| Snapshot::from_bytes(bytes).expect("a snapshot")).collect();
    let samples: Vec<u64> = snapshots.iter().map(|snapshot| snapshot.film().record().samples).collect();
    for (i, snapshot) in snapshots.into_iter().enumerate() {
        assert!(bits(&render(1 + i % 3, Some(snapshot), &mut Vec::new())) == bits(&whole), "{request}, slice {i}");
    }
    for threads in [1, 3] {
        assert!(bits(&render(threads, None, &mut Vec::new())) == bits(&whole), "{request}, {threads} threads");
    }
    assert!(samples.iter().any(|samples| *samples < 5 * 48 * 40), "{request}: no slice ends before the whole");
    (whole, samples)
}

/// Clear glass of this index of refraction.
pub fn glass(eta: f32) -> MaterialKind {
    let [reflectance, transmittance] = [Color::Constant([1.0; 3]); 2];
    MaterialKind::Dielectric { eta, roughness: Roughness::constant(0.0, 0.0, false), reflectance, transmittance }
}

/// Adds a sphere.
pub fn add_sphere(scene: &mut Scene, centre: DVec3, radius: f64, material: MaterialId, radiance: f32) {
    let shines = (radiance > 0.0).then_some(radiance);
    add(scene, Geometry::Sphere { radius }, DAffine3::from_translation(centre), material, shines);
}
