//! Integrators whose light starts at the lights: a crate beside the example renderer, on its public queries.
//!
//! [`integrators`] is the table of all integrators by name: the renderer's own, then [`ENTRIES`]. [`make_integrator`]
//! makes one.

#[cfg(test)]
extern crate self as dapple_transport;

mod bdpt;
mod instant;
mod lightcuts;
mod metropolis;
mod patches;
mod photons;
mod radiosity;
#[cfg(test)]
#[path = "../tests/transport/support.rs"]
mod support;
mod table;
mod walk;

pub use bdpt::{Bdpt, BdptOptions};
pub use instant::InstantOptions;
pub use lightcuts::LightcutOptions;
pub use metropolis::{Metropolis, MetropolisOptions};
pub use photons::{PhotonOptions, What};
pub use radiosity::RadiosityOptions;
pub use table::{ENTRIES, check_integrator, integrators, make_integrator};
