//! Meshes from STL files, binary and text, through the crate `stl_io`.
//!
//! This module adds what that crate lacks:
//! * the distinction of text and binary files, since binary files may begin with `solid`, too;
//! * files of several solids, and upper case;
//! * line numbers in errors, and the refusal of numbers that are not finite.

use super::{UpAxis, add_mesh, model_scene};
use crate::files::Files;
use crate::readers::{AnyOptions, SceneReader};
use crate::{MeshData, MeshFault, ReadError, Scene, Source};
use glam::DVec3;
use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;

/// The [`SceneReader`] of STL models.
#[derive(Clone, Copy, Debug, Default)]
pub struct StlReader;

impl SceneReader for StlReader {
    fn name(&self) -> &'static str {
        "STL"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["stl"]
    }

    fn recognizes(&self, content: &[u8]) -> bool {
        let count = content.get(80..84).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        let binary = count.is_some_and(|count| count > 0 && content.len() as u64 == 84 + 50 * count);
        binary || begins_with(&String::from_utf8_lossy(&content[..content.len().min(64)]), "solid")
    }

    fn read(&self, files: &dyn Files, path: &Path, options: &AnyOptions) -> Result<Scene, ReadError> {
        let stage = options.model.stage(UpAxis::Z);
        model_scene(files, path, stage, |scene, bytes, source| {
            let mesh = read_stl(&bytes).map_err(|e| match e {
                StlError::Line { line, what } => ReadError::invalid(Source { line, ..source.clone() }, what),
                other => ReadError::invalid(source.clone(), other.to_string()),
            })?;
            add_mesh(scene, mesh.data, mesh.doubt, source);
            Ok(())
        })
    }
}

/// A mesh from an STL file, as [`read_stl`] returns it.
#[derive(Clone, Debug)]
pub struct StlMesh {
    /// The mesh, without normals, since facets are flat. Bitwise equal corners are merged into one vertex.
    pub data: MeshData,
    /// A reason to suspect that the file is damaged; `None` if there is none.
    pub doubt: Option<String>,
}

/// The error of an STL file. Indices of facets count from 0, lines from 1.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StlError {
    /// The file is neither binary nor text STL.
    #[error("{bytes} bytes that do not begin with `solid` are no STL file; a binary one has 84 or more")]
    Foreign {
        /// Length of the file in bytes.
        bytes: usize,
    },
    /// The header of a binary file declares more facets than the file can hold.
    #[error(
        "the header promises {count} facets, and only {bytes} bytes follow where each takes 50; the file is cut off or damaged"
    )]
    TooShort {
        /// Number of facets that the header declares.
        count: u32,
        /// Number of bytes after the header.
        bytes: usize,
    },
    /// A facet of a binary file has a coordinate that is not finite.
    #[error("facet {facet}: a corner is not finite; mend the mesh")]
    Facet {
        /// Index of the facet.
        facet: usize,
    },
    /// A line of a text file is invalid.
    #[error("line {line}: {what}")]
    Line {
        /// Number of the line, from 1.
        line: u32,
        /// A description of the error, with its remedy.
        what: String,
    },
    /// The mesh is invalid.
    #[error(transparent)]
    Mesh(#[from] MeshFault),
}

/// Length of a binary file's header in bytes: 80 of text, and 4 for the number of facets.
const HEADER: usize = 84;
/// Length of a facet of a binary file in bytes: normal, three corners, two extra bytes.
const FACET: usize = 50;

