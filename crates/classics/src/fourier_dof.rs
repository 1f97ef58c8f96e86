//! Fourier depth of field: sample counts from the lens and the visible surfaces.

mod bandwidth;

pub use bandwidth::LensBandwidthOptions;

use crate::method::{counts_so_far, lacking, total};
use bandwidth::{LensBandwidth, NYQUIST};
use dapple_core::filter::{FilterMemory, ImagePlanes};
use dapple_core::options::Options as _;
use dapple_core::plan::{Feedback, Plan, Progress, SamplerMemory, share};
use dapple_core::point_set::streams;
use dapple_core::{
    Error, Film, Filter, Filtered, FirstHit, Frame, Limits, Needs, PointSet, SampleId, Sampler, parallel,
};
use dapple_low_discrepancy::BlueNoise;
use std::sync::Arc;

/// A pure function that traces the ray through the centres of the lens and of the given pixel of the full image.
///
/// The result is the first hit, and the radius in pixels of its circle of confusion, negative in front of the focal plane. If
/// the ray hits nothing, the radius is that of an infinitely distant point.
pub type TraceLensHit = Arc<dyn Fn([u32; 2]) -> (Option<FirstHit>, f32) + Send + Sync>;

dapple_core::options! {
    /// The parameters of [`FourierDof`].
    pub struct FourierDofOptions {
        /// Minimum fraction of pixels that get samples, in smooth areas.
        pub density: f64 = 0.015625, |density| density > 0.0 && density <= 1.0, "above 0 and at most 1";
        /// Samples follow the deviation of albedo and normals over the lens; this is the weight of normals relative to albedo.
        pub normals: f64 = 0.25, |weight| weight >= 0.0 && weight.is_finite(), "a weight of 0 or more";
        /// Lower bound on the deviation over the lens (in units of albedo), so that pixels with other noise get samples too.
        pub floor: f64 = 0.3, |floor| floor > 0.0 && floor <= 1.0, "above 0 and at most 1";
        /// 1: accept scenes without a lens, with bandwidths from surfaces alone; 0: refuse them.
        pub force: u8 = 0, |force| force <= 1, "0 or 1";
    }
}

/// Fourier depth of field [after Soler et al. 2009]: few pixels get samples where the lens blurs the image; pixels whose
/// radiance varies over the lens get many.
///
/// One ray per pixel, through the centres of pixel and lens, finds the surface and its circle of confusion. These determine the
/// image's bandwidth `W` in cycles per pixel ([`LensBandwidthOptions`]). A pixel is sampled with probability `(2 W)^2`; a
/// blue-noise tile selects the pixels. Counts are proportional to the standard deviation of a sinusoidal texture over the lens.
/// The sinusoid's frequency is the bandwidth that the image would have without the lens. Its variance is the sum of the
/// variances of albedo, normals and coverage within the radius of the circle of confusion.
///
/// Use `--min-spp 0`: with a larger minimum, every pixel gets samples. The filter [`Splat`] fills pixels without samples.
///
/// The published method propagates spectra through the scene; only its abstract and slides were available. The bandwidth and
/// variance here are simpler and not in the paper.
///
/// *Guarantees*: spends the budget exactly. Counts never depend on samples, so each sampled pixel is unbiased. *Weaknesses*:
/// only the lens is modelled. The bandwidth ignores edges of shadows and reflections, and the noise of lights. Tracing the rays
/// before the first plan counts as planning time.
pub struct FourierDof<P> {
    points: P,
    first_hits: TraceLensHit,
    options: FourierDofOptions,
    bandwidth: LensBandwidthOptions,
    prior: Option<(Frame, Vec<f64>)>,
}

impl<P: PointSet> FourierDof<P> {
    /// Creates a sampler that calls `first_hits` to trace lens rays before its first plan.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] with the name of a parameter outside its range.
    pub fn new(
        points: P,
        first_hits: TraceLensHit,
        options: FourierDofOptions,
        bandwidth: LensBandwidthOptions,
    ) -> Result<Self, Error> {
        options.check_ranges()?;
        bandwidth.check_ranges()?;
        Ok(Self { points, first_hits, options, bandwidth, prior: None })
    }

