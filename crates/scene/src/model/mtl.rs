//! Materials of an OBJ model: its MTL files, and the images that these name.

use super::add_material;
use super::obj::{shown, statements};
use crate::files::Files;
use crate::image::{Encoding, Image, read_texture};
use crate::{Color, MaterialId, Scene, Source, TextureKind, text};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The materials of an OBJ file: those read from its MTL files, and those added to the scene so far.
#[derive(Default)]
pub(super) struct Materials {
    /// MTL materials by name, each with the path of its file. If a comment follows a name, the material is stored under the
    /// name with and without the comment.
    known: BTreeMap<String, (Statements, Arc<PathBuf>)>,
    made: BTreeMap<(Option<String>, bool), MaterialId>,
    images: BTreeMap<PathBuf, Option<Arc<Image>>>,
}

impl Materials {
    /// Reads the material files named by a `mtllib`'s argument: one file, whose name may contain blanks, or several.
    pub(super) fn open(&mut self, scene: &mut Scene, argument: &str, files: &dyn Files, source: &Source) {
        let whole = text::names(argument).find_map(|name| self.read(scene, name, files, source).ok());
        if whole.is_none() {
            for name in several(argument) {
                if let Err(what) = self.read(scene, name, files, source) {
                    scene.warn(source, what);
                }
            }
        }
    }

    /// Reads a material file. The error is a message.
    fn read(&mut self, scene: &mut Scene, name: &str, files: &dyn Files, source: &Source) -> Result<(), String> {
        let path = beside(&source.file, name);
        let fault = |e: &dyn Display| format!("the materials of {} cannot be read ({e}); grey is used", path.display());
        let bytes = files.read(&path).map_err(|e| fault(&e))?;
        let library = read_mtl(&text::decode(&bytes).map_err(|e| fault(&e))?);
        let file = Arc::new(path);
        for (line, message) in library.notices {
            scene.warn(&Source { file: file.clone(), line }, message);
        }
        for (name, material) in library.materials {
            if let Some(bare) = text::names(&name).nth(1) {
                self.known.entry(bare.to_owned()).or_insert_with(|| (material.clone(), file.clone()));
            }
            self.known.insert(name, (material, file.clone()));
        }
        Ok(())
    }

    /// Returns the scene's material for the name and line of a `usemtl`, or the default grey for `None`. `is_colored` is true
    /// for a mesh with vertex colours. Adds the material on its first use.
    pub(super) fn of(
        &mut self,
        scene: &mut Scene,
        (asked, is_colored): (Option<&(String, u32)>, bool),
        files: &dyn Files,
        source: &Source,
    ) -> MaterialId {
        let key = (asked.map(|(name, _)| name.clone()), is_colored);
        if let Some(id) = self.made.get(&key) {
            return *id;
        }
        let id = match asked {
            None => add_material(scene, "grey", None, is_colored, source),
            Some((name, line)) => match self.named(name).cloned() {
                Some((material, file)) => {
                    let source = Source { line: material.line, file };
                    let color = self.color(scene, &material, files, &source);
                    add_material(scene, name, color, is_colored, &source)
                }
                None => {
                    let source = Source { line: *line, ..source.clone() };
                    scene.warn(&source, format!("unknown material \"{name}\"; grey is used"));
                    add_material(scene, name, None, is_colored, &source)
                }
            },
        };
        self.made.insert(key, id);
        id
    }

    fn named(&self, name: &str) -> Option<&(Statements, Arc<PathBuf>)> {
        text::names(name).find_map(|name| self.known.get(name))
    }

    /// True if the material of a `usemtl` has an image that was read.
    pub(super) fn is_textured(&self, asked: Option<&(String, u32)>) -> bool {
        let Some((material, file)) = asked.and_then(|(name, _)| self.named(name)) else { return false };
        let image = material.texture.as_ref().and_then(|name| self.images.get(&beside(file, text::name(name))));
        image.is_some_and(Option::is_some)
    }

