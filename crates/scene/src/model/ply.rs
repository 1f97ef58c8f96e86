//! Meshes from PLY files: ASCII, and binary of either byte order [Turk 1994].

use super::{ModelError, ModelMesh, UpAxis, add_mesh, model_scene};
use crate::files::Files;
use crate::polygon;
use crate::readers::{AnyOptions, SceneReader};
use crate::{MeshData, MeshFault, ReadError, Scene};
use glam::dvec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    BeginList, DefaultElement, ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult,
    PropertyType, ScalarType,
};
use std::borrow::Cow;
use std::fmt::Display;
use std::io::BufRead;
use std::path::Path;

/// The [`SceneReader`] of PLY models.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlyReader;

impl SceneReader for PlyReader {
    fn name(&self) -> &'static str {
        "PLY"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["ply"]
    }

    fn recognizes(&self, content: &[u8]) -> bool {
        content.starts_with(b"ply\n") || content.starts_with(b"ply\r")
    }

    fn read(&self, files: &dyn Files, path: &Path, options: &AnyOptions) -> Result<Scene, ReadError> {
        let stage = options.model.stage(UpAxis::Y);
        model_scene(files, path, stage, |scene, bytes, source| {
            add_mesh(scene, read_ply(&bytes)?, source);
            Ok(())
        })
    }
}

/// Reads a mesh from the bytes of a PLY file. Texture coordinates may be called `u v`, `s t`, `texture_u texture_v` or
/// `texture_s texture_t`; other properties and elements are skipped.
///
/// Memory is at most a small multiple of `bytes.len()`, whatever the header declares.
///
/// # Errors
/// Returns the first fault in the file.
pub fn read_ply(bytes: &[u8]) -> Result<ModelMesh, ModelError> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<DefaultElement>::new().read_header(&mut reader).map_err(|e| bad_header(&one_line(&e)))?;
    let left = reader.into_inner();
    check_unique(&bytes[..bytes.len() - left.len()], &header)?;
    let mut payload = Payload { left, encoding: header.encoding, line: String::new() };
    let mut data = MeshData::default();
    let (mut has_positions, mut faces) = (false, None);
    for def in header.elements.values() {
        payload.check_length(def)?;
        match def.name.as_str() {
            "vertex" => {
                has_positions = ["x", "y", "z"].iter().all(|name| def.properties.contains_key(*name));
                read_vertices(&mut payload, def, &mut data)?;
            }
            "face" => faces = Some(read_faces(&mut payload, def)?),
            _ => (0..def.count).try_for_each(|i| payload.read::<Skipped>(def, i).map(|_| ()))?,
        }
    }
    if !has_positions {
        return Err(ModelError::new("there is no element vertex with properties x, y and z; export positions too"));
    }
    let faces = faces.ok_or_else(no_faces)?;
    if let Some(vertex) = data.positions.iter().position(|p| !p.is_finite()) {
        return Err(MeshFault::Position { vertex }.into());
    }
    cut(&faces, &mut data)?;
    let mended = data.mend_normals();
    let mended = mended.map(|count| format!("{count} normals are not finite; the faces' own stand for them"));
    data.check()?;
    let cut_line = header.encoding == Encoding::Ascii && !bytes.ends_with(b"\n");
    let cut =
        cut_line.then(|| "the last line has no line break; if the file was cut off, a number may be wrong".into());
    let doubts = mended.into_iter().chain(cut).collect::<Vec<String>>().join("; ");
    Ok(ModelMesh { data, doubt: (!doubts.is_empty()).then_some(doubts) })
}

/// Refuses a header that declares a name twice: the parser would keep one of the two and misread the data.
fn check_unique(text: &[u8], header: &Header) -> Result<(), ModelError> {
    let lines = |word: &[u8]| text.split(|&b| b == b'\n').filter(|line| line.starts_with(word)).count();
    let properties: usize = header.elements.values().map(|def| def.properties.len()).sum();
    if lines(b"element") == header.elements.len() && lines(b"property") == properties {
        return Ok(());
    }
    Err(bad_header("an element or property is declared twice"))
}

fn bad_header(what: &str) -> ModelError {
    ModelError::new(format!("the PLY header cannot be read ({what}); export the mesh anew"))
}

