//! The clusters, first-hit rays and coordinates for which samplers and filters are made.

use crate::RegistryError;
#[cfg(feature = "classics")]
use dapple_classics::{Domain, FilmPoints};
use dapple_cluster_adaptive::{AreaVectors, FirstHitRay, FirstHitSurface, TraceFirstHit, TraceVisibility};
use dapple_clustering::{Cluster, ClusterParams};
use dapple_core::FirstHit;
use dapple_denoise::ClusterLookup;
use std::sync::Arc;

/// Clusters of a scene, first-hit rays, and the meaning of samples' coordinates, for the methods that use them.
///
/// A renderer implements this on its scene, or fills [`HostClusters`]. Each part may be missing. `cluster-regression` and
/// `bilateral` then do without clusters. `cluster-gaussian` and `cluster-thesis` are refused, and so are methods that place
/// samples or read their coordinates.
pub trait ClusterInputs {
    /// The function from a first hit to its cluster, for clusters made with `params`; `None` without clusters.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if there must be clusters and there are none.
    fn labels(&self, params: &ClusterParams) -> Result<Option<ClusterLookup>, ClusterInputError>;

    /// Clusters made with `params`, and the function that traces first-hit rays; `None` without them.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if there must be clusters and there are none.
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

    /// The function that traces shadow rays from first hits, for clusters that know the lights; `None` by default.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if there is no scene.
    fn visibility(&self) -> Result<Option<TraceVisibility>, ClusterInputError> {
        Ok(None)
    }

    /// First hits through the centre of the lens, and the lens' blur there, for methods that know the lens before they sample;
    /// `None` by default.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if there is no scene.
    fn lens_first_hits(&self) -> Result<Option<LensFirstHits>, ClusterInputError> {
        Ok(None)
    }

    /// The dimensions in which the renderer's samples have a meaning, for samplers that place samples; `None` by default.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if samples cannot be placed.
    #[cfg(feature = "classics")]
    fn domain(&self) -> Result<Option<Domain>, ClusterInputError> {
        Ok(None)
    }

    /// The points of the film's samples, for filters that read coordinates; `None` by default.
    ///
    /// # Errors
    ///
    /// [`ClusterInputError`] if the coordinates have no meaning.
    #[cfg(feature = "classics")]
    fn film_points(&self) -> Result<Option<FilmPoints>, ClusterInputError> {
        Ok(None)
    }
}

/// The reason why a [`ClusterInputs`] has no clusters or no domain.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ClusterInputError {
    /// There is no scene yet: methods that use clusters are refused.
    NoScene,
    /// Surfaces that cannot be clustered, or samples that cannot be placed: the fault, and the remedy.
    Failed(String),
}

impl ClusterInputError {
    /// The error of the method `of`.
    pub(crate) fn of(self, of: &'static str) -> RegistryError {
        match self {
            Self::NoScene => RegistryError::NeedsWorld { of, what: CLUSTERS },
            Self::Failed(why) => RegistryError::Clusters { of, why },
        }
    }
}

/// The part that most methods with clusters lack without a scene.
pub(crate) const CLUSTERS: &str = "clusters of the scene's surfaces";

/// Clusters, and the function that traces first-hit rays for the sampler `cluster-thesis`.
#[derive(Clone)]
pub struct ClusterFirstHits {
    /// The cluster's number of each primitive.
    pub labels: Arc<[u32]>,
    /// The clusters.
    pub clusters: Arc<[Cluster]>,
    /// The function that traces a first-hit ray and returns its first hit, with the hit's index among `labels`.
    pub shoot: TraceFirstHit,
}

impl ClusterFirstHits {
    /// First-hit rays of a scene of objects, each a cluster of its own: spheres, instances, distance fields. `bounds` are the
    /// smallest and largest corner of each object's bounding box. `shoot` reports the object's number as
    /// [`FirstHitSurface::primitive`].
    pub fn of_objects(
        bounds: &[[[f32; 3]; 2]],
        shoot: impl Fn(FirstHitRay) -> Option<FirstHitSurface> + Send + Sync + 'static,
    ) -> Self {
        let cluster = |(number, &[low, high]): (usize, &[[f32; 3]; 2])| {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(high[axis]) - f64::from(low[axis]));
            // The area of the box.
            Cluster::without_triangles([low, high], 2.0 * (x * y + y * z + z * x), 0, number as u32)
        };
        Self {
            labels: (0..bounds.len() as u32).collect(),
            clusters: bounds.iter().enumerate().map(cluster).collect(),
            shoot: Arc::new(shoot),
        }
    }
}

/// The function that traces the ray through the centres of a pixel and of the lens, for a pixel of the full image.
///
/// It returns the first hit, and the radius in pixels of the circle of confusion there: negative in front of the plane in focus,
/// 0 without a lens. It must be pure.
pub type TraceLensHit = Arc<dyn Fn([u32; 2]) -> (Option<FirstHit>, f32) + Send + Sync>;

/// First hits through the centre of the lens, for the sampler `fourier-dof` and the filter `splat`.
#[derive(Clone)]
pub struct LensFirstHits {
    /// The function that traces the first hits.
    pub trace: TraceLensHit,
    /// `true` if the camera has a lens.
    pub has_lens: bool,
}

/// Clusters that a renderer makes itself, from the shapes and primitives of its first hits.
///
/// The parameters of clustering (`k`, `clamp`, …) have no effect on them.
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
    /// The function from shape and primitive of a first hit to its cluster; it returns `None` outside all clusters.
    pub labels: Option<ClusterLookup>,
    /// The clusters and the function that traces first-hit rays, for the sampler `cluster-thesis`.
    pub first_hits: Option<ClusterFirstHits>,
    /// The camera's matrix from the world to clip space, for `cluster-thesis:size=screen`.
    pub world_to_clip: Option<[[f32; 4]; 4]>,
    /// The function that traces shadow rays from first hits, for `cluster-thesis:lights=16`.
    pub visibility: Option<TraceVisibility>,
    /// The function that traces first hits through the centre of the lens, for `fourier-dof` and `splat`.
    pub lens_first_hits: Option<LensFirstHits>,
    /// The dimensions in which samples have a meaning, for samplers that place samples.
    #[cfg(feature = "classics")]
    pub domain: Option<Domain>,
    /// The points of the film's samples, for filters that read coordinates.
    #[cfg(feature = "classics")]
    pub film_points: Option<FilmPoints>,
}

impl HostClusters {
    /// A renderer without clusters.
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
