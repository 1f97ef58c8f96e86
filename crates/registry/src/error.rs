//! Errors in names and parameters.

/// An error in the description of a sampler, point set or filter.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum RegistryError {
    /// An unknown name.
    #[error("there is no {kind} \"{name}\"; {}", choice(*nearest, known))]
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
    /// An entry that needs clusters or another input from the scene, which is missing.
    #[error("{of} needs {what}; pass ClusterInputs that provide this, such as those of a world")]
    NeedsWorld {
        /// The name of the entry.
        of: &'static str,
        /// The missing input, as a noun phrase.
        what: &'static str,
    },
    /// A scene whose surfaces cannot be clustered.
    #[error("{of}: clustering failed: {why}")]
    Clusters {
        /// The name of the entry.
        of: &'static str,
        /// The fault, and the remedy.
        why: String,
    },
    /// A scene in which samples cannot be placed, or in which the meaning of sample coordinates is unknown.
    #[error("{of}: samples cannot be placed: {why}")]
    Points {
        /// The name of the entry.
        of: &'static str,
        /// The fault, and the remedy.
        why: String,
    },
    /// A filter that is not built into this program.
    #[error(
        "the filter \"{of}\" is not in this program; build Dapple with the feature \"{feature}\" (cargo … --features {feature})"
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

/// The end of the message about an unknown name.
fn choice(nearest: Option<&str>, known: &str) -> String {
    match nearest {
        Some(nearest) => format!("did you mean \"{nearest}\"? Choose among {known}"),
        None if cfg!(feature = "classics") => format!("choose among {known}"),
        None => format!("choose among {known} (the feature \"classics\" adds more)"),
    }
}

impl From<RegistryError> for dapple_core::Error {
    fn from(error: RegistryError) -> Self {
        Self::Method(Box::new(error))
    }
}
