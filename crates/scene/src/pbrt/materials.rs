//! Materials of pbrt-v4. Materials of older versions are in `legacy`.

use super::directive::{Directive, shown};
use super::params::{Params, Type};
use super::reader::Reader;
use super::spectra::{Gamut, metal};
use super::state::MaterialRef;
use crate::{Coating, Color, ConductorFresnel, Material, MaterialId, MaterialKind, Roughness, Scalar, TextureKind};

/// Material types that pbrt-v4 introduced, all supported.
pub(super) const NEW_MATERIALS: &str =
    "diffuse diffusetransmission conductor dielectric thindielectric coateddiffuse coatedconductor interface";
/// Supported material types of pbrt-v2 and v3 that pbrt-v4 no longer has.
pub(super) const OLD_MATERIALS: &str = "matte plastic substrate metal mirror glass";

/// The usual names of a roughness: for both directions, for u, for v.
pub(super) const ROUGHNESS: [&str; 3] = ["roughness", "uroughness", "vroughness"];

/// Returns pbrt's default material: diffuse, with reflectance 0.5.
pub(super) fn default_kind() -> MaterialKind {
    MaterialKind::Diffuse { reflectance: Color::Constant([0.5; 3]) }
}

/// A material as a directive describes it, without an index.
pub(super) struct Made {
    pub(super) kind: MaterialKind,
    pub(super) mixes: Mixes,
}

/// The names of the two mixed materials; `None` if the material is no mix.
type Mixes = Option<[String; 2]>;

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
        let (material, mixes) = self.make_material(name, (&d.texts[0], d.source.line), params);
        let id = self.scene.add_material(material);
        self.settle_mix(id, mixes);
        self.state.material = MaterialRef::Made(id);
    }

    /// Executes `MakeNamedMaterial`: defines a named material.
    pub(super) fn make_named_material(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "material");
        let name = d.texts.swap_remove(0);
        let kind = params.text("type").or_else(|| params.lacks("its type; add \"string type\" \"diffuse\""));
        if let Some(first) = self.named_materials.get(&name) {
            let first = &self.scene.materials[first].source;
            let what = |how| format!("material {} is made {how} (first at {first})", shown(&name));
            match self.context.version.is_old() {
                true => params.notice(d.source.line, what("anew")),
                false => params.problem(d.source.line, what("twice")),
            }
        }
        let (kind, line) = kind.unwrap_or(("diffuse".into(), d.source.line));
        let (material, mixes) = self.make_material(name.clone(), (&kind, line), params);
        let id = MaterialId(self.named_materials.define(&name, material, &mut self.scene.materials) as u32);
        self.settle_mix(id, mixes);
    }

    /// Makes a material of type `kind`; after an error a placeholder, so that reading can continue. Also returns the names
    /// of the materials that it mixes, if it is a mix.
    fn make_material(&mut self, name: String, kind: (&str, u32), mut params: Params) -> (Material, Mixes) {
        let ((kind, line), old) = (kind, self.context.version.is_old());
        let shades = !matches!(kind, "mix" | "interface" | "none" | "");
        let bump_name = if old { "bumpmap" } else { "displacement" };
        let bump = (shades && params.has(bump_name))
            .then(|| params.scalar(bump_name, 0.0, |_| true, "finite"))
            // A constant height tilts no normals.
            .filter(|bump| matches!(bump, Scalar::Texture(_)));
        let normal_map = if shades && !old { self.normal_map(&mut params) } else { None };
        if let (Some(_), Some(_)) = (bump, normal_map) {
            params.problem(line, format!("{} has both displacement and normalmap; remove one", params.of));
        }
        let made = match kind {
            "diffusetransmission" if !old => Some(self.diffuse_transmission(&mut params).into()),
            _ if old => self.old_material(kind, &mut params),
            _ => new_material(kind, &mut params),
        };
        let made = made.unwrap_or_else(|| {
            let known: Vec<&str> = if old { OLD_MATERIALS } else { NEW_MATERIALS }.split(' ').chain(["mix"]).collect();
            params.unsupported_type(line, "Material", kind, &known);
            default_kind().into()
        });
        let material = Material { bump, normal_map, ..Material::new(name, made.kind, params.source.clone()) };
        params.finish(&mut self.log);
        (material, made.mixes)
    }

    /// Sets the materials of a mix by their names.
    fn settle_mix(&mut self, mix: MaterialId, names: Mixes) {
        let Some(names) = names else { return };
        let source = self.scene.materials[mix.0 as usize].source.clone();
        let found = names.map(|name| self.material_named(&name, &source));
        if let MaterialKind::Mix { materials, .. } = &mut self.scene.materials[mix.0 as usize].kind {
            *materials = found;
        }
    }

    fn diffuse_transmission(&mut self, params: &mut Params) -> MaterialKind {
        let given = ["reflectance", "transmittance"].map(|name| params.color(name, [0.25; 3]));
        let scale = params.float32("scale", 1.0, |v| v >= 0.0, "at least 0");
        let [reflectance, transmittance] = given.map(|color| match color {
            Color::Constant(c) => Color::Constant(c.map(|c| c * scale)),
            color if scale == 1.0 => color,
            color => {
                let factors = [color, Color::Constant([scale; 3])];
                self.add_texture("scaled", TextureKind::Product { factors }, params)
            }
        });
        if let (Color::Constant(r), Color::Constant(t)) = (reflectance, transmittance) {
            if r.iter().chain(&t).any(|&c| c > 1.0) {
                let what = format!("{}: reflectance and transmittance, scaled, must not be above 1", params.of);
                params.problem(params.line(), what);
            } else if (0..3).any(|i| r[i] + t[i] > 1.0) {
                let what = format!("{} gives back more light than it gets; the sum of both is above 1", params.of);
                params.notice(params.line(), what);
            }
        }
        MaterialKind::DiffuseTransmission { reflectance, transmittance }
    }
}

