//! Materials prepared for shading. Values that do not depend on the hit are computed once.

mod mix;
#[cfg(test)]
mod tests;

pub(crate) use mix::{check_mixes, passed_share, resolve};

use crate::shading::coat::{Coat, CoatOptions};
use crate::shading::{
    Bsdf, ComplexIor, DiffuseTransmission, Layered, Layers, MetalCoat, Plastic, RoughDielectric, SmoothDielectric,
    Substrate, Tint, TrowbridgeReitz,
};
use crate::texture::{TexturePoint, Textures};
use dapple_scene::{
    ClearCoat, Coating, Color, ConductorFresnel, Effect, Material, MaterialKind, Roughness, Scalar, Scene, Source,
    TextureId, WithoutError, effectively_smooth, roughness_to_alpha,
};
use glam::Vec3;

/// A material prepared for shading.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    kind: Kind,
    /// The bump map and the normal map.
    pub(crate) normal_variation: NormalVariation,
    /// True if there is a bump map or a normal map.
    pub(crate) bumped: bool,
    /// True if scattering depends on the texture coordinates or the vertex colours.
    pub(crate) textured: bool,
    /// True if scattering depends on the tangent in the direction of increasing u.
    pub(crate) anisotropic: bool,
    /// True if sampling selects among several lobes, which takes a random number.
    pub(crate) several_lobes: bool,
    /// True if the material scatters nothing, as is common for area lights.
    pub(crate) black: bool,
    /// True if the material may transmit light, by refraction or diffusely.
    pub(crate) transmits: bool,
    /// True for an interface: a boundary between media that light passes without scattering.
    pub(crate) interface: bool,
    /// True for an unlit surface, which only the camera sees, with its albedo as radiance.
    pub(crate) unlit: bool,
    /// True for a mix of two materials; [`resolve`] selects one of them at each hit.
    pub(crate) mixes: bool,
}

/// The textures that tilt shading normals: a bump map and a normal map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct NormalVariation {
    /// The bump map: a texture of heights in units of the scene file's world space.
    pub(crate) bump: Option<TextureId>,
    /// The normal map: an image of normals in tangent space.
    pub(crate) normal_map: Option<TextureId>,
}

#[derive(Clone, Debug, Default)]
enum Kind {
    Diffuse(Color),
    Conductor {
        metal: Metal,
        widths: Widths,
    },
    Coated {
        coat: Box<Coat>,
        base: Vec3,
    },
    TexturedCoated {
        coat: Box<Coat>,
        reflectance: Color,
    },
    CoatedConductor {
        coat: Box<MetalCoat>,
        metal: Metal,
    },
    Dielectric {
        eta: f32,
        widths: Widths,
        reflectance: Color,
        transmittance: Color,
    },
    ThinDielectric {
        eta: f32,
    },
    DiffuseTransmission {
        reflectance: Color,
        transmittance: Color,
    },
    Mirror(Color),
    Plastic {
        diffuse: Color,
        specular: Color,
        widths: Widths,
    },
    Substrate {
        diffuse: Color,
        specular: Color,
        widths: Widths,
    },
    Layered {
        base: Color,
        metallic: Scalar,
        widths: Widths,
        layers: Layers,
    },
    Mix {
        materials: [u32; 2],
        amount: Scalar,
    },
    #[default]
    Interface,
}

/// The microfacet widths of a material: constant, or from a texture.
#[derive(Clone, Copy, Debug)]
enum Widths {
    Smooth(TrowbridgeReitz),
    Rough(TrowbridgeReitz),
    Textured(Roughness),
}

/// The error of a material that cannot be prepared. Its message names the material and its line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{at}: material \"{name}\": {what}")]
pub struct MaterialError {
    at: Source,
    name: String,
    what: String,
}

impl MaterialError {
    fn new(material: &Material, what: impl Into<String>) -> Self {
        Self { at: material.source.clone(), name: material.name.clone(), what: what.into() }
    }
}

