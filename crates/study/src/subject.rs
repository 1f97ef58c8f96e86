//! A scene to be studied, read and ready for rays.

use crate::StudyError;
use crate::digest::Digest;
use dapple_core::{Frame, Limits, Render};
use dapple_job::Stage;
use dapple_job::registry::{self, Setting};
use dapple_renderer::light::LightSelection;
use dapple_renderer::{World, integrator};
use dapple_scene::files::{Disk, Files};
use dapple_scene::pbrt::ReadOptions;
use dapple_scene::{AnyOptions, bundled, read_any_from};
use dapple_scene::{PixelFilter, Scene};
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Which scene, and how it is looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct View {
    /// Its name in the study.
    pub name: String,
    /// Bundled name or path.
    pub source: String,
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Most scattering events between camera and light; `None` follows the scene.
    pub max_depth: Option<u32>,
    /// Whether unsupported directives are warnings.
    pub allow_unsupported: bool,
    /// How a light is chosen among several.
    #[serde(default)]
    pub lights: LightSelection,
}

impl View {
    /// As references are rendered: they do not depend on how lights are chosen, and are shared by all ways to do so.
    pub(crate) fn by_default(&self) -> Self {
        Self { lights: LightSelection::default(), ..self.clone() }
    }
}

/// A scene read and built: with a box of one pixel as its pixel filter, uncropped.
pub struct Subject {
    pub(crate) view: View,
    pub(crate) scene: Scene,
    pub(crate) world: Arc<World>,
    /// Of all bytes that were read for it.
    pub(crate) content: Digest,
    /// Seconds of reading and of building.
    pub(crate) load: f64,
    pub(crate) bvh: f64,
}

/// The scene's own name for itself, from its source: that of the folder for the likes of `scene.pbrt`.
pub(crate) fn name_of(source: &str) -> String {
    let path = Path::new(source);
    let part = |part: Option<&std::ffi::OsStr>| part.map(|p| p.to_string_lossy().into_owned());
    let stem = part(path.file_stem()).unwrap_or_else(|| "scene".into());
    match part(path.parent().and_then(Path::file_name)) {
        Some(folder) if stem.starts_with("scene") => folder,
        _ => stem,
    }
}

/// The bundled scene that a source means: where it is no file's.
fn bundle(source: &str) -> Option<bundled::Bundle> {
    if Path::new(source).is_file() { None } else { bundled::files(source) }
}

impl Subject {
    /// Reads and builds a scene.
    ///
    /// # Errors
    ///
    /// [`StudyError::Scene`] with everything that is wrong with it.
    pub fn load(view: &View) -> Result<Self, StudyError> {
        let clock = Instant::now();
        let (mut scene, content) = read(&view.source, view.allow_unsupported)?;
        if view.max_depth.is_some() {
            scene.max_depth = view.max_depth;
        }
        scene.film.resolution = view.resolution;
        scene.film.crop = None;
        scene.film.pixel_filter = PixelFilter::default();
        let load = clock.elapsed().as_secs_f64();
        let clock = Instant::now();
        let mut world = World::new(&scene).map_err(|e| StudyError::Scene(e.to_string()))?;
        world.set_light_selection(view.lights);
        let bvh = clock.elapsed().as_secs_f64();
        Ok(Self { view: view.clone(), scene, world: Arc::new(world), content, load, bvh })
    }

    /// What was read otherwise than written, a line each; nothing of bundled scenes.
    pub fn notices(&self) -> Vec<String> {
        if bundle(&self.view.source).is_some() {
            return Vec::new();
        }
        self.scene.notices.iter().map(|n| format!("{}: {}", n.source, n.message)).collect()
    }

    /// The whole image.
    pub(crate) fn frame(&self) -> Result<Frame, StudyError> {
        let [w, h] = self.view.resolution;
        Frame::new(w, h).map_err(|e| StudyError::Scene(e.to_string()))
    }

    /// A digest of the few pixels in the middle with a few samples: a renderer whose code has changed what it renders
    /// changes it, whatever its version says.
    pub(crate) fn fingerprint(&self) -> Result<Digest, StudyError> {
        let wrong = |e: &dyn std::fmt::Display| StudyError::Scene(format!("{}: {e}", self.view.name));
        let middle = |side: u32| {
            let first = side.saturating_sub(CANARY_SIDE) / 2;
            (first, side.min(first + CANARY_SIDE))
        };
        let [(x0, x1), (y0, y1)] = self.view.resolution.map(middle);
        let frame = self.frame()?.crop(x0, y0, x1, y1).map_err(|e| wrong(&e))?;
        let setting = Setting { seed: 1, spp: Some(CANARY_SPP) };
        let points = registry::points("random", setting).map_err(|e| wrong(&e))?;
        let mut sampler = registry::sampler("uniform", points, &Stage::empty()).map_err(|e| wrong(&e))?;
        let limits = Limits::samples(CANARY_SPP * frame.pixels() as u64);
        let mut integrator = integrator(&self.world);
        let film = Render::new(frame, &limits).run(&mut *integrator, &mut *sampler).map_err(|e| wrong(&e))?;
        let mut digest = Digest::new();
        film.image().as_flattened().iter().for_each(|v| digest.add(&v.to_bits().to_le_bytes()));
        Ok(digest)
    }
}

/// Pixels along a side, and samples per pixel, of what a fingerprint is taken of: milliseconds.
const CANARY_SIDE: u32 = 32;
const CANARY_SPP: u64 = 4;

/// Reads a scene and digests every byte that was read for it.
fn read(source: &str, allow_unsupported: bool) -> Result<(Scene, Digest), StudyError> {
    let path = Path::new(source);
    let wrong = |e: dapple_scene::pbrt::ReadError| StudyError::Scene(e.to_string());
    if let Some(bundle) = bundle(source) {
        let mut digest = Digest::new();
        for (name, bytes) in &bundle.files {
            digest.text(name);
            digest.add(bytes);
        }
        return Ok((bundle.read().map_err(wrong)?, digest));
    }
    if !path.exists() {
        let known = bundled::names().join(", ");
        let what = format!("{source}: there is no such file, and no such bundled scene: those are {known}");
        return Err(StudyError::Scene(what));
    }
    let files = Recorder::default();
    let options = ReadOptions::default().with_allow_unsupported(allow_unsupported);
    let scene = read_any_from(&files, path, &AnyOptions::default().with_scene(options)).map_err(wrong)?;
    let mut digest = Digest::new();
    for (file, of_bytes) in files.read.into_inner() {
        // Where the scene lies does not matter.
        let folder = path.parent().unwrap_or(Path::new(""));
        digest.text(&file.strip_prefix(folder).unwrap_or(&file).to_string_lossy());
        digest.text(&of_bytes);
    }
    Ok((scene, digest))
}

/// The disk, with a digest of each file read.
#[derive(Default)]
struct Recorder {
    read: RefCell<BTreeMap<PathBuf, String>>,
}

impl Files for Recorder {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let bytes = Disk.read(path)?;
        self.read.borrow_mut().insert(path.to_owned(), Digest::of(&bytes).hex());
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_that_people_use() {
        let cases = [
            ("teapot", "teapot"),
            ("a/b/box.pbrt", "box"),
            ("cornell-box/scene-v4.pbrt", "cornell-box"),
            ("scene.pbrt", "scene"),
            ("../x/model.obj", "model"),
        ];
        for (source, name) in cases {
            assert_eq!(name_of(source), name, "{source}");
        }
    }
}
