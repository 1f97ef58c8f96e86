//! Materials of pbrt-v4. Materials of older versions are in `legacy`.

use super::directive::Directive;
use super::params::{Params, Type, Values};
use super::reader::Reader;
use super::spectra::{Gamut, metal};
use super::state::MaterialRef;
use super::textures::Textures;
use super::tokens::shown;
use crate::{
    Coating, Color, ConductorFresnel, Material, MaterialId, MaterialKind, Roughness, Scalar, Source, TextureKind,
};

/// Supported material types of pbrt-v4.
const MATERIALS: &[&str] = &[
    "diffuse",
    "diffusetransmission",
    "conductor",
    "dielectric",
    "thindielectric",
    "coateddiffuse",
    "coatedconductor",
    "mix",
    "interface",
];
/// Supported material types of pbrt-v2 and v3.
const OLD_MATERIALS: &[&str] = &["matte", "plastic", "substrate", "metal", "mirror", "glass", "mix"];

/// Returns pbrt's default material: diffuse, with reflectance 0.5.
pub(super) fn default_kind() -> MaterialKind {
    MaterialKind::Diffuse { reflectance: Color::Constant([0.5; 3]) }
}

/// A material as a directive describes it, without an index.
pub(super) struct Made {
    pub(super) kind: MaterialKind,
    /// The names of the two mixed materials; `None` if the material is no mix.
    pub(super) mixes: Option<[String; 2]>,
}

impl From<MaterialKind> for Made {
    fn from(kind: MaterialKind) -> Self {
        Self { kind, mixes: None }
    }
}

impl Reader<'_> {
    /// Executes `Material`: makes the current material.
    pub(super) fn set_material(&mut self, mut d: Directive<'_>) {
        let params = self.params(&mut d, "material");
        let name = format!("material {}", self.scene.materials.len());
        let line = d.source.line;
        let (material, mixes) = self.make_material(name, &d.texts[0], line, params, d.source);
        let id = self.scene.add_material(material);
        self.settle_mix(id, mixes);
        self.state.material = MaterialRef::Made(id);
    }

    /// Executes `MakeNamedMaterial`: defines a named material.
    pub(super) fn make_named_material(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "material");
        let name = d.texts.swap_remove(0);
        let kind = params.text("type");
        if kind.is_none() {
            params.lacks(d.source.line, "its type; add \"string type\" \"diffuse\"");
        }
        if let Some(first) = self.named_materials.get(&name) {
            let first = &self.scene.materials[first].source;
            if self.version.is_old() {
                params.notice(d.source.line, format!("material {} is made anew (first at {first})", shown(&name)));
            } else {
                params.problem(d.source.line, format!("material {} is made twice (first at {first})", shown(&name)));
            }
        }
        let (kind, line) = kind.unwrap_or(("diffuse".into(), d.source.line));
        let (material, mixes) = self.make_material(name.clone(), &kind, line, params, d.source);
        let id = MaterialId(self.named_materials.define(&name, material, &mut self.scene.materials) as u32);
        self.settle_mix(id, mixes);
    }

    /// Makes a material of type `kind`; after an error a placeholder, so that reading can continue. Also returns the names
    /// of the materials that it mixes, if it is a mix.
    fn make_material(
        &mut self,
        name: String,
        kind: &str,
        line: u32,
        mut params: Params,
        source: Source,
    ) -> (Material, Option<[String; 2]>) {
        let shades = !matches!(kind, "mix" | "interface" | "none" | "");
        let (bump_name, has_bump) = match self.version.is_old() {
            true => ("bumpmap", params.has("bumpmap")),
            false => ("displacement", params.has("displacement")),
        };
        let bump = (shades && has_bump)
            .then(|| params.scalar(bump_name, 0.0, &self.textures, |_| true, "finite"))
            // A constant height tilts no normals.
            .filter(|bump| matches!(bump, Scalar::Texture(_)));
        let normal_map = (shades && !self.version.is_old()).then(|| self.normal_map(&mut params, &source)).flatten();
        if let (Some(_), Some(_)) = (bump, normal_map) {
            params.problem(line, format!("{} has both displacement and normalmap; remove one", params.of()));
        }
        let (textures, old) = (&self.textures, self.version.is_old());
        let made = match kind {
            "diffusetransmission" if !old => Some(self.diffuse_transmission(&mut params, &source).into()),
            _ if old => self.old_material(kind, &mut params),
            _ => new_material(kind, &mut params, textures),
        };
        let made = made.unwrap_or_else(|| {
            params.unsupported_type(line, "Material", kind, if old { OLD_MATERIALS } else { MATERIALS });
            default_kind().into()
        });
        params.finish(&mut self.log);
        (Material { bump, normal_map, ..Material::new(name, made.kind, source) }, made.mixes)
    }

    /// Sets the materials of a mix by their names.
    fn settle_mix(&mut self, mix: MaterialId, names: Option<[String; 2]>) {
        let Some(names) = names else { return };
        let source = self.scene.materials[mix.0 as usize].source.clone();
        let found = names.map(|name| self.material_named(&name, &source));
        if let MaterialKind::Mix { materials, .. } = &mut self.scene.materials[mix.0 as usize].kind {
            *materials = found;
        }
    }

    fn diffuse_transmission(&mut self, params: &mut Params, source: &Source) -> MaterialKind {
        let given = ["reflectance", "transmittance"].map(|name| params.color(name, [0.25; 3], &self.textures));
        let scale = params.float32("scale", 1.0, |v| v >= 0.0, "at least 0");
        let [reflectance, transmittance] = given.map(|color| match color {
            Color::Constant(c) => Color::Constant(c.map(|c| c * scale)),
            color if scale == 1.0 => color,
            color => {
                let factors = [color, Color::Constant([scale; 3])];
                self.add_texture("scaled", TextureKind::Product { factors }, params, source)
            }
        });
        if let (Color::Constant(r), Color::Constant(t)) = (reflectance, transmittance) {
            if r.iter().chain(&t).any(|&c| c > 1.0) {
                let what = format!("{}: reflectance and transmittance, scaled, must not be above 1", params.of());
                params.problem(params.line(), what);
            } else if (0..3).any(|i| r[i] + t[i] > 1.0) {
                let what = format!("{} gives back more light than it gets; the sum of both is above 1", params.of());
                params.notice(params.line(), what);
            }
        }
        MaterialKind::DiffuseTransmission { reflectance, transmittance }
    }
}

