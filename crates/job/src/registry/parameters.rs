//! `NAME:key=value,…`, checked against what an entry takes.

use super::{Entry, Parameter};
use std::str::FromStr;

/// Why words name nothing that can be made.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum RegistryError {
    /// An unknown name.
    #[error("there is no {kind} \"{name}\": there are {known}")]
    Unknown {
        /// Sampler, point set or filter.
        kind: &'static str,
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// Words that are no `key=value`, an unknown key, a key twice, or a value that is none.
    #[error("{of}: {what}")]
    Parameter {
        /// The entry.
        of: &'static str,
        /// What is wrong, and what to do.
        what: String,
    },
    /// It looks at the world, and there is none.
    #[error("{of} looks at the scene's triangles: give it a stage with a world")]
    NeedsWorld {
        /// The entry.
        of: &'static str,
    },
    /// The world's triangles cannot be grouped.
    #[error("{of}: clusters cannot be made: {why}")]
    Clusters {
        /// The entry.
        of: &'static str,
        /// What is wrong, and what to do.
        why: String,
    },
    /// A value that the sampler refuses.
    #[error(transparent)]
    Core(#[from] dapple_core::Error),
}

/// The parameters of one entry: what was said, else the default.
#[derive(Clone, Debug)]
pub struct Parameters {
    of: &'static str,
    values: Vec<(&'static str, String)>,
}

pub(super) fn find<'a, Make>(
    kind: &'static str,
    entries: &'a [Entry<Make>],
    words: &str,
) -> Result<(&'a Entry<Make>, Parameters), RegistryError> {
    let (name, said) = words.split_once(':').unwrap_or((words, ""));
    let Some(entry) = entries.iter().find(|e| e.name == name.trim()) else {
        let known = entries.iter().map(|e| e.name).collect::<Vec<_>>().join(", ");
        return Err(RegistryError::Unknown { kind, name: name.trim().to_owned(), known });
    };
    let mut parameters = Parameters { of: entry.name, values: Vec::new() };
    for pair in said.split(',').map(str::trim).filter(|p| !p.is_empty()) {
        let Some((key, value)) = pair.split_once('=') else {
            return Err(parameters.refuse(format!("\"{pair}\" is no key=value")));
        };
        let Some(&(key, ..)) = entry.parameters().find(|p| p.0 == key.trim()) else {
            let known = entry.parameters().map(|p| p.0).collect::<Vec<_>>().join(", ");
            let known = if known.is_empty() { "it takes none".into() } else { format!("it takes {known}") };
            return Err(parameters.refuse(format!("there is no parameter \"{}\": {known}", key.trim())));
        };
        if parameters.values.iter().any(|v| v.0 == key) {
            return Err(parameters.refuse(format!("{key} is given twice")));
        }
        parameters.values.push((key, value.trim().to_owned()));
    }
    for &(key, default, _) in entry.parameters() {
        if !parameters.values.iter().any(|v| v.0 == key) {
            parameters.values.push((key, default.to_owned()));
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

    /// The parameters of a group, as words.
    pub(super) fn described(&self, group: &[Parameter]) -> String {
        group.iter().map(|(key, ..)| format!("{key}={}", self.value(key))).collect::<Vec<_>>().join(",")
    }

    pub(super) fn value(&self, key: &str) -> &str {
        self.values.iter().find(|v| v.0 == key).map_or("", |v| &v.1)
    }

    pub(super) fn number<T: FromStr>(&self, key: &str) -> Result<T, RegistryError> {
        let value = self.value(key);
        value.parse().map_err(|_| self.refuse(format!("{key}={value}: a number is wanted")))
    }

    pub(super) fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Result<T, RegistryError> {
        let value = self.value(key);
        choices.iter().find(|c| c.0 == value).map(|c| c.1).ok_or_else(|| {
            let known = choices.iter().map(|c| c.0).collect::<Vec<_>>().join(", ");
            self.refuse(format!("{key}={value}: one of {known} is wanted"))
        })
    }
}
