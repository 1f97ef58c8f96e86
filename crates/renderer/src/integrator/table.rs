//! The table of integrators by name.

use super::{AmbientOcclusion, integrator};
use crate::World;
use dapple_core::Integrator;
use std::str::FromStr;

/// The integrators, the default first. A new one is a file beside this one and a line here.
const INTEGRATORS: &[IntegratorEntry] = &[
    IntegratorEntry {
        name: "path",
        about: "path tracing with next-event estimation and multiple importance sampling (the default)",
        parameters: &[],
        make: |_, world| Ok(integrator(world)),
    },
    IntegratorEntry {
        name: "ambient-occlusion",
        about: "the open share of the hemisphere above each surface, without lights and materials",
        parameters: &[("distance", "inf", "the largest distance of an occluder, in lengths of the scene file")],
        make: AmbientOcclusion::from_parameters,
    },
];

/// Makes an integrator from its parameters.
type MakeIntegrator = for<'w> fn(&IntegratorParameters, &'w World) -> Result<Box<dyn Integrator + 'w>, IntegratorError>;

/// One integrator of the table.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct IntegratorEntry {
    /// The name on the command line.
    pub name: &'static str,
    /// A description in one line.
    pub about: &'static str,
    /// Name, default, and a description in one line of each parameter.
    pub parameters: &'static [(&'static str, &'static str, &'static str)],
    make: MakeIntegrator,
}

/// A request for an integrator that cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum IntegratorError {
    /// An unknown name.
    #[error("integrator \"{name}\" is unknown; give {known}")]
    Unknown {
        /// The name.
        name: String,
        /// The names of the table.
        known: String,
    },
    /// A parameter that is unknown, repeated, or has no valid value.
    #[error("integrator \"{integrator}\": {problem}")]
    Parameter {
        /// The integrator.
        integrator: &'static str,
        /// The problem, and its remedy.
        problem: String,
    },
}

/// The values of an integrator's parameters: those given, or the defaults.
#[derive(Clone, Debug)]
pub struct IntegratorParameters {
    integrator: &'static str,
    values: Vec<(&'static str, String)>,
}

/// All integrators, the default first.
pub fn integrators() -> &'static [IntegratorEntry] {
    INTEGRATORS
}

/// Makes an integrator for a world from `NAME` or `NAME:key=value,…`.
///
/// # Errors
///
/// For an unknown name or parameter, and for a value out of range.
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
    let (entry, parameters) = IntegratorParameters::parse(request)?;
    (entry.make)(&parameters, world)
}

impl IntegratorParameters {
    /// Reads a request.
    fn parse(request: &str) -> Result<(&'static IntegratorEntry, Self), IntegratorError> {
        let (name, pairs) = request.split_once(':').unwrap_or((request, ""));
        let name = name.trim();
        let Some(entry) = INTEGRATORS.iter().find(|entry| entry.name == name) else {
            let known = INTEGRATORS.iter().map(|entry| entry.name).collect::<Vec<_>>().join(", ");
            return Err(IntegratorError::Unknown { name: name.to_owned(), known });
        };
        let mut parameters = Self { integrator: entry.name, values: Vec::new() };
        for pair in pairs.split(',').map(str::trim).filter(|pair| !pair.is_empty()) {
            let Some((key, value)) = pair.split_once('=') else {
                return Err(parameters.refuse(format!("\"{pair}\" has no value; give key=value")));
            };
            let Some(&(key, ..)) = entry.parameters.iter().find(|parameter| parameter.0 == key.trim()) else {
                let known = entry.parameters.iter().map(|parameter| parameter.0).collect::<Vec<_>>().join(", ");
                let known = if known.is_empty() { "none".into() } else { known };
                return Err(parameters.refuse(format!("parameter \"{}\" is unknown; it takes {known}", key.trim())));
            };
            if parameters.values.iter().any(|value| value.0 == key) {
                return Err(parameters.refuse(format!("parameter \"{key}\" is repeated; give it once")));
            }
            parameters.values.push((key, value.trim().to_owned()));
        }
        for &(key, default, _) in entry.parameters {
            if !parameters.values.iter().any(|value| value.0 == key) {
                parameters.values.push((key, default.to_owned()));
            }
        }
        Ok((entry, parameters))
    }

    fn refuse(&self, problem: String) -> IntegratorError {
        IntegratorError::Parameter { integrator: self.integrator, problem }
    }

    /// The value of a parameter, which must be `valid`.
    pub(super) fn number<T: FromStr>(&self, key: &str, valid: impl Fn(&T) -> bool) -> Result<T, IntegratorError> {
        let value = self.values.iter().find(|value| value.0 == key).map_or("", |value| &value.1);
        let number = value.parse().ok().filter(valid);
        number.ok_or_else(|| self.refuse(format!("{key}=\"{value}\" is out of range; give a number above 0")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(request: &str) -> String {
        IntegratorParameters::parse(request).map_or_else(
            |e| e.to_string(),
            |(entry, parameters)| {
                let distance = parameters.number("distance", |distance: &f64| *distance > 0.0);
                distance.map_or_else(|e| e.to_string(), |distance| format!("{} {distance}", entry.name))
            },
        )
    }

    #[test]
    fn requests_are_read_and_wrong_ones_refused() {
        assert_eq!(refused("ambient-occlusion"), "ambient-occlusion inf");
        assert_eq!(refused("ambient-occlusion: distance = 2.5"), "ambient-occlusion 2.5");
        assert_eq!(refused("paths"), "integrator \"paths\" is unknown; give path, ambient-occlusion");
        let wrong = |problem: &str| format!("integrator \"ambient-occlusion\": {problem}");
        assert_eq!(refused("ambient-occlusion:far"), wrong("\"far\" has no value; give key=value"));
        assert_eq!(refused("ambient-occlusion:far=1"), wrong("parameter \"far\" is unknown; it takes distance"));
        let twice = "ambient-occlusion:distance=1,distance=2";
        assert_eq!(refused(twice), wrong("parameter \"distance\" is repeated; give it once"));
        let range = wrong("distance=\"-1\" is out of range; give a number above 0");
        assert_eq!(refused("ambient-occlusion:distance=-1"), range);
        assert_eq!(refused("path:distance=1"), "integrator \"path\": parameter \"distance\" is unknown; it takes none");
    }
}