/// Makes a material of the pbrt-v4 type `kind`; `None` for an unknown type.
fn new_material(kind: &str, params: &mut Params, textures: &Textures) -> Option<Made> {
    let kind = match kind {
        "diffuse" => MaterialKind::Diffuse { reflectance: params.color("reflectance", [0.5; 3], textures) },
        "conductor" => MaterialKind::Conductor {
            fresnel: fresnel(params, textures, ["reflectance", "eta", "k"]),
            roughness: roughness(params, textures),
        },
        "dielectric" => MaterialKind::Dielectric {
            eta: params.index("eta", 1.5),
            roughness: roughness(params, textures),
            reflectance: Color::Constant([1.0; 3]),
            transmittance: Color::Constant([1.0; 3]),
        },
        "thindielectric" => MaterialKind::ThinDielectric { eta: params.index("eta", 1.5) },
        "coateddiffuse" => MaterialKind::CoatedDiffuse {
            reflectance: params.color("reflectance", [0.5; 3], textures),
            coat: {
                let roughness = roughness(params, textures);
                coating(params, textures, roughness, "eta")
            },
        },
        "coatedconductor" => coated_conductor(params, textures),
        "mix" => return Some(mix(params, textures)),
        "interface" | "none" | "" => MaterialKind::Interface,
        _ => return None,
    };
    Some(kind.into())
}

fn coated_conductor(params: &mut Params, textures: &Textures) -> MaterialKind {
    let remap = params.flag("remaproughness", true);
    let coat = ["interface.roughness", "interface.uroughness", "interface.vroughness"];
    let metal = ["conductor.roughness", "conductor.uroughness", "conductor.vroughness"];
    MaterialKind::CoatedConductor {
        fresnel: fresnel(params, textures, ["reflectance", "conductor.eta", "conductor.k"]),
        roughness: roughness_of(params, textures, metal, 0.0, remap),
        coat: {
            let roughness = roughness_of(params, textures, coat, 0.0, remap);
            coating(params, textures, roughness, "interface.eta")
        },
    }
}

fn coating(params: &mut Params, textures: &Textures, roughness: Roughness, eta: &'static str) -> Coating {
    Coating {
        roughness,
        eta: params.index(eta, 1.5),
        thickness: params.constant("thickness", 0.01, textures, |v| v >= 0.0, "at least 0"),
        albedo: params.color("albedo", [0.0; 3], textures),
        g: params.constant("g", 0.0, textures, |v| v > -1.0 && v < 1.0, "between -1 and 1"),
        max_depth: params.integer("maxdepth", 1, i32::MAX).unwrap_or(10) as u32,
        samples: params.integer("nsamples", 1, i32::MAX).unwrap_or(1) as u32,
    }
}

fn mix(params: &mut Params, textures: &Textures) -> Made {
    let amount = params.scalar("amount", 0.5, textures, |v| (0.0..=1.0).contains(&v), "within 0..=1");
    let names = params.take_typed("materials", &[Type::Text]).and_then(|p| match p.values {
        Values::Texts(names) => Some((names, p.line)),
        _ => None,
    });
    let mixes = match names.map(|(names, line)| (<[String; 2]>::try_from(names), line)) {
        Some((Ok(names), _)) => Some(names),
        Some((Err(names), line)) => {
            params.problem(line, format!("parameter materials of {} takes 2 names, not {}", params.of(), names.len()));
            None
        }
        None => {
            params.lacks(params.line(), "\"string materials\" with two names");
            None
        }
    };
    Made { kind: MaterialKind::Mix { materials: [MaterialId(0); 2], amount }, mixes }
}

