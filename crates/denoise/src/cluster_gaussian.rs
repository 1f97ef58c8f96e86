//! The Gaussian filter that favours pixels of the same cluster.

use crate::Gaussian;
use crate::gaussian::{emission, mean_and_presence, memory, normalised, squared_error, variances};
use crate::inputs::{BACKGROUND, ClusterLookup, describe};
use crate::planes::per_pixel;
use dapple_core::options::Options as _;
use dapple_core::{Error, Film, Filter, Filtered, Frame, Needs, filter::FilterMemory, parallel};
use std::fmt;

dapple_core::options! {
    /// The parameters of [`ClusterGaussian`] besides its kernel.
    pub struct ClusterGaussianOptions {
        /// Weight of a pixel of another cluster, relative to a pixel of the same cluster; 1 ignores clusters.
        ///
        /// The table shows the ratio of the relMSE to the lowest relMSE of any `outside`, as the geometric mean over five
        /// synthetic images at 8 to 64 spp (`tests/denoise/filters.rs`). In some images the clusters miss edges, in others they
        /// cut smooth gradients.
        ///
        /// | `outside` | 0 | 0.01 | 0.03 | 0.05 | 0.07 | 0.1 | 0.2 | 1 |
        /// |---|---|---|---|---|---|---|---|---|
        /// | 1 first hit | 1.124 | 1.117 | 1.108 | 1.103 | 1.100 | 1.101 | 1.130 | 1.608 |
        /// | 4 first hits | 1.101 | 1.098 | 1.095 | 1.094 | 1.097 | 1.105 | 1.156 | 1.704 |
        pub outside: f64 = 0.05,
            |w| (0.0..=1.0).contains(&w), "0 (nothing crosses a border) to 1 (clusters do not matter)";
        /// Number of first hits per pixel whose clusters are compared: 1 (as published) to 8.
        ///
        /// Has no effect on a filter with a map of clusters.
        pub hits: u8 = 1, |hits| hits > 0 && usize::from(hits) <= MOST_VOTES, "1 to 8 first hits per pixel";
    }
}

/// The source of a pixel's clusters.
#[derive(Clone)]
enum Clusters {
    Map { size: [u32; 2], clusters: Vec<u32> },
    Hits(ClusterLookup),
}

/// A [`Gaussian`] in which pixels of other clusters weigh less.
///
/// The weight of the Gaussian is multiplied by
///
/// `outside + (1 - outside) overlap`
///
/// where `overlap` is 1 for pixels `p` and `q` in the same cluster and 0 for pixels in different ones. If the fraction `p_c` of
/// the samples of `p` lies in cluster `c`, and `q_c` likewise, `overlap` is the sum of `min(p_c, q_c)` over all clusters. With
/// `outside` 1 the filter is the plain Gaussian; with 0 nothing crosses a cluster's border.
///
/// The cluster-adaptive thesis "modified [its Gaussian] to favour same-cluster pixels" but gives no formula.
///
/// # Clusters
///
/// Clusters come from a map ([`from_map`](Self::from_map)) or from the first hits of a pixel's first samples
/// ([`from_hits`](Self::from_hits)).
/// The thesis uses one first hit per pixel. Four first hits reveal that a pixel lies on an edge: the error on a slanted edge at
/// 64 spp is 0.6 times as large (`tests/denoise/filters.rs`).
///
/// With first hits, clusters and values come from the same samples. In pixels with several clusters, weights and values are
/// therefore not quite independent.
///
/// Unequal sample counts, borders, pixels without samples and [`Filtered::error`] are handled as in [`Gaussian`]. If `outside`
/// is 0 and clusters exclude every sample in reach of a pixel, the plain Gaussian fills it.
///
/// ```
/// use dapple_core::{Film, Filter, Frame, Needs};
/// use dapple_denoise::{ClusterGaussian, ClusterGaussianOptions};
///
/// let mut film = Film::new(Frame::new(4, 1)?, Needs::none());
/// for (pixel, value) in [0.0, 0.0, 1.0, 1.0].into_iter().enumerate() {
///     film.push(pixel, 0, [value; 3]);
/// }
/// let filter = ClusterGaussian::from_map([4, 1], vec![7, 7, 9, 9])?;
/// let filter = filter.with_options(ClusterGaussianOptions::default().outside(0.0))?;
/// assert_eq!(filter.apply(&film)?.radiance, film.image(), "nothing crosses the border");
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone)]
pub struct ClusterGaussian {
    kernel: Gaussian,
    options: ClusterGaussianOptions,
    clusters: Clusters,
    described: String,
}

