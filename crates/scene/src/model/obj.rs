//! Meshes from OBJ files.
//!
//! This parser uses no library. `tobj` reports errors without lines, and panics or reads wrong numbers for some malformed
//! files. It supports neither continued lines nor faces that mix corners with and without texture coordinates.

use super::mtl::Materials;
use super::{ModelError, UpAxis, colors, model_scene, no_uvs};
use crate::files::Files;
use crate::polygon;
use crate::scene_reader::SceneReader;
use crate::text::{self, first_word};
use crate::{Geometry, MeshData, Scene, Shape, Source};
use glam::{DAffine3, DVec3};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// The reader of OBJ models.
pub(crate) const OBJ: SceneReader = SceneReader {
    name: "OBJ",
    extensions: &["obj"],
    recognizes: |content| {
        const WORDS: [&[u8]; 10] = [b"v", b"vn", b"vt", b"vp", b"f", b"o", b"g", b"s", b"mtllib", b"usemtl"];
        first_word(content).is_some_and(|word| WORDS.contains(&word))
    },
    read: |files, path, options| {
        model_scene(files, path, options.model.stage(UpAxis::Y), |scene, bytes, source| {
            let model = read_obj(&bytes)?;
            drop(bytes);
            add_model(scene, model, files, source);
            Ok(())
        })
    },
};

/// Adds the shapes and materials of an OBJ file to a scene, and notices on unsupported statements.
fn add_model(scene: &mut Scene, model: ObjModel, files: &dyn Files, source: &Source) {
    let mut materials = Materials::default();
    for (message, line) in model.notices {
        scene.warn(&Source { line, ..source.clone() }, message);
    }
    for (argument, line) in model.libraries {
        materials.open(scene, &argument, files, &Source { line, ..source.clone() });
    }
    for mesh in model.meshes {
        let material = materials.of(scene, (mesh.material.as_ref(), !mesh.data.colors.is_empty()), files, source);
        if mesh.data.uvs.is_empty() && materials.is_textured(mesh.material.as_ref()) {
            let (name, line) = mesh.material.unwrap_or_default();
            scene.warn(&Source { line, ..source.clone() }, format!("the mesh of {name:?}: {}", no_uvs("")));
        }
        let geometry = Geometry::Mesh(Arc::new(mesh.data));
        scene.shapes.push(Shape::new(geometry, DAffine3::IDENTITY, material, source.clone()));
    }
}

/// The contents of an OBJ file.
#[derive(Clone, Debug, Default)]
pub struct ObjModel {
    /// The meshes, one for each combination of material and vertex attributes (normals, texture coordinates).
    pub meshes: Vec<ObjMesh>,
    /// The argument and the line of each `mtllib` statement. An argument names one or several material files (MTL).
    pub libraries: Vec<(String, u32)>,
    /// Notices of left out or corrected statements, with the line of the first statement concerned; 0 means the whole file.
    pub notices: Vec<(String, u32)>,
}

/// The faces of an OBJ file that share one material and the same vertex attributes.
#[derive(Clone, Debug)]
pub struct ObjMesh {
    /// Name of the material and line of its first use; `None` for faces before the first `usemtl`.
    pub material: Option<(String, u32)>,
    /// The mesh, with polygons cut into triangles.
    pub data: MeshData,
}

/// Reads the meshes of an OBJ file.
///
/// Negative indices count back from the last vertex read so far. Polygons become triangles. Colours of vertices (`v x y z r g
/// b`) are in sRGB. In a mesh with colours, a vertex without a colour is white. Names may be in UTF-8 or Latin-1.
///
/// # Errors
/// Returns the first fault in the file.
pub fn read_obj(bytes: &[u8]) -> Result<ObjModel, ModelError> {
    let text = text::decode(bytes)?;
    let mut parser = Parser::default();
    for (line, statement) in statements(&text) {
        parser.line(line, &statement).map_err(|what| ModelError::at(line, what))?;
    }
    parser.check_ranges()?;
    let clamped = colors::decode(&mut parser.vertices.colors);
    parser.notices.extend(clamped.map(|message| (message, 0)));
    let Parser { vertices, groups, libraries, notices, .. } = parser;
    let mut meshes = Vec::with_capacity(groups.len());
    for (key, group) in groups {
        let data = vertices.mesh(&group, key.has)?;
        meshes.push(ObjMesh { material: key.material.map(|(line, name)| (name, line)), data });
    }
    if meshes.is_empty() {
        return Err("there are no faces; export faces, not points or curves".into());
    }
    Ok(ObjModel { meshes, libraries, notices })
}

