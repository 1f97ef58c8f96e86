//! Scenes edited so that they lack one of their effects.

use crate::material::Surface;
use crate::texture::Textures;
use dapple_scene::{Effect, Material, Scene, WithoutError};

/// Returns a copy of the scene that lacks an effect, made by [`Scene::without`]. If the edit replaces a material by a
/// diffuse one, the diffuse one gets the material's approximate albedo.
///
/// # Errors
///
/// [`WithoutError::NoLight`] if the edit would remove the last light of the scene.
pub fn without(scene: &Scene, effect: Effect) -> Result<Scene, WithoutError> {
    scene.without(effect, &albedo)
}

/// Returns the approximate albedo of a material at normal incidence. Textures count as black. Returns `None` for an
/// invalid material.
fn albedo(material: &Material) -> Option<[f32; 3]> {
    let surface = Surface::new(material).ok()?;
    Some(surface.bsdf(&Textures::default(), [0.5; 2]).albedo().to_array())
}
