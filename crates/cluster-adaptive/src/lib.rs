#![doc = include_str!("../README.md")]

mod first_hits;
mod importance;
mod options;
mod sampler;
mod size;

pub use first_hits::{
    BACKGROUND, ClusterHit, FirstHitRay, FirstHitSurface, FirstHits, FirstHitsCost, Placement, first_hits,
};
pub use importance::{Importance, RateMap, TraceVisibility, importance, visibility_variances};
pub use options::{ClusterThesisOptions, Error, published_bounds};
pub use sampler::{ClusterThesis, FirstHitSource, FirstHitsHandle, TraceFirstHit};
pub use size::{AreaVectors, ClusterSize, PixelArea, Rates, projected_box_area, rates};
