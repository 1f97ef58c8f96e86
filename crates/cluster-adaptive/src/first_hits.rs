//! First-hit rays: the clusters that pixels see.

use crate::Error;
pub use dapple_core::integrator::BACKGROUND;
use dapple_core::{Clock, Frame, PointSet, SampleId, parallel, point_set::streams};

/// The position of a pixel's first-hit rays on pixel and lens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Placement {
    /// One first-hit ray, through the centres of pixel and lens [Lan 2016, 2.6]. The predicted sampling rate is wrong for
    /// pixels that see more than one cluster.
    #[default]
    Centre,
    /// This many first-hit rays, 1 to 256, spread over pixel and lens by a point set. The expectation of each first-hit ray's
    /// predicted sampling rate is correct for any pixel.
    Jittered(u32),
}

impl Placement {
    /// Returns the number of first-hit rays per pixel.
    pub const fn per_pixel(self) -> u32 {
        match self {
            Self::Centre => 1,
            Self::Jittered(k) => k,
        }
    }
}

impl std::fmt::Display for Placement {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Centre => f.write_str("centre"),
            Self::Jittered(k) => write!(f, "{k}"),
        }
    }
}

/// A ray that the caller traces from the camera to the first hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstHitRay {
    /// Column and row of the first-hit ray's pixel in the full image.
    pub pixel: [u32; 2],
    /// The ray's point on the film, inside `pixel`, in pixels of the full image from its upper left corner.
    pub film: [f32; 2],
    /// The ray's point on the lens as a sample in `[0, 1)^2`; `[0.5, 0.5]` with [`Placement::Centre`]. A pinhole camera ignores
    /// it.
    pub lens: [f32; 2],
    /// The sample's identity in the point set. A renderer that needs more coordinates (time, for example) uses the blocks of
    /// this sample from 1 on; block 0 is `film` and `lens`.
    pub sample: SampleId,
}

/// The first surface on a first-hit ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstHitSurface {
    /// The index of the primitive, which is also the index of its label (its cluster number).
    pub primitive: u32,
    /// The ray's direction, from the eye to the hit; its length may be any number above 0.
    pub direction: [f32; 3],
    /// Distance along the ray from the eye, in world units, not negative.
    pub distance: f32,
    /// The surface's unit normal, facing either side.
    pub normal: [f32; 3],
    /// Width of a pixel at the hit, in world units, measured across the ray; not negative. Used with
    /// [`PixelArea::Footprint`](crate::PixelArea::Footprint) only.
    pub footprint: f32,
}

/// The cluster and geometry that one first-hit ray hit. Without a hit, the cluster is [`BACKGROUND`] and all else is zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClusterHit {
    /// The index of the cluster that the first-hit ray hit, or [`BACKGROUND`].
    pub cluster: u32,
    /// Unit direction of the ray.
    pub direction: [f32; 3],
    /// Cosine of the angle between ray and surface normal, in `[0, 1]`.
    pub cosine: f32,
    /// Distance from the eye, in world units.
    pub distance: f32,
    /// Width of a pixel at the hit, in world units.
    pub footprint: f32,
}

impl ClusterHit {
    const MISS: Self = Self { cluster: BACKGROUND, direction: [0.0; 3], cosine: 0.0, distance: 0.0, footprint: 0.0 };

    /// Creates the record of a hit on `cluster`; `None` if the hit has NaN, infinite or negative lengths, or no direction.
    fn new(cluster: u32, hit: &FirstHitSurface) -> Option<Self> {
        let FirstHitSurface { direction, distance, normal, footprint, .. } = *hit;
        // In f64, since squares of small components leave the range of f32.
        let length = dot(direction, direction).sqrt();
        let fine = length > 0.0 && length.is_finite() && distance >= 0.0 && footprint >= 0.0;
        let finite = distance.is_finite() && footprint.is_finite() && normal.iter().all(|n| n.is_finite());
        (fine && finite).then(|| Self {
            cluster,
            direction: direction.map(|d| (f64::from(d) * (1.0 / length)) as f32),
            cosine: (dot(direction, normal).abs() / length).min(1.0) as f32,
            distance,
            footprint,
        })
    }
}

pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f64 {
    f64::from(a[0]) * f64::from(b[0]) + f64::from(a[1]) * f64::from(b[1]) + f64::from(a[2]) * f64::from(b[2])
}

/// The cost of first-hit rays, and of shadow rays from their hits. It is part of the cost of every image planned from them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FirstHitsCost {
    /// The number of rays traced.
    pub rays: u64,
    /// The wall-clock seconds of tracing.
    pub seconds: f64,
}

/// The first-hit rays of a frame; 28 bytes each.
#[derive(Clone, Debug)]
pub struct FirstHits {
    frame: Frame,
    placement: Placement,
    first_hits: Vec<ClusterHit>,
    rejected: u64,
    cost: FirstHitsCost,
}

