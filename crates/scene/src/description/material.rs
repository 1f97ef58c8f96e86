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

/// The scattering of a material. Parameters are pbrt-v4's, or those of the older pbrt version that has the material.
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
    /// The surface of glTF [Khronos 2021]: a share of metal, the rest diffuse below a glossy layer, and a clear coat above.
    Layered {
        /// The colour: of diffuse reflection, and of a metal's reflection along the normal.
        base: Color,
        /// The share of metal, 0 to 1.
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

/// A clear coat of index of refraction 1.5, as in glTF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClearCoat {
    /// The share of the surface that is coated, 0 to 1.
    pub amount: f32,
    /// Microfacet width of the coat.
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
    /// The largest number of scattering events in pbrt-v4's random walk between the layers.
    pub max_depth: u32,
    /// The number of random walks that pbrt-v4 averages per evaluation.
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

/// A colour: constant, or a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Color {
    /// A constant colour, linear RGB.
    Constant([f32; 3]),
    /// A texture that gives the colour.
    Texture(TextureId),
}

/// Smallest microfacet width (alpha) of a rough surface, as in pbrt-v4. A surface of smaller width is treated as
/// smooth.
pub const SMOOTH_ALPHA: f32 = 1e-3;

/// Returns the microfacet width (alpha) of a roughness: `sqrt(roughness)`, as in pbrt-v4.
#[inline]
pub fn roughness_to_alpha(roughness: f32) -> f32 {
    roughness.max(0.0).sqrt()
}

/// Returns true if a surface with these two microfacet widths (alpha) is treated as smooth.
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
}

/// A number: constant, or the first channel of a texture whose channels are equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scalar {
    /// A constant value.
    Constant(f32),
    /// The first channel of a texture.
    Texture(TextureId),
}

/// A texture with its name and its place in the file.
#[derive(Clone, Debug)]
pub struct Texture {
    /// The texture's name in the file.
    pub name: String,
    /// The kind of texture, with its parameters.
    pub kind: TextureKind,
    /// File and line of the texture, for messages.
    pub source: Source,
}

/// The kind of a texture.
#[derive(Clone, Debug)]
pub enum TextureKind {
    /// A checkerboard in texture coordinates.
    Checkerboard {
        /// Factors of u and v, applied before the shift.
        scale: [f32; 2],
        /// Offsets added to u and v after `scale`.
        shift: [f32; 2],
        /// The colour where `floor(u) + floor(v)` is even, and the colour where it is odd.
        colors: [Color; 2],
    },
    /// An image, interpolated bilinearly. `v = 0` is its bottom edge, `u = 0` its left edge.
    Image {
        /// The image, decoded to linear RGB, top row first.
        image: Arc<Image>,
        /// Factors of u and v, applied before the shift.
        scale: [f32; 2],
        /// Offsets added to u and v after `scale`.
        shift: [f32; 2],
        /// Factor applied to every pixel value.
        factor: f32,
        /// True if each value, after `factor`, is subtracted from 1; negative results become 0.
        invert: bool,
        /// The values beyond the edges of the image.
        wrap: Wrap,
    },
    /// The product of two colours or textures.
    Product {
        /// The two factors.
        factors: [Color; 2],
    },
    /// A linear interpolation between two colours or textures.
    Mix {
        /// The colour at `amount` 0 and the colour at `amount` 1.
        colors: [Color; 2],
        /// Weight of the second colour, 0 to 1.
        amount: Scalar,
    },
}

/// The values of an image texture beyond the edges of its image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// Black outside the image.
    Black,
    /// The value of the nearest pixel of the image.
    Clamp,
}
