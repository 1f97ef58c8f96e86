//! Every sampler, point set and filter by name: one line each, in the file of its kind.

mod filters;
mod parameters;
mod points;
mod samplers;

pub use filters::{FILTERS, MakeFilter};
pub use parameters::{Parameters, RegistryError};
pub use points::{AnyPoints, MakePoints, POINTS};
pub use samplers::{MakeSampler, SAMPLERS};

use crate::Stage;
use dapple_clustering::{Grouping, Insertion, Order, Params};
use dapple_core::{Filter, Sampler};

/// A parameter: its name, its default as it would be written, and one line about it.
pub type Parameter = (&'static str, &'static str, &'static str);

/// One entry: its name, one line about it, its parameters, and how it is made.
pub struct Entry<Make> {
    /// The name on the command line.
    pub name: &'static str,
    /// What it is, in one line.
    pub about: &'static str,
    /// Its parameters, in groups.
    pub parameters: &'static [&'static [Parameter]],
    make: Make,
}

impl<Make> Entry<Make> {
    /// Its parameters.
    pub fn parameters(&self) -> impl Iterator<Item = &'static Parameter> + use<Make> {
        self.parameters.iter().copied().flatten()
    }
}

/// What a point set is made from besides its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// The seed.
    pub seed: u64,
    /// The mean number of samples per pixel asked for, where it is known: some sets want it beforehand.
    pub spp: Option<u64>,
}

/// How triangles are grouped, for whatever looks at clusters: the published method by default.
const CLUSTERING: &[Parameter] = &[
    ("k", "9", "voxels along the longest axis: k times the cube root of the triangles; 3, 9 and 30 in the thesis"),
    ("clamp", "32", "most voxels along an axis"),
    ("normals", "10", "degrees within which normals are alike"),
    ("insertion", "box", "a triangle's voxels: box (all that its box overlaps, the last one wins) or centroid"),
    ("grouping", "greedy", "within a voxel: greedy, or connected (cut into connected pieces)"),
    ("order", "input", "the order of triangles: input (published) or canonical (independent of their order)"),
    ("sides", "1", "normals of 1 side, or of 2: opposite ones are alike"),
];

fn clustering(p: &Parameters) -> Result<Params, RegistryError> {
    Ok(Params {
        k: p.number("k")?,
        clamp: p.number("clamp")?,
        angle: p.number("normals")?,
        insertion: p.choice("insertion", &[("box", Insertion::BoundingBox), ("centroid", Insertion::Centroid)])?,
        grouping: p.choice("grouping", &[("greedy", Grouping::Greedy), ("connected", Grouping::Connected)])?,
        order: p.choice("order", &[("input", Order::Input), ("canonical", Order::Canonical)])?,
        two_sided: p.choice("sides", &[("1", false), ("2", true)])?,
        ..Params::default()
    })
}

/// Makes the point set that `words` names: `NAME` or `NAME:key=value,…`.
///
/// # Errors
///
/// For an unknown name or key, which lists what there is, and for a value out of range.
pub fn points(words: &str, setting: Setting) -> Result<AnyPoints, RegistryError> {
    let (entry, parameters) = parameters::find("point set", POINTS, words)?;
    Ok(AnyPoints::new((entry.make)(&parameters, setting)?))
}

/// Makes the sampler that `words` names, with these points, for the world on `stage`.
///
/// # Errors
///
/// As [`points`]; [`RegistryError::NeedsWorld`] where it looks at the world and `stage` is empty.
pub fn sampler(words: &str, points: AnyPoints, stage: &Stage) -> Result<Box<dyn Sampler>, RegistryError> {
    let (entry, parameters) = parameters::find("sampler", SAMPLERS, words)?;
    (entry.make)(&parameters, points, stage)
}

/// Makes the filter that `words` names, for the world on `stage`.
///
/// # Errors
///
/// As [`sampler`].
pub fn filter(words: &str, stage: &Stage) -> Result<Box<dyn Filter>, RegistryError> {
    let (entry, parameters) = parameters::find("filter", FILTERS, words)?;
    (entry.make)(&parameters, stage)
}

/// What is wrong with the words for a sampler, as far as can be told without a world.
///
/// # Errors
///
/// As [`sampler`], but for [`RegistryError::NeedsWorld`].
pub fn check_sampler(words: &str) -> Result<(), RegistryError> {
    let points = points("random", Setting { seed: 0, spp: None })?;
    known_without_a_world(sampler(words, points, &Stage::empty()))
}

/// What is wrong with the words for a filter, as far as can be told without a world.
///
/// # Errors
///
/// As [`filter`], but for [`RegistryError::NeedsWorld`].
pub fn check_filter(words: &str) -> Result<(), RegistryError> {
    known_without_a_world(filter(words, &Stage::empty()))
}

fn known_without_a_world<T>(made: Result<T, RegistryError>) -> Result<(), RegistryError> {
    match made {
        Err(RegistryError::NeedsWorld { .. }) => Ok(()),
        made => made.map(|_| ()),
    }
}

#[cfg(test)]
mod tests;