impl Surface {
    /// Prepares a material of a scene for shading.
    ///
    /// # Errors
    ///
    /// [`MaterialError`] if a parameter is out of its range.
    pub fn new(material: &Material) -> Result<Self, MaterialError> {
        let wrong = |what: String| MaterialError::new(material, what);
        let mut surface = Self::of_kind(&material.kind).map_err(&wrong)?;
        let bump = match material.bump {
            Some(Scalar::Constant(height)) if !height.is_finite() => {
                return Err(wrong(format!("a bump height of {height} is invalid; use a finite number")));
            }
            // A constant height tilts no normal.
            Some(Scalar::Constant(_)) | None => None,
            Some(Scalar::Texture(id)) => Some(id),
        };
        surface.normal_variation = NormalVariation { bump, normal_map: material.normal_map };
        surface.bumped = surface.normal_variation != NormalVariation::default();
        Ok(surface)
    }

    fn of_kind(kind: &MaterialKind) -> Result<Self, String> {
        Ok(match kind {
            MaterialKind::Diffuse { reflectance } => {
                let reflectance = share(reflectance)?;
                Self::of(Kind::Diffuse(reflectance)).colors(&[reflectance])
            }
            MaterialKind::DiffuseTransmission { reflectance, transmittance } => {
                let (reflectance, transmittance) = (share(reflectance)?, share(transmittance)?);
                let surface = Self::of(Kind::DiffuseTransmission { reflectance, transmittance });
                surface.colors(&[reflectance, transmittance]).lobes().through()
            }
            MaterialKind::Conductor { fresnel, roughness } => {
                let (widths, metal) = (Widths::new(roughness)?, conductor(fresnel)?);
                Self::of(Kind::Conductor { metal, widths }).metal(&metal).rough(&widths)
            }
            MaterialKind::Dielectric { eta, roughness, reflectance, transmittance } => {
                let widths = Widths::new(roughness)?;
                let (reflectance, transmittance) = (share(reflectance)?, share(transmittance)?);
                let surface = Self::of(Kind::Dielectric { eta: index(*eta)?, widths, reflectance, transmittance });
                surface.colors(&[reflectance, transmittance]).rough(&widths).lobes().through()
            }
            MaterialKind::ThinDielectric { eta } => {
                Self::of(Kind::ThinDielectric { eta: index(*eta)? }).lobes().through()
            }
            MaterialKind::CoatedDiffuse { reflectance, coat } => coated_diffuse(reflectance, coat)?,
            MaterialKind::CoatedConductor { fresnel, roughness, coat } => coated_conductor(fresnel, roughness, coat)?,
            MaterialKind::Mirror { reflectance } => {
                let reflectance = share(reflectance)?;
                Self::of(Kind::Mirror(reflectance)).colors(&[reflectance])
            }
            MaterialKind::Plastic { diffuse, specular, roughness } => {
                let (diffuse, specular, widths) = (share(diffuse)?, share(specular)?, Widths::new(roughness)?);
                let surface = Self::of(Kind::Plastic { diffuse, specular, widths });
                surface.colors(&[diffuse, specular]).rough(&widths).lobes()
            }
            MaterialKind::Substrate { diffuse, specular, roughness } => {
                let (diffuse, specular, widths) = (share(diffuse)?, share(specular)?, Widths::new(roughness)?);
                let surface = Self::of(Kind::Substrate { diffuse, specular, widths });
                // The coat reflects at grazing angles even if both colors are black.
                Self { black: false, ..surface.colors(&[diffuse, specular]).rough(&widths).lobes() }
            }
            MaterialKind::Layered { base, metallic, normal, grazing, roughness, coat } => {
                layered(base, *metallic, (*normal, *grazing), roughness, coat.as_ref())?
            }
            MaterialKind::Mix { materials, amount } => {
                if matches!(amount, Scalar::Constant(a) if !(0.0..=1.0).contains(a)) {
                    return Err("the amount of a mix is invalid; use a number from 0 to 1".into());
                }
                let textured = matches!(amount, Scalar::Texture(_));
                let kind = Kind::Mix { materials: materials.map(|m| m.0), amount: *amount };
                Self { mixes: true, textured, ..Self::of(kind) }
            }
            MaterialKind::Interface => Self { interface: true, ..Self::default() },
            MaterialKind::Unlit { color } => {
                let color = share(color)?;
                Self { unlit: true, black: true, ..Self::of(Kind::Diffuse(color)).colors(&[color]) }
            }
        })
    }

    /// Makes the surface of a kind with all flags unset.
    fn of(kind: Kind) -> Self {
        Self { kind, ..Self::default() }
    }

