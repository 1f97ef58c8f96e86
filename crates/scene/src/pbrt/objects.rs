//! Objects of pbrt scenes, and their instances.

use super::directive::Directive;
use super::reader::Reader;
use super::tokens::shown;
use crate::{Instance, Object, ObjectId};

impl Reader<'_> {
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
        let object = self.object_named(&d.texts[0], &d.source);
        let ctm = &self.state.ctm;
        let source = d.source.clone();
        self.scene.instances.push(Instance { object, to_world: ctm.start, moves_to: ctm.moves_to(), source });
    }
}
