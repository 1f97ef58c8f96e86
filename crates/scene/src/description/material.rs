//! Materials and textures.

use super::Source;
use crate::image::Image;
use std::sync::Arc;

/// Index of a material in [`Scene::materials`](super::Scene::materials).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MaterialId(pub u32);

/// Index of a texture in [`Scene::textures`](super::Scene::textures).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub u32);

/// A material: its scattering, and the maps that tilt its normals.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file, or a generated one.
    pub name: String,
    /// The kind of scattering, with its parameters.
    pub kind: MaterialKind,
    /// Bump map: a height in units of the file's world space, which tilts shading normals and leaves the surface in
    /// place.
    pub bump: Option<Scalar>,
    /// Normal map: an image of tangent-space normals, `2 rgb - 1`, which replace shading normals.
    pub normal_map: Option<TextureId>,
    /// File and line.
    pub source: Source,
}

impl Material {
    /// Makes a material without bump and normal map.
    pub fn new(name: impl Into<String>, kind: MaterialKind, source: Source) -> Self {
        Self { name: name.into(), kind, bump: None, normal_map: None, source }
    }
}

/// The scattering of a material. Parameters are pbrt-v4's, or those of the older pbrt version that has the material.
#[derive(Clone, Debug, PartialEq)]
pub enum MaterialKind {
    /// Lambert.
    Diffuse {
        /// Share of light reflected.
        reflectance: Color,
    },
    /// Lambert's reflection, and the same through the surface: a sheet of paper.
    DiffuseTransmission {
        /// Share of light reflected.
        reflectance: Color,
        /// Share of light transmitted to the other side.
        transmittance: Color,
    },
    /// A metal, smooth or rough (Trowbridge-Reitz).
    Conductor {
        /// The metal's Fresnel term.
        fresnel: ConductorFresnel,
        /// Microfacet roughness.
        roughness: Roughness,
    },
    /// Glass, smooth or rough. The surface's normal points out of the glass.
    Dielectric {
        /// Index of refraction of the inside over that of the outside.
        eta: f32,
        /// Microfacet roughness.
        roughness: Roughness,
        /// Factor of reflected light; always white in pbrt-v4.
        reflectance: Color,
        /// Factor of transmitted light; always white in pbrt-v4.
        transmittance: Color,
    },
    /// A pane of glass, one shape for both faces: light passes straight through or is reflected.
    ThinDielectric {
        /// Index of refraction of the glass.
        eta: f32,
    },
    /// A dielectric coat over a diffuse base.
    CoatedDiffuse {
        /// Reflectance of the base.
        reflectance: Color,
        /// The coat.
        coat: Coating,
    },
    /// A dielectric coat over a metal.
    CoatedConductor {
        /// Fresnel term of the metal.
        fresnel: ConductorFresnel,
        /// Microfacet roughness of the metal.
        roughness: Roughness,
        /// The coat.
        coat: Coating,
    },
    /// A blend of two materials.
    Mix {
        /// The materials at `amount` 0 and at `amount` 1.
        materials: [MaterialId; 2],
        /// Share of the second material, 0 to 1.
        amount: Scalar,
    },
    /// A border between two media. Light passes straight through, without a scattering event being counted.
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
    /// Reflectance at normal incidence; the real part `eta` is 1.
    Reflectance(Color),
}

/// A dielectric layer over another material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coating {
    /// Microfacet roughness.
    pub roughness: Roughness,
    /// Index of refraction.
    pub eta: f32,
    /// Optical thickness along the normal.
    pub thickness: f32,
    /// Scattering albedo inside the coat.
    pub albedo: Color,
    /// Henyey-Greenstein asymmetry inside the coat, -1 to 1.
    pub g: f32,
    /// The largest number of events of pbrt-v4's random walk between the layers.
    pub max_depth: u32,
    /// pbrt-v4's number of random walks per evaluation.
    pub samples: u32,
}

/// pbrt-v4's default coat, smooth.
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

/// A colour: constant or a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Color {
    /// Linear RGB.
    Constant([f32; 3]),
    /// A texture.
    Texture(TextureId),
}

/// Smallest microfacet width (alpha) of a rough surface, as in pbrt-v4. Surfaces of smaller widths are smooth.
pub const SMOOTH_ALPHA: f32 = 1e-3;

/// Returns the microfacet width (alpha) of a roughness: `sqrt(roughness)`, as in pbrt-v4.
#[inline]
pub fn roughness_to_alpha(roughness: f32) -> f32 {
    roughness.max(0.0).sqrt()
}

/// Returns true if a surface with these two microfacet widths counts as smooth.
#[inline]
pub fn effectively_smooth(alpha: [f32; 2]) -> bool {
    alpha[0].max(alpha[1]) < SMOOTH_ALPHA
}

impl Roughness {
    /// Makes a roughness without textures.
    pub const fn constant(u: f32, v: f32, remap: bool) -> Self {
        Self { u: Scalar::Constant(u), v: Scalar::Constant(v), remap }
    }

    /// Returns both roughnesses, or `None` if either is a texture.
    pub fn constants(&self) -> Option<[f32; 2]> {
        match (self.u, self.v) {
            (Scalar::Constant(u), Scalar::Constant(v)) => Some([u, v]),
            _ => None,
        }
    }
}

/// A number: constant, or the first channel of a texture with equal channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scalar {
    /// One value for all points.
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
    /// A checkerboard in texture coordinates.
    Checkerboard {
        /// Factors of u and v, applied before the shift.
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
        /// Factors of u and v, applied before the shift.
        scale: [f32; 2],
        /// Shift of u and v.
        shift: [f32; 2],
        /// Factor of every value.
        factor: f32,
        /// True if every value is then subtracted from 1, with negative results set to 0.
        invert: bool,
        /// The values beyond the image's edges.
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
        /// Share of the second colour, 0 to 1.
        amount: Scalar,
    },
}

/// The values of an image beyond its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// Repeats the image.
    #[default]
    Repeat,
    /// Black.
    Black,
    /// Repeats the nearest pixel.
    Clamp,
}
