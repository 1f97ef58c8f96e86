//! Textures of pbrt scenes, by name, and the images that a scene names. Constant textures become plain values.

use super::directive::Directive;
use super::images::{Channel, Decoding};
use super::params::Params;
use super::reader::Reader;
use super::spectra::Gamut;
use super::tokens::shown;
use super::version::Version;
use crate::{Color, Scalar, TextureId, TextureKind, Wrap};
use std::rc::Rc;

/// The colour in place of an unsupported or invalid texture.
const GREY: Color = Color::Constant([0.5; 3]);

/// The deepest nesting of textures within textures. A look-up evaluates all levels.
const DEEPEST_TEXTURE: u32 = 8;

impl Reader<'_> {
    /// Executes `Texture`: defines a named texture.
    pub(super) fn make_texture(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "texture");
        let [name, ty, class] = &d.texts[..] else { return };
        let line = d.source.line;
        let old = self.context.version.is_old();
        let colors = match ty.as_str() {
            "spectrum" => true,
            "color" if old => true,
            "float" => false,
            _ => {
                params.problem(line, format!("a texture is of type spectrum or float, not {}", shown(ty)));
                params.ignore_rest();
                params.finish(&mut self.log);
                return;
            }
        };
        let known = &params.context.textures;
        let made = if colors { known.spectra.contains_key(name) } else { known.floats.contains_key(name) };
        match made {
            true if old => params.notice(line, format!("texture {} is redefined", shown(name))),
            true => params.problem(line, format!("{ty} texture {} is defined twice; rename one", shown(name))),
            false => {}
        }
        let color = self.texture_color(name, class, colors, &mut params);
        if color.is_none() {
            params.ignore_rest();
            // An unsupported float texture is reported only at its use.
            if colors {
                params.unsupported(line, format!("Texture {}", shown(class)));
            }
        }
        // After this, nothing else holds the textures, so that they aren't copied.
        params.finish(&mut self.log);
        let textures = Rc::make_mut(&mut self.context.textures);
        if colors {
            textures.spectra.insert(name.clone(), color.unwrap_or(GREY));
        } else {
            textures.floats.insert(name.clone(), color.map(scalar_of).ok_or_else(|| class.clone()));
        }
    }

    /// Makes a texture of a class such as `imagemap`, for colours or numbers; `None` if the class is unsupported.
    fn texture_color(&mut self, name: &str, class: &str, colors: bool, params: &mut Params) -> Option<Color> {
        let color = match class {
            "constant" => self.part("value", 1.0, colors, params),
            "checkerboard" => self.checkerboard(name, colors, params),
            "imagemap" => self.image_map(name, colors, params),
            "scale" => {
                let old = self.context.version.is_old();
                let first = self.part(if old { "tex1" } else { "tex" }, 1.0, colors, params);
                // In pbrt-v4 the second factor is a number.
                let second = match (old, colors) {
                    (true, _) => self.part("tex2", 1.0, colors, params),
                    (false, false) => self.part("scale", 1.0, colors, params),
                    (false, true) => color_of(params.scalar("scale", 1.0, |v| v >= 0.0, "at least 0")),
                };
                self.product(name, first, second, params)
            }
            "mix" => {
                let colors = [self.part("tex1", 0.0, colors, params), self.part("tex2", 1.0, colors, params)];
                let range = |v: f64| (0.0..=1.0).contains(&v);
                let amount = params.scalar("amount", 0.5, range, "within 0..=1");
                match (colors, amount) {
                    ([Color::Constant(a), Color::Constant(b)], Scalar::Constant(t)) => {
                        Color::Constant(std::array::from_fn(|i| a[i] * (1.0 - t) + b[i] * t))
                    }
                    _ => self.add_texture(name, TextureKind::Mix { colors, amount }, params),
                }
            }
            _ => return None,
        };
        Some(color)
    }

    /// Takes a parameter of a texture: a constant, or another texture of the same type.
    fn part(&self, name: &'static str, default: f32, colors: bool, params: &mut Params) -> Color {
        match colors {
            true => params.color_in(Gamut::Unbounded, name, [default; 3]),
            false => color_of(params.scalar(name, default, |_| true, "finite")),
        }
    }

    pub(super) fn add_texture(&mut self, name: &str, kind: TextureKind, params: &mut Params) -> Color {
        let depth_of = |color: &Color| match color {
            Color::Texture(id) => self.texture_depths.get(id.0 as usize).copied().unwrap_or(0),
            Color::Constant(_) => 0,
        };
        let below = match &kind {
            TextureKind::Checkerboard { colors, .. } => colors.iter().map(depth_of).max(),
            TextureKind::Product { factors } => factors.iter().map(depth_of).max(),
            TextureKind::Mix { colors, amount } => colors.iter().chain([&color_of(*amount)]).map(depth_of).max(),
            TextureKind::Image { .. } | TextureKind::VertexColor => None,
        };
        let depth = below.unwrap_or(0) + 1;
        if depth > DEEPEST_TEXTURE {
            let what = format!("textures are nested too deep; at most {DEEPEST_TEXTURE} levels are allowed");
            params.problem(params.line(), what);
            return GREY;
        }
        let id = self.scene.add_texture(name, kind, &params.source);
        self.texture_depths.push(depth);
        Color::Texture(id)
    }

    fn checkerboard(&mut self, name: &str, colors: bool, params: &mut Params) -> Color {
        if params.integer("dimension", 2, 3) == Some(3) {
            params.unsupported(params.line(), "a three-dimensional checkerboard");
        }
        params.ignore(&["aamode"]);
        let (scale, shift) = mapping(params);
        let colors = [self.part("tex1", 1.0, colors, params), self.part("tex2", 0.0, colors, params)];
        self.add_texture(name, TextureKind::Checkerboard { scale, shift, colors }, params)
    }

    fn image_map(&mut self, name: &str, colors: bool, params: &mut Params) -> Color {
        let (mut scale, mut shift) = mapping(params);
        if self.context.version == Version::V2 {
            // pbrt-v2 places an image's first row at v = 0.
            (scale[1], shift[1]) = (-scale[1], 1.0 - shift[1]);
        }
        let factor = params.float32("scale", 1.0, |_| true, "finite");
        let invert = !self.context.version.is_old() && params.flag("invert", false);
        let wrap = match params.text("wrap").as_ref().map(|(w, line)| (w.as_str(), line)) {
            None | Some(("repeat", _)) => Wrap::Repeat,
            Some(("black", _)) => Wrap::Black,
            Some(("clamp", _)) => Wrap::Clamp,
            Some((wrap, line)) => {
                params.unsupported(*line, format!("wrap {} of an image", shown(wrap)));
                Wrap::Repeat
            }
        };
        if let Some((filter, line)) = params.text("filter").filter(|t| t.0 != "bilinear") {
            params.notice(line, format!("filter {} of an image is read as bilinear", shown(&filter)));
        }
        params.ignore(&["maxanisotropy"]);
        if self.context.version.is_old() {
            params.ignore(&["trilinear"]);
        }
        let Some((file, line)) = params.needed_text("filename") else { return GREY };
        let decoding = Decoding::of(params, &file);
        let channel = match colors {
            true => Channel::Rgb,
            false if self.context.version.is_old() => Channel::Luminance,
            false => Channel::AlphaOrMean,
        };
        let Some(image) = self.image(&file, (decoding, channel), &params.at(line)) else { return GREY };
        self.add_texture(name, TextureKind::Image { image, scale, shift, factor, invert, wrap }, params)
    }

    /// Makes the texture of a material's normal map; `None` if the parameters name no file, or the file cannot be read.
    pub(super) fn normal_map(&mut self, params: &mut Params) -> Option<TextureId> {
        let (file, line) = params.text("normalmap")?;
        let image = self.image(&file, (Decoding::Linear, Channel::Vector), &params.at(line))?;
        match self.add_texture(&file, TextureKind::image(image, 1.0), params) {
            Color::Texture(id) => Some(id),
            Color::Constant(_) => None,
        }
    }

    /// Returns the product of two colours, each a constant or a texture. If possible, a gray constant scales the texture's
    /// own parameters instead of adding a product.
    fn product(&mut self, name: &str, a: Color, b: Color, params: &mut Params) -> Color {
        let gray = |c: [f32; 3]| (c[0] == c[1] && c[1] == c[2]).then_some(c[0]);
        let folded = match (a, b) {
            (Color::Constant(a), Color::Constant(b)) => {
                let product: [f32; 3] = std::array::from_fn(|i| a[i] * b[i]);
                if product.iter().all(|c| c.is_finite()) {
                    return Color::Constant(product);
                }
                params.problem(params.line(), format!("{} is above 3.4e38; scale it less", params.of));
                return GREY;
            }
            (Color::Texture(id), Color::Constant(c)) | (Color::Constant(c), Color::Texture(id)) => {
                gray(c).and_then(|by| self.scaled(id, by))
            }
            (Color::Texture(_), Color::Texture(_)) => None,
        };
        let kind = folded.unwrap_or(TextureKind::Product { factors: [a, b] });
        self.add_texture(name, kind, params)
    }

    /// Returns the texture multiplied by `by` without another level of nesting; `None` if its kind does not allow that.
    fn scaled(&self, id: TextureId, by: f32) -> Option<TextureKind> {
        match self.scene.textures[id.0 as usize].kind.clone() {
            TextureKind::Checkerboard { scale, shift, colors } => {
                let constant = |c: Color| {
                    let Color::Constant(c) = c else { return None };
                    Some(c.map(|c| c * by)).filter(|c| c.iter().all(|c| c.is_finite())).map(Color::Constant)
                };
                Some(TextureKind::Checkerboard { scale, shift, colors: [constant(colors[0])?, constant(colors[1])?] })
            }
            TextureKind::Image { image, scale, shift, factor, invert: false, wrap } if (factor * by).is_finite() => {
                Some(TextureKind::Image { image, scale, shift, factor: factor * by, invert: false, wrap })
            }
            _ => None,
        }
    }
}

/// Returns a gray colour with this value: a constant or a texture.
fn color_of(scalar: Scalar) -> Color {
    match scalar {
        Scalar::Constant(value) => Color::Constant([value; 3]),
        Scalar::Texture(id) => Color::Texture(id),
    }
}

/// Returns the value of a gray colour: a constant or a texture.
fn scalar_of(color: Color) -> Scalar {
    match color {
        Color::Constant([value, ..]) => Scalar::Constant(value),
        Color::Texture(id) => Scalar::Texture(id),
    }
}

/// Takes the parameters of texture coordinates. Returns the factors of u and v, and the shifts of u and v.
fn mapping(params: &mut Params) -> ([f32; 2], [f32; 2]) {
    if let Some((mapping, line)) = params.text("mapping").filter(|t| t.0 != "uv") {
        params.unsupported(line, format!("mapping {}", shown(&mapping)));
        params.ignore(&["v1", "v2"]);
    }
    let mut read = |name, default| params.float32(name, default, |_| true, "finite");
    let scale = [read("uscale", 1.0), read("vscale", 1.0)];
    let shift = [read("udelta", 0.0), read("vdelta", 0.0)];
    (scale, shift)
}
