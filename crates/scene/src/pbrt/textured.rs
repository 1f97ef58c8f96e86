//! Parameters that are a constant or the name of a texture.

use super::params::{Params, Type};
use super::spectra::Gamut;
use super::tokens::shown;
use crate::{Color, Scalar};

impl Params {
    /// Reads a reflectance parameter: a constant or a texture. Returns `default` if it is absent or invalid.
    pub(super) fn color(&mut self, name: &'static str, default: [f32; 3]) -> Color {
        self.color_in(Gamut::Reflectance, name, default)
    }

    /// Reads a colour parameter: a constant or a texture. Returns `default` if it is absent or invalid.
    pub(super) fn color_in(&mut self, gamut: Gamut, name: &'static str, default: [f32; 3]) -> Color {
        let default_color = Color::Constant(default);
        match self.peek(name).map(|p| p.ty) {
            Some(Type::Texture) => {}
            // pbrt-v2 and v3 take a number for gray in textures.
            Some(Type::Float) if gamut == Gamut::Unbounded && self.context.version.is_old() => {
                return Color::Constant([self.float32(name, default[0], |v| v >= 0.0, "at least 0"); 3]);
            }
            _ => return Color::Constant(self.rgb(name, gamut).unwrap_or(default)),
        }
        let Some((texture, line)) = self.text_of(name, Type::Texture) else { return default_color };
        match self.context.textures.clone().spectrum(&texture) {
            Ok(Color::Constant(c)) if gamut == Gamut::Reflectance && c.iter().any(|&c| c > 1.0) => {
                let what = format!("texture {} is above 1, the limit of {name} of {}", shown(&texture), self.of);
                self.problem(line, what);
            }
            Ok(color) => return color,
            Err(message) => self.problem(line, message),
        }
        default_color
    }

    /// Reads a number parameter: a constant or a texture. `ok` returns true for valid constants; `range` describes them in
    /// messages. Returns `default` if the parameter is absent or invalid.
    pub(super) fn scalar(&mut self, name: &'static str, default: f32, ok: impl Fn(f64) -> bool, range: &str) -> Scalar {
        let default_scalar = Scalar::Constant(default);
        if self.peek(name).is_none_or(|p| p.ty != Type::Texture) {
            return Scalar::Constant(self.float32(name, default, ok, range));
        }
        let Some((texture, line)) = self.text_of(name, Type::Texture) else { return default_scalar };
        match self.context.textures.clone().float(&texture) {
            Ok(Ok(Scalar::Constant(value))) if !ok(f64::from(*value)) => {
                self.bad(name, line, format!("must be {range}, not {value}"));
            }
            Ok(Ok(scalar)) => return *scalar,
            Ok(Err(class)) => {
                self.unsupported(line, format!("a texture of class {} as {name} of {}", shown(class), self.of));
            }
            Err(message) => self.problem(line, message),
        }
        default_scalar
    }

    /// Reads a number parameter that must not vary: a constant or a constant texture. `ok` returns true for valid numbers;
    /// `range` describes them in messages. Returns `default` if the parameter is absent, invalid or varies.
    pub(super) fn constant(&mut self, name: &'static str, default: f32, ok: impl Fn(f64) -> bool, range: &str) -> f32 {
        let line = self.peek(name).map_or(0, |p| p.line);
        match self.scalar(name, default, ok, range) {
            Scalar::Constant(value) => value,
            Scalar::Texture(_) => {
                self.unsupported(line, format!("a texture as {name} of {}", self.of));
                default
            }
        }
    }
}
