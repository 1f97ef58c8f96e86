//! A bank of filters, selected per pixel by Stein's unbiased risk estimate, and a sampler driven by the estimated error.

mod bank;

use crate::method::{FilterMethod, MethodFilter, MethodSampler, SamplingMethod};
use crate::method::{counts_so_far, lacking, total, with_extra};
use crate::windows::stored;
use bank::{BANK, NEEDS, OfPixel, Planes};
use dapple_core::plan::{Feedback, PilotPolicy, Plan, saturating_u32, share};
use dapple_core::{Error, Film, Filtered, Needs, filter::ImagePlanes, parallel};

dapple_core::options! {
    /// The parameters of [`SureFilter`].
    pub struct SureFilterOptions {
        /// Search radius in pixels, 0 to 20.
        pub window: usize = 20, |window| window <= 20, "0 to 20 pixels to each side";
        /// true: limit the search radius to 5 pixels, with 14 times fewer pixel pairs than radius 20.
        pub fast: bool = false => "false";
        /// Standard deviation in pixels of the kernel that smooths error estimates before the best filter is chosen.
        pub smooth: f64 = 4.0 => "4", |sigma| sigma > 0.0 && sigma <= 8.0, "above 0 and at most 8 pixels";
    }
}

/// A bank of cross non-local means filters; each pixel uses the filter with the least estimated error [Li 2012].
///
/// The weight of a pixel `q` in the result of pixel `p` is `exp(-D / (2 sigma^2))` times a weight by features. `D` is the mean
/// squared difference between the 5x5 patches around both pixels. The bank has `sigma` 0 (unfiltered), and 0.005 doubled up to
/// seven times (0.64). Features are the normal (standard deviation 0.8), the albedo (0.25), and the depth divided by its
/// maximum (0.6). Squared feature differences are divided by the sum of both pixels' sample variances, at least 0.01.
///
/// The squared error of a filter is estimated by `(F - y)^2 + 2 v dF/dy - v` for a mean `y` of variance `v` [Stein 1981].
/// Neither a reference nor halves are needed. For `sigma` 0 the estimate is `2 v`. Estimates are smoothed by a cross-bilateral
/// filter over the same features before the best filter is selected.
///
/// # Differences from the authors' code
///
/// * Errors are estimated on the image itself, not on one blurred by a reconstruction filter.
/// * The derivative takes into account that patches compare three channels.
/// * Pixels without samples are filled, and pixels with one sample use the variance of 5x5 pixels.
///
/// # Weaknesses
///
/// The estimate assumes Gaussian noise, independent between pixels. With heavy-tailed noise, fireflies remain.
/// Raw estimates are noisy, hence the smoothing. Windows of 41x41 pixels cost as much as tens of samples.
///
/// # Result
///
/// Pixels without samples are filled from their window; they are black if the window has no samples. [`Filtered::error`] is the
/// smoothed estimate for the selected filter, at least 0.
pub type SureFilter = MethodFilter<SureFilterOptions>;

/// The search radius with `fast`.
const FAST: usize = 5;

impl FilterMethod for SureFilterOptions {
    const NAME: &'static str = "sure";
    const BYTES: usize = BYTES;
    const PLANES: ImagePlanes = ImagePlanes::RadianceAndError;

    fn needs(&self) -> Needs {
        NEEDS
    }

    fn image(&self, film: &Film, (): &()) -> Result<Filtered, Error> {
        let radius = if self.fast { self.window.min(FAST) } else { self.window };
        let chosen = choose(film, radius, self.smooth);
        let error = chosen.iter().map(|pixel| stored(pixel.error)).collect::<Vec<_>>();
        let radiance = chosen.iter().map(|pixel| pixel.radiance).collect();
        Ok(Filtered::new(film.frame().size(), radiance).with_error(error))
    }
}

/// A pixel of the selected filter.
#[derive(Clone, Copy, Default)]
struct Chosen {
    radiance: [f32; 3],
    /// The smoothed estimate of the squared error; may be negative.
    error: f64,
    /// The smoothed priority of further samples, 0 or above.
    priority: f64,
}

/// The peak memory of [`choose`] in bytes per pixel.
const BYTES: usize = Planes::BYTES + size_of::<OfPixel>() + size_of::<Chosen>();

/// Applies the bank with windows of this radius, and selects for each pixel the filter with the least error. Errors are
/// smoothed with a standard deviation of `sigma` pixels.
fn choose(film: &Film, radius: usize, sigma: f64) -> Vec<Chosen> {
    let planes = Planes::new(film);
    let all = bank::apply(&planes, radius);
    let spatial = falloff(sigma);
    parallel::map(all.len(), |i| chosen(&planes, &all, i, &spatial))
}

/// `-d^2 / (2 sigma^2)` for distances `d` from 0 to two standard deviations.
fn falloff(sigma: f64) -> Vec<f64> {
    let reach = (2.0 * sigma).round() as u32;
    (0..=reach).map(|d| -0.5 * f64::from(d * d) / (sigma * sigma)).collect()
}

