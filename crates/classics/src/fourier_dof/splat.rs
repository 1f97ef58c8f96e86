//! Reconstruction of a blurred image from few of its pixels.

use super::TraceLensProbe;
use super::bandwidth::{LensBandwidth, LensBandwidthOptions, NYQUIST};
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, ImagePlanes, Options as _};
use rayon::prelude::*;

dapple_core::options! {
    /// The parameters of [`Splat`].
    pub struct SplatOptions {
        /// Standard deviation of a pixel's Gaussian, times its bandwidth; ours.
        pub width: f64 = 0.25, |width| width > 0.0 && width <= 1.0, "above 0 and at most 1";
        /// Half the side of the square that a pixel's Gaussian covers, times its bandwidth; ours.
        pub reach: f64 = 1.0 => "1", |reach| reach > 0.0 && reach <= 2.0, "above 0 and at most 2";
    }
}

/// Gaussians around the pixels that have samples, as wide as the image's bandwidth allows [after Soler et al. 2009].
///
/// The bandwidth follows from the lens and the surfaces, as in the sampler [`FourierDof`](super::FourierDof), whose pixels
/// without samples this filter fills. Give both the same parameters. A pixel of bandwidth `W` spreads its mean as a Gaussian of
/// standard deviation `1 / (4 W)` pixels. The image is the mean of these, weighted by the Gaussians. Where the bandwidth is 1/2
/// a pixel keeps its own mean.
///
/// A pixel of `n` samples has the weight `n / (n + m)`, for a mean of `m` samples per pixel: pixels at the floor of counts hardly
/// matter, and many samples never count for more than 1.
///
/// Each pixel's Gaussian costs its area: films with samples in all pixels of a smooth image take longer than those of the
/// sampler. Pixels out of reach of all samples are black. There is no error estimate.
///
/// *Bias*: blur within the bandwidth, and across edges by a pixel or two. *Weaknesses*: knows neither shadows nor
/// reflections, and blurs them where surfaces are smooth.
#[derive(Clone)]
pub struct Splat {
    probes: TraceLensProbe,
    options: SplatOptions,
    bandwidth: LensBandwidthOptions,
}

impl Splat {
    /// Makes a filter that traces these probes for each film.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn new(probes: TraceLensProbe, options: SplatOptions, bandwidth: LensBandwidthOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        bandwidth.check_ranges()?;
        Ok(Self { probes, options, bandwidth })
    }
}

/// The Gaussian of one pixel.
#[derive(Clone, Copy, Default)]
struct Kernel {
    /// `exp(-falloff d^2)` is the weight at distance `d`.
    falloff: f64,
    /// The weight by the number of samples.
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

    fn memory(&self, frame: &Frame, _: &dapple_core::Needs) -> FilterMemory {
        let applying = 12 + 8 + size_of::<Kernel>();
        FilterMemory::new(frame, applying.max(LensBandwidth::BYTES), ImagePlanes::Radiance)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        let frame = film.frame();
        let width = frame.size()[0] as usize;
        let bandwidth = LensBandwidth::of(frame, &*self.probes, &self.bandwidth, None).bandwidth;
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
        radiance.par_chunks_mut(width).enumerate().for_each(|(y, image)| {
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
        // The weights at growing distances: each is the last one times a factor, which itself falls by a constant factor.
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
