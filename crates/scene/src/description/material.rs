//! Materials.

use super::{Color, Scalar, Source, TextureId};

/// Index of a material in [`Scene::materials`](super::Scene::materials).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MaterialId(pub u32);

/// A material: its scattering, and the maps that tilt its shading normals.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The material's name in the file, or a generated name.
    pub name: String,
    /// The kind of scattering, with its parameters.
    pub kind: MaterialKind,
    /// Bump map: heights in units of the file's world space. They tilt shading normals and do not move the surface.
    pub bump: Option<Scalar>,
    /// Normal map: an image of tangent-space normals, `2 rgb - 1`, which replace shading normals.
    pub normal_map: Option<TextureId>,
    /// File and line of the material, for messages.
    pub source: Source,
}

impl Material {
    /// Makes a material without bump map and normal map.
    pub fn new(name: impl Into<String>, kind: MaterialKind, source: Source) -> Self {
        Self { name: name.into(), kind, bump: None, normal_map: None, source }
    }
}

/// The scattering of a material, with the parameters of pbrt-v4, of an older pbrt version or of glTF.
#[derive(Clone, Debug, PartialEq)]
pub enum MaterialKind {
    /// Lambertian (ideal diffuse) reflection.
    Diffuse {
        /// The fraction of light reflected.
        reflectance: Color,
    },
    /// Lambertian reflection and Lambertian transmission, as of a sheet of paper.
    DiffuseTransmission {
        /// The fraction of light reflected.
        reflectance: Color,
        /// The fraction of light transmitted to the other side.
        transmittance: Color,
    },
    /// A metal, smooth or rough (Trowbridge-Reitz).
    Conductor {
        /// Fresnel reflectance of the metal.
        fresnel: ConductorFresnel,
        /// Microfacet roughness of the metal.
        roughness: Roughness,
    },
    /// Glass or another transparent dielectric, smooth or rough. The surface normal points out of it.
    Dielectric {
        /// Index of refraction of the inside divided by that of the outside.
        eta: f32,
        /// Microfacet roughness of the surface.
        roughness: Roughness,
        /// Factor applied to reflected light; white (1) in pbrt-v4.
        reflectance: Color,
        /// Factor applied to transmitted light; white (1) in pbrt-v4.
        transmittance: Color,
    },
    /// A pane of glass, modelled as one surface for both faces: light passes straight through or is reflected.
    ThinDielectric {
        /// Index of refraction of the glass.
        eta: f32,
    },
    /// A dielectric coat over a diffuse base.
    CoatedDiffuse {
        /// Reflectance of the diffuse base.
        reflectance: Color,
        /// The dielectric coat.
        coat: Coating,
    },
    /// A dielectric coat over a metal.
    CoatedConductor {
        /// Fresnel reflectance of the metal.
        fresnel: ConductorFresnel,
        /// Microfacet roughness of the metal.
        roughness: Roughness,
        /// The dielectric coat.
        coat: Coating,
    },
    /// A blend of two materials.
    Mix {
        /// The material at `amount` 0 and the material at `amount` 1.
        materials: [MaterialId; 2],
        /// Weight of the second material, 0 to 1.
        amount: Scalar,
    },
    /// A border between two media, without a surface: light passes straight through, and no scattering event is
    /// counted.
    Interface,
    /// An unlit surface: the camera sees its colour as radiance. Shadow rays and scattered rays pass through it. It neither
    /// lights nor shades other surfaces, and is not visible in mirrors.
    Unlit {
        /// The radiance seen, linear RGB within 0 to 1.
        color: Color,
    },
    /// A perfect mirror without a Fresnel term [pbrt-v3, `mirror`].
    Mirror {
        /// The fraction of light reflected.
        reflectance: Color,
    },
    /// The sum of a Lambertian lobe and the reflection of a rough dielectric of index 1.5 [pbrt-v3, `plastic`].
    Plastic {
        /// The fraction of light reflected diffusely.
        diffuse: Color,
        /// Factor applied to the glossy reflection.
        specular: Color,
        /// Microfacet roughness of the glossy reflection.
        roughness: Roughness,
    },
    /// A glossy coat over a diffuse base [Ashikhmin and Shirley 2000; pbrt-v3, `substrate`].
    Substrate {
        /// Reflectance of the diffuse base.
        diffuse: Color,
        /// Reflectance of the coat at normal incidence.
        specular: Color,
        /// Microfacet roughness of the coat.
        roughness: Roughness,
    },
    /// glTF's surface [Khronos 2021]: a blend of metal and of a diffuse base below a glossy layer, under an optional clear
    /// coat.
    Layered {
        /// The base colour: the diffuse reflectance, and the metal's Fresnel reflectance along the normal.
        base: Color,
        /// The fraction of metal, 0 to 1.
        metallic: Scalar,
        /// Fresnel reflectance of the glossy layer along the normal, 0 to 1.
        normal: [f32; 3],
        /// Fresnel reflectance of the glossy layer at grazing angles, 0 to 1.
        grazing: f32,
        /// Microfacet roughness of the glossy layer and of the metal.
        roughness: Roughness,
        /// The clear coat.
        coat: Option<ClearCoat>,
    },
}