/// Keywords of statements whose argument is a name. A backslash at its end does not continue the line.
const NAMES: [&str; 6] = ["o", "g", "usemtl", "mtllib", "newmtl", "map_Kd"];

/// The statements of an OBJ or MTL text, each with its line. A backslash at the end of a line joins it with the next line.
pub(super) fn statements(text: &str) -> impl Iterator<Item = (u32, String)> {
    let mut lines = (1..).zip(text.lines());
    std::iter::from_fn(move || {
        let (first, mut line) = lines.next()?;
        let mut joined = String::new();
        let is_name = NAMES.contains(&line.split_whitespace().next().unwrap_or(""));
        // A backslash within a comment continues nothing.
        while let Some(part) = line.trim_end().strip_suffix('\\').filter(|part| !is_name && !part.contains('#')) {
            joined.extend([part, " "]);
            line = lines.next().map_or("", |(_, line)| line);
        }
        joined.push_str(line);
        Some((first, joined))
    })
}

/// Positions, texture coordinates and normals of the whole OBJ file.
#[derive(Debug, Default)]
struct Vertices {
    positions: Vec<DVec3>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    /// The colours of the positions, up to the last position with a colour; NaN for positions without one.
    colors: Vec<[f32; 3]>,
}

impl Vertices {
    /// Returns the number of positions, of texture coordinates and of normals, in the order of [`KINDS`].
    fn counts(&self) -> [u64; 3] {
        [self.positions.len(), self.uvs.len(), self.normals.len()].map(|n| n as u64)
    }

    /// Returns the mesh of a group of faces, with one vertex for each distinct corner, in the order of first use.
    fn mesh(&self, group: &Group, [has_uv, has_normal]: [bool; 2]) -> Result<MeshData, ModelError> {
        let mut data = MeshData::default();
        let mut known: HashMap<Corner, u32> = HashMap::new();
        let mut polygon = Vec::new();
        let mut start = 0;
        for &(line, end) in &group.faces {
            polygon.clear();
            for &corner in &group.corners[start..end] {
                let next = known.len() as u32;
                polygon.push(*known.entry(corner).or_insert_with(|| {
                    // Faces may precede their vertices. `check_ranges` has checked these indices, which count from 1.
                    let [position, uv, normal] = corner.map(|number| number.map_or(0, |n| n as usize - 1));
                    data.positions.push(self.positions[position]);
                    if has_uv {
                        data.uvs.push(self.uvs[uv]);
                    }
                    if has_normal {
                        data.normals.push(self.normals[normal]);
                    }
                    data.colors.extend(self.colors.get(position).or((!self.colors.is_empty()).then_some(&NO_COLOR)));
                    next
                }));
            }
            start = end;
            polygon::triangulate(&polygon, &data.positions, &mut data.triangles)
                .map_err(|what| ModelError::at(line, what))?;
        }
        if data.colors.iter().all(|color| color[0].is_nan()) {
            data.colors = Vec::new();
        }
        data.mend_colors();
        data.check()?;
        Ok(data)
    }
}

/// The value that marks a vertex without a colour, which is shown white.
const NO_COLOR: [f32; 3] = [f32::NAN; 3];

/// The key of a group of faces: material and vertex attributes. Keys sort by the material's first use.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    material: Option<(u32, String)>,
    /// Two flags: all corners have texture coordinates; all corners have normals.
    has: [bool; 2],
}

/// Indices of a corner's position, texture coordinates and normal, from 1; `None` for an absent one.
type Corner = [Option<u64>; 3];

/// The faces of an OBJ file that share one [`Key`].
#[derive(Debug, Default)]
struct Group {
    corners: Vec<Corner>,
    /// The line of each face, and the end of its corners within `corners`.
    faces: Vec<(u32, usize)>,
}

const KINDS: [&str; 3] = ["vertices", "texture coordinates", "normals"];

/// The state of the OBJ parser: everything read so far.
#[derive(Default)]
struct Parser {
    vertices: Vertices,
    /// For each of [`KINDS`], the largest index used before its definition, and the line of that use.
    largest: [(u64, u32); 3],
    groups: BTreeMap<Key, Group>,
    key: Key,
    materials: BTreeMap<String, u32>,
    libraries: Vec<(String, u32)>,
    notices: Vec<(String, u32)>,
    /// True within a smoothing group.
    smooths: bool,
}

