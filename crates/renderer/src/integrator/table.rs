//! The table of all integrators, by name.

use super::{AmbientOcclusion, AmbientOcclusionOptions, integrator};
use crate::World;
use dapple_core::Integrator;
use dapple_core::options::{OptionError, Options, Parameter, nearest_name, parse_pairs};

/// All integrators, the default first. A new integrator is a file in this directory and an entry here.
const INTEGRATORS: &[IntegratorEntry] = &[
    IntegratorEntry {
        name: "path",
        source: "Kajiya, The Rendering Equation, 1986; multiple importance sampling: Veach and Guibas 1995",
        about: "path tracing with next-event estimation and multiple importance sampling (the default, unless the scene needs photons)",
        parameters: &[],
        make: |_, world| Ok(integrator(world)),
    },
    IntegratorEntry {
        name: "ambient-occlusion",
        source: "none: as in textbooks",
        about: "unoccluded fraction of the hemisphere above each surface, without lights and materials",
        parameters: AmbientOcclusionOptions::PARAMETERS,
        make: AmbientOcclusion::parse,
    },
];

/// A function that makes an integrator from the text of the integrator's parameters, `key=value,…`, and a world.
pub type MakeIntegrator = for<'w> fn(&str, &'w World) -> Result<Box<dyn Integrator + 'w>, MakeError>;

/// The reason why an integrator could not be made from the text of its parameters.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MakeError {
    /// A parameter is unknown, repeated, or has an invalid value.
    #[error(transparent)]
    Parameter(#[from] OptionError),
    /// The scene has an effect that the integrator cannot simulate.
    #[error("{0}")]
    Scene(String),
}

/// An entry of the table of integrators.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct IntegratorEntry {
    /// The integrator's name on the command line.
    pub name: &'static str,
    /// A one-line description of the integrator, for help texts.
    pub about: &'static str,
    /// The publication that the integrator comes from; `docs/references.bib` lists it in full.
    pub source: &'static str,
    /// The integrator's parameters, with their defaults.
    pub parameters: &'static [Parameter],
    make: MakeIntegrator,
}

impl IntegratorEntry {
    /// Makes an entry for a table in another crate.
    pub const fn new(
        [name, about, source]: [&'static str; 3],
        parameters: &'static [Parameter],
        make: MakeIntegrator,
    ) -> Self {
        Self { name, about, source, parameters, make }
    }
}

/// The reason why an integrator could not be made from a request, `NAME` or `NAME:key=value,…`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum IntegratorError {
    /// There is no integrator of this name.
    #[error("there is no integrator \"{name}\"; {} among {known}", nearest.map_or("choose".to_owned(), |n| format!("did you mean \"{n}\"? Choose")))]
    Unknown {
        /// The unknown name.
        name: String,
        /// The known name most similar to the unknown one, if one is similar.
        nearest: Option<&'static str>,
        /// The names of all integrators, separated by commas.
        known: String,
    },
    /// A parameter is wrong, or the scene has an effect that the integrator cannot simulate.
    #[error("{integrator}: {reason}")]
    NotMade {
        /// The name of the integrator.
        integrator: &'static str,
        /// The problem: a parameter error, or the unsupported effect with advice.
        reason: MakeError,
    },
}

/// Returns the table of all integrators, the default first.
pub fn integrators() -> &'static [IntegratorEntry] {
    INTEGRATORS
}

/// Makes an integrator for a world from `NAME` or `NAME:key=value,…`.
///
/// # Errors
///
/// [`IntegratorError`] if the integrator or a parameter is unknown, or if a value is out of range.
///
/// # Examples
///
/// ```
/// use dapple_renderer::{World, integrators, make_integrator};
/// use dapple_scene::bundled;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let scene = bundled::files("teapot").ok_or("no such scene")?.read()?;
/// let world = World::with_resolution(&scene, [16, 12])?;
/// let integrator = make_integrator("ambient-occlusion:distance=0.5", &world)?;
/// assert!(!integrator.wants_training());
/// assert_eq!(integrators()[0].name, "path");
/// # Ok(())
/// # }
/// ```
pub fn make<'w>(request: &str, world: &'w World) -> Result<Box<dyn Integrator + 'w>, IntegratorError> {
    make_among(INTEGRATORS, request, world)
}

/// Makes an integrator as [`make`] does, from a table that may include entries of other crates.
///
/// # Errors
///
/// The errors of [`make`].
pub fn make_among<'w>(
    entries: &'static [IntegratorEntry],
    request: &str,
    world: &'w World,
) -> Result<Box<dyn Integrator + 'w>, IntegratorError> {
    let (entry, parameters) = find(entries, request)?;
    (entry.make)(parameters, world).map_err(|reason| IntegratorError::NotMade { integrator: entry.name, reason })
}

/// Checks a request against a table that may include entries of other crates. The names of the integrator and its parameters
/// must be known. No world is needed, since values are not checked.
///
/// # Errors
///
/// [`IntegratorError`] if the integrator or a parameter is unknown.
pub fn check_among(entries: &'static [IntegratorEntry], request: &str) -> Result<(), IntegratorError> {
    find(entries, request).map(|_| ())
}

/// Returns the table entry of a request and the text of its parameters, after checking the names of both.
fn find<'r>(
    entries: &'static [IntegratorEntry],
    request: &'r str,
) -> Result<(&'static IntegratorEntry, &'r str), IntegratorError> {
    let (name, parameters) = request.split_once(':').unwrap_or((request, ""));
    let names = || entries.iter().map(|entry| entry.name);
    let entry = entries.iter().find(|entry| entry.name == name.trim()).ok_or_else(|| {
        let (nearest, known) = (nearest_name(name, names()), names().collect::<Vec<_>>().join(", "));
        IntegratorError::Unknown { name: name.trim().to_owned(), nearest, known }
    })?;
    let known = parse_pairs(parameters, entry.parameters);
    known.map_err(|e| IntegratorError::NotMade { integrator: entry.name, reason: e.into() })?;
    Ok((entry, parameters))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_and_wrong_ones_refused() {
        let outcome = |request: &str| match find(INTEGRATORS, request) {
            Err(error) => error.to_string(),
            Ok((entry, text)) => AmbientOcclusionOptions::parse(text)
                .map_or_else(|e| e.to_string(), |options| format!("{} {}", entry.name, options.distance)),
        };
        for (request, expected) in [
            ("ambient-occlusion", "ambient-occlusion inf"),
            ("ambient-occlusion: distance = 2.5", "ambient-occlusion 2.5"),
            ("paths", "there is no integrator \"paths\"; did you mean \"path\"? Choose among path, ambient-occlusion"),
            (
                "ambient-occlusion:far",
                "ambient-occlusion: \"far\" is not of the form key=value; give each parameter a value",
            ),
            ("ambient-occlusion:far=1", "ambient-occlusion: there is no parameter \"far\"; known parameters: distance"),
            (
                "ambient-occlusion:distance=1,distance=2",
                "ambient-occlusion: parameter \"distance\" is given twice; remove one",
            ),
            ("ambient-occlusion:distance=-1", "distance = -1 is out of range; allowed: above 0"),
            ("path:distance=1", "path: there is no parameter \"distance\"; known parameters: none"),
        ] {
            assert_eq!(outcome(request), expected);
        }
    }
}