impl MaterialKind {
    /// Returns a short name of the kind, such as "coated diffuse", for messages.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Diffuse { .. } => "diffuse",
            Self::DiffuseTransmission { .. } => "diffuse transmission",
            Self::Conductor { .. } => "conductor",
            Self::Dielectric { .. } => "dielectric",
            Self::ThinDielectric { .. } => "thin dielectric",
            Self::CoatedDiffuse { .. } => "coated diffuse",
            Self::CoatedConductor { .. } => "coated conductor",
            Self::Mix { .. } => "mix",
            Self::Interface => "interface",
            Self::Unlit { .. } => "unlit",
            Self::Mirror { .. } => "mirror",
            Self::Plastic { .. } => "plastic",
            Self::Substrate { .. } => "substrate",
            Self::Layered { .. } => "layered",
        }
    }

    /// Returns the non-diffuse lobes, which decide the effects that the material uses.
    pub(crate) fn lobes(&self) -> Vec<Lobe<'_>> {
        let black = |color: &Color| *color == Color::Constant([0.0; 3]);
        let reflecting = |what, roughness| Lobe { what, roughness: Some(roughness), refracts: false };
        match self {
            Self::Conductor { roughness, .. } => vec![reflecting("a metal", roughness)],
            Self::Dielectric { reflectance, transmittance, .. } if black(reflectance) && black(transmittance) => {
                Vec::new()
            }
            Self::Dielectric { roughness, .. } => {
                vec![Lobe { what: "glass", roughness: Some(roughness), refracts: true }]
            }
            Self::ThinDielectric { .. } => vec![Lobe { what: "a pane", roughness: None, refracts: true }],
            Self::CoatedDiffuse { coat, .. } => vec![reflecting("coated", &coat.roughness)],
            Self::CoatedConductor { roughness, coat, .. } => {
                vec![reflecting("coated", &coat.roughness), reflecting("a coated metal", roughness)]
            }
            Self::Mirror { reflectance } if black(reflectance) => Vec::new(),
            Self::Mirror { .. } => vec![Lobe { what: "a mirror", roughness: None, refracts: false }],
            Self::Plastic { specular, .. } if black(specular) => Vec::new(),
            Self::Plastic { roughness, .. } => vec![reflecting("plastic", roughness)],
            Self::Substrate { roughness, .. } => vec![reflecting("coated", roughness)],
            Self::Layered { metallic, roughness, .. } => {
                let metal = *metallic == Scalar::Constant(1.0);
                vec![reflecting(if metal { "a metal" } else { "plastic" }, roughness)]
            }
            Self::Diffuse { .. }
            | Self::DiffuseTransmission { .. }
            | Self::Mix { .. }
            | Self::Interface
            | Self::Unlit { .. } => Vec::new(),
        }
    }

    /// Calls `visit` with each parameter that may be textured, colours first, and the parameter's name for messages. The name
    /// "color" marks the colour that most affects the albedo.
    pub(crate) fn each_parameter(&mut self, mut visit: impl FnMut(&'static str, Parameter<'_>)) {
        let visit = &mut visit;
        match self {
            Self::Diffuse { reflectance: color } | Self::Mirror { reflectance: color } | Self::Unlit { color } => {
                visit("color", Parameter::Color(color))
            }
            Self::DiffuseTransmission { reflectance, transmittance } => {
                visit("color", Parameter::Color(reflectance));
                visit("transmitted color", Parameter::Color(transmittance));
            }
            Self::Conductor { fresnel, roughness } => {
                fresnel.each_parameter(visit);
                roughness.each_parameter(visit);
            }
            Self::Dielectric { roughness, reflectance, transmittance, .. } => {
                visit("color", Parameter::Color(reflectance));
                visit("transmitted color", Parameter::Color(transmittance));
                roughness.each_parameter(visit);
            }
            Self::CoatedDiffuse { reflectance, coat } => {
                visit("color", Parameter::Color(reflectance));
                visit("albedo of the coat", Parameter::Color(&mut coat.albedo));
                coat.roughness.each_parameter(visit);
            }
            Self::CoatedConductor { fresnel, roughness, coat } => {
                fresnel.each_parameter(visit);
                visit("albedo of the coat", Parameter::Color(&mut coat.albedo));
                coat.roughness.each_parameter(visit);
                roughness.each_parameter(visit);
            }
            Self::Mix { amount, .. } => visit("amount of a mix", Parameter::Scalar(amount)),
            Self::Plastic { diffuse, specular, roughness } | Self::Substrate { diffuse, specular, roughness } => {
                visit("color", Parameter::Color(diffuse));
                visit("specular color", Parameter::Color(specular));
                roughness.each_parameter(visit);
            }
            Self::Layered { base, metallic, roughness, .. } => {
                visit("color", Parameter::Color(base));
                roughness.each_parameter(visit);
                visit("metallic", Parameter::Scalar(metallic));
            }
            Self::ThinDielectric { .. } | Self::Interface => {}
        }
    }
}

