//! Meshes from STL files, binary and text.

use super::{ModelError, ModelMesh, UpAxis, colors, mesh_scene};
use crate::MeshData;
use crate::image::srgb_encode;
use crate::scene_reader::SceneReader;
use crate::text::{self, Words, first_word};
use glam::DVec3;
use std::collections::HashMap;

/// The reader of STL models.
pub(crate) const STL: SceneReader = SceneReader {
    name: "STL",
    extensions: &["stl"],
    recognizes: |content| {
        let binary = promised(content).is_some_and(|(count, length)| count > 0 && length == content.len() as u64);
        binary || begins_as_text(content)
    },
    read: |files, path, options| mesh_scene(files, path, options.model.stage(UpAxis::Z), read_stl),
};

/// Length of a binary file's header in bytes: 80 of text, and 4 for the number of facets.
const HEADER: usize = 84;
/// Length of a facet of a binary file in bytes: normal, three corners, two extra bytes.
const FACET_LENGTH: usize = 50;

/// Reads a mesh from the bytes of an STL file, without normals, since facets are flat. Bitwise equal corners are merged into
/// one vertex, unless their facets have different colours. Colours of binary files are read in the format of VisCAM and
/// SolidView, or of Materialise Magics.
///
/// A file that begins with `solid` is text, unless its first 512 bytes contain a NUL, or its length is exactly that of a
/// binary file with as many facets as bytes 80 to 83 declare.
///
/// # Errors
/// Returns the first fault in the file.
pub fn read_stl(bytes: &[u8]) -> Result<ModelMesh, ModelError> {
    let promised = promised(bytes);
    if promised.is_none_or(|(_, length)| length != bytes.len() as u64) {
        // Text in UTF-16 is an error.
        text::without_mark(bytes)?;
        if begins_as_text(bytes) && !bytes[..bytes.len().min(512)].contains(&0) {
            return read_text(&text::decode(bytes)?);
        }
    }
    let Some((count, promised)) = promised else {
        let found = format!("its {} bytes are fewer than the {HEADER} of a binary header", bytes.len());
        return Err(format!("not an STL file: it does not begin with `solid`, and {found}; export it again").into());
    };
    if promised > bytes.len() as u64 {
        let found = format!("only {} bytes follow instead of {FACET_LENGTH} for each", bytes.len() - HEADER);
        let what =
            format!("the header declares {count} facets, but {found}; the file is damaged; copy or export it again");
        return Err(what.into());
    }
    let mut welder = Welder::default();
    let mut attributes = Attributes::of(&bytes[..80]);
    for (number, facet) in bytes[HEADER..promised as usize].chunks_exact(FACET_LENGTH).enumerate() {
        // The normal comes first.
        let float = |i: usize| f32::from_le_bytes([facet[i], facet[i + 1], facet[i + 2], facet[i + 3]]);
        let corners = [12, 24, 36].map(|corner| [corner, corner + 4, corner + 8].map(float));
        let not_finite = || ModelError::from(format!("facet {number}: a corner is not finite; repair the mesh"));
        welder.add(corners).ok_or_else(not_finite)?;
        attributes.facets.push(u16::from_le_bytes([facet[48], facet[49]]));
    }
    let mut data = welder.mesh;
    data.check()?;
    data.positions.shrink_to_fit();
    let (colors, left_out) = attributes.colors();
    if !colors.is_empty() {
        data.color_triangles(&colors);
    }
    let extra = bytes.len() as u64 - promised;
    let doubt = (extra > 0).then(|| format!("{extra} bytes follow the last of {count} facets and are not read"));
    Ok(ModelMesh { data, doubt, left_out })
}

/// The two extra bytes of each facet of a binary file, and the colours in its header.
///
/// VisCAM and SolidView set the highest bit of a facet that has a colour, with red in the high bits and blue in the low bits.
/// Magics writes `COLOR=` and the colour of the body into the header, clears the highest bit of a facet with a colour of its
/// own, and stores red in the low bits. Each channel has five bits, in sRGB.
struct Attributes {
    facets: Vec<u16>,
    /// The colour of the body in the header, as bytes.
    body: Option<[u8; 3]>,
    has_material: bool,
}

impl Attributes {
    fn of(header: &[u8]) -> Self {
        let after =
            |word: &[u8]| header.windows(word.len()).position(|w| w == word).map(|at| &header[at + word.len()..]);
        let body = after(b"COLOR=").and_then(|rest| rest.first_chunk().copied());
        Self { facets: Vec::new(), body, has_material: after(b"MATERIAL=").is_some() }
    }

    /// Returns the colour of each facet, linear RGB, or none; also returns the names of left-out parts.
    fn colors(self) -> (Vec<[f32; 3]>, Vec<String>) {
        const COLORED: u16 = 1 << 15;
        let channels = |bits: u16| [10, 5, 0].map(|shift| f32::from(bits >> shift & 31) / 31.0);
        let reversed = |[b, g, r]: [f32; 3]| [r, g, b];
        let has_any = self.facets.iter().any(|bits| *bits != 0);
        let mut left_out: Vec<String> =
            self.has_material.then(|| "MATERIAL of the header".into()).into_iter().collect();
        let mut colors: Vec<[f32; 3]> = match self.body.map(|body| body.map(|c| f32::from(c) / 255.0)) {
            // Programs that write no colours of facets leave all bits 0.
            Some(body) => {
                let own = |bits: &u16| if has_any && bits & COLORED == 0 { reversed(channels(*bits)) } else { body };
                self.facets.iter().map(own).collect()
            }
            None if self.facets.iter().any(|bits| bits & COLORED != 0) => {
                let grey = srgb_encode(0.5) as f32;
                let own = |bits: &u16| if bits & COLORED == 0 { [grey; 3] } else { channels(*bits) };
                self.facets.iter().map(own).collect()
            }
            None => {
                let first = self.facets.iter().position(|bits| *bits != 0);
                left_out
                    .extend(first.map(|facet| format!("attributes of facets that are not colours (facet {facet})")));
                Vec::new()
            }
        };
        // There is no notice, since all values are from 0 to 1.
        _ = colors::decode(&mut colors);
        (colors, left_out)
    }
}