/// Statements that are left out, and why.
const LEFT_OUT: [(&str, &str); 6] = [
    ("l p", "is not a surface"),
    (
        "vp cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con mg ctech stech bsp bzp cdc cdp res",
        "belongs to curves and curved surfaces; export triangles",
    ),
    ("call csh", "runs other files"),
    ("maplib usemap", "is a texture outside of an MTL file"),
    ("bevel c_interp d_interp lod shadow_obj trace_obj", "controls how other renderers show the model"),
    ("#MRGB", "holds colours in ZBrush's own form; export colours as numbers after each position"),
];
/// The largest number of kinds of statements that are reported as left out.
const MOST_LEFT_OUT: usize = 12;

impl Parser {
    fn line(&mut self, number: u32, line: &str) -> Result<(), String> {
        // A comment may follow anything but a name.
        let words = || line.split('#').next().unwrap_or("").split_whitespace().skip(1);
        let Some(keyword) = line.split_whitespace().next() else { return Ok(()) };
        let argument = line.trim_start()[keyword.len()..].trim();
        match keyword {
            "v" => self.vertex(number, words()),
            // A texture of one dimension has one coordinate.
            "vt" => self.finite("vt", number, words().chain(["0"])).map(|uv| self.vertices.uvs.push(uv)),
            "vn" => self.finite("vn", number, words()).map(|n| self.vertices.normals.push(n)),
            "f" | "fo" => self.face(number, words()),
            "usemtl" => {
                let name = text::name(argument);
                self.key.material = (!name.is_empty()).then(|| {
                    let line = *self.materials.entry(name.to_owned()).or_insert(number);
                    (line, name.to_owned())
                });
                Ok(())
            }
            "mtllib" => {
                let libraries = &mut self.libraries;
                if !argument.is_empty() && !libraries.iter().any(|(known, _)| known == argument) {
                    libraries.push((argument.to_owned(), number));
                }
                Ok(())
            }
            "s" => {
                self.smooths = !matches!(words().next(), None | Some("off" | "0"));
                Ok(())
            }
            // Names of objects and groups change nothing.
            "o" | "g" => Ok(()),
            comment if comment.starts_with('#') && comment != "#MRGB" => Ok(()),
            other => {
                let known = LEFT_OUT.iter().find(|(words, _)| words.split(' ').any(|word| word == other));
                self.leave_out(other, known.map_or("is unknown", |(_, why)| *why), number);
                Ok(())
            }
        }
    }

    /// Adds a notice of a statement that is left out, once for each reason.
    fn leave_out(&mut self, keyword: &str, why: &str, line: u32) {
        let list = &mut self.notices;
        if list.len() < MOST_LEFT_OUT && !list.iter().any(|(known, _)| known.ends_with(why)) {
            list.push((format!("left out: \"{}\" {why}", shown(keyword)), line));
        }
    }

