//! Lights, and the emission of shapes.

use super::directive::Directive;
use super::params::Params;
use super::reader::Reader;
use super::spectra::Gamut;
use super::tokens::shown;
use crate::image::{Encoding, Picture, read_picture};
use crate::scene::{Emission, EnvironmentRadiance, Light, LightKind, Source};
use std::path::PathBuf;
use std::sync::Arc;

impl Reader<'_> {
    /// Carries out `AreaLightSource`: shapes to come shine.
    pub(super) fn set_area_light(&mut self, mut d: Directive<'_>) {
        self.lights_met += 1;
        let mut params = self.params(&mut d, "light");
        let line = d.source.line;
        if d.texts[0] != "diffuse" {
            params.unsupported(line, format!("AreaLightSource {}", shown(&d.texts[0])));
            params.ignore_rest();
            params.finish(&mut self.log);
            return;
        }
        refuse(&mut params, &["filename", "power"]);
        let radiance = params.rgb("L", Gamut::Light).unwrap_or([1.0; 3]);
        let radiance = scaled(radiance, &mut params);
        let two_sided = params.flag("twosided", false);
        if params.finish(&mut self.log) {
            self.state.emission = Some(Emission { radiance, two_sided });
        }
    }

    /// Carries out `LightSource`.
    pub(super) fn add_light(&mut self, mut d: Directive<'_>) {
        self.lights_met += 1;
        let mut params = self.params(&mut d, "light");
        let line = d.source.line;
        if d.texts[0] != "infinite" {
            params.unsupported(line, format!("LightSource {}", shown(&d.texts[0])));
            params.ignore_rest();
            params.finish(&mut self.log);
            return;
        }
        refuse(&mut params, &["illuminance", "portal", "mapname"]);
        let constant = params.has("L").then(|| params.rgb("L", Gamut::Light).unwrap_or([1.0; 3]));
        let radiance = match params.text("filename") {
            Some((_, line)) if constant.is_some() => {
                params.problem(line, format!("{} has both L and filename: remove one", params.of().to_owned()));
                None
            }
            Some((file, line)) => self.environment(&file, &Source { line, ..d.source.clone() }, &mut params),
            None => Some(EnvironmentRadiance::Constant(scaled(constant.unwrap_or([1.0; 3]), &mut params))),
        };
        if params.finish(&mut self.log)
            && let Some(radiance) = radiance
        {
            let kind = LightKind::Infinite { radiance };
            self.scene.lights.push(Light { kind, to_world: self.state.ctm, source: d.source });
        }
    }

    fn environment(&mut self, file: &str, source: &Source, params: &mut Params) -> Option<EnvironmentRadiance> {
        let scale = params.float32("scale", 1.0, |v| v >= 0.0, "at least 0");
        let picture = self.picture(file, false, source)?;
        if picture.size[0] == picture.size[1] {
            let what = "a square environment (pbrt-v4's equal-area layout; a latitude-longitude picture is)";
            params.unsupported(source.line, what);
            return None;
        }
        let bad = picture.pixels.iter().position(|p| p.iter().any(|&c| !(0.0..f32::INFINITY).contains(&(c * scale))));
        if let Some(at) = bad {
            let (x, y) = (at as u32 % picture.size[0], at as u32 / picture.size[0]);
            let what = format!("pixel {x}, {y} of {} is negative or not finite: mend the picture", shown(file));
            params.problem(source.line, what);
            return None;
        }
        Some(EnvironmentRadiance::LatLong { picture, scale })
    }

    /// A picture by its name in the scene; each file is decoded once.
    pub(super) fn picture(&mut self, name: &str, linear: bool, source: &Source) -> Option<Arc<Picture>> {
        let key: (PathBuf, bool) = (self.resolve(name), linear);
        if let Some(picture) = self.pictures.get(&key) {
            return Some(picture.clone());
        }
        let bytes = self.load(&key.0, source)?;
        let encoding = if linear { Encoding::Linear } else { Encoding::Srgb };
        match read_picture(&bytes, name, encoding) {
            Ok(picture) => {
                let picture = Arc::new(picture);
                self.pictures.insert(key, picture.clone());
                Some(picture)
            }
            Err(e) => {
                self.log.problem(source, e.to_string());
                None
            }
        }
    }
}

/// Parameters that change the light and are not supported.
fn refuse(params: &mut Params, names: &[&'static str]) {
    for &name in names {
        if let Some(param) = params.take(name) {
            let what = format!("parameter {name} of {}", params.of());
            params.unsupported(param.line, what);
        }
    }
}

/// Radiance times the parameter `scale`.
fn scaled(radiance: [f32; 3], params: &mut Params) -> [f32; 3] {
    let largest = radiance.iter().fold(0.0f32, |a, &b| a.max(b));
    let ok = |v: f64| v >= 0.0 && (largest * v as f32).is_finite();
    let scale = params.float32("scale", 1.0, ok, "at least 0, and its product with L below 3.4e38");
    radiance.map(|c| c * scale)
}
