//! The reader of one pbrt scene: the state that directives change, which includes the graphics state.

use super::directive::Directive;
use super::images::{Images, ReadAs, decode};
use super::log::Log;
use super::materials::default_kind;
use super::names::Names;
use super::params::{Context, Param, Params, Type, Values};
use super::spectra::{names, numbers};
use super::tokens::{did_you_mean, shown};
use crate::files::Files;
use crate::image::Image;
use crate::scene_reader::{ReadOptions, cannot_read};
use crate::{Material, MaterialId, Medium, MediumId, MeshData, ObjectId, PixelFilter, Scene, Source, TextureId, text};
use glam::DAffine3;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// The deepest nesting of blocks. Scenes have a few levels, and each level costs memory.
const DEEPEST_BLOCK: usize = 4096;

/// The reader of one pbrt scene: the scene so far, the graphics state, and all named objects.
#[derive(Default)]
pub(super) struct Reader<'a> {
    pub(super) files: &'a dyn Files,
    pub(super) path: PathBuf,
    pub(super) log: Log,
    pub(super) scene: Scene,
    pub(super) state: State,
    pub(super) context: Context,
    pub(super) blocks: Vec<Block>,
    /// Named coordinate systems, as transforms to world space at the start and at the end of the motion.
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
    /// The memory limit in bytes for subdivision surfaces, if there is one.
    pub(super) memory: Option<u64>,
    /// The places in the file of directives that should occur only once, by name.
    pub(super) once: BTreeMap<String, Source>,
    pub(super) including: Vec<PathBuf>,
    pub(super) included: usize,
    /// Number of `Shape` directives so far, including failed ones. `lights_met` counts directives that emit light.
    pub(super) shapes_met: usize,
    pub(super) lights_met: usize,
    pub(super) stopped: bool,
}

impl<'a> Reader<'a> {
    pub(super) fn new(files: &'a dyn Files, path: &Path, options: &ReadOptions) -> Self {
        let mut scene = Scene { max_depth: Some(5), motion_times: [0.0, 1.0], ..Scene::default() };
        scene.name = text::file_stem(path).unwrap_or_default();
        // pbrt-v4's default filter.
        scene.film.pixel_filter = PixelFilter::Gaussian { radius: [1.5, 1.5], sigma: 0.5 };
        let mut reader = Self { files, path: path.to_owned(), scene, memory: options.memory, ..Self::default() };
        reader.log.allow_unsupported = options.allow_unsupported;
        reader
    }

    /// Returns the bytes of a file that the scene names at `source`; `None`, with a reported problem, if it cannot be
    /// read or is compressed by gzip.
    pub(super) fn load(&mut self, path: &Path, source: &Source) -> Option<Vec<u8>> {
        let what = match self.files.read(path) {
            Ok(bytes) if !bytes.starts_with(&[0x1f, 0x8b]) => return Some(bytes),
            Ok(_) => format!("{} is compressed with gzip; unpack this file and name the unpacked one", path.display()),
            Err(e) => cannot_read(path, &e),
        };
        self.log.problem(source, what);
        None
    }

    /// Returns the path of a file that the scene names: relative to the folder of the main scene file.
    pub(super) fn resolve(&self, name: &str) -> PathBuf {
        tidy(&self.path.parent().unwrap_or(Path::new("")).join(name))
    }

    /// Returns the image of a file that the scene names. Decodes the file at its first use. `None`, with a reported
    /// problem, if the file cannot be read.
    pub(super) fn image(&mut self, name: &str, read_as: ReadAs, source: &Source) -> Option<Arc<Image>> {
        let key = (self.resolve(name), read_as);
        if let Some(image) = self.images.get(&key) {
            return Some(image.clone());
        }
        let image = decode(&self.load(&key.0, source)?, name, read_as);
        let (image, notices) = image.map_err(|e| self.log.problem(source, e.to_string())).ok()?;
        notices.into_iter().for_each(|notice| self.log.notice(source, notice));
        let image = Arc::new(image);
        self.images.insert(key, image.clone());
        Some(image)
    }

