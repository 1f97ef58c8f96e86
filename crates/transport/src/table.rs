//! The table of all integrators, by name.

use crate::instant::{self, InstantOptions};
use crate::lightcuts::{self, LightcutOptions};
use crate::photons::{self, PhotonOptions};
use crate::radiosity::{self, RadiosityOptions};
use crate::{Bdpt, BdptOptions, Metropolis, MetropolisOptions};
use dapple_core::{Integrator, Options as _};
use dapple_renderer::{IntegratorEntry, IntegratorError, World, check_integrator_among, make_integrator_among};
use std::sync::LazyLock;

/// The integrators of this crate. A new integrator is a file in `src/`, and an entry here.
pub const ENTRIES: &[IntegratorEntry] = &[
    IntegratorEntry::new(
        [
            "photons",
            "path tracing beside photons, which find light of small lamps through glass and mirrors",
            "Jensen 1996; passes after Knaus and Zwicker 2011",
        ],
        PhotonOptions::PARAMETERS,
        photons::make,
    ),
    IntegratorEntry::new(
        [
            "lightcuts",
            "direct light of many lights by cuts through trees of them, then path tracing",
            "Walter et al. 2005; clusters after Wang et al. 2011",
        ],
        LightcutOptions::PARAMETERS,
        lightcuts::make,
    ),
    IntegratorEntry::new(
        ["instant", "indirect light from virtual lights, which paths from the lamps leave behind", "Keller 1997"],
        InstantOptions::PARAMETERS,
        instant::make,
    ),
    IntegratorEntry::new(
        [
            "radiosity",
            "indirect light of diffuse surfaces from patches: clusters of their triangles, lit by paths from the lamps",
            "Goral et al. 1984; particles after Pattanaik and Mudur 1992; clusters of Lan 2016",
        ],
        RadiosityOptions::PARAMETERS,
        radiosity::make,
    ),
    IntegratorEntry::new(
        [
            "bdpt",
            "bidirectional path tracing: paths from the camera and from a light, connected in all ways",
            "Lafortune and Willems 1993; Veach and Guibas 1994; weights: Veach and Guibas 1995",
        ],
        BdptOptions::PARAMETERS,
        Bdpt::parse,
    ),
    IntegratorEntry::new(
        [
            "metropolis",
            "Markov chains over bidirectional paths, beside direct light",
            "Veach and Guibas 1997; Kelemen et al. 2002",
        ],
        MetropolisOptions::PARAMETERS,
        Metropolis::parse,
    ),
];

/// Returns the table of all integrators: those of [`dapple_renderer::integrators`], the default first, then
/// [`ENTRIES`].
pub fn integrators() -> &'static [IntegratorEntry] {
    static ALL: LazyLock<Vec<IntegratorEntry>> = LazyLock::new(|| [dapple_renderer::integrators(), ENTRIES].concat());
    &ALL
}

/// Makes an integrator for a world from `NAME` or `NAME:key=value,…`.
///
/// # Errors
///
/// [`IntegratorError`] if the integrator or a parameter is unknown, if a value is out of range, or if the scene has an
/// effect that the integrator cannot simulate.
///
/// # Examples
///
/// ```
/// use dapple_renderer::World;
/// use dapple_scene::bundled;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let scene = bundled::files("cornell").ok_or("no such scene")?.read()?;
/// let world = World::with_resolution(&scene, [16, 12])?;
/// let integrator = dapple_transport::make_integrator("path", &world)?;
/// assert!(!integrator.wants_training());
/// # Ok(())
/// # }
/// ```
pub fn make_integrator<'w>(request: &str, world: &'w World) -> Result<Box<dyn Integrator + 'w>, IntegratorError> {
    make_integrator_among(integrators(), request, world)
}

/// Checks a request without a world: the integrator's name and the names of its parameters, but no values.
///
/// # Errors
///
/// [`IntegratorError`] if the integrator or a parameter is unknown.
pub fn check_integrator(request: &str) -> Result<(), IntegratorError> {
    check_integrator_among(integrators(), request)
}
