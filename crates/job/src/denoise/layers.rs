//! The names that renderers give to layers, and the search for them.

use super::DenoiseError;
use dapple_core::options::nearest_name;
use dapple_scene::image::{Channels, Plane};
use std::path::Path;

/// The kinds of layers that denoising reads.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LayerKind {
    /// The noisy image.
    Color,
    /// The variance of one sample.
    Variance,
    /// The variance of the pixel's mean.
    MeanVariance,
    /// The mean of the squares of samples.
    SecondMoment,
    /// Samples per pixel.
    Count,
    /// Shading normals.
    Normal,
    /// Albedo.
    Albedo,
    /// Positions.
    Position,
    /// Depth.
    Depth,
    /// The share of the samples that hit a surface.
    Coverage,
    /// The emission of light sources seen directly.
    Emission,
    /// Ids of objects, materials or clusters.
    Id,
}

use LayerKind::{
    Albedo, Color, Count, Coverage, Depth, Emission, Id, MeanVariance, Normal, Position, SecondMoment, Variance,
};

/// Every kind of layer with the names under which it is found, best first. Case does not matter, and a name may follow
/// others and a dot, as in `ViewLayer.Combined`. The empty name is `R`, `G`, `B` without a layer.
///
/// | renderer | names |
/// |---|---|
/// | Dapple | `unfiltered`, `variance`, `count`, `normal`, `albedo`, `depth`, `coverage`, `cluster` |
/// | pbrt-v4 (`gbuffer`) | `Variance`, `Ns`, `N`, `Albedo`, `P` |
/// | Cycles | `Noisy Image`, `Combined`, `Debug Sample Count`, `Denoising …`, `Normal`, `DiffCol`, `Position`, `Depth`, `Emit` |
/// | Mitsuba 3 | `m2_…`, `sh_normal`, `nn`, `albedo`, `position`, `pp`, `dd`, and others: names are the user's |
/// | Arnold | `RGBA`, `variance`, `N`, `denoise_albedo`, `diffuse_albedo`, `P`, `Z` |
/// | RenderMan | `mse` |
pub const KNOWN_LAYERS: &[(LayerKind, &str, &[&str])] = &[
    (Color, "color", &["unfiltered", "noisy image", "", "combined", "rgba", "beauty", "color", "image"]),
    (Variance, "variance", &["variance"]),
    (MeanVariance, "variance-of-mean", &["mse", "variance_of_mean"]),
    (SecondMoment, "second-moment", &[]),
    (Count, "count", &["count", "debug sample count", "sample_count", "samples", "spp"]),
    (
        Normal,
        "normal",
        &["denoising normal", "normal", "ns", "sh_normal", "shading_normal", "n", "nn", "normals", "geo_normal"],
    ),
    (
        Albedo,
        "albedo",
        &["denoising albedo", "albedo", "denoise_albedo", "diffuse_albedo", "diffcol", "base_color", "basecolor"],
    ),
    (Position, "position", &["position", "p", "pp", "pos", "world_position"]),
    (Depth, "depth", &["denoising depth", "depth", "z", "dd"]),
    (Coverage, "coverage", &["coverage"]),
    (Emission, "emission", &["emission", "emit"]),
    (Id, "id", &["cluster"]),
];

impl LayerKind {
    /// The name of the kind in arguments and messages.
    pub fn name(self) -> &'static str {
        KNOWN_LAYERS.iter().find(|(kind, ..)| *kind == self).map_or("", |(_, name, _)| name)
    }

    /// Iterates over all kinds.
    pub fn all() -> impl Iterator<Item = Self> {
        KNOWN_LAYERS.iter().map(|(kind, ..)| *kind)
    }

    /// True for layers of one channel.
    const fn is_scalar(self) -> bool {
        matches!(self, Count | Depth | Coverage | Id)
    }
}

impl std::str::FromStr for LayerKind {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::all().find(|kind| kind.name() == name).ok_or_else(|| {
            let names: Vec<&str> = Self::all().map(Self::name).collect();
            format!("there is no kind of layer \"{name}\"; choose among {}", names.join(", "))
        })
    }
}

/// A layer that was found: its name, and its one or three channels as indices.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) kind: LayerKind,
    pub(super) name: String,
    pub(super) channels: Vec<usize>,
}

/// The letters of three channels.
const THREE: [[&str; 3]; 2] = [["r", "g", "b"], ["x", "y", "z"]];

/// A layer name, and its channels: the letter in lower case, and the channel's index.
type Group = (String, Vec<(String, usize)>);

/// The channels of a file, grouped by layer.
pub(super) struct Layers {
    groups: Vec<Group>,
}

impl Layers {
    /// Groups channels by the part of their names before the last dot. `Nx`, `Ny`, `Nz` make a layer, too.
    pub(super) fn of(file: &Channels) -> Self {
        let names: Vec<&str> = file.channels.iter().map(|(name, _)| name.as_str()).collect();
        let mut groups: Vec<Group> = Vec::new();
        for (index, name) in names.iter().enumerate() {
            let without_dot = || without_dot(name, &names);
            let (layer, letter) = name.rsplit_once('.').unwrap_or_else(|| name.split_at(without_dot().len()));
            let (layer, letter) = (layer.to_owned(), letter.to_lowercase());
            match groups.iter_mut().find(|(known, _)| *known == layer) {
                Some((_, channels)) => channels.push((letter, index)),
                None => groups.push((layer, vec![(letter, index)])),
            }
        }
        Self { groups }
    }

