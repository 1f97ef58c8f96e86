//! Meshes from OBJ files through `tobj`.
//!
//! That crate gives no line with its errors, panics or reads on with wrong numbers at some mistakes, and knows
//! neither continued lines nor faces that mix corners with and without texture coordinates. So every line is
//! checked first, and `tobj` is handed what was found good: vertices, then faces with absolute numbers, sorted
//! by material and by what their corners have.

use crate::polygon;
use crate::{MeshData, MeshFault};
use glam::DVec3;
use std::collections::BTreeMap;
use std::fmt::Write;
use tobj::{LoadOptions, Mesh, load_obj_buf};

/// What an OBJ file holds.
#[derive(Clone, Debug, Default)]
pub struct ObjModel {
    /// Meshes, one for each material and for each set of things that corners have.
    pub meshes: Vec<ObjMesh>,
    /// Files of materials that it names, and the lines where it does.
    pub libraries: Vec<(String, u32)>,
    /// What the renderer has no use for (lines, points, curves), each with the line where it is met first.
    pub left_out: Vec<(String, u32)>,
}

/// The part of an OBJ file that has one material.
#[derive(Clone, Debug)]
pub struct ObjMesh {
    /// Name of its material, and the line that asks for it first; `None` before the first `usemtl`.
    pub material: Option<(String, u32)>,
    /// The mesh; polygons are cut into triangles.
    pub data: MeshData,
}

/// Why an OBJ file is refused. Lines count from 1.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ObjError {
    /// A line that cannot be read.
    #[error("line {line}: {what}")]
    Line {
        /// Its number.
        line: u32,
        /// What is wrong and what to do.
        what: String,
    },
    /// The file has no faces.
    #[error("there are no faces: export a mesh, not points or curves")]
    NoFaces,
    /// The parser's own words.
    #[error("the file cannot be read ({0}): export the mesh anew")]
    Parser(String),
    /// The mesh itself is wrong.
    #[error(transparent)]
    Mesh(#[from] MeshFault),
}

/// Reads the meshes of a file. Negative numbers count back from the last vertex so far; polygons are cut into
/// triangles; `w` and colours of vertices are skipped. Bytes that are no UTF-8 are taken for names.
///
/// # Errors
/// The first thing wrong with the file.
pub fn read_obj(bytes: &[u8]) -> Result<ObjModel, ObjError> {
    let text = String::from_utf8_lossy(bytes);
    let mut checked = Checked::default();
    let lines = Lines { rest: &text, number: 0 };
    for (number, line) in lines {
        checked.line(number, &line).map_err(|what| ObjError::Line { line: number, what })?;
    }
    checked.check_ranges()?;
    let Checked { vertices, groups, libraries, left_out, .. } = checked;
    let parsed = parse(vertices, groups.values())?;
    let mut meshes = Vec::with_capacity(groups.len());
    for ((key, group), mesh) in groups.into_iter().zip(parsed) {
        let data = cut(mesh, &group.lines)?;
        meshes.push(ObjMesh { material: key.material.map(|(line, name)| (name, line)), data });
    }
    if meshes.is_empty() { Err(ObjError::NoFaces) } else { Ok(ObjModel { meshes, libraries, left_out }) }
}

/// Vertices and the groups of faces through `tobj`: a mesh for each group.
fn parse<'g>(mut text: String, groups: impl Iterator<Item = &'g Group>) -> Result<Vec<Mesh>, ObjError> {
    for group in groups {
        text.push_str("g\n");
        text.push_str(&group.faces);
    }
    let options = LoadOptions { single_index: true, ..LoadOptions::default() };
    let no_materials = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let parsed = load_obj_buf(&mut text.as_bytes(), &options, no_materials);
    let (models, _) = parsed.map_err(|e| ObjError::Parser(e.to_string()))?;
    Ok(models.into_iter().map(|model| model.mesh).collect())
}

