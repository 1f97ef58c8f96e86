//! The Gaussian filter that favours pixels of the same cluster.

use crate::Gaussian;
use crate::membership::{BACKGROUND, MOST_VOTES, Membership, Votes};
use crate::source::{mean_and_presence, normalised, squared_error, variances};
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, FirstHit, Frame, ImagePlanes, Needs};
use rayon::prelude::*;
use std::fmt;
use std::sync::Arc;

/// Names the cluster of a first hit; `None` for the background.
pub type ClusterLookup = Arc<dyn Fn(&FirstHit) -> Option<u32> + Send + Sync>;

/// Where a pixel's cluster comes from.
#[derive(Clone)]
enum Clusters {
    Map { size: [u32; 2], clusters: Vec<u32> },
    Hits { k: u8, label: ClusterLookup },
}

/// A [`Gaussian`] in which pixels of other clusters weigh less.
///
/// The cluster-adaptive thesis says that its Gaussian was "modified to favour same-cluster pixels" and gives no
/// formula. Here the Gaussian's weight is multiplied by
///
/// `outside + (1 - outside) overlap`
///
/// where `overlap` is what the two pixels have in common: 1 in the same cluster, 0 in different ones, and
/// between pixels of several clusters the sum over the clusters of the smaller of their two shares. With
/// `outside` 1 it is the plain Gaussian, with 0 nothing crosses a cluster's border.
///
/// A pixel's clusters come from a map made beforehand ([`from_map`](Self::from_map)) or from the first
/// hits of its first samples ([`from_hits`](Self::from_hits)). In the latter case labels and values come from
/// the same samples, so weights and values are not quite independent in mixed pixels. With one first hit
/// the thesis' probe is met; four tell that a pixel lies on an edge, and left 0.6 times the error on a
/// slanted edge at 64 spp (`tests/reconstruction/outside.rs`).
///
/// Unequal sample counts, borders, pixels without samples and [`Filtered::error`] are as with
/// [`Gaussian`]. A pixel without samples that is cut off from every sample in reach, since `outside` is 0,
/// is filled as by the plain Gaussian.
#[derive(Clone)]
pub struct ClusterGaussian {
    kernel: Gaussian,
    outside: f64,
    clusters: Clusters,
    described: String,
}

impl ClusterGaussian {
    /// The weight of a pixel of another cluster, relative to one of the same, unless given.
    ///
    /// Measured in `tests/reconstruction/outside.rs` on five made-up images (edges known to the clusters and not, gradients
    /// that the clusters cut for nothing) at 8 to 64 spp: relMSE over the best `outside` of each image and
    /// budget, geometric means.
    ///
    /// | `outside` | 0 | 0.01 | 0.03 | 0.05 | 0.07 | 0.1 | 0.2 | 1 |
    /// |---|---|---|---|---|---|---|---|---|
    /// | 1 first hit | 1.124 | 1.117 | 1.108 | 1.103 | 1.100 | 1.101 | 1.130 | 1.608 |
    /// | 4 first hits | 1.101 | 1.098 | 1.095 | 1.094 | 1.097 | 1.105 | 1.156 | 1.704 |
    ///
    /// The optimum is flat. Over 4 to 256 spp it moves to 0.01 or 0.02: the less noise, the more a leak costs.
    pub const DEFAULT_OUTSIDE: f64 = 0.05;

    /// Takes each pixel's cluster from `clusters`, row by row from the top of a film's window of `size`
    /// (width, height); [`BACKGROUND`] is one more cluster.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] when there are not `size[0] * size[1]` of them.
    pub fn from_map(size: [u32; 2], clusters: Vec<u32>) -> Result<Self, Error> {
        let [width, height] = size;
        if u64::from(width) * u64::from(height) != clusters.len() as u64 {
            return Err(Error::OutOfRange {
                name: "clusters",
                value: format!("{} of them for {width}x{height} pixels", clusters.len()),
                allowed: "give one cluster for each pixel of the film's window, row by row",
            });
        }
        Ok(Self::new(Clusters::Map { size, clusters }))
    }

    /// Takes each pixel's clusters from the first hits of its first `k` samples, which the film has to
    /// record: each sample is one vote for the cluster that `label` gives it, a miss or `None` one for
    /// the background. With `k` 1 one sample decides for the pixel, as published.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `k` is in `1 ..= 8`.
    pub fn from_hits(k: u8, label: ClusterLookup) -> Result<Self, Error> {
        if k == 0 || usize::from(k) > MOST_VOTES {
            return Err(Error::OutOfRange { name: "hits", value: k.to_string(), allowed: "1 to 8 first hits a pixel" });
        }
        Ok(Self::new(Clusters::Hits { k, label }))
    }

    fn new(clusters: Clusters) -> Self {
        Self { kernel: Gaussian::default(), outside: Self::DEFAULT_OUTSIDE, clusters, described: String::new() }
    }

