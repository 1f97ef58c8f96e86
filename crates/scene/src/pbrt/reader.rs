//! Execution of the directives of a pbrt file, one by one, on a graphics state.

use super::Log;
use super::ReadOptions;
use super::directive::{Directive, Directives, shown};
use super::legacy::Version;
use super::names::Names;
use super::params::{Context, Param, Params, Values};
use super::state::{Ctm, MaterialRef, State};
use super::textures::Images;
use crate::ReadError;
use crate::files::Files;
use crate::{MaterialId, MeshData, ObjectId, PixelFilter, Scene, Source};
use dapple_core::nearest_name;
use glam::DAffine3;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// The deepest nesting of blocks. Scenes have a few levels, and each level costs memory.
const DEEPEST_BLOCK: usize = 4096;
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

/// An open block: its opening directive and the state to restore at its end.
pub(super) struct Block {
    /// The opening directive: `AttributeBegin`, `TransformBegin` or `ObjectBegin`.
    pub(super) begin: &'static str,
    pub(super) source: Source,
    saved: State,
}

/// The reader of one pbrt scene: the scene so far, the graphics state, and all named objects.
#[derive(Default)]
pub(super) struct Reader<'a> {
    pub(super) files: &'a dyn Files,
    folder: PathBuf,
    path: PathBuf,
    pub(super) log: Log,
    pub(super) scene: Scene,
    pub(super) state: State,
    pub(super) context: Context,
    pub(super) blocks: Vec<Block>,
    /// Named coordinate systems. The two transforms lead to world space, at the start and at the end of the motion.
    pub(super) spaces: BTreeMap<String, [DAffine3; 2]>,
    /// The object that new shapes belong to; `None` outside of object definitions.
    pub(super) object: Option<ObjectId>,
    pub(super) named_objects: Names,
    pub(super) named_materials: Names,
    pub(super) named_media: Names,
    pub(super) default_material: Option<MaterialId>,
    /// The nesting depth of each texture of the scene, by its index.
    pub(super) texture_depths: Vec<u32>,
    pub(super) meshes: BTreeMap<PathBuf, Arc<MeshData>>,
    pub(super) images: Images,
    /// Number of triangles made so far from shapes that are not triangle meshes.
    pub(super) triangles_made: usize,
    /// The memory in bytes for subdivision surfaces, if it is limited.
    pub(super) memory: Option<u64>,
    /// The places in the file of directives that should occur only once, by name.
    pub(super) once: BTreeMap<String, Source>,
    including: Vec<PathBuf>,
    included: usize,
    /// Number of `Shape` directives so far, including failed ones. `lights_met` counts directives that emit light.
    pub(super) shapes_met: usize,
    pub(super) lights_met: usize,
    stopped: bool,
}

impl<'a> Reader<'a> {
    pub(super) fn new(files: &'a dyn Files, path: &Path, options: &ReadOptions) -> Self {
        let mut scene = Scene { max_depth: Some(5), motion_times: [0.0, 1.0], ..Scene::default() };
        scene.name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        // pbrt-v4's default filter.
        scene.film.pixel_filter = PixelFilter::Gaussian { radius: [1.5, 1.5], sigma: 0.5 };
        let (folder, path) = (path.parent().unwrap_or(Path::new("")).to_owned(), path.to_owned());
        let (log, memory) = (Log::new(options.allow_unsupported), options.memory);
        Self { files, folder, path, log, scene, memory, ..Self::default() }
    }

    pub(super) fn read(mut self) -> Result<Scene, ReadError> {
        let whole = Source { file: Arc::new(self.path.clone()), line: 0 };
        self.read_file(&self.path.clone(), &whole);
        if !self.stopped {
            self.check_complete(&whole);
        }
        self.scene.notices = self.log.finish()?;
        Ok(self.scene)
    }

    /// Returns the bytes of a file that the scene names at `source`; `None`, with a reported problem, if it cannot be
    /// read or is compressed by gzip.
    pub(super) fn load(&mut self, path: &Path, source: &Source) -> Option<Vec<u8>> {
        let what = match self.files.read(path) {
            Ok(bytes) if !bytes.starts_with(&[0x1f, 0x8b]) => return Some(bytes),
            Ok(_) => format!("{} is compressed with gzip; unpack it and name the unpacked file", path.display()),
            Err(e) => format!("cannot read {}: {e}; check the name and that the file is there", path.display()),
        };
        self.log.problem(source, what);
        None
    }