fn chosen(planes: &Planes, all: &[OfPixel], i: usize, spatial: &[f64]) -> Chosen {
    let reach = spatial.len() as isize - 1;
    let (x, y) = ((i % planes.size[0]) as isize, (i / planes.size[0]) as isize);
    let (mut weight, mut error, mut priority) = (0.0, [0.0; BANK], [0.0; BANK]);
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let Some(j) = planes.at(x + dx, y + dy).filter(|&j| planes.means.known[j]) else { continue };
            let near = spatial[dx.unsigned_abs()] + spatial[dy.unsigned_abs()];
            let w = libm::exp(near + planes.likeness(i, j));
            weight += w;
            for k in 0..BANK {
                error[k] += w * all[j].error[k];
                priority[k] += w * all[j].priority[k];
            }
        }
    }
    // A pixel without samples uses the widest filter, and its own error is unknown.
    let widest = 1;
    if !planes.means.known[i] || weight <= 0.0 {
        let unknown = if weight > 0.0 { error[widest] / weight } else { f64::INFINITY };
        let priority = if weight > 0.0 { priority[widest] / weight } else { 0.0 };
        return Chosen { radiance: all[i].filtered[0], error: unknown, priority: priority.max(0.0) };
    }
    let best = (1..BANK).fold(0, |best, k| if error[k] < error[best] { k } else { best });
    let radiance = if best == 0 { planes.means.colour[i].map(|c| c as f32) } else { all[i].filtered[best - 1] };
    Chosen { radiance, error: error[best] / weight, priority: (priority[best] / weight).max(0.0) }
}

dapple_core::options! {
    /// The parameters of [`Sure`]. Except for the number of rounds, the defaults are those of the authors' code.
    pub struct SureOptions {
        /// Samples per pixel before counts adapt; at most half of the mean spp.
        pub pilot: u32 = 8, |pilot| pilot != 0, "at least one sample";
        /// Rounds after the pilot, each planned from all samples before it.
        pub rounds: u32 = 1, |rounds| (1..=16).contains(&rounds), "1 to 16";
        /// Search radius in pixels, 0 to 20.
        pub window: usize = 10, |window| window <= 20, "0 to 20 pixels to each side";
        /// Standard deviation in pixels of the kernel that smooths error estimates.
        pub smooth: f64 = 4.0 => "4", |sigma| sigma > 0.0 && sigma <= 8.0, "above 0 and at most 8 pixels";
        /// Maximum samples per pixel.
        pub cap: u32 = 1024, |cap| cap != 0, "at least one sample";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// A sampler for the filter [`SureFilter`]: samples go where the selected filter of the bank still has errors [Li 2012].
///
/// Every pixel gets `pilot` samples. A pixel with `n` samples and a mean of variance `v` then has the score `max(0, E + v) /
/// ((F^2 + 0.01) (1 + n))`. `E` is the smoothed error estimate of the pixel's selected filter, and `F` the filtered luminance.
/// Additional samples are proportional to scores, at least one per pixel where the budget allows.
///
/// *Guarantees*: spends the budget exactly; the published counts, rounded up, exceed it. No pixel gets fewer samples than the
/// pilot. *Bias*: sample counts depend on the samples, and all samples are kept [Kirk and Arvo 1991]. *Weaknesses*: as for
/// [`SureFilter`]. Planning costs as much as filtering.
pub type Sure<P> = MethodSampler<P, SureOptions>;

impl SamplingMethod for SureOptions {
    const NAME: &'static str = "sure";
    const PLANNING: usize = BYTES + 8;

    fn needs(&self) -> Needs {
        NEEDS
    }

    fn pilot_and_rounds(&self, mean: u64) -> (u32, Option<u32>) {
        (self.pilot.min(saturating_u32(mean / 2).max(1)), Some(self.rounds))
    }

    fn refine(&self, seen: &Feedback<'_>, _: u32, _: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error> {
        let (budget, pixels, now) = (seen.budget, seen.pixels() as u64, counts_so_far(seen));
        let floors: Vec<u32> = now.iter().map(|&n| budget.min_spp.saturating_sub(n)).collect();
        let (pilot, _) = self.pilot_and_rounds(budget.total / pixels);
        let after = budget.total.saturating_sub(u64::from(pilot) * pixels);
        let step = after.div_ceil(self.rounds.into()).max(total(&floors)).clamp(1, budget.left());
        let chosen = choose(seen.film, self.window, self.smooth);
        let scores: Vec<f64> =
            chosen.iter().zip(&now).map(|(pixel, &n)| pixel.priority / (1.0 + f64::from(n))).collect();
        let more = share(&scores, 1, &floors, u32::MAX, step)?.counts;
        let cap = self.cap.max(budget.min_spp).min(budget.max_spp);
        let wanted = more.iter().zip(&now).map(|(more, &n)| n.saturating_add(*more).min(cap).max(n));
        let counts = lacking(&wanted.collect::<Vec<_>>(), &now);
        // The excess over the cap goes to the pixels with the fewest samples.
        let planned = total(&counts);
        plan.counts = with_extra(seen, counts, step - planned)?;
        Ok(())
    }
}
