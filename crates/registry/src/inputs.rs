//! The clusters, first-hit rays and sample coordinates that samplers and filters take from a renderer.

use crate::RegistryError;
#[cfg(feature = "classics")]
use dapple_classics::{Domain, FilmPoints};
use dapple_cluster_adaptive::{AreaVectors, FirstHitRay, FirstHitSurface, TraceFirstHit, TraceVisibility};
use dapple_clustering::{Cluster, ClusterParams};
use dapple_core::FirstHit;
use dapple_denoise::ClusterLookup;
use std::sync::Arc;

/// Clusters of a scene, first-hit rays, and the meaning of sample coordinates, for the methods that use them.
///
/// A renderer implements this trait for its scene, or fills [`HostClusters`]. Any input may be missing. Without clusters,
/// `cluster-regression` and `bilateral` work on features alone, and `cluster-gaussian` and `cluster-thesis` cannot be created.
/// Without known coordinates, methods that place samples or read coordinates cannot be created.
pub trait ClusterInputs {
    /// The function that returns the cluster of a first hit, for clusters made with `params`; `None` without clusters.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if there is no scene yet, or clustering failed.
    fn labels(&self, params: &ClusterParams) -> Result<Option<ClusterLookup>, ClusterInputError>;

    /// Clusters made with `params`, and the function that traces first-hit rays; `None` if there are none.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if there is no scene yet, or clustering failed.
    fn first_hits(&self, params: &ClusterParams) -> Result<Option<ClusterFirstHits>, ClusterInputError>;

    /// The camera's matrix from the world to clip space, for clusters measured on the screen; `None` by default.
    fn world_to_clip(&self) -> Option<[[f32; 4]; 4]> {
        None
    }

    /// The area vectors of the triangles of `clusters`, for clusters measured by triangles; `None` by default.
    ///
    /// # Errors
    ///
    /// [`dapple_cluster_adaptive::Error`] for labels that do not fit the triangles.
    fn area_vectors(&self, clusters: &ClusterFirstHits) -> Result<Option<AreaVectors>, dapple_cluster_adaptive::Error> {
        let _ = clusters;
        Ok(None)
    }

    /// The function that traces shadow rays from the hits of first-hit rays, for `cluster-thesis` with `lights` above 0; `None`
    /// by default.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if there is no scene.
    fn visibility(&self) -> Result<Option<TraceVisibility>, ClusterInputError> {
        Ok(None)
    }

    /// The tracer of first hits through the centre of the lens, with the circle of confusion at each hit, for methods that plan
    /// by it; `None` by default.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if there is no scene.
    fn lens_first_hits(&self) -> Result<Option<LensFirstHits>, ClusterInputError> {
        Ok(None)
    }

    /// The meaning of the dimensions of the renderer's samples, for samplers that place samples; `None` by default.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if samples cannot be placed.
    #[cfg(feature = "classics")]
    fn domain(&self) -> Result<Option<Domain>, ClusterInputError> {
        Ok(None)
    }

    /// The coordinates of the film's samples, for filters that read them; `None` by default.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if the meaning of the coordinates is unknown.
    #[cfg(feature = "classics")]
    fn film_points(&self) -> Result<Option<FilmPoints>, ClusterInputError> {
        Ok(None)
    }
}

/// The reason why a [`ClusterInputs`] cannot provide an input.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ClusterInputError {
    /// There is no scene yet, so methods that need clusters cannot be created.
    NoScene,
    /// Surfaces cannot be clustered, or samples cannot be placed. The text names the problem and the remedy.
    Failed(String),
}

impl ClusterInputError {
    /// Converts to the error of creating the method `of`.
    pub(crate) fn of(self, of: &'static str) -> RegistryError {
        match self {
            Self::NoScene => RegistryError::NeedsWorld { of, what: CLUSTERS },
            Self::Failed(why) => RegistryError::Clusters { of, why },
        }
    }
}

/// The input that most methods with clusters need from a scene, for messages.
pub(crate) const CLUSTERS: &str = "clusters of the scene's surfaces";

/// Clusters, and the function that traces first-hit rays for the sampler `cluster-thesis`.
#[derive(Clone)]
pub struct ClusterFirstHits {
    /// The cluster index of each primitive.
    pub labels: Arc<[u32]>,
    /// The clusters.
    pub clusters: Arc<[Cluster]>,
    /// Traces a first-hit ray. Returns the first hit with the index of its primitive in `labels`; `None` without a hit.
    pub shoot: TraceFirstHit,
}

