//! Estimates of the memory of scenes, worlds and renders, before they exist.
//!
//! Only meshes and images are counted: names, materials and lights are too small to matter.

mod estimate;
mod image;
mod process;

pub use estimate::{MemoryAdvice, MemoryEstimate, MemoryLimit, size};
pub(crate) use image::ImageMemory;
pub use process::{available, resident};

use dapple_scene::image::Image;
use dapple_scene::{EnvironmentRadiance, Geometry, LightKind, MeshData, Scene, Shape, TextureKind};
use std::sync::Arc;

/// Bytes of the bounding volume hierarchy per triangle. Measured: 51 to 52 on meshes of 0.1 to 50 million triangles
/// (docs/results/rays.md).
const TREE: u64 = 53;
/// Peak bytes per triangle while the bounding volume hierarchy is built, not counting the meshes. Measured: 155 on 4 million.
const BUILDING: u64 = 160;
/// Bytes per pixel of an environment map's sampling tables.
const ENVIRONMENT: u64 = 16;

/// The memory of a world (a scene built for tracing) in bytes, not counting the scene itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorldMemory {
    /// The size of the finished world in bytes.
    pub built: u64,
    /// The peak memory in bytes while the world is built.
    pub building: u64,
}

/// Returns the bytes of a scene's meshes and images; shared ones count once.
pub fn of_scene(scene: &Scene) -> u64 {
    let meshes = once(meshes(scene)).into_iter().map(|mesh| {
        of_slice(&mesh.positions) + of_slice(&mesh.normals) + of_slice(&mesh.uvs) + of_slice(&mesh.triangles)
    });
    let images = once(images(scene)).into_iter().map(|p| of_slice(&p.pixels) + of_slice(&p.alpha));
    meshes.chain(images).sum()
}

/// Estimates the memory of the world that [`World::new`](dapple_renderer::World::new) builds for a scene, to within 10
/// % for large meshes.
pub fn of_world(scene: &Scene) -> WorldMemory {
    // Positions are stored in single precision; normals, texture coordinates and triangles are copied; each triangle
    // gets a normal.
    let copied = |mesh: &Arc<MeshData>| {
        let vertices = mesh.positions.len() as u64 * 12 + of_slice(&mesh.normals) + of_slice(&mesh.uvs);
        vertices + 2 * of_slice(&mesh.triangles)
    };
    let copies: u64 = meshes(scene).map(copied).sum();
    let triangles: u64 = meshes(scene).map(|mesh| mesh.triangles.len() as u64).sum();
    let tables: u64 = environments(scene).map(|image| ENVIRONMENT * image.pixels.len() as u64).sum();
    let kept = copies + tables;
    WorldMemory { built: kept + TREE * triangles, building: kept + BUILDING * triangles }
}

fn of_slice<T>(values: &[T]) -> u64 {
    size_of_val(values) as u64
}

/// The meshes of all shapes. An object's meshes occur once, however many instances it has.
fn meshes(scene: &Scene) -> impl Iterator<Item = &Arc<MeshData>> {
    let shapes = scene.shapes.iter().chain(scene.objects.iter().flat_map(|object| &object.shapes));
    shapes.filter_map(|shape: &Shape| match &shape.geometry {
        Geometry::Mesh(mesh) => Some(mesh),
        _ => None,
    })
}

fn environments(scene: &Scene) -> impl Iterator<Item = &Arc<Image>> {
    scene.lights.iter().filter_map(|light| match &light.kind {
        LightKind::Infinite { radiance: EnvironmentRadiance::LatLong { image, .. } } => Some(image),
        LightKind::Infinite { radiance: EnvironmentRadiance::EqualArea { image, .. } } => Some(image),
        _ => None,
    })
}

fn images(scene: &Scene) -> impl Iterator<Item = &Arc<Image>> {
    let textures = scene.textures.iter().filter_map(|texture| match &texture.kind {
        TextureKind::Image { image, .. } => Some(image),
        _ => None,
    });
    textures.chain(environments(scene))
}

/// Removes repetitions of shared values.
fn once<'a, T>(all: impl Iterator<Item = &'a Arc<T>>) -> Vec<&'a Arc<T>> {
    let mut all: Vec<&Arc<T>> = all.collect();
    all.sort_by_key(|one| Arc::as_ptr(one));
    all.dedup_by_key(|one| Arc::as_ptr(one));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_renderer::World;
    use dapple_scene::bundled;

    #[test]
    fn worlds_take_the_estimated_memory_z03() {
        let scene = bundled::files("terrain").unwrap().read().unwrap();
        let world = World::new(&scene).unwrap();
        let triangles: u64 = meshes(&scene).map(|mesh| mesh.triangles.len() as u64).sum();
        assert_eq!(triangles, world.geometry().triangle_count() as u64);
        let (tree, foreseen) = (world.geometry().memory_bytes() as f64, (TREE * triangles) as f64);
        assert!((0.85..=1.0).contains(&(tree / foreseen)), "{foreseen} estimated, {tree} bytes");
        let (meshes, world) = (of_scene(&scene), of_world(&scene));
        assert!(meshes > 24 * triangles && world.built > meshes && world.building > world.built);
    }
}
