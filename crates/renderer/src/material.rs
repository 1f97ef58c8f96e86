//! Materials ready to shade: everything that does not depend on the hit is computed once.

use crate::scene::{Color, ConductorFresnel, Material, MaterialKind, Roughness, Source};
use crate::shading::coat::{Coat, CoatOptions};
use crate::shading::{Bsdf, ComplexIor, TrowbridgeReitz};
use crate::texture::Textures;
use glam::Vec3;

/// A material ready to shade.
#[derive(Clone, Debug)]
pub struct Surface {
    kind: Kind,
    /// Whether texture coordinates are looked at.
    pub(crate) textured: bool,
    /// Whether the direction of u on the surface matters.
    pub(crate) anisotropic: bool,
    /// Whether there is a lobe to choose.
    pub(crate) several_lobes: bool,
    /// Whether nothing is ever reflected: a lamp's body, say.
    pub(crate) black: bool,
}

#[derive(Clone, Debug)]
enum Kind {
    Diffuse(Color),
    Conductor { ior: ComplexIor, alpha: [f32; 2] },
    TintedConductor { reflectance: Color, alpha: [f32; 2] },
    Coated { coat: Box<Coat>, reflectance: Color },
}

/// What is wrong with a material.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{at}: material \"{name}\": {what}")]
pub struct MaterialError {
    at: Source,
    name: String,
    what: String,
}

impl Surface {
    /// Prepares a material.
    ///
    /// # Errors
    ///
    /// When a parameter is outside its range.
    pub fn new(material: &Material) -> Result<Self, MaterialError> {
        let wrong = |what: String| MaterialError { at: material.source.clone(), name: material.name.clone(), what };
        let color = |c: &Color| match c {
            Color::Constant(rgb) if rgb.iter().any(|x| !(x.is_finite() && *x >= 0.0)) => {
                Err(wrong(format!("a reflectance of {rgb:?} is none: give numbers of at least 0")))
            }
            c => Ok(*c),
        };
        let textured = |c: &Color| matches!(c, Color::Texture(_));
        let (kind, textured, anisotropic, several_lobes) = match &material.kind {
            MaterialKind::Diffuse { reflectance } => {
                let reflectance = match color(reflectance)? {
                    Color::Constant(rgb) => Color::Constant(rgb.map(|c| c.clamp(0.0, 1.0))),
                    texture => texture,
                };
                (Kind::Diffuse(reflectance), textured(&reflectance), false, false)
            }
            MaterialKind::Conductor { fresnel, roughness } => {
                let alpha = alpha(roughness).map_err(&wrong)?;
                let anisotropic = alpha[0] != alpha[1];
                match fresnel {
                    ConductorFresnel::EtaK { eta, k } => {
                        let ior = ComplexIor { eta: Vec3::from_array(*eta), k: Vec3::from_array(*k) };
                        Bsdf::conductor(ior, alpha).map_err(|e| wrong(e.to_string()))?;
                        (Kind::Conductor { ior, alpha }, false, anisotropic, false)
                    }
                    ConductorFresnel::Reflectance(reflectance) => {
                        let reflectance = color(reflectance)?;
                        let textured = textured(&reflectance);
                        (Kind::TintedConductor { reflectance, alpha }, textured, anisotropic, false)
                    }
                }
            }
            MaterialKind::CoatedDiffuse { reflectance, roughness, eta, thickness, albedo, max_depth, .. } => {
                if *albedo != Color::Constant([0.0; 3]) {
                    return Err(wrong(
                        "a coat that scatters (\"albedo\" above 0) is not supported: leave it out".into(),
                    ));
                }
                let alpha = alpha(roughness).map_err(&wrong)?;
                let options = CoatOptions { eta: *eta, alpha, thickness: *thickness, max_depth: *max_depth };
                let coat = Coat::new(options).map_err(|e| wrong(e.to_string()))?;
                let reflectance = color(reflectance)?;
                let textured = textured(&reflectance);
                (Kind::Coated { coat: Box::new(coat), reflectance }, textured, alpha[0] != alpha[1], true)
            }
            _ => return Err(wrong("this kind of material is not supported yet".into())),
        };
        let black = matches!(kind, Kind::Diffuse(Color::Constant([0.0, 0.0, 0.0])));
        Ok(Self { kind, textured, anisotropic, several_lobes, black })
    }

