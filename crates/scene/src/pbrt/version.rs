//! The versions of the pbrt file format.

/// A version of the pbrt file format, which decides the meaning of directives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Version {
    V2,
    V3,
    #[default]
    V4,
}

impl Version {
    /// Returns true for versions before pbrt-v4.
    pub(super) fn is_old(self) -> bool {
        self < Self::V4
    }

    /// Returns the name of the version, such as "pbrt-v3", for messages.
    pub(super) fn name(self) -> &'static str {
        ["pbrt-v2", "pbrt-v3", "pbrt-v4"][self as usize]
    }
}
