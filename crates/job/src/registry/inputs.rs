//! The world for which samplers and filters are made.

use super::RegistryError;
use crate::WorldClusters;
use dapple_clustering::ClusterParams;
use dapple_renderer::World;
use std::sync::Arc;

/// The world for which a sampler or filter is made, and clusters of it that exist already.
#[derive(Clone, Debug, Default)]
pub struct MethodInputs {
    /// The world; `None` for methods that need none. The others fail with [`RegistryError::NeedsWorld`].
    pub world: Option<Arc<World>>,
    /// Clusters of the world, for a method with the same parameters of clustering. Another method makes its own.
    pub clusters: Option<Arc<WorldClusters>>,
}

impl MethodInputs {
    /// The inputs of a method on `world`, without clusters.
    pub fn of(world: Arc<World>) -> Self {
        Self { world: Some(world), clusters: None }
    }

    /// The world, for the method `of`.
    pub(super) fn world(&self, of: &'static str) -> Result<&Arc<World>, RegistryError> {
        self.world.as_ref().ok_or(RegistryError::NeedsWorld { of })
    }

    /// The clusters of the world with these parameters, for the method `of`.
    pub(super) fn clusters(
        &self,
        of: &'static str,
        params: &ClusterParams,
    ) -> Result<Arc<WorldClusters>, RegistryError> {
        if let Some(known) = self.clusters.as_ref().filter(|known| known.params() == params) {
            return Ok(known.clone());
        }
        let made = WorldClusters::new(self.world(of)?, params);
        made.map(Arc::new).map_err(|e| RegistryError::Clusters { of, why: e.to_string() })
    }
}
