//! Meshes from PLY files: ASCII, and binary of either byte order [Turk 1994].
//!
//! A file is a header and rows of numbers. This parser uses no library: existing ones wrap every number in a property, and
//! their errors state neither line nor remedy.

use super::{ModelError, ModelMesh, UpAxis, colors, mesh_scene};
use crate::MeshData;
use crate::polygon;
use crate::scene_reader::SceneReader;
use crate::text::{self, Words, first_word};
use glam::dvec3;
use std::borrow::Cow;

/// The reader of PLY models.
pub(crate) const PLY: SceneReader = SceneReader {
    name: "PLY",
    extensions: &["ply"],
    recognizes: |content| first_word(content) == Some(b"ply"),
    read: |files, path, options| mesh_scene(files, path, options.model.stage(UpAxis::Y), read_ply),
};

/// Reads a mesh from the bytes of a PLY file. Texture coordinates may be called `u v`, `s t`, `texture_u texture_v` or
/// `texture_s texture_t`. Colours of vertices, or else of faces, are in sRGB: `red green blue`, from 0 to the largest
/// number of their type, or from 0 to 1. Other properties and elements are left out.
///
/// Memory is at most a small multiple of `bytes.len()`, whatever the header declares.
///
/// # Errors
/// Returns the first fault in the file.
pub fn read_ply(bytes: &[u8]) -> Result<ModelMesh, ModelError> {
    let header = header(text::without_mark(bytes)?)?;
    let text = if header.format == ASCII { text::decode(header.rest)? } else { Cow::default() };
    let mut rows = match header.format {
        ASCII => Rows::Text(Words::new(&text, header.lines + 1)),
        format => Rows::Binary { left: header.rest, big: format == BIG },
    };
    let mut data = MeshData::default();
    let (mut has_positions, mut faces, mut left_out) = (false, None, header.files);
    for element in &header.elements {
        rows.check_length(element)?;
        match &*element.name {
            "vertex" => {
                has_positions = element.has(&["x", "y", "z"]);
                left_out.extend(read_vertices(&mut rows, element, &mut data)?);
            }
            "face" => {
                let (found, unread) = read_faces(&mut rows, element)?;
                left_out.extend(unread);
                faces = Some(found);
            }
            name => {
                (0..element.count).try_for_each(|i| rows.read(element, i, |_, _| {}))?;
                left_out.push(format!("element {name}"));
            }
        }
    }
    if !has_positions {
        return Err("there is no element vertex with properties x, y and z; export positions too".into());
    }
    let faces = faces.ok_or(NO_FACES)?;
    data.check_positions()?;
    let mut of_faces = cut(&faces, &mut data)?;
    let mut clamped = colors::decode(&mut data.colors);
    if !of_faces.is_empty() && data.colors.is_empty() {
        clamped = colors::decode(&mut of_faces);
        data.color_triangles(&of_faces);
    } else if !of_faces.is_empty() {
        left_out.push("colours of faces, since vertices have their own".into());
    }
    let colors = data.mend_colors().map(|count| format!("{count} colours are not finite; white is used instead"));
    let mended = data.mend_normals();
    let mended = mended.map(|count| format!("{count} normals are not finite; face normals are used instead"));
    data.check()?;
    let doubts =
        mended.into_iter().chain(clamped).chain(colors).chain(rows.doubt(&text)).collect::<Vec<String>>().join("; ");
    Ok(ModelMesh { data, doubt: (!doubts.is_empty()).then_some(doubts), left_out })
}

const ASCII: &str = "ascii";
const LITTLE: &str = "binary_little_endian";
const BIG: &str = "binary_big_endian";
const NO_FACES: &str = "there is no element face with a list vertex_indices; export triangles";

/// A type of number: its length in bytes, and the meaning of its bits.
#[derive(Clone, Copy)]
struct Number(usize, Bits);

#[derive(Clone, Copy, PartialEq)]
enum Bits {
    Signed,
    Unsigned,
    Float,
}

