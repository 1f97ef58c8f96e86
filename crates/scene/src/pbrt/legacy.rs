//! Files of pbrt-v2 and pbrt-v3: detection of the version, materials, and the scale of lights.

use super::materials::{Made, NEW_MATERIALS, ROUGHNESS, fresnel, roughness_by};
use super::params::{Params, Type};
use super::spectra::Gamut;
use super::tokens::{Kind, Tokens};
use super::version::Version;
use crate::{Color, MaterialId, MaterialKind, Roughness, Scalar};

/// Supported material types of pbrt-v2 and v3 that pbrt-v4 no longer has.
pub(super) const OLD_MATERIALS: &str = "matte plastic substrate metal mirror glass";

/// Material types of pbrt-v2 or v3 that pbrt-v4 no longer has and that are not supported.
const FOREIGN_MATERIALS: &str = "disney fourier kdsubsurface shinymetal translucent uber";

impl Version {
    /// Returns the pbrt version of a file, derived from its directives and types, since files do not state it.
    ///
    /// A directive or type that only pbrt-v4 has identifies pbrt-v4, as does the lack of any that only older versions
    /// have. Otherwise an `Integrator` or a medium, without a directive of pbrt-v2 alone, identifies pbrt-v3. All other
    /// files are pbrt-v2.
    pub(super) fn of(text: &str) -> Self {
        let [mut new, mut old, mut second, mut third] = [false; 4];
        let mut tokens = Tokens::new(text);
        let mut word = "";
        // The index of the current string after `word`, and the string before it.
        let (mut place, mut before) = (0, "");
        while let Some(token) = tokens.next() {
            let Ok(token) = token else { continue };
            let text = token.text;
            if token.is_name() {
                (word, place, before) = (text, 0, "");
                new |= matches!(word, "Attribute" | "ColorSpace" | "Import" | "Option");
                second |= matches!(word, "Renderer" | "SurfaceIntegrator" | "Volume" | "VolumeIntegrator");
                third |= matches!(word, "Integrator" | "MakeNamedMedium" | "MediumInterface");
                old |= second || word == "WorldEnd";
            } else if token.kind == Kind::Text {
                let declared = word == "MakeNamedMaterial" && before.split_ascii_whitespace().eq(["string", "type"]);
                match (word, text) {
                    _ if declared || (word == "Material" && place == 0) => {
                        let among = |list: &str| list.split(' ').any(|known| known == text);
                        new |= among(NEW_MATERIALS);
                        old |= among(OLD_MATERIALS) || among(FOREIGN_MATERIALS);
                    }
                    // The types in declarations of parameters.
                    _ if place > 0 => {
                        let mut words = text.split_ascii_whitespace();
                        let first_of_two = words.next().filter(|_| words.next().is_some() && words.next().is_none());
                        old |= matches!(first_of_two, Some("color" | "xyz" | "point" | "vector"));
                        old |= word == "Texture" && place == 1 && text == "color";
                    }
                    ("Film", "rgb" | "gbuffer" | "spectral") => new = true,
                    ("Sampler", "independent" | "paddedsobol" | "pmj02bn" | "zsobol") => new = true,
                    ("Film", "image") | ("AreaLightSource", "area") => old = true,
                    _ => {}
                }
                place += 1;
                before = text;
            }
        }
        match (new, old, second, third) {
            (true, ..) | (_, false, ..) => Self::V4,
            (_, _, false, true) => Self::V3,
            _ => Self::V2,
        }
    }
}

/// Makes a material of the pbrt-v2 or v3 type `kind`; `None` for an unknown or unsupported type.
pub(super) fn old_material(kind: &str, params: &mut Params) -> Option<Made> {
    let kind = match kind {
        "matte" => {
            let line = params.peek("sigma").map(|p| p.line);
            let sigma = params.scalar("sigma", 0.0, |_| true, "finite");
            if let (Some(line), true) = (line, sigma != Scalar::Constant(0.0)) {
                params.notice(line, format!("sigma of {} (Oren-Nayar) is read as 0 (Lambert)", params.of));
            }
            MaterialKind::Diffuse { reflectance: params.color("Kd", [0.5; 3]) }
        }
        "plastic" | "substrate" => {
            let default = if kind == "plastic" { [0.25; 3] } else { [0.5; 3] };
            let [diffuse, specular] = ["Kd", "Ks"].map(|name| params.color(name, default));
            let roughness = old_roughness(params, 0.1);
            match kind {
                "plastic" => MaterialKind::Plastic { diffuse, specular, roughness },
                _ => MaterialKind::Substrate { diffuse, specular, roughness },
            }
        }
        "metal" => MaterialKind::Conductor {
            fresnel: fresnel(params, ["", "eta", "k"]),
            roughness: old_roughness(params, 0.01),
        },
        "mirror" => MaterialKind::Mirror { reflectance: params.color("Kr", [0.9; 3]) },
        "glass" => glass(params),
        "mix" => return Some(old_mix(params)),
        "none" | "" if params.context.version == Version::V3 => MaterialKind::Interface,
        _ => return None,
    };
    Some(kind.into())
}

