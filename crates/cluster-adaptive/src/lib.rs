#![doc = include_str!("../README.md")]

mod area_vectors;
mod cells;
mod disjoint;
mod error;
mod error_driven;
mod importance;
mod light_cells;
mod options;
mod probe;
mod sampler;
mod screen;
mod size;

pub use area_vectors::AreaVectors;
pub use cells::{CellOptions, Cells};
pub use error::Error;
pub use error_driven::{
    Adaptive, AdaptiveOptions, ErrorMap, MapErrors, PoolShape, Pooling, geometric_variance, relative_variance,
};
pub use importance::{Importance, RateMap, importance};
pub use light_cells::{Guidance, LightCellOptions, LightCells};
pub use options::{ClusterThesisOptions, published_bounds};
pub use probe::{BACKGROUND, Placement, Probe, ProbeCost, ProbeHit, ProbeRay, Probes, probe};
pub use sampler::{ClusterThesis, ProbeSource, ProbesHandle, TraceProbe};
pub use screen::projected_box_area;
pub use size::{ClusterSize, PixelArea, Rates, rates};
