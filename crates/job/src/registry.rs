//! The samplers, point sets and filters of `dapple-registry` by name, created for a world.

pub use dapple_registry::{
    AnyPoints, Entry, FILTERS, MakeFilter, MakePoints, MakeSampler, NOT_BUILT, POINTS, Parameter, Parameters,
    PointSettings, RegistryError, SAMPLERS, best_filter, check_filter, check_points, check_sampler, open_image_denoise,
    points, verdicts,
};

use crate::WorldClusters;
use crate::clusters::{WorldTriangles, lens_first_hits, shoot, visibility};
use dapple_classics::{Axis, Defocus, Domain, FilmPoints, PlacedHandle, Role};
use dapple_cluster_adaptive::{AreaVectors, FirstHitsHandle, TraceVisibility};
use dapple_clustering::ClusterParams;
use dapple_core::{Filter, PointSet, Sampler};
use dapple_denoise::ClusterLookup;
use dapple_registry::{ClusterFirstHits, ClusterInputError, ClusterInputs, LensFirstHits};
use dapple_renderer::{BlockDimensions, World};
use std::cell::RefCell;
use std::sync::Arc;

/// A sampler, and the clusters and first-hit rays that it uses.
pub struct MadeSampler {
    /// The sampler.
    pub sampler: Box<dyn Sampler>,
    /// The clusters; `None` for a sampler without clusters.
    pub clusters: Option<Arc<WorldClusters>>,
    /// The first-hit rays that the sampler traces for its first plan; stays empty if it traces none.
    pub first_hits: FirstHitsHandle,
    /// Gives filters the coordinates that the sampler has chosen; `None` if the point set chooses all coordinates.
    pub placed: Option<PlacedHandle>,
}

/// A filter, and the clusters that it uses.
pub struct MadeFilter {
    /// The filter.
    pub filter: Box<dyn Filter>,
    /// The clusters; `None` for a filter without clusters.
    pub clusters: Option<Arc<WorldClusters>>,
}

/// Creates a sampler from its description (`NAME` or `NAME:key=value,…`), with the point set `points`.
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
/// [`RegistryError::NeedsWorld`] if the sampler reads the world and `inputs` has none.
pub fn sampler(description: &str, points: AnyPoints, inputs: &MethodInputs) -> Result<MadeSampler, RegistryError> {
    let inputs = OnWorld::new(inputs);
    let dapple_registry::MadeSampler { sampler, first_hits, placed } =
        dapple_registry::sampler(description, points, &inputs)?;
    Ok(MadeSampler { sampler, clusters: inputs.used.into_inner(), first_hits, placed })
}

/// Creates a filter (denoiser) from its description (`NAME` or `NAME:key=value,…`).
///
/// # Errors
///
/// [`RegistryError`] for an unknown name or key, listing the known ones, and for a value out of range.
/// [`RegistryError::NotBuilt`] for a filter whose feature is off, [`RegistryError::NoLibrary`] for one whose library is
/// missing. [`RegistryError::NeedsWorld`] if the filter reads the world and `inputs` has none.
pub fn filter(description: &str, inputs: &MethodInputs) -> Result<MadeFilter, RegistryError> {
    let inputs = OnWorld::new(inputs);
    let filter = dapple_registry::filter(description, &inputs)?;
    Ok(MadeFilter { filter, clusters: inputs.used.into_inner() })
}

/// The [`World`] for which a sampler or filter is created, and its existing clusters.
#[derive(Clone, Debug, Default)]
pub struct MethodInputs {
    /// The world. With `None`, methods that need a world fail with [`RegistryError::NeedsWorld`].
    pub world: Option<Arc<World>>,
    /// Existing clusters of the world. Only samplers and filters with the same clustering parameters reuse them.
    pub clusters: Option<Arc<WorldClusters>>,
    /// The points of the film's samples, for filters that read coordinates; `None` if they are unknown.
    pub points: Option<FilmPoints>,
}

impl MethodInputs {
    /// The inputs of a sampler or filter for `world`, without clusters and points.
    pub fn of(world: Arc<World>) -> Self {
        Self { world: Some(world), ..Self::default() }
    }
}

/// The inputs of one method, and the clusters that it uses.
struct OnWorld<'a> {
    inputs: &'a MethodInputs,
    used: RefCell<Option<Arc<WorldClusters>>>,
}

