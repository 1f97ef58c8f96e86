//! Participating media.

use super::Source;

/// Number of a medium in [`Scene::media`](super::Scene::media).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MediumId(pub u32);

/// A homogeneous medium.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// Its name in the file.
    pub name: String,
    /// Absorption coefficient per unit of the file's world space, linear RGB.
    pub absorption: [f32; 3],
    /// Scattering coefficient per unit of the file's world space, linear RGB.
    pub scattering: [f32; 3],
    /// Asymmetry of the Henyey-Greenstein phase function, -1 to 1 (exclusive).
    pub g: f32,
    /// File and line.
    pub source: Source,
}

/// The media on both sides of a shape; `None` is vacuum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MediumInterface {
    /// On the side away from the normal.
    pub inside: Option<MediumId>,
    /// On the side that the normal points to.
    pub outside: Option<MediumId>,
}
