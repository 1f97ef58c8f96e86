//! The Gaussian filter that favours pixels of the same cluster.

use crate::Gaussian;
use crate::gaussian::{emission, mean_and_presence, normalised, squared_error, variances};
use crate::parameters::{BACKGROUND, ClusterLookup, describe};
use crate::planes::per_pixel;
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, ImagePlanes, Needs, Options as _};
use rayon::prelude::*;
use std::fmt;

dapple_core::options! {
    /// The parameters of [`ClusterGaussian`] besides its kernel.
    pub struct ClusterGaussianOptions {
        /// Weight of a pixel of another cluster relative to one of the same.
        ///
        /// The table shows relMSE over that of the best `outside` of each image and budget, as geometric means
        /// (`tests/denoise/outside.rs`: five synthetic images at 8 to 64 spp).
        /// In some images the clusters miss edges, in others they cut smooth gradients.
        ///
        /// | `outside` | 0 | 0.01 | 0.03 | 0.05 | 0.07 | 0.1 | 0.2 | 1 |
        /// |---|---|---|---|---|---|---|---|---|
        /// | 1 first hit | 1.124 | 1.117 | 1.108 | 1.103 | 1.100 | 1.101 | 1.130 | 1.608 |
        /// | 4 first hits | 1.101 | 1.098 | 1.095 | 1.094 | 1.097 | 1.105 | 1.156 | 1.704 |
        ///
        /// The optimum is flat. Over 4 to 256 spp it moves to 0.01 or 0.02, since leaks cost more when there is less
        /// noise.
        pub outside: f64 = 0.05,
            |w| (0.0..=1.0).contains(&w), "0 (nothing crosses a border) to 1 (clusters do not matter)";
        /// First hits that tell a pixel's clusters, 1 (published) to 8.
        ///
        /// Without effect on a filter with a map of clusters.
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
/// where `overlap` is the share that the two pixels have in common. It is 1 in the same cluster and 0 in different
/// ones.
/// Between pixels of several clusters it is the sum over the clusters of the smaller share.
/// With `outside` 1 the filter is the plain Gaussian; with 0 nothing crosses a cluster's border.
///
/// The cluster-adaptive thesis "modified [its Gaussian] to favour same-cluster pixels" without a formula; this one is
/// our choice.
///
/// # Clusters
///
/// Clusters come from a map ([`from_map`](Self::from_map)) or from the first hits of a pixel's first samples
/// ([`from_hits`](Self::from_hits)).
/// One first hit corresponds to the probe of the thesis. Four first hits reveal that a pixel lies on an edge.
/// They leave 0.6 times the error on a slanted edge at 64 spp (`tests/denoise/outside.rs`).
///
/// With first hits, labels and values come from the same samples. In mixed pixels weights and values are therefore not
/// quite independent.
///
/// Unequal sample counts, borders, pixels without samples and [`Filtered::error`] are as with [`Gaussian`].
/// If `outside` is 0 and a pixel without samples is cut off from every sample in reach, the plain Gaussian fills it.
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
    /// Takes the cluster of each pixel from `clusters`, row by row from the top of a film window of `size` (width,
    /// height). Any number may stand for the background, such as `u32::MAX`.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless there are `size[0] * size[1]` clusters.
    pub fn from_map(size: [u32; 2], clusters: Vec<u32>) -> Result<Self, Error> {
        let [width, height] = size;
        if u64::from(width) * u64::from(height) != clusters.len() as u64 {
            let value = format!("{} of them for {width}x{height} pixels", clusters.len());
            let allowed = "give one cluster for each pixel of the film's window, row by row";
            return Err(Error::OutOfRange { name: "clusters", value, allowed });
        }
        Ok(Self::new(Clusters::Map { size, clusters }))
    }

    /// Takes the clusters of each pixel from the first hits of its first samples, which the film must record. Their
    /// number is [`ClusterGaussianOptions::hits`].
    ///
    /// Each sample is a vote for the cluster that `label` returns. A miss or `None` is a vote for the background. With
    /// one vote, one sample decides for the pixel, as published.
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

    fn blend<M: Membership>(&self, film: &Film, members: &[M]) -> Filtered {
        let size = film.frame().size();
        let width = size[0] as usize;
        let pixels = film.frame().pixels();
        let emission = emission(film);
        let emission = emission.as_deref();
        let mean = |i| mean_and_presence(film, emission, i);
        let plane = Plane {
            size: size.map(|n| n as usize),
            means: per_pixel(pixels, mean),
            variances: variances(film),
            members,
        };
        let mut radiance = vec![[0.0; 3]; pixels];
        let mut error = plane.variances.as_ref().map(|_| vec![0.0; pixels]);
        let row = |y: usize, radiance: &mut [[f32; 3]], error: &mut [f32]| {
            for (x, radiance) in radiance.iter_mut().enumerate() {
                let (sum, noise) = self.gather(&plane, x, y);
                *radiance = normalised(sum, emission.map_or([0.0; 3], |emission| emission[y * width + x]));
                if let Some(error) = error.get_mut(x) {
                    *error = squared_error(noise, sum[3]);
                }
            }
        };
        let rows = radiance.par_chunks_mut(width).enumerate();
        match &mut error {
            Some(error) => rows.zip(error.par_chunks_mut(width)).for_each(|((y, r), e)| row(y, r, e)),
            None => rows.for_each(|(y, r)| row(y, r, &mut [])),
        }
        Filtered::new(size, radiance).with_error(error)
    }

    /// The weighted sums over the kernel around pixel (x, y): of means and presence, and of variances. Clusters are
    /// ignored if they leave no sample in reach.
    #[inline]
    fn gather<M: Membership>(&self, plane: &Plane<'_, M>, x: usize, y: usize) -> ([f64; 4], f64) {
        // The factor is 0 or at least 2^-53, however small `outside`: its square does not underflow.
        let cut = 1.0 - self.options.outside;
        let sums = plane.gather(self.kernel.weights(), x, y, |overlap| 1.0 - cut * (1.0 - overlap));
        if sums.0[3] > 0.0 { sums } else { plane.gather(self.kernel.weights(), x, y, |_| 1.0) }
    }
}

/// The film's means, variances and clusters, row by row.
struct Plane<'a, M> {
    size: [usize; 2],
    means: Vec<[f64; 4]>,
    variances: Option<Vec<f64>>,
    members: &'a [M],
}

