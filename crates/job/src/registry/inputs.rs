//! The world for which samplers and filters are made.

use crate::WorldClusters;
use crate::clusters::{WorldTriangles, lens_probes, shoot, visibility};
use dapple_classics::{Axis, Defocus, Domain, FilmPoints, Role};
use dapple_cluster_adaptive::{AreaVectors, TraceVisibility};
use dapple_clustering::ClusterParams;
use dapple_core::PointSet;
use dapple_denoise::ClusterLookup;
use dapple_registry::{ClusterInputError, ClusterInputs, ClusterProbes, LensProbes};
use dapple_renderer::{Lanes, World};
use std::cell::RefCell;
use std::sync::Arc;

/// The world for which a sampler or filter is made, and clusters of it that exist already.
#[derive(Clone, Debug, Default)]
pub struct MethodInputs {
    /// The world; `None` for methods that need none. The others fail with
    /// [`RegistryError::NeedsWorld`](super::RegistryError::NeedsWorld).
    pub world: Option<Arc<World>>,
    /// Clusters of the world, for a method with the same parameters of clustering. Another method makes its own.
    pub clusters: Option<Arc<WorldClusters>>,
    /// The points of the samples, for a filter that reads their coordinates.
    pub points: Option<FilmPoints>,
}

impl MethodInputs {
    /// The inputs of a method on `world`, without clusters.
    pub fn of(world: Arc<World>) -> Self {
        Self { world: Some(world), ..Self::default() }
    }
}

/// The inputs of one method: keeps the clusters that it uses.
pub(super) struct OnWorld<'a> {
    inputs: &'a MethodInputs,
    used: RefCell<Option<Arc<WorldClusters>>>,
}

impl<'a> OnWorld<'a> {
    pub(super) fn new(inputs: &'a MethodInputs) -> Self {
        Self { inputs, used: RefCell::new(None) }
    }

    /// The clusters that the method used; `None` if it used none.
    pub(super) fn into_used(self) -> Option<Arc<WorldClusters>> {
        self.used.into_inner()
    }

    fn world(&self) -> Result<&Arc<World>, ClusterInputError> {
        self.inputs.world.as_ref().ok_or(ClusterInputError::NoScene)
    }

    /// The clusters of the world with these parameters: those that exist, or new ones.
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
        Ok(Some(Arc::new(move |hit| clusters.label(hit))))
    }

    fn probes(&self, params: &ClusterParams) -> Result<Option<ClusterProbes>, ClusterInputError> {
        let clusters = self.clusters(params)?;
        Ok(Some(ClusterProbes {
            labels: clusters.labels().clone(),
            clusters: clusters.clusters().clone(),
            shoot: shoot(self.world()?.clone(), clusters),
        }))
    }

    fn world_to_clip(&self) -> Option<[[f32; 4]; 4]> {
        self.inputs.world.as_ref().map(|world| world.camera().world_to_clip())
    }

    fn area_vectors(&self, clusters: &ClusterProbes) -> Result<Option<AreaVectors>, dapple_cluster_adaptive::Error> {
        let Some(world) = &self.inputs.world else { return Ok(None) };
        let triangles = WorldTriangles::of(world);
        // Spheres and disks come after the triangles.
        let labels = clusters.labels.get(..triangles.indices.len()).unwrap_or(&clusters.labels);
        AreaVectors::new(&triangles.as_slices(), labels, clusters.clusters.len()).map(Some)
    }

    fn visibility(&self) -> Result<Option<TraceVisibility>, ClusterInputError> {
        Ok(Some(visibility(self.world()?.clone())))
    }

    fn lens_probes(&self) -> Result<Option<LensProbes>, ClusterInputError> {
        Ok(Some(lens_probes(self.world()?.clone())))
    }

    fn domain(&self) -> Result<Option<Domain>, ClusterInputError> {
        let why = "the pixel filter is not a box one pixel wide; render with that box (--pixel-filter box)";
        domain(self.world()?).map(Some).ok_or_else(|| ClusterInputError::Failed(why.to_owned()))
    }

    fn film_points(&self) -> Result<Option<FilmPoints>, ClusterInputError> {
        self.domain().map(|_| self.inputs.points.clone())
    }
}

/// The dimensions in which the world's samples have a meaning; `None` for pixel filters other than a box of one pixel.
fn domain(world: &World) -> Option<Domain> {
    let found = world.sample_dimensions()?;
    let axes = |(role, (block, lanes)): (Role, Lanes)| lanes.map(move |lane| Axis::new(role, block.number(), lane));
    let roles =
        [(Role::Place, found.place), (Role::Lens, found.lens), (Role::Time, found.time), (Role::Light, found.light)];
    let domain = Domain::new(roles.into_iter().flat_map(axes)).ok()?;
    Some(match found.outside {
        Some(what) => domain.with_outside(what),
        None => domain,
    })
}

/// The points of a film of this world that is rendered with `points`; `None` if their coordinates have no meaning.
pub fn film_points(world: &World, points: Arc<dyn PointSet>) -> Option<FilmPoints> {
    let defocus = world.camera().defocus().map(|[far, by_inverse_depth]| Defocus::new(far, by_inverse_depth));
    Some(FilmPoints::new(points, domain(world)?).with_defocus(defocus))
}