impl ClusterGaussian {
    /// Creates a filter from the cluster number of each pixel, in row-major order from the top. `size` is the width and height
    /// of the film. Any number may represent the background, such as `u32::MAX`.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `clusters` has `size[0] * size[1]` entries.
    pub fn from_map(size: [u32; 2], clusters: Vec<u32>) -> Result<Self, Error> {
        let [width, height] = size;
        if u64::from(width) * u64::from(height) != clusters.len() as u64 {
            let value = format!("{} for {width}x{height} pixels", clusters.len());
            let allowed = "one cluster for each pixel of the film's window, row by row";
            return Err(Error::OutOfRange { name: "clusters", value, allowed });
        }
        Ok(Self::new(Clusters::Map { size, clusters }))
    }

    /// Creates a filter with clusters from the film's first hits. The film must record [`ClusterGaussianOptions::hits`] first
    /// hits per pixel.
    ///
    /// Each first hit votes for the cluster that `label` returns. A miss or `None` is a vote for the background. With one vote,
    /// as published, a single sample determines the pixel's cluster.
    pub fn from_hits(label: ClusterLookup) -> Self {
        Self::new(Clusters::Hits(label))
    }

    fn new(clusters: Clusters) -> Self {
        let (kernel, options) = (Gaussian::default(), ClusterGaussianOptions::default());
        Self { kernel, options, clusters, described: String::new() }
    }

    /// Replaces the kernel.
    pub fn with_kernel(self, kernel: Gaussian) -> Self {
        Self { kernel, ..self }
    }

    /// Sets the parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(self, options: ClusterGaussianOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { options, ..self })
    }

    /// Appends `described` to the filter's description: the parameters of the clusters, such as `k=9,clamp=32`.
    pub fn with_described(self, described: impl Into<String>) -> Self {
        Self { described: described.into(), ..self }
    }

    /// Filters a film. `members` holds the clusters of each pixel; `overlap` returns the fraction that two pixels have in
    /// common.
    fn blend<M: Sync>(&self, film: &Film, members: &[M], overlap: impl Fn(&M, &M) -> f64 + Sync) -> Filtered {
        let (size, pixels) = (film.frame().size(), film.frame().pixels());
        let emission = emission(film);
        let emission = emission.as_deref();
        let variances = variances(film);
        let plane = Plane {
            size: size.map(|n| n as usize),
            means: per_pixel(pixels, |i| mean_and_presence(film, emission, i)),
            variances: variances.as_deref(),
            members,
        };
        // The factor is 0 or at least 2^-53 for any `outside`, so its square does not underflow.
        let cut = 1.0 - self.options.outside;
        let (width, weights) = (plane.size[0], self.kernel.weights());
        let (mut radiance, mut error) = (vec![[0.0; 3]; pixels], vec![0.0; pixels]);
        let rows = radiance.chunks_mut(width).zip(error.chunks_mut(width));
        parallel::parts(rows, |y, (radiance, error)| {
            for (x, (radiance, error)) in radiance.iter_mut().zip(&mut **error).enumerate() {
                let (mut sum, mut noise) = plane.gather(weights, [x, y], |a, b| 1.0 - cut * (1.0 - overlap(a, b)));
                if sum[3] <= 0.0 {
                    // Clusters exclude every sample in reach.
                    (sum, noise) = plane.gather(weights, [x, y], |_, _| 1.0);
                }
                *radiance = normalised(sum, emission, y * width + x);
                *error = squared_error(noise, sum[3]);
            }
        });
        Filtered::new(size, radiance).with_error(variances.map(|_| error))
    }
}

/// The film's means, variances and clusters, row by row.
struct Plane<'a, M> {
    size: [usize; 2],
    means: Vec<[f64; 4]>,
    variances: Option<&'a [f64]>,
    members: &'a [M],
}

impl<M> Plane<'_, M> {
    /// The sums over the kernel around pixel (x, y) of two products: weight times mean and presence, and squared weight times
    /// variance. `factor` returns the factor on the weight for two pixels.
    #[inline]
    fn gather(&self, weights: &[f64], [x, y]: [usize; 2], factor: impl Fn(&M, &M) -> f64) -> ([f64; 4], f64) {
        let [width, height] = self.size;
        let n = weights.len() / 2;
        let own = &self.members[y * width + x];
        let (left, right) = (x.saturating_sub(n), (x + n + 1).min(width));
        let across = &weights[left + n - x..right + n - x];
        let (mut sum, mut noise) = ([0.0; 4], 0.0);
        for source in y.saturating_sub(n)..(y + n + 1).min(height) {
            let down = weights[source + n - y];
            let row = source * width + left..source * width + right;
            let (means, members) = (&self.means[row.clone()], &self.members[row.clone()]);
            for (((weight, mean), member), i) in across.iter().zip(means).zip(members).zip(row) {
                let weight = down * weight * factor(own, member);
                for (sum, mean) in sum.iter_mut().zip(mean) {
                    *sum += weight * mean;
                }
                // An unknown variance is infinite; times a weight of 0 it would be NaN.
                if let Some(variances) = self.variances
                    && weight > 0.0
                {
                    noise += weight * weight * variances[i];
                }
            }
        }
        (sum, noise)
    }
}

