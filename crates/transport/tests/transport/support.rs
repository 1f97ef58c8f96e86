//! Small scenes made by hand, and short ways to render them.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

#[path = "../../../scene/tests/scene/support.rs"]
mod made;

pub use made::*;

use dapple_conformance::bits;
use dapple_conformance::statistics::Mean;
use dapple_core::samplers::Uniform;
use dapple_core::{Control, Film, Frame, Limits, Monitor, Render, Snapshot, Status};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::World;
use dapple_scene::{Color, Emission, Geometry, MaterialId, MaterialKind, Roughness, Scene, Shape};
use dapple_transport::make_integrator;
use glam::{DAffine3, DVec3};

/// The film of `spp` Sobol' samples in every pixel.
pub fn film(world: &World, integrator: &str, [width, height]: [u32; 2], spp: u64, seed: u64) -> Film {
    let mut integrator = make_integrator(integrator, world).expect("an integrator");
    let frame = Frame::new(width, height).expect("a frame");
    let limits = Limits::samples(spp * u64::from(width * height));
    Render::new(frame, &limits).run(&mut *integrator, &mut Uniform::new(Sobol::new(seed))).expect("a film")
}

/// The mean of all pixels of some films, in green, one value for each seed.
pub fn means(scene: &Scene, integrator: &str, spp: u64, seeds: std::ops::Range<u64>) -> Mean {
    let world = World::new(scene).expect("a world");
    let size = scene.film.resolution;
    seeds.map(|seed| mean_of(&film(&world, integrator, size, spp, seed))).collect()
}

pub fn mean_of(film: &Film) -> f64 {
    let pixels = film.frame().pixels();
    (0..pixels).map(|i| film.mean(i)[1]).sum::<f64>() / pixels as f64
}

/// Keeps a snapshot of every slice.
#[derive(Default)]
struct Keeper(Vec<Vec<u8>>);

impl Monitor for Keeper {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        self.0.push(status.snapshot());
        Control::Continue
    }
}

/// Requires the same bits of 5 spp in 48x40 pixels from one to three threads, resumed after each slice and not. Returns the
/// film.
pub fn with_the_same_bits_on_any_threads_and_resumed(scene: &Scene, request: &str) -> Film {
    let world = World::with_resolution(scene, [48, 40]).expect("a world");
    let (frame, limits) = (Frame::new(48, 40).expect("a frame"), Limits::samples(5 * 48 * 40));
    let render = |threads: usize, from: Option<Snapshot>, keeper: &mut Keeper| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let run = || {
            let mut integrator = make_integrator(request, &world).expect("an integrator");
            let (render, mut sampler) = (Render::new(frame, &limits).monitor(keeper), Uniform::new(Sobol::new(3)));
            match from {
                Some(snapshot) => render.resume(snapshot, &mut *integrator, &mut sampler),
                None => render.run(&mut *integrator, &mut sampler),
            }
        };
        pool.install(run).expect("a film")
    };
    let mut keeper = Keeper::default();
    let whole = render(2, None, &mut keeper);
    assert!(whole.record().prepare_rays > 5000);
    let snapshots: Vec<_> = keeper.0.iter().map(|bytes| Snapshot::from_bytes(bytes).expect("a snapshot")).collect();
    let within = |snapshot: &Snapshot| !snapshot.film().record().samples.is_multiple_of(48 * 40);
    assert!(snapshots.iter().any(within), "a slice ends within a pass");
    for (i, snapshot) in snapshots.into_iter().enumerate() {
        let film = render(1 + i % 3, Some(snapshot), &mut Keeper::default());
        assert!(bits(&film) == bits(&whole), "{request}, slice {i}");
    }
    for threads in [1, 3] {
        assert!(bits(&render(threads, None, &mut Keeper::default())) == bits(&whole), "{request}, {threads} threads");
    }
    whole
}

/// Clear glass of this index of refraction.
pub fn glass(eta: f32) -> MaterialKind {
    let [reflectance, transmittance] = [Color::Constant([1.0; 3]); 2];
    MaterialKind::Dielectric { eta, roughness: Roughness::constant(0.0, 0.0, false), reflectance, transmittance }
}

/// Adds a sphere.
pub fn add_sphere(scene: &mut Scene, centre: DVec3, radius: f64, material: MaterialId, radiance: f32) {
    let number = scene.shapes.len() as u32;
    let emission = (radiance > 0.0).then_some(Emission { radiance: [radiance; 3], two_sided: false });
    let shape =
        Shape::new(Geometry::Sphere { radius }, DAffine3::from_translation(centre), material, line(10 + number));
    scene.shapes.push(Shape { emission, ..shape });
}
