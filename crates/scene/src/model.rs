//! Readers of models: OBJ, PLY and STL files as scenes, with a default camera and a default light.
//!
//! [`read_any`](crate::read_any) returns a [`Scene`] that can be rendered without edits. It holds:
//! * the meshes of the file in grey (or in an OBJ file's materials: `Kd` and `map_Kd`), multiplied by the colours of vertices
//!   or facets, which are in sRGB; shading is smooth only if the file has normals;
//! * a camera that sees the whole model from the front, the right and above, or from its open side;
//! * a ground on which the model stands;
//! * an environment map, brighter above than below, with a round light over the viewer's left shoulder.
//!
//! Unsupported parts of the file are listed in [`Scene::notices`].
//!
//! The y axis points up in OBJ and PLY files and the z axis in STL files, as most programs write them; no format
//! records it. [`ModelOptions::up`] overrides this.

mod colors;
mod mtl;
mod obj;
mod ply;
mod stl;
pub(crate) mod studio;

pub(crate) use obj::OBJ;
pub use obj::{ObjMesh, ObjModel, read_obj};
pub(crate) use ply::PLY;
pub use ply::read_ply;
pub(crate) use stl::STL;
pub use stl::read_stl;

pub use crate::scene_reader::{ModelOptions, UpAxis};

use crate::files::Files;
use crate::scene_reader::{ReadError, unreadable};
use crate::{Color, Geometry, Material, MaterialId, MaterialKind, MeshData, MeshFault, Scene, Shape, Source, text};
use glam::DAffine3;
use std::path::Path;
use std::sync::Arc;

/// A mesh from a model file, as [`read_ply`] and [`read_stl`] return it.
#[derive(Clone, Debug)]
pub struct ModelMesh {
    /// The mesh, with polygons cut into triangles.
    pub data: MeshData,
    /// A reason to suspect that the file is damaged or incomplete; `None` if it seems intact.
    pub doubt: Option<String>,
    /// Parts of the file that are not read, such as `property confidence of vertex`.
    pub left_out: Vec<String>,
}

/// The error of a model file. Indices of elements, facets and faces in its message count from 0.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{what}", line.map_or(String::new(), |line| format!("line {line}: ")))]
#[non_exhaustive]
pub struct ModelError {
    /// The number of the line, from 1; `None` for errors that have no line, such as those in binary data.
    pub line: Option<u32>,
    /// A description of the error, with its remedy.
    pub what: String,
}

impl ModelError {
    pub(crate) fn at(line: u32, what: impl Into<String>) -> Self {
        Self { line: Some(line), what: what.into() }
    }
}

impl From<MeshFault> for ModelError {
    fn from(fault: MeshFault) -> Self {
        fault.to_string().into()
    }
}

impl<T: Into<String>> From<T> for ModelError {
    fn from(what: T) -> Self {
        Self { line: None, what: what.into() }
    }
}

/// Reads a file as a scene. `add` parses the file's bytes and adds its contents to the scene.
pub(crate) fn scene_of(
    files: &dyn Files,
    path: &Path,
    add: impl FnOnce(&mut Scene, Vec<u8>, &Source) -> Result<(), ModelError>,
) -> Result<Scene, ReadError> {
    let source = Source { file: Arc::new(path.to_owned()), line: 0 };
    let bytes = files.read(path).map_err(|e| unreadable(source.clone(), &e))?;
    let name = text::file_stem(path).unwrap_or_else(|| "model".to_owned());
    let mut scene = Scene { name, ..Scene::default() };
    add(&mut scene, bytes, &source)
        .map_err(|e| ReadError::invalid(Source { line: e.line.unwrap_or(0), ..source }, e.what))?;
    Ok(scene)
}

/// Reads a model file as a scene with a default camera and light. `add` parses the file's bytes and adds the meshes to
/// the scene.
fn model_scene(
    files: &dyn Files,
    path: &Path,
    stage: studio::Stage,
    add: impl FnOnce(&mut Scene, Vec<u8>, &Source) -> Result<(), ModelError>,
) -> Result<Scene, ReadError> {
    scene_of(files, path, |scene, bytes, source| {
        add(scene, bytes, source)?;
        let bare = studio::Wanted { camera: true, sky: true, ground: true };
        Ok(studio::set(scene, stage, bare, source)?)
    })
}

/// Reflectance of surfaces without a material: 0.5.
const GREY: Color = Color::Constant([0.5; 3]);

/// Adds a diffuse material. Vertex colours multiply its reflectance, or replace the default grey.
fn add_material(
    scene: &mut Scene,
    name: &str,
    reflectance: Option<Color>,
    is_colored: bool,
    source: &Source,
) -> MaterialId {
    let reflectance = match is_colored {
        true => scene.vertex_color(reflectance.unwrap_or(Color::Constant([1.0; 3])), source),
        false => reflectance.unwrap_or(GREY),
    };
    scene.add_material(Material::new(name, MaterialKind::Diffuse { reflectance }, source.clone()))
}

/// The notice of a textured mesh without texture coordinates. `set` names the missing set.
pub(crate) fn no_uvs(set: &str) -> String {
    format!("it has textures but no texture coordinates{set}; every triangle shows the same piece of the textures")
}

/// Reads a file of one mesh as a scene, in its own colours or the default grey. Doubts about the file, and left-out
/// properties, become warnings.
fn mesh_scene(
    files: &dyn Files,
    path: &Path,
    stage: studio::Stage,
    read: fn(&[u8]) -> Result<ModelMesh, ModelError>,
) -> Result<Scene, ReadError> {
    model_scene(files, path, stage, |scene, bytes, source| {
        let mesh = read(&bytes)?;
        let material = add_material(scene, "grey", None, !mesh.data.colors.is_empty(), source);
        let geometry = Geometry::Mesh(Arc::new(mesh.data));
        scene.shapes.push(Shape::new(geometry, DAffine3::IDENTITY, material, source.clone()));
        let left_out = (!mesh.left_out.is_empty()).then(|| format!("left out: {}", mesh.left_out.join(", ")));
        mesh.doubt.into_iter().chain(left_out).for_each(|message| scene.warn(source, message));
        Ok(())
    })
}
