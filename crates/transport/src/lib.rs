#![doc = include_str!("../README.md")]
//!
//! [`make_integrator`] makes any integrator of the table [`integrators`], by name.
//!
//! A surface is called *non-specular* in this crate if its widest lobe has a microfacet width of at least 0.3.

mod bdpt;
mod instant;
mod lightcuts;
mod metropolis;
mod patches;
mod photons;
mod radiosity;
mod walk;

pub use bdpt::{Bdpt, BdptOptions};
pub use instant::InstantOptions;
pub use lightcuts::LightcutOptions;
pub use metropolis::{Metropolis, MetropolisOptions};
pub use photons::{PhotonOptions, PhotonScope};
pub use radiosity::RadiosityOptions;

use dapple_core::{Integrator, options::Options};
use dapple_renderer::{
    IntegratorEntry, IntegratorError, MakeIntegrator, World, check_integrator_among, make_integrator_among,
};
use std::sync::LazyLock;

/// The integrators of this crate. A new integrator is a file in `src/`, and an entry here.
pub const ENTRIES: &[IntegratorEntry] = &[
    entry::<PhotonOptions>(
        "photons",
        "path tracing plus progressive photon mapping for caustics (light of small lights via glass or mirrors)",
        "Jensen 1996; passes after Knaus and Zwicker 2011",
        photons::make,
    ),
    entry::<LightcutOptions>(
        "lightcuts",
        "direct light of many lights, grouped into clusters up to an error bound (lightcuts); path tracing for the rest",
        "Walter et al. 2005; clusters after Wang et al. 2011",
        lightcuts::make,
    ),
    entry::<InstantOptions>(
        "instant",
        "instant radiosity: indirect lighting from virtual point lights (Keller 1997)",
        "Keller 1997",
        instant::make,
    ),
    entry::<RadiosityOptions>(
        "radiosity",
        "diffuse indirect lighting from radiosity patches (clusters of triangles), lit by particles from the lights",
        "Goral et al. 1984; particles after Pattanaik and Mudur 1992; clusters of Lan 2016",
        radiosity::make,
    ),
    entry::<BdptOptions>(
        "bdpt",
        "bidirectional path tracing: paths from camera and light, connected in all ways",
        "Lafortune and Willems 1993; Veach and Guibas 1994; weights: Veach and Guibas 1995",
        Bdpt::parse,
    ),
    entry::<MetropolisOptions>(
        "metropolis",
        "primary-sample-space MLT over bdpt paths; direct light is sampled separately",
        "Veach and Guibas 1997; Kelemen et al. 2002",
        Metropolis::parse,
    ),
];

const fn entry<O: Options>(
    name: &'static str,
    about: &'static str,
    source: &'static str,
    make: MakeIntegrator,
) -> IntegratorEntry {
    IntegratorEntry::new([name, about, source], O::PARAMETERS, make)
}

/// Returns the table of all integrators: [`dapple_renderer::integrators`], with the default first, followed by [`ENTRIES`].
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

/// Checks a request without a world: the names of the integrator and its parameters, but not the values.
///
/// # Errors
///
/// [`IntegratorError`] if the integrator or a parameter is unknown.
pub fn check_integrator(request: &str) -> Result<(), IntegratorError> {
    check_integrator_among(integrators(), request)
}
