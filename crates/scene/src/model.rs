//! Models by themselves: OBJ, PLY and STL files as scenes, under a camera and a light of our own.
//!
//! [`read_model`] gives a [`Scene`] that can be rendered as it stands: the meshes of the file in grey (or as an
//! OBJ file's materials say: `Kd` and `map_Kd`), smooth only where the file has normals; a camera that sees all
//! of it from the front, the right and above; an environment, brighter above than below, with a round lamp over
//! the viewer's left shoulder. What a file says beyond that is listed in [`Scene::notices`].
//!
//! The y axis points up in OBJ and PLY files and the z axis in STL files, as most programs write them; neither
//! format says. [`ModelOptions::up`] overrules that.

mod mtl;
mod obj;
mod stage;
mod stl;

pub use obj::{ObjError, ObjMesh, ObjModel, read_obj};
pub use stl::{StlError, StlMesh, read_stl};

use crate::files::{Disk, Files};
use crate::image::{Encoding, Image, read_image};
use crate::pbrt::{Problem, ReadError};
use crate::ply::read_ply;
use crate::{
    Color, Geometry, Material, MaterialId, MaterialKind, MeshData, Notice, Scene, Shape, Source, Texture, TextureId,
    TextureKind, Wrap,
};
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The axis that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// +y; the front is where +z points.
    Y,
    /// +z; the front is where -y points.
    Z,
}

impl UpAxis {
    /// The directions to the front, to the right of one who looks from there, and up.
    fn axes(self) -> (DVec3, DVec3, DVec3) {
        match self {
            Self::Y => (DVec3::Z, DVec3::X, DVec3::Y),
            Self::Z => (DVec3::NEG_Y, DVec3::X, DVec3::Z),
        }
    }
}

/// How a model is shown.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct ModelOptions {
    /// The axis that points up; `None` is y for OBJ and PLY and z for STL.
    pub up: Option<UpAxis>,
}

impl ModelOptions {
    /// These options with [`up`](Self::up) as said.
    pub fn with_up(mut self, up: UpAxis) -> Self {
        self.up = Some(up);
        self
    }
}

/// A format of models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ModelFormat {
    /// Wavefront OBJ, with materials in MTL files.
    Obj,
    /// PLY [Turk 1994], ascii or binary.
    Ply,
    /// STL, text or binary.
    Stl,
}

impl ModelFormat {
    /// The format that a file's extension stands for, whatever its case; `None` for any other file.
    pub fn from_path(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "obj" => Self::Obj,
            "ply" => Self::Ply,
            "stl" => Self::Stl,
            _ => return None,
        })
    }
}

/// Reads a model from disk, with the default [`ModelOptions`].
///
/// # Errors
/// What is wrong with it, naming file and line or element.
pub fn read_model(path: impl AsRef<Path>) -> Result<Scene, ReadError> {
    read_model_from(&Disk, path, &ModelOptions::default())
}

/// Reads a model from `files`; its extension tells the format. An OBJ file's materials and textures are looked
/// for relative to the folder of the file that names them.
///
/// # Errors
/// What is wrong with it, naming file and line or element. Materials and textures that are missing or cannot be
/// read are notices only.
pub fn read_model_from(
    files: &(impl Files + ?Sized),
    path: impl AsRef<Path>,
    options: &ModelOptions,
) -> Result<Scene, ReadError> {
    let path = path.as_ref();
    let source = Source { file: Arc::new(path.to_owned()), line: 0 };
    let refuse = |line: u32, message: String| ReadError {
        problems: vec![Problem { source: Source { line, ..source.clone() }, message }],
        more: 0,
    };
    let Some(format) = ModelFormat::from_path(path) else {
        return Err(refuse(0, "the extension tells a model's format, and it is none of .obj, .ply, .stl".into()));
    };
    let bytes = files.read(path).map_err(|e| {
        refuse(0, format!("cannot read {}: {e}; check the name and that the file is there", path.display()))
    })?;
    if let Some(advice) = compressed(&bytes) {
        return Err(refuse(0, advice.into()));
    }
    let mut scene = Scene { name: stem(path), ..Scene::default() };
    match format {
        ModelFormat::Obj => {
            let model = read_obj(&bytes).map_err(|e| match e {
                ObjError::Line { line, what } => refuse(line, what),
                other => refuse(0, other.to_string()),
            })?;
            drop(bytes);
            add_obj(&mut scene, model, &|path| files.read(path), &source);
        }
        ModelFormat::Ply => {
            let mesh = read_ply(&bytes).map_err(|e| refuse(0, e.to_string()))?;
            add_mesh(&mut scene, mesh.data, mesh.doubt.map(str::to_owned), &source);
        }
        ModelFormat::Stl => {
            let mesh = read_stl(&bytes).map_err(|e| match e {
                StlError::Line { line, what } => refuse(line, what),
                other => refuse(0, other.to_string()),
            })?;
            add_mesh(&mut scene, mesh.data, mesh.doubt, &source);
        }
    }
    let up = options.up.unwrap_or(if format == ModelFormat::Stl { UpAxis::Z } else { UpAxis::Y });
    let meshes: Vec<Arc<MeshData>> = scene.shapes.iter().filter_map(mesh_of).collect();
    let corners =
        meshes.iter().flat_map(|mesh| mesh.triangles.iter().flatten().map(|&corner| mesh.positions[corner as usize]));
    stage::set(&mut scene, corners, up, &source).map_err(|what| refuse(0, what.into()))?;
    Ok(scene)
}

