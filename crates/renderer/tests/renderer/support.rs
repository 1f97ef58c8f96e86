//! Small scenes made by hand, short ways to render them, and the names that most tests use.
#![allow(dead_code, unreachable_pub, unused_imports)]

#[path = "../../../scene/tests/scene/support.rs"]
mod made;

pub use dapple_conformance::statistics::{FAMILY, Mean, Verdict, chi_square, critical, images, integrate, sidak};
pub use dapple_core::limits::Schedule;
pub use dapple_core::point_set::streams;
pub use dapple_core::samplers::Uniform;
pub use dapple_core::{Draws, Film, Frame, Integrator, Limits, Needs, PointSet, Render, SampleId, Sampler, Worker};
pub use dapple_low_discrepancy::{Random, Sobol};
pub use dapple_renderer::{World, blocks, integrator};
pub use dapple_scene::image::Image;
pub use dapple_scene::*;
pub use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};
pub use made::*;
pub use rand::{RngExt, SeedableRng};
pub use rand_pcg::Pcg32;
pub use std::f64::consts::{PI, TAU};
pub use std::sync::Arc;

/// The largest number below 1.
pub const BELOW_ONE: f32 = 1.0 - 0.5 * f32::EPSILON;

/// Returns `long` if `DAPPLE_THOROUGH` is set, else `short`.
pub fn thorough<T>(short: T, long: T) -> T {
    if std::env::var_os("DAPPLE_THOROUGH").is_some() { long } else { short }
}

/// Returns the world of a scene; panics with the problems if the scene is invalid.
pub fn world(scene: &Scene) -> World {
    World::new(scene).unwrap_or_else(|e| panic!("{e}"))
}

/// Returns the problems of an invalid scene; empty for a valid one.
pub fn refusal(scene: &Scene) -> String {
    World::new(scene).err().map(|e| e.to_string()).unwrap_or_default()
}

pub fn bundle(name: &str) -> Scene {
    bundled::files(name).expect("bundled").read().unwrap_or_else(|e| panic!("{name}: {e}"))
}

pub fn small(scene: &Scene, size: [u32; 2]) -> World {
    World::with_resolution(scene, size).unwrap_or_else(|e| panic!("{}: {e}", scene.name))
}

pub fn at(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(x, y, z))
}

/// Returns an empty scene with this image size.
pub fn empty(size: [u32; 2]) -> Scene {
    scene(size, 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO)
}

/// Returns the square `[-1, 1]^2` at height 0 with albedo 1/2 as the first material.
pub fn ground(size: [u32; 2]) -> Scene {
    let mut scene = empty(size);
    let grey = add_material(&mut scene, diffuse(0.5));
    plate(&mut scene, [DVec3::ZERO, DVec3::X, DVec3::Y], grey, None);
    scene
}

/// Adds a rectangle, given by its centre and half axes, with the normal `u x v`.
pub fn plate(scene: &mut Scene, [centre, u, v]: [DVec3; 3], material: MaterialId, shines: Option<f32>) -> usize {
    add(scene, rectangle(centre, u, v), DAffine3::IDENTITY, material, shines)
}

pub fn ball(scene: &mut Scene, centre: DVec3, radius: f64, material: MaterialId, shines: Option<f32>) -> usize {
    add(scene, Geometry::Sphere { radius }, DAffine3::from_translation(centre), material, shines)
}

/// Adds a light with a source line from 200 on.
pub fn add_light(scene: &mut Scene, kind: LightKind, to_world: DAffine3) {
    let source = line(200 + scene.lights.len() as u32);
    scene.lights.push(Light { kind, to_world, source });
}

/// Adds a texture and returns its index.
pub fn add_texture(scene: &mut Scene, name: &str, kind: TextureKind) -> TextureId {
    scene.textures.push(Texture { name: name.into(), kind, source: line(300 + scene.textures.len() as u32) });
    TextureId(scene.textures.len() as u32 - 1)
}

pub fn checks(scale: f32, colors: [f32; 2]) -> TextureKind {
    let colors = colors.map(|x| Color::Constant([x; 3]));
    TextureKind::Checkerboard { scale: [scale; 2], shift: [0.0; 2], colors }
}

pub fn grey_image(size: [u32; 2], value: impl Fn(u32, u32) -> f32) -> Arc<Image> {
    let pixels = (0..size[0] * size[1]).map(|i| [value(i % size[0], i / size[0]); 3]).collect();
    Arc::new(Image::new(size, pixels).expect("as many"))
}