    /// Records a directive that should occur only once. Adds a notice if it has occurred before.
    pub(super) fn meet(&mut self, word: &str, source: &Source) {
        if let Some(first) = self.once.insert(word.to_owned(), source.clone()) {
            self.log.notice(source, format!("a second {word} (the first is at {first}); this one is used"));
        }
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

    /// Replaces each file name in a spectrum parameter by the numbers in the file.
    pub(super) fn load_spectra(&mut self, params: &mut [Param], source: &Source) {
        for param in params.iter_mut().filter(|p| p.ty == Type::Spectrum) {
            let Values::Texts(texts) = &param.values else { continue };
            let [name] = &texts[..] else { continue };
            if names().any(|known| known == name) {
                continue;
            }
            let at = Source { line: param.line, ..source.clone() };
            let name = name.clone();
            param.values = self.spectrum_file(&name, &at).map_or(Values::Broken, Values::Numbers);
        }
    }

    fn spectrum_file(&mut self, name: &str, at: &Source) -> Option<Vec<f64>> {
        let path = self.resolve(name);
        if self.files.read(&path).is_err_and(|e| e.kind() == ErrorKind::NotFound) {
            let near = did_you_mean(name, names());
            self.log.problem(at, format!("spectrum {} is neither known by name nor a file{near}", shown(name)));
            return None;
        }
        let read = numbers(&self.load(&path, at)?);
        let file = Arc::new(path);
        read.map_err(|(line, what)| self.log.problem(&Source { file, line }, what)).ok()
    }

    pub(super) fn material_named(&mut self, name: &str, source: &Source) -> MaterialId {
        let item = |source| Material::new(name, default_kind(), source);
        MaterialId(self.named_materials.used(name, source, &mut self.scene.materials, item) as u32)
    }

    pub(super) fn medium_named(&mut self, name: Option<&str>, source: &Source) -> Option<MediumId> {
        let (name, none) = (name?, [0.0; 3]);
        let item = |source| Medium { name: name.to_owned(), absorption: none, scattering: none, g: 0.0, source };
        Some(MediumId(self.named_media.used(name, source, &mut self.scene.media, item) as u32))
    }

    /// Returns the parameters of a directive, including parameters that `Attribute` added for directives of `kind` (`shape`,
    /// `light`, …).
    pub(super) fn params(&mut self, d: &mut Directive<'_>, kind: &str) -> Params {
        let of = d.texts.last().map_or(d.word.to_owned(), |t| format!("{} {}", d.word, shown(t)));
        self.load_spectra(&mut d.params, &d.source);
        let inherited = self.state.attributes.get(kind).map_or(&[][..], Vec::as_slice);
        Params::new(of, &d.source, std::mem::take(&mut d.params), inherited, self.context.clone())
    }
}

/// Returns a path without `.` components, and without `..` components that follow a folder's name.
pub(super) fn tidy(path: &Path) -> PathBuf {
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

/// The graphics state, which `AttributeBegin` saves and `AttributeEnd` restores.
#[derive(Clone, Debug, Default)]
pub(super) struct State {
    /// The current transformation matrix: from the current space to world space (before `WorldBegin`, to camera space).
    pub(super) ctm: Ctm,
    pub(super) reversed: bool,
    pub(super) material: MaterialRef,
    pub(super) emission: Option<AreaLight>,
    pub(super) media: Option<Rc<MediaRef>>,
    /// Parameters that `Attribute` adds to directives, for each kind of directive.
    pub(super) attributes: Rc<BTreeMap<&'static str, Vec<Param>>>,
}

/// The current transformation matrix at the start and at the end of the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ctm {
    pub(super) start: DAffine3,
    pub(super) end: DAffine3,
    /// Two flags: directives change the transform at the start; directives change the transform at the end.
    pub(super) active: [bool; 2],
}

impl Default for Ctm {
    fn default() -> Self {
        Self { start: DAffine3::IDENTITY, end: DAffine3::IDENTITY, active: [true, true] }
    }
}

impl Ctm {
    /// Returns the transform at the end of the motion; `None` if it equals [`start`](Self::start).
    pub(super) fn moves_to(&self) -> Option<DAffine3> {
        (self.end != self.start).then_some(self.end)
    }
}

/// The arguments of `AreaLightSource`, for the emission of subsequent shapes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AreaLight {
    /// Radiance, linear RGB, with the parameter `scale` applied.
    pub(super) radiance: [f32; 3],
    pub(super) two_sided: bool,
    /// Total power of each shape, if given. A shape's radiance is then `radiance * power / (pi * area)`, with the area
    /// of both sides if two-sided.
    pub(super) power: Option<f64>,
    /// The image that multiplies the radiance.
    pub(super) texture: Option<TextureId>,
}

/// The names of media in a `MediumInterface`. As in pbrt, names are looked up at the end of the file.
#[derive(Clone, Debug)]
pub(super) struct MediaRef {
    pub(super) inside: Option<String>,
    pub(super) outside: Option<String>,
    pub(super) source: Source,
}

/// The current material: the default, an index, or a name. As in pbrt, names are looked up at the end of the file.
#[derive(Clone, Debug, Default)]
pub(super) enum MaterialRef {
    #[default]
    Default,
    Made(MaterialId),
    Named(Rc<str>, Rc<Source>),
}

/// An open block: its opening directive and the state to restore at its end.
pub(super) struct Block {
    /// The opening directive: `AttributeBegin`, `TransformBegin` or `ObjectBegin`.
    pub(super) begin: &'static str,
    pub(super) source: Source,
    pub(super) saved: State,
}