fn no_faces() -> ModelError {
    ModelError::new("there is no element face with a list vertex_indices; export triangles")
}

fn bad_face(face: usize, what: impl Display) -> ModelError {
    ModelError::new(format!("face {face}: {what}"))
}

fn one_line(e: &ParseError) -> String {
    let text = e.to_string();
    let words: Vec<&str> = text.split_whitespace().collect();
    let text = words.join(" ");
    match text.char_indices().nth(200) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

/// The unread bytes after the header, which hold the elements.
struct Payload<'b> {
    left: &'b [u8],
    encoding: Encoding,
    line: String,
}

impl Payload<'_> {
    /// Refuses an element count that the remaining bytes cannot hold, before memory is allocated.
    fn check_length(&self, def: &ElementDef) -> Result<(), ModelError> {
        let size = |ty: &PropertyType| match (self.encoding, ty) {
            // The shortest number in ASCII: a digit and a space.
            (Encoding::Ascii, _) => 2,
            (_, PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) => bytes_of(scalar),
        };
        let least: usize = def.properties.values().map(|p| size(&p.data_type)).sum();
        // The last line may lack its line break.
        let bytes = self.left.len();
        let fits = least > 0 && def.count.checked_mul(least).is_some_and(|total| total <= bytes + 1);
        if fits || def.count == 0 {
            return Ok(());
        }
        let (name, count) = (&def.name, def.count);
        Err(ModelError::new(format!(
            "the header promises {count} elements {name}, and only {bytes} bytes follow; the file is cut off or damaged"
        )))
    }

    fn read<E: PropertyAccess>(&mut self, def: &ElementDef, index: usize) -> Result<E, ModelError> {
        let parser = Parser::<E>::new();
        let result = match self.encoding {
            Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut self.left, def),
            Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut self.left, def),
            Encoding::Ascii => {
                self.line.clear();
                match self.left.read_line(&mut self.line) {
                    Ok(_) => parser.read_ascii_element(&spelled_out(&self.line), def),
                    Err(e) => Err(e.into()),
                }
            }
        };
        result.map_err(|e| {
            let (name, what) = (&def.name, one_line(&e));
            ModelError::new(format!("{name} {index} cannot be read ({what}); the file is cut off or damaged"))
        })
    }
}

/// A line of numbers in which `nan` and `inf`, which the parser doesn't know, are numbers too large for a float.
fn spelled_out(line: &str) -> Cow<'_, str> {
    let finite = |byte: u8| !matches!(byte, b'n' | b'N');
    if line.bytes().all(finite) {
        return Cow::Borrowed(line);
    }
    let plain = |word: &str| word.trim_start_matches(['-', '+']).to_ascii_lowercase();
    let word = |word| match plain(word).as_str() {
        "nan" | "inf" | "infinity" | "nan(ind)" => "1e999",
        _ => word,
    };
    // The parser needs the line break.
    let words: Vec<&str> = line.split_whitespace().map(word).collect();
    Cow::Owned(words.join(" ") + "\n")
}

fn bytes_of(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

fn scalar(property: &Property) -> Option<f64> {
    Some(match property {
        Property::Char(v) => f64::from(*v),
        Property::UChar(v) => f64::from(*v),
        Property::Short(v) => f64::from(*v),
        Property::UShort(v) => f64::from(*v),
        Property::Int(v) => f64::from(*v),
        Property::UInt(v) => f64::from(*v),
        Property::Float(v) => f64::from(*v),
        Property::Double(v) => *v,
        _ => return None,
    })
}

struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

/// The values of one vertex in a PLY file: x, y, z, nx, ny, nz, u, v.
struct Vertex([f64; 8]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self([0.0; 8])
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set_double(name, f64::from(value))
    }

    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        match slot(name) {
            Some(slot) => self.0[slot] = value,
            None => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match (slot(name), scalar(&property)) {
            (Some(_), Some(value)) => self.set_double(name, value),
            (Some(_), None) => PropertyAccessResult::UnsupportedType,
            (None, _) => PropertyAccessResult::Ignored,
        }
    }
}

