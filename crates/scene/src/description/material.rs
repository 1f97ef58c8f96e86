//! Materials and textures.

use super::Source;
use crate::image::Image;
use std::sync::Arc;

/// Number of a material in [`Scene::materials`](super::Scene::materials).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MaterialId(pub u32);

/// Number of a texture in [`Scene::textures`](super::Scene::textures).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub u32);

/// A named or anonymous material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name, or a made-up one.
    pub name: String,
    /// Its scattering.
    pub kind: MaterialKind,
    /// A height over the surface, in units of the file's world space, that tilts its shading normals; the surface stays.
    pub bump: Option<Scalar>,
    /// An image of tangent-space normals, `2 rgb - 1`, that turns its shading normals.
    pub normal_map: Option<TextureId>,
    /// File and line.
    pub source: Source,
}

impl Material {
    /// A material on smooth surfaces.
    pub fn new(name: impl Into<String>, kind: MaterialKind, source: Source) -> Self {
        Self { name: name.into(), kind, bump: None, normal_map: None, source }
    }
}

/// The scattering of a material. Parameters are pbrt-v4's; those of older versions are theirs.
#[derive(Clone, Debug, PartialEq)]
pub enum MaterialKind {
    /// Lambert.
    Diffuse {
        /// Share of light reflected.
        reflectance: Color,
    },
    /// Lambert on both sides: a sheet of paper.
    DiffuseTransmission {
        /// Share of light reflected.
        reflectance: Color,
        /// Share of light that comes out on the other side.
        transmittance: Color,
    },
    /// A metal, smooth or rough (Trowbridge-Reitz).
    Conductor {
        /// Its index of refraction.
        fresnel: ConductorFresnel,
        /// Its microfacets.
        roughness: Roughness,
    },
    /// Glass, smooth or rough. Its normal points out of it.
    Dielectric {
        /// Index of refraction of the inside over that of the outside.
        eta: f32,
        /// Its microfacets.
        roughness: Roughness,
        /// Factor of reflected light; white since pbrt-v4.
        reflectance: Color,
        /// Factor of transmitted light; white since pbrt-v4.
        transmittance: Color,
    },
    /// A pane of glass, both of whose faces are one shape: light goes straight through or is mirrored.
    ThinDielectric {
        /// Its index of refraction.
        eta: f32,
    },
    /// A dielectric coat over a diffuse base.
    CoatedDiffuse {
        /// The base's reflectance.
        reflectance: Color,
        /// The coat.
        coat: Coating,
    },
    /// A dielectric coat over a metal.
    CoatedConductor {
        /// The metal's index of refraction.
        fresnel: ConductorFresnel,
        /// The metal's microfacets.
        roughness: Roughness,
        /// The coat.
        coat: Coating,
    },
    /// A blend of two materials.
    Mix {
        /// The materials at `amount` 0 and at `amount` 1.
        materials: [MaterialId; 2],
        /// Share of the second.
        amount: Scalar,
    },
    /// Nothing but a border between two media: light passes straight through, and no scattering event is counted.
    Interface,
    /// A perfect mirror without a Fresnel term [pbrt-v3, `mirror`].
    Mirror {
        /// Share of light reflected.
        reflectance: Color,
    },
    /// A sum of Lambert's reflection and a rough dielectric's of index 1.5 [pbrt-v3, `plastic`].
    Plastic {
        /// Share of light reflected diffusely.
        diffuse: Color,
        /// Factor of the glossy reflection.
        specular: Color,
        /// Microfacets of the glossy reflection.
        roughness: Roughness,
    },
    /// A glossy coat over a diffuse base [Ashikhmin and Shirley 2000; pbrt-v3, `substrate`].
    Substrate {
        /// Reflectance of the base.
        diffuse: Color,
        /// Reflectance of the coat at normal incidence.
        specular: Color,
        /// Microfacets of the coat.
        roughness: Roughness,
    },
}

/// The Fresnel term of a metal.
#[derive(Clone, Debug, PartialEq)]
pub enum ConductorFresnel {
    /// Complex index of refraction, per channel.
    EtaK {
        /// Real part.
        eta: [f32; 3],
        /// Imaginary part.
        k: [f32; 3],
    },
    /// The reflectance at normal incidence, `eta` being 1.
    Reflectance(Color),
}

