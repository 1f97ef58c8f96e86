//! Resolution of names that are used before their definition, and checks that need the whole file.

use super::reader::{Reader, unknown_name};
use super::state::{MaterialRef, MediaRef};
use super::tokens::shown;
use crate::{Material, MaterialId, MaterialKind, MediumId, MediumInterface, ObjectId, Shape, Source};
use std::rc::Rc;

/// The deepest nesting of mixed materials. Each level costs a random choice per hit.
const DEEPEST_MIX: u32 = 8;

/// References to names that are resolved at the end of the file.
#[derive(Default)]
pub(super) struct Awaited {
    /// Shapes, each with the name of its material and the place of that name in the file.
    materials: Vec<(ShapePlace, Rc<str>, Rc<Source>)>,
    /// Mixed materials, each with the names of its two materials.
    pub(super) mixes: Vec<(MaterialId, [String; 2])>,
    /// Shapes, each with the names of the media inside and outside.
    media: Vec<(ShapePlace, Rc<MediaRef>)>,
    /// The names of the media in effect at the `Camera` directive. The outside one surrounds the camera.
    pub(super) camera: Option<Rc<MediaRef>>,
    /// Indices of instances, each with the name of its object.
    pub(super) instances: Vec<(usize, String)>,
}

/// The index of a shape in its object, or in the scene if `object` is `None`.
#[derive(Clone, Copy)]
struct ShapePlace {
    object: Option<ObjectId>,
    index: usize,
}

