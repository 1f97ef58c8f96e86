//! The materials of a glTF file.

use super::textures::{Part, Use};
use super::{Reader, named};
use crate::{
    ClearCoat, Color, ConductorFresnel, Emission, Material, MaterialId, MaterialKind, Medium, MediumId,
    MediumInterface, Roughness, Scalar,
};
use ::gltf::material::{AlphaMode, Material as GltfMaterial};

/// Reflectance of meshes without a material, as of Blender's default material.
const BARE: [f32; 3] = [0.8; 3];
/// Default index of refraction.
const IOR: f32 = 1.5;

/// A material of the scene, with the material's properties that the scene stores in shapes.
#[derive(Clone)]
pub(super) struct Surface {
    pub(super) material: MaterialId,
    pub(super) emission: Option<Emission>,
    pub(super) alpha: Option<Scalar>,
    pub(super) media: Option<MediumInterface>,
    /// The set of texture coordinates that the material's textures use; `None` without textures.
    pub(super) uv_set: Option<u32>,
}

/// The parameters that all kinds of scattering share.
struct Look {
    name: String,
    base: Color,
    /// True if vertex colours multiply the base colour.
    colored: bool,
    roughness: Roughness,
    ior: f32,
    normal_map: Option<crate::TextureId>,
}

impl Reader<'_> {
    /// Returns the scene's material for a material of the file. Adds it at its first use. `colored` is true for a mesh with
    /// vertex colours.
    pub(super) fn surface_of(&mut self, material: &GltfMaterial<'_>, colored: bool) -> Result<Surface, String> {
        let key = (material.index(), colored);
        if let Some(known) = self.surfaces.get(&key) {
            return Ok(known.clone());
        }
        let surface = match material.index() {
            None => {
                let base = if colored {
                    self.scene.vertex_color(Color::Constant([1.0; 3]), self.source)
                } else {
                    Color::Constant(BARE)
                };
                let kind = MaterialKind::Diffuse { reflectance: base };
                let id = self.scene.add_material(Material::new("bare", kind, self.source.clone()));
                Surface { material: id, emission: None, alpha: None, media: None, uv_set: None }
            }
            Some(index) => self.surface(material, named("material", index, material.name()), colored)?,
        };
        self.surfaces.insert(key, surface.clone());
        Ok(surface)
    }

    fn surface(&mut self, material: &GltfMaterial<'_>, name: String, colored: bool) -> Result<Surface, String> {
        let uv_set = self.uv_set(material, &name);
        if material.occlusion_texture().is_some() {
            self.warn(format!("{name}: its occlusion texture is left out; occlusion is ray-traced"));
        }
        let look = self.look(material, name, colored);
        if material.unlit() {
            let id = self.add_material(&look, MaterialKind::Unlit { color: look.base });
            let alpha = self.alpha(material);
            return Ok(Surface { material: id, emission: None, alpha, media: None, uv_set });
        }
        let id = self.kind(material, &look);
        let strength = material.emissive_strength().unwrap_or(1.0);
        let radiance = material.emissive_factor().map(|c| c * strength);
        if !radiance.iter().all(|c| c.is_finite() && *c >= 0.0) {
            return Err(format!("{}: its emission is invalid; export the file again", look.name));
        }
        let shines = radiance.iter().any(|c| *c > 0.0);
        let texture = material.emissive_texture().filter(|_| shines);
        let texture = texture.and_then(|info| self.texture(&Use::of(&info), Part::Color, 1.0));
        let emission = shines.then_some(Emission { texture, ..Emission::even(radiance, material.double_sided()) });
        let alpha = match emission {
            None => self.alpha(material),
            Some(_) if material.alpha_mode() == AlphaMode::Opaque => None,
            Some(_) => {
                self.warn(format!("{}: it emits light, so its opacity is left out", look.name));
                None
            }
        };
        let media = self.medium(material, &look.name);
        Ok(Surface { material: id, emission, alpha, media, uv_set })
    }

    /// The set of texture coordinates of a material; `None` without textures. Adds a notice if its textures use several sets.
    fn uv_set(&mut self, material: &GltfMaterial<'_>, name: &str) -> Option<u32> {
        let pbr = material.pbr_metallic_roughness();
        let infos = [pbr.base_color_texture(), pbr.metallic_roughness_texture(), material.emissive_texture()];
        let mut sets: Vec<u32> = infos.iter().flatten().map(|info| Use::of(info).set).collect();
        sets.extend(material.normal_texture().map(|normal| Use::of_normals(&normal).set));
        let first = *sets.first()?;
        if sets.iter().any(|set| *set != first) {
            self.warn(format!("{name}: its textures use several sets of coordinates; set {first} is used for all"));
        }
        Some(first)
    }

    fn look(&mut self, material: &GltfMaterial<'_>, name: String, colored: bool) -> Look {
        let pbr = material.pbr_metallic_roughness();
        let [r, g, b, _] = pbr.base_color_factor();
        let base = self.color(pbr.base_color_texture(), [r, g, b].map(share));
        let base = if colored { self.scene.vertex_color(base, self.source) } else { base };
        let rough = share(pbr.roughness_factor());
        let alpha = self.number(pbr.metallic_roughness_texture(), Part::Squared(1), rough * rough);
        let roughness = Roughness { u: alpha, v: alpha, remap: false };
        let normal_map = material.normal_texture().and_then(|normal| {
            let info = Use::of_normals(&normal);
            self.texture(&info, Part::Normal(normal.scale().to_bits()), 1.0)
        });
        let ior = material.ior().unwrap_or(IOR);
        let ior = if ior.is_finite() && ior >= 1.0 {
            ior
        } else {
            self.warn(format!("{name}: its index of refraction {ior} is invalid; {IOR} is used instead"));
            IOR
        };
        Look { name, base, colored, roughness, ior, normal_map }
    }

    /// Adds the scattering of a material, with all mixed materials.
    fn kind(&mut self, material: &GltfMaterial<'_>, look: &Look) -> MaterialId {
        if let Some(old) = material.pbr_specular_glossiness() {
            let kind = self.specular_glossiness(&old, look.colored);
            return self.add_material(look, kind);
        }
        let opaque = self.opaque(material, look);
        let opaque = self.add_material(look, opaque);
        let Some(transmission) = material.transmission() else { return opaque };
        let factor = share(transmission.transmission_factor());
        let amount = self.number(transmission.transmission_texture(), Part::Channel(0), factor);
        let glass = glass(look, material.volume().is_some());
        let glass = self.add_material(look, glass);
        self.mix(look, [opaque, glass], amount)
    }

    /// A surface that transmits no light: diffuse, glossy and metallic parts, and a clear coat.
    fn opaque(&mut self, material: &GltfMaterial<'_>, look: &Look) -> MaterialKind {
        let coat = self.coat(material, look);
        let pbr = material.pbr_metallic_roughness();
        let metal = share(pbr.metallic_factor());
        let metallic = self.number(pbr.metallic_roughness_texture(), Part::Channel(2), metal);
        let (normal, grazing) = self.specular(material, look);
        let roughness = look.roughness;
        let smooth = roughness.constants().is_some_and(crate::effectively_smooth);
        match metallic {
            Scalar::Constant(1.0) if smooth && coat.is_none() => {
                MaterialKind::Conductor { fresnel: ConductorFresnel::Reflectance(look.base), roughness }
            }
            Scalar::Constant(0.0) if grazing == 0.0 && coat.is_none() => {
                MaterialKind::Diffuse { reflectance: look.base }
            }
            _ => MaterialKind::Layered { base: look.base, metallic, normal, grazing, roughness, coat },
        }
    }

    /// The clear coat of a material. Its textures are left out, with a notice.
    fn coat(&mut self, material: &GltfMaterial<'_>, look: &Look) -> Option<ClearCoat> {
        let coat = material.extension_value("KHR_materials_clearcoat")?;
        let number = |key: &str| share(coat.get(key).and_then(serde_json::Value::as_f64).unwrap_or(0.0) as f32);
        let (amount, rough) = (number("clearcoatFactor"), number("clearcoatRoughnessFactor"));
        if amount == 0.0 {
            return None;
        }
        let textures = ["clearcoatTexture", "clearcoatRoughnessTexture", "clearcoatNormalTexture"];
        if textures.iter().any(|key| coat.get(key).is_some()) {
            self.warn(format!("{}: the textures of its clear coat are left out", look.name));
        }
        Some(ClearCoat { amount, alpha: rough * rough })
    }

    /// The Fresnel reflectance of a dielectric material along the normal, and at grazing angles.
    fn specular(&mut self, material: &GltfMaterial<'_>, look: &Look) -> ([f32; 3], f32) {
        let ratio = (look.ior - 1.0) / (look.ior + 1.0);
        let Some(specular) = material.specular() else { return ([ratio * ratio; 3], 1.0) };
        if specular.specular_texture().is_some() || specular.specular_color_texture().is_some() {
            self.warn(format!("{}: the textures of its specular reflection are left out", look.name));
        }
        let strength = share(specular.specular_factor());
        (specular.specular_color_factor().map(|c| share(ratio * ratio * c) * strength), strength)
    }

    fn specular_glossiness(
        &mut self,
        old: &::gltf::material::PbrSpecularGlossiness<'_>,
        colored: bool,
    ) -> MaterialKind {
        let [r, g, b, _] = old.diffuse_factor();
        let diffuse = self.color(old.diffuse_texture(), [r, g, b].map(share));
        let diffuse = if colored { self.scene.vertex_color(diffuse, self.source) } else { diffuse };
        let gloss = share(old.glossiness_factor());
        let specular = self.color(old.specular_glossiness_texture(), old.specular_factor().map(share));
        let used = old.specular_glossiness_texture().map(|info| Use::of(&info));
        let alpha = used.and_then(|info| self.texture(&info, Part::Glossiness(gloss.to_bits()), 1.0));
        let alpha = alpha.map_or(Scalar::Constant((1.0 - gloss) * (1.0 - gloss)), Scalar::Texture);
        let roughness = Roughness { u: alpha, v: alpha, remap: false };
        MaterialKind::Substrate { diffuse, specular, roughness }
    }

    /// Adds a mix of two materials. If `amount` is 0 or 1, returns the first or the second material.
    fn mix(&mut self, look: &Look, materials: [MaterialId; 2], amount: Scalar) -> MaterialId {
        match amount {
            Scalar::Constant(0.0) => materials[0],
            Scalar::Constant(1.0) => materials[1],
            _ => self.add_material(look, MaterialKind::Mix { materials, amount }),
        }
    }

    fn add_material(&mut self, look: &Look, kind: MaterialKind) -> MaterialId {
        let material = Material::new(look.name.clone(), kind, self.source.clone());
        self.scene.add_material(Material { normal_map: look.normal_map, ..material })
    }

    fn alpha(&mut self, material: &GltfMaterial<'_>) -> Option<Scalar> {
        let pbr = material.pbr_metallic_roughness();
        let factor = share(pbr.base_color_factor()[3]);
        let used = pbr.base_color_texture();
        match material.alpha_mode() {
            AlphaMode::Opaque => None,
            AlphaMode::Mask => {
                let cutoff = material.alpha_cutoff().unwrap_or(0.5);
                let part = Part::Mask((cutoff / factor).to_bits());
                let texture = used.and_then(|info| self.texture(&Use::of(&info), part, 1.0));
                let constant = Scalar::Constant(f32::from(factor >= cutoff));
                Some(texture.map_or(constant, Scalar::Texture))
            }
            AlphaMode::Blend => Some(self.number(used, Part::Alpha, factor)),
        }
    }

    /// The medium inside a material with a volume, from the colour of white light after the attenuation distance.
    fn medium(&mut self, material: &GltfMaterial<'_>, name: &str) -> Option<MediumInterface> {
        let volume = material.volume().filter(|volume| volume.thickness_factor() > 0.0)?;
        if volume.thickness_texture().is_some() {
            self.warn(format!("{name}: its thickness texture is left out; the mesh has its own thickness"));
        }
        let distance = volume.attenuation_distance();
        let absorption = volume.attenuation_color().map(|c| -libm::logf(c.clamp(1e-6, 1.0)) / distance);
        let absorbs = distance > 0.0 && distance.is_finite() && absorption.iter().any(|a| *a > 0.0);
        absorbs.then(|| {
            let id = MediumId(self.scene.media.len() as u32);
            let source = self.source.clone();
            self.scene.media.push(Medium { name: name.into(), absorption, scattering: [0.0; 3], g: 0.0, source });
            MediumInterface { inside: Some(id), outside: None }
        })
    }
}

/// Glass: a solid body, or a pane if the file states no volume and the glass is clear and smooth.
fn glass(look: &Look, solid: bool) -> MaterialKind {
    let clear = matches!(look.base, Color::Constant(rgb) if rgb.iter().all(|c| *c > 0.99));
    let smooth = look.roughness.constants().is_some_and(|alpha| alpha[0] < crate::SMOOTH_ALPHA);
    if clear && smooth && !solid {
        return MaterialKind::ThinDielectric { eta: look.ior };
    }
    let reflectance = Color::Constant([1.0; 3]);
    MaterialKind::Dielectric { eta: look.ior, roughness: look.roughness, reflectance, transmittance: look.base }
}

/// The value clamped to 0..=1; NaN becomes 0.
fn share(value: f32) -> f32 {
    if value > 0.0 { value.min(1.0) } else { 0.0 }
}