impl<'a> OnWorld<'a> {
    fn new(inputs: &'a MethodInputs) -> Self {
        Self { inputs, used: RefCell::new(None) }
    }

    fn world(&self) -> Result<&Arc<World>, ClusterInputError> {
        self.inputs.world.as_ref().ok_or(ClusterInputError::NoScene)
    }

    /// The clusters of the world with these parameters, existing or newly computed.
    fn clusters(&self, params: &ClusterParams) -> Result<Arc<WorldClusters>, ClusterInputError> {
        let known = self.inputs.clusters.as_ref().filter(|known| known.params() == params);
        let clusters = match known {
            Some(known) => known.clone(),
            None => {
                let made = WorldClusters::new(self.world()?, params);
                Arc::new(made.map_err(|e| ClusterInputError::Failed(e.to_string()))?)
            }
        };
        *self.used.borrow_mut() = Some(clusters.clone());
        Ok(clusters)
    }
}

impl ClusterInputs for OnWorld<'_> {
    fn labels(&self, params: &ClusterParams) -> Result<Option<ClusterLookup>, ClusterInputError> {
        let clusters = self.clusters(params)?;
        Ok(Some(Arc::new(move |shape, primitive| clusters.label(shape, primitive))))
    }

    fn first_hits(&self, params: &ClusterParams) -> Result<Option<ClusterFirstHits>, ClusterInputError> {
        let clusters = self.clusters(params)?;
        Ok(Some(ClusterFirstHits {
            labels: clusters.labels().clone(),
            clusters: clusters.clusters().clone(),
            shoot: shoot(self.world()?.clone(), clusters),
        }))
    }

    fn world_to_clip(&self) -> Option<[[f32; 4]; 4]> {
        self.inputs.world.as_ref().map(|world| world.camera().world_to_clip())
    }

    fn area_vectors(&self, clusters: &ClusterFirstHits) -> Result<Option<AreaVectors>, dapple_cluster_adaptive::Error> {
        let Some(world) = &self.inputs.world else { return Ok(None) };
        let triangles = WorldTriangles::of(world);
        // Spheres and disks come after the triangles.
        let labels = clusters.labels.get(..triangles.indices.len()).unwrap_or(&clusters.labels);
        AreaVectors::new(&triangles.as_slices(), labels, clusters.clusters.len()).map(Some)
    }

    fn visibility(&self) -> Result<Option<TraceVisibility>, ClusterInputError> {
        Ok(Some(visibility(self.world()?.clone())))
    }

    fn lens_first_hits(&self) -> Result<Option<LensFirstHits>, ClusterInputError> {
        Ok(Some(lens_first_hits(self.world()?.clone())))
    }

    fn domain(&self) -> Result<Option<Domain>, ClusterInputError> {
        let why = "the pixel filter must be a box one pixel wide; use --pixel-filter box";
        domain(self.world()?).map(Some).ok_or_else(|| ClusterInputError::Failed(why.to_owned()))
    }

    fn film_points(&self) -> Result<Option<FilmPoints>, ClusterInputError> {
        self.domain().map(|_| self.inputs.points.clone())
    }
}

/// The meaning of each dimension of the world's samples; `None` for pixel filters other than a box one pixel wide.
fn domain(world: &World) -> Option<Domain> {
    let found = world.sample_dimensions()?;
    let axes =
        |(role, (block, lanes)): (Role, BlockDimensions)| lanes.map(move |lane| Axis::new(role, block.number(), lane));
    let roles =
        [(Role::Place, found.place), (Role::Lens, found.lens), (Role::Time, found.time), (Role::Light, found.light)];
    let domain = Domain::new(roles.into_iter().flat_map(axes)).ok()?;
    Some(found.outside.into_iter().fold(domain, Domain::with_outside))
}

/// The sample points of a render of `world` with the set `points`; `None` unless the pixel filter is a box one pixel wide.
pub fn film_points(world: &World, points: Arc<dyn PointSet>) -> Option<FilmPoints> {
    let defocus = world.camera().defocus().map(|[far, by_inverse_depth]| Defocus::new(far, by_inverse_depth));
    Some(FilmPoints::new(points, domain(world)?).with_defocus(defocus))
}