/// Reads a metal's Fresnel parameters. `names` are the names of the parameters for reflectance, eta and k.
pub(super) fn fresnel(params: &mut Params, textures: &Textures, names: [&'static str; 3]) -> ConductorFresnel {
    let [reflectance_name, eta, k] = names;
    if params.has(reflectance_name) {
        let reflectance = params.color(reflectance_name, [0.5; 3], textures);
        for name in [eta, k] {
            if let Some(param) = params.take(name) {
                let what = format!("{} has both {reflectance_name} and {name}; remove one", params.of());
                params.problem(param.line, what);
            }
        }
        return ConductorFresnel::Reflectance(reflectance);
    }
    // pbrt's default metal is copper.
    let eta = params.rgb(eta, Gamut::Index).or_else(|| metal("metal-Cu-eta"));
    let k = params.rgb(k, Gamut::Index).or_else(|| metal("metal-Cu-k"));
    ConductorFresnel::EtaK { eta: eta.unwrap_or([1.0; 3]), k: k.unwrap_or([0.0; 3]) }
}

fn roughness(params: &mut Params, textures: &Textures) -> Roughness {
    let remap = params.flag("remaproughness", true);
    roughness_of(params, textures, ["roughness", "uroughness", "vroughness"], 0.0, remap)
}

/// Reads a roughness from three parameters. `names` are their names: for both directions, for u, for v.
pub(super) fn roughness_of(
    params: &mut Params,
    textures: &Textures,
    names: [&'static str; 3],
    default: f32,
    remap: bool,
) -> Roughness {
    let ok = |v: f64| v >= 0.0;
    let both = params.scalar(names[0], default, textures, ok, "at least 0");
    let mut along = |name| match params.has(name) {
        true => params.scalar(name, default, textures, ok, "at least 0"),
        false => {
            params.ignore(&[name]);
            both
        }
    };
    Roughness { u: along(names[1]), v: along(names[2]), remap }
}

impl Params {
    /// Reads a reflectance parameter: a constant or a texture. Returns `default` if it is absent or invalid.
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

    /// Reads a number parameter: a constant or a texture. `ok` accepts valid constants; `range` describes these in
    /// messages. Returns `default` if the parameter is absent or invalid.
    pub(super) fn scalar(
        &mut self,
        name: &'static str,
        default: f32,
        textures: &Textures,
        ok: impl Fn(f64) -> bool,
        range: &str,
    ) -> Scalar {
        let default_scalar = Scalar::Constant(default);
        if self.peek(name).is_none_or(|p| p.ty != Type::Texture) {
            return Scalar::Constant(self.float32(name, default, ok, range));
        }
        let Some((texture, line)) = self.texture_name(name) else { return default_scalar };
        match textures.float(&texture) {
            Ok(Ok(Scalar::Constant(value))) if !ok(f64::from(*value)) => {
                self.problem(line, format!("parameter {name} of {} must be {range}, not {value}", self.of()));
            }
            Ok(Ok(scalar)) => return *scalar,
            Ok(Err(class)) => {
                self.unsupported(line, format!("a texture of class {} as {name} of {}", shown(class), self.of()));
            }
            Err(message) => self.problem(line, message),
        }
        default_scalar
    }

    /// Reads a number parameter that must not vary: a constant or a constant texture. `ok` accepts valid numbers;
    /// `range` describes these in messages. Returns `default` if the parameter is absent, invalid or varies.
    pub(super) fn constant(
        &mut self,
        name: &'static str,
        default: f32,
        textures: &Textures,
        ok: impl Fn(f64) -> bool,
        range: &str,
    ) -> f32 {
        let line = self.peek(name).map_or(0, |p| p.line);
        match self.scalar(name, default, textures, ok, range) {
            Scalar::Constant(value) => value,
            Scalar::Texture(_) => {
                self.unsupported(line, format!("a texture as {name} of {}", self.of()));
                default
            }
        }
    }

    /// Takes a parameter that names a texture. Returns the texture's name and the parameter's line.
    pub(super) fn texture_name(&mut self, name: &'static str) -> Option<(String, u32)> {
        let param = self.take_typed(name, &[Type::Texture])?;
        match &param.values {
            Values::Texts(names) if names.len() == 1 => Some((names[0].clone(), param.line)),
            _ => {
                self.problem(param.line, format!("parameter {name} of {} takes one texture's name", self.of()));
                None
            }
        }
    }
}