    /// The relative sample counts of the pixels; 0 for pixels that need no samples.
    fn weights(&mut self, frame: &Frame) -> &[f64] {
        let fresh = self.prior.take().filter(|(of, _)| of == frame);
        let (_, weights) = self.prior.insert(fresh.unwrap_or_else(|| {
            let map = LensBandwidth::of(frame, &*self.first_hits, &self.bandwidth, Some(self.options.normals));
            let tile = BlueNoise::new(0, Origin);
            let weight = |i: usize| {
                let density = (2.0 * map.bandwidth[i]).powi(2).max(self.options.density);
                let is_chosen = threshold(&tile, frame.pixel(i)) < density;
                if is_chosen { map.deviation[i].max(self.options.floor) } else { 0.0 }
            };
            (*frame, (0..frame.pixels()).map(weight).collect())
        }));
        weights
    }
}

/// A point set whose coordinates are all 0, so that blue noise over it is the blue-noise tile itself.
struct Origin;

impl PointSet for Origin {
    fn describe(&self) -> String {
        "origin".to_owned()
    }

    fn block(&self, _: SampleId, _: u32) -> [f32; 4] {
        [0.0; 4]
    }
}

/// The value of the blue noise at a pixel, in `[0, 1)`. The pixels below any threshold are evenly distributed.
fn threshold(tile: &BlueNoise<Origin>, pixel: [u32; 2]) -> f64 {
    /// The side of the tile. A single tile is repeated, which leaves no seams.
    const SIDE: u32 = 128;
    f64::from(tile.block(SampleId::new(pixel.map(|c| c % SIDE), streams::FIRST_HITS, 0), 0)[0])
}

impl<P: PointSet> Sampler for FourierDof<P> {
    fn name(&self) -> &str {
        "fourier-dof"
    }

    fn describe(&self) -> String {
        format!("{}:{},{}", self.name(), self.options.describe(), self.bandwidth.describe())
    }

    fn a_priori(&self) -> bool {
        true
    }

    fn memory(&self, frame: &Frame, _: &Needs, _: &Limits) -> SamplerMemory {
        // Before the first plan, the film's counts and means (32 bytes) are unused. Later plans hold counts, floors, and the
        // weights, fractions and counts of the allocation.
        let first = LensBandwidth::BYTES.saturating_sub(32);
        SamplerMemory::planning(frame, first.max(28)).with_state(frame, 8)
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        let budget = seen.budget;
        if budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let now = counts_so_far(seen);
        let all = total(&now) + budget.left();
        let weights = self.weights(seen.frame());
        // Each selected pixel gets a sample, if the budget suffices.
        let floors = |chosen: u32| -> Vec<u32> {
            let least = |weight: f64| if weight > 0.0 { budget.min_spp.max(chosen) } else { budget.min_spp };
            now.iter().zip(weights).map(|(&now, &weight)| now.max(least(weight).min(budget.max_spp))).collect()
        };
        let mut least = floors(1);
        if total(&least) > all {
            least = floors(0);
        }
        let wanted = share(weights, 0, &least, budget.max_spp, all)?.counts;
        plan.counts = lacking(&wanted, &now);
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}

dapple_core::options! {
    /// The parameters of [`Splat`].
    pub struct SplatOptions {
        /// Standard deviation of the kernel in pixels = width / bandwidth.
        pub width: f64 = 0.25, |width| width > 0.0 && width <= 1.0, "above 0 and at most 1";
        /// Half-width of the kernel in pixels = reach / bandwidth.
        pub reach: f64 = 1.0 => "1", |reach| reach > 0.0 && reach <= 2.0, "above 0 and at most 2";
    }
}

/// Reconstruction from Gaussians around the sampled pixels, as wide as the image's bandwidth allows [after Soler et al. 2009].
///
/// The bandwidth is computed from the lens and the surfaces, as in the sampler [`FourierDof`]; this filter fills the pixels
/// that the sampler leaves empty. Use the same parameters for both. A pixel of bandwidth `W` spreads its mean as a Gaussian of
/// standard deviation `1 / (4 W)` pixels. The image is the weighted mean of these Gaussians. Where the bandwidth is 1/2, a
/// pixel keeps its own mean.
///
/// A pixel of `n` samples has the weight `n / (n + m)`, where `m` is the mean count of all pixels. Pixels with few samples thus
/// matter little.
///
/// The cost of a Gaussian is proportional to its area, so filtering is slow if all pixels of a smooth area have samples. Pixels
/// out of reach of all samples are black. There is no error estimate.
///
/// *Bias*: blur within the bandwidth, and across edges by a pixel or two. *Weaknesses*: shadows and reflections are ignored,
/// and blurred where surfaces are smooth.
#[derive(Clone)]
pub struct Splat {
    first_hits: TraceLensHit,
    options: SplatOptions,
    bandwidth: LensBandwidthOptions,
}

impl Splat {
    /// Creates a filter that calls `first_hits` to trace lens rays for each film.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] with the name of a parameter outside its range.
    pub fn new(
        first_hits: TraceLensHit,
        options: SplatOptions,
        bandwidth: LensBandwidthOptions,
    ) -> Result<Self, Error> {
        options.check_ranges()?;
        bandwidth.check_ranges()?;
        Ok(Self { first_hits, options, bandwidth })
    }
}

/// The Gaussian of one pixel.
#[derive(Clone, Copy, Default)]
struct Kernel {
    /// `exp(-falloff d^2)` is the weight at distance `d`.
    falloff: f64,
    /// The factor on the weight, from the number of samples.
    trust: f64,
    /// The largest distance along a row or column; `None` for a pixel without samples.
    reach: Option<u32>,
}

impl Filter for Splat {
    fn name(&self) -> &str {
        "splat"
    }