impl ClusterFirstHits {
    /// First-hit rays of a scene in which each object (sphere, instance, distance field) is one cluster. `bounds` holds the
    /// smallest and largest corner of each object's bounding box. `shoot` returns the object's index in `bounds` as the
    /// primitive that was hit.
    pub fn of_objects(
        bounds: &[[[f32; 3]; 2]],
        shoot: impl Fn(FirstHitRay) -> Option<FirstHitSurface> + Send + Sync + 'static,
    ) -> Self {
        let cluster = |(number, &[low, high]): (usize, &[[f32; 3]; 2])| {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(high[axis]) - f64::from(low[axis]));
            // The surface area of the bounding box.
            Cluster::without_triangles([low, high], 2.0 * (x * y + y * z + z * x), 0, number as u32)
        };
        Self {
            labels: (0..bounds.len() as u32).collect(),
            clusters: bounds.iter().enumerate().map(cluster).collect(),
            shoot: Arc::new(shoot),
        }
    }
}

/// A function that traces the ray through the centres of a pixel and of the lens. It takes the pixel's column and row in the
/// full image, even if only a crop is rendered.
///
/// It returns the first hit, and the radius in pixels of the hit's circle of confusion: negative in front of the plane in
/// focus, 0 without a lens. The function must be pure.
pub type TraceLensHit = Arc<dyn Fn([u32; 2]) -> (Option<FirstHit>, f32) + Send + Sync>;

/// The tracer of first hits through the centre of the lens, for the sampler `fourier-dof` and the filter `splat`.
#[derive(Clone)]
pub struct LensFirstHits {
    /// The function that traces the first hits.
    pub trace: TraceLensHit,
    /// `true` if the camera has a lens.
    pub has_lens: bool,
}

/// The [`ClusterInputs`] of a renderer that makes its own clusters. Clusters are found by a first hit's shape and primitive.
///
/// The parameters of clustering (`k`, `clamp`, …) have no effect on these clusters.
///
/// ```
/// use dapple_registry::HostClusters;
///
/// // Each of this renderer's objects is a cluster.
/// let clusters = HostClusters::none().with_labels(|shape, _| Some(shape));
/// let filter = dapple_registry::filter("cluster-gaussian:hits=4", &clusters)?;
/// assert_eq!(filter.needs().first_hits, 4);
/// # Ok::<(), dapple_registry::RegistryError>(())
/// ```
#[derive(Clone, Default)]
pub struct HostClusters {
    /// The function that returns the cluster of a first hit's shape and primitive, or `None` outside all clusters.
    pub labels: Option<ClusterLookup>,
    /// The clusters and the function that traces first-hit rays, for the sampler `cluster-thesis`.
    pub first_hits: Option<ClusterFirstHits>,
    /// The rows of the camera's matrix from the world to clip space, for `cluster-thesis:size=screen`.
    pub world_to_clip: Option<[[f32; 4]; 4]>,
    /// The function that traces shadow rays from first hits, for `cluster-thesis` with `lights` above 0.
    pub visibility: Option<TraceVisibility>,
    /// The function that traces first hits through the centre of the lens, for `fourier-dof` and `splat`.
    pub lens_first_hits: Option<LensFirstHits>,
    /// The meaning of each sample dimension, for samplers that choose sample coordinates.
    #[cfg(feature = "classics")]
    pub domain: Option<Domain>,
    /// The coordinates of the film's samples (position, lens, time, light), for filters that read coordinates.
    #[cfg(feature = "classics")]
    pub film_points: Option<FilmPoints>,
}

impl HostClusters {
    /// Returns inputs in which every field is `None`.
    pub fn none() -> Self {
        Self::default()
    }

    /// Sets [`labels`](Self::labels).
    #[must_use]
    pub fn with_labels(self, label: impl Fn(u32, u32) -> Option<u32> + Send + Sync + 'static) -> Self {
        Self { labels: Some(Arc::new(label)), ..self }
    }
}

impl ClusterInputs for HostClusters {
    fn labels(&self, _: &ClusterParams) -> Result<Option<ClusterLookup>, ClusterInputError> {
        Ok(self.labels.clone())
    }

    fn first_hits(&self, _: &ClusterParams) -> Result<Option<ClusterFirstHits>, ClusterInputError> {
        Ok(self.first_hits.clone())
    }

    fn world_to_clip(&self) -> Option<[[f32; 4]; 4]> {
        self.world_to_clip
    }

    fn visibility(&self) -> Result<Option<TraceVisibility>, ClusterInputError> {
        Ok(self.visibility.clone())
    }

    fn lens_first_hits(&self) -> Result<Option<LensFirstHits>, ClusterInputError> {
        Ok(self.lens_first_hits.clone())
    }

    #[cfg(feature = "classics")]
    fn domain(&self) -> Result<Option<Domain>, ClusterInputError> {
        Ok(self.domain.clone())
    }

    #[cfg(feature = "classics")]
    fn film_points(&self) -> Result<Option<FilmPoints>, ClusterInputError> {
        Ok(self.film_points.clone())
    }
}