/// Polygons into triangles.
fn cut(mesh: Mesh, lines: &[u32]) -> Result<MeshData, ObjError> {
    let mut data = MeshData {
        positions: mesh.positions.chunks_exact(3).map(DVec3::from_slice).collect(),
        normals: mesh.normals.chunks_exact(3).map(|n| [0, 1, 2].map(|i| n[i] as f32)).collect(),
        uvs: mesh.texcoords.chunks_exact(2).map(|t| [0, 1].map(|i| t[i] as f32)).collect(),
        triangles: Vec::new(),
    };
    let mut rest = &mesh.indices[..];
    for (face, &line) in lines.iter().enumerate() {
        let arity = mesh.face_arities.get(face).map_or(3, |&n| n as usize);
        let Some((corners, after)) = rest.split_at_checked(arity) else { break };
        rest = after;
        polygon::triangulate(corners, &data.positions, &mut data.triangles)
            .map_err(|what| ObjError::Line { line, what: what.into() })?;
    }
    data.check()?;
    Ok(data)
}

/// Lines with their numbers; a backslash at the end continues a line.
struct Lines<'t> {
    rest: &'t str,
    number: u32,
}

impl<'t> Iterator for Lines<'t> {
    type Item = (u32, std::borrow::Cow<'t, str>);

    fn next(&mut self) -> Option<Self::Item> {
        let mut joined = String::new();
        let mut first = 0;
        while !self.rest.is_empty() {
            let (line, rest) = self.rest.split_once('\n').unwrap_or((self.rest, ""));
            self.rest = rest;
            self.number += 1;
            first = if first == 0 { self.number } else { first };
            let line = line.trim_end();
            match line.strip_suffix('\\') {
                Some(line) => joined.extend([line, " "]),
                None if joined.is_empty() => return Some((first, line.into())),
                None => return Some((first, (joined + line).into())),
            }
        }
        (first > 0).then(|| (first, joined.into()))
    }
}

/// What faces are sorted by: in the order of first use.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    material: Option<(u32, String)>,
    /// Whether corners have texture coordinates and normals.
    has: [bool; 2],
}

/// Faces of one key in plain words, and the line of each.
#[derive(Debug, Default)]
struct Group {
    faces: String,
    lines: Vec<u32>,
}

/// A number that a corner gives, where vertices were too few when it did.
#[derive(Clone, Copy, Debug, Default)]
struct Largest {
    value: u64,
    line: u32,
}

const KINDS: [&str; 3] = ["vertices", "texture coordinates", "normals"];

/// What was read so far.
#[derive(Default)]
struct Checked {
    /// Vertices, texture coordinates and normals in plain words.
    vertices: String,
    counts: [u64; 3],
    largest: [Largest; 3],
    groups: BTreeMap<Key, Group>,
    key: Key,
    materials: BTreeMap<String, u32>,
    libraries: Vec<(String, u32)>,
    left_out: Vec<(String, u32)>,
}

impl Checked {
    fn line(&mut self, number: u32, line: &str) -> Result<(), String> {
        // A comment may stand behind anything but a name.
        let words = || line.split('#').next().unwrap_or("").split_whitespace().skip(1);
        let Some(keyword) = line.split_whitespace().next() else { return Ok(()) };
        let name = line.trim_start()[keyword.len()..].trim();
        match keyword {
            "v" => self.vertex(0, "v", words().take(3), 3),
            // A texture of one dimension has one.
            "vt" => self.vertex(1, "vt", words().chain(["0"]).take(2), 2),
            "vn" => self.vertex(2, "vn", words().take(3), 3),
            "f" | "fo" => self.face(number, words()),
            "usemtl" => {
                self.key.material = (!name.is_empty()).then(|| {
                    let line = *self.materials.entry(name.to_owned()).or_insert(number);
                    (line, name.to_owned())
                });
                Ok(())
            }
            "mtllib" => {
                if !name.is_empty() && !self.libraries.iter().any(|(known, _)| known == name) {
                    self.libraries.push((name.to_owned(), number));
                }
                Ok(())
            }
            "l" | "p" | "curv" | "curv2" | "surf" | "call" => {
                if !self.left_out.iter().any(|(known, _)| known == keyword) {
                    self.left_out.push((keyword.to_owned(), number));
                }
                Ok(())
            }
            // Names, groups, smoothing and comments change nothing.
            _ => Ok(()),
        }
    }

