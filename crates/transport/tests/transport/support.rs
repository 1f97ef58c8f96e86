//! Small scenes made by hand, and short ways to render them.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

#[path = "../../../scene/tests/scene/support.rs"]
mod made;

pub use made::*;

use dapple_conformance::statistics::Mean;
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Limits, Render};
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
