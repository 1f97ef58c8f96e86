//! Textures of pbrt scenes, by name. Constant textures become plain values.

use super::directive::Directive;
use super::images::{Channel, Decoding};
use super::legacy::Version;
use super::params::{Params, Type};
use super::reader::{Reader, unknown_name};
use super::spectra::Gamut;
use super::tokens::shown;
use crate::{Color, Scalar, Source, TextureId, TextureKind, Wrap};
use std::collections::BTreeMap;

/// The colour in place of an unsupported or invalid texture.
const GREY: Color = Color::Constant([0.5; 3]);

/// The deepest nesting of textures within textures. A look-up evaluates all levels.
const DEEPEST_TEXTURE: u32 = 8;

/// The textures defined so far, by name.
#[derive(Debug, Default)]
pub(super) struct Textures {
    spectra: BTreeMap<String, Color>,
    /// Float textures by name. `Err` holds the name of an unsupported class of texture.
    floats: BTreeMap<String, Result<Scalar, String>>,
    /// The nesting depth of each texture of the scene, by its index.
    depths: Vec<u32>,
}

impl Textures {
    /// Returns the spectrum (colour) texture with this name. The error is a message for an unknown name.
    pub(super) fn spectrum(&self, name: &str) -> Result<Color, String> {
        self.spectra.get(name).copied().ok_or_else(|| {
            let advice = if self.floats.contains_key(name) {
                "it is a float texture, and a spectrum texture is needed"
            } else {
                "make it by Texture above this line"
            };
            unknown_name("texture", name, self.spectra.keys(), advice)
        })
    }

    /// Returns the float texture with this name. The outer error is a message for an unknown name. The inner error
    /// names an unsupported class of texture.
    pub(super) fn float(&self, name: &str) -> Result<&Result<Scalar, String>, String> {
        self.floats.get(name).ok_or_else(|| {
            let advice = if self.spectra.contains_key(name) {
                "it is a spectrum texture, and a float texture is needed"
            } else {
                "make it by Texture above this line"
            };
            unknown_name("texture", name, self.floats.keys(), advice)
        })
    }
}

/// The type of a texture's values: colours or numbers.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Holds {
    Colors,
    Numbers,
}

