//! Parsing of `NAME:key=value,…` against an entry's parameters.

use super::{Entry, Parameter};
use dapple_core::{Options, nearest_name, parse_pairs};
use std::str::FromStr;

/// An error in the description of a sampler, point set or filter.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum RegistryError {
    /// An unknown name.
    #[error("there is no {kind} \"{name}\"; {} among {known}", nearest.map_or("choose".to_owned(), |n| format!("did you mean \"{n}\"? Choose")))]
    Unknown {
        /// The kind of entry: sampler, point set or filter.
        kind: &'static str,
        /// The name given.
        name: String,
        /// The known name closest to the given one, if a few edits separate them.
        nearest: Option<&'static str>,
        /// The known names, as a list for messages.
        known: String,
    },
    /// An item that is not `key=value`, an unknown or repeated key, or a wrong value.
    #[error("{of}: {what}")]
    Parameter {
        /// The name of the entry.
        of: &'static str,
        /// The fault, and the remedy.
        what: String,
    },
    /// An entry that reads the world, without one.
    #[error("{of} reads the scene's triangles: give it a world")]
    NeedsWorld {
        /// The name of the entry.
        of: &'static str,
    },
    /// A world whose triangles cannot be clustered.
    #[error("{of}: clusters cannot be made: {why}")]
    Clusters {
        /// The name of the entry.
        of: &'static str,
        /// The fault, and the remedy.
        why: String,
    },
    /// A filter that this program was built without.
    #[error(
        "the filter \"{of}\" is not in this program; build it with the feature \"{feature}\" (cargo … --features {feature})"
    )]
    NotBuilt {
        /// The name of the filter.
        of: &'static str,
        /// The Cargo feature that adds it.
        feature: &'static str,
    },
    /// A filter whose shared library is missing or unsuitable.
    #[error("{of}: {why}")]
    NoLibrary {
        /// The name of the filter.
        of: &'static str,
        /// The fault, and the remedy.
        why: String,
    },
    /// A parameter value that the sampler or filter refuses.
    #[error(transparent)]
    Core(#[from] dapple_core::Error),
}

/// The parameter values of one entry: those given, and defaults for the others.
#[derive(Clone, Debug)]
pub struct Parameters {
    of: &'static str,
    values: Vec<(&'static str, String)>,
}

pub(super) fn find<'a, Make>(
    kind: &'static str,
    entries: &'a [Entry<Make>],
    description: &str,
) -> Result<(&'a Entry<Make>, Parameters), RegistryError> {
    let (name, given) = description.split_once(':').unwrap_or((description, ""));
    let name = name.trim();
    let Some(entry) = entries.iter().find(|entry| entry.is_called(name)) else {
        let names = entries.iter().map(|entry| entry.name);
        let (nearest, known) = (nearest_name(name, names.clone()), names.collect::<Vec<_>>().join(", "));
        return Err(RegistryError::Unknown { kind, name: name.to_owned(), nearest, known });
    };
    let mut parameters = Parameters { of: entry.name, values: Vec::new() };
    let given = parse_pairs(given, entry.parameters()).map_err(|e| parameters.refuse(e.to_string()))?;
    parameters.values.extend(given.into_iter().map(|(name, value)| (name, value.to_owned())));
    for parameter in entry.parameters() {
        if !parameters.values.iter().any(|v| v.0 == parameter.name) {
            parameters.values.push((parameter.name, parameter.default.to_owned()));
        }
    }
    Ok((entry, parameters))
}

impl Parameters {
    pub(super) fn refuse(&self, what: String) -> RegistryError {
        RegistryError::Parameter { of: self.of, what }
    }

    /// The entry's name.
    pub(super) fn of(&self) -> &'static str {
        self.of
    }

    /// The values of the parameters that the options type `T` declares.
    pub(super) fn options<T: Options>(&self) -> Result<T, RegistryError> {
        let mut options = T::default();
        for parameter in T::PARAMETERS {
            options.set(parameter.name, self.value(parameter.name)).map_err(|e| self.refuse(e.to_string()))?;
        }
        options.check_ranges().map_err(|e| self.refuse(e.to_string()))?;
        Ok(options)
    }

    /// The parameters of `group` as `key=value,…`.
    pub(super) fn described(&self, group: &[Parameter]) -> String {
        group.iter().map(|p| format!("{}={}", p.name, self.value(p.name))).collect::<Vec<_>>().join(",")
    }

    pub(super) fn value(&self, key: &str) -> &str {
        self.values.iter().find(|v| v.0 == key).map_or("", |v| &v.1)
    }

    pub(super) fn number<T: FromStr>(&self, key: &str) -> Result<T, RegistryError> {
        let value = self.value(key);
        value.parse().map_err(|_| self.refuse(format!("{key} = \"{value}\": a number is required")))
    }

    pub(super) fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Result<T, RegistryError> {
        let value = self.value(key);
        choices.iter().find(|c| c.0 == value).map(|c| c.1).ok_or_else(|| {
            let known = choices.iter().map(|c| c.0).collect::<Vec<_>>().join(", ");
            self.refuse(format!("{key} = \"{value}\": one of {known} is required"))
        })
    }
}