    /// The same with another kernel.
    pub fn with_kernel(self, kernel: Gaussian) -> Self {
        Self { kernel, ..self }
    }

    /// The same with another weight of pixels of other clusters, relative to those of the same.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless it is in `[0, 1]`.
    pub fn with_outside(self, outside: f64) -> Result<Self, Error> {
        if !(0.0..=1.0).contains(&outside) {
            let allowed = "0 (nothing crosses a border) to 1 (the plain Gaussian)";
            return Err(Error::OutOfRange { name: "outside", value: outside.to_string(), allowed });
        }
        Ok(Self { outside, ..self })
    }

    /// The same, describing itself with how its clusters were made, as further parameters: `k=9,clamp=32`, say.
    pub fn with_described(self, described: String) -> Self {
        Self { described, ..self }
    }

    /// The kernel.
    pub fn kernel(&self) -> &Gaussian {
        &self.kernel
    }

    /// The weight of a pixel of another cluster, relative to one of the same.
    pub fn outside(&self) -> f64 {
        self.outside
    }

    fn blend<M: Membership>(&self, film: &Film, members: &[M]) -> Filtered {
        let size = film.frame().size();
        let width = size[0] as usize;
        let pixels = film.frame().pixels();
        let means = (0..pixels).into_par_iter().with_min_len(1024).map(|i| mean_and_presence(film, i)).collect();
        let plane = Plane { size: size.map(|n| n as usize), means, variances: variances(film), members };
        let mut radiance = vec![[0.0; 3]; pixels];
        let mut error = plane.variances.as_ref().map(|_| vec![0.0; pixels]);
        let row = |y: usize, radiance: &mut [[f32; 3]], error: &mut [f32]| {
            for (x, radiance) in radiance.iter_mut().enumerate() {
                let (sum, noise) = self.gather(&plane, x, y);
                *radiance = normalised(sum);
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

    /// The weighted sums around pixel (x, y); without regard to clusters if it is cut off by them.
    #[inline]
    fn gather<M: Membership>(&self, plane: &Plane<'_, M>, x: usize, y: usize) -> ([f64; 4], f64) {
        // The factor is 0 or at least 2^-53, however small `outside`: its square does not underflow.
        let cut = 1.0 - self.outside;
        let sums = plane.gather(self.kernel.weights(), x, y, |overlap| 1.0 - cut * (1.0 - overlap));
        if sums.0[3] > 0.0 { sums } else { plane.gather(self.kernel.weights(), x, y, |_| 1.0) }
    }
}

/// What is read of a film, row by row.
struct Plane<'a, M> {
    size: [usize; 2],
    means: Vec<[f64; 4]>,
    variances: Option<Vec<f64>>,
    members: &'a [M],
}

impl<M: Membership> Plane<'_, M> {
    /// The sums of weight times mean and presence, and of squared weight times variance.
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
                // An unknown variance is infinite: times no weight it would be NaN.
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
        let clusters = match &self.clusters {
            Clusters::Map { .. } => "clusters=map".to_owned(),
            Clusters::Hits { k, .. } => format!("hits={k}"),
        };
        let Self { outside, described, .. } = self;
        let comma = if described.is_empty() { "" } else { "," };
        format!("cluster-gaussian:{},outside={outside},{clusters}{comma}{described}", self.kernel.parameters())
    }

    fn needs(&self) -> Needs {
        match self.clusters {
            Clusters::Map { .. } => Needs::none(),
            Clusters::Hits { k, .. } => Needs::none().with_first_hits(k),
        }
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let votes = match self.clusters {
            Clusters::Map { .. } => 0,
            Clusters::Hits { .. } => size_of::<Votes>(),
        };
        let known = needs.variance || needs.halves;
        // Means and presence, variances, and the image with its error.
        let planes = size_of::<[f64; 4]>() + if known { 8 + 16 } else { 12 };
        let image = if known { ImagePlanes::RadianceAndError } else { ImagePlanes::Radiance };
        FilterMemory::new(frame, votes + planes, image)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        match &self.clusters {
            Clusters::Map { size, clusters } => {
                let [width, height] = film.frame().size();
                if *size != [width, height] {
                    let [w, h] = size;
                    let what = format!(
                        "its map of clusters is of {w}x{h} pixels and the film of {width}x{height}; make the map for the window that is rendered"
                    );
                    return Err(Error::Mismatch { who: self.name().to_owned(), what });
                }
                Ok(self.blend(film, clusters))
            }
            Clusters::Hits { k, label } => {
                let votes = |i| {
                    let traced = film.count(i).min(u64::from(*k)) as usize;
                    let hits = &film.first_hits(i)[..traced];
                    Votes::count(hits.iter().map(|hit| hit.as_ref().and_then(|h| label(h)).unwrap_or(BACKGROUND)))
                };
                let pixels = film.frame().pixels();
                let members: Vec<Votes> = (0..pixels).into_par_iter().with_min_len(256).map(votes).collect();
                Ok(self.blend(film, &members))
            }
        }
    }
}
