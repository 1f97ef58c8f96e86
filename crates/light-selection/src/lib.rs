#![doc = include_str!("../README.md")]

mod light_cells;

pub use light_cells::{Guidance, LightCellOptions, LightCells};

/// The reason why [`LightCells::new`](crate::LightCells::new) refused its options or its bounding box.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A parameter is outside its range.
    #[error("{name} = {value} is out of range; allowed: {allowed}")]
    OutOfRange {
        /// The name of the parameter, such as "prior".
        name: &'static str,
        /// The value of the parameter, as text.
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