    fn describe(&self) -> String {
        format!("{}:{},{}", self.name(), self.options.describe(), self.bandwidth.describe())
    }

    fn memory(&self, frame: &Frame, _: &Needs) -> FilterMemory {
        let applying = 12 + 8 + size_of::<Kernel>();
        FilterMemory::new(frame, applying.max(LensBandwidth::BYTES), ImagePlanes::Radiance)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        let frame = film.frame();
        let width = frame.size()[0] as usize;
        let bandwidth = LensBandwidth::of(frame, &*self.first_hits, &self.bandwidth, None).bandwidth;
        let mean = (0..frame.pixels()).map(|i| film.count(i)).sum::<u64>() as f64 / frame.pixels() as f64;
        let kernel = |(i, &bandwidth): (usize, &f64)| {
            let deviation = self.options.width / bandwidth;
            let reach = (film.count(i) > 0).then(|| (self.options.reach / bandwidth) as u32);
            let count = film.count(i) as f64;
            Kernel { falloff: 0.5 / (deviation * deviation), trust: count / (count + mean), reach }
        };
        let kernels: Vec<Kernel> = bandwidth.iter().enumerate().map(kernel).collect();
        let rows: Vec<u32> =
            kernels.chunks(width).map(|row| row.iter().filter_map(|k| k.reach).max().unwrap_or(0)).collect();
        let far = rows.iter().copied().max().unwrap_or(0) as usize;
        let mut radiance = vec![[0.0; 3]; frame.pixels()];
        parallel::chunks(&mut radiance, width, |y, image| {
            let mut sums = vec![[0.0; 4]; width];
            for from in y.saturating_sub(far)..(y + far + 1).min(rows.len()) {
                if rows[from] as usize >= from.abs_diff(y) {
                    splat_row(&mut sums, film, &kernels[from * width..][..width], [from, y]);
                }
            }
            for (x, (pixel, [r, g, b, weight])) in image.iter_mut().zip(sums).enumerate() {
                let i = y * width + x;
                let keeps = bandwidth[i] >= NYQUIST && film.count(i) > 0;
                let mean = if keeps { film.mean(i) } else { [r, g, b].map(|sum| sum / weight) };
                *pixel = if keeps || weight > 0.0 { mean.map(|x| x as f32) } else { [0.0; 3] };
            }
        });
        Ok(Filtered::new(frame.size(), radiance))
    }
}

/// Adds the Gaussians of the pixels of row `from` to the sums of row `to`, from left to right.
fn splat_row(sums: &mut [[f64; 4]], film: &Film, kernels: &[Kernel], [from, to]: [usize; 2]) {
    let (width, down) = (sums.len(), from.abs_diff(to));
    for (x, kernel) in kernels.iter().enumerate() {
        let Some(reach) = kernel.reach.map(|reach| reach as usize).filter(|reach| *reach >= down) else { continue };
        let [r, g, b] = film.mean(from * width + x);
        let mut add = |x: usize, weight: f64| {
            sums[x].iter_mut().zip([r, g, b, 1.0]).for_each(|(sum, value)| *sum += weight * value);
        };
        // The weights at growing distances. Each is the previous weight times a factor, which falls by a constant factor
        // itself.
        let mut weight = kernel.trust * libm::exp(-kernel.falloff * (down * down) as f64);
        let mut factor = libm::exp(-kernel.falloff);
        let fall = factor * factor;
        add(x, weight);
        for across in 1..=reach {
            weight *= factor;
            factor *= fall;
            if across <= x {
                add(x - across, weight);
            }
            if x + across < width {
                add(x + across, weight);
            }
        }
    }
}
