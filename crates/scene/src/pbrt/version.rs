//! Detection of the pbrt version that a file was written for.

use super::tokens::{Kind, Tokens};

/// A version of the pbrt file format, which decides the meaning of directives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Version {
    V2,
    V3,
    #[default]
    V4,
}

/// Material types of pbrt-v2 or v3 that pbrt-v4 no longer has.
const OLD_MATERIALS: &[&str] = &[
    "disney",
    "fourier",
    "glass",
    "kdsubsurface",
    "matte",
    "metal",
    "mirror",
    "plastic",
    "shinymetal",
    "substrate",
    "translucent",
    "uber",
];

/// Material types that pbrt-v4 introduced.
const NEW_MATERIALS: &[&str] = &[
    "coatedconductor",
    "coateddiffuse",
    "conductor",
    "dielectric",
    "diffuse",
    "diffusetransmission",
    "interface",
    "thindielectric",
];

/// Flags for directives and types, found in a file, that identify a pbrt version.
#[derive(Default)]
struct Marks {
    new: bool,
    old: bool,
    /// True after a directive that only pbrt-v2 has.
    second: bool,
    /// True after a directive that pbrt-v3 and later have.
    third: bool,
}

impl Version {
    /// Returns the pbrt version of a file, derived from its directives and types, since files do not state it.
    ///
    /// A directive or type that only pbrt-v4 has identifies pbrt-v4, as does the lack of any that only older versions
    /// have. Otherwise an `Integrator` or a medium, without a directive of pbrt-v2 alone, identifies pbrt-v3. All other
    /// files are pbrt-v2.
    pub(super) fn of(text: &str) -> Self {
        let mut marks = Marks::default();
        let mut tokens = Tokens::new(text);
        let mut word = "";
        // The index of the current string after `word`, and the string before it.
        let (mut place, mut before) = (0, "");
        while let Some(token) = tokens.next() {
            let Ok(token) = token else { continue };
            match token.kind {
                Kind::Word if token.is_name() => {
                    (word, place, before) = (token.text, 0, "");
                    marks.meet_word(word);
                }
                Kind::Text => {
                    marks.meet_text(word, place, before, token.text);
                    place += 1;
                    before = token.text;
                }
                _ => {}
            }
        }
        match marks {
            Marks { new: true, .. } | Marks { old: false, .. } => Self::V4,
            Marks { second: false, third: true, .. } => Self::V3,
            _ => Self::V2,
        }
    }

    /// Returns true for versions before pbrt-v4.
    pub(super) fn is_old(self) -> bool {
        self < Self::V4
    }

    /// Returns the name of the version, such as "pbrt-v3", for messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::V2 => "pbrt-v2",
            Self::V3 => "pbrt-v3",
            Self::V4 => "pbrt-v4",
        }
    }
}

impl Marks {
    fn meet_word(&mut self, word: &str) {
        match word {
            "Attribute" | "ColorSpace" | "Import" | "Option" => self.new = true,
            "WorldEnd" => self.old = true,
            "Renderer" | "SurfaceIntegrator" | "VolumeIntegrator" | "Volume" => {
                self.old = true;
                self.second = true;
            }
            "Integrator" | "MakeNamedMedium" | "MediumInterface" => self.third = true,
            _ => {}
        }
    }

    fn meet_text(&mut self, word: &str, place: usize, before: &str, text: &str) {
        let material = (word == "Material" && place == 0)
            || (word == "MakeNamedMaterial" && before.split_ascii_whitespace().eq(["string", "type"]));
        if material {
            self.new |= NEW_MATERIALS.contains(&text);
            self.old |= OLD_MATERIALS.contains(&text);
        }
        match (word, place, text) {
            ("Film", 0, "rgb" | "gbuffer" | "spectral") => self.new = true,
            ("Sampler", 0, "independent" | "paddedsobol" | "pmj02bn" | "zsobol") => self.new = true,
            ("Film", 0, "image") | ("AreaLightSource", 0, "area") | ("Texture", 1, "color") => self.old = true,
            // The types in declarations of parameters.
            (_, 1.., _) => {
                let mut parts = text.split_ascii_whitespace();
                let ty = parts.next().filter(|_| parts.next().is_some() && parts.next().is_none());
                self.old |= matches!(ty, Some("color" | "xyz" | "point" | "vector"));
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_by_their_words() {
        for (text, version) in [
            ("Film \"image\"\nWorldBegin\nMaterial \"matte\"\nWorldEnd", Version::V2),
            ("Integrator \"path\"\nWorldBegin\nMaterial \"matte\" \"color Kd\" [1 1 1]", Version::V3),
            ("Integrator \"path\"\nFilm \"rgb\"\nWorldBegin\nMaterial \"diffuse\"", Version::V4),
            ("SurfaceIntegrator \"path\"", Version::V2),
            ("MakeNamedMaterial \"m\" \"string type\" [\"uber\"] MakeNamedMedium \"x\"", Version::V3),
            // One mark of the newest version outweighs the older ones.
            ("Film \"rgb\"\nWorldBegin\nMaterial \"matte\"\nWorldEnd", Version::V4),
            ("MakeNamedMaterial \"matte\" \"string type\" [\"diffuse\"]", Version::V4),
            ("MakeNamedMaterial \"matte\"", Version::V4),
            ("", Version::V4),
            ("\"unclosed\nFilm \"image\"", Version::V2),
        ] {
            assert_eq!(Version::of(text), version, "{text}");
        }
    }
}
