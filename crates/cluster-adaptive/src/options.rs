//! The parameters of the sampler of [Lan 2016], and errors of first-hit rays, labels and parameters.

use crate::{PixelArea, RateMap};
use dapple_core::options::Options as _;

dapple_core::options! {
    /// The parameters of [`ClusterThesis`](crate::ClusterThesis), the sampler of [Lan 2016].
    ///
    /// The defaults are the thesis' values where it states them. It states no formula for `map`, and no values for the weights
    /// `angle` and `distance`: 0.25 is a guess.
    pub struct ClusterThesisOptions {
        /// Area of a pixel, for size=box or triangles: one (area 1, as published) or footprint (surface seen by the pixel).
        pub pixel: PixelArea = PixelArea::One => "one";
        /// Function that turns pixel area / cluster size into a sampling rate: identity, root (square root) or log.
        pub map: RateMap = RateMap::Root => "root";
        /// Weight of grazing angles (which get more samples); the cluster size has weight 1.
        ///
        /// 0 leaves the angle out.
        pub angle: f64 = 0.25, |weight| weight >= 0.0 && weight.is_finite(), "a weight of 0 or more";
        /// Weight of the distance to the hit (farther hits get more samples); the cluster size has weight 1.
        ///
        /// 0 leaves the distance out.
        pub distance: f64 = 0.25, |weight| weight >= 0.0 && weight.is_finite(), "a weight of 0 or more";
        /// Minimum samples per pixel (with --time or --error use --min-spp); 0 = automatic (rises with spp, after table 4-3 of Lan's thesis).
        ///
        /// [`published_bounds`] returns the values of this table. A render with a time or error limit starts with a small
        /// budget. It fails if that budget cannot give every pixel `min` samples; `--min-spp` raises the budget instead.
        pub min: u32 = 0;
        /// Maximum samples per pixel; 0 = automatic (rises with spp, after table 4-3 of Lan's thesis).
        pub max: u32 = 0;
        /// Shadow rays per cluster to random points on lights, so that penumbras get more samples; 0: none (as published).
        ///
        /// The importance of a cluster is multiplied by `1 + v (1 - v)`, where `v` is the fraction of its shadow rays that
        /// reach a light. Penumbras get up to a quarter more. [Lan 2016] suggests this as future work, without a formula.
        pub lights: u32 = 0, |rays| rays != 1 && rays <= 1024, "0, or 2 to 1024 shadow rays";
    }
}

impl ClusterThesisOptions {
    /// Checks the options without a sampler.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a weight that is negative or not finite, or a maximum below the minimum.
    pub fn check(&self) -> Result<(), Error> {
        self.check_ranges()?;
        if self.max != 0 && self.max < self.min {
            return Err(Error::range("max", self.max, "at least min, or 0 for the table's maximum"));
        }
        Ok(())
    }

    /// The least and the largest sample count per pixel, for a budget of `mean` samples per pixel.
    pub(crate) fn bounds(&self, mean: f64) -> [u32; 2] {
        let [low, high] = published_bounds(mean);
        match (self.min, self.max) {
            (0, 0) => [low, high],
            (0, max) => [low.min(max), max],
            (min, 0) => [min, high.max(min)],
            bounds => bounds.into(),
        }
    }
}

/// The least and the largest sample count per pixel for a budget of `mean` samples per pixel [Lan 2016, table 4-3].
///
/// The table has minima 6, 12, 24, 56 and maxima 16, 32, 48, 80 for means 8, 16, 32, 64. Bounds are interpolated linearly
/// between these means, and proportional to the mean outside. The minimum is rounded down, the maximum up.
pub fn published_bounds(mean: f64) -> [u32; 2] {
    const TABLE: [[f64; 3]; 4] = [[8.0, 6.0, 16.0], [16.0, 12.0, 32.0], [32.0, 24.0, 48.0], [64.0, 56.0, 80.0]];
    let mean = mean.clamp(0.0, f64::from(u32::MAX));
    let at = |column: usize| {
        let [first, .., last] = TABLE;
        if mean <= first[0] {
            return mean * first[column] / first[0];
        }
        match TABLE.windows(2).find(|w| mean <= w[1][0]) {
            Some(w) => w[0][column] + (mean - w[0][0]) * (w[1][column] - w[0][column]) / (w[1][0] - w[0][0]),
            None => mean * last[column] / last[0],
        }
    };
    [at(1).floor() as u32, at(2).ceil() as u32]
}

/// Invalid first-hit rays, clusters or parameters. Each message has a remedy.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A first-hit ray that hit a primitive without a label.
    #[error(
        "pixel ({}, {}): a first-hit ray hits primitive {primitive}, but there are only {labels} cluster labels; give one \
         label per primitive, in the order of the primitives' indices",
        pixel[0],
        pixel[1]
    )]
    NoLabel {
        /// Column and row of the first-hit ray's pixel in the full image.
        pixel: [u32; 2],
        /// The index of the primitive that was hit.
        primitive: u32,
        /// The number of labels.
        labels: usize,
    },
    /// A label that is not the number of a cluster.
    #[error(
        "the cluster label {label} is too large for {clusters} clusters, which are numbered from 0; pass labels and \
         clusters of the same clustering"
    )]
    NoCluster {
        /// The invalid label.
        label: u32,
        /// The number of clusters.
        clusters: usize,
    },
    /// A number of labels that differs from the number of triangles.
    #[error("the numbers of cluster labels ({labels}) and triangles ({triangles}) differ; give one label per triangle")]
    LabelCount {
        /// The number of labels given.
        labels: usize,
        /// The number of triangles.
        triangles: usize,
    },
    /// A triangle with the index of a missing vertex.
    #[error(
        "triangle {triangle} refers to vertex {vertex}, but vertex indices must be below {vertices}; correct the index"
    )]
    NoVertex {
        /// The index of the triangle.
        triangle: usize,
        /// The index of the vertex.
        vertex: u32,
        /// The number of vertices.
        vertices: usize,
    },
    /// A parameter outside its range.
    #[error(transparent)]
    OutOfRange(#[from] dapple_core::options::OutOfRange),
    /// First-hit rays that were traced for another frame than the rendered one.
    #[error(
        "the first-hit rays were traced for {of}, but the frame to render is {wanted}; trace first-hit rays for the frame to render, or let the sampler trace them (ClusterThesis::tracing)"
    )]
    OtherFrame {
        /// The frame of the first-hit rays, as text.
        of: String,
        /// The frame of the render, as text.
        wanted: String,
    },
}

impl Error {
    pub(crate) fn range(name: &'static str, value: impl ToString, allowed: &'static str) -> Self {
        dapple_core::options::OutOfRange { name, value: value.to_string(), allowed }.into()
    }
}

/// Converts parameter errors to [`dapple_core::Error::OutOfRange`], and other errors to [`dapple_core::Error::Other`].
impl From<Error> for dapple_core::Error {
    fn from(error: Error) -> Self {
        match error {
            Error::OutOfRange(wrong) => wrong.into(),
            error => Self::other("cluster-thesis", error),
        }
    }
}
