//! Images and textures of a glTF file.

use super::buffers::{beside, read_uri};
use super::{Reader, named};
use crate::image::{Encoding, Image, read_texture};
use crate::{Color, Scalar, TextureId, TextureKind, Wrap};
use ::gltf::json;
use ::gltf::json::texture::{MagFilter, WrappingMode};
use ::gltf::material::NormalTexture;
use ::gltf::texture::Info;
use serde_json::Value;
use std::sync::Arc;

/// The part of an image that a parameter reads, and its conversion. Floats are stored as bits, so that this can be a map key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Part {
    /// The colour, sRGB.
    Color,
    /// A tangent-space normal, whose x and y are scaled by this factor.
    Normal(u32),
    /// One channel (0 is red), linear.
    Channel(usize),
    /// The square of one linear channel: the microfacet width (alpha) of a roughness.
    Squared(usize),
    /// Opacity.
    Alpha,
    /// Opacity: 1 where it is at least this, else 0.
    Mask(u32),
    /// The microfacet width (alpha) of a surface whose glossiness is the opacity times this factor.
    Glossiness(u32),
}

/// A use of a texture by a material: the texture, its set of coordinates and its transform.
pub(super) struct Use<'a> {
    pub(super) texture: ::gltf::Texture<'a>,
    pub(super) set: u32,
    /// Scale and offset of the coordinates, as in the file.
    scale: [f32; 2],
    offset: [f32; 2],
    rotated: bool,
}

impl<'a> Use<'a> {
    pub(super) fn of(info: &Info<'a>) -> Self {
        let plain = Self::plain(info.texture(), info.tex_coord());
        let Some(moved) = info.texture_transform() else { return plain };
        let (set, rotated) = (moved.tex_coord().unwrap_or(plain.set), moved.rotation() != 0.0);
        Self { set, scale: moved.scale(), offset: moved.offset(), rotated, ..plain }
    }

    fn plain(texture: ::gltf::Texture<'a>, set: u32) -> Self {
        Self { texture, set, scale: [1.0; 2], offset: [0.0; 2], rotated: false }
    }

    /// The use of a normal map. The crate `gltf` provides the transform of a normal map only as JSON.
    pub(super) fn of_normals(map: &NormalTexture<'a>) -> Self {
        let plain = Self::plain(map.texture(), map.tex_coord());
        let Some(moved) = map.extension_value("KHR_texture_transform") else { return plain };
        let number = |value: Option<&Value>| value.and_then(Value::as_f64).map(|v| v as f32).filter(|v| v.is_finite());
        let pair = |key: &str, default: f32| {
            [0, 1].map(|i| number(moved.get(key).and_then(|pair| pair.get(i))).unwrap_or(default))
        };
        let set = moved.get("texCoord").and_then(Value::as_u64).and_then(|set| set.try_into().ok());
        Self {
            set: set.unwrap_or(plain.set),
            scale: pair("scale", 1.0),
            offset: pair("offset", 0.0),
            rotated: number(moved.get("rotation")).is_some_and(|angle| angle != 0.0),
            ..plain
        }
    }

    /// The scale and the shift of Dapple's texture coordinates, whose v is 1 minus glTF's.
    fn transform(&self) -> [[f32; 2]; 2] {
        [self.scale, [self.offset[0], 1.0 - self.offset[1] - self.scale[1]]]
    }
}