impl Number {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self(1, Bits::Signed),
            "uchar" | "uint8" => Self(1, Bits::Unsigned),
            "short" | "int16" => Self(2, Bits::Signed),
            "ushort" | "uint16" => Self(2, Bits::Unsigned),
            "int" | "int32" => Self(4, Bits::Signed),
            "uint" | "uint32" => Self(4, Bits::Unsigned),
            "float" | "float32" => Self(4, Bits::Float),
            "double" | "float64" => Self(8, Bits::Float),
            _ => return None,
        })
    }

    fn of_word(self, word: &str) -> Option<f64> {
        match self {
            Self(4, Bits::Float) => text::number::<f32>(word).map(f64::from),
            Self(_, Bits::Float) => text::number(word),
            // A number out of the range of its type changes when it is cut to the type's bytes.
            Self(bytes, _) => word
                .parse()
                .ok()
                .filter(|value: &f64| *value == self.of_bits(*value as i64 as u64 & u64::MAX >> (64 - 8 * bytes))),
        }
    }

    /// The value of this type that means full intensity of a colour channel.
    fn full(self) -> f64 {
        match self {
            Self(_, Bits::Float) => 1.0,
            Self(2, _) => 65_535.0,
            _ => 255.0,
        }
    }

    /// The value of `bits`; bits beyond the type's length are 0.
    fn of_bits(self, bits: u64) -> f64 {
        let unused = 64 - 8 * self.0;
        match self {
            Self(4, Bits::Float) => f32::from_bits(bits as u32).into(),
            Self(_, Bits::Float) => f64::from_bits(bits),
            Self(_, Bits::Unsigned) => bits as f64,
            Self(_, Bits::Signed) => ((bits << unused) as i64 >> unused) as f64,
        }
    }
}

/// A property of an element: a number, or a list with a count.
struct Property {
    name: String,
    count: Option<Number>,
    number: Number,
}

/// An element of the header: the number and the properties of its rows.
struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

impl Element {
    fn lacks(&self, name: &str) -> bool {
        self.properties.iter().all(|p| p.name != name)
    }

    /// True if the element has a number for each of `names`.
    fn has(&self, names: &[&str]) -> bool {
        names.iter().all(|name| self.properties.iter().any(|p| p.name == *name && p.count.is_none()))
    }
}

/// The header, and the bytes that follow it.
struct Header<'b> {
    elements: Vec<Element>,
    format: &'static str,
    lines: u32,
    rest: &'b [u8],
    /// The images that comments name, for messages.
    files: Vec<String>,
}

fn header(bytes: &[u8]) -> Result<Header<'_>, ModelError> {
    let mut header = Header { elements: Vec::new(), format: "", lines: 0, rest: bytes, files: Vec::new() };
    // Binary rows may begin with a LF after a header whose lines end with CR.
    let first = bytes.iter().position(|b| matches!(b, b'\r' | b'\n')).unwrap_or(0);
    let lone = bytes[first..].starts_with(b"\r") && !bytes[first..].starts_with(b"\r\n");
    loop {
        header.lines += 1;
        let line = header.lines;
        let bad = |what| ModelError::at(line, format!("the PLY header cannot be read ({what}); export the mesh again"));
        let text = text::take_line(&mut header.rest, lone).ok_or_else(|| bad("it does not end"))?;
        let unknown = || bad("this line is unknown");
        let elements = &mut header.elements;
        match text.split_whitespace().collect::<Vec<&str>>()[..] {
            ["comment", "TextureFile", ref name @ ..] => header.files.push(format!("texture file {}", name.join(" "))),
            [] | ["ply" | "comment" | "obj_info", ..] => {}
            ["format", ASCII, _] => header.format = ASCII,
            ["format", LITTLE, _] => header.format = LITTLE,
            ["format", BIG, _] => header.format = BIG,
            ["element", name, count] if elements.iter().all(|e| e.name != name) => {
                let count = count.parse().map_err(|_| unknown())?;
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", ref kind @ .., name] if elements.last().is_some_and(|e| e.lacks(name)) => {
                let (count, number) = match kind {
                    ["list", count, number] => (Some(Number::named(count).ok_or_else(unknown)?), number),
                    [number] => (None, number),
                    _ => return Err(unknown()),
                };
                let number = Number::named(number).ok_or_else(unknown)?;
                let last = elements.len() - 1;
                elements[last].properties.push(Property { name: name.to_owned(), count, number });
            }
            ["element", ..] | ["property", ..] => {
                return Err(bad("a name is declared twice, or a property before its element"));
            }
            ["end_header"] if !header.format.is_empty() => return Ok(header),
            _ => return Err(unknown()),
        }
    }
}

/// The rows that have not been read.
enum Rows<'b> {
    /// Numbers in ASCII. Any white space separates them; line ends have no special meaning.
    Text(Words<'b>),
    Binary {
        left: &'b [u8],
        big: bool,
    },
}