/// A dielectric layer over another material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coating {
    /// Its microfacets.
    pub roughness: Roughness,
    /// Its index of refraction.
    pub eta: f32,
    /// Its thickness.
    pub thickness: f32,
    /// Scattering albedo within it.
    pub albedo: Color,
    /// Henyey-Greenstein asymmetry within it.
    pub g: f32,
    /// Most events of the walk between the layers.
    pub max_depth: u32,
    /// Walks per evaluation.
    pub samples: u32,
}

/// pbrt-v4's, smooth.
impl Default for Coating {
    fn default() -> Self {
        let (roughness, albedo) = (Roughness::constant(0.0, 0.0, false), Color::Constant([0.0; 3]));
        Self { roughness, eta: 1.5, thickness: 0.01, albedo, g: 0.0, max_depth: 10, samples: 1 }
    }
}

/// Microfacet roughness along the two tangents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Along u.
    pub u: Scalar,
    /// Along v.
    pub v: Scalar,
    /// True for `alpha = sqrt(roughness)`, false for `alpha = roughness`.
    pub remap: bool,
}

/// A colour: constant, or looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Color {
    /// Linear RGB.
    Constant([f32; 3]),
    /// A texture.
    Texture(TextureId),
}

/// Smallest microfacet width (alpha) of a rough surface, as in pbrt-v4: narrower ones are smooth.
pub const SMOOTH_ALPHA: f32 = 1e-3;

/// The microfacet width of a roughness: `sqrt(roughness)`, as pbrt-v4 remaps it.
#[inline]
pub fn roughness_to_alpha(roughness: f32) -> f32 {
    roughness.max(0.0).sqrt()
}

/// True if a surface with these microfacet widths counts as smooth.
#[inline]
pub fn effectively_smooth(alpha: [f32; 2]) -> bool {
    alpha[0].max(alpha[1]) < SMOOTH_ALPHA
}

impl Roughness {
    /// The same everywhere.
    pub const fn constant(u: f32, v: f32, remap: bool) -> Self {
        Self { u: Scalar::Constant(u), v: Scalar::Constant(v), remap }
    }

    /// Both roughnesses, where neither is looked up.
    pub fn constants(&self) -> Option<[f32; 2]> {
        match (self.u, self.v) {
            (Scalar::Constant(u), Scalar::Constant(v)) => Some([u, v]),
            _ => None,
        }
    }
}

/// A number: constant, or looked up (the first channel of a texture, whose channels agree).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scalar {
    /// The same everywhere.
    Constant(f32),
    /// A texture.
    Texture(TextureId),
}

/// A texture with its name and line.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: TextureKind,
    /// File and line.
    pub source: Source,
}

/// The kind of a texture.
#[derive(Clone, Debug)]
pub enum TextureKind {
    /// Squares in texture space.
    Checkerboard {
        /// u and v are scaled by this, then shifted.
        scale: [f32; 2],
        /// Shift of u and v.
        shift: [f32; 2],
        /// The colors where `floor(u) + floor(v)` is even, and where it is odd.
        colors: [Color; 2],
    },
    /// An image, repeated, bilinear. `v = 0` is its bottom edge, `u = 0` its left one.
    Image {
        /// Decoded to linear RGB, top row first.
        image: Arc<Image>,
        /// u and v are scaled by this, then shifted.
        scale: [f32; 2],
        /// Shift of u and v.
        shift: [f32; 2],
        /// Every value is multiplied by this.
        factor: f32,
        /// True if every value is then subtracted from 1, with negative results set to 0.
        invert: bool,
        /// The values beyond its edges.
        wrap: Wrap,
    },
    /// Two textures, multiplied.
    Product {
        /// The factors.
        factors: [Color; 2],
    },
    /// An interpolation between two textures.
    Mix {
        /// The colors at `amount` 0 and at `amount` 1.
        colors: [Color; 2],
        /// Share of the second.
        amount: Scalar,
    },
}

/// The values of an image beyond its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The image again.
    #[default]
    Repeat,
    /// Nothing.
    Black,
    /// The nearest pixel.
    Clamp,
}