/// The number of facets that a binary file declares, and the length in bytes of a file with that many facets.
fn promised(bytes: &[u8]) -> Option<(u32, u64)> {
    let count = bytes.get(80..HEADER).and_then(<[u8]>::first_chunk).map(|&count| u32::from_le_bytes(count))?;
    Some((count, HEADER as u64 + FACET_LENGTH as u64 * u64::from(count)))
}

/// True if `solid` is the first word after empty lines and comments.
fn begins_as_text(bytes: &[u8]) -> bool {
    let start = text::without_mark(bytes).unwrap_or_default();
    let mut lines = start.split(|byte| matches!(byte, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let is_comment = |line: &&[u8]| COMMENTS.iter().any(|mark| line.starts_with(mark.as_bytes())) || line.is_empty();
    let after = lines.find(|line| !is_comment(line)).unwrap_or_default();
    first_word(after).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
}

/// The marks that begin comments between solids.
const COMMENTS: [&str; 3] = ["#", ";", "//"];
/// The words that begin a facet. They end a solid's name even on the same line.
const FACET: [&str; 2] = ["facet", "normal"];

/// Reads a sequence of solids. Line ends have no meaning, except that a solid's name extends to the end of its line.
fn read_text(text: &str) -> Result<ModelMesh, ModelError> {
    let mut words = Words::new(text, 1);
    let mut welder = Welder::default();
    let mut open = false;
    loop {
        let mut ahead = words.clone();
        let Some((line, word)) = ahead.next() else { break };
        if words.take_pair(["end", "solid"]) {
            // The whole file may be one line; another solid may follow in it.
            open = words.skip_line_to(FACET);
        } else if word.eq_ignore_ascii_case("solid") {
            words = ahead;
            words.skip_line_to(FACET);
            open = true;
        } else if open {
            let corners = read_facet(&mut words).map_err(|lacks| bad_facet(line, lacks))?;
            let not_finite = || ModelError::at(line, "a corner of this facet is not finite; repair the mesh");
            welder.add(corners).ok_or_else(not_finite)?;
        } else if COMMENTS.iter().any(|mark| word.starts_with(mark)) {
            words = ahead;
            // Skips to the end of the line, since no word is a line break.
            words.skip_line_to(["\n"; 2]);
        } else {
            return Err(ModelError::at(
                line,
                "only `solid` is allowed outside of a solid; the file is damaged; copy or export it again",
            ));
        }
    }
    if open {
        return Err(bad_facet(words.line(), "endsolid"));
    }
    welder.mesh.check()?;
    Ok(ModelMesh { data: welder.mesh, doubt: None, left_out: Vec::new() })
}

/// Reads the corners of a facet, and skips its normal, which may be missing or invalid. The error names the missing words.
fn read_facet(words: &mut Words<'_>) -> Result<[[f32; 3]; 3], &'static str> {
    let is = |word: &str, other: &&str| word.eq_ignore_ascii_case(other);
    words.next().filter(|(_, word)| is(word, &"facet")).ok_or("facet")?;
    while !words.take_pair(["outer", "loop"]) {
        let after = ["facet", "vertex", "endloop", "endfacet", "endsolid"];
        words.next().filter(|(_, word)| !after.iter().any(|other| is(word, other))).ok_or("outer loop")?;
    }
    let mut corners = [[0.0; 3]; 3];
    for corner in &mut corners {
        words.next().filter(|(_, word)| is(word, &"vertex")).ok_or("vertex")?;
        for coordinate in corner {
            *coordinate = words.next().and_then(|(_, word)| text::number(word)).ok_or("vertex")?;
        }
    }
    let ends = [("endloop", "loop"), ("endfacet", "facet")];
    ends.into_iter().try_for_each(|(both, what)| words.take_pair(["end", what]).then_some(()).ok_or(both))?;
    Ok(corners)
}

/// The error of a facet that begins at a line and lacks these words.
fn bad_facet(line: u32, words: &str) -> ModelError {
    let what = format!(
        "the file was read as text STL, but the next facet lacks `{words}` or numbers; the file is cut off, damaged or of another format; copy or export the file again"
    );
    ModelError::at(line, what)
}

/// A mesh under construction, which merges bitwise equal corners into one vertex.
#[derive(Default)]
struct Welder {
    mesh: MeshData,
    known: HashMap<[u32; 3], u32>,
}

impl Welder {
    /// Adds a triangle; `None` if a corner is not finite.
    fn add(&mut self, corners: [[f32; 3]; 3]) -> Option<()> {
        if !corners.as_flattened().iter().all(|c| c.is_finite()) {
            return None;
        }
        let triangle = corners.map(|corner| {
            // Adding 0 turns -0 into 0.
            let key = corner.map(|c| (c + 0.0).to_bits());
            let next = self.mesh.positions.len() as u32;
            *self.known.entry(key).or_insert_with(|| {
                self.mesh.positions.push(DVec3::from_array(corner.map(f64::from)));
                next
            })
        });
        self.mesh.triangles.push(triangle);
        Some(())
    }
}
