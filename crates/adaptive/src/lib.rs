#![doc = include_str!("../README.md")]

mod adaptive;
mod cycles;
mod options;
mod pilot;
mod plan;
mod pool;
mod similar_pool;
mod then;
mod variance;

pub use adaptive::Adaptive;
pub use cycles::{Cycles, CyclesOptions};
pub use dapple_core::{PilotPolicy, Stopping};
pub use options::{AdaptiveOptions, ErrorMap, MapErrors};
pub use pilot::{Pilot, PilotRound};
pub use pool::{PoolShape, Pooling, Sources, relative_variance};
pub use then::Then;
pub use variance::VarianceOptions;

fn out_of_range(name: &'static str, value: impl ToString, allowed: &'static str) -> dapple_core::Error {
    dapple_core::Error::OutOfRange { name, value: value.to_string(), allowed }
}
