//! The integrator of a render: the one that its description names, or the one that its scene calls for.

use crate::{DEFAULT_INTEGRATOR, RenderSpec};
use dapple_renderer::IntegratorError;
use dapple_scene::{Called, Effect, Effects, Scene};

/// Checks a request for an integrator: `auto`, or its name and the names of its parameters.
///
/// # Errors
///
/// [`IntegratorError`] if the integrator or a parameter is unknown.
pub fn check_integrator(request: &str) -> Result<(), IntegratorError> {
    if request == DEFAULT_INTEGRATOR { Ok(()) } else { dapple_transport::check_integrator(request) }
}

/// The integrator of a render, `NAME` or `NAME:key=value,…`, and the caustics that call for photons, if they do.
///
/// The default takes photons for a scene with [caustics that paths find by chance only](Effects::found_by_chance). Motion
/// blur and shards leave it with path tracing, since photons have no time and a shard would trace those of the whole image.
pub(crate) fn integrator(spec: &RenderSpec, scene: &Scene) -> (String, Option<Called>) {
    if spec.integrator != DEFAULT_INTEGRATOR {
        return (spec.integrator.clone(), None);
    }
    let excluded = spec.shard.is_some() || Effects::of(scene).has(Effect::MotionBlur);
    match Effects::found_by_chance(scene) {
        Some(called) if !excluded => ("photons".to_owned(), Some(called)),
        _ => ("path".to_owned(), None),
    }
}

/// Returns true if an integrator finds light of small lamps through glass: photons, and paths from the lights that are
/// connected with the camera.
pub(crate) fn finds_caustics(integrator: &str) -> bool {
    let name = integrator.split(':').next().unwrap_or_default().trim();
    matches!(name, "photons" | "metropolis") || name == "bdpt" && !integrator.contains("splat=0")
}

#[cfg(test)]
mod tests {
    use super::integrator;
    use crate::RenderSpec;
    use dapple_scene::bundled;

    fn chosen(spec: &RenderSpec) -> String {
        let scene = bundled::files(&spec.scene).expect("a bundled scene").read().expect("a scene");
        let (name, because) = integrator(spec, &scene);
        assert_eq!(because.is_some(), name == "photons" && spec.integrator == "auto");
        name
    }

    #[test]
    fn the_default_takes_photons_where_the_scene_calls_for_them() {
        assert_eq!(chosen(&RenderSpec::new("caustic")), "photons");
        for scene in ["cornell", "glass", "tea", "teapot", "many-lights", "motion"] {
            assert_eq!(chosen(&RenderSpec::new(scene)), "path", "{scene}");
        }
        assert_eq!(chosen(&RenderSpec::new("caustic").integrator("path")), "path");
        assert_eq!(chosen(&RenderSpec::new("cornell").integrator("photons:what=all")), "photons:what=all");
        let shard = "1/2".parse().expect("a shard");
        assert_eq!(chosen(&RenderSpec { shard: Some(shard), ..RenderSpec::new("caustic") }), "path");
    }
}
