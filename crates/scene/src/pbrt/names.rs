//! Names of materials, media and objects, which may be used before their definition. Objects and their instances, and
//! checks that need the whole file. Participating media.

use super::Log;
use super::directive::{Directive, shown};
use super::reader::{Reader, unknown_name};
use super::spectra::Gamut;
use super::state::{MaterialRef, MediaRef};
use crate::{
    Instance, Material, MaterialId, MaterialKind, Medium, MediumId, MediumInterface, Object, ObjectId, Scene, Shape,
    Source,
};
use std::collections::BTreeMap;
use std::rc::Rc;

/// The deepest nesting of mixed materials. Each level costs a random choice per hit.
const DEEPEST_MIX: u32 = 8;

/// The names of the scene's materials, media or objects. A use before the definition reserves a place in the scene.
#[derive(Default)]
pub(super) struct Names {
    /// The index in the scene by name.
    defined: BTreeMap<String, usize>,
    /// The reserved index, and the place of the first use, of each name that is not defined yet.
    awaited: BTreeMap<String, (usize, Source)>,
}

impl Names {
    /// Returns the index of a name; `None` if it is not defined yet.
    pub(super) fn get(&self, name: &str) -> Option<usize> {
        self.defined.get(name).copied()
    }

    /// Defines a name as `item`, which goes to its place in `list`. Returns its index.
    pub(super) fn define<T>(&mut self, name: &str, item: T, list: &mut Vec<T>) -> usize {
        let index = self.awaited.remove(name).map_or(list.len(), |(index, _)| index);
        self.defined.insert(name.to_owned(), index);
        match list.get_mut(index) {
            Some(place) => *place = item,
            None => list.push(item),
        }
        index
    }

    /// Returns the index of a name that is used at `source`. Reserves a place with `item` for a name without one.
    fn used<T>(&mut self, name: &str, source: &Source, list: &mut Vec<T>, item: impl FnOnce(Source) -> T) -> usize {
        if let Some(index) = self.get(name).or(self.awaited.get(name).map(|(index, _)| *index)) {
            return index;
        }
        self.awaited.insert(name.to_owned(), (list.len(), source.clone()));
        list.push(item(source.clone()));
        list.len() - 1
    }

    /// Reports the names that are used and not defined, in the order of their first uses. `what` is the kind of thing that
    /// has them, made by the directive `by`.
    fn check(&self, what: &str, by: &str, log: &mut Log) {
        let mut unknown: Vec<_> = self.awaited.iter().collect();
        unknown.sort_by_key(|(_, (index, _))| *index);
        for (name, (_, source)) in unknown {
            log.problem(source, unknown_name(what, name, self.defined.keys(), &format!("make it by {by}")));
        }
    }
}

impl Reader<'_> {
    pub(super) fn material_named(&mut self, name: &str, source: &Source) -> MaterialId {
        let item = |source| Material::new(name, super::materials::default_kind(), source);
        MaterialId(self.named_materials.used(name, source, &mut self.scene.materials, item) as u32)
    }

    pub(super) fn medium_named(&mut self, name: Option<&str>, source: &Source) -> Option<MediumId> {
        let (name, none) = (name?, [0.0; 3]);
        let item = |source| Medium { name: name.to_owned(), absorption: none, scattering: none, g: 0.0, source };
        Some(MediumId(self.named_media.used(name, source, &mut self.scene.media, item) as u32))
    }

    /// Executes `ObjectBegin`: later shapes belong to this object until `ObjectEnd`.
    pub(super) fn begin_object(&mut self, d: &Directive<'_>) {
        if let Some(open) = self.object {
            let open = &self.scene.objects[open.0 as usize];
            let what = format!("ObjectBegin within object {} of {}; close that first", shown(&open.name), open.source);
            self.log.problem(&d.source, what);
        }
        let name = d.texts[0].clone();
        if let Some(first) = self.named_objects.get(&name) {
            let first = &self.scene.objects[first].source;
            let what = format!("object {} is made twice (first at {first}); rename one", shown(&name));
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
                let kind = super::materials::default_kind();
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

    /// Reports undefined names and missing parts of the scene: unclosed blocks, no `WorldBegin`, camera, shape or light.
    /// `whole` is the whole file, for messages.
    pub(super) fn check_complete(&mut self, whole: &Source) {
        self.named_materials.check("material", "MakeNamedMaterial", &mut self.log);
        self.named_media.check("medium", "MakeNamedMedium", &mut self.log);
        self.named_objects.check("object", "ObjectBegin", &mut self.log);
        self.check_mixes();
        // An instance of an empty object has no effect.
        let objects = &self.scene.objects;
        self.scene.instances.retain(|i| !objects[i.object.0 as usize].shapes.is_empty());
        for block in std::mem::take(&mut self.blocks) {
            self.log.problem(&block.source, format!("this {} is never closed", block.begin));
        }
        if !self.once.contains_key("WorldBegin") {
            self.log.problem(whole, "there is no WorldBegin; the file holds no scene, or is cut off");
            return;
        }
        self.check_old_transport(whole);
        if !self.once.contains_key("Film") {
            let [width, height] = self.scene.film.resolution;
            self.log.notice(whole, format!("there is no Film; the image is {width}x{height}"));
        }
        let camera = "there is no Camera; add one before WorldBegin, as in Camera \"perspective\"";
        let light = "nothing gives off light; add a LightSource, or an AreaLightSource before a Shape";
        let present = [
            (self.once.contains_key("Camera"), camera),
            (self.shapes_met > 0, "there are no shapes; add a Shape after WorldBegin"),
            (self.lights_met > 0, light),
        ];
        present.iter().filter(|(there, _)| !there).for_each(|(_, what)| self.log.problem(whole, *what));
        if self.log.has_problems() {
            return;
        }
        // The unsupported features left out may have been the only shapes or lights.
        let Scene { shapes, instances, objects, lights, .. } = &self.scene;
        if shapes.is_empty() && instances.is_empty() {
            let what = match objects.iter().any(|o| !o.shapes.is_empty()) {
                true => "no shape stands in the world; place an object by ObjectInstance",
                false => "no shapes remain once unsupported ones are left out",
            };
            self.log.problem(whole, what);
        }
        if lights.is_empty() && shapes.iter().all(|s| s.emission.is_none()) {
            self.log.problem(whole, "no lights remain; those that there are belong to no shape, or are not supported");
        }
    }

    /// Reports mixes that are nested too deep, or contain themselves.
    fn check_mixes(&mut self) {
        // The depth of a mix that contains itself exceeds every bound.
        let mut depths = vec![0; self.scene.materials.len()];
        for _ in 0..=DEEPEST_MIX {
            for (mix, material) in self.scene.materials.iter().enumerate() {
                if let MaterialKind::Mix { materials, .. } = &material.kind {
                    let deepest = materials.iter().map(|m| depths[m.0 as usize]).max().unwrap_or(0);
                    depths[mix] = deepest + 1;
                }
            }
        }
        let deep = self.scene.materials.iter().zip(depths).find(|(_, depth)| *depth > DEEPEST_MIX);
        if let Some((Material { name, source, .. }, _)) = deep.filter(|_| !self.log.has_problems()) {
            let name = shown(name);
            let what =
                format!("material {name} mixes itself, or mixes more than {DEEPEST_MIX} deep; name other materials");
            self.log.problem(source, what);
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
            let what = format!("parameter preset (give its sigma_a and sigma_s) of {}", params.of);
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
