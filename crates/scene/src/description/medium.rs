//! Participating media.

use super::Source;

/// Index of a medium in [`Scene::media`](super::Scene::media).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MediumId(pub u32);

/// A homogeneous participating medium.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// The medium's name in the file.
    pub name: String,
    /// Absorption coefficient per unit of the file's world space, linear RGB.
    pub absorption: [f32; 3],
    /// Scattering coefficient per unit of the file's world space, linear RGB.
    pub scattering: [f32; 3],
    /// Asymmetry of the Henyey-Greenstein phase function, -1 to 1 (exclusive).
    pub g: f32,
    /// File and line of the medium, for messages.
    pub source: Source,
}

/// The media on both sides of a shape; `None` is vacuum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MediumInterface {
    /// The medium on the side opposite to the normal.
    pub inside: Option<MediumId>,
    /// The medium on the side of the normal.
    pub outside: Option<MediumId>,
}
