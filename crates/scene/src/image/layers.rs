//! Layers of OpenEXR files: channels that share a name, and the names that renderers give them.
//!
//! A layer's place is its part, its view layer and its view: `Front.Normal.left.X` is channel `X` of layer `Normal` in view
//! layer `Front`, as the left eye sees it. [`Layers::image`] chooses an image; [`Layers::guide`] finds other layers at the
//! same place.

mod choice;
mod places;

pub use choice::{ChosenImage, NoImage, Purpose};

use super::ExrPart;

/// The kinds of layers that are found by their names.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LayerKind {
    /// The image; for denoising, the noisy one.
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
    /// The fraction of the samples that hit a surface.
    Coverage,
    /// The emission of light sources seen directly.
    Emission,
    /// Ids of objects, materials or clusters.
    Id,
}

use LayerKind::{
    Albedo, Color, Count, Coverage, Depth, Emission, Id, MeanVariance, Normal, Position, SecondMoment, Variance,
};

/// Names of noisy images that renderers write beside the denoised image.
const NOISY: [&str; 2] = ["unfiltered", "noisy image"];

/// Every kind of layer, its name in arguments, and the names of its layers in files, best first. Case does not matter. The
/// empty name stands for the channels `R`, `G`, `B` (or `Y`) outside of any layer.
///
/// | renderer | names |
/// |---|---|
/// | Dapple | `unfiltered`, `variance`, `count`, `normal`, `albedo`, `depth`, `coverage`, `cluster` |
/// | pbrt-v4 (`gbuffer`) | `Variance`, `Ns`, `N`, `Albedo`, `P` |
/// | Cycles | `Noisy Image`, `Combined`, `Debug Sample Count`, `Denoising …`, `Normal`, `DiffCol`, `Position`, `Depth`, `Emit` |
/// | Mitsuba 3 | `m2_…`, `sh_normal`, `nn`, `albedo`, `position`, `pp`, `dd`, and others: names are the user's |
/// | Arnold | `RGBA`, `variance`, `N`, `denoise_albedo`, `diffuse_albedo`, `P`, `Z` |
/// | RenderMan | `Ci`, `mse` |
/// | Houdini | `C` |
pub const KNOWN_LAYERS: &[(LayerKind, &str, &[&str])] = &[
    (Color, "color", &[NOISY[0], NOISY[1], "", "combined", "rgba", "rgb", "beauty", "color", "image", "c", "ci"]),
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

    fn names(self) -> &'static [&'static str] {
        KNOWN_LAYERS.iter().find(|(kind, ..)| *kind == self).map_or(&[], |(.., names)| names)
    }

    /// True for layers of one channel.
    const fn is_scalar(self) -> bool {
        matches!(self, Count | Depth | Coverage | Id)
    }

    /// The channels that a layer of this kind needs, for messages.
    pub const fn channels(self) -> &'static str {
        match self {
            _ if self.is_scalar() => "one channel",
            Normal | Position => "X, Y, Z or R, G, B",
            _ => "R, G, B, or red, green, blue, or one channel",
        }
    }
}

impl std::str::FromStr for LayerKind {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::all().find(|kind| kind.name() == name).ok_or_else(|| {
            let names: Vec<&str> = Self::all().map(Self::name).collect();
            format!("unknown kind of layer \"{name}\"; choose among {}", names.join(", "))
        })
    }
}

/// A layer that was found: its name, and its one or three channels.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundLayer {
    /// The kind.
    pub kind: LayerKind,
    /// The name in the file; empty for `R`, `G`, `B` without a layer.
    pub name: String,
    /// The index, from 0, of the part of the OpenEXR file that holds the layer.
    pub part: usize,
    /// The view; empty in files without views.
    pub view: String,
    /// Indices of the channels in the part; three equal indices for a gray image.
    pub channels: Vec<usize>,
    group: usize,
}

impl FoundLayer {
    /// The name for messages, such as `albedo`, or `R, G, B` without a layer.
    pub fn shown(&self) -> String {
        match (self.name.as_str(), &self.channels[..]) {
            ("", [first, second, _]) if first == second => "Y".to_owned(),
            ("", _) => "R, G, B".to_owned(),
            _ => self.name.clone(),
        }
    }
}

/// The channels of a file that share part, layer name and view.
struct Group {
    part: usize,
    /// The layer's name in the file, after the name of its part if the file has several parts.
    name: String,
    view: String,
    view_layer: Vec<String>,
    /// The last component of the name without the view; empty for channels without a layer.
    pass: String,
    /// The letter of each channel in lower case, and its index in the part.
    channels: Vec<(String, usize)>,
}