impl Rows<'_> {
    /// Refuses an element count that the remaining bytes cannot hold, before memory is allocated.
    fn check_length(&self, element: &Element) -> Result<(), ModelError> {
        // The shortest number in ASCII: a digit and a space.
        let (bytes, short) = match self {
            Self::Text(words) => (words.rest().len(), Some(2)),
            Self::Binary { left, .. } => (left.len(), None),
        };
        let size = |p: &Property| short.unwrap_or(p.count.unwrap_or(p.number).0);
        let least: usize = element.properties.iter().map(size).sum();
        // The last line may lack its line break.
        let fits = least > 0 && element.count.checked_mul(least).is_some_and(|total| total <= bytes + 1);
        if fits || element.count == 0 {
            return Ok(());
        }
        let promised = format!("the header declares {} elements {}", element.count, element.name);
        Err(format!("{promised}, but only {bytes} bytes follow; the file is damaged; copy or export it again").into())
    }

    /// Takes the next number.
    fn next(&mut self, number: Number) -> Option<f64> {
        let (left, big) = match self {
            Self::Text(words) => return number.of_word(words.next()?.1),
            Self::Binary { left, big } => (left, *big),
        };
        let (bytes, rest) = left.split_at_checked(number.0)?;
        *left = rest;
        let join = |bits: u64, byte: &u8| bits << 8 | u64::from(*byte);
        let bits = if big { bytes.iter().fold(0, join) } else { bytes.iter().rev().fold(0, join) };
        Some(number.of_bits(bits))
    }

    /// Reads the row `index` of an element. Calls `take` with the index of the property and each of its values.
    fn read(&mut self, element: &Element, index: usize, mut take: impl FnMut(usize, f64)) -> Result<(), ModelError> {
        for (at, property) in element.properties.iter().enumerate() {
            let count = property.count.map_or(Some(1.0), |count| self.next(count)).filter(|count| *count >= 0.0);
            let count = count.ok_or_else(|| self.bad(element, index, property))?;
            for _ in 0..count as u64 {
                let value = self.next(property.number);
                take(at, value.ok_or_else(|| self.bad(element, index, property))?);
            }
        }
        Ok(())
    }

    /// The error of a row that lacks a number, or has another word in its place.
    fn bad(&self, element: &Element, index: usize, property: &Property) -> ModelError {
        let what = format!("{} {index} cannot be read (no valid number for {})", element.name, property.name);
        let line = if let Self::Text(words) = self { Some(words.line()) } else { None };
        ModelError { line, what: what + "; the file is damaged; copy or export it again" }
    }

    /// A reason to suspect that ASCII rows are damaged, after the last row is read. `text` is the text of all rows.
    fn doubt(self, text: &str) -> Option<String> {
        let Self::Text(mut words) = self else { return None };
        if let Some((line, word)) = words.next() {
            let first = format!("\"{}\" in line {line} and everything after it is not read", word.escape_debug());
            return Some(first + ": the header declares no more rows; if rows hold more numbers, export again");
        }
        let cut = "the last line has no line break; if the file was cut off, a number may be wrong";
        (!text.ends_with('\n')).then(|| cut.to_owned())
    }
}

/// The names of red, green, blue and opacity.
const COLORS: [[&str; 4]; 4] = [
    ["red", "r", "diffuse_red", "Red"],
    ["green", "g", "diffuse_green", "Green"],
    ["blue", "b", "diffuse_blue", "Blue"],
    ["alpha", "a", "diffuse_alpha", "Alpha"],
];
/// The names of a vertex's numbers: x, y, z, nx, ny, nz, the two texture coordinates, and its colour.
const SLOTS: [[&str; 4]; 12] = [
    ["x"; 4],
    ["y"; 4],
    ["z"; 4],
    ["nx"; 4],
    ["ny"; 4],
    ["nz"; 4],
    ["u", "s", "texture_u", "texture_s"],
    ["v", "t", "texture_v", "texture_t"],
    COLORS[0],
    COLORS[1],
    COLORS[2],
    COLORS[3],
];

/// The slot of each property of an element; `None` for one that is not read.
fn slots(element: &Element, names: &[[&str; 4]]) -> Vec<Option<usize>> {
    let slot = |p: &Property| names.iter().position(|names| p.count.is_none() && names.contains(&&*p.name));
    element.properties.iter().map(slot).collect()
}

fn has_colors(element: &Element) -> bool {
    (0..4).any(|k| element.has(&[COLORS[0][k], COLORS[1][k], COLORS[2][k]]))
}

/// Returns the properties of an element that are not read, for messages. `is_opaque` is true if no colour has an opacity
/// below 1.
fn unread(element: &Element, names: &[[&str; 4]], list: &str, is_opaque: bool) -> impl Iterator<Item = String> {
    let is_read = |p: &Property| match p.count {
        None => names.iter().any(|names| names.contains(&&*p.name)),
        Some(_) => p.name == list,
    };
    let unread = element.properties.iter().filter(|p| !is_read(p)).map(|p| p.name.escape_debug().to_string());
    let opacity = (!is_opaque).then(|| "alpha".to_owned());
    let names: Vec<String> = unread.chain(opacity).collect();
    names.into_iter().map(|name| format!("property {name} of {}", element.name))
}