    /// Returns the colour from `Kd` and `map_Kd`; `None` if the material has neither.
    fn color(&mut self, scene: &mut Scene, material: &Statements, files: &dyn Files, source: &Source) -> Option<Color> {
        let flat = material.diffuse.map(Color::Constant);
        let Some(argument) = &material.texture else { return flat };
        let Some(image) = self.image(scene, argument, files, source) else { return flat };
        // Kd multiplies the image. A missing Kd, or a black one as some programs write, leaves the image unchanged.
        let tint = material.diffuse.filter(|c| *c != [0.0; 3]).unwrap_or([1.0; 3]);
        let even = tint[0] == tint[1] && tint[1] == tint[2];
        let image = TextureKind::image(image, if even { tint[0] } else { 1.0 });
        let image = Color::Texture(scene.add_texture(text::name(argument), image, source));
        if even {
            return Some(image);
        }
        let product = TextureKind::Product { factors: [Color::Constant(tint), image] };
        Some(Color::Texture(scene.add_texture(text::name(argument), product, source)))
    }

    /// Returns the image of the file that an argument names; `None`, with a notice, if it cannot be read. Each file is
    /// read once.
    fn image(&mut self, scene: &mut Scene, argument: &str, files: &dyn Files, source: &Source) -> Option<Arc<Image>> {
        let path = beside(&source.file, text::name(argument));
        if let Some(known) = self.images.get(&path) {
            return known.clone();
        }
        let other = || text::names(argument).skip(1).find_map(|name| files.read(&beside(&source.file, name)).ok());
        let bytes = files.read(&path).or_else(|e| other().ok_or(e)).map_err(|e| format!("{}: {e}", path.display()));
        let read = |bytes: Vec<u8>| {
            let name = path.display().to_string();
            read_texture(&bytes, &name, Encoding::Auto).map_err(|e| e.to_string())
        };
        let image = match bytes.and_then(read) {
            Ok((image, notices)) => {
                notices.into_iter().for_each(|notice| scene.warn(source, notice));
                Some(Arc::new(image))
            }
            Err(e) => {
                scene.warn(source, format!("the texture cannot be read, so Kd is used instead: {e}"));
                None
            }
        };
        self.images.insert(path, image.clone());
        image
    }
}

/// The largest number of material files that one statement names.
const MOST_LIBRARIES: usize = 64;

/// The names in the argument of a `mtllib` with several files. A name is in quotes, ends with a word that ends in `.mtl`, or
/// is a single word. A comment ends the list.
fn several(argument: &str) -> Vec<&str> {
    let mut names = Vec::new();
    let mut rest = argument.trim_start();
    while !rest.is_empty() && !rest.starts_with('#') {
        if names.len() == MOST_LIBRARIES {
            // Reported as a file that is not found.
            names.push(rest);
            break;
        }
        let quoted = rest.strip_prefix('"').and_then(|rest| rest.split_once('"'));
        let (name, after) = quoted.unwrap_or_else(|| {
            let is_end = |at: usize| rest[at..].chars().next().is_none_or(char::is_whitespace);
            let suffixes = rest.as_bytes().windows(4).enumerate().filter(|(_, w)| w.eq_ignore_ascii_case(b".mtl"));
            let end = suffixes.map(|(at, _)| at + 4).find(|&end| is_end(end));
            rest.split_at(end.or_else(|| rest.find(char::is_whitespace)).unwrap_or(rest.len()))
        });
        names.push(name);
        rest = after.trim_start();
    }
    names
}

/// Returns the path of the file `name` relative to the folder of `file`. Accepts backslashes, as Windows writes them.
fn beside(file: &Path, name: &str) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).join(name.replace('\\', "/"))
}

/// The contents of an MTL file.
#[derive(Clone, Debug, Default, PartialEq)]
struct Library {
    /// The materials of the file, by name.
    materials: BTreeMap<String, Statements>,
    /// Messages on unsupported or corrected statements, each with its line; line 0 is the whole file.
    notices: Vec<(u32, String)>,
}

/// The supported statements of one MTL material.
#[derive(Clone, Debug, Default, PartialEq)]
struct Statements {
    /// The diffuse reflectance, statement `Kd`: linear RGB within 0..=1.
    diffuse: Option<[f32; 3]>,
    /// The name of an image file, statement `map_Kd`.
    texture: Option<String>,
    /// The line of the statement `newmtl` that begins the material.
    line: u32,
}