impl Reader<'_> {
    /// Returns the colour `factor` times a texture; just `factor` if there is no texture, or its image cannot be read.
    pub(super) fn color(&mut self, info: Option<Info<'_>>, factor: [f32; 3]) -> Color {
        let even = factor[0] == factor[1] && factor[1] == factor[2];
        let scale = if even { factor[0] } else { 1.0 };
        match info.and_then(|info| self.texture(&Use::of(&info), Part::Color, scale)) {
            None => Color::Constant(factor),
            Some(id) if even => Color::Texture(id),
            Some(id) => {
                let kind = TextureKind::Product { factors: [Color::Constant(factor), Color::Texture(id)] };
                Color::Texture(self.scene.add_texture("product", kind, self.source))
            }
        }
    }

    /// Returns the number `factor` times a part of a texture; just `factor` if there is no texture, or its image cannot be
    /// read.
    pub(super) fn number(&mut self, info: Option<Info<'_>>, part: Part, factor: f32) -> Scalar {
        let id = info.and_then(|info| self.texture(&Use::of(&info), part, factor));
        id.map_or(Scalar::Constant(factor), Scalar::Texture)
    }

    /// A part of a texture times `factor`. `None`, with a notice, if the image cannot be read.
    pub(super) fn texture(&mut self, info: &Use<'_>, part: Part, factor: f32) -> Option<TextureId> {
        let name = named("texture", info.texture.index(), info.texture.name());
        let texture = &self.document.as_json().textures[info.texture.index()];
        // The mark of a texture without a source.
        if texture.source.value() == u32::MAX as usize {
            let extensions: Vec<&str> =
                texture.extensions.iter().flat_map(|found| found.others.keys()).map(String::as_str).collect();
            let needed = extensions.join(", ");
            let only = if needed.is_empty() { "it has none".into() } else { format!("its image needs {needed}") };
            self.warn(format!("{name} has no supported image ({only}); a constant is used instead"));
            return None;
        }
        let image = self.image(texture.source.value(), part)?;
        self.check_rotation(info);
        let sampler = info.texture.sampler();
        let wrap = [sampler.wrap_s(), sampler.wrap_t()];
        if wrap.contains(&WrappingMode::MirroredRepeat) {
            self.warn(format!("{name}: it repeats without the mirroring in the file"));
        }
        if wrap[0] != wrap[1] {
            self.warn(format!("{name}: u and v have different wrap modes; both use that of u"));
        }
        if sampler.mag_filter() == Some(MagFilter::Nearest) {
            self.warn(format!("{name}: its texels are interpolated, not the nearest ones as in the file"));
        }
        let wrap = if wrap[0] == WrappingMode::ClampToEdge { Wrap::Clamp } else { Wrap::Repeat };
        let [scale, shift] = info.transform();
        let kind = TextureKind::Image { image, scale, shift, factor, invert: false, wrap };
        Some(self.scene.add_texture(name, kind, self.source))
    }

    /// Adds a notice if the coordinates of a use are rotated.
    fn check_rotation(&mut self, info: &Use<'_>) {
        if info.rotated {
            let name = named("texture", info.texture.index(), info.texture.name());
            self.warn(format!("{name}: the rotation of its coordinates is left out"));
        }
    }

    /// A part of an image. `None`, with a notice, if it cannot be read.
    fn image(&mut self, index: usize, part: Part) -> Option<Arc<Image>> {
        if let Some(known) = self.images.get(&(index, part)) {
            return known.clone();
        }
        let image = match self.decode(index, part) {
            Ok((image, notices)) => {
                notices.into_iter().for_each(|notice| self.warn(notice));
                Some(Arc::new(image))
            }
            Err(what) => {
                let name = self.document.images().nth(index).and_then(|image| image.name()).map(str::to_owned);
                let name = named("image", index, name.as_deref());
                self.warn(format!("{name} cannot be read, so a constant is used instead: {what}"));
                None
            }
        };
        self.images.insert((index, part), image.clone());
        image
    }

    fn decode(&self, index: usize, part: Part) -> Result<(Image, Vec<String>), String> {
        let json: &json::Image = self.document.as_json().images.get(index).ok_or("it does not exist")?;
        let name = match &json.uri {
            Some(uri) if !uri.starts_with("data:") => beside(uri, &self.source.file).display().to_string(),
            _ => format!("image {index}"),
        };
        let bytes = match (&json.uri, json.buffer_view) {
            (Some(uri), _) => read_uri(uri, self.files, &self.source.file)?,
            (None, Some(view)) => {
                let view = self.document.views().nth(view.value()).ok_or("its buffer does not exist")?;
                self.buffers.view(&view).ok_or("it reaches beyond its buffer")?.to_vec()
            }
            (None, None) => return Err("it names no file".into()),
        };
        let encoding = if part == Part::Color { Encoding::Srgb } else { Encoding::Linear };
        let (image, notices) = read_texture(&bytes, &name, encoding).map_err(|e| e.to_string())?;
        Ok((part.of(image), notices))
    }
}

impl Part {
    fn of(self, mut image: Image) -> Image {
        let alpha = std::mem::take(&mut image.alpha);
        let opacity = |i: usize| alpha.get(i).copied().unwrap_or(1.0);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            *pixel = match self {
                Self::Color => *pixel,
                Self::Normal(scale) => scaled_normal(*pixel, f32::from_bits(scale)),
                Self::Channel(c) => [pixel[c]; 3],
                Self::Squared(c) => [pixel[c] * pixel[c]; 3],
                Self::Alpha => [opacity(i); 3],
                Self::Mask(cutoff) => [f32::from(opacity(i) >= f32::from_bits(cutoff)); 3],
                Self::Glossiness(factor) => {
                    let roughness = (1.0 - opacity(i) * f32::from_bits(factor)).clamp(0.0, 1.0);
                    [roughness * roughness; 3]
                }
            };
        }
        image
    }
}

/// The normal `2 rgb - 1` with x and y times `scale`, encoded as RGB again.
fn scaled_normal(rgb: [f32; 3], scale: f32) -> [f32; 3] {
    if scale == 1.0 {
        return rgb;
    }
    let [x, y, z] = rgb.map(|c| 2.0 * c - 1.0);
    let [x, y] = [x * scale, y * scale];
    let length = (x * x + y * y + z * z).sqrt().max(1e-6);
    [x, y, z].map(|c| 0.5 + 0.5 * c / length)
}
