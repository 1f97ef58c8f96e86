#![doc = include_str!("../README.md")]

mod importance;
mod options;
mod probe;
mod sampler;
mod size;

pub use importance::{Importance, RateMap, TraceVisibility, importance, visibility_variances};
pub use options::{ClusterThesisOptions, Error, published_bounds};
pub use probe::{BACKGROUND, Placement, Probe, ProbeCost, ProbeHit, ProbeRay, Probes, probe};
pub use sampler::{ClusterThesis, ProbeSource, ProbesHandle, TraceProbe};
pub use size::{AreaVectors, ClusterSize, PixelArea, Rates, projected_box_area, rates};
