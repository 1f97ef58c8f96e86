#![doc = include_str!("../README.md")]

#[cfg(feature = "classics")]
mod classics;
mod error;
mod filters;
mod inputs;
mod parameters;
mod points;
mod samplers;

pub use dapple_cluster_adaptive::FirstHitsHandle;
pub use dapple_core::options::Parameter;
pub use error::RegistryError;
pub use filters::{FILTERS, MakeFilter, NOT_BUILT, best_filter, open_image_denoise};
pub use inputs::{ClusterFirstHits, ClusterInputError, ClusterInputs, HostClusters, LensFirstHits, TraceLensHit};
pub use parameters::Parameters;
pub use points::{AnyPoints, MakePoints, POINTS};
pub use samplers::{MadeSampler, MakeSampler, SAMPLERS};

use dapple_adaptive::Adaptive;
use dapple_clustering::{ClusterParams, Grouping, Insertion, Order, Sides};
use dapple_core::{Filter, Methods, PointSet};
use dapple_denoise::ClusterRegression;
use dapple_low_discrepancy::Sobol;

/// An entry of the registry: the name, description, parameters and constructor of a sampler, point set or filter.
pub struct Entry<Make> {
    /// The entry's name: `NAME` in `NAME:key=value,…`.
    pub name: &'static str,
    /// Other names of the entry, which are accepted as well.
    pub aliases: &'static [&'static str],
    /// A one-line description of the entry, for lists.
    pub about: &'static str,
    /// The parameters of the entry, in groups that several entries share.
    pub parameters: &'static [&'static [Parameter]],
    /// The Cargo feature that the entry requires; `None` for entries that are always built in.
    pub feature: Option<&'static str>,
    /// The publication or program from which the method comes; `docs/references.bib` has the full reference.
    pub source: &'static str,
    /// The cases in which the method fails or does worse than others. A test requires a text here for each entry.
    pub weakness: &'static str,
    make: Make,
}

impl<Make> Entry<Make> {
    const fn new(
        name: &'static str,
        about: &'static str,
        source: &'static str,
        weakness: &'static str,
        parameters: &'static [&'static [Parameter]],
        make: Make,
    ) -> Self {
        Self { name, aliases: &[], about, parameters, feature: None, source, weakness, make }
    }

    /// A published method for comparison.
    #[cfg(feature = "classics")]
    const fn classic(
        name: &'static str,
        about: &'static str,
        source: &'static str,
        weakness: &'static str,
        parameters: &'static [&'static [Parameter]],
        make: Make,
    ) -> Self {
        Self { name, aliases: &[], about, parameters, feature: Some("classics"), source, weakness, make }
    }

    /// Iterates over all parameters of the entry.
    pub fn parameters(&self) -> impl Iterator<Item = &'static Parameter> + use<Make> {
        self.parameters.iter().copied().flatten()
    }

    /// Returns `true` if `name` is the entry's name or one of its aliases.
    pub fn is_called(&self, name: &str) -> bool {
        self.name == name || self.aliases.contains(&name)
    }
}

/// The seed and the expected number of samples per pixel of a point set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointSettings {
    /// The seed of all random numbers.
    pub seed: u64,
    /// The mean number of samples per pixel; `None` if unknown. Some point sets need it in advance.
    pub spp: Option<u64>,
}

/// The parameters of clustering triangles, for all entries that use clusters. The defaults are the published method's.
const CLUSTERING: &[Parameter] = &[
    Parameter::new(
        "k",
        "9",
        "Number of voxels along the longest axis, divided by the cube root of the number of triangles; Lan's thesis uses 3, 9 and 30.",
    ),
    Parameter::new("clamp", "32", "Maximum voxels per axis."),
    Parameter::new("normals", "10", "Normals up to this angle apart, in degrees, count as similar."),
    Parameter::new(
        "insertion",
        "box",
        "Voxel of a triangle: box (the last in z, then y, then x, of the voxels that its bounding box overlaps, as published) or centroid (the voxel of its centroid).",
    ),
    Parameter::new(
        "grouping",
        "greedy",
        "Clusters within a voxel: greedy (by similar normals, as published) or connected (greedy, then split into connected pieces).",
    ),
    Parameter::new(
        "order",
        "input",
        "Order of triangles: input (that of the file, as published) or canonical (by normal, so that file order does not matter).",
    ),
    Parameter::new("sides", "1", "1: opposite normals differ (as published); 2: opposite normals count as similar."),
];

fn clustering(p: &Parameters) -> Result<ClusterParams, RegistryError> {
    let insertions = [("box", Insertion::BoundingBox), ("centroid", Insertion::Centroid)];
    let groupings = [("greedy", Grouping::Greedy), ("connected", Grouping::Connected)];
    let orders = [("input", Order::Input), ("canonical", Order::Canonical)];
    let sides = [("1", Sides::Signed), ("2", Sides::Either)];
    let params = ClusterParams {
        k: p.number("k")?,
        clamp: p.number("clamp")?,
        angle: p.number("normals")?,
        insertion: p.choice("insertion", &insertions)?,
        grouping: p.choice("grouping", &groupings)?,
        order: p.choice("order", &orders)?,
        sides: p.choice("sides", &sides)?,
        ..ClusterParams::default()
    };
    p.made(params.check())?;
    Ok(params)
}