/// Reads a mesh from the bytes of an STL file. A file that begins with `solid` is text, with two exceptions: a NUL
/// among its first 512 bytes, or the exact length of a binary file with its number of facets.
///
/// # Errors
/// Returns the first fault in the file.
pub fn read_stl(bytes: &[u8]) -> Result<StlMesh, StlError> {
    let count = bytes.get(80..HEADER).and_then(<[u8]>::first_chunk).map(|&count| u32::from_le_bytes(count));
    let promised = count.map(|count| HEADER as u64 + FACET as u64 * u64::from(count));
    let blanks = bytes.iter().take_while(|b| b.is_ascii_whitespace()).count();
    let begins = bytes.get(blanks..blanks + 5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    if begins && promised != Some(bytes.len() as u64) && !bytes[..bytes.len().min(512)].contains(&0) {
        return read_text(bytes);
    }
    let (Some(count), Some(promised)) = (count, promised) else {
        return Err(StlError::Foreign { bytes: bytes.len() });
    };
    if promised > bytes.len() as u64 {
        return Err(StlError::TooShort { count, bytes: bytes.len() - HEADER });
    }
    let mut data = read_binary(bytes)?;
    data.check()?;
    data.positions.shrink_to_fit();
    let extra = bytes.len() as u64 - promised;
    let doubt = (extra > 0).then(|| format!("{extra} bytes follow the last of {count} facets and are not read"));
    Ok(StlMesh { data, doubt })
}

fn read_binary(bytes: &[u8]) -> Result<MeshData, StlError> {
    // `stl_io` takes files that begin with `solid ` for text.
    let mut bytes = bytes.to_vec();
    bytes[0] = 0;
    let mut file = Cursor::new(bytes);
    let mut welder = Welder::default();
    let unreadable = |facet: usize| StlError::Facet { facet };
    let facets = stl_io::create_stl_reader(&mut file).map_err(|_| unreadable(0))?;
    for (number, facet) in facets.enumerate() {
        let corners = facet.map_err(|_| unreadable(number))?.vertices.map(|v| v.0);
        welder.add(corners).ok_or_else(|| unreadable(number))?;
    }
    Ok(welder.mesh)
}

fn read_text(bytes: &[u8]) -> Result<StlMesh, StlError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = (1..).zip(text.lines()).map(|(n, line)| (n, line.trim())).filter(|(_, line)| !line.is_empty());
    let mut welder = Welder::default();
    while let Some((first, line)) = lines.next() {
        if !begins_with(line, "solid") {
            let what = "outside of a solid, only `solid` can follow; the file is damaged";
            return Err(StlError::Line { line: first, what: what.into() });
        }
        // One solid in the lower case that `stl_io` requires, and its line numbers.
        let mut solid = String::from("solid \n");
        let mut numbers = Vec::new();
        for (number, line) in lines.by_ref() {
            solid.extend(line.chars().map(|c| c.to_ascii_lowercase()).chain(['\n']));
            numbers.push(number);
            if begins_with(line, "endsolid") {
                break;
            }
        }
        read_solid(solid, first, &numbers, &mut welder)?;
    }
    welder.mesh.check()?;
    Ok(StlMesh { data: welder.mesh, doubt: None })
}

fn begins_with(line: &str, word: &str) -> bool {
    line.split_whitespace().next().is_some_and(|first| first.eq_ignore_ascii_case(word))
}

fn read_solid(text: String, first: u32, lines: &[u32], welder: &mut Welder) -> Result<(), StlError> {
    /// Number of lines per facet of a text file: normal, `outer loop`, three corners, `endloop`, `endfacet`.
    const LINES: usize = 7;
    let mut file = Cursor::new(text);
    let fault = |facet: usize, what: String| {
        let line = lines.get(facet * LINES).or(lines.last()).copied().unwrap_or(first);
        StlError::Line { line, what }
    };
    let unreadable = |e: std::io::Error, facet: usize| {
        let reason: String = e.to_string().chars().take(200).collect();
        fault(
            facet,
            format!(
                "this was read as a text STL file, and its next facet is missing or wrong ({reason}); the file is cut off, damaged or of another format"
            ),
        )
    };
    let facets = stl_io::create_stl_reader(&mut file).map_err(|e| unreadable(e, 0))?;
    for (number, facet) in facets.enumerate() {
        let corners = facet.map_err(|e| unreadable(e, number))?.vertices.map(|v| v.0);
        welder
            .add(corners)
            .ok_or_else(|| fault(number, "a corner of this facet is not finite; mend the mesh".into()))?;
    }
    Ok(())
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