    /// Sets the flags of a surface whose scattering depends on these colors only. The surface is black if all colors are.
    fn colors(self, colors: &[Color]) -> Self {
        let textured = colors.iter().any(|c| matches!(c, Color::Texture(_)));
        let black = colors.iter().all(|c| *c == Color::Constant([0.0; 3]));
        Self { textured, black, ..self }
    }

    fn metal(self, metal: &Metal) -> Self {
        Self { textured: matches!(metal, Metal::Tinted(_)), ..self }
    }

    fn lobes(self) -> Self {
        Self { several_lobes: true, ..self }
    }

    fn through(self) -> Self {
        Self { transmits: true, ..self }
    }

    fn rough(self, widths: &Widths) -> Self {
        match widths {
            Widths::Smooth(m) | Widths::Rough(m) => Self { anisotropic: m.alpha()[0] != m.alpha()[1], ..self },
            Widths::Textured(r) => Self { textured: true, anisotropic: r.u != r.v, ..self },
        }
    }

    /// Returns true for Lambertian reflection of constant color, without a bump map or normal map.
    pub(crate) fn is_plain(&self) -> bool {
        matches!(self.kind, Kind::Diffuse(Color::Constant(_))) && !self.bumped && !self.unlit
    }

    /// Returns the BSDF of a [plain](Self::is_plain) material; a black BSDF for any other material.
    #[inline(always)]
    pub(crate) fn plain(&self) -> Bsdf<'_> {
        let reflectance = match self.kind {
            Kind::Diffuse(Color::Constant(rgb)) => Vec3::from_array(rgb),
            _ => Vec3::ZERO,
        };
        Bsdf::Diffuse { reflectance }
    }

    /// Returns the BSDF at a point. It is black for a boundary between media, and for a mix from which no material is selected.
    #[inline(always)]
    pub fn bsdf(&self, textures: &Textures, point: impl Into<TexturePoint>) -> Bsdf<'_> {
        // A constant color was clamped when the material was prepared.
        if let Kind::Diffuse(Color::Constant(rgb)) = &self.kind {
            return Bsdf::Diffuse { reflectance: Vec3::from_array(*rgb) };
        }
        self.bsdf_of_others(textures, point.into())
    }

    fn bsdf_of_others(&self, textures: &Textures, point: TexturePoint) -> Bsdf<'_> {
        let color = |c: &Color| match c {
            Color::Constant(rgb) => Vec3::from_array(*rgb),
            Color::Texture(id) => textures.look_up(*id, point).clamp(Vec3::ZERO, Vec3::ONE),
        };
        let ior = |metal: &Metal| match metal {
            Metal::Known(ior) => *ior,
            Metal::Tinted(reflectance) => ComplexIor::from_reflectance(color(reflectance)),
        };
        match &self.kind {
            Kind::Diffuse(reflectance) => Bsdf::Diffuse { reflectance: color(reflectance) },
            Kind::Conductor { metal, widths } => match widths.at(textures, point) {
                Some(microfacets) => Bsdf::Conductor { ior: ior(metal), microfacets },
                None => Bsdf::SmoothConductor { ior: ior(metal) },
            },
            Kind::Coated { coat, base } => Bsdf::CoatedDiffuse { coat, base: *base },
            Kind::TexturedCoated { coat, reflectance } => Bsdf::coated_diffuse(coat, color(reflectance)),
            Kind::CoatedConductor { coat, metal } => Bsdf::coated_conductor(coat, ior(metal)),
            Kind::Dielectric { eta, widths, reflectance, transmittance } => {
                let (eta, tint) = (*eta, Tint { reflectance: color(reflectance), transmittance: color(transmittance) });
                match widths.at(textures, point) {
                    Some(microfacets) if eta != 1.0 => Bsdf::Dielectric(RoughDielectric { eta, microfacets, tint }),
                    _ => Bsdf::SmoothDielectric(SmoothDielectric { eta, tint }),
                }
            }
            Kind::ThinDielectric { eta } => Bsdf::ThinDielectric { eta: *eta },
            Kind::DiffuseTransmission { reflectance, transmittance } => {
                let (reflectance, transmittance) = (color(reflectance), color(transmittance));
                Bsdf::DiffuseTransmission(DiffuseTransmission { reflectance, transmittance })
            }
            Kind::Mirror(reflectance) => Bsdf::Mirror { reflectance: color(reflectance) },
            Kind::Plastic { diffuse, specular, widths } => {
                let microfacets = widths.rough(textures, point);
                Bsdf::Plastic(Plastic { diffuse: color(diffuse), specular: color(specular), microfacets })
            }
            Kind::Substrate { diffuse, specular, widths } => {
                let microfacets = widths.rough(textures, point);
                Bsdf::Substrate(Substrate { diffuse: color(diffuse), specular: color(specular), microfacets })
            }
            Kind::Layered { base, metallic, widths, layers } => {
                let (base, microfacets) = (color(base), widths.rough(textures, point));
                let metallic = textures.look_up_scalar(*metallic, point).clamp(0.0, 1.0);
                Bsdf::Layered(Layered { base, metallic, microfacets, layers })
            }
            Kind::Mix { .. } | Kind::Interface => Bsdf::Diffuse { reflectance: Vec3::ZERO },
        }
    }
}

