//! Errors of names and parameters.

use std::fmt;

/// An error in the description of a sampler, point set or filter.
#[non_exhaustive]
#[derive(Debug)]
pub enum RegistryError {
    /// An unknown name.
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
    Parameter {
        /// The name of the entry.
        of: &'static str,
        /// The fault, and the remedy.
        what: String,
    },
    /// An entry that uses clusters of a scene, without them.
    NeedsWorld {
        /// The name of the entry.
        of: &'static str,
        /// The missing part of the scene, as a noun phrase.
        what: &'static str,
    },
    /// A scene whose surfaces cannot be clustered.
    Clusters {
        /// The name of the entry.
        of: &'static str,
        /// The fault, and the remedy.
        why: String,
    },
    /// A scene in which samples cannot be placed, or coordinates have no meaning.
    Points {
        /// The name of the entry.
        of: &'static str,
        /// The fault, and the remedy.
        why: String,
    },
    /// A filter that this program was built without.
    NotBuilt {
        /// The name of the filter.
        of: &'static str,
        /// The Cargo feature that adds it.
        feature: &'static str,
    },
    /// A filter whose shared library is missing or unsuitable.
    NoLibrary {
        /// The name of the filter.
        of: &'static str,
        /// The fault, and the remedy.
        why: String,
    },
    /// A parameter value that the sampler or filter refuses.
    Core(dapple_core::Error),
}

impl fmt::Display for RegistryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { kind, name, nearest: Some(nearest), known } => {
                write!(f, "there is no {kind} \"{name}\"; did you mean \"{nearest}\"? Choose among {known}")
            }
            Self::Unknown { kind, name, nearest: None, known } => {
                write!(f, "there is no {kind} \"{name}\"; choose among {known}")?;
                f.write_str(if cfg!(feature = "classics") { "" } else { " (the feature \"classics\" adds more)" })
            }
            Self::Parameter { of, what } => write!(f, "{of}: {what}"),
            Self::NeedsWorld { of, what } => {
                write!(f, "{of} needs {what}; give it a world, or cluster inputs that have this")
            }
            Self::Clusters { of, why } => write!(f, "{of}: clusters cannot be made: {why}"),
            Self::Points { of, why } => write!(f, "{of}: samples cannot be placed: {why}"),
            Self::NotBuilt { of, feature } => write!(
                f,
                "the filter \"{of}\" is not in this program; build it with the feature \"{feature}\" (cargo … --features {feature})"
            ),
            Self::NoLibrary { of, why } => write!(f, "{of}: {why}"),
            Self::Core(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for RegistryError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Core(error) => error.source(),
            _ => None,
        }
    }
}

impl From<dapple_core::Error> for RegistryError {
    fn from(error: dapple_core::Error) -> Self {
        Self::Core(error)
    }
}