/// Reads an MTL file. Unreadable statements are skipped with a notice, never an error.
fn read_mtl(text: &str) -> Library {
    let mut library = Library::default();
    // Statements before the first `newmtl` belong to no material.
    let mut ownerless = Statements::default();
    let mut name = None;
    let mut unheeded = BTreeSet::new();
    for (number, statement) in statements(text) {
        let line = statement.trim();
        let keyword = line.split_whitespace().next().unwrap_or("");
        let rest = line[keyword.len()..].trim();
        let numbers: Vec<f64> = rest.split_whitespace().map_while(text::number).collect();
        let material = name.as_ref().and_then(|name| library.materials.get_mut(name)).unwrap_or(&mut ownerless);
        match keyword {
            "newmtl" => {
                let given = text::name(rest).to_owned();
                name = (!given.is_empty()).then(|| given.clone());
                if given.is_empty() {
                    library.notices.push((number, "newmtl has no name; its material is left out".into()));
                } else if library
                    .materials
                    .insert(given.clone(), Statements { line: number, ..Statements::default() })
                    .is_some()
                {
                    library.notices.push((number, format!("material \"{given}\" is defined twice; the last is used")));
                }
            }
            "Kd" => match diffuse(rest) {
                Some(color) => {
                    material.diffuse = Some(color.map(|c| c.clamp(0.0, 1.0) as f32));
                    if color.iter().any(|c| !(0.0..=1.0).contains(c)) {
                        library
                            .notices
                            .push((number, format!("Kd {} is outside of 0 to 1 and is clamped", shown(rest))));
                    }
                }
                None => library
                    .notices
                    .push((number, format!("Kd needs one or three numbers, not \"{}\"; left out", shown(rest)))),
            },
            "map_Kd" => match file_of(rest) {
                Some(file) => {
                    if rest.starts_with('-') {
                        library.notices.push((number, "the options of map_Kd are ignored".into()));
                    }
                    material.texture = Some(file.to_owned());
                }
                None => library.notices.push((number, "map_Kd names no file; left out".into())),
            },
            _ => {
                if calls_for_more(keyword, &numbers) {
                    unheeded.insert(keyword.to_owned());
                }
            }
        }
    }
    if !unheeded.is_empty() {
        let unheeded: Vec<String> = unheeded.into_iter().take(12).collect();
        let what = format!("materials are diffuse, by Kd and map_Kd; {} ignored", unheeded.join(", "));
        library.notices.push((0, what));
    }
    library
}

/// The colour in the argument of `Kd`: three finite numbers, or one for all three. Words after three numbers are ignored.
fn diffuse(argument: &str) -> Option<[f64; 3]> {
    let words = argument.split('#').next().unwrap_or("").split_whitespace().take(3);
    match words.map(|word| text::number::<f64>(word).filter(|c| c.is_finite())).collect::<Option<Vec<_>>>()?[..] {
        [grey] => Some([grey; 3]),
        [r, g, b] => Some([r, g, b]),
        _ => None,
    }
}

/// Returns the file name in a texture statement: the text after its options. A file name may contain blanks.
fn file_of<'t>(mut rest: &'t str) -> Option<&'t str> {
    // The first word, and the text after it.
    let first = |rest: &'t str| rest.split_at(rest.find(char::is_whitespace).unwrap_or(rest.len()));
    while rest.starts_with('-') {
        let (option, values) = first(rest);
        let most = match option {
            "-o" | "-s" | "-t" => 3,
            "-mm" => 2,
            _ => 1,
        };
        rest = values.trim_start();
        for _ in 0..most {
            let (value, after) = first(rest);
            if most == 1 || text::number::<f64>(value).is_some() {
                rest = after.trim_start();
            }
        }
    }
    (!rest.is_empty()).then_some(rest)
}

/// Returns true if an unsupported MTL statement would change the image, or is unknown. `numbers` are the statement's
/// arguments.
fn calls_for_more(keyword: &str, numbers: &[f64]) -> bool {
    let first = numbers.first().copied().unwrap_or(0.0);
    match keyword {
        "Ks" | "Ke" | "Tf" => numbers.iter().any(|&c| c != if keyword == "Tf" { 1.0 } else { 0.0 }),
        "d" => first < 1.0,
        "Tr" => first > 0.0,
        // Illumination models with mirror reflection or transmission.
        "illum" => first >= 3.0,
        "Pm" | "Ps" | "Pc" | "aniso" => first != 0.0,
        "Pr" => first != 1.0,
        // Ambient light is traced. Shininess and refraction matter only with Ks and d, which are reported.
        "" | "newmtl" | "Ka" | "map_Ka" | "Ns" | "map_Ns" | "Ni" | "Km" | "sharpness" | "Pcr" | "anisor" => false,
        _ => !keyword.starts_with('#'),
    }
}
