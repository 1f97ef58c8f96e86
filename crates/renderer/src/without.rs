//! Scenes edited to do without one of their effects.

use crate::material::Surface;
use crate::texture::Textures;
use dapple_scene::{Effect, Material, Scene, WithoutError};

/// Returns the scene without an effect, by [`Scene::without`]. Diffuse surfaces get the albedo of the BSDFs that they
/// replace.
///
/// # Errors
///
/// [`WithoutError::NoLight`] if the edit would remove the last light.
pub fn without(scene: &Scene, effect: Effect) -> Result<Scene, WithoutError> {
    scene.without(effect, &albedo)
}

/// Returns the albedo at normal incidence of a material without textures; `None` for an invalid material.
fn albedo(material: &Material) -> Option<[f32; 3]> {
    let surface = Surface::new(material).ok()?;
    Some(surface.bsdf(&Textures::default(), [0.5; 2]).albedo().to_array())
}
