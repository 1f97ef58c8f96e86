//! A sampler that adds samples where noise is visible, by a model of contrast sensitivity and masking.

use crate::method::{MethodSampler, SamplingMethod};
use crate::method::{counts_so_far, lacking, next_step, total};
use crate::windows::{convolve, filled_means, per_pixel};
use dapple_core::plan::{Feedback, PilotPolicy, Plan, Stopping, allocate, saturating_u32};
use dapple_core::{Error, Film, film::luminance};

dapple_core::options! {
    /// The parameters of [`Perceptual`].
    pub struct PerceptualOptions {
        /// With mode=threshold: a pixel stops below this many just noticeable differences.
        pub threshold: f64 = 1.0 => "1", |t| t > 0.0 && t.is_finite(), "above 0";
        /// Pixels per degree of visual angle, as for FLIP.
        pub ppd: f64 = 67.0 => "67", |ppd| (1.0..=1000.0).contains(&ppd), "1 to 1000 pixels per degree";
        /// Peak contrast sensitivity, at 4 cycles per degree.
        pub sensitivity: f64 = 100.0 => "100", |s| s > 0.0 && s.is_finite(), "above 0";
        /// Luminance to which the eye has adapted; 0 = automatic (the mean of the image).
        pub adapt: f64 = 0.0 => "0", |adapt| adapt >= 0.0 && adapt.is_finite(), "0 or above; 0 chooses";
        /// Samples per pixel before counts adapt.
        pub pilot: u32 = 4, |pilot| pilot >= 2, "at least 2, since one sample has no variance";
        /// Rounds after the pilot, each with an equal share of the remaining budget.
        pub rounds: u32 = 4, |rounds| (1..=1024).contains(&rounds), "1 to 1024";
        /// Stopping rule: budget (most visible differences first, until spent) or threshold (until all pixels are below it, within the budget).
        pub mode: Stopping = Stopping::Budget => "budget";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// Sample counts by how visible the noise is [after Bolin and Meyer 1998].
///
/// The eye's response to luminance `x` is `ln(1 + x / adapt)`. The standard error of a pixel's response is a quarter of the
/// difference between the responses to `mean + 2 SE` and `mean - 2 SE`. The response is split into six octaves by means over
/// blocks of 1, 2x2, 4x4 and more pixels. The noise contrast of a band is four of the band's standard errors, divided by the
/// mean response two levels coarser. It is weighted by the sensitivity `s (f / 4) exp(1 - f / 4)` to the band's frequency `f`
/// in cycles per degree. To model masking, it is divided by `1 + (c / 0.1)^0.7` for the image's contrast `c` in the same band,
/// reduced by the noise. The fourth root of the sum of fourth powers over all bands is the difference `D` in just noticeable
/// differences.
///
/// With [`Stopping::Budget`], counts minimise the sum of `D^2`. With [`Stopping::Threshold`], pixels whose `D` is above the
/// threshold get the samples expected to bring `D` below it, but a round at most doubles a pixel's count.
///
/// The method is implemented from memory: bounds, octaves, contrast, sensitivity and masking are the authors' steps, but no
/// formula or constant is from the paper. The authors compute bounds of the details of a Haar pyramid.
///
/// *Guarantees*: spends the budget exactly, or at most the budget with [`Stopping::Threshold`]. Takes the pilot in every pixel
/// if the budget allows. *Bias*: sample counts depend on the samples, and all samples are kept [Kirk and Arvo 1991].
/// *Weaknesses*: stops early in busy textures, as intended, and in the dark. The displayed image is assumed to show the adapted
/// luminance as grey. The method does well by FLIP and poorly by relative squared error.
pub type Perceptual<P> = MethodSampler<P, PerceptualOptions>;

impl PerceptualOptions {
    /// Plans samples for all pixels so as to minimise the sum of squared differences.
    fn plan_budget(&self, seen: &Feedback<'_>, differences: &[f64], step: u64, plan: &mut Plan) -> Result<(), Error> {
        let now = counts_so_far(seen);
        let score = |(d, n): (&f64, &u32)| d * d * f64::from((*n).max(1));
        let scores: Vec<f64> = differences.iter().zip(&now).map(score).collect();
        let counts = allocate(&scores, &now, seen.budget.max_spp, total(&now) + step)?.counts;
        plan.counts = lacking(&counts, &now);
        Ok(())
    }

    /// Plans samples for the pixels above the threshold, the largest differences first if the budget is too small.
    fn plan_threshold(&self, seen: &Feedback<'_>, differences: &[f64], plan: &mut Plan) {
        let mut open: Vec<usize> = (0..seen.pixels()).filter(|&i| differences[i] > self.threshold).collect();
        open.sort_by(|&a, &b| differences[b].total_cmp(&differences[a]).then(a.cmp(&b)));
        let mut left = seen.budget.left();
        for i in open {
            let now = saturating_u32(seen.film.count(i)).max(1);
            // The difference falls with the square root of the count.
            let ratio = differences[i] / self.threshold;
            let lacking = (f64::from(now) * (ratio * ratio - 1.0)).ceil().min(f64::from(now)) as u32;
            let room = seen.budget.max_spp.saturating_sub(saturating_u32(seen.film.count(i)));
            plan.counts[i] = lacking.max(1).min(room).min(saturating_u32(left));
            left -= u64::from(plan.counts[i]);
        }
    }
}

/// The eye's response to a pixel and the variance of the response.
type Response = [f64; 2];

/// The response of each pixel and its variance, from the bounds of its luminance.
///
/// Sample variances are pooled with the variance of 5x5 pixels, which counts as 12 degrees of freedom. Before that, they are
/// scaled by the squared slope of the response, so that dark pixels beside a light are not affected by the light's noise.
fn responses(film: &Film, adapt: f64) -> Vec<Response> {
    let size = film.frame().size().map(|n| n as usize);
    let (means, variances) = filled_means(film);
    let grey = per_pixel(film, |i| luminance(means[i]));
    let adapted = if adapt > 0.0 { adapt } else { (grey.iter().sum::<f64>() / grey.len() as f64).max(1e-4) };
    let squared_slope = |i: usize| 1.0 / ((grey[i] + adapted) * (grey[i] + adapted));
    let known = |i: usize| {
        // The noise of the three channels is assumed to be fully correlated.
        let deviation = film.moments(i).variance().map(|v| luminance(v.map(f64::sqrt)));
        deviation.map_or([0.0; 2], |deviation| [deviation * deviation * squared_slope(i), 1.0])
    };
    let own = per_pixel(film, known);
    let near = convolve(size, &[1.0; 5], &own);
    let response = |i: usize| {
        let n = film.count(i).max(1) as f64;
        let freedom = (n - 1.0) * own[i][1];
        let [sum, number] = near[i];
        let around = if number > 0.0 { sum / number } else { variances[i] * n * squared_slope(i) };
        let variance = (freedom * own[i][0] + POOLED * around) / ((freedom + POOLED) * n);
        let error = (variance / squared_slope(i)).sqrt();
        let of = |x: f64| libm::log1p(x.max(0.0) / adapted);
        let spread = (of(grey[i] + 2.0 * error) - of(grey[i] - 2.0 * error)) / 4.0;
        [of(grey[i]), spread * spread]
    };
    per_pixel(film, response)
}

/// The degrees of freedom of the variance of 5x5 pixels.
const POOLED: f64 = 12.0;
/// The number of octaves.
const BANDS: usize = 6;
/// The least mean response by which a band's noise is divided.
const DARK: f64 = 0.01;
/// The exponent of the sum over bands.
const SUM: f64 = 4.0;

/// The means of blocks of 1, 2x2, 4x4 and more pixels, with their variances.
struct Pyramid {
    sizes: Vec<[usize; 2]>,
    levels: Vec<Vec<Response>>,
}

impl Pyramid {
    fn new(size: [usize; 2], finest: Vec<Response>) -> Self {
        let (mut sizes, mut levels) = (vec![size], vec![finest]);
        for level in 0..BANDS {
            let (fine, [width, height]) = (&levels[level], sizes[level]);
            let [columns, rows] = [width.div_ceil(2), height.div_ceil(2)];
            let mean = |i: usize| {
                let (x, y) = (i % columns * 2, i / columns * 2);
                let mut sum = [0.0; 3];
                for y in y..(y + 2).min(height) {
                    for [mean, variance] in &fine[y * width + x..y * width + (x + 2).min(width)] {
                        sum = [sum[0] + mean, sum[1] + variance, sum[2] + 1.0];
                    }
                }
                [sum[0] / sum[2], sum[1] / (sum[2] * sum[2])]
            };
            let coarse = (0..columns * rows).map(mean).collect();
            levels.push(coarse);
            sizes.push([columns, rows]);
        }
        Self { sizes, levels }
    }

    fn block(&self, level: usize, [x, y]: [usize; 2]) -> Response {
        self.levels[level][(y >> level) * self.sizes[level][0] + (x >> level)]
    }

    /// The number of blocks of `level` that make up the next coarser block around a pixel.
    fn children(&self, level: usize, at: [usize; 2]) -> f64 {
        let along = |axis: usize| if (at[axis] >> level | 1) < self.sizes[level][axis] { 2.0 } else { 1.0 };
        along(0) * along(1)
    }

    /// The contrast of a pixel in a band, without the contrast expected from noise, and its standard error.
    fn contrast(&self, band: usize, at: [usize; 2]) -> [f64; 2] {
        let ([fine, variance], [coarse, coarse_variance]) = (self.block(band, at), self.block(band + 1, at));
        // The finer mean has this weight in the coarser one, which makes their noise correlated.
        let covariance = variance / self.children(band, at);
        let error = (variance + coarse_variance - 2.0 * covariance).max(0.0).sqrt();
        let [below, _] = self.block((band + 2).min(BANDS), at);
        // The squared contrast without the contribution of noise.
        let square = (fine - coarse) * (fine - coarse) - error * error;
        [square.max(0.0).sqrt(), error].map(|value| value / below.max(DARK))
    }
}

/// The sensitivity to each band at `ppd` pixels per degree: `(f / 4) exp(1 - f / 4)` at the middle of the octave, times `peak`.
fn sensitivities(ppd: f64, peak: f64) -> [f64; BANDS] {
    std::array::from_fn(|band| {
        let frequency = ppd * std::f64::consts::FRAC_1_SQRT_2 / f64::from(2u32 << band);
        peak * frequency / 4.0 * libm::exp(1.0 - frequency / 4.0)
    })
}

/// The visible difference of each pixel in just noticeable differences.
fn visible_differences(film: &Film, options: &PerceptualOptions) -> Vec<f64> {
    let size = film.frame().size().map(|n| n as usize);
    let pyramid = Pyramid::new(size, responses(film, options.adapt));
    let sensitivities = sensitivities(options.ppd, options.sensitivity);
    let difference = |i: usize| {
        let at = [i % size[0], i / size[0]];
        let of_band = |(band, sensitivity): (usize, &f64)| {
            let [contrast, error] = pyramid.contrast(band, at);
            let masked = 1.0 + libm::pow(contrast / 0.1, 0.7);
            libm::pow(4.0 * error * sensitivity / masked, SUM)
        };
        libm::pow(sensitivities.iter().enumerate().map(of_band).sum::<f64>(), 1.0 / SUM)
    };
    per_pixel(film, difference)
}

impl SamplingMethod for PerceptualOptions {
    const NAME: &'static str = "perceptual";
    // Means and variances, two sums over windows and their rows, brightness, response; then the pyramid and the differences.
    const PLANNING: usize = 24 + 8 + 3 * 16 + 8 + 16;

    fn pilot_and_rounds(&self, _: u64) -> (u32, Option<u32>) {
        (self.pilot, None)
    }

    fn refine(&self, seen: &Feedback<'_>, first: u32, _: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error> {
        let differences = visible_differences(seen.film, self);
        match self.mode {
            Stopping::Threshold => self.plan_threshold(seen, &differences, plan),
            Stopping::Budget => {
                self.plan_budget(seen, &differences, next_step(seen, first, self.rounds), plan)?;
            }
        }
        Ok(())
    }
}
