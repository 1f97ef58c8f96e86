//! Textures, and parameters that may be textured.

use super::Source;
use crate::image::Image;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// Index of a texture in [`Scene::textures`](super::Scene::textures).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub u32);

/// A colour: constant, or a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Color {
    /// A constant colour, linear RGB.
    Constant([f32; 3]),
    /// A texture, whose value is the colour.
    Texture(TextureId),
}

/// A number: constant, or the first channel of a texture.
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
    /// The vertex colours of the mesh, interpolated; white on shapes without any.
    VertexColor,
    /// A linear interpolation between two colours or textures.
    Mix {
        /// The colour at `amount` 0 and the colour at `amount` 1.
        colors: [Color; 2],
        /// Weight of the second colour, 0 to 1.
        amount: Scalar,
    },
}

impl TextureKind {
    /// Makes an image texture that repeats, multiplied by `factor`.
    pub(crate) fn image(image: Arc<Image>, factor: f32) -> Self {
        Self::Image { image, scale: [1.0; 2], shift: [0.0; 2], factor, invert: false, wrap: Wrap::Repeat }
    }
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

/// The deepest nesting of textures within textures. Deeper textures count as black.
const DEEPEST: u32 = 8;

/// Returns the mean colour of a texture over the unit square of texture coordinates, linear RGB.
///
/// The mean of a checkerboard is the mean of its two colours. The mean of a product is the product of its factors'
/// means, and the mean of a mix is the mix of its colours' means. An image is averaged over all its pixels. Vertex colours
/// count as white. A missing texture is black.
pub(crate) fn texture_mean(textures: &[Texture], id: TextureId) -> [f32; 3] {
    mean_within(textures, id, DEEPEST).to_array()
}

fn mean_within(textures: &[Texture], id: TextureId, depth: u32) -> Vec3 {
    let Some(texture) = textures.get(id.0 as usize).filter(|_| depth > 0) else { return Vec3::ZERO };
    let color = |color: &Color| match color {
        Color::Constant(rgb) => Vec3::from_array(*rgb),
        Color::Texture(id) => mean_within(textures, *id, depth - 1),
    };
    match &texture.kind {
        TextureKind::Checkerboard { colors: [a, b], .. } => 0.5 * (color(a) + color(b)),
        TextureKind::Image { image, factor, invert, .. } => {
            let sum = |sum: DVec3, pixel: &[f32; 3]| {
                let value = Vec3::from_array(*pixel) * *factor;
                sum + if *invert { (Vec3::ONE - value).max(Vec3::ZERO) } else { value }.as_dvec3()
            };
            let sum = image.pixels.iter().fold(DVec3::ZERO, sum);
            (sum / image.pixels.len().max(1) as f64).as_vec3()
        }
        TextureKind::Product { factors: [a, b] } => color(a) * color(b),
        TextureKind::VertexColor => Vec3::ONE,
        TextureKind::Mix { colors: [a, b], amount } => {
            let amount = match amount {
                Scalar::Constant(amount) => *amount,
                Scalar::Texture(id) => mean_within(textures, *id, depth - 1).x,
            };
            color(a).lerp(color(b), amount)
        }
    }
}
