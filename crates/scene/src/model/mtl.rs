//! Reading of MTL files, the material files of OBJ models.

use std::collections::{BTreeMap, BTreeSet};

/// The contents of an MTL file.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Library {
    /// The materials of the file, by name.
    pub(super) materials: BTreeMap<String, Material>,
    /// Messages on unsupported or corrected statements, each with its line; line 0 is the whole file.
    pub(super) notices: Vec<(u32, String)>,
}

/// The supported statements of one MTL material.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Material {
    /// The diffuse reflectance, statement `Kd`: linear RGB within 0..=1.
    pub(super) diffuse: Option<[f32; 3]>,
    /// The name of an image file, statement `map_Kd`.
    pub(super) texture: Option<String>,
    /// The line of the statement `newmtl` that begins the material.
    pub(super) line: u32,
}

/// Reads an MTL file. Unreadable statements are skipped with a notice, never an error.
pub(super) fn read_mtl(bytes: &[u8]) -> Library {
    let text = String::from_utf8_lossy(bytes);
    let mut library = Library::default();
    // Statements before the first `newmtl` belong to no material.
    let mut ownerless = Material::default();
    let mut name = None;
    let mut unheeded = BTreeSet::new();
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        let keyword = line.split_whitespace().next().unwrap_or("");
        let rest = line[keyword.len()..].trim();
        let numbers: Vec<f64> = rest.split_whitespace().map_while(|w| w.parse().ok()).collect();
        let material = name.as_ref().and_then(|name| library.materials.get_mut(name)).unwrap_or(&mut ownerless);
        match keyword {
            "newmtl" if !rest.is_empty() => {
                library.materials.insert(rest.to_owned(), Material { line: number, ..Material::default() });
                name = Some(rest.to_owned());
            }
            "Kd" => match numbers[..] {
                [r, g, b, ..] if [r, g, b].iter().all(|c| c.is_finite()) => {
                    material.diffuse = Some([r, g, b].map(|c| c.clamp(0.0, 1.0) as f32));
                }
                _ => library.notices.push((number, "Kd needs three numbers; left out".into())),
            },
            "map_Kd" => match file_of(rest) {
                Some(file) => {
                    if rest.starts_with('-') {
                        library.notices.push((number, "the options of map_Kd are not followed".into()));
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
        let what = format!("materials are diffuse, by Kd and map_Kd: {} not followed", unheeded.join(", "));
        library.notices.push((0, what));
    }
    library
}

/// Returns the file name in a texture statement: the last word if options precede it, else the whole argument.
fn file_of(rest: &str) -> Option<&str> {
    let file = if rest.starts_with('-') { rest.split_whitespace().next_back()? } else { rest };
    (!file.is_empty() && !file.starts_with('-')).then_some(file)
}

/// Returns true if an unsupported MTL statement would change the image. The statement is given by its keyword and its
/// numbers.
fn calls_for_more(keyword: &str, numbers: &[f64]) -> bool {
    let first = numbers.first().copied().unwrap_or(0.0);
    match keyword {
        "Ks" | "Ke" | "Tf" => numbers.iter().any(|&c| c != if keyword == "Tf" { 1.0 } else { 0.0 }),
        "d" => first < 1.0,
        "Tr" => first > 0.0,
        "map_Ka" | "map_Ns" => false,
        "bump" | "norm" | "disp" | "decal" | "refl" => true,
        _ => keyword.starts_with("map_"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_is_left_out_and_noted() {
        let text = b"newmtl red\nKd 1 0 0\nKs 0.5 0.5 0.5\nd 1\nillum 2\n\
            newmtl\nnewmtl short\nKd 1 2\nmap_Kd -s 2 2 1 brick wall.png\nmap_Kd\n\
            newmtl a b\nKd nan 0 0\nKd 2 -1 0.5\nmap_Kd wood \xff.png\nd 0.5\nillum x\nNs\n";
        let library = read_mtl(text);
        let material = |name: &str| library.materials[name].clone();
        assert_eq!(material("red"), Material { diffuse: Some([1.0, 0.0, 0.0]), texture: None, line: 1 });
        assert_eq!(material("short"), Material { diffuse: None, texture: Some("wall.png".into()), line: 7 });
        assert_eq!(material("a b").diffuse, Some([1.0, 0.0, 0.5]));
        assert_eq!(material("a b").texture.as_deref(), Some("wood \u{fffd}.png"));
        let lines: Vec<u32> = library.notices.iter().map(|n| n.0).collect();
        assert_eq!(lines, [8, 9, 10, 12, 0]);
        assert!(library.notices[4].1.contains("Ks, d not followed"), "{}", library.notices[4].1);
    }
}
