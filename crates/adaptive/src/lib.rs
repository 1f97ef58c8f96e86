#![doc = include_str!("../README.md")]

mod adaptive;
mod cycles;
mod options;
mod pilot;
mod plan;
mod pool;
mod sequence;
mod similar_pool;

pub use adaptive::Adaptive;
pub use cycles::{Cycles, CyclesOptions};
pub use dapple_core::plan::{PilotPolicy, Stopping};
pub use options::{AdaptiveOptions, ErrorMap, MapErrors, VarianceOptions};
pub use pilot::{Pilot, PilotRound};
pub use pool::{PoolShape, Pooling, Sources, relative_variance};
pub use sequence::Sequence;