impl Widths {
    fn new(roughness: &Roughness) -> Result<Self, String> {
        if roughness.constants().is_none() {
            // If one of the two widths is a number, that number is checked here.
            for scalar in [roughness.u, roughness.v] {
                if let Scalar::Constant(r) = scalar {
                    alpha(&Roughness { u: scalar, v: Scalar::Constant(r), ..*roughness })?;
                }
            }
            return Ok(Self::Textured(*roughness));
        }
        let alpha = alpha(roughness)?;
        let microfacets = TrowbridgeReitz::new(alpha).map_err(|e| e.to_string())?;
        Ok(match effectively_smooth(alpha) {
            true => Self::Smooth(microfacets),
            false => Self::Rough(microfacets),
        })
    }

    /// Returns the microfacet distribution at a point; `None` if the surface is smooth there.
    #[inline]
    fn at(&self, textures: &Textures, point: TexturePoint) -> Option<TrowbridgeReitz> {
        match self {
            Self::Smooth(_) => None,
            Self::Rough(microfacets) => Some(*microfacets),
            Self::Textured(_) => {
                let microfacets = self.rough(textures, point);
                (!effectively_smooth(microfacets.alpha())).then_some(microfacets)
            }
        }
    }

    /// Returns the microfacet distribution at a point, even if the surface counts as smooth there.
    #[inline]
    fn rough(&self, textures: &Textures, point: TexturePoint) -> TrowbridgeReitz {
        match self {
            Self::Smooth(microfacets) | Self::Rough(microfacets) => *microfacets,
            Self::Textured(roughness) => TrowbridgeReitz::nearest([roughness.u, roughness.v].map(|r| {
                let r = textures.look_up_scalar(r, point);
                if roughness.remap { roughness_to_alpha(r) } else { r }
            })),
        }
    }
}

/// The index of refraction of a metal: constant, or from a texture of reflectances.
#[derive(Clone, Copy, Debug)]
enum Metal {
    Known(ComplexIor),
    Tinted(Color),
}

fn layered(
    base: &Color,
    metallic: Scalar,
    (normal, grazing): ([f32; 3], f32),
    roughness: &Roughness,
    coat: Option<&ClearCoat>,
) -> Result<Surface, String> {
    let part = |value: f32, what: &str| match (0.0..=1.0).contains(&value) {
        true => Ok(value),
        false => Err(format!("{what} of {value} is invalid; use a number from 0 to 1")),
    };
    let (base, widths) = (share(base)?, Widths::new(roughness)?);
    for value in normal.into_iter().chain([grazing]) {
        part(value, "a reflectance")?;
    }
    if let Scalar::Constant(metallic) = metallic {
        part(metallic, "a fraction of metal")?;
    }
    let coat = match coat {
        Some(coat) => {
            let microfacets = TrowbridgeReitz::new([coat.alpha; 2]).map_err(|e| e.to_string())?;
            Some((part(coat.amount, "an amount of clear coat")?, microfacets))
        }
        None => None,
    };
    let layers = Layers { normal: Vec3::from_array(normal), grazing, coat };
    let textured = matches!(base, Color::Texture(_)) || matches!(metallic, Scalar::Texture(_));
    let surface = Surface { textured, ..Surface::of(Kind::Layered { base, metallic, widths, layers }) };
    Ok(surface.rough(&widths).lobes())
}