/// Makes a material of the pbrt-v4 type `kind`; `None` for an unknown type.
fn new_material(kind: &str, params: &mut Params) -> Option<Made> {
    let kind = match kind {
        "diffuse" => MaterialKind::Diffuse { reflectance: params.color("reflectance", [0.5; 3]) },
        "conductor" => MaterialKind::Conductor {
            fresnel: fresnel(params, ["reflectance", "eta", "k"]),
            roughness: roughness(params),
        },
        "dielectric" => MaterialKind::Dielectric {
            eta: params.index("eta", 1.5),
            roughness: roughness(params),
            reflectance: Color::Constant([1.0; 3]),
            transmittance: Color::Constant([1.0; 3]),
        },
        "thindielectric" => MaterialKind::ThinDielectric { eta: params.index("eta", 1.5) },
        "coateddiffuse" => {
            let remap = params.flag("remaproughness", true);
            let coat = coating(params, ROUGHNESS, remap, "eta");
            MaterialKind::CoatedDiffuse { reflectance: params.color("reflectance", [0.5; 3]), coat }
        }
        "coatedconductor" => coated_conductor(params),
        "mix" => return Some(mix(params)),
        "interface" | "none" | "" => MaterialKind::Interface,
        _ => return None,
    };
    Some(kind.into())
}

fn coated_conductor(params: &mut Params) -> MaterialKind {
    let remap = params.flag("remaproughness", true);
    let coat = ["interface.roughness", "interface.uroughness", "interface.vroughness"];
    let metal = ["conductor.roughness", "conductor.uroughness", "conductor.vroughness"];
    MaterialKind::CoatedConductor {
        fresnel: fresnel(params, ["reflectance", "conductor.eta", "conductor.k"]),
        roughness: roughness_of(params, metal, remap),
        coat: coating(params, coat, remap, "interface.eta"),
    }
}

