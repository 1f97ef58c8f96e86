//! Errors of probes, labels and parameters.

use std::fmt;

/// Invalid probes, clusters or parameters. Each message has a remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum Error {
    /// A probe's hit on a primitive that has no label.
    NoLabel {
        /// Column and row of the probe's pixel in the full image.
        pixel: [u32; 2],
        /// The index of the primitive that was hit.
        primitive: u32,
        /// The number of labels.
        labels: usize,
    },
    /// A label that names a cluster not in the list.
    NoCluster {
        /// The label that names no cluster.
        label: u32,
        /// The number of clusters.
        clusters: usize,
    },
    /// A number of labels that differs from the number of triangles.
    LabelCount {
        /// The number of labels given.
        labels: usize,
        /// The number of triangles.
        triangles: usize,
    },
    /// A triangle with the index of a vertex that does not exist.
    NoVertex {
        /// The index of the triangle.
        triangle: usize,
        /// The index of the vertex.
        vertex: u32,
        /// The number of vertices.
        vertices: usize,
    },
    /// A parameter outside its range.
    OutOfRange {
        /// The parameter's name on the command line.
        name: &'static str,
        /// The rejected value.
        value: String,
        /// The allowed range, in words.
        allowed: &'static str,
    },
    /// Probes that were traced for another frame than the rendered one.
    OtherFrame {
        /// The frame of the probes, as text.
        of: String,
        /// The frame of the render, as text.
        wanted: String,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoLabel { pixel, primitive, labels } => write!(
                f,
                "pixel ({}, {}): a probe hit primitive {primitive}, but there are labels for {labels} only: give one \
                 label per primitive, in the numbering of the hits",
                pixel[0], pixel[1]
            ),
            Self::NoCluster { label, clusters } => write!(
                f,
                "label {label} names no cluster: there are {clusters}, numbered from 0; pass labels and clusters of \
                 the same clustering"
            ),
            Self::LabelCount { labels, triangles } => {
                write!(f, "{labels} labels for {triangles} triangles: give one label per triangle")
            }
            Self::NoVertex { triangle, vertex, vertices } => {
                write!(f, "triangle {triangle} names vertex {vertex}, but there are {vertices}")
            }
            Self::OutOfRange { name, value, allowed } => write!(f, "{name} = {value} is out of range: {allowed}"),
            Self::OtherFrame { of, wanted } => write!(
                f,
                "the probes are those of {of}, but {wanted} is rendered: probe that frame, or let the sampler probe"
            ),
        }
    }
}

impl std::error::Error for Error {}

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