pub fn lat_long(size: [u32; 2], value: impl Fn(u32, u32) -> f32) -> EnvironmentRadiance {
    EnvironmentRadiance::LatLong { image: grey_image(size, value), scale: 0.5 }
}

pub fn equal_area(side: u32, value: impl Fn(u32, u32) -> f32) -> EnvironmentRadiance {
    EnvironmentRadiance::EqualArea { image: grey_image([side; 2], value), scale: 0.5 }
}

/// Returns a medium with equal coefficients in all channels and source line 500.
pub fn fog(absorption: [f32; 3], scattering: [f32; 3], g: f32) -> Medium {
    Medium { name: "fog".into(), absorption, scattering, g, source: line(500) }
}

/// Returns a direction in the xz plane with this cosine to the normal.
pub fn slanted(cos: f64) -> Vec3 {
    DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos).as_vec3()
}

/// Renders a frame.
pub fn film_in(world: &World, frame: Frame, needs: Needs, sampler: &mut dyn Sampler, limits: &Limits) -> Film {
    let film = Render::new(frame, limits).needs(needs).run(&mut *integrator(world), sampler);
    film.unwrap_or_else(|e| panic!("{e}"))
}

/// Renders `spp` samples in every pixel of the whole frame.
pub fn film_with(world: &World, size: [u32; 2], spp: u64, needs: Needs, points: impl PointSet) -> Film {
    let frame = Frame::new(size[0], size[1]).expect("the size is at least 1x1");
    film_in(world, frame, needs, &mut Uniform::new(points), &Limits::samples(spp * frame.pixels() as u64))
}

pub fn film_of(world: &World, size: [u32; 2], spp: u64, points: impl PointSet) -> Film {
    film_with(world, size, spp, Needs::none(), points)
}

/// Renders `spp` Sobol' samples in every pixel of the scene's image.
pub fn image(scene: &Scene, spp: u64, seed: u64) -> Film {
    film_of(&world(scene), scene.film.resolution, spp, Sobol::new(seed))
}

/// Renders films with 16 seeds.
pub fn replicates(world: &World, size: [u32; 2], spp: u64, seed: u64) -> Vec<Film> {
    (seed..seed + 16).map(|seed| film_of(world, size, spp, Sobol::new(seed))).collect()
}

pub fn pixels(film: &Film) -> Vec<[f64; 3]> {
    (0..film.frame().pixels()).map(|i| film.mean(i)).collect()
}

/// Returns the mean over pixels of one channel. Pixels have independently scrambled points, so they are replicates if all have
/// the same expected value.
pub fn pixel_mean(film: &Film, channel: usize) -> Mean {
    pixels(film).iter().map(|p| p[channel]).collect()
}

/// Returns the mean of all pixels, per channel.
pub fn mean(film: &Film) -> [f64; 3] {
    [0, 1, 2].map(|c| pixel_mean(film, c).mean)
}

/// Returns the FNV-1a hash of the bits of all means and sample counts.
pub fn hash(film: &Film) -> u64 {
    let values =
        (0..film.frame().pixels()).flat_map(|i| film.mean(i).map(f64::to_bits).into_iter().chain([film.count(i)]));
    fnv(0xcbf2_9ce4_8422_2325, values.flat_map(u64::to_le_bytes))
}

pub fn fnv(hash: u64, bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(hash, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Returns the means of 8x8 blocks (smaller at the border) in row-major order.
pub fn block_means([w, h]: [u32; 2], pixels: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let [w, h] = [w, h].map(|n| n as usize);
    let corners = (0..h).step_by(8).flat_map(|y| (0..w).step_by(8).map(move |x| (x, y)));
    let mean = |(x, y): (usize, usize)| {
        let (x1, y1) = ((x + 8).min(w), (y + 8).min(h));
        let inside = (y..y1).flat_map(|row| pixels[row * w + x..row * w + x1].iter());
        let sum = inside.fold([0.0; 3], |s: [f64; 3], p| std::array::from_fn(|c| s[c] + p[c]));
        sum.map(|s| s / ((x1 - x) * (y1 - y)) as f64)
    };
    corners.map(mean).collect()
}

/// Returns the block means, indexed by replicate, then by block.
pub fn blocks_of(films: &[Film]) -> Vec<Vec<[f64; 3]>> {
    films.iter().map(|film| block_means(film.frame().size(), &pixels(film))).collect()
}