    /// The scattering at a point with these texture coordinates.
    #[inline(always)]
    pub fn bsdf(&self, textures: &Textures, uv: [f32; 2]) -> Bsdf<'_> {
        let reflectance = |c: &Color| match c {
            Color::Constant(rgb) => Vec3::from_array(*rgb),
            Color::Texture(id) => textures.look_up(*id, uv),
        };
        match &self.kind {
            // A constant was clamped when the material was made.
            Kind::Diffuse(Color::Constant(rgb)) => Bsdf::Diffuse { reflectance: Vec3::from_array(*rgb) },
            Kind::Diffuse(c) => Bsdf::Diffuse { reflectance: reflectance(c).clamp(Vec3::ZERO, Vec3::ONE) },
            Kind::Conductor { ior, alpha } => conductor(*ior, *alpha),
            Kind::TintedConductor { reflectance: c, alpha } => {
                conductor(ComplexIor::from_reflectance(reflectance(c)), *alpha)
            }
            Kind::Coated { coat, reflectance: c } => Bsdf::coated_diffuse(coat, reflectance(c)),
        }
    }
}

#[inline]
fn conductor(ior: ComplexIor, alpha: [f32; 2]) -> Bsdf<'static> {
    // The widths were checked when the material was made.
    Bsdf::conductor(ior, alpha).unwrap_or(Bsdf::SmoothConductor { ior })
}

fn alpha(roughness: &Roughness) -> Result<[f32; 2], String> {
    let constants = roughness.constants().ok_or("a roughness from a texture is not supported: give a number")?;
    let alpha = constants.map(|r| match roughness.remap {
        true => TrowbridgeReitz::roughness_to_alpha(r),
        false => r,
    });
    match alpha.iter().all(|a| a.is_finite() && *a >= 0.0) {
        true => Ok(alpha),
        false => Err(format!("a roughness of {}, {} is none: give numbers of at least 0", constants[0], constants[1])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Picture;
    use crate::scene::{Texture, TextureId, TextureKind, Wrap};
    use std::sync::Arc;

    fn surface(kind: MaterialKind) -> Result<Surface, String> {
        let made = Surface::new(&Material::new("m", kind, Source::default()));
        made.map_err(|e| e.to_string())
    }

    fn diffuse(rgb: [f32; 3]) -> MaterialKind {
        MaterialKind::Diffuse { reflectance: Color::Constant(rgb) }
    }

    fn metal(alpha: f32) -> MaterialKind {
        let fresnel = ConductorFresnel::EtaK { eta: [0.2; 3], k: [3.0; 3] };
        MaterialKind::Conductor { fresnel, roughness: Roughness::constant(alpha, alpha, false) }
    }

    #[test]
    fn parameters_out_of_range_are_refused_by_name() {
        for bad in [-0.1, f32::NAN, f32::INFINITY] {
            assert!(surface(diffuse([0.5, bad, 0.5])).is_err_and(|e| e.contains("material \"m\"")), "{bad}");
            assert!(surface(metal(bad)).is_err(), "{bad}");
        }
        assert!(surface(metal(11.0)).is_err());
        assert!(surface(metal(0.0)).is_ok_and(|s| !s.several_lobes && !s.anisotropic));
        assert!(surface(diffuse([0.0; 3])).is_ok_and(|s| s.black));
    }

    #[test]
    fn reflectances_lie_between_0_and_1() {
        let pixels = vec![[-0.5, 2.0, f32::NAN]];
        let picture = Arc::new(Picture::new([1, 1], pixels).expect("one pixel"));
        let kind = TextureKind::Image {
            picture,
            scale: [1.0; 2],
            shift: [0.0; 2],
            factor: 1.0,
            invert: false,
            wrap: Wrap::Repeat,
        };
        let textures = Textures::new(&[Texture { name: String::new(), kind, source: Source::default() }]);
        let color = Color::Texture(TextureId(0));
        let coated = MaterialKind::CoatedDiffuse {
            reflectance: color,
            roughness: Roughness::constant(0.0, 0.0, false),
            eta: 1.5,
            thickness: 0.01,
            albedo: Color::Constant([0.0; 3]),
            g: 0.0,
            max_depth: 10,
            samples: 1,
        };
        let roughness = Roughness::constant(0.3, 0.3, false);
        let tinted = MaterialKind::Conductor { fresnel: ConductorFresnel::Reflectance(color), roughness };
        for kind in [MaterialKind::Diffuse { reflectance: color }, coated, tinted] {
            let surface = surface(kind.clone()).unwrap_or_else(|e| panic!("{e}"));
            assert!(surface.textured);
            let bsdf = surface.bsdf(&textures, [0.5, 0.5]);
            let up = Vec3::new(0.0, 0.6, 0.8);
            let f = bsdf.evaluate(up, up).to_array();
            assert!(f.iter().all(|x| *x >= 0.0 && x.is_finite()), "{kind:?}: {f:?}");
            let albedo = bsdf.albedo().to_array();
            assert!(albedo.iter().all(|a| (0.0..=1.0).contains(a)), "{kind:?}: {albedo:?}");
        }
    }
}