    /// The names of all layers, for messages. Channels without a layer are listed by themselves.
    pub(super) fn names(&self) -> Vec<String> {
        let name = |(layer, channels): &Group| match layer.as_str() {
            "" => channels.iter().map(|(letter, _)| letter.to_uppercase()).collect::<Vec<_>>(),
            _ => vec![layer.clone()],
        };
        self.groups.iter().flat_map(name).collect()
    }

    /// Finds the layer of a kind by its known names.
    pub(super) fn find(&self, kind: LayerKind) -> Option<Found> {
        let names = KNOWN_LAYERS.iter().find(|(known, ..)| *known == kind)?.2;
        if kind == SecondMoment {
            let of_image = |(layer, _): &&Group| {
                first_moment_of(layer).is_some_and(|first| self.named(&first).is_some() && !is_feature(&first))
            };
            return self.groups.iter().filter(of_image).find_map(|group| found(kind, group));
        }
        names.iter().find_map(|name| self.known(kind, name))
    }

    fn known(&self, kind: LayerKind, name: &str) -> Option<Found> {
        let is = |layer: &str| {
            let layer = layer.to_lowercase();
            first_moment_of(&layer).is_none()
                && (layer == name || (!name.is_empty() && layer.ends_with(&format!(".{name}"))))
        };
        let groups = self.groups.iter().filter(|(layer, _)| is(layer));
        groups.filter_map(|group| found(kind, group)).next().or_else(|| self.lone(kind, name))
    }

    /// A channel without a layer, such as `Z`.
    fn lone(&self, kind: LayerKind, name: &str) -> Option<Found> {
        let (_, channels) = self.groups.iter().find(|(layer, _)| layer.is_empty())?;
        let (letter, index) = channels.iter().find(|(letter, _)| letter == name)?;
        kind.is_scalar().then(|| Found { kind, name: letter.to_uppercase(), channels: vec![*index] })
    }

    fn named(&self, name: &str) -> Option<&Group> {
        let exact = self.groups.iter().find(|(layer, _)| layer == name);
        exact.or_else(|| self.groups.iter().find(|(layer, _)| layer.eq_ignore_ascii_case(name)))
    }

    /// Finds the layer that the caller names.
    pub(super) fn given(&self, kind: LayerKind, name: &str, path: &Path) -> Result<Found, DenoiseError> {
        let lower = name.to_lowercase();
        if let Some(found) = self.named(name).and_then(|group| found(kind, group)).or_else(|| self.lone(kind, &lower)) {
            return Ok(found);
        }
        let layers = self.names();
        let near = nearest_name(name, layers.iter().map(String::as_str)).map(str::to_owned);
        Err(DenoiseError::NoLayer { path: path.to_owned(), kind, name: name.to_owned(), near, layers })
    }

    /// The channels of the mean to which a layer of second moments belongs: `path.X` for `m2_path.X`.
    pub(super) fn first_moment(&self, second: &Found) -> Option<Vec<usize>> {
        let group = self.named(&first_moment_of(&second.name)?)?;
        Some(found(SecondMoment, group)?.channels)
    }

    /// The layer of second moments that belongs to this layer.
    pub(super) fn second_moment(&self, first: &Found) -> Option<Found> {
        let is = |(layer, _): &&Group| first_moment_of(layer).is_some_and(|mean| mean == first.name);
        found(first.kind, self.groups.iter().find(is)?).filter(|second| second.channels.len() == first.channels.len())
    }

    /// True if the layer holds X, Y and Z rather than R, G and B.
    pub(super) fn is_xyz(&self, layer: &Found) -> bool {
        self.named(&layer.name).is_some_and(|(_, channels)| channels.iter().any(|(letter, _)| letter == "x"))
    }
}

/// The name of the mean to a layer of second moments: `a.nested` for `m2_a.nested` or `a.m2_nested`.
fn first_moment_of(layer: &str) -> Option<String> {
    let within = layer.rsplit_once(".m2_").map(|(path, name)| format!("{path}.{name}"));
    layer.strip_prefix("m2_").map(str::to_owned).or(within)
}

/// Returns true for the names of features, of which a file may hold second moments, too.
fn is_feature(layer: &str) -> bool {
    let name = layer.rsplit_once('.').map_or(layer, |(_, name)| name).to_lowercase();
    let kinds = KNOWN_LAYERS.iter().filter(|(kind, ..)| [Normal, Albedo, Position, Depth, Emission].contains(kind));
    kinds.flat_map(|(.., names)| *names).any(|known| *known == name)
}