impl fmt::Debug for ClusterGaussian {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ClusterGaussian({})", self.describe())
    }
}

impl Filter for ClusterGaussian {
    fn name(&self) -> &str {
        "cluster-gaussian"
    }

    fn describe(&self) -> String {
        let own = match &self.clusters {
            Clusters::Map { .. } => format!("outside={},clusters=map", self.options.outside),
            Clusters::Hits(_) => self.options.describe(),
        };
        let comma = if self.described.is_empty() { "" } else { "," };
        describe(self.name(), &self.kernel.options(), &format!("{own}{comma}{}", self.described))
    }

    fn needs(&self) -> Needs {
        let hits = if let Clusters::Hits(_) = self.clusters { self.options.hits } else { 0 };
        Needs::none().with_emission().with_first_hits(hits)
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let votes = if let Clusters::Hits(_) = self.clusters { size_of::<Votes>() } else { 0 };
        // Means and presence, the image with its error, and variances.
        memory(frame, needs, votes + size_of::<[f64; 4]>() + 16 + 8)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let [width, height] = film.frame().size();
        match &self.clusters {
            Clusters::Map { size: [w, h], .. } if [*w, *h] != [width, height] => {
                let what = format!("the cluster map has {w}x{h} pixels, but the film has {width}x{height}");
                let what = what + "; create the map for the rendered window";
                Err(Error::Mismatch { who: self.name().to_owned(), what })
            }
            Clusters::Map { clusters, .. } => Ok(self.blend(film, clusters, |one, other| f64::from(one == other))),
            Clusters::Hits(label) => {
                let votes = |i| {
                    let traced = film.count(i).min(u64::from(self.options.hits)) as usize;
                    let hits = &film.first_hits(i)[..traced];
                    Votes::of(
                        hits.iter()
                            .map(|hit| hit.as_ref().and_then(|h| label(h.shape, h.primitive)).unwrap_or(BACKGROUND)),
                    )
                };
                Ok(self.blend(film, &per_pixel(film.frame().pixels(), votes), Votes::overlap))
            }
        }
    }
}

/// The largest number of samples per pixel that vote for a cluster.
const MOST_VOTES: usize = 8;

/// The clusters of a pixel's first samples (up to eight).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Votes {
    /// The clusters of the samples in ascending order; only the first `samples` entries are used.
    clusters: [u32; MOST_VOTES],
    samples: u8,
    /// True if all samples lie in one cluster.
    agree: bool,
}

impl Votes {
    /// Counts the votes of a pixel whose samples lie in the clusters `labels`. Only the first eight count.
    pub(crate) fn of(labels: impl Iterator<Item = u32>) -> Self {
        let mut votes = Self::default();
        for (vote, label) in votes.clusters.iter_mut().zip(labels) {
            *vote = label;
            votes.samples += 1;
        }
        let known = &mut votes.clusters[..usize::from(votes.samples)];
        known.sort_unstable();
        votes.agree = !known.is_empty() && known.first() == known.last();
        votes
    }

    /// The sum over all clusters of the smaller of both pixels' fractions of samples in the cluster; 1 if either pixel has no
    /// samples.
    #[inline]
    pub(crate) fn overlap(&self, other: &Self) -> f64 {
        if self.agree && other.agree {
            return if self.clusters[0] == other.clusters[0] { 1.0 } else { 0.0 };
        }
        self.common(other)
    }

    /// The overlap of two pixels if either has several clusters or none.
    #[inline(never)]
    fn common(&self, other: &Self) -> f64 {
        let [own, others] = [self, other].map(|votes| &votes.clusters[..usize::from(votes.samples)]);
        if own.is_empty() || others.is_empty() {
            return 1.0;
        }
        let shared = |votes: &[u32]| {
            let there = others.iter().filter(|other| **other == votes[0]).count();
            (votes.len() * others.len()).min(there * own.len())
        };
        let sum: usize = own.chunk_by(|a, b| a == b).map(shared).sum();
        sum as f64 / (own.len() * others.len()) as f64
    }
}
