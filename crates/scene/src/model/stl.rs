//! Meshes from STL files, binary and text.

use super::{ModelError, ModelMesh, UpAxis, mesh_scene};
use crate::MeshData;
use crate::scene_reader::SceneReader;
use glam::DVec3;
use std::collections::HashMap;

/// The reader of STL models.
pub(crate) const STL: SceneReader = SceneReader {
    name: "STL",
    extensions: &["stl"],
    recognizes: |content| {
        let count = content.get(80..84).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        let binary = count.is_some_and(|count| count > 0 && content.len() as u64 == 84 + 50 * count);
        binary || begins_with(&String::from_utf8_lossy(&content[..content.len().min(64)]), "solid")
    },
    read: |files, path, options| mesh_scene(files, path, options.model.stage(UpAxis::Z), read_stl),
};

/// Length of a binary file's header in bytes: 80 of text, and 4 for the number of facets.
const HEADER: usize = 84;
/// Length of a facet of a binary file in bytes: normal, three corners, two extra bytes.
const FACET: usize = 50;

/// Reads a mesh from the bytes of an STL file, without normals, since facets are flat. Bitwise equal corners are merged
/// into one vertex.
///
/// A file that begins with `solid` is text, with two exceptions: a NUL among its first 512 bytes, or the exact length of
/// a binary file with its number of facets.
///
/// # Errors
/// Returns the first fault in the file.
pub fn read_stl(bytes: &[u8]) -> Result<ModelMesh, ModelError> {
    let count = bytes.get(80..HEADER).and_then(<[u8]>::first_chunk).map(|&count| u32::from_le_bytes(count));
    let promised = count.map(|count| HEADER as u64 + FACET as u64 * u64::from(count));
    let blanks = bytes.iter().take_while(|b| b.is_ascii_whitespace()).count();
    let begins = bytes.get(blanks..blanks + 5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    if begins && promised != Some(bytes.len() as u64) && !bytes[..bytes.len().min(512)].contains(&0) {
        return read_text(bytes);
    }
    let (Some(count), Some(promised)) = (count, promised) else {
        let what = "bytes that do not begin with `solid` are no STL file; a binary one has";
        return Err(format!("{} {what} {HEADER} or more", bytes.len()).into());
    };
    if promised > bytes.len() as u64 {
        let found = format!("only {} bytes follow where each takes {FACET}", bytes.len() - HEADER);
        let what = format!("the header promises {count} facets, and {found}; the file is cut off or damaged");
        return Err(what.into());
    }
    let mut welder = Welder::default();
    for (number, facet) in bytes[HEADER..promised as usize].chunks_exact(FACET).enumerate() {
        // The normal comes first, and two bytes without meaning last.
        let float = |i: usize| f32::from_le_bytes([facet[i], facet[i + 1], facet[i + 2], facet[i + 3]]);
        let corners = [12, 24, 36].map(|corner| [corner, corner + 4, corner + 8].map(float));
        let not_finite = || ModelError::from(format!("facet {number}: a corner is not finite; mend the mesh"));
        welder.add(corners).ok_or_else(not_finite)?;
    }
    let mut data = welder.mesh;
    data.check()?;
    data.positions.shrink_to_fit();
    let extra = bytes.len() as u64 - promised;
    let doubt = (extra > 0).then(|| format!("{extra} bytes follow the last of {count} facets and are not read"));
    Ok(ModelMesh { data, doubt })
}

fn read_text(bytes: &[u8]) -> Result<ModelMesh, ModelError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let mut welder = Welder::default();
    while let Some((start, line)) = lines.next() {
        if !begins_with(line, "solid") {
            return Err(ModelError::at(start, "outside of a solid, only `solid` can follow; the file is damaged"));
        }
        loop {
            let end = || bad_facet(text.lines().count() as u32, "endsolid");
            let (first, line) = lines.next().ok_or_else(end)?;
            if begins_with(line, "endsolid") {
                break;
            }
            if !begins_with(line, "facet") {
                return Err(bad_facet(first, "facet"));
            }
            let mut take = |word| match lines.next() {
                Some((_, line)) if begins_with(line, word) => Ok(line),
                _ => Err(bad_facet(first, word)),
            };
            take("outer")?;
            let mut corners = [[0.0; 3]; 3];
            for corner in &mut corners {
                let numbers = take("vertex")?.split_whitespace().skip(1).map_while(|word| word.parse().ok());
                let numbers = numbers.take(3).collect::<Vec<f32>>();
                *corner = numbers.try_into().map_err(|_| bad_facet(first, "vertex"))?;
            }
            take("endloop")?;
            take("endfacet")?;
            let not_finite = || ModelError::at(first, "a corner of this facet is not finite; mend the mesh");
            welder.add(corners).ok_or_else(not_finite)?;
        }
    }
    welder.mesh.check()?;
    Ok(ModelMesh { data: welder.mesh, doubt: None })
}

/// The error of a facet that begins at a line and lacks the line that begins with `word`.
fn bad_facet(line: u32, word: &str) -> ModelError {
    let what = format!(
        "this was read as a text STL file, and its next facet is missing or wrong (`{word}` is missing, or its numbers); the file is cut off, damaged or of another format"
    );
    ModelError::at(line, what)
}

fn begins_with(line: &str, word: &str) -> bool {
    line.split_whitespace().next().is_some_and(|first| first.eq_ignore_ascii_case(word))
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