fn coated_diffuse(reflectance: &Color, coat: &Coating) -> Result<Surface, String> {
    let options = coat_options(coat)?;
    let coat = Box::new(Coat::new(options).map_err(|e| e.to_string())?);
    let reflectance = share(reflectance)?;
    let anisotropic = options.alpha[0] != options.alpha[1];
    let (kind, textured) = match reflectance {
        Color::Constant(rgb) => (Kind::Coated { base: coat.base(Vec3::from_array(rgb)), coat }, false),
        Color::Texture(_) => (Kind::TexturedCoated { coat, reflectance }, true),
    };
    Ok(Surface { anisotropic, textured, ..Surface::of(kind) }.lobes())
}

fn coated_conductor(fresnel: &ConductorFresnel, roughness: &Roughness, coat: &Coating) -> Result<Surface, String> {
    let options = coat_options(coat)?;
    let alpha = alpha(roughness)?;
    let coat = Box::new(MetalCoat::new(options, alpha).map_err(|e| e.to_string())?);
    let anisotropic = alpha[0] != alpha[1] || options.alpha[0] != options.alpha[1];
    let metal = conductor(fresnel)?;
    Ok(Surface { anisotropic, ..Surface::of(Kind::CoatedConductor { coat, metal }) }.metal(&metal).lobes())
}

fn conductor(fresnel: &ConductorFresnel) -> Result<Metal, String> {
    Ok(match fresnel {
        ConductorFresnel::EtaK { eta, k } => {
            if eta.iter().chain(k).any(|x| !(x.is_finite() && *x >= 0.0)) {
                return Err(format!("a metal with eta {eta:?} and k {k:?} is invalid; use numbers of at least 0"));
            }
            Metal::Known(ComplexIor { eta: Vec3::from_array(*eta), k: Vec3::from_array(*k) })
        }
        ConductorFresnel::Reflectance(reflectance) => match share(reflectance)? {
            Color::Constant(rgb) => Metal::Known(ComplexIor::from_reflectance(Vec3::from_array(rgb))),
            texture => Metal::Tinted(texture),
        },
    })
}

/// Checks the color of a reflectance or transmittance, and clamps constant colors to `[0, 1]`. Textures are clamped at look-up.
fn share(color: &Color) -> Result<Color, String> {
    match color {
        Color::Constant(rgb) if rgb.iter().any(|x| !(x.is_finite() && *x >= 0.0)) => {
            Err(format!("a reflectance of {rgb:?} is invalid; use numbers of at least 0"))
        }
        Color::Constant(rgb) => Ok(Color::Constant(rgb.map(|c| c.clamp(0.0, 1.0)))),
        texture => Ok(*texture),
    }
}

fn index(eta: f32) -> Result<f32, String> {
    match (0.1..=10.0).contains(&eta) {
        true => Ok(eta),
        false => Err(format!("an index of refraction of {eta} is invalid; use 0.1 to 10 (glass has 1.5)")),
    }
}

fn coat_options(coat: &Coating) -> Result<CoatOptions, String> {
    let Coating { eta, thickness, max_depth, .. } = *coat;
    if coat.albedo != Color::Constant([0.0; 3]) {
        return Err("a scattering coat (\"albedo\" above 0) is not supported; set its albedo to 0".into());
    }
    Ok(CoatOptions { eta, alpha: alpha(&coat.roughness)?, thickness, max_depth })
}

fn alpha(roughness: &Roughness) -> Result<[f32; 2], String> {
    let constants = roughness
        .constants()
        .ok_or("a roughness texture is not supported for a coat or for a metal below a coat; use a number")?;
    let alpha = constants.map(|r| match roughness.remap {
        true => roughness_to_alpha(r),
        false => r,
    });
    match constants.iter().all(|r| r.is_finite() && *r >= 0.0) {
        true => Ok(alpha),
        false => {
            Err(format!("a roughness of {}, {} is invalid; use numbers of at least 0", constants[0], constants[1]))
        }
    }
}

/// Returns a copy of the scene from which [`Scene::without`] has removed `effect`. Materials replaced by diffuse ones keep
/// their approximate albedo.
///
/// # Errors
///
/// [`WithoutError::NoLight`] if the copy would have no light.
pub fn without(scene: &Scene, effect: Effect) -> Result<Scene, WithoutError> {
    scene.without(effect, &albedo)
}

/// Returns the approximate albedo of a material at normal incidence. Textures count as black. Returns `None` for an
/// invalid material.
fn albedo(material: &Material) -> Option<[f32; 3]> {
    let surface = Surface::new(material).ok()?;
    Some(surface.bsdf(&Textures::default(), [0.5; 2]).albedo().to_array())
}