impl<M: Membership> Plane<'_, M> {
    /// The sums over the kernel around pixel (x, y): of weight times mean and presence, and of squared weight times
    /// variance. `factor` maps the overlap of two pixels' clusters to a factor on the weight.
    #[inline]
    fn gather(&self, weights: &[f64], x: usize, y: usize, factor: impl Fn(f64) -> f64) -> ([f64; 4], f64) {
        let [width, height] = self.size;
        let n = weights.len() / 2;
        let own = &self.members[y * width + x];
        let (left, right) = (x.saturating_sub(n), (x + n + 1).min(width));
        let across = &weights[left + n - x..right + n - x];
        let (mut sum, mut noise) = ([0.0; 4], 0.0);
        for source in y.saturating_sub(n)..(y + n + 1).min(height) {
            let down = weights[source + n - y];
            let row = source * width + left..source * width + right;
            for (((weight, mean), member), i) in
                across.iter().zip(&self.means[row.clone()]).zip(&self.members[row.clone()]).zip(row)
            {
                let weight = down * weight * factor(own.overlap(member));
                for (sum, mean) in sum.iter_mut().zip(mean) {
                    *sum += weight * mean;
                }
                // An unknown variance is infinite; times a weight of 0 it would be NaN.
                if let Some(variances) = &self.variances
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
        match self.clusters {
            Clusters::Map { .. } => Needs::none().with_emission(),
            Clusters::Hits(_) => Needs::none().with_emission().with_first_hits(self.options.hits),
        }
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let votes = match self.clusters {
            Clusters::Map { .. } => 0,
            Clusters::Hits(_) => size_of::<Votes>(),
        };
        let known = needs.variance || needs.halves;
        // Means and presence, variances, the image with its error, and emission.
        let planes = size_of::<[f64; 4]>() + if known { 8 + 16 } else { 12 } + if needs.emission { 24 } else { 0 };
        let image = if known { ImagePlanes::RadianceAndError } else { ImagePlanes::Radiance };
        FilterMemory::new(frame, votes + planes, image)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let (pixels, [width, height]) = (film.frame().pixels(), film.frame().size());
        let image = match &self.clusters {
            Clusters::Map { size: [w, h], .. } if [*w, *h] != [width, height] => {
                let what = format!(
                    "its cluster map has {w}x{h} pixels, the film {width}x{height}; make the map for the rendered window"
                );
                return Err(Error::Mismatch { who: self.name().to_owned(), what });
            }
            Clusters::Map { clusters, .. } => self.blend(film, clusters),
            Clusters::Hits(label) => {
                let votes = |i| {
                    let traced = film.count(i).min(u64::from(self.options.hits)) as usize;
                    let hits = &film.first_hits(i)[..traced];
                    Votes::count(hits.iter().map(|hit| hit.as_ref().and_then(|h| label(h)).unwrap_or(BACKGROUND)))
                };
                self.blend(film, &per_pixel(pixels, votes))
            }
        };
        Ok(image)
    }
}

/// The largest number of samples per pixel whose clusters count.
const MOST_VOTES: usize = 8;

/// The cluster or clusters that a pixel belongs to.
trait Membership: Sync {
    /// The overlap of two pixels' clusters: 1 if both lie in the same cluster, 0 if they have no cluster in common.
    fn overlap(&self, other: &Self) -> f64;
}

/// The cluster of a pixel that belongs to only one.
impl Membership for u32 {
    #[inline]
    fn overlap(&self, other: &Self) -> f64 {
        if self == other { 1.0 } else { 0.0 }
    }
}

/// The clusters of a pixel's first samples (up to eight), with the number of samples in each.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Votes {
    /// The clusters in ascending order. The first `len` entries are used.
    clusters: [u32; MOST_VOTES],
    counts: [u8; MOST_VOTES],
    len: u8,
    samples: u8,
}

