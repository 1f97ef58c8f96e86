//! Directives of objects, their instances and participating media.

use super::directive::Directive;
use super::materials::default_kind;
use super::reader::{MaterialRef, MediaRef, Reader};
use super::spectra::Gamut;
use super::tokens::shown;
use crate::{Instance, Material, Medium, MediumInterface, Object, ObjectId, Shape};
use std::rc::Rc;

impl Reader<'_> {
    /// Executes `ObjectBegin`: later shapes belong to this object until `ObjectEnd`.
    pub(super) fn begin_object(&mut self, d: &Directive<'_>) {
        if let Some(open) = self.object {
            let open = &self.scene.objects[open.0 as usize];
            let what = format!("ObjectBegin in object {} at {}; end the object first", shown(&open.name), open.source);
            self.log.problem(&d.source, what);
        }
        let name = d.texts[0].clone();
        if let Some(first) = self.named_objects.get(&name) {
            let first = &self.scene.objects[first].source;
            let what = format!("object {} is defined twice (first at {first}); rename one", shown(&name));
            self.log.problem(&d.source, what);
        }
        self.begin_block("ObjectBegin", d.source.clone());
        let object = Object { name: name.clone(), shapes: Vec::new(), source: d.source.clone() };
        self.object = Some(ObjectId(self.named_objects.define(&name, object, &mut self.scene.objects) as u32));
    }

    /// Executes `ObjectInstance`: places an object in the world.
    pub(super) fn add_instance(&mut self, d: &Directive<'_>) {
        if self.object.is_some() {
            let what = "ObjectInstance within an object; objects hold shapes only, so move it out";
            self.log.problem(&d.source, what);
            return;
        }
        let item = |source| Object { name: d.texts[0].clone(), shapes: Vec::new(), source };
        let object = self.named_objects.used(&d.texts[0], &d.source, &mut self.scene.objects, item);
        let ctm = &self.state.ctm;
        let (object, source) = (ObjectId(object as u32), d.source.clone());
        self.scene.instances.push(Instance { object, to_world: ctm.start, moves_to: ctm.moves_to(), source });
    }

    /// Adds a shape to the current object or, outside of objects, to the scene. The shape gets the current material and
    /// media.
    pub(super) fn keep_shape(&mut self, mut shape: Shape) {
        shape.material = match self.state.material.clone() {
            MaterialRef::Made(id) => id,
            MaterialRef::Named(name, source) => self.material_named(&name, &source),
            MaterialRef::Default => *self.default_material.get_or_insert_with(|| {
                let kind = default_kind();
                self.scene.add_material(Material::new("default", kind, shape.source.clone()))
            }),
        };
        // With the same medium on both sides, the surrounding medium stays.
        if let Some(media) = self.state.media.clone().filter(|media| media.inside != media.outside) {
            let [inside, outside] =
                [&media.inside, &media.outside].map(|name| self.medium_named(name.as_deref(), &media.source));
            shape.media = Some(MediumInterface { inside, outside });
        }
        match self.object {
            Some(id) => self.scene.objects[id.0 as usize].shapes.push(shape),
            None => self.scene.shapes.push(shape),
        }
    }

    /// Executes `MakeNamedMedium`: defines a homogeneous medium.
    pub(super) fn make_medium(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "medium");
        let name = d.texts.swap_remove(0);
        let line = d.source.line;
        let kind = params.text("type").or_else(|| params.lacks("its type; add \"string type\" \"homogeneous\""));
        if let Some((kind, line)) = kind.filter(|(kind, _)| kind != "homogeneous") {
            params.unsupported(line, format!("a medium of type {} (other than homogeneous)", shown(&kind)));
            params.ignore_rest();
        }
        if let Some(param) = params.take("preset") {
            let what = format!("parameter preset (use sigma_a and sigma_s) of {}", params.of);
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
            params.problem(line, format!("medium {} is defined twice (first at {first}); rename one", shown(&name)));
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