/// Reads the vertices; returns the properties that are left out.
fn read_vertices(rows: &mut Rows<'_>, element: &Element, data: &mut MeshData) -> Result<Vec<String>, ModelError> {
    let slots = slots(element, &SLOTS);
    let normals = element.has(&["nx", "ny", "nz"]);
    let uvs = (0..4).any(|k| element.has(&[SLOTS[6][k], SLOTS[7][k]]));
    let (has_colors, mut is_opaque) = (has_colors(element), true);
    data.positions.reserve_exact(element.count);
    data.normals.reserve_exact(if normals { element.count } else { 0 });
    data.uvs.reserve_exact(if uvs { element.count } else { 0 });
    data.colors.reserve_exact(if has_colors { element.count } else { 0 });
    let full: Vec<f64> = element.properties.iter().map(|p| p.number.full()).collect();
    for i in 0..element.count {
        let mut vertex = [0.0; SLOTS.len()];
        vertex[SLOTS.len() - 1] = 1.0;
        rows.read(element, i, |property, value| {
            let Some(slot) = slots[property] else { return };
            vertex[slot] = if slot < 8 { value } else { value / full[property] };
        })?;
        let [x, y, z, nx, ny, nz, u, v, r, g, b, alpha] = vertex;
        data.positions.push(dvec3(x, y, z));
        if normals {
            data.normals.push([nx as f32, ny as f32, nz as f32]);
        }
        if uvs {
            data.uvs.push([u as f32, v as f32]);
        }
        if has_colors {
            data.colors.push([r as f32, g as f32, b as f32]);
            is_opaque &= alpha >= 1.0;
        }
    }
    Ok(unread(element, &SLOTS[..if has_colors { 12 } else { 8 }], "", is_opaque).collect())
}

/// The vertex indices of all polygons in one list, and the end of each polygon in that list.
#[derive(Default)]
struct Faces {
    corners: Vec<u32>,
    ends: Vec<usize>,
    /// The colour of each polygon, as it is in the file; empty if there are none.
    colors: Vec<[f32; 3]>,
}

/// Reads the faces; returns them and the properties that are left out.
fn read_faces(rows: &mut Rows<'_>, element: &Element) -> Result<(Faces, Vec<String>), ModelError> {
    let is_corners = |p: &Property| p.count.is_some() && matches!(&*p.name, "vertex_indices" | "vertex_index");
    let list = element.properties.iter().position(is_corners).ok_or(NO_FACES)?;
    let (slots, has_colors, mut is_opaque) = (slots(element, &COLORS), has_colors(element), true);
    let mut faces = Faces::default();
    for face in 0..element.count {
        let (mut bad, mut color) = (None, [0.0, 0.0, 0.0, 1.0]);
        rows.read(element, face, |property, value| match value {
            _ if property != list => {
                slots[property].into_iter().for_each(|c| color[c] = value / element.properties[property].number.full());
            }
            _ if value >= 0.0 && value.fract() == 0.0 => faces.corners.push(value as u32),
            _ => bad = bad.or(Some(value)),
        })?;
        if let Some(corner) = bad {
            return Err(format!("face {face}: vertex index {corner} is negative; indices start at 0").into());
        }
        faces.ends.push(faces.corners.len());
        if has_colors {
            let [r, g, b, alpha] = color;
            faces.colors.push([r, g, b].map(|c| c as f32));
            is_opaque &= alpha >= 1.0;
        }
    }
    let names = &COLORS[..if has_colors { 4 } else { 0 }];
    Ok((faces, unread(element, names, &element.properties[list].name, is_opaque).collect()))
}

/// Cuts all polygons into triangles and appends the triangles to `data`. Returns their colours, if faces have any.
fn cut(faces: &Faces, data: &mut MeshData) -> Result<Vec<[f32; 3]>, ModelError> {
    let vertices = data.positions.len();
    data.triangles.reserve(faces.corners.len().saturating_sub(2 * faces.ends.len()));
    let (mut start, mut colors) = (0, Vec::new());
    for (face, &end) in faces.ends.iter().enumerate() {
        let corners = &faces.corners[start..end];
        start = end;
        let bad = |what: &str| ModelError::from(format!("face {face}: {what}"));
        if let Some(corner) = corners.iter().find(|&&c| c as usize >= vertices) {
            return Err(bad(&format!(
                "vertex index {corner} is too large; indices must be below {vertices}, the number of vertices"
            )));
        }
        if corners.len() < 3 {
            return Err(bad(&format!("a face needs 3 corners or more, not {}; remove it", corners.len())));
        }
        polygon::triangulate(corners, &data.positions, &mut data.triangles).map_err(bad)?;
        if let Some(color) = faces.colors.get(face) {
            colors.resize(data.triangles.len(), *color);
        }
    }
    Ok(colors)
}
