//! Materials of an OBJ model: its MTL files, and the images that these name.

use super::mtl::{Material as MtlMaterial, read_mtl};
use super::{GREY, add_material};
use crate::files::Files;
use crate::image::{Encoding, Image, read_image};
use crate::{Color, MaterialId, Scene, Source, TextureKind, Wrap};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The materials of an OBJ file: those read from its MTL files, and those added to the scene so far.
#[derive(Default)]
pub(super) struct Materials {
    /// MTL materials by name, each with the path of its file.
    known: BTreeMap<String, (MtlMaterial, Arc<PathBuf>)>,
    made: BTreeMap<Option<String>, MaterialId>,
    images: BTreeMap<PathBuf, Option<Arc<Image>>>,
}

impl Materials {
    pub(super) fn open(&mut self, scene: &mut Scene, name: &str, files: &dyn Files, source: &Source) {
        let path = beside(&source.file, name);
        let bytes = match files.read(&path) {
            Ok(bytes) => bytes,
            Err(e) => {
                scene.warn(source, format!("the materials of {} cannot be read ({e}); grey instead", path.display()));
                return;
            }
        };
        let library = read_mtl(&bytes);
        let file = Arc::new(path);
        for (line, message) in library.notices {
            scene.warn(&Source { file: file.clone(), line }, message);
        }
        for (name, material) in library.materials {
            self.known.insert(name, (material, file.clone()));
        }
    }

    /// Returns the scene's material for the name and line of a `usemtl`, or the default grey for `None`. Adds the
    /// material on its first use.
    pub(super) fn of(
        &mut self,
        scene: &mut Scene,
        asked: Option<&(String, u32)>,
        files: &dyn Files,
        source: &Source,
    ) -> MaterialId {
        let name = asked.map(|(name, _)| name.clone());
        if let Some(id) = self.made.get(&name) {
            return *id;
        }
        let id = match asked {
            None => add_material(scene, "grey", GREY, source),
            Some((name, line)) => match self.known.get(name).cloned() {
                Some((material, file)) => {
                    let source = Source { line: material.line, file };
                    let color = self.color(scene, &material, files, &source);
                    add_material(scene, name, color, &source)
                }
                None => {
                    let source = Source { line: *line, ..source.clone() };
                    scene.warn(&source, format!("unknown material \"{name}\"; grey instead"));
                    add_material(scene, name, GREY, &source)
                }
            },
        };
        self.made.insert(name, id);
        id
    }

    fn color(&mut self, scene: &mut Scene, material: &MtlMaterial, files: &dyn Files, source: &Source) -> Color {
        let flat = material.diffuse.map_or(GREY, Color::Constant);
        let Some(name) = &material.texture else { return flat };
        let Some(image) = self.image(scene, name, files, source) else { return flat };
        // Kd multiplies the image. A missing Kd, or a black one as some programs write, leaves the image unchanged.
        let tint = material.diffuse.filter(|c| *c != [0.0; 3]).unwrap_or([1.0; 3]);
        let even = tint[0] == tint[1] && tint[1] == tint[2];
        let (scale, shift, factor) = ([1.0; 2], [0.0; 2], if even { tint[0] } else { 1.0 });
        let image = TextureKind::Image { image, scale, shift, factor, invert: false, wrap: Wrap::Repeat };
        let image = Color::Texture(scene.add_texture(name, image, source));
        if even {
            return image;
        }
        let product = TextureKind::Product { factors: [Color::Constant(tint), image] };
        Color::Texture(scene.add_texture(name, product, source))
    }

    /// Returns the image of a file; `None`, with a notice, if it cannot be read. Each file is read once.
    fn image(&mut self, scene: &mut Scene, name: &str, files: &dyn Files, source: &Source) -> Option<Arc<Image>> {
        let path = beside(&source.file, name);
        if let Some(known) = self.images.get(&path) {
            return known.clone();
        }
        let bytes = files.read(&path).map_err(|e| format!("{}: {e}", path.display()));
        let read = |bytes: Vec<u8>| {
            let name = path.display().to_string();
            let image = read_image(&bytes, &name, Encoding::Auto).and_then(|p| p.checked_finite(&name));
            image.map_err(|e| e.to_string())
        };
        let image = match bytes.and_then(read) {
            Ok(image) => Some(Arc::new(image)),
            Err(e) => {
                scene.warn(source, format!("the texture cannot be read, Kd stands for it: {e}"));
                None
            }
        };
        self.images.insert(path, image.clone());
        image
    }
}

/// Returns the path of the file `name` relative to the folder of `file`. Accepts backslashes, as Windows writes them.
fn beside(file: &Path, name: &str) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).join(name.replace('\\', "/"))
}