/// The channels of a file, grouped by part, layer and view.
pub struct Layers {
    groups: Vec<Group>,
    /// All views, the default one first.
    views: Vec<String>,
}

/// The channel names of a colour.
const RGB: [[&str; 3]; 2] = [["r", "g", "b"], ["red", "green", "blue"]];
const XYZ: [&str; 3] = ["x", "y", "z"];

impl Group {
    fn channel(&self, letter: &str) -> Option<usize> {
        self.channels.iter().find(|(own, _)| own == letter).map(|(_, index)| *index)
    }

    fn three(&self, letters: [&str; 3]) -> Option<Vec<usize>> {
        letters.iter().map(|letter| self.channel(letter)).collect()
    }

    fn alpha(&self) -> Option<usize> {
        self.channel("a").or_else(|| self.channel("alpha"))
    }

    /// The channels of an image: three colours, or grey.
    fn image(&self) -> Option<Vec<usize>> {
        let is_tristimulus = || XYZ.iter().all(|letter| self.channel(letter).is_some());
        let has_chroma = || self.channel("ry").or_else(|| self.channel("by")).is_some();
        let grey = || self.channel("y").filter(|_| !is_tristimulus() && !has_chroma()).map(|index| vec![index; 3]);
        RGB.iter().find_map(|letters| self.three(*letters)).or_else(grey)
    }

    fn is_grey(&self) -> bool {
        self.image().is_some_and(|channels| channels[0] == channels[1])
    }

    /// The channels of the group as a layer of this kind.
    fn channels_of(&self, kind: LayerKind) -> Option<Vec<usize>> {
        let colors = || RGB.iter().find_map(|letters| self.three(*letters));
        let only = || match &self.channels[..] {
            [(_, index)] => Some(*index),
            [(_, index), (a, _)] | [(a, _), (_, index)] if a == "a" || a == "alpha" => Some(*index),
            _ => None,
        };
        let named = !self.pass.is_empty();
        let grey = || only().filter(|_| named).map(|index| vec![index; 3]);
        match kind {
            Color => self.image().or_else(|| self.three(XYZ)).or_else(grey),
            Normal | Position => colors().or_else(|| self.three(XYZ)),
            Count | Depth | Coverage | Id => {
                let known = || ["y", "z", "t", "v", "x", "r", "red", "depth"].iter().find_map(|l| self.channel(l));
                known().or_else(only).filter(|_| named).map(|index| vec![index])
            }
            _ => colors().or_else(|| self.three(XYZ)).or_else(grey),
        }
    }

    /// The channel `name`, such as `Z`, as a layer of a kind, if the group's channels have no layer.
    fn lone(&self, kind: LayerKind, name: &str) -> Option<(String, Vec<usize>)> {
        if !self.pass.is_empty() || matches!(kind, Normal | Position) {
            return None;
        }
        let index = self.channel(name)?;
        let prefix = if self.name.is_empty() { String::new() } else { format!("{}.", self.name) };
        Some((prefix + name, vec![index; if kind.is_scalar() { 1 } else { 3 }]))
    }
}

impl Layers {
    /// Groups the channels of a file's parts. Channels such as `Nx`, `Ny` and `Nz` also form a layer.
    pub fn of(parts: &[ExrPart]) -> Self {
        let (groups, views) = places::grouped(parts);
        Self { groups, views }
    }

    fn found(&self, group: usize, kind: LayerKind) -> Option<FoundLayer> {
        let Group { name, part, view, .. } = &self.groups[group];
        let channels = self.groups[group].channels_of(kind)?;
        Some(FoundLayer { kind, name: name.clone(), part: *part, view: view.clone(), channels, group })
    }

    fn lone(&self, group: usize, kind: LayerKind, name: &str) -> Option<FoundLayer> {
        let Group { part, view, .. } = &self.groups[group];
        let (name, channels) = self.groups[group].lone(kind, name)?;
        let shown = if name.chars().count() == 1 { name.to_uppercase() } else { name };
        Some(FoundLayer { kind, name: shown, part: *part, view: view.clone(), channels, group })
    }

    /// The names of all layers, and of each channel without a layer, for messages.
    pub fn names(&self) -> Vec<String> {
        let name = |group: &Group| match group.name.as_str() {
            "" => group.channels.iter().map(|(letter, _)| shown_letter(letter)).collect(),
            _ => vec![group.name.clone()],
        };
        self.groups.iter().flat_map(name).collect()
    }

