//! Materials of pbrt-v4. Materials of older versions are in `legacy`.

use super::params::{Params, Type};
use super::spectra::{Gamut, metal};
use crate::{Coating, Color, ConductorFresnel, MaterialId, MaterialKind, Roughness, Scalar};

/// Material types that pbrt-v4 introduced, all supported.
pub(super) const NEW_MATERIALS: &str =
    "diffuse diffusetransmission conductor dielectric thindielectric coateddiffuse coatedconductor interface";

/// The usual names of roughness parameters: for both directions, for u, for v.
pub(super) const ROUGHNESS: [&str; 3] = ["roughness", "uroughness", "vroughness"];

/// Returns pbrt's default material: diffuse, with reflectance 0.5.
pub(super) fn default_kind() -> MaterialKind {
    MaterialKind::Diffuse { reflectance: Color::Constant([0.5; 3]) }
}

/// A material made by a directive, before it has an index.
pub(super) struct Made {
    pub(super) kind: MaterialKind,
    pub(super) mixes: Mixes,
}

/// The names of the two mixed materials; `None` if the material is no mix.
pub(super) type Mixes = Option<[String; 2]>;

impl From<MaterialKind> for Made {
    fn from(kind: MaterialKind) -> Self {
        Self { kind, mixes: None }
    }
}

/// Makes a material of the pbrt-v4 type `kind`; `None` for an unknown type.
pub(super) fn new_material(kind: &str, params: &mut Params) -> Option<Made> {
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