impl Reader<'_> {
    pub(super) fn add_material(&mut self, material: Material) -> MaterialId {
        let id = MaterialId(self.scene.materials.len() as u32);
        self.scene.materials.push(material);
        id
    }

    /// Adds a shape to the current object or, outside of objects, to the scene. The shape gets the current material and
    /// media.
    pub(super) fn keep_shape(&mut self, mut shape: Shape) {
        let place = ShapePlace { object: self.object, index: self.shapes_here().len() };
        shape.material = self.current_material(&shape.source, place);
        // With the same medium on both sides, the surrounding medium stays.
        if let Some(media) = self.state.media.as_ref().filter(|m| m.inside != m.outside) {
            self.awaited.media.push((place, media.clone()));
        }
        self.shapes_here().push(shape);
    }

    fn shapes_here(&mut self) -> &mut Vec<Shape> {
        match self.object {
            Some(id) => &mut self.scene.objects[id.0 as usize].shapes,
            None => &mut self.scene.shapes,
        }
    }

    fn shape_at(&mut self, place: ShapePlace) -> &mut Shape {
        match place.object {
            Some(id) => &mut self.scene.objects[id.0 as usize].shapes[place.index],
            None => &mut self.scene.shapes[place.index],
        }
    }

    /// Returns the current material for the shape at `place`. If its name is not defined yet, returns a placeholder and
    /// records the name.
    fn current_material(&mut self, source: &Source, place: ShapePlace) -> MaterialId {
        match self.state.material.clone() {
            MaterialRef::Made(id) => id,
            MaterialRef::Named(name, at) => match self.named_materials.get(&*name) {
                Some(&id) => id,
                None => {
                    self.awaited.materials.push((place, name, at));
                    MaterialId(0)
                }
            },
            MaterialRef::Default => match self.default_material {
                Some(id) => id,
                None => {
                    let kind = super::materials::default_kind();
                    let id = self.add_material(Material::new("default", kind, source.clone()));
                    self.default_material = Some(id);
                    id
                }
            },
        }
    }

    /// Resolves all names, and reports missing parts of the scene: unclosed blocks, no `WorldBegin`, camera, shape or
    /// light. `whole` is the whole file, for messages.
    pub(super) fn check_complete(&mut self, whole: &Source) {
        let awaited = std::mem::take(&mut self.awaited);
        for (place, name, at) in awaited.materials {
            if let Some(id) = self.material_named(&name, &at) {
                self.shape_at(place).material = id;
            }
        }
        self.settle_mixes(awaited.mixes);
        self.settle_media(awaited.media, awaited.camera);
        self.settle_instances(awaited.instances);
        for block in std::mem::take(&mut self.blocks) {
            self.log.problem(&block.source, format!("this {} is never closed", block.begin));
        }
        if !self.once.places.contains_key("WorldBegin") {
            self.log.problem(whole, "there is no WorldBegin; the file holds no scene, or is cut off");
            return;
        }
        self.check_old_transport(whole);
        if !self.once.places.contains_key("Camera") {
            self.log.problem(whole, "there is no Camera; add one before WorldBegin, as in Camera \"perspective\"");
        }
        if !self.once.places.contains_key("Film") {
            let [width, height] = self.scene.film.resolution;
            self.log.notice(whole, format!("there is no Film; the image is {width}x{height}"));
        }
        if self.shapes_met == 0 {
            self.log.problem(whole, "there are no shapes; add a Shape after WorldBegin");
        }
        if self.lights_met == 0 {
            self.log.problem(whole, "nothing gives off light; add a LightSource, or an AreaLightSource before a Shape");
        }
        if self.log.has_problems() {
            return;
        }
        // The unsupported features left out may have been the only shapes or lights.
        if self.scene.shapes.is_empty() && self.scene.instances.is_empty() {
            let what = if self.scene.objects.iter().any(|o| !o.shapes.is_empty()) {
                "no shape stands in the world; place an object by ObjectInstance"
            } else {
                "no shapes remain once unsupported ones are left out"
            };
            self.log.problem(whole, what);
        }
        let shines = self.scene.shapes.iter().any(|s| s.emission.is_some());
        if self.scene.lights.is_empty() && !shines {
            self.log.problem(whole, "no lights remain; those that there are belong to no shape, or are not supported");
        }
    }

    fn material_named(&mut self, name: &str, at: &Source) -> Option<MaterialId> {
        let id = self.named_materials.get(name).copied();
        if id.is_none() {
            let advice = "make it by MakeNamedMaterial";
            self.log.problem(at, unknown_name("material", name, self.named_materials.keys(), advice));
        }
        id
    }

    fn settle_mixes(&mut self, mixes: Vec<(MaterialId, [String; 2])>) {
        for (mix, names) in &mixes {
            let source = self.scene.materials[mix.0 as usize].source.clone();
            let found = [0, 1].map(|i| self.material_named(&names[i], &source));
            if let ([Some(first), Some(second)], MaterialKind::Mix { materials, .. }) =
                (found, &mut self.scene.materials[mix.0 as usize].kind)
            {
                *materials = [first, second];
            }
        }
        // The depth of a mix that contains itself exceeds every bound.
        let mut depths = vec![0; self.scene.materials.len()];
        for _ in 0..=DEEPEST_MIX {
            for (mix, _) in &mixes {
                if let MaterialKind::Mix { materials, .. } = &self.scene.materials[mix.0 as usize].kind {
                    let deepest = materials.iter().map(|m| depths[m.0 as usize]).max().unwrap_or(0);
                    depths[mix.0 as usize] = deepest + 1;
                }
            }
        }
        for (mix, _) in &mixes {
            if depths[mix.0 as usize] > DEEPEST_MIX && !self.log.has_problems() {
                let Material { name, source, .. } = &self.scene.materials[mix.0 as usize];
                let what = format!(
                    "material {} mixes itself, or mixes more than {DEEPEST_MIX} deep; name other materials",
                    shown(name)
                );
                self.log.problem(&source.clone(), what);
            }
        }
    }

    fn settle_media(&mut self, shapes: Vec<(ShapePlace, Rc<MediaRef>)>, camera: Option<Rc<MediaRef>>) {
        // Many shapes share one directive, whose names are looked up and reported once.
        let mut last: Option<(Rc<MediaRef>, MediumInterface)> = None;
        for (place, media) in shapes {
            let known = last.as_ref().filter(|l| Rc::ptr_eq(&l.0, &media)).map(|l| l.1);
            let interface = known.unwrap_or_else(|| MediumInterface {
                inside: self.medium_named(media.inside.as_deref(), &media.source),
                outside: self.medium_named(media.outside.as_deref(), &media.source),
            });
            self.shape_at(place).media = Some(interface);
            last = Some((media, interface));
        }
        if let Some(media) = camera {
            self.scene.camera.medium = self.medium_named(media.outside.as_deref(), &media.source);
        }
    }

    fn medium_named(&mut self, name: Option<&str>, at: &Source) -> Option<MediumId> {
        let name = name?;
        let id = self.named_media.get(name).copied();
        if id.is_none() {
            let advice = "make it by MakeNamedMedium";
            self.log.problem(at, unknown_name("medium", name, self.named_media.keys(), advice));
        }
        id
    }

    fn settle_instances(&mut self, awaited: Vec<(usize, String)>) {
        for (instance, name) in awaited {
            match self.named_objects.get(&name) {
                Some(&id) => self.scene.instances[instance].object = id,
                None => {
                    let advice = "make it by ObjectBegin";
                    let what = unknown_name("object", &name, self.named_objects.keys(), advice);
                    self.log.problem(&self.scene.instances[instance].source.clone(), what);
                }
            }
        }
        let objects = &self.scene.objects;
        // An instance of an empty object has no effect.
        self.scene.instances.retain(|i| objects.get(i.object.0 as usize).is_some_and(|o| !o.shapes.is_empty()));
    }
}
