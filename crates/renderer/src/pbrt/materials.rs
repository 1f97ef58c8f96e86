//! Materials.

use super::directive::Directive;
use super::params::{Params, Type, Values};
use super::reader::Reader;
use super::spectra::{Gamut, metal};
use super::state::MaterialRef;
use super::textures::Textures;
use super::tokens::shown;
use crate::scene::{Color, ConductorFresnel, MaterialKind, Roughness};

/// pbrt's default material.
pub(super) fn default_kind() -> MaterialKind {
    MaterialKind::Diffuse { reflectance: Color::Constant([0.5; 3]) }
}

impl Reader<'_> {
    /// Carries out `Material`.
    pub(super) fn set_material(&mut self, mut d: Directive<'_>) {
        let params = self.params(&mut d, "material");
        let kind = self.material_kind(&d.texts[0], d.source.line, params);
        let id = self.add_material(format!("material {}", self.scene.materials.len()), kind, d.source);
        self.state.material = MaterialRef::Made(id);
    }

    /// Carries out `MakeNamedMaterial`.
    pub(super) fn make_named_material(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "material");
        let name = d.texts.swap_remove(0);
        let kind = params.text("type");
        if kind.is_none() && !params.is_bad() {
            params.problem(d.source.line, format!("{} lacks its type: add \"string type\" \"diffuse\"", params.of()));
        }
        if let Some(&first) = self.named_materials.get(&name) {
            let first = &self.scene.materials[first.0 as usize].source;
            params.problem(d.source.line, format!("material {} is made twice (first at {first})", shown(&name)));
        }
        let (kind, line) = kind.unwrap_or(("diffuse".into(), d.source.line));
        let kind = self.material_kind(&kind, line, params);
        let id = self.add_material(name.clone(), kind, d.source);
        self.named_materials.insert(name, id);
    }

    /// What a material of this type does; another one, so that reading can go on, where that was reported.
    fn material_kind(&mut self, kind: &str, line: u32, mut params: Params) -> MaterialKind {
        if params.has("displacement") || params.has("normalmap") {
            params.unsupported(line, "a displacement or normal map");
            params.ignore(&["displacement", "normalmap"]);
        }
        let textures = &self.textures;
        let made = match kind {
            "diffuse" => MaterialKind::Diffuse { reflectance: params.color("reflectance", [0.5; 3], textures) },
            "conductor" => MaterialKind::Conductor {
                fresnel: fresnel(&mut params, textures),
                roughness: roughness(&mut params, textures),
            },
            "coateddiffuse" => MaterialKind::CoatedDiffuse {
                reflectance: params.color("reflectance", [0.5; 3], textures),
                roughness: roughness(&mut params, textures),
                eta: eta(&mut params),
                thickness: params.scalar("thickness", 0.01, textures, |v| v >= 0.0, "at least 0"),
                albedo: params.color("albedo", [0.0; 3], textures),
                g: params.scalar("g", 0.0, textures, |v| v > -1.0 && v < 1.0, "between -1 and 1"),
                max_depth: params.integer("maxdepth", 1, i32::MAX).unwrap_or(10) as u32,
                samples: params.integer("nsamples", 1, i32::MAX).unwrap_or(1) as u32,
            },
            _ => {
                params.unsupported(line, format!("Material {}", shown(kind)));
                params.ignore_rest();
                default_kind()
            }
        };
        params.finish(&mut self.log);
        made
    }
}

fn fresnel(params: &mut Params, textures: &Textures) -> ConductorFresnel {
    if params.has("reflectance") {
        let reflectance = params.color("reflectance", [0.5; 3], textures);
        for name in ["eta", "k"] {
            if let Some(param) = params.take(name) {
                let what = format!("{} has both reflectance and {name}: remove one", params.of());
                params.problem(param.line, what);
            }
        }
        return ConductorFresnel::Reflectance(reflectance);
    }
    // pbrt's default metal is copper.
    let eta = index(params, "eta").or_else(|| metal("metal-Cu-eta"));
    let k = index(params, "k").or_else(|| metal("metal-Cu-k"));
    ConductorFresnel::EtaK { eta: eta.unwrap_or([1.0; 3]), k: k.unwrap_or([0.0; 3]) }
}

/// An index of refraction per channel: RGB, or the name of a metal's.
fn index(params: &mut Params, name: &'static str) -> Option<[f32; 3]> {
    let named = params.peek(name).and_then(|p| match &p.values {
        Values::Texts(texts) if p.ty == Type::Spectrum => texts.first().and_then(|t| metal(t)),
        _ => None,
    });
    if named.is_some() {
        params.take(name);
        return named;
    }
    params.rgb(name, Gamut::Unbounded)
}

/// The index of refraction of a coat: a number.
fn eta(params: &mut Params) -> f32 {
    let spectrum = params.peek("eta").is_some_and(|p| p.ty == Type::Spectrum);
    if !spectrum {
        return params.float32("eta", 1.5, |v| v > 0.0, "above 0");
    }
    params.rgb("eta", Gamut::Unbounded).map_or(1.5, |[eta, ..]| eta)
}

fn roughness(params: &mut Params, textures: &Textures) -> Roughness {
    let mut read = |name, default| params.scalar(name, default, textures, |v| v >= 0.0, "at least 0");
    let both = read("roughness", 0.0);
    Roughness::constant(read("uroughness", both), read("vroughness", both), params.flag("remaproughness", true))
}

impl Params {
    /// A reflectance: constant or a texture.
    pub(super) fn color(&mut self, name: &'static str, default: [f32; 3], textures: &Textures) -> Color {
        if self.peek(name).is_none_or(|p| p.ty != Type::Texture) {
            return Color::Constant(self.rgb(name, Gamut::Reflectance).unwrap_or(default));
        }
        let Some((texture, line)) = self.texture_name(name) else { return Color::Constant(default) };
        match textures.spectrum(&texture) {
            Ok(Color::Constant(c)) if c.iter().any(|&c| c > 1.0) => {
                let what = format!("texture {} is above 1: {name} of {} must not be", shown(&texture), self.of());
                self.problem(line, what);
            }
            Ok(color) => return color,
            Err(message) => self.problem(line, message),
        }
        Color::Constant(default)
    }

    /// A number: constant, or a texture that is constant.
    pub(super) fn scalar(
        &mut self,
        name: &'static str,
        default: f32,
        textures: &Textures,
        ok: impl Fn(f64) -> bool,
        range: &str,
    ) -> f32 {
        if self.peek(name).is_none_or(|p| p.ty != Type::Texture) {
            return self.float32(name, default, ok, range);
        }
        let Some((texture, line)) = self.texture_name(name) else { return default };
        match textures.float(&texture) {
            Ok(Some(value)) if ok(f64::from(value)) => return value,
            Ok(Some(value)) => {
                let what = format!("parameter {name} of {} must be {range}, not {value}", self.of());
                self.problem(line, what);
            }
            Ok(None) => {
                let what = format!("a texture as {name} of {}", self.of());
                self.unsupported(line, what);
            }
            Err(message) => self.problem(line, message),
        }
        default
    }

    /// The name of the texture that a parameter refers to, and its line.
    pub(super) fn texture_name(&mut self, name: &'static str) -> Option<(String, u32)> {
        let param = self.take_typed(name, &[Type::Texture])?;
        match &param.values {
            Values::Texts(names) if names.len() == 1 => Some((names[0].clone(), param.line)),
            _ => {
                self.problem(
                    param.line,
                    format!("parameter {name} of {} takes one texture's name", self.of().to_owned()),
                );
                None
            }
        }
    }
}
