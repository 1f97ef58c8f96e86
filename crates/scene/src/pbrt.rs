//! Reads scenes in the format of pbrt-v4 [Pharr et al. 2023; pbrt-v4 input file format], and of pbrt-v3 and v2 [Pharr
//! et al. 2016; 2010] as far as Dapple can render them.
//!
//! [`read_scene`] reads from disk, [`read_scene_from`] from any [`Files`]. Either returns the whole [`Scene`] or every
//! problem found, each with file and line; nothing is left out silently. Deviations from the file (ignored samplers,
//! unknown parameters, features left out by [`ReadOptions::allow_unsupported`]) are listed in [`Scene::notices`].
//!
//! A file is text: directives with their arguments. `directive` splits the text and reads one directive at a time, and
//! `reader` executes each on a graphics state. The other modules interpret each kind of directive. A new directive is a
//! word in `directive::FORMS` and an arm in `Reader::execute`. A new shape, material, texture or light is an arm in its
//! module.
//!
//! Files of pbrt-v2 and pbrt-v3 are read by the rules of their version, which is derived from the directives of the
//! main file (not of included files): see `legacy`. Names of materials, media and objects may be defined after their
//! use, as in pbrt-v4: see `names`.
//!
//! Colours are linear sRGB. A spectrum of a surface or a medium is converted under illuminant D65. In pbrt-v4, a
//! light's spectrum or temperature gives only the light's colour, at luminance 1; `scale`, `power` or `illuminance` set
//! the brightness. In pbrt-v2 and v3 a light's spectrum is converted without scaling. `spectra` lists the named metals
//! and glasses. Cylinders, parts of spheres and disks, curved bilinear patches and subdivision surfaces become
//! triangles, with a notice where that is not exact.
//!
//! A truncated file is detected if something is missing: a value, a bracket, an `AttributeEnd`, the camera, all shapes,
//! all lights, or the line break of the last line. A cut between two directives that leaves a complete scene is not
//! detected.

mod colorimetry;
mod directive;
mod legacy;
mod lights;
mod materials;
mod names;
mod options;
mod params;
mod reader;
mod shapes;
mod spectra;
mod state;
mod subdivide;
mod tessellate;
mod textures;

use crate::files::{Disk, Files};
use crate::readers::SceneReader;
use crate::{Notice, NoticeKind, Problem, ProblemKind, ReadError, Scene, Source};
use std::collections::BTreeMap;
use std::path::Path;

/// Options of the pbrt reader.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// True to leave unsupported features out with a notice, false to report an error. An unknown material becomes
    /// diffuse, an unknown texture grey; other objects are dropped.
    pub allow_unsupported: bool,
    /// The memory in bytes that subdivision surfaces may take; `None` for some 300 MB. More is an error, before it is taken.
    pub memory: Option<u64>,
}

/// Reads a pbrt scene from disk.
///
/// # Errors
/// Returns all problems of the file, each with its line.
pub fn read_scene(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Scene, ReadError> {
    read_scene_from(&Disk, path, options)
}

/// Reads a pbrt scene from `files`. Names of other files are relative to the folder of `path`, even in included files,
/// as in pbrt.
///
/// # Errors
/// Returns all problems of the file, each with its line.
pub fn read_scene_from(
    files: &(impl Files + ?Sized),
    path: impl AsRef<Path>,
    options: &ReadOptions,
) -> Result<Scene, ReadError> {
    reader::Reader::new(&files, path.as_ref(), options).read()
}

/// The reader of pbrt scenes.
pub(crate) const READER: SceneReader = SceneReader {
    name: "pbrt",
    extensions: &["pbrt", ""],
    recognizes: directive::begins_a_scene,
    read: |files, path, options| read_scene_from(files, path, &options.scene),
};

/// The largest number of problems that an error lists; further problems are only counted.
const LISTED_PROBLEMS: usize = 100;
/// The largest number of notices in a scene; further notices are only counted.
const LISTED_NOTICES: usize = 1000;

/// The problems and notices collected while a pbrt scene is read.
#[derive(Debug, Default)]
struct Log {
    problems: Vec<Problem>,
    more: usize,
    /// The listed notices, each with the number of others with the same message.
    notices: Vec<(Notice, usize)>,
    /// The index of the listed notice by its message.
    said: BTreeMap<String, usize>,
    more_notices: usize,
    allow_unsupported: bool,
}

impl Log {
    fn new(allow_unsupported: bool) -> Self {
        Self { allow_unsupported, ..Self::default() }
    }

    fn problem(&mut self, source: &Source, message: impl Into<String>) {
        self.push(source, ProblemKind::Invalid, message.into());
    }

    fn push(&mut self, source: &Source, kind: ProblemKind, message: String) {
        if self.problems.len() < LISTED_PROBLEMS {
            self.problems.push(Problem { source: source.clone(), kind, message });
        } else {
            self.more += 1;
        }
    }

    fn notice(&mut self, source: &Source, message: impl Into<String>) {
        self.push_notice(Notice::warning(source.clone(), message));
    }

    /// Adds a notice of an ignored setting, such as a sampler, which Dapple takes from its user.
    fn ignored_setting(&mut self, source: &Source, message: String) {
        self.push_notice(Notice { source: source.clone(), kind: NoticeKind::IgnoredSetting, message });
    }

    /// Adds a notice. Of those with the same message only the first is listed, and the others are counted.
    fn push_notice(&mut self, notice: Notice) {
        if let Some(&first) = self.said.get(&notice.message) {
            self.notices[first].1 += 1;
        } else if self.notices.len() < LISTED_NOTICES {
            self.said.insert(notice.message.clone(), self.notices.len());
            self.notices.push((notice, 0));
        } else {
            self.more_notices += 1;
        }
    }

    /// Reports a valid but unsupported feature: as a notice if unsupported features may be left out, else as a problem.
    fn unsupported(&mut self, source: &Source, what: &str) {
        if self.allow_unsupported {
            self.notice(source, format!("{what} is not supported; left out"));
        } else {
            self.push(source, ProblemKind::Unsupported, format!("{what} is not supported"));
        }
    }

    fn has_problems(&self) -> bool {
        !self.problems.is_empty()
    }

    fn finish(mut self) -> Result<Vec<Notice>, ReadError> {
        if self.has_problems() {
            return Err(ReadError { problems: self.problems, more: self.more });
        }
        if let (Some((last, _)), more @ 1..) = (self.notices.last(), self.more_notices) {
            let source = last.source.clone();
            self.notices.push((Notice::warning(source, format!("{more} more notices are not listed")), 0));
        }
        let counted = |(notice, count): (Notice, usize)| match count {
            0 => notice,
            _ => Notice { message: notice.message + &format!(" (and {count} more times)"), ..notice },
        };
        Ok(self.notices.into_iter().map(counted).collect())
    }
}
