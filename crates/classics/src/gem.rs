//! Greedy error minimisation: a Gaussian of its own scale for each pixel, and samples for the pixels with the largest error.

use crate::method::{FilterMethod, MethodFilter, MethodSampler, SamplingMethod};
use crate::method::{next_step, within_ceiling};
use crate::windows::{convolve, gaussian_taps, per_pixel, stored, variances_of_means};
use dapple_core::plan::{Feedback, PilotPolicy, Plan};
use dapple_core::{Error, Film, Filtered, Needs, filter::ImagePlanes, parallel, point_set::mix};
use std::sync::atomic::{AtomicU32, Ordering};

dapple_core::options! {
    /// The parameters of [`Gem`], the sampler.
    pub struct GemOptions {
        /// Probability that noise alone stops the search for a wider Gaussian at a step; larger values smooth less.
        pub gamma: f64 = 0.2, |gamma| gamma > 0.0 && gamma <= 0.5, "above 0 and at most 0.5";
        /// Samples per pixel before counts adapt.
        pub pilot: u32 = 4, |pilot| pilot >= 2, "at least 2, since one sample has no variance";
        /// Rounds after the pilot, each with an equal share of the remaining budget.
        pub rounds: u32 = 8, |rounds| (1..=1024).contains(&rounds), "1 to 1024";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

dapple_core::options! {
    /// The parameters of [`GemFilter`].
    pub struct GemFilterOptions {
        /// Probability that noise alone stops the search for a wider Gaussian at a step; larger values smooth less.
        pub gamma: f64 = 0.2, |gamma| gamma > 0.0 && gamma <= 0.5, "above 0 and at most 0.5";
    }
}

/// The filter of greedy error minimisation [Rousselle, Knaus and Zwicker 2011]: each pixel is blurred by a Gaussian of its own
/// scale.
///
/// A pixel steps through seven Gaussians of 1 to 8 pixels, from fine to coarse. It stops before the step from a scale `f` to
/// the next coarser scale `c` if `z loss - gain >= 0`. The gain is the decrease of the variance. The loss is `beta (mu_f -
/// mu_c)^2`, with `beta = (r_c^2 + r_f^2) / (r_c^2 - r_f^2)` for the means `mu` and standard deviations `r` of the Gaussians.
/// For an image quadratic in x and y, the loss is the increase of the squared bias. The factor `z = -ln(1 - (1.9 gamma)^(1 /
/// sqrt 2)) (1 - 1 / N)` depends on the mean number of samples `N` under the kernel. On white noise, `gamma` is the fraction of
/// false stops. Smoothing the stop flags of each step by a Gaussian removes most false stops.
///
/// *Differences from the authors' program*: the program averages samples per cell of a finer grid, 4x4 per pixel, and has an
/// eighth Gaussian of 0.71 pixels. Variances are exact at the image's border, and pixels without samples have no weight.
///
/// *Error*: the variance plus the squared bias. For the squared bias, each pixel's losses are summed, their expectation on
/// noise is subtracted, and the result is averaged by a Gaussian of 8 pixels. Negative averages count as 0. On white noise the
/// error is overestimated. On six bundled scenes at 16 independent samples per pixel, its sum is only 0.54 to 0.84 of the true
/// sum, and 0.18 on the scene `lens`, where most samples miss the light. *Bias*: scales depend on the samples that are blurred.
/// *Weaknesses*: kernels are round and use no features. Textures and edges of shadows blur at few samples, and blotches appear
/// where flags change.
pub type GemFilter = MethodFilter<GemFilterOptions>;

impl GemFilterOptions {
    /// The squared error of each pixel: its variance, plus the squared bias around it if the estimate is positive.
    fn errors(&self, film: &Film, selection: &[Selected]) -> Vec<f32> {
        let size = film.frame().size().map(|n| n as usize);
        let own: Vec<[f64; 2]> = selection.iter().map(|pixel| [pixel.bias, 1.0]).collect();
        let around = convolve(size, &gaussian_taps(SMOOTHING), &own);
        let error = |i: usize| {
            let [bias, weight] = around[i];
            let is_black = selection[i].scale == 0 && film.count(i) == 0;
            let error = selection[i].variance + (bias / weight).max(0.0);
            stored(if is_black { f64::INFINITY } else { error })
        };
        per_pixel(film, error)
    }
}

/// The standard deviation in pixels of the Gaussian that averages estimated squared biases: the coarsest scale.
const SMOOTHING: f64 = 8.0;

impl FilterMethod for GemFilterOptions {
    const NAME: &'static str = "gem";
    const BYTES: usize = Selected::BYTES;
    const PLANES: ImagePlanes = ImagePlanes::RadianceAndError;

    fn needs(&self) -> Needs {
        Needs::none().with_variance()
    }

    fn image(&self, film: &Film, (): &()) -> Result<Filtered, Error> {
        let selection = select(film, &Bank::of_image(), self.gamma);
        let radiance = selection.iter().map(|pixel| pixel.mean.map(|x| x as f32)).collect();
        Ok(Filtered::new(film.frame().size(), radiance).with_error(self.errors(film, &selection)))
    }
}

/// The sampler of greedy error minimisation [Rousselle, Knaus and Zwicker 2011].
///
/// After a pilot, each round selects one of four Gaussians for every pixel (see [`GemFilter`]), and picks the pixels with the
/// largest `b e / ((0.001 + mu^2) (b + N))`. Here `e` is the estimated squared error, `mu` the mean, `N` the number of samples
/// under the kernel, and `b` the budget's mean samples per pixel. For each picked pixel, `b` samples are added to pixels drawn
/// with probabilities proportional to its kernel.
///
/// *Guarantees*: spends the budget exactly, and takes the pilot in every pixel if the budget allows. *Bias*: sample counts
/// depend on the samples, and all samples are kept [Kirk and Arvo 1991]. *Weaknesses*: counts suit the Gaussians of
/// [`GemFilter`]; the errors of a filter that uses features lie elsewhere.
///
/// *Differences from the authors' program*: the draws use hashes instead of random numbers, so that the same samples give the
/// same counts. Pixels of equal error are picked in the order of a hash.
pub type Gem<P> = MethodSampler<P, GemOptions>;

impl SamplingMethod for GemOptions {
    const NAME: &'static str = "gem";
    const PLANNING: usize = Selected::BYTES;

    fn pilot_and_rounds(&self, _: u64) -> (u32, Option<u32>) {
        (self.pilot, Some(self.rounds))
    }

    fn refine(&self, seen: &Feedback<'_>, first: u32, _: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error> {
        let bank = Bank::between_rounds();
        let selection = select(seen.film, &bank, self.gamma);
        let drawn = draw(seen, &bank, &selection, next_step(seen, first, self.rounds));
        plan.counts = within_ceiling(seen, drawn)?;
        Ok(())
    }
}

/// Distributes `total` samples: picks pixels by error, and draws the pixels that receive the samples of each pick.
fn draw(seen: &Feedback<'_>, bank: &Bank, selection: &[Selected], total: u64) -> Vec<u32> {
    let pixels = seen.pixels();
    let each = (seen.budget.total / pixels as u64).max(1);
    let priority = |i: usize| {
        let Selected { mean: [r, g, b], error, samples, .. } = selection[i];
        let grey = (r + g + b) / 3.0;
        let priority = error / (1e-3 + grey * grey) / (each as f64 + samples);
        if priority.is_finite() { priority } else { f64::MAX }
    };
    let priorities: Vec<f64> = parallel::map(pixels, priority);
    let (all, rest) = (total / (each * pixels as u64), total % (each * pixels as u64));
    let (picks, cut) = (rest.div_ceil(each) as usize, rest % each);
    let mut order: Vec<u32> = (0..pixels as u32).collect();
    if picks > 0 {
        let rank = |&a: &u32, &b: &u32| {
            let by_error = priorities[b as usize].total_cmp(&priorities[a as usize]);
            by_error.then_with(|| mix(a.into()).cmp(&mix(b.into())))
        };
        order.select_nth_unstable_by(picks - 1, rank);
    }
    let kernels = Kernels::new(bank, seen.frame().size());
    let received: Vec<AtomicU32> = (0..pixels).map(|_| AtomicU32::new(0)).collect();
    // Sums of integers do not depend on the order.
    parallel::parts(order.chunks(64), |chunk, order| {
        for (rank, &pixel) in (64 * chunk..).zip(*order) {
            let own = if rank < picks { if rank + 1 == picks && cut > 0 { cut } else { each } } else { 0 };
            let scale = selection[pixel as usize].scale;
            let key = mix(mix(seen.budget.spent).wrapping_add(pixel.into()));
            for j in 0..all * each + own {
                received[kernels.draw(pixel, scale, key.wrapping_add(j << 8))].fetch_add(1, Ordering::Relaxed);
            }
        }
    });
    received.into_iter().map(AtomicU32::into_inner).collect()
}

/// The distributions from which the receiving pixels are drawn.
struct Kernels {
    /// The cumulative weights along an axis, for each Gaussian.
    cumulated: Vec<Vec<f64>>,
    size: [i64; 2],
}

impl Kernels {
    /// The number of attempts to draw a pixel inside the image. After that, the picked pixel itself receives the sample.
    const TRIES: u64 = 64;

    fn new(bank: &Bank, size: [u32; 2]) -> Self {
        let cumulated = |sigma: &f64| {
            let sums = gaussian_taps(*sigma).into_iter().scan(0.0, |sum, tap| {
                *sum += tap;
                Some(*sum)
            });
            sums.collect()
        };
        Self { cumulated: bank.sigmas.iter().map(cumulated).collect(), size: size.map(i64::from) }
    }

    /// The pixel that receives a sample of the picked `pixel`. It is drawn again while it lies outside the image. The lowest 8
    /// bits of the hash `key` number these attempts.
    fn draw(&self, pixel: u32, scale: u8, key: u64) -> usize {
        let Some(cumulated) = usize::from(scale).checked_sub(1).map(|s| &self.cumulated[s]) else {
            return pixel as usize;
        };
        let offset = |bits: u64| {
            let u = (bits & 0xffff_ffff) as f64 / 4_294_967_296.0;
            let k = cumulated.partition_point(|sum| *sum <= u).min(cumulated.len() - 1);
            k as i64 - (cumulated.len() / 2) as i64
        };
        let [width, height] = self.size;
        let (x, y) = (i64::from(pixel) % width, i64::from(pixel) / width);
        let drawn = |attempt: u64| {
            let bits = mix(key.wrapping_add(attempt));
            let (x, y) = (x + offset(bits), y + offset(bits >> 32));
            ((0..width).contains(&x) && (0..height).contains(&y)).then_some((y * width + x) as usize)
        };
        (0..Self::TRIES).find_map(drawn).unwrap_or(pixel as usize)
    }
}

/// A bank of Gaussians, and how the stop flags of each step are smoothed.
struct Bank {
    /// The standard deviations in pixels, from fine to coarse.
    sigmas: Vec<f64>,
    /// The standard deviation of the Gaussian that smooths a step's flags, relative to the step's own.
    smoothing: f64,
    /// `true` if smoothing only removes flags. Otherwise the smoothed flags replace them.
    only_removes: bool,
}

impl Bank {
    /// The bank that is used between rounds: four scales of 1 to 8 pixels.
    fn between_rounds() -> Self {
        Self { sigmas: vec![1.0, 2.0, 4.0, 8.0], smoothing: 1.0, only_removes: false }
    }

    /// The bank for the final image: seven scales of 1 to 8 pixels, each larger by a factor of the square root of 2.
    fn of_image() -> Self {
        let sigma = |s: i32| f64::from(1 << (s / 2)) * if s % 2 == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
        Self { sigmas: (0..7).map(sigma).collect(), smoothing: 2.0, only_removes: true }
    }

    /// The factor that turns a step's squared difference of means into a difference of squared biases. It is exact where the
    /// image is a quadratic function of the position.
    fn beta(&self, step: usize) -> f64 {
        let [coarse, fine] = match step {
            0 => return 1.0,
            _ => [self.sigmas[step], self.sigmas[step - 1]].map(|sigma| sigma * sigma),
        };
        (coarse + fine) / (coarse - fine)
    }
}

/// The image at one scale.
struct Level {
    /// Red, green and blue, the kernel's weight on pixels with samples, and the mean sample count under the kernel.
    means: Vec<[f64; 5]>,
    /// The variances of the means, averaged over the channels.
    variances: Vec<f64>,
    /// The kernel's weights along an axis.
    taps: Vec<f64>,
}

impl Level {
    /// The level that holds the pixels themselves.
    fn finest(film: &Film, variances: &[f64]) -> Self {
        let mean = |i: usize| {
            let [r, g, b] = film.mean(i);
            let n = film.count(i) as f64;
            [r, g, b, f64::from(u8::from(n > 0.0)), n]
        };
        Self { means: per_pixel(film, mean), variances: variances.to_vec(), taps: vec![1.0] }
    }

    /// The convolution of this (finest) level with a Gaussian. Pixels without samples have no weight.
    fn blurred(&self, size: [usize; 2], sigma: f64) -> Self {
        let taps = gaussian_taps(sigma);
        let mut means = convolve(size, &taps, &self.means);
        // Variances of independent pixels add up by squared weights.
        let squares: Vec<f64> = taps.iter().map(|tap| tap * tap).collect();
        let mut variances = convolved(size, &squares, &self.variances);
        let inside = inside(size, &taps);
        for (i, (mean, variance)) in means.iter_mut().zip(&mut variances).enumerate() {
            let weight = mean[3];
            if weight > 0.0 {
                (0..3).for_each(|c| mean[c] /= weight);
                *variance /= weight * weight;
            }
            mean[4] /= inside(i);
        }
        Self { means, variances, taps }
    }

    /// The number of samples under this level's kernel, with the kernel scaled to a peak of 1.
    fn samples(&self, i: usize) -> f64 {
        let peak = self.taps[self.taps.len() / 2];
        self.means[i][4] / (peak * peak)
    }
}

/// Convolves one plane.
fn convolved(size: [usize; 2], taps: &[f64], plane: &[f64]) -> Vec<f64> {
    convolve(size, taps, plane.as_chunks::<1>().0).into_flattened()
}

/// The variance of the difference between the means at two scales, averaged over the channels. `own` holds the variances of the
/// pixels.
fn variances_of_differences(size: [usize; 2], fine: &Level, coarse: &Level, own: &[f64]) -> Vec<f64> {
    let beyond = (coarse.taps.len() - fine.taps.len()) / 2;
    let products: Vec<f64> = fine.taps.iter().zip(&coarse.taps[beyond..]).map(|(f, c)| f * c).collect();
    let covariances = convolved(size, &products, own);
    parallel::map(covariances.len(), |i| {
        let weights = fine.means[i][3] * coarse.means[i][3];
        let covariance_of_means = if weights > 0.0 { covariances[i] / weights } else { 0.0 };
        fine.variances[i] + coarse.variances[i] - 2.0 * covariance_of_means
    })
}

/// The part of the kernel's weight that lies inside the image, as a function of the kernel's central pixel.
fn inside([width, height]: [usize; 2], taps: &[f64]) -> impl Fn(usize) -> f64 + Sync + use<> {
    let reach = taps.len() / 2;
    let along = |length: usize| -> Vec<f64> {
        let within = |at: usize| (0..taps.len()).filter(move |k| (reach..reach + length).contains(&(at + k)));
        (0..length).map(|at| within(at).map(|k| taps[k]).sum()).collect()
    };
    let [across, down] = [along(width), along(height)];
    move |i| across[i % width] * down[i / width]
}

/// The result of a step from one scale to the next for one pixel.
#[derive(Clone, Copy)]
struct Step {
    /// 1 if the step raises the error, so that the pixel stops before the step; else 0.
    flag: f64,
    /// The estimated increase of the squared bias.
    loss: f64,
    /// The decrease of the variance.
    gain: f64,
}

/// Compares two scales at pixel `i` by the loss `beta (mu_f - mu_c)^2` and the gain `V_f - V_c`.
///
/// The step stops if the mean over the channels of `z loss - gain` is not negative, where `z` is `strictness` times
/// 1 - 1 / N.
fn compare(fine: &Level, coarse: &Level, beta: f64, strictness: f64, i: usize) -> Step {
    let (f, c) = (&fine.means[i], &coarse.means[i]);
    let loss = beta * (0..3).map(|k| (f[k] - c[k]) * (f[k] - c[k])).sum::<f64>() / 3.0;
    let gain = fine.variances[i] - coarse.variances[i];
    let confidence = (1.0 - 1.0 / c[4]).max(0.0);
    let stops = strictness * confidence * loss - gain >= 0.0;
    Step { flag: f64::from(u8::from(stops)), loss, gain }
}

/// The factor on the loss for which a fraction `gamma` of all steps stop falsely on white noise: `-ln(1 - (1.9 gamma)^(1 / sqrt
/// 2))`.
fn strictness(gamma: f64) -> f64 {
    -libm::log(1.0 - libm::pow(1.9 * gamma, std::f64::consts::FRAC_1_SQRT_2))
}

/// Smooths the flags of a step by a Gaussian and rounds them. The pixel's own flag has at most 1 % of the weight.
fn smoothed(size: [usize; 2], sigma: f64, flags: &[[f64; 1]]) -> Vec<bool> {
    let taps = gaussian_taps(sigma);
    let (inside, peak) = (inside(size, &taps), taps[taps.len() / 2]);
    let sums = convolve(size, &taps, flags);
    let round = |(i, [sum]): (usize, &[f64; 1])| {
        let weight = inside(i);
        let own = (peak * peak - 0.01 * weight).max(0.0);
        sum - own * flags[i][0] >= 0.5 * (weight - own)
    };
    parallel::map(sums.len(), |i| round((i, &sums[i])))
}

/// A pixel filtered at its selected scale.
struct Selected {
    /// The number of steps taken: 0 for the pixel's own mean, `s` for the bank's Gaussian `s - 1`.
    scale: u8,
    /// The mean at that scale, linear RGB.
    mean: [f64; 3],
    /// The estimated squared error at that scale as published, averaged over the channels: the variance plus all losses. Noise
    /// raises the losses.
    error: f64,
    /// The estimated squared bias at that scale without noise, averaged over the channels. It may be negative. It is 0 except
    /// in the bank for the final image.
    bias: f64,
    /// The variance at that scale, averaged over the channels.
    variance: f64,
    /// The number of samples under the kernel, with the kernel scaled to a peak of 1.
    samples: f64,
}

impl Selected {
    /// The bytes per pixel at the peak of [`select`]: the finest level, two more levels, the row sums of one level, variances,
    /// errors and marks, steps and flags.
    const BYTES: usize = 4 * 48 + 25 + size_of::<Step>() + 17 + 8 + size_of::<Self>();

    fn new(level: &Level, i: usize, scale: u8, [error, bias]: [f64; 2]) -> Self {
        let [r, g, b, ..] = level.means[i];
        Self { scale, mean: [r, g, b], error, bias, variance: level.variances[i], samples: level.samples(i) }
    }
}

/// Selects each pixel's scale. A pixel advances from scale to scale until the first flagged step.
///
/// If the noise is unknown, as in an image of one sample per pixel, no scale is selected.
fn select(film: &Film, bank: &Bank, gamma: f64) -> Vec<Selected> {
    let size = film.frame().size().map(|n| n as usize);
    let variances = variances_of_means(film);
    let finest = Level::finest(film, &variances);
    let own = |i| Selected::new(&finest, i, 0, [variances[i], 0.0]);
    let mut selection: Vec<Selected> = (0..variances.len()).map(own).collect();
    if variances.iter().any(|v| v.is_infinite()) {
        return selection; // nothing is known of the noise
    }
    let mut errors: Vec<[f64; 2]> = variances.iter().map(|v| [*v, 0.0]).collect();
    let mut open = vec![true; errors.len()];
    let mut last: Option<Level> = None;
    for (step, &sigma) in bank.sigmas.iter().enumerate() {
        let coarse = finest.blurred(size, sigma);
        let fine = last.as_ref().unwrap_or(&finest);
        let (beta, strictness) = (bank.beta(step), strictness(gamma));
        let steps: Vec<Step> = parallel::map(errors.len(), |i| compare(fine, &coarse, beta, strictness, i));
        let flags: Vec<[f64; 1]> = steps.iter().map(|step| [step.flag]).collect();
        let stops = smoothed(size, bank.smoothing * sigma, &flags);
        let noise = bank.only_removes.then(|| variances_of_differences(size, fine, &coarse, &variances));
        for (i, Step { flag, loss, gain }) in steps.into_iter().enumerate() {
            let bias = noise.as_ref().map_or(0.0, |noise| loss - beta * noise[i]);
            let [error, squared_bias] = errors[i];
            let is_new = fine.means[i][3] <= 0.0;
            errors[i] = if is_new { [coarse.variances[i], 0.0] } else { [error + loss - gain, squared_bias + bias] };
            let stops = stops[i] && (!bank.only_removes || flag > 0.0) && !is_new;
            open[i] &= !stops;
            if open[i] {
                selection[i] = Selected::new(&coarse, i, step as u8 + 1, errors[i]);
            }
        }
        last = Some(coarse);
    }
    selection
}
