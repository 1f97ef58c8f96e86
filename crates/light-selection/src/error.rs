//! The error of this crate.

use std::fmt;

/// The reason why [`LightCells::new`](crate::LightCells::new) refused its options or its bounding box.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum Error {
    /// A parameter is outside its range.
    OutOfRange {
        /// The name of the parameter, such as "prior".
        name: &'static str,
        /// The value of the parameter, as text.
        value: String,
        /// The allowed range, as text for the message.
        allowed: &'static str,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { name, value, allowed } => write!(f, "{name} = {value} is out of range: {allowed}"),
        }
    }
}

impl std::error::Error for Error {}

impl Error {
    pub(crate) fn range(name: &'static str, value: impl ToString, allowed: &'static str) -> Self {
        Self::OutOfRange { name, value: value.to_string(), allowed }
    }
}