/// A parameter of a material that may be textured.
pub(crate) enum Parameter<'m> {
    Color(&'m mut Color),
    Scalar(&'m mut Scalar),
}

/// A non-diffuse lobe of a material.
pub(crate) struct Lobe<'m> {
    /// The lobe's description for messages, such as "a metal".
    pub(crate) what: &'static str,
    /// Microfacet roughness of the lobe; `None` for a perfectly smooth lobe.
    pub(crate) roughness: Option<&'m Roughness>,
    /// True if the lobe transmits light.
    pub(crate) refracts: bool,
}

impl Lobe<'_> {
    /// Returns two flags: the lobe may be smooth, and the lobe may be rough. A textured roughness sets both.
    pub(crate) fn smooth_or_rough(&self) -> [bool; 2] {
        match self.roughness.map(Roughness::alpha) {
            None => [true, false],
            Some(None) => [true, true],
            Some(Some(alpha)) => [effectively_smooth(alpha), !effectively_smooth(alpha)],
        }
    }
}

/// A clear coat of index of refraction 1.5, as in glTF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClearCoat {
    /// The fraction of the surface that is coated, 0 to 1.
    pub amount: f32,
    /// Microfacet width (alpha) of the coat: the square of glTF's roughness.
    pub alpha: f32,
}

