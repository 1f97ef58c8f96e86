#![doc = include_str!("../README.md")]

mod area_vectors;
mod error;
mod importance;
mod options;
mod probe;
mod sampler;
mod size;

pub use area_vectors::AreaVectors;
pub use error::Error;
pub use importance::{Importance, RateMap, TraceVisibility, importance, visibility_variances};
pub use options::{ClusterThesisOptions, published_bounds};
pub use probe::{BACKGROUND, Placement, Probe, ProbeCost, ProbeHit, ProbeRay, Probes, probe};
pub use sampler::{ClusterThesis, ProbeSource, ProbesHandle, TraceProbe};
pub use size::{ClusterSize, PixelArea, Rates, projected_box_area, rates};
