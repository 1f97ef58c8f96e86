//! Textures, by name; what is constant is folded.

use super::directive::Directive;
use super::params::{Params, Type};
use super::reader::{Reader, unknown_name};
use super::spectra::Gamut;
use super::tokens::shown;
use crate::scene::{Color, Source, Texture, TextureId, TextureKind, Wrap};
use std::collections::BTreeMap;

/// What stands for a texture that is not supported, where that is allowed.
const GREY: Color = Color::Constant([0.5; 3]);

/// Textures made so far.
#[derive(Debug, Default)]
pub(super) struct Textures {
    spectra: BTreeMap<String, Color>,
    /// Those of numbers: only constants can be used.
    floats: BTreeMap<String, Option<f32>>,
}

impl Textures {
    /// A texture of colours.
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

    /// A texture of numbers: its value, if it is constant.
    pub(super) fn float(&self, name: &str) -> Result<Option<f32>, String> {
        self.floats.get(name).copied().ok_or_else(|| {
            let advice = if self.spectra.contains_key(name) {
                "it is a spectrum texture, and a float texture is needed"
            } else {
                "make it by Texture above this line"
            };
            unknown_name("texture", name, self.floats.keys(), advice)
        })
    }
}

impl Reader<'_> {
    /// Carries out `Texture`.
    pub(super) fn make_texture(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "texture");
        let [name, ty, class] = &d.texts[..] else { return };
        let line = d.source.line;
        match ty.as_str() {
            "spectrum" | "color" => {
                if self.textures.spectra.contains_key(name) {
                    params.problem(line, format!("spectrum texture {} is made twice: rename one", shown(name)));
                }
                let color = match class.as_str() {
                    "constant" => Color::Constant(params.rgb("value", Gamut::Unbounded).unwrap_or([1.0; 3])),
                    "checkerboard" => self.checkerboard(name, &mut params, &d.source),
                    "imagemap" => self.image_map(name, &mut params, &d.source),
                    "scale" => self.scaled(name, &mut params, &d.source),
                    _ => {
                        params.unsupported(line, format!("Texture {}", shown(class)));
                        params.ignore_rest();
                        GREY
                    }
                };
                self.textures.spectra.insert(name.clone(), color);
            }
            "float" => {
                if self.textures.floats.contains_key(name) {
                    params.problem(line, format!("float texture {} is made twice: rename one", shown(name)));
                }
                let value = match class.as_str() {
                    "constant" => Some(params.float32("value", 1.0, |_| true, "finite")),
                    "scale" => {
                        let mut read = |part| params.scalar(part, 1.0, &self.textures, |_| true, "finite");
                        Some(read("tex") * read("scale")).filter(|v| v.is_finite())
                    }
                    // Whoever uses it will say that it is not supported.
                    _ => {
                        params.ignore_rest();
                        None
                    }
                };
                self.textures.floats.insert(name.clone(), value);
            }
            _ => params.problem(line, format!("a texture is of type spectrum or float, not {}", shown(ty))),
        }
        params.finish(&mut self.log);
    }

    fn add_texture(&mut self, name: &str, kind: TextureKind, source: &Source) -> Color {
        let id = TextureId(self.scene.textures.len() as u32);
        self.scene.textures.push(Texture { name: name.to_owned(), kind, source: source.clone() });
        Color::Texture(id)
    }

    fn checkerboard(&mut self, name: &str, params: &mut Params, source: &Source) -> Color {
        if params.integer("dimension", 2, 3) == Some(3) {
            params.unsupported(source.line, "a three-dimensional checkerboard");
        }
        let (scale, shift) = mapping(params);
        let mut color = |name, default| params.any_color(name, default, &self.textures);
        let colors = [color("tex1", [1.0; 3]), color("tex2", [0.0; 3])];
        self.add_texture(name, TextureKind::Checkerboard { scale, shift, colors }, source)
    }

    fn image_map(&mut self, name: &str, params: &mut Params, source: &Source) -> Color {
        let (scale, shift) = mapping(params);
        let factor = params.float32("scale", 1.0, |_| true, "finite");
        let invert = params.flag("invert", false);
        if let Some((wrap, line)) = params.text("wrap").filter(|t| t.0 != "repeat") {
            params.unsupported(line, format!("wrap {} of an image", shown(&wrap)));
        }
        if let Some((filter, line)) = params.text("filter").filter(|t| t.0 != "bilinear") {
            params.notice(line, format!("filter {} of an image is read as bilinear", shown(&filter)));
        }
        params.ignore(&["maxanisotropy"]);
        let linear = match params.text("encoding") {
            Some((encoding, _)) if encoding == "linear" => true,
            Some((encoding, line)) if encoding != "sRGB" => {
                params.unsupported(line, format!("encoding {}", shown(&encoding)));
                false
            }
            _ => false,
        };
        let Some((file, line)) = params.text("filename") else {
            if !params.is_bad() {
                params.problem(source.line, format!("{} lacks \"string filename\"", params.of()));
            }
            return GREY;
        };
        match self.picture(&file, linear, &Source { line, ..source.clone() }) {
            Some(picture) => self.add_texture(
                name,
                TextureKind::Image { picture, scale, shift, factor, invert, wrap: Wrap::Repeat },
                source,
            ),
            None => GREY,
        }
    }

    /// A texture multiplied by a number.
    fn scaled(&mut self, name: &str, params: &mut Params, source: &Source) -> Color {
        let color = params.any_color("tex", [1.0; 3], &self.textures);
        let factor = params.scalar("scale", 1.0, &self.textures, |v| v >= 0.0, "at least 0");
        match self.multiply(color, factor, name, source) {
            Some(color) => color,
            None => {
                params.unsupported(source.line, "a scaled texture of this kind");
                GREY
            }
        }
    }

    fn multiply(&mut self, color: Color, by: f32, name: &str, source: &Source) -> Option<Color> {
        let id = match color {
            Color::Constant(c) => {
                let c = c.map(|c| c * by);
                return c.iter().all(|c| c.is_finite()).then_some(Color::Constant(c));
            }
            Color::Texture(id) => id,
        };
        let kind = match self.scene.textures[id.0 as usize].kind.clone() {
            TextureKind::Checkerboard { scale, shift, colors } => {
                let constant = |c: Color| match c {
                    Color::Constant(c) => Some(Color::Constant(c.map(|c| c * by))),
                    Color::Texture(_) => None,
                };
                TextureKind::Checkerboard { scale, shift, colors: [constant(colors[0])?, constant(colors[1])?] }
            }
            TextureKind::Image { picture, scale, shift, factor, invert: false, wrap } => {
                TextureKind::Image { picture, scale, shift, factor: factor * by, invert: false, wrap }
            }
            _ => return None,
        };
        Some(self.add_texture(name, kind, source))
    }
}

/// How u and v are scaled, then shifted.
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
    /// A colour of any size, as textures have them.
    fn any_color(&mut self, name: &'static str, default: [f32; 3], textures: &Textures) -> Color {
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
