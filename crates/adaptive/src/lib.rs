#![doc = include_str!("../README.md")]

mod adaptive;
mod alike;
mod cells;
mod cost;
mod cycles;
mod disjoint;
mod options;
mod pilot;
mod plan;
mod pool;
mod variance;

pub use adaptive::Adaptive;
pub use cells::{CellOptions, Cells};
pub use cycles::{Cycles, CyclesOptions};
pub use dapple_core::{PilotPolicy, Stopping};
pub use options::{AdaptiveOptions, ErrorMap, MapErrors};
pub use pilot::{Pilot, PilotRound};
pub use pool::{PoolShape, Pooling, Sources, geometric_variance, relative_variance};
pub use variance::VarianceOptions;

fn out_of_range(name: &'static str, value: impl ToString, allowed: &'static str) -> dapple_core::Error {
    dapple_core::Error::OutOfRange { name, value: value.to_string(), allowed }
}