fn glass(params: &mut Params) -> MaterialKind {
    let name = if params.has("eta") && params.context.version == Version::V3 { "eta" } else { "index" };
    let eta = params.constant(name, 1.5, |v| v > 0.0, "above 0");
    let roughness = match params.context.version {
        Version::V3 if params.has("uroughness") || params.has("vroughness") => old_roughness(params, 0.0),
        _ => {
            params.ignore(&["uroughness", "vroughness", "remaproughness"]);
            Roughness::constant(0.0, 0.0, false)
        }
    };
    let [reflectance, transmittance] = ["Kr", "Kt"].map(|name| params.color(name, [1.0; 3]));
    MaterialKind::Dielectric { eta, roughness, reflectance, transmittance }
}

/// Makes a mix of two materials. The file's `amount` is the weight of the first material. It is subtracted from 1, since
/// Dapple stores the second one's weight.
fn old_mix(params: &mut Params) -> Made {
    let names = ["namedmaterial1", "namedmaterial2"].map(|name| params.needed_text(name).map(|text| text.0));
    let mixes = if let [Some(first), Some(second)] = names { Some([first, second]) } else { None };
    let amount = match params.color("amount", [0.5; 3]) {
        Color::Constant([r, g, b]) if r == g && g == b => 1.0 - r,
        _ => {
            params.unsupported(params.line(), format!("an amount that is a texture or not gray in {}", params.of));
            0.5
        }
    };
    Made { kind: MaterialKind::Mix { materials: [MaterialId(0); 2], amount: Scalar::Constant(amount) }, mixes }
}

/// Reads the roughness parameters and converts them to microfacet widths (alpha) by the rule of the file's version.
fn old_roughness(params: &mut Params, default: f32) -> Roughness {
    let remap = params.context.version == Version::V3 && params.flag("remaproughness", true);
    let read = |params: &mut Params, name| old_alpha(params, name, default, remap);
    roughness_by(params, ROUGHNESS, false, read)
}

fn old_alpha(params: &mut Params, name: &'static str, default: f32, remap: bool) -> Scalar {
    let line = params.peek(name).map(|p| p.line);
    let roughness = params.scalar(name, default, |v| v >= 0.0, "at least 0");
    match (roughness, params.context.version) {
        (Scalar::Constant(r), Version::V2) => {
            let alpha = alpha_of_blinn(r);
            if let Some(line) = line {
                let read_as = format!("Trowbridge-Reitz microfacets of alpha {alpha:.3}");
                params.notice(line, format!("{name} {r} of {} (Blinn) is read as {read_as}", params.of));
            }
            Scalar::Constant(alpha)
        }
        (Scalar::Constant(r), _) if remap => Scalar::Constant(alpha_of_third(r)),
        (Scalar::Texture(_), version) if remap || version == Version::V2 => {
            let what = format!("a texture as {name} of {} (except as a microfacet width, alpha)", params.of);
            params.unsupported(line.unwrap_or(params.line()), what);
            Scalar::Constant(default)
        }
        (scalar, _) => scalar,
    }
}

/// Returns the Trowbridge-Reitz alpha `sqrt(2 / (e + 2))`, which makes highlights as wide as Blinn's distribution of
/// exponent `e = 1 / roughness` [after Walter et al. 2007].
fn alpha_of_blinn(roughness: f32) -> f32 {
    // pbrt-v2 caps exponents at this.
    const STEEPEST: f32 = 10_000.0;
    let exponent = (1.0 / roughness).min(STEEPEST);
    (2.0 / (exponent + 2.0)).sqrt()
}

/// Returns the microfacet width (alpha) of a roughness by pbrt-v3's polynomial [Pharr et al. 2016, section 8.4.2].
fn alpha_of_third(roughness: f32) -> f32 {
    let x = roughness.max(1e-3).ln();
    1.62142 + x * (0.819_955 + x * (0.1734 + x * (0.017_120_1 + x * 0.000_640_711)))
}

/// Takes the parameter `scale` of a light in pbrt-v2 and v3: a colour, or a number for all three channels. The default
/// is 1.
pub(super) fn light_scale(params: &mut Params) -> [f32; 3] {
    if params.peek("scale").is_some_and(|p| p.ty == Type::Float) {
        return [params.float32("scale", 1.0, |v| v >= 0.0, "at least 0"); 3];
    }
    params.rgb("scale", Gamut::Unbounded).unwrap_or([1.0; 3])
}