/// The layer of a channel without a dot: `N` for `Nx`, if `Ny` and `Nz` exist.
fn without_dot<'n>(name: &'n str, names: &[&str]) -> &'n str {
    let whole = |stem: &&str| ["x", "y", "z"].iter().all(|letter| names.contains(&format!("{stem}{letter}").as_str()));
    name.strip_suffix(['x', 'y', 'z']).filter(|stem| !stem.is_empty()).filter(whole).unwrap_or_default()
}

/// The channels of a group as a layer of this kind.
fn found(kind: LayerKind, (layer, channels): &Group) -> Option<Found> {
    let of = |letter: &str| channels.iter().find(|(own, _)| own == letter).map(|(_, index)| *index);
    let channels = if kind.is_scalar() {
        let one = ["y", "z", "t", "v", "x", "r", "depth"].iter().find_map(|letter| of(letter));
        one.filter(|_| !layer.is_empty()).map(|index| vec![index])
    } else {
        THREE.iter().find_map(|letters| letters.iter().map(|letter| of(letter)).collect())
    };
    channels.map(|channels| Found { kind, name: layer.clone(), channels })
}

/// The values of one channel as floats.
pub(super) fn floats(plane: &Plane<'_>) -> Vec<f32> {
    match plane {
        Plane::F32(values) | Plane::F16(values) => values.to_vec(),
        Plane::U32(values) => values.iter().map(|&v| v as f32).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(names: &[&str]) -> Layers {
        let channels = names.iter().map(|name| ((*name).to_owned(), Plane::from(vec![0.0_f32]))).collect();
        Layers::of(&Channels { size: [1, 1], channels })
    }

    /// The layer and the channels that are found for a kind, as `NAME:0,1,2`.
    fn shown(names: &[&str], kind: LayerKind) -> Option<String> {
        let found = layers(names).find(kind)?;
        let channels: Vec<String> = found.channels.iter().map(usize::to_string).collect();
        Some(format!("{}:{}", found.name, channels.join(",")))
    }

    #[test]
    fn layers_are_found_by_their_known_names_best_first() {
        let cases: [(&[&str], LayerKind, Option<&str>); 17] = [
            (&["B", "G", "R"], Color, Some(":2,1,0")),
            (&["B", "G", "R", "unfiltered.B", "unfiltered.G", "unfiltered.R"], Color, Some("unfiltered:5,4,3")),
            (&["V.Combined.R", "V.Combined.G", "V.Combined.B"], Color, Some("V.Combined:0,1,2")),
            (&["img.R", "img.G"], Color, None),
            (&["RelativeVariance.R", "RelativeVariance.G", "RelativeVariance.B"], Variance, None),
            (&["VARIANCE.r", "VARIANCE.g", "VARIANCE.b"], Variance, Some("VARIANCE:0,1,2")),
            (&["N.X", "N.Y", "N.Z", "Ns.X", "Ns.Y", "Ns.Z"], Normal, Some("Ns:3,4,5")),
            (&["Nx", "Ny", "Nz"], Normal, Some("N:0,1,2")),
            (&["Nx", "Ny"], Normal, None),
            (&["P.X", "P.Y", "P.Z"], Depth, None),
            (&["Z"], Depth, Some("Z:0")),
            (&["A.Depth.Z", "A.Denoising Depth.Z"], Depth, Some("A.Denoising Depth:1")),
            (&["m2_a.X", "m2_a.Y", "m2_a.Z", "a.X", "a.Y", "a.Z"], SecondMoment, Some("m2_a:0,1,2")),
            (&["i.m2_a.X", "i.m2_a.Y", "i.m2_a.Z", "i.a.X", "i.a.Y", "i.a.Z"], SecondMoment, Some("i.m2_a:0,1,2")),
            (&["m2_nn.X", "m2_nn.Y", "m2_nn.Z", "nn.X", "nn.Y", "nn.Z"], SecondMoment, None),
            (&["a.m2_nn.X", "a.m2_nn.Y", "a.m2_nn.Z", "nn.X", "nn.Y", "nn.Z"], Normal, Some("nn:3,4,5")),
            (&["m2_albedo.R", "m2_albedo.G", "m2_albedo.B"], Albedo, None),
        ];
        for (names, kind, expected) in cases {
            assert_eq!(shown(names, kind).as_deref(), expected, "{kind:?} in {names:?}");
        }
    }

    #[test]
    fn names_of_the_caller_are_exact_or_but_for_case() {
        let found = layers(&["a.N.X", "a.N.Y", "a.N.Z", "Z"]);
        let path = Path::new("a.exr");
        assert_eq!(found.given(Normal, "A.n", path).map(|f| f.channels).ok(), Some(vec![0, 1, 2]));
        assert_eq!(found.given(Depth, "z", path).map(|f| f.channels).ok(), Some(vec![3]));
        let message = found.given(Normal, "a.M", path).unwrap_err().to_string();
        assert_eq!(message, "a.exr: it has no layer \"a.M\" for normal; did you mean \"a.N\"? its layers are a.N, Z");
    }

    #[test]
    fn kinds_are_parsed_by_their_names() {
        assert!(LayerKind::all().all(|kind| kind.name().parse() == Ok(kind)));
        assert!("colour".parse::<LayerKind>().unwrap_err().contains("choose among color, variance"));
    }
}