    /// The channel names of the layer `name`, for messages. If `name` is a channel without a layer, the list holds only this
    /// channel. For an unknown name it is empty.
    pub fn letters(&self, name: &str) -> Vec<String> {
        match self.named(name) {
            Some(group) => self.groups[group].channels.iter().map(|(letter, _)| shown_letter(letter)).collect(),
            None => self.names().into_iter().filter(|known| known.eq_ignore_ascii_case(name)).collect(),
        }
    }

    /// Returns the name of the first layer, if any, that is named like this kind but lacks the channels that the kind needs.
    pub fn unusable(&self, kind: LayerKind) -> Option<&str> {
        let known = |group: &&Group| kind.names().contains(&group.pass.to_lowercase().as_str());
        let group = self.groups.iter().filter(known).find(|group| group.channels_of(kind).is_none())?;
        Some(&group.name)
    }

    /// The alpha channel of an image's layer, as an index into the channels of the part; `None` without alpha.
    pub fn alpha(&self, image: &FoundLayer) -> Option<usize> {
        self.groups[image.group].alpha()
    }

    fn named(&self, name: &str) -> Option<usize> {
        let exact = self.groups.iter().position(|group| group.name == name);
        exact.or_else(|| self.groups.iter().position(|group| group.name.eq_ignore_ascii_case(name)))
    }

    /// Finds the layer or channel that the caller names, such as `noise` or `noise.V`. `None` if it does not exist, or lacks
    /// the channels of this kind.
    pub fn given(&self, kind: LayerKind, name: &str) -> Option<FoundLayer> {
        let whole = || self.found(self.named(name)?, kind);
        let lone = || (0..self.groups.len()).find_map(|group| self.lone(group, kind, &name.to_lowercase()));
        whole().or_else(lone).or_else(|| self.one_channel(kind, name))
    }

    fn one_channel(&self, kind: LayerKind, name: &str) -> Option<FoundLayer> {
        let (layer, letter) = name.rsplit_once('.')?;
        let group = self.named(layer)?;
        let index = self.groups[group].channel(&letter.to_lowercase())?;
        let count = if kind.is_scalar() { 1 } else { 3 };
        let Group { part, view, .. } = &self.groups[group];
        let place = (*part, view.clone(), vec![index; count]);
        let (part, view, channels) = (!matches!(kind, Normal | Position)).then_some(place)?;
        Some(FoundLayer { kind, name: name.to_owned(), part, view, channels, group })
    }

    /// Returns the layer of means `path.X` for the layer of second moments `m2_path.X`; `None` if the file lacks it.
    pub fn first_moment(&self, second: &FoundLayer) -> Option<FoundLayer> {
        self.found(self.named(&first_moment_of(&second.name)?)?, SecondMoment)
    }

    /// Returns the layer of second moments `m2_path.X` for the layer of means `path.X`; `None` if it is missing or has
    /// another number of channels.
    pub fn second_moment(&self, first: &FoundLayer) -> Option<FoundLayer> {
        let is = |group: &Group| first_moment_of(&group.name).is_some_and(|mean| mean == first.name);
        let second = self.found(self.groups.iter().position(is)?, first.kind)?;
        (second.channels.len() == first.channels.len()).then_some(second)
    }

    /// True if the layer holds X, Y and Z rather than R, G and B.
    pub fn is_xyz(&self, layer: &FoundLayer) -> bool {
        self.groups[layer.group].three(XYZ).is_some_and(|channels| channels == layer.channels)
    }
}

fn shown_letter(letter: &str) -> String {
    if letter.chars().count() == 1 { letter.to_uppercase() } else { letter.to_owned() }
}

/// The name of the layer of means for a layer of second moments: `a.nested` for `m2_a.nested` or `a.m2_nested`.
fn first_moment_of(layer: &str) -> Option<String> {
    let within = layer.rsplit_once(".m2_").map(|(path, name)| format!("{path}.{name}"));
    layer.strip_prefix("m2_").map(str::to_owned).or(within)
}

/// Returns true for the names of features, which may also have second moments in a file.
fn is_feature(layer: &str) -> bool {
    let name = layer.rsplit_once('.').map_or(layer, |(_, name)| name).to_lowercase();
    [Normal, Albedo, Position, Depth, Emission].iter().any(|kind| kind.names().contains(&name.as_str()))
}