/// What to say of a file that begins like a packed one.
pub(crate) fn compressed(bytes: &[u8]) -> Option<&'static str> {
    let starts = |magic: &[u8]| bytes.starts_with(magic);
    if starts(&[0x1f, 0x8b]) {
        Some("the file is compressed by gzip: unpack it first (gunzip)")
    } else if starts(&[0x28, 0xb5, 0x2f, 0xfd]) {
        Some("the file is compressed by zstd: unpack it first (unzstd)")
    } else if starts(b"BZh") || starts(&[0xfd, b'7', b'z', b'X', b'Z', 0]) || starts(b"PK\x03\x04") {
        Some("the file is compressed: unpack it first")
    } else {
        None
    }
}

pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "model".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

fn mesh_of(shape: &Shape) -> Option<Arc<MeshData>> {
    match &shape.geometry {
        Geometry::Mesh(mesh) => Some(mesh.clone()),
        _ => None,
    }
}

/// Share of light that a surface reflects where nothing says otherwise.
const GREY: Color = Color::Constant([0.5; 3]);

fn add_material(scene: &mut Scene, name: &str, reflectance: Color, source: &Source) -> MaterialId {
    let id = MaterialId(scene.materials.len() as u32);
    scene.materials.push(Material::new(name, MaterialKind::Diffuse { reflectance }, source.clone()));
    id
}

/// A file's only mesh, in grey.
fn add_mesh(scene: &mut Scene, data: MeshData, doubt: Option<String>, source: &Source) {
    let material = add_material(scene, "grey", GREY, source);
    let geometry = Geometry::Mesh(Arc::new(data));
    scene.shapes.push(Shape::new(geometry, DAffine3::IDENTITY, material, source.clone()));
    scene.notices.extend(doubt.map(|message| Notice { source: source.clone(), message }));
}

/// Something that reads files.
type Read<'f> = &'f dyn Fn(&Path) -> std::io::Result<Vec<u8>>;

fn add_obj(scene: &mut Scene, model: ObjModel, files: Read<'_>, source: &Source) {
    let mut materials = Materials::default();
    for (word, line) in model.left_out {
        let source = Source { line, ..source.clone() };
        scene.notices.push(Notice { source, message: format!("`{word}` is no surface: left out") });
    }
    for (name, line) in model.libraries {
        materials.open(scene, &name, files, &Source { line, ..source.clone() });
    }
    for mesh in model.meshes {
        let material = materials.of(scene, mesh.material.as_ref(), files, source);
        let geometry = Geometry::Mesh(Arc::new(mesh.data));
        scene.shapes.push(Shape::new(geometry, DAffine3::IDENTITY, material, source.clone()));
    }
}

/// The materials of an OBJ file: those that libraries hold, and those that were asked for.
#[derive(Default)]
struct Materials {
    /// By name, each with its library's path.
    known: BTreeMap<String, (mtl::Material, Arc<PathBuf>)>,
    made: BTreeMap<Option<String>, MaterialId>,
    images: BTreeMap<PathBuf, Option<Arc<Image>>>,
}