    fn vertex<'w>(
        &mut self,
        kind: usize,
        keyword: &str,
        words: impl Iterator<Item = &'w str>,
        wanted: usize,
    ) -> Result<(), String> {
        self.vertices.push_str(keyword);
        let mut found = 0;
        for word in words {
            let value: f64 = word.parse().map_err(|_| format!("'{}' is no number", shown(word)))?;
            // Positions are kept in double precision, the others are not.
            if !value.is_finite() || kind > 0 && !(value as f32).is_finite() {
                return Err(format!("'{}' is not finite: mend the mesh", shown(word)));
            }
            self.vertices.push(' ');
            self.vertices.push_str(word);
            found += 1;
        }
        self.vertices.push('\n');
        self.counts[kind] += 1;
        if found == wanted { Ok(()) } else { Err(format!("{keyword} needs {wanted} numbers, not {found}")) }
    }

    fn face<'w>(&mut self, line: u32, words: impl Iterator<Item = &'w str>) -> Result<(), String> {
        let mut corners = Vec::new();
        for word in words {
            corners.push(self.corner(line, word)?);
        }
        if corners.len() < 3 {
            return Err(format!("a face needs 3 corners or more, not {}: remove it", corners.len()));
        }
        self.key.has = [1, 2].map(|kind| corners.iter().all(|corner| corner[kind].is_some()));
        let group = match self.groups.get_mut(&self.key) {
            Some(group) => group,
            None => self.groups.entry(self.key.clone()).or_default(),
        };
        group.lines.push(line);
        group.faces.push('f');
        let text = |number: Option<u64>, has: bool| number.filter(|_| has).map_or(String::new(), |n| n.to_string());
        for [position, uv, normal] in corners {
            let [has_uv, has_normal] = self.key.has;
            let [position, uv, normal] = [text(position, true), text(uv, has_uv), text(normal, has_normal)];
            // Writing to a string does not fail.
            let _ = write!(group.faces, " {position}/{uv}/{normal}");
        }
        group.faces.push('\n');
        Ok(())
    }

    /// The numbers of a corner, counted from 1.
    fn corner(&mut self, line: u32, word: &str) -> Result<[Option<u64>; 3], String> {
        let mut numbers = [None; 3];
        for (kind, text) in word.split('/').enumerate() {
            let Some(number) = numbers.get_mut(kind) else {
                return Err(format!("corner '{}' has more than three numbers", shown(word)));
            };
            if text.is_empty() {
                continue;
            }
            let value: i64 = text.parse().map_err(|_| format!("corner '{}' is no number", shown(word)))?;
            let count = self.counts[kind];
            let what = KINDS[kind];
            *number = Some(match u64::try_from(value) {
                Ok(0) => return Err(format!("corner '{}': {what} count from 1", shown(word))),
                Ok(value) => {
                    if value > count.max(self.largest[kind].value) {
                        self.largest[kind] = Largest { value, line };
                    }
                    value
                }
                Err(_) => match count.checked_sub(value.unsigned_abs()) {
                    Some(before) => before + 1,
                    None => return Err(format!("corner '{}': there are only {count} {what} so far", shown(word))),
                },
            });
        }
        if numbers[0].is_none() {
            return Err(format!("corner '{}' has no vertex", shown(word)));
        }
        Ok(numbers)
    }

    /// Faces may come before their vertices; in the end all must be there.
    fn check_ranges(&self) -> Result<(), ObjError> {
        for (kind, largest) in self.largest.iter().enumerate() {
            let (count, what) = (self.counts[kind], KINDS[kind]);
            if largest.value > count {
                let what = format!("a corner has number {}, but there are only {count} {what}", largest.value);
                return Err(ObjError::Line { line: largest.line, what });
            }
            if count > u64::from(u32::MAX) {
                let what = format!("{count} {what} are too many: split the mesh");
                return Err(ObjError::Line { line: 1, what });
            }
        }
        Ok(())
    }
}

/// A word for a message, cut to a sensible length.
fn shown(word: &str) -> String {
    let mut shown: String = word.chars().take(32).filter(|c| !c.is_control()).collect();
    if word.chars().nth(32).is_some() {
        shown.push('…');
    }
    shown
}
