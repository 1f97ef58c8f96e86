//! Errors of probes, labels and parameters.

/// Invalid probes, clusters or parameters. Each message has a remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A probe's hit on a primitive that has no label.
    #[error(
        "pixel ({}, {}): a probe hit primitive {primitive}, but there are labels for {labels} only: give one label per \
         primitive, in the numbering of the hits",
        pixel[0],
        pixel[1]
    )]
    NoLabel {
        /// Column and row of the probe's pixel in the full image.
        pixel: [u32; 2],
        /// The index of the primitive that was hit.
        primitive: u32,
        /// The number of labels.
        labels: usize,
    },
    /// A label that names a cluster not in the list.
    #[error(
        "label {label} names no cluster: there are {clusters}, numbered from 0; pass labels and clusters of the same \
         clustering"
    )]
    NoCluster {
        /// The label that names no cluster.
        label: u32,
        /// The number of clusters.
        clusters: usize,
    },
    /// A number of labels that differs from the number of triangles.
    #[error("{labels} labels for {triangles} triangles: give one label per triangle")]
    LabelCount {
        /// The number of labels given.
        labels: usize,
        /// The number of triangles.
        triangles: usize,
    },
    /// A triangle with the index of a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {vertices}")]
    NoVertex {
        /// The index of the triangle.
        triangle: usize,
        /// The index of the vertex.
        vertex: u32,
        /// The number of vertices.
        vertices: usize,
    },
    /// A parameter outside its range.
    #[error("{name} = {value} is out of range: {allowed}")]
    OutOfRange {
        /// The parameter's name on the command line.
        name: &'static str,
        /// The rejected value.
        value: String,
        /// The allowed range, in words.
        allowed: &'static str,
    },
    /// Probes that were traced for another frame than the rendered one.
    #[error("the probes are those of {of}, but {wanted} is rendered: probe that frame, or let the sampler probe")]
    OtherFrame {
        /// The frame of the probes, as text.
        of: String,
        /// The frame of the render, as text.
        wanted: String,
    },
}

impl Error {
    pub(crate) fn range(name: &'static str, value: impl ToString, allowed: &'static str) -> Self {
        Self::OutOfRange { name, value: value.to_string(), allowed }
    }
}

impl From<dapple_core::OutOfRange> for Error {
    fn from(dapple_core::OutOfRange { name, value, allowed }: dapple_core::OutOfRange) -> Self {
        Self::OutOfRange { name, value, allowed }
    }
}

/// Converts errors of parameters to [`dapple_core::Error::OutOfRange`], and other errors to
/// [`dapple_core::Error::Other`].
impl From<Error> for dapple_core::Error {
    fn from(error: Error) -> Self {
        match error {
            Error::OutOfRange { name, value, allowed } => Self::OutOfRange { name, value, allowed },
            error => Self::other("cluster-thesis", error),
        }
    }
}
