//! Groups a scene's triangles by place, material and normal: plain slices in, clusters out.

mod clusters;
mod connected;
mod error;
mod greedy;
mod grid;
mod group;
mod params;
mod partition;
mod voxels;

pub use clusters::{Cluster, Clusters, Report};
pub use error::Error;
pub use params::{Grouping, Insertion, Order, Params};
pub use partition::cluster;

/// The triangles to group, as plain slices.
#[derive(Clone, Copy, Debug)]
pub struct Triangles<'a> {
    /// Vertices. Those that no triangle uses may be anything.
    pub positions: &'a [[f32; 3]],
    /// Three vertices each.
    pub indices: &'a [[u32; 3]],
    /// A material each; empty where all are of one.
    pub materials: &'a [u32],
}
