//! Parsing of `NAME:key=value,…` against an entry's parameters.

use crate::{Entry, Parameter, RegistryError};
use dapple_core::options::{Options, nearest_name, parse_pairs};
use std::str::FromStr;

/// The parameter values of one entry: the given values, and defaults for the other parameters.
#[derive(Clone, Debug)]
pub struct Parameters {
    of: &'static str,
    values: Vec<(&'static str, String)>,
}

pub(crate) fn find<'a, Make>(
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
    let given = parse_pairs(given, entry.parameters()).map_err(|e| parameters.refuse(e))?;
    parameters.values.extend(given.into_iter().map(|(name, value)| (name, value.to_owned())));
    for parameter in entry.parameters() {
        if !parameters.values.iter().any(|v| v.0 == parameter.name) {
            parameters.values.push((parameter.name, parameter.default.to_owned()));
        }
    }
    Ok((entry, parameters))
}

impl Parameters {
    /// Creates the sampler or filter that the parameter `key` describes, with `/` in place of `:` and `,`:
    /// `cluster-thesis/k=9/clamp=16`. A description within that description uses `//`, and so on. `make` receives the
    /// description with `:` and `,`.
    pub(crate) fn nested<T>(
        &self,
        key: &str,
        make: impl FnOnce(&str) -> Result<T, RegistryError>,
    ) -> Result<T, RegistryError> {
        let value = self.value(key);
        if value.contains(':') {
            let inner = dapple_core::options::nested(value);
            return Err(self.refuse(format!(
                "{key} = \"{value}\" contains \":\"; write \"/\" for \":\" and \",\", as in {key}={inner}"
            )));
        }
        make(&dapple_core::options::unnested(value)).map_err(|error| match error {
            RegistryError::Unknown { .. } | RegistryError::Parameter { .. } => {
                self.refuse(format!("{key} = \"{value}\": {error}"))
            }
            other => other,
        })
    }

    pub(crate) fn refuse(&self, what: impl ToString) -> RegistryError {
        RegistryError::Parameter { of: self.of, what: what.to_string() }
    }

    /// Converts an error of creating a method to an error about the entry's parameters.
    pub(crate) fn made<T>(&self, made: Result<T, impl ToString>) -> Result<T, RegistryError> {
        made.map_err(|e| self.refuse(e))
    }

    /// The entry's name.
    pub(crate) fn of(&self) -> &'static str {
        self.of
    }

    /// The values of the parameters that the options type `T` declares.
    pub(crate) fn options<T: Options>(&self) -> Result<T, RegistryError> {
        let mut options = T::default();
        for parameter in T::PARAMETERS {
            self.made(options.set(parameter.name, self.value(parameter.name)))?;
        }
        self.made(options.check_ranges())?;
        Ok(options)
    }

    /// The parameters of `group` as `key=value,…`.
    pub(crate) fn described(&self, group: &[Parameter]) -> String {
        group.iter().map(|p| format!("{}={}", p.name, self.value(p.name))).collect::<Vec<_>>().join(",")
    }

    pub(crate) fn value(&self, key: &str) -> &str {
        self.values.iter().find(|v| v.0 == key).map_or("", |v| &v.1)
    }

    pub(crate) fn number<T: FromStr>(&self, key: &str) -> Result<T, RegistryError> {
        let value = self.value(key);
        value.parse().map_err(|_| self.refuse(format!("{key} = \"{value}\" is not a number; give a number")))
    }

    pub(crate) fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Result<T, RegistryError> {
        let value = self.value(key);
        choices.iter().find(|c| c.0 == value).map(|c| c.1).ok_or_else(|| {
            let known = choices.iter().map(|c| c.0).collect::<Vec<_>>().join(", ");
            self.refuse(format!("{key} = \"{value}\" is unknown; use one of {known}"))
        })
    }
}