/// The Fresnel reflectance of a metal, by its index of refraction or by its colour.
#[derive(Clone, Debug, PartialEq)]
pub enum ConductorFresnel {
    /// A complex index of refraction, `eta + i k`, for each of R, G and B.
    EtaK {
        /// Real part of the index of refraction, RGB.
        eta: [f32; 3],
        /// Imaginary part of the index of refraction, RGB.
        k: [f32; 3],
    },
    /// Reflectance at normal incidence; the real part of the index of refraction is 1.
    Reflectance(Color),
}

impl ConductorFresnel {
    fn each_parameter(&mut self, visit: &mut impl FnMut(&'static str, Parameter<'_>)) {
        if let Self::Reflectance(reflectance) = self {
            visit("color", Parameter::Color(reflectance));
        }
    }
}

/// The parameters of a dielectric coat over another material, as in pbrt-v4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coating {
    /// Microfacet roughness of the coat.
    pub roughness: Roughness,
    /// Index of refraction of the coat.
    pub eta: f32,
    /// Optical thickness of the coat along its normal.
    pub thickness: f32,
    /// Single-scattering albedo of the medium inside the coat.
    pub albedo: Color,
    /// Henyey-Greenstein asymmetry of the medium inside the coat, -1 to 1.
    pub g: f32,
    /// The largest number of scattering events on a path between the coat and the material under it.
    pub max_depth: u32,
    /// The number of random walks that pbrt-v4 averages per evaluation; Dapple's renderer ignores it.
    pub samples: u32,
}

/// The defaults of pbrt-v4's coat: smooth, index of refraction 1.5, no medium inside.
impl Default for Coating {
    fn default() -> Self {
        let (roughness, albedo) = (Roughness::constant(0.0, 0.0, false), Color::Constant([0.0; 3]));
        Self { roughness, eta: 1.5, thickness: 0.01, albedo, g: 0.0, max_depth: 10, samples: 1 }
    }
}

/// Microfacet roughness along the two tangents of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Roughness along the tangent u.
    pub u: Scalar,
    /// Roughness along the tangent v.
    pub v: Scalar,
    /// True if the microfacet width is `alpha = sqrt(roughness)`, false if `alpha = roughness`.
    pub remap: bool,
}

/// Smallest microfacet width (alpha) of a rough surface, as in pbrt-v4. A surface of smaller width is treated as
/// smooth.
pub const SMOOTH_ALPHA: f32 = 1e-3;

/// Returns the microfacet width (alpha) of a roughness: `sqrt(max(roughness, 0))`, as in pbrt-v4.
#[inline]
pub fn roughness_to_alpha(roughness: f32) -> f32 {
    roughness.max(0.0).sqrt()
}

/// Returns true if both microfacet widths (alpha) are below [`SMOOTH_ALPHA`], so that the surface is treated as smooth.
#[inline]
pub fn effectively_smooth(alpha: [f32; 2]) -> bool {
    alpha[0].max(alpha[1]) < SMOOTH_ALPHA
}

impl Roughness {
    /// Makes a roughness of constant values along u and v.
    pub const fn constant(u: f32, v: f32, remap: bool) -> Self {
        Self { u: Scalar::Constant(u), v: Scalar::Constant(v), remap }
    }

    /// Returns the roughness along u and along v; `None` if either is a texture.
    pub fn constants(&self) -> Option<[f32; 2]> {
        match (self.u, self.v) {
            (Scalar::Constant(u), Scalar::Constant(v)) => Some([u, v]),
            _ => None,
        }
    }

    /// Returns the microfacet widths (alpha) along u and v; `None` if a texture sets either.
    pub(crate) fn alpha(&self) -> Option<[f32; 2]> {
        let alpha = |r| if self.remap { roughness_to_alpha(r) } else { r };
        self.constants().map(|r| r.map(alpha))
    }

    fn each_parameter(&mut self, visit: &mut impl FnMut(&'static str, Parameter<'_>)) {
        visit("roughness", Parameter::Scalar(&mut self.u));
        visit("roughness", Parameter::Scalar(&mut self.v));
    }
}