/// Traces the first-hit rays of `frame`, in parallel by rows. `labels` holds the cluster number of each primitive.
///
/// `shoot` traces one ray and must be a pure function; the result is then the same for any number of threads. With
/// [`Placement::Jittered`], positions on pixel and lens come from `points`, in the stream [`streams::FIRST_HITS`].
///
/// Each first-hit ray ends in exactly one class: a cluster, or the background. A hit is rejected, and counts as a miss, if it
/// contains NaN or infinity, if the distance or footprint is negative, or if the direction is zero.
///
/// # Errors
///
/// [`Error::NoLabel`] for a hit whose primitive has no label; [`Error::NoCluster`] if a label is [`BACKGROUND`];
/// [`Error::OutOfRange`] if `placement` has 0 or more than 256 rays per pixel, or more than `points` has samples.
pub fn first_hits(
    frame: &Frame,
    placement: Placement,
    points: &dyn PointSet,
    labels: &[u32],
    shoot: impl Fn(FirstHitRay) -> Option<FirstHitSurface> + Sync,
) -> Result<FirstHits, Error> {
    let clock = Clock::of_machine();
    let k = placement.per_pixel();
    if !(1..=256).contains(&k) || u64::from(k) > points.capacity() {
        let allowed = "1 to 256, and at most the number of samples in the point set";
        return Err(Error::range("first-hit rays per pixel", k, allowed));
    }
    let width = frame.size()[0] as usize * k as usize;
    let mut first_hits = vec![ClusterHit::MISS; frame.pixels() * k as usize];
    let trace = |(row, out): (usize, &mut [ClusterHit])| -> Result<u64, Error> {
        let [x0, y0] = frame.origin();
        let mut rejected = 0;
        for (x, slots) in out.chunks_exact_mut(k as usize).enumerate() {
            let pixel = [x0 + x as u32, y0 + row as u32];
            for (index, slot) in slots.iter_mut().enumerate() {
                let Some(hit) = shoot(ray(pixel, index as u64, placement, points)) else { continue };
                let Some(&label) = labels.get(hit.primitive as usize) else {
                    return Err(Error::NoLabel { pixel, primitive: hit.primitive, labels: labels.len() });
                };
                if label == BACKGROUND {
                    return Err(Error::NoCluster { label, clusters: BACKGROUND as usize });
                }
                match ClusterHit::new(label, &hit) {
                    Some(first_hit) => *slot = first_hit,
                    None => rejected += 1,
                }
            }
        }
        Ok(rejected)
    };
    // Collected row by row, so that the first error does not depend on the number of threads.
    let rows: Vec<Result<u64, Error>> = parallel::map_parts(first_hits.chunks_mut(width).enumerate(), trace);
    let rejected = rows.into_iter().sum::<Result<u64, Error>>()?;
    let cost = FirstHitsCost { rays: first_hits.len() as u64, seconds: clock.seconds() };
    Ok(FirstHits { frame: *frame, placement, first_hits, rejected, cost })
}

pub(crate) fn ray(pixel: [u32; 2], index: u64, placement: Placement, points: &dyn PointSet) -> FirstHitRay {
    let sample = SampleId::new(pixel, streams::FIRST_HITS, index);
    let u = match placement {
        Placement::Centre => [0.5; 4],
        Placement::Jittered(_) => points.block(sample, 0),
    };
    // Far from the origin, a sum may round up to the next pixel.
    let place = |k: usize| (pixel[k] as f32 + u[k]).min((pixel[k] as f32 + 1.0).next_down());
    FirstHitRay { pixel, film: [place(0), place(1)], lens: [u[2], u[3]], sample }
}

impl FirstHits {
    /// The frame of these first-hit rays.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The placement of each pixel's first-hit rays.
    pub fn placement(&self) -> Placement {
        self.placement
    }

    /// Adds shadow rays and their seconds to the cost.
    pub(crate) fn add_cost(&mut self, rays: u64, seconds: f64) {
        self.cost.rays += rays;
        self.cost.seconds += seconds;
    }

    /// All first-hit rays in row-major pixel order, with [`Placement::per_pixel`] rays for each pixel.
    pub fn all(&self) -> &[ClusterHit] {
        &self.first_hits
    }

    /// The first-hit rays of pixel `i` of the frame's window, counted from 0 in row-major order.
    ///
    /// # Panics
    ///
    /// If `i` is not below the number of pixels.
    pub fn of_pixel(&self, i: usize) -> &[ClusterHit] {
        let k = self.placement.per_pixel() as usize;
        &self.first_hits[i * k..(i + 1) * k]
    }

    /// The number of rejected hits, which count as misses. [`first_hits()`] lists the reasons for rejection.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// The number of rays traced and the wall-clock seconds of tracing, shadow rays of the sampler included.
    pub fn cost(&self) -> FirstHitsCost {
        self.cost
    }

    /// The cluster hit by the first ray of each pixel, or [`BACKGROUND`], in row-major order: for colour maps and filters.
    pub fn cluster_map(&self) -> Vec<u32> {
        self.first_hits.iter().step_by(self.placement.per_pixel() as usize).map(|p| p.cluster).collect()
    }

    /// The number of first-hit rays that hit each cluster, followed by the number that hit nothing.
    ///
    /// # Errors
    ///
    /// [`Error::NoCluster`] if a first-hit ray has a cluster that is not below `clusters`.
    pub fn class_counts(&self, clusters: usize) -> Result<Vec<u64>, Error> {
        let mut counts = vec![0; clusters + 1];
        for first_hit in &self.first_hits {
            let class = if first_hit.cluster == BACKGROUND { clusters } else { first_hit.cluster as usize };
            if class > clusters || (class == clusters && first_hit.cluster != BACKGROUND) {
                return Err(Error::NoCluster { label: first_hit.cluster, clusters });
            }
            counts[class] += 1;
        }
        Ok(counts)
    }
}