    /// Returns the path of a file that the scene names: relative to the folder of the main scene file.
    pub(super) fn resolve(&self, name: &str) -> PathBuf {
        tidy(&self.folder.join(name))
    }

    fn read_file(&mut self, path: &Path, named_at: &Source) {
        let Some(bytes) = self.load(path, named_at) else {
            self.stopped |= self.including.is_empty();
            return;
        };
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
        let file = Arc::new(path.to_owned());
        let text = match std::str::from_utf8(bytes) {
            Ok(text) => text,
            Err(e) => {
                let good = &bytes[..e.valid_up_to()];
                let line = 1 + good.iter().filter(|&&b| b == b'\n').count() as u32;
                let what = format!("the byte at offset {} is not UTF-8; save the file as UTF-8", good.len());
                self.log.problem(&Source { file, line }, what);
                self.stopped = true;
                return;
            }
        };
        if self.including.is_empty() {
            self.set_version(Version::of(text), named_at);
        }
        self.including.push(path.to_owned());
        let mut directives = Directives::new(text, file);
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
            let what =
                format!("this file is written for an older version; it is read by the rules of {}", version.name());
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
                let what = "TransformBegin is read as AttributeBegin, as pbrt-v4 does; write that instead";
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

    /// Returns true if a directive stands where it belongs, before or after `WorldBegin`; else reports it.
    fn is_placed(&mut self, d: &Directive<'_>, after: bool) -> bool {
        let placed = self.once.contains_key("WorldBegin") == after;
        if !placed {
            let side = if after { "after" } else { "before" };
            self.log.problem(&d.source, format!("{} belongs {side} WorldBegin; move it there", d.word));
        }
        placed
    }

    /// Records a directive that should occur only once. Adds a notice if it has occurred before.
    pub(super) fn meet(&mut self, word: &str, source: &Source) {
        if let Some(first) = self.once.insert(word.to_owned(), source.clone()) {
            self.log.notice(source, format!("a second {word} (the first is at {first}); this one counts"));
        }
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

    pub(super) fn begin_block(&mut self, begin: &'static str, source: Source) {
        if self.blocks.len() >= DEEPEST_BLOCK {
            let what = format!("blocks are nested too deep; at most {DEEPEST_BLOCK} may be open; the rest is not read");
            self.log.problem(&source, what);
            self.stopped = true;
            return;
        }
        self.blocks.push(Block { begin, source, saved: self.state.clone() });
    }

    fn end_block(&mut self, begin: &'static str, d: &Directive<'_>) {
        match self.blocks.pop() {
            Some(block) => {
                if block.begin != begin {
                    let what = format!("{} closes the {} of {}; they must match", d.word, block.begin, block.source);
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
            None => self.log.problem(&d.source, format!("{} without {begin}; remove it", d.word)),
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
            let what = format!("more than {MOST_ATTRIBUTES} attributes of one kind; give them where they belong");
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
            self.log.problem(source, format!("files are included too deep; at most {DEEPEST_INCLUDE} may be open"));
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
                self.log.notice(&d.source, format!("Option {} is not followed", shown(&param.name)));
            }
        }
    }

    /// Returns the parameters of a directive, with those that `Attribute` added for directives of `kind` (`shape`,
    /// `light`, …).
    pub(super) fn params(&mut self, d: &mut Directive<'_>, kind: &str) -> Params {
        let of = d.texts.last().map_or(d.word.to_owned(), |t| format!("{} {}", d.word, shown(t)));
        self.load_spectra(&mut d.params, &d.source);
        let inherited = self.state.attributes.get(kind).map_or(&[][..], Vec::as_slice);
        Params::new(of, &d.source, std::mem::take(&mut d.params), inherited, self.context.clone())
    }
}

/// Returns the message for an unknown name. It suggests the nearest known name or, if none is near, gives `advice`.
pub(super) fn unknown_name<'k>(
    what: &str,
    name: &str,
    known: impl IntoIterator<Item = &'k (impl AsRef<str> + ?Sized + 'k)>,
    advice: &str,
) -> String {
    match nearest_name(name, known.into_iter().map(AsRef::as_ref)) {
        Some(near) => format!("unknown {what} {}; did you mean \"{near}\"?", shown(name)),
        None => format!("unknown {what} {}; {advice}", shown(name)),
    }
}

/// Returns a path without `.` components, and without `..` components that follow a folder's name.
fn tidy(path: &Path) -> PathBuf {
    let mut tidy = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if matches!(tidy.components().next_back(), Some(Component::Normal(_))) => {
                tidy.pop();
            }
            part => tidy.push(part),
        }
    }
    tidy
}
