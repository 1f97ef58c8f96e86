//! The error of this crate.

/// An option or a box that [`LightCells::new`](crate::LightCells::new) refuses.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A parameter outside its range.
    #[error("{name} = {value} is out of range: {allowed}")]
    OutOfRange {
        /// The name of the parameter.
        name: &'static str,
        /// The value given.
        value: String,
        /// The allowed range, as text for the message.
        allowed: &'static str,
    },
}

impl Error {
    pub(crate) fn range(name: &'static str, value: impl ToString, allowed: &'static str) -> Self {
        Self::OutOfRange { name, value: value.to_string(), allowed }
    }
}