impl Reader<'_> {
    /// Executes `Texture`: defines a named texture.
    pub(super) fn make_texture(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "texture");
        let [name, ty, class] = &d.texts[..] else { return };
        let line = d.source.line;
        let holds = match ty.as_str() {
            "spectrum" => Holds::Colors,
            "color" if self.version.is_old() => Holds::Colors,
            "float" => Holds::Numbers,
            _ => {
                params.problem(line, format!("a texture is of type spectrum or float, not {}", shown(ty)));
                params.ignore_rest();
                params.finish(&mut self.log);
                return;
            }
        };
        let made = match holds {
            Holds::Colors => self.textures.spectra.contains_key(name),
            Holds::Numbers => self.textures.floats.contains_key(name),
        };
        match made {
            true if self.version.is_old() => params.notice(line, format!("texture {} is made anew", shown(name))),
            true => params.problem(line, format!("{ty} texture {} is made twice; rename one", shown(name))),
            false => {}
        }
        let color = self.texture_color(name, class, holds, &mut params, &d.source);
        if color.is_none() {
            params.ignore_rest();
        }
        match holds {
            Holds::Colors => {
                if color.is_none() {
                    params.unsupported(line, format!("Texture {}", shown(class)));
                }
                self.textures.spectra.insert(name.clone(), color.unwrap_or(GREY));
            }
            // An unsupported float texture is reported only at its use.
            Holds::Numbers => {
                let value = color.map(scalar_of).ok_or_else(|| class.clone());
                self.textures.floats.insert(name.clone(), value);
            }
        }
        params.finish(&mut self.log);
    }

    /// Makes a texture of a class such as `imagemap`, for colours or numbers; `None` if the class is unsupported.
    fn texture_color(
        &mut self,
        name: &str,
        class: &str,
        holds: Holds,
        params: &mut Params,
        source: &Source,
    ) -> Option<Color> {
        let color = match class {
            "constant" => self.part("value", 1.0, holds, params),
            "checkerboard" => self.checkerboard(name, holds, params, source),
            "imagemap" => self.image_map(name, holds, params, source),
            "scale" => {
                let old = self.version.is_old();
                let first = self.part(if old { "tex1" } else { "tex" }, 1.0, holds, params);
                // In pbrt-v4 the second factor is a number.
                let second = match (old, holds) {
                    (true, _) => self.part("tex2", 1.0, holds, params),
                    (false, Holds::Numbers) => self.part("scale", 1.0, holds, params),
                    (false, Holds::Colors) => {
                        color_of(params.scalar("scale", 1.0, &self.textures, |v| v >= 0.0, "at least 0"))
                    }
                };
                self.product(name, first, second, params, source)
            }
            "mix" => {
                let colors = [self.part("tex1", 0.0, holds, params), self.part("tex2", 1.0, holds, params)];
                let range = |v: f64| (0.0..=1.0).contains(&v);
                let amount = params.scalar("amount", 0.5, &self.textures, range, "within 0..=1");
                match (colors, amount) {
                    ([Color::Constant(a), Color::Constant(b)], Scalar::Constant(t)) => {
                        Color::Constant(std::array::from_fn(|i| a[i] * (1.0 - t) + b[i] * t))
                    }
                    _ => self.add_texture(name, TextureKind::Mix { colors, amount }, params, source),
                }
            }
            _ => return None,
        };
        Some(color)
    }

    /// Takes a parameter of a texture: a constant, or another texture of the same type.
    fn part(&self, name: &'static str, default: f32, holds: Holds, params: &mut Params) -> Color {
        match holds {
            Holds::Colors => params.any_color(name, [default; 3], &self.textures),
            Holds::Numbers => color_of(params.scalar(name, default, &self.textures, |_| true, "finite")),
        }
    }

    pub(super) fn add_texture(&mut self, name: &str, kind: TextureKind, params: &mut Params, source: &Source) -> Color {
        let depth_of = |color: &Color| match color {
            Color::Texture(id) => self.textures.depths.get(id.0 as usize).copied().unwrap_or(0),
            Color::Constant(_) => 0,
        };
        let below = match &kind {
            TextureKind::Checkerboard { colors, .. } => colors.iter().map(depth_of).max(),
            TextureKind::Product { factors } => factors.iter().map(depth_of).max(),
            TextureKind::Mix { colors, amount } => colors.iter().chain([&color_of(*amount)]).map(depth_of).max(),
            TextureKind::Image { .. } => None,
        };
        let depth = below.unwrap_or(0) + 1;
        if depth > DEEPEST_TEXTURE {
            let what = format!("textures are nested too deep; at most {DEEPEST_TEXTURE} may be made of each other");
            params.problem(source.line, what);
            return GREY;
        }
        let id = self.scene.add_texture(name, kind, source);
        self.textures.depths.push(depth);
        Color::Texture(id)
    }

    fn checkerboard(&mut self, name: &str, holds: Holds, params: &mut Params, source: &Source) -> Color {
        if params.integer("dimension", 2, 3) == Some(3) {
            params.unsupported(source.line, "a three-dimensional checkerboard");
        }
        params.ignore(&["aamode"]);
        let (scale, shift) = mapping(params);
        let colors = [self.part("tex1", 1.0, holds, params), self.part("tex2", 0.0, holds, params)];
        self.add_texture(name, TextureKind::Checkerboard { scale, shift, colors }, params, source)
    }

    fn image_map(&mut self, name: &str, holds: Holds, params: &mut Params, source: &Source) -> Color {
        let (mut scale, mut shift) = mapping(params);
        if self.version == Version::V2 {
            // pbrt-v2 places an image's first row at v = 0.
            (scale[1], shift[1]) = (-scale[1], 1.0 - shift[1]);
        }
        let factor = params.float32("scale", 1.0, |_| true, "finite");
        let invert = !self.version.is_old() && params.flag("invert", false);
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
        if self.version.is_old() {
            params.ignore(&["trilinear"]);
        }
        let Some((file, line)) = params.text("filename") else {
            params.lacks(source.line, "\"string filename\"");
            return GREY;
        };
        let decoding = self.decoding(params, &file);
        let channel = if holds == Holds::Colors { Channel::Rgb } else { Channel::of_number(self.version) };
        match self.image(&file, decoding, channel, &Source { line, ..source.clone() }) {
            Some(image) => {
                let kind = TextureKind::Image { image, scale, shift, factor, invert, wrap };
                self.add_texture(name, kind, params, source)
            }
            None => GREY,
        }
    }

    /// Makes the texture of a material's normal map; `None` if the parameters name no file, or the file cannot be read.
    pub(super) fn normal_map(&mut self, params: &mut Params, source: &Source) -> Option<TextureId> {
        let (file, line) = params.text("normalmap")?;
        let image = self.image(&file, Decoding::Linear, Channel::Rgb, &Source { line, ..source.clone() })?;
        let (scale, shift, factor, invert, wrap) = ([1.0; 2], [0.0; 2], 1.0, false, Wrap::Repeat);
        let kind = TextureKind::Image { image, scale, shift, factor, invert, wrap };
        match self.add_texture(&file, kind, params, source) {
            Color::Texture(id) => Some(id),
            Color::Constant(_) => None,
        }
    }

    /// Returns the product of two colours, each a constant or a texture. A gray constant is multiplied into the other
    /// texture's own values if possible.
    fn product(&mut self, name: &str, a: Color, b: Color, params: &mut Params, source: &Source) -> Color {
        let gray = |c: [f32; 3]| (c[0] == c[1] && c[1] == c[2]).then_some(c[0]);
        let folded = match (a, b) {
            (Color::Constant(a), Color::Constant(b)) => {
                let product: [f32; 3] = std::array::from_fn(|i| a[i] * b[i]);
                if product.iter().all(|c| c.is_finite()) {
                    return Color::Constant(product);
                }
                params.problem(source.line, format!("{} is above 3.4e38; scale it less", params.of()));
                return GREY;
            }
            (Color::Texture(id), Color::Constant(c)) | (Color::Constant(c), Color::Texture(id)) => {
                gray(c).and_then(|by| self.scaled(id, by))
            }
            (Color::Texture(_), Color::Texture(_)) => None,
        };
        let kind = folded.unwrap_or(TextureKind::Product { factors: [a, b] });
        self.add_texture(name, kind, params, source)
    }

    /// Returns the texture multiplied by `by` without another level of nesting; `None` if its kind does not allow that.
    fn scaled(&self, id: TextureId, by: f32) -> Option<TextureKind> {
        match self.scene.textures[id.0 as usize].kind.clone() {
            TextureKind::Checkerboard { scale, shift, colors } => {
                let constant = |c: Color| match c {
                    Color::Constant(c) => {
                        Some(c.map(|c| c * by)).filter(|c| c.iter().all(|c| c.is_finite())).map(Color::Constant)
                    }
                    Color::Texture(_) => None,
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

impl Params {
    /// Takes a parameter that is a colour without an upper bound or a texture. Returns `default` if it is missing or
    /// invalid.
    fn any_color(&mut self, name: &'static str, default: [f32; 3], textures: &Textures) -> Color {
        // pbrt-v2 and v3 take a number for gray here.
        if self.version().is_old() && self.peek(name).is_some_and(|p| p.ty == Type::Float) {
            return Color::Constant([self.float32(name, default[0], |v| v >= 0.0, "at least 0"); 3]);
        }
        if self.peek(name).is_none_or(|p| p.ty != Type::Texture) {
            return Color::Constant(self.rgb(name, Gamut::Unbounded).unwrap_or(default));
        }
        let Some((texture, line)) = self.texture_name(name) else { return Color::Constant(default) };
        textures.spectrum(&texture).unwrap_or_else(|message| {
            self.problem(line, message);
            Color::Constant(default)
        })
    }
}
