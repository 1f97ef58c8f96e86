//! Execution of the directives of a pbrt file, one by one, and checks of the whole.

use super::directive::{Directive, Directives};
use super::params::{Param, Values};
use super::reader::{Ctm, MaterialRef, Reader, tidy};
use super::tokens::shown;
use super::version::Version;
use crate::scene_reader::ReadError;
use crate::{Material, MaterialKind, PixelFilter, Scene, Source, text};
use glam::DAffine3;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

/// The deepest nesting of included files. Each level costs stack memory.
const DEEPEST_INCLUDE: usize = 32;
/// The largest number of included files, which bounds the work for a few small files that include each other many
/// times.
const MOST_INCLUDES: usize = 10_000;

/// The largest number of parameters that `Attribute` may add to one kind of directive. Each directive copies these
/// parameters.
const MOST_ATTRIBUTES: usize = 64;
/// The kinds of directives to which `Attribute` adds parameters.
const ATTRIBUTED: [&str; 5] = ["shape", "light", "material", "medium", "texture"];

/// The deepest nesting of mixed materials. Each level costs a random choice per hit.
const DEEPEST_MIX: u32 = 8;

impl Reader<'_> {
    pub(super) fn read(mut self) -> Result<Scene, ReadError> {
        let whole = Source { file: Arc::new(self.path.clone()), line: 0 };
        self.read_file(&self.path.clone(), &whole);
        if !self.stopped {
            self.check_complete(&whole);
        }
        self.scene.notices = self.log.finish()?;
        Ok(self.scene)
    }

    fn read_file(&mut self, path: &Path, named_at: &Source) {
        let Some(bytes) = self.load(path, named_at) else {
            self.stopped |= self.including.is_empty();
            return;
        };
        let file = Arc::new(path.to_owned());
        let text = match text::decode(&bytes) {
            Ok(text) => text,
            Err(what) => {
                self.log.problem(&Source { file, line: 0 }, what);
                self.stopped = true;
                return;
            }
        };
        if self.including.is_empty() {
            self.set_version(Version::of(&text), named_at);
        }
        self.including.push(path.to_owned());
        let mut directives = Directives::new(&text, file);
        while let Some(directive) = directives.next(&mut self.log) {
            self.execute(directive);
            if self.stopped {
                return;
            }
        }
        if !text.is_empty() && !text.ends_with('\n') {
            let what = "the last line has no line break; if the file was cut off, something may be missing";
            self.log.notice(&directives.here(), what);
        }
        self.including.pop();
    }

    /// Sets the pbrt version whose rules and defaults apply. Adds a notice for a version before pbrt-v4.
    fn set_version(&mut self, version: Version, whole: &Source) {
        self.context.version = version;
        if version.is_old() {
            let what = format!("this file is of an older version and is read by the rules of {}", version.name());
            self.log.notice(whole, what);
            self.scene.film.resolution = [640, 480];
            self.scene.film.pixel_filter = PixelFilter::Box { radius: [0.5, 0.5] };
        }
    }

    fn execute(&mut self, mut d: Directive<'_>) {
        if self.transform(&d) {
            return;
        }
        let source = d.source.clone();
        match d.word {
            "ReverseOrientation" if self.in_world(&d) => self.state.reversed = !self.state.reversed,
            "WorldBegin" => self.begin_world(&source),
            "AttributeBegin" if self.in_world(&d) => self.begin_block("AttributeBegin", source),
            "TransformBegin" if self.context.version.is_old() => self.begin_block("TransformBegin", source),
            "TransformBegin" if self.in_world(&d) => {
                let what = "TransformBegin is read as AttributeBegin, as in pbrt-v4; write AttributeBegin instead";
                self.log.notice(&source, what);
                self.begin_block("TransformBegin", source);
            }
            "ObjectBegin" if self.in_world(&d) => self.begin_object(&d),
            "ObjectInstance" if self.in_world(&d) => self.add_instance(&d),
            "AttributeEnd" => self.end_block("AttributeBegin", &d),
            "TransformEnd" => self.end_block("TransformBegin", &d),
            "ObjectEnd" => self.end_block("ObjectBegin", &d),
            "Attribute" => self.add_attributes(d),
            "Include" | "Import" => self.include(&d.texts[0], &source),
            "Option" => self.read_option(d),
            "ColorSpace" if d.texts[0] != "srgb" => {
                self.log.unsupported(&source, &format!("ColorSpace {}", shown(&d.texts[0])));
            }
            "ColorSpace" => {}
            "Camera" | "Film" | "Sampler" | "Integrator" | "PixelFilter" if self.is_placed(&d, false) => {
                self.read_rendering_option(d);
            }
            // Advice on speed, which does not change the image.
            "Accelerator" => {}
            "MakeNamedMaterial" => self.make_named_material(d),
            "NamedMaterial" if self.in_world(&d) => {
                self.state.material = MaterialRef::Named(d.texts.swap_remove(0).into(), Rc::new(source));
            }
            "Material" if self.in_world(&d) => self.set_material(d),
            "Texture" if self.in_world(&d) => self.make_texture(d),
            "Shape" if self.in_world(&d) => self.add_shape(d),
            "AreaLightSource" if self.in_world(&d) => self.set_area_light(d),
            "LightSource" if self.in_world(&d) => self.add_light(d),
            "TransformTimes" if self.is_placed(&d, false) => self.set_times(&d),
            "MakeNamedMedium" => self.make_medium(d),
            "MediumInterface" => self.set_media(d),
            "WorldEnd" if self.context.version.is_old() => {}
            "WorldEnd" => self.log.notice(&source, "WorldEnd is not needed since pbrt-v4"),
            "Renderer" | "SurfaceIntegrator" | "VolumeIntegrator" => self.read_old_transport(d),
            "Volume" => self.log.unsupported(&source, "Volume (of pbrt-v2)"),
            // A directive in the wrong part of the file, which has been reported.
            _ => {}
        }
    }

    fn in_world(&mut self, d: &Directive<'_>) -> bool {
        self.is_placed(d, true)
    }

    /// Returns true if a directive is on the correct side of `WorldBegin`: after it if `after` is true, else before it.
    /// Otherwise reports a problem.
    fn is_placed(&mut self, d: &Directive<'_>, after: bool) -> bool {
        let placed = self.once.contains_key("WorldBegin") == after;
        if !placed {
            let side = if after { "after" } else { "before" };
            self.log.problem(&d.source, format!("{} belongs {side} WorldBegin; move it there", d.word));
        }
        placed
    }

    fn begin_world(&mut self, source: &Source) {
        if let Some(first) = self.once.get("WorldBegin").cloned() {
            self.log.problem(source, format!("a second WorldBegin (the first is at {first}); remove one"));
            return;
        }
        self.once.insert("WorldBegin".into(), source.clone());
        self.state.ctm = Ctm::default();
        self.spaces.insert("world".into(), [DAffine3::IDENTITY; 2]);
    }

    fn end_block(&mut self, begin: &'static str, d: &Directive<'_>) {
        match self.blocks.pop() {
            Some(block) => {
                if block.begin != begin {
                    let what = format!("{} closes the {} at {}; they must match", d.word, block.begin, block.source);
                    self.log.problem(&d.source, what);
                }
                if block.begin == "ObjectBegin" {
                    self.object = None;
                }
                if block.begin == "TransformBegin" && self.context.version.is_old() {
                    // In older versions such a block saves only the transform.
                    self.state.ctm = block.saved.ctm;
                } else {
                    self.state = block.saved;
                }
            }
            None => self.log.problem(&d.source, format!("{} has no matching {begin}; remove it", d.word)),
        }
    }

    fn add_attributes(&mut self, mut d: Directive<'_>) {
        self.load_spectra(&mut d.params, &d.source);
        let kind = ATTRIBUTED.iter().find(|kind| **kind == d.texts[0]);
        let Some(kind) = kind else {
            let what = "is unknown; use shape, light, material, medium or texture";
            self.log.problem(&d.source, format!("Attribute {} {what}", shown(&d.texts[0])));
            return;
        };
        let list = Rc::make_mut(&mut self.state.attributes).entry(kind).or_default();
        // Later parameters replace earlier ones of the same name.
        list.retain(|old: &Param| d.params.iter().all(|new| new.name != old.name));
        list.extend(d.params);
        if list.len() > MOST_ATTRIBUTES {
            let what = format!("more than {MOST_ATTRIBUTES} Attribute parameters of a kind; set some in directives");
            self.log.problem(&d.source, what);
            self.stopped = true;
        }
    }

    fn include(&mut self, name: &str, source: &Source) {
        let path = self.resolve(name);
        self.included += 1;
        if self.including.iter().any(|open| tidy(open) == path) {
            self.log.problem(source, format!("{} includes itself; remove this Include", path.display()));
        } else if self.including.len() > DEEPEST_INCLUDE {
            self.log.problem(source, format!("includes are nested too deep; at most {DEEPEST_INCLUDE} may be open"));
        } else if self.included > MOST_INCLUDES {
            self.log.problem(source, format!("more than {MOST_INCLUDES} files are included; the rest is not read"));
            self.stopped = true;
        } else {
            self.read_file(&path, source);
        }
    }

    fn read_option(&mut self, d: Directive<'_>) {
        for param in &d.params {
            // The only option that changes materials.
            if param.name == "forcediffuse" && param.values != Values::Bools(vec![false]) {
                self.log.unsupported(&d.source, "Option forcediffuse");
            } else {
                self.log.notice(&d.source, format!("Option {} is ignored", shown(&param.name)));
            }
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
        let light = "there are no lights; add a LightSource, or an AreaLightSource before a Shape";
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
                true => "no shape is placed in the world; place an object with ObjectInstance",
                false => "no shapes remain after unsupported ones are left out; add a supported Shape",
            };
            self.log.problem(whole, what);
        }
        if lights.is_empty() && shapes.iter().all(|s| s.emission.is_none()) {
            self.log.problem(whole, "no lights remain after unsupported ones and area lights without a shape are left out; add a supported light");
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
                format!("material {name} contains itself, or nests more than {DEEPEST_MIX} mixes; mix other materials");
            self.log.problem(source, what);
        }
    }
}