fn coating(params: &mut Params, names: [&'static str; 3], remap: bool, eta: &'static str) -> Coating {
    Coating {
        roughness: roughness_of(params, names, remap),
        eta: params.index(eta, 1.5),
        thickness: params.constant("thickness", 0.01, |v| v >= 0.0, "at least 0"),
        albedo: params.color("albedo", [0.0; 3]),
        g: params.constant("g", 0.0, |v| v > -1.0 && v < 1.0, "between -1 and 1"),
        max_depth: params.integer("maxdepth", 1, i32::MAX).unwrap_or(10) as u32,
        samples: params.integer("nsamples", 1, i32::MAX).unwrap_or(1) as u32,
    }
}

fn mix(params: &mut Params) -> Made {
    let amount = params.scalar("amount", 0.5, |v| (0.0..=1.0).contains(&v), "within 0..=1");
    let names = params.take_texts("materials", Type::Text).map(|(names, line)| (<[String; 2]>::try_from(names), line));
    let mixes = match names {
        Some((Ok(names), _)) => Some(names),
        Some((Err(names), line)) => params.wrong("materials", line, format!("takes 2 names, not {}", names.len())),
        None => params.lacks("\"string materials\" with two names"),
    };
    Made { kind: MaterialKind::Mix { materials: [MaterialId(0); 2], amount }, mixes }
}

/// Reads a metal's Fresnel parameters. `names` are the names of the parameters for reflectance, eta and k.
pub(super) fn fresnel(params: &mut Params, names: [&'static str; 3]) -> ConductorFresnel {
    let [reflectance_name, eta, k] = names;
    if params.has(reflectance_name) {
        let reflectance = params.color(reflectance_name, [0.5; 3]);
        for param in params.given(&[eta, k]) {
            let what = format!("{} has both {reflectance_name} and {}; remove one", params.of, param.name);
            params.problem(param.line, what);
        }
        return ConductorFresnel::Reflectance(reflectance);
    }
    // pbrt's default metal is copper.
    let eta = params.rgb(eta, Gamut::Index).or_else(|| metal("metal-Cu-eta"));
    let k = params.rgb(k, Gamut::Index).or_else(|| metal("metal-Cu-k"));
    ConductorFresnel::EtaK { eta: eta.unwrap_or([1.0; 3]), k: k.unwrap_or([0.0; 3]) }
}

fn roughness(params: &mut Params) -> Roughness {
    let remap = params.flag("remaproughness", true);
    roughness_of(params, ROUGHNESS, remap)
}

/// Reads a roughness from three parameters. `names` are their names: for both directions, for u, for v.
fn roughness_of(params: &mut Params, names: [&'static str; 3], remap: bool) -> Roughness {
    roughness_by(params, names, remap, |params, name| params.scalar(name, 0.0, |v| v >= 0.0, "at least 0"))
}

/// Reads a roughness from three parameters, each by `read`: for both directions, for u, for v.
pub(super) fn roughness_by(
    params: &mut Params,
    names: [&'static str; 3],
    remap: bool,
    read: impl Fn(&mut Params, &'static str) -> Scalar,
) -> Roughness {
    let [both, u, v] = names.map(|name| (name, params.has(name)));
    let both = read(params, both.0);
    let [u, v] = [u, v].map(|(name, given)| if given { read(params, name) } else { both });
    params.ignore(&names);
    Roughness { u, v, remap }
}

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
                let what = format!("texture {} is above 1: {name} of {} must not be", shown(&texture), self.of);
                self.problem(line, what);
            }
            Ok(color) => return color,
            Err(message) => self.problem(line, message),
        }
        default_color
    }

    /// Reads a number parameter: a constant or a texture. `ok` accepts valid constants; `range` describes these in
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

    /// Reads a number parameter that must not vary: a constant or a constant texture. `ok` accepts valid numbers;
    /// `range` describes these in messages. Returns `default` if the parameter is absent, invalid or varies.
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