    /// Reads a position, and a colour if three or four more numbers follow. A single further number is a weight.
    fn vertex<'w>(&mut self, line: u32, words: impl Iterator<Item = &'w str> + Clone) -> Result<(), String> {
        let Vertices { positions, colors, .. } = &mut self.vertices;
        positions.push(DVec3::from_array(numbers("v", words.clone())?));
        let more = words.clone().skip(3);
        let count = more.clone().count();
        if count == 1 {
            if more.filter_map(text::number::<f64>).next() != Some(1.0) {
                self.leave_out("v", "has a weight, which only curves use", line);
            }
        } else if !matches!(count, 0 | 3 | 4) {
            self.leave_out("v", "must have 3, 4, 6 or 7 numbers", line);
        } else if count > 0 {
            colors.resize(positions.len() - 1, NO_COLOR);
            let color = numbers("v", more).and_then(single);
            colors.push(*color.as_ref().unwrap_or(&NO_COLOR));
            if color.is_err() {
                self.leave_out("v", "has a colour that is not three finite numbers", line);
            }
        }
        Ok(())
    }

    /// Reads the numbers of a normal or of texture coordinates. If one is not finite, all become 0, with a notice. A normal
    /// of 0 is replaced by the face's normal.
    fn finite<'w, const N: usize>(
        &mut self,
        keyword: &str,
        line: u32,
        words: impl Iterator<Item = &'w str>,
    ) -> Result<[f32; N], String> {
        let values = any_numbers(keyword, words)?.map(|value: f64| value as f32);
        if values.iter().all(|value| value.is_finite()) {
            return Ok(values);
        }
        let why = if N == 3 {
            "is not finite; the face's normal is used instead"
        } else {
            "is not finite; 0 is used instead"
        };
        self.leave_out(keyword, why, line);
        Ok([0.0; N])
    }

    fn face<'w>(&mut self, line: u32, words: impl Iterator<Item = &'w str>) -> Result<(), String> {
        let corners = words.map(|word| self.corner(line, word)).collect::<Result<Vec<_>, _>>()?;
        if corners.len() < 3 {
            return Err(format!("a face needs 3 corners or more, not {}; remove it", corners.len()));
        }
        self.key.has = [1, 2].map(|kind| corners.iter().all(|corner| corner[kind].is_some()));
        if self.smooths && !self.key.has[1] {
            self.leave_out("s", "smooths faces without normals, which are rendered flat; export normals", line);
        }
        let group = match self.groups.get_mut(&self.key) {
            Some(group) => group,
            None => self.groups.entry(self.key.clone()).or_default(),
        };
        let [has_uv, has_normal] = self.key.has;
        let kept = |[position, uv, normal]: Corner| [position, uv.filter(|_| has_uv), normal.filter(|_| has_normal)];
        group.corners.extend(corners.into_iter().map(kept));
        group.faces.push((line, group.corners.len()));
        Ok(())
    }

    /// Parses one corner of a face, such as `1/2/3`, into indices from 1.
    fn corner(&mut self, line: u32, word: &str) -> Result<Corner, String> {
        let bad = |what: &str| format!("corner \"{}\"{what}; export the file again", shown(word));
        let mut numbers = [None; 3];
        for (kind, text) in word.split('/').enumerate() {
            let number = numbers.get_mut(kind).ok_or_else(|| bad(" has more than three numbers"))?;
            if text.is_empty() {
                continue;
            }
            let value: i64 = text.parse().map_err(|_| bad(" is not a number"))?;
            let (count, what) = (self.vertices.counts()[kind], KINDS[kind]);
            *number = Some(match u64::try_from(value) {
                Ok(0) => return Err(bad(&format!(": indices of {what} start at 1"))),
                Ok(value) => {
                    if value > count.max(self.largest[kind].0) {
                        self.largest[kind] = (value, line);
                    }
                    value
                }
                Err(_) => {
                    let before = count.checked_sub(value.unsigned_abs());
                    before.ok_or_else(|| bad(&format!(": there are only {count} {what} so far")))? + 1
                }
            });
        }
        numbers[0].map(|_| numbers).ok_or_else(|| bad(" has no vertex"))
    }

    /// Checks, after the last line, that all indices refer to existing vertices. Faces may precede their vertices.
    fn check_ranges(&self) -> Result<(), ModelError> {
        for (kind, &(largest, line)) in self.largest.iter().enumerate() {
            let (count, what) = (self.vertices.counts()[kind], KINDS[kind]);
            if largest > count {
                let what =
                    format!("a corner has index {largest}, but only {count} {what} exist; export the file again");
                return Err(ModelError::at(line, what));
            }
            if count > u64::from(u32::MAX) {
                return Err(ModelError::at(1, format!("{count} {what} are too many; split the mesh")));
            }
        }
        Ok(())
    }
}

/// Parses the first `N` numbers of a statement, which must be finite. The error is a message without the line.
fn numbers<'w, const N: usize>(
    keyword: &str,
    words: impl Iterator<Item = &'w str> + Clone,
) -> Result<[f64; N], String> {
    let values: [f64; N] = any_numbers(keyword, words.clone())?;
    let bad = values.iter().zip(words).find(|(value, _)| !value.is_finite());
    bad.map_or(Ok(values), |(_, word)| Err(not_finite(word)))
}

/// Parses the first `N` numbers of a statement, NaN and infinity included. The error is a message without the line.
fn any_numbers<'w, const N: usize>(keyword: &str, words: impl Iterator<Item = &'w str>) -> Result<[f64; N], String> {
    let number =
        |word| text::number(word).ok_or_else(|| format!("\"{}\" is not a number; export the file again", shown(word)));
    let values: Vec<f64> = words.take(N).map(number).collect::<Result<_, _>>()?;
    values
        .try_into()
        .map_err(|values: Vec<f64>| format!("{keyword} needs {N} numbers, not {}; export the file again", values.len()))
}

/// Converts numbers to single precision. The error reports an overflow.
fn single<const N: usize>(values: [f64; N]) -> Result<[f32; N], String> {
    let over = values.iter().find(|v| !(**v as f32).is_finite());
    over.map_or(Ok(values.map(|v| v as f32)), |over| Err(not_finite(&over.to_string())))
}

fn not_finite(word: &str) -> String {
    format!("\"{}\" is not finite; repair the mesh", shown(word))
}

/// Returns a word of the file for a message: cut to 32 characters, without control characters.
pub(super) fn shown(word: &str) -> String {
    let mut shown: String = word.chars().take(32).filter(|c| !c.is_control()).collect();
    if word.chars().nth(32).is_some() {
        shown.push('…');
    }
    shown
}