/// Creates a point set from its description: `NAME` or `NAME:key=value,…`.
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
pub fn points(description: &str, setting: PointSettings) -> Result<AnyPoints, RegistryError> {
    let (entry, parameters) = parameters::find("point set", POINTS, description)?;
    (entry.make)(&parameters, setting)
}

/// Creates a sampler from its description (`NAME` or `NAME:key=value,…`), with the point set `points`.
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
/// [`RegistryError::NeedsWorld`] if the sampler uses clusters and `inputs` has none.
pub fn sampler(description: &str, points: AnyPoints, inputs: &dyn ClusterInputs) -> Result<MadeSampler, RegistryError> {
    let (entry, parameters) = parameters::find("sampler", SAMPLERS, description)?;
    (entry.make)(&parameters, points, inputs)
}

/// Creates a filter (denoiser) from its description (`NAME` or `NAME:key=value,…`). The name `best` selects [`best_filter`].
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
/// [`RegistryError::NotBuilt`] for a filter whose feature is off, [`RegistryError::NoLibrary`] for one whose library is
/// missing. [`RegistryError::NeedsWorld`] if the filter requires clusters and `inputs` has none.
pub fn filter(description: &str, inputs: &dyn ClusterInputs) -> Result<Box<dyn Filter>, RegistryError> {
    let description = if description.trim() == "best" { best_filter() } else { description };
    let name = match description.split(':').next().unwrap_or_default().trim() {
        "both" => "oidn-blend",
        name => name,
    };
    if let Some(&(of, feature)) = NOT_BUILT.iter().find(|(absent, _)| *absent == name) {
        return Err(RegistryError::NotBuilt { of, feature });
    }
    let (entry, parameters) = parameters::find("filter", FILTERS, description)?;
    (entry.make)(&parameters, inputs)
}

/// The name of the default sampler. The default of its parameter `epsilon` suits the default filter; without a filter,
/// an `epsilon` of 0.01 is better.
pub const DEFAULT_SAMPLER: &str = "adaptive";
/// The name of the default point set.
pub const DEFAULT_POINTS: &str = "sobol";
/// The name of the default filter (denoiser).
pub const DEFAULT_FILTER: &str = "cluster-regression";

/// Creates the default sampler, with Sobol' points of `seed`, and the default filter, which uses features but no clusters.
///
/// ```
/// use dapple_core::{Frame, Limits, Session};
///
/// let pair = dapple_registry::default_pair(7);
/// assert_eq!((pair.sampler.name(), pair.filter.as_ref().unwrap().name()), ("adaptive", "cluster-regression"));
/// let session = Session::new(Frame::new(8, 8)?, Limits::spp(16.0), pair)?;
/// # let _ = session;
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub fn default_pair(seed: u64) -> Methods<'static> {
    default_pair_with(Sobol::new(seed))
}

/// Creates the default sampler, with `points`, and the default filter, which uses features but no clusters.
///
/// With [`HostNumbers`](dapple_core::HostNumbers), the pair suits renderers that draw their own random numbers.
pub fn default_pair_with(points: impl PointSet + 'static) -> Methods<'static> {
    Methods::from((Adaptive::new(points), ClusterRegression::new()))
}

/// Checks the parts of a sampler's description that need no scene.
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
pub fn check_sampler(description: &str) -> Result<(), RegistryError> {
    let points = points("random", PointSettings { seed: 0, spp: None })?;
    without_scene(sampler(description, points, &HostClusters::none()))
}

/// Checks the description of a point set.
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
pub fn check_points(description: &str) -> Result<(), RegistryError> {
    points(description, PointSettings { seed: 0, spp: None }).map(|_| ())
}

/// Checks the parts of a filter's description that need no scene.
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
pub fn check_filter(description: &str) -> Result<(), RegistryError> {
    without_scene(filter(description, &HostClusters::none()))
}

fn without_scene<T>(made: Result<T, RegistryError>) -> Result<(), RegistryError> {
    match made {
        Err(RegistryError::NeedsWorld { .. }) => Ok(()),
        made => made.map(|_| ()),
    }
}

/// The rows that `docs/results/methods.py` writes: kind, description of the method, and result, separated by tabs.
const TABLE: &str = include_str!("verdicts.tsv");

/// The results of a method in the comparison of all methods (docs/results/methods.md). Returns pairs: a
/// description that was compared (`NAME` or `NAME:key=value,…`), and its result in one line.
///
/// `kind` is `sampler`, `points` or `filter`; `name` is the entry's name. Nothing is returned for methods that were not
/// compared.
///
/// ```
/// assert_eq!(dapple_registry::verdicts("sampler", "none of ours").count(), 0);
/// ```
pub fn verdicts<'a>(kind: &'a str, name: &'a str) -> impl Iterator<Item = (&'static str, &'static str)> + 'a {
    TABLE.lines().filter_map(move |line| {
        let (of, rest) = line.split_once('\t')?;
        let (description, result) = rest.split_once('\t')?;
        let is_meant = of == kind && description.split([':', ' ']).next() == Some(name);
        is_meant.then_some((description, result))
    })
}