impl Votes {
    /// Counts the samples in each cluster. `labels` are the clusters of a pixel's samples, of which the first eight
    /// count.
    fn count(labels: impl Iterator<Item = u32>) -> Self {
        let mut votes = [0; MOST_VOTES];
        let mut samples = 0;
        for (vote, label) in votes.iter_mut().zip(labels) {
            *vote = label;
            samples += 1;
        }
        let votes = &mut votes[..samples];
        votes.sort_unstable();
        let mut counted = Self { samples: samples as u8, ..Self::default() };
        for run in votes.chunk_by(|a, b| a == b) {
            let slot = usize::from(counted.len);
            (counted.clusters[slot], counted.counts[slot]) = (run[0], run.len() as u8);
            counted.len += 1;
        }
        counted
    }

    /// The overlap of two pixels with several clusters each; 1 if either pixel has no samples.
    #[inline(never)]
    fn merge(&self, other: &Self) -> f64 {
        // A pixel without samples matches every pixel.
        if self.samples == 0 || other.samples == 0 {
            return 1.0;
        }
        let (n, m) = (u32::from(self.samples), u32::from(other.samples));
        let (mut i, mut j, mut common) = (0, 0, 0);
        while i < usize::from(self.len) && j < usize::from(other.len) {
            match self.clusters[i].cmp(&other.clusters[j]) {
                std::cmp::Ordering::Less => i += 1,
                std::cmp::Ordering::Greater => j += 1,
                std::cmp::Ordering::Equal => {
                    common += (u32::from(self.counts[i]) * m).min(u32::from(other.counts[j]) * n);
                    i += 1;
                    j += 1;
                }
            }
        }
        f64::from(common) / f64::from(n * m)
    }
}

impl Membership for Votes {
    /// The sum over all clusters of the smaller share: the share of one pixel's samples in the cluster or of the
    /// other's.
    #[inline]
    fn overlap(&self, other: &Self) -> f64 {
        if self.len == 1 && other.len == 1 {
            return self.clusters[0].overlap(&other.clusters[0]);
        }
        self.merge(other)
    }
}

#[cfg(test)]
#[path = "../tests/denoise/internals/votes.rs"]
mod tests;
