//! Participating media of pbrt scenes.

use super::directive::Directive;
use super::reader::Reader;
use super::spectra::Gamut;
use super::state::MediaRef;
use super::tokens::shown;
use crate::Medium;
use std::rc::Rc;

impl Reader<'_> {
    /// Executes `MakeNamedMedium`: defines a homogeneous medium.
    pub(super) fn make_medium(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "medium");
        let name = d.texts.swap_remove(0);
        let line = d.source.line;
        match params.text("type") {
            Some((kind, _)) if kind == "homogeneous" => {}
            Some((kind, line)) => {
                params.unsupported(line, format!("a medium of type {} (other than homogeneous)", shown(&kind)));
                params.ignore_rest();
            }
            None => params.lacks(line, "its type; add \"string type\" \"homogeneous\""),
        }
        if let Some(param) = params.take("preset") {
            let what = format!("parameter preset (give its sigma_a and sigma_s) of {}", params.of());
            params.unsupported(param.line, what);
        }
        params.refuse(&["Le", "Lescale"]);
        // pbrt's defaults.
        let absorption = params.rgb("sigma_a", Gamut::Unbounded).unwrap_or([0.0011, 0.0024, 0.014]);
        let scattering = params.rgb("sigma_s", Gamut::Unbounded).unwrap_or([2.55, 3.21, 3.77]);
        let largest = absorption.iter().chain(&scattering).fold(0.0f32, |a, &b| a.max(b));
        let ok = |v: f64| v >= 0.0 && (largest * v as f32).is_finite();
        let scale = params.float32("scale", 1.0, ok, "at least 0, and its product with the coefficients below 3.4e38");
        let g = params.float32("g", 0.0, |v| v > -1.0 && v < 1.0, "between -1 and 1");
        if let Some(first) = self.named_media.get(&name) {
            let first = &self.scene.media[first].source;
            params.problem(line, format!("medium {} is made twice (first at {first})", shown(&name)));
        }
        // Made even after an error, so that its uses cause no further errors.
        let _good = params.finish(&mut self.log);
        let [absorption, scattering] = [absorption, scattering].map(|rgb| rgb.map(|c| c * scale));
        let medium = Medium { name: name.clone(), absorption, scattering, g, source: d.source };
        self.named_media.define(&name, medium, &mut self.scene.media);
    }

    /// Executes `MediumInterface`: sets the media of later shapes, and of the camera.
    pub(super) fn set_media(&mut self, d: Directive<'_>) {
        let named = |i: usize| d.texts.get(i).filter(|name| !name.is_empty()).cloned();
        let inside = named(0);
        // A single name applies to both sides, as in pbrt.
        let outside = if d.texts.len() == 1 { inside.clone() } else { named(1) };
        self.state.media = Some(Rc::new(MediaRef { inside, outside, source: d.source }));
    }
}