fn slot(name: &str) -> Option<usize> {
    Some(match name {
        "x" => 0,
        "y" => 1,
        "z" => 2,
        "nx" => 3,
        "ny" => 4,
        "nz" => 5,
        "u" | "s" | "texture_u" | "texture_s" => 6,
        "v" | "t" | "texture_v" | "texture_t" => 7,
        _ => return None,
    })
}

fn read_vertices(payload: &mut Payload<'_>, def: &ElementDef, data: &mut MeshData) -> Result<(), ModelError> {
    let has = |names: &[&str]| names.iter().all(|name| def.properties.contains_key(*name));
    let pairs = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];
    let (normals, uvs) = (has(&["nx", "ny", "nz"]), pairs.iter().any(|pair| has(pair)));
    data.positions.reserve_exact(def.count);
    data.normals.reserve_exact(if normals { def.count } else { 0 });
    data.uvs.reserve_exact(if uvs { def.count } else { 0 });
    for i in 0..def.count {
        let Vertex([x, y, z, nx, ny, nz, u, v]) = payload.read(def, i)?;
        data.positions.push(dvec3(x, y, z));
        if normals {
            data.normals.push([nx as f32, ny as f32, nz as f32]);
        }
        if uvs {
            data.uvs.push([u as f32, v as f32]);
        }
    }
    Ok(())
}

/// The vertex indices of one polygon. The file's type of integer decides which list holds them.
#[derive(Default)]
struct Face {
    signed: Vec<i32>,
    unsigned: Vec<u32>,
}

fn is_corners(name: &str) -> bool {
    matches!(name, "vertex_indices" | "vertex_index")
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn begin_list_int(&mut self, name: &str, _: usize) -> BeginList<'_, i32> {
        if is_corners(name) { BeginList::Fill(&mut self.signed) } else { BeginList::UseSetter }
    }

    fn begin_list_uint(&mut self, name: &str, _: usize) -> BeginList<'_, u32> {
        if is_corners(name) { BeginList::Fill(&mut self.unsigned) } else { BeginList::UseSetter }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !is_corners(name) {
            return PropertyAccessResult::Ignored;
        }
        match property.to_u32_list() {
            Some(list) => self.unsigned = list,
            None => return PropertyAccessResult::UnsupportedType,
        }
        PropertyAccessResult::Set
    }
}

/// The vertex indices of all polygons in one list, and the end of each polygon in that list.
#[derive(Default)]
struct Faces {
    corners: Vec<u32>,
    ends: Vec<usize>,
}

fn read_faces(payload: &mut Payload<'_>, def: &ElementDef) -> Result<Faces, ModelError> {
    if !def.properties.values().any(|p| is_corners(&p.name) && matches!(p.data_type, PropertyType::List(..))) {
        return Err(no_faces());
    }
    let mut faces = Faces::default();
    for face in 0..def.count {
        let Face { signed, unsigned } = payload.read(def, face)?;
        faces.corners.extend(unsigned);
        for corner in signed {
            let negative = |_| bad_face(face, format!("corner {corner} is negative; corners count vertices from 0"));
            let corner = u32::try_from(corner).map_err(negative)?;
            faces.corners.push(corner);
        }
        faces.ends.push(faces.corners.len());
    }
    Ok(faces)
}

/// Cuts all polygons into triangles and appends the triangles to `data`.
fn cut(faces: &Faces, data: &mut MeshData) -> Result<(), ModelError> {
    let vertices = data.positions.len();
    data.triangles.reserve(faces.corners.len().saturating_sub(2 * faces.ends.len()));
    let mut start = 0;
    for (face, &end) in faces.ends.iter().enumerate() {
        let corners = &faces.corners[start..end];
        start = end;
        if let Some(corner) = corners.iter().find(|&&c| c as usize >= vertices) {
            let what = format!("corner {corner} is beyond the last of {vertices} vertices, which count from 0");
            return Err(bad_face(face, what));
        }
        if corners.len() < 3 {
            let what = format!("a face needs 3 corners or more, not {}; remove it", corners.len());
            return Err(bad_face(face, what));
        }
        polygon::triangulate(corners, &data.positions, &mut data.triangles).map_err(|what| bad_face(face, what))?;
    }
    Ok(())
}
