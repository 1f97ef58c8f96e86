#![doc = include_str!("../README.md")]

mod error;
mod light_cells;

pub use error::Error;
pub use light_cells::{Guidance, LightCellOptions, LightCells};