impl Materials {
    fn open(&mut self, scene: &mut Scene, name: &str, files: Read<'_>, source: &Source) {
        let path = beside(&source.file, name);
        let bytes = match files(&path) {
            Ok(bytes) => bytes,
            Err(e) => {
                let message = format!("the materials of {} cannot be read ({e}): grey instead", path.display());
                scene.notices.push(Notice { source: source.clone(), message });
                return;
            }
        };
        let library = mtl::read_mtl(&bytes);
        let file = Arc::new(path);
        let notices = library.notices.into_iter();
        scene
            .notices
            .extend(notices.map(|(line, message)| Notice { source: Source { file: file.clone(), line }, message }));
        for (name, material) in library.materials {
            self.known.insert(name, (material, file.clone()));
        }
    }

    /// The material that the meshes with this `usemtl` have.
    fn of(&mut self, scene: &mut Scene, asked: Option<&(String, u32)>, files: Read<'_>, source: &Source) -> MaterialId {
        let name = asked.map(|(name, _)| name.clone());
        if let Some(id) = self.made.get(&name) {
            return *id;
        }
        let id = match asked {
            None => add_material(scene, "grey", GREY, source),
            Some((name, line)) => match self.known.get(name).cloned() {
                Some((material, file)) => {
                    let source = Source { line: material.line, file };
                    let color = self.color(scene, &material, files, &source);
                    add_material(scene, name, color, &source)
                }
                None => {
                    let source = Source { line: *line, ..source.clone() };
                    let message = format!("there is no material '{name}': grey instead");
                    scene.notices.push(Notice { source: source.clone(), message });
                    add_material(scene, name, GREY, &source)
                }
            },
        };
        self.made.insert(name, id);
        id
    }

    fn color(&mut self, scene: &mut Scene, material: &mtl::Material, files: Read<'_>, source: &Source) -> Color {
        let flat = material.diffuse.map_or(GREY, Color::Constant);
        let Some(name) = &material.texture else { return flat };
        let Some(image) = self.image(scene, name, files, source) else { return flat };
        // Kd multiplies the image; without one, or black as some programs write it, the image stands alone.
        let tint = material.diffuse.filter(|c| *c != [0.0; 3]).unwrap_or([1.0; 3]);
        let even = tint[0] == tint[1] && tint[1] == tint[2];
        let (scale, shift, factor) = ([1.0; 2], [0.0; 2], if even { tint[0] } else { 1.0 });
        let image = TextureKind::Image { image, scale, shift, factor, invert: false, wrap: Wrap::Repeat };
        let image = add_texture(scene, name, image, source);
        if even {
            return image;
        }
        add_texture(scene, name, TextureKind::Product { factors: [Color::Constant(tint), image] }, source)
    }

    /// An image, if it can be had; each file is read once.
    fn image(&mut self, scene: &mut Scene, name: &str, files: Read<'_>, source: &Source) -> Option<Arc<Image>> {
        let path = beside(&source.file, name);
        if let Some(known) = self.images.get(&path) {
            return known.clone();
        }
        let bytes = files(&path).map_err(|e| format!("{}: {e}", path.display()));
        let read = |bytes: Vec<u8>| {
            let name = path.display().to_string();
            let image = read_image(&bytes, &name, Encoding::Auto).and_then(|p| p.checked_finite(&name));
            image.map_err(|e| e.to_string())
        };
        let image = match bytes.and_then(read) {
            Ok(image) => Some(Arc::new(image)),
            Err(e) => {
                let message = format!("the texture cannot be read, Kd stands for it: {e}");
                scene.notices.push(Notice { source: source.clone(), message });
                None
            }
        };
        self.images.insert(path, image.clone());
        image
    }
}

fn add_texture(scene: &mut Scene, name: &str, kind: TextureKind, source: &Source) -> Color {
    let id = TextureId(scene.textures.len() as u32);
    scene.textures.push(Texture { name: name.to_owned(), kind, source: source.clone() });
    Color::Texture(id)
}

/// The path of a file that `file` names; backslashes are Windows' way to write it.
fn beside(file: &Path, name: &str) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).join(name.replace('\\', "/"))
}
