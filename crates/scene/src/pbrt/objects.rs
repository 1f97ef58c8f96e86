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
            let first = &self.scene.objects[first.0 as usize].source;
            let what = format!("object {} is made twice (first at {first}); rename one", shown(&name));
            self.log.problem(&d.source, what);
        }
        self.begin_block("ObjectBegin", d.source.clone());
        let id = ObjectId(self.scene.objects.len() as u32);
        self.scene.objects.push(Object { name: name.clone(), shapes: Vec::new(), source: d.source.clone() });
        self.named_objects.insert(name, id);
        self.object = Some(id);
    }

    /// Executes `ObjectInstance`: places an object in the world.
    pub(super) fn add_instance(&mut self, d: &Directive<'_>) {
        if self.object.is_some() {
            let what = "ObjectInstance within an object; objects hold shapes only, so move it out";
            self.log.problem(&d.source, what);
            return;
        }
        // The object may be defined later: pbrt looks it up at the end of the file.
        let object = match self.named_objects.get(&d.texts[0]) {
            Some(&id) => id,
            None => {
                self.awaited.instances.push((self.scene.instances.len(), d.texts[0].clone()));
                ObjectId(0)
            }
        };
        let ctm = &self.state.ctm;
        let source = d.source.clone();
        self.scene.instances.push(Instance { object, to_world: ctm.start, moves_to: ctm.moves_to(), source });
    }
}
