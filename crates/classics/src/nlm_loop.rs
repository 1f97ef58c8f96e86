//! Adaptive rendering with non-local means: the filter and the sampler of the authors' program.

use crate::method::{FilterMethod, MethodFilter, MethodSampler, SamplingMethod};
use crate::method::{next_step, within_ceiling};
use crate::patch_means::{Mirrored, PatchGuide, Patches, patch_means};
use crate::windows::{convolve, gaussian_taps, per_pixel, stored};
use dapple_core::plan::{Feedback, PilotPolicy, Plan, saturating_u32, share};
use dapple_core::{Error, Film, Filtered, Needs, filter::ImagePlanes};

/// The estimate of the variance of pixel means in one half of the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HalfVariance {
    /// The squared difference of the halves' means, smoothed. It is valid for low-discrepancy points.
    Halves,
    /// The sample variance divided by the count. It is valid for independent samples.
    Samples,
}

dapple_core::choices!(HalfVariance { Halves = "halves", Samples = "samples" });

dapple_core::options! {
    /// The parameters of [`NlmLoopFilter`].
    pub struct NlmLoopFilterOptions {
        /// Search radius in pixels.
        pub window: usize = 10, |window| window <= 10, "0 to 10 pixels to each side";
        /// Patch radius in pixels.
        pub patch: usize = 3, |patch| patch <= 5, "0 to 5 pixels to each side";
        /// Damping of colour differences. Larger values smooth more.
        pub k: f64 = 0.45, |k| (1e-3..=1e3).contains(&k), "0.001 to 1000 standard deviations";
        /// Factor on the noise variance that is subtracted from squared differences.
        pub alpha: f64 = 1.0 => "1", |alpha| (0.0..=4.0).contains(&alpha), "0 to 4";
        /// Estimate of the variance of pixel means: halves (smoothed difference of half-buffers) or samples (for independent points).
        pub variance: HalfVariance = HalfVariance::Halves => "halves";
    }
}

dapple_core::options! {
    /// The parameters of [`NlmLoop`], the sampler.
    pub struct NlmLoopOptions {
        /// Samples per pixel before counts adapt.
        pub pilot: u32 = 4, |pilot| pilot >= 4, "at least 4, two for each half";
        /// Rounds after the pilot, each with an equal share of the remaining budget.
        pub rounds: u32 = 3, |rounds| (1..=1024).contains(&rounds), "1 to 1024";
        /// Search radius in pixels.
        pub window: usize = 7, |window| window <= 10, "0 to 10 pixels to each side";
        /// Patch radius in pixels.
        pub patch: usize = 3, |patch| patch <= 5, "0 to 5 pixels to each side";
        /// Damping of colour differences. Larger values smooth more.
        pub k: f64 = 0.45, |k| (1e-3..=1e3).contains(&k), "0.001 to 1000 standard deviations";
        /// Factor on the noise variance that is subtracted from squared differences.
        pub alpha: f64 = 0.5, |alpha| (0.0..=4.0).contains(&alpha), "0 to 4";
        /// Estimate of the variance of pixel means: halves (smoothed difference of half-buffers) or samples (for independent points).
        pub variance: HalfVariance = HalfVariance::Halves => "halves";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// The filter of adaptive rendering with non-local means, as in the authors' program [Rousselle, Knaus and Zwicker 2012].
///
/// Each pixel becomes the mean of pixels with similar surrounding patches. Weights from one half of the samples filter the
/// other half, and the image is the mean of both, weighted by their counts. Patches are compared as in the faster filter `nlm`
/// (`NlMeans` of `dapple-denoise`). This filter differs from `nlm` in these points:
///
/// * Windows have 21x21 pixels.
/// * If the mean of two opposite pixels of a window is more similar to the central pixel than either, both get the mean's
///   weight.
/// * Weights are averaged over patches; weights below 0.05 are removed.
/// * The variance of a half's mean is `(A - B)^2 / 2` for the means `A` and `B` of the halves, smoothed over 3x3 pixels by
///   non-local means with the sample variance as guide. Its maximum is `max(v_A / n_A, v_B / n_B)` for the sample variances `v`
///   and counts `n` of the halves.
///
/// *Differences from the authors' program*: the program divides pixels into smaller cells. Here, sample variances are averaged
/// over 3x3 pixels instead of by the program's pixel filter. Averages are exact at the image's border, and pixels without
/// samples have no weight.
///
/// *Error*: a quarter of the squared difference of the filtered halves, smoothed over 5x5 pixels. This is only the variance;
/// bias is not included. *Weaknesses*: without features, textures and edges of shadows need many samples. Filtering takes as
/// long as tens of samples of a simple scene.
pub type NlmLoopFilter = MethodFilter<NlmLoopFilterOptions>;

impl NlmLoopFilterOptions {
    fn like(&self) -> Patches {
        Patches { window: self.window, patch: self.patch, k: self.k as f32, alpha: self.alpha as f32 }
    }

    /// Filters both halves of a film's samples. A pixel has red, green, blue, the mean sample count under its weights, and the
    /// sum of its weights. The sum is 0 if its window holds no sample.
    fn halves(&self, film: &Film) -> [Vec<[f32; 5]>; 2] {
        let like = self.like();
        let halves = [0, 1].map(|half| Half::new(film, half));
        let variances = match self.variance {
            HalfVariance::Halves => {
                let common = smoothed_variance(film, &halves, like);
                [common.clone(), common]
            }
            HalfVariance::Samples => halves.each_ref().map(|half| half.variance.clone()),
        };
        let size = film.frame().size().map(|n| n as usize);
        [0, 1].map(|half: usize| {
            let plane = |values: &Vec<f32>| Mirrored::new(size, like.window, values);
            let other = 1 - half;
            let guide = PatchGuide {
                colour: halves[other].colour.each_ref().map(plane),
                variance: variances[other].each_ref().map(plane),
            };
            let mean = |i, c| film.half(half, i).unwrap_or_default().mean[c] as f32;
            let [r, g, b] = planes(film, mean).each_ref().map(plane);
            let count = &halves[half].count;
            let known = per_pixel(film, |i| f32::from(u8::from(count[i] > 0.0)));
            patch_means(size, &guide, &[r, g, b, plane(count), plane(&known)], like)
        })
    }
}

/// One plane per channel.
fn planes(film: &Film, of: impl Fn(usize, usize) -> f32 + Sync + Send) -> [Vec<f32>; 3] {
    [0, 1, 2].map(|c| per_pixel(film, |i| of(i, c)))
}

/// The variance of a pixel without samples, in squared levels.
const UNKNOWN: f32 = 1e18;
/// The largest colour and standard deviation in comparisons, in levels.
const LARGEST: f64 = 1e9;

/// The planes of one half of the samples that comparisons read, in units of the image's level.
struct Half {
    colour: [Vec<f32>; 3],
    /// The variance of one sample.
    sample_variance: [Vec<f32>; 3],
    /// The variance of the mean.
    variance: [Vec<f32>; 3],
    count: Vec<f32>,
}

impl Half {
    fn new(film: &Film, half: usize) -> Self {
        let unit = 1.0 / median(film);
        let of = |i: usize| film.half(half, i).unwrap_or_default();
        // Sample variances are averaged over 3x3 pixels, since the pixel filter of the authors' program mixes neighbours too.
        let own = per_pixel(film, |i| {
            let known = |variance: [f64; 3]| {
                let [r, g, b] = variance.map(|v| (v * unit * unit).min(LARGEST * LARGEST));
                [r, g, b, 1.0]
            };
            of(i).variance().map_or([0.0; 4], known)
        });
        let near = convolve(film.frame().size().map(|n| n as usize), &[1.0; 3], &own);
        let colour = |i, c: usize| {
            let mean = if of(i).count > 0 { of(i).mean } else { film.mean(i) };
            (mean[c] * unit).min(LARGEST) as f32
        };
        let of_sample = |i: usize, c: usize| if near[i][3] > 0.0 { (near[i][c] / near[i][3]) as f32 } else { UNKNOWN };
        let of_mean = |i, c| if of(i).count > 0 { of_sample(i, c) / of(i).count as f32 } else { UNKNOWN };
        let count = per_pixel(film, |i| of(i).count as f32);
        let (colour, sample_variance) = (planes(film, colour), planes(film, of_sample));
        Self { colour, sample_variance, variance: planes(film, of_mean), count }
    }
}

/// The median brightness of the pixels that are not black; 1 in a black image.
fn median(film: &Film) -> f64 {
    let grey = per_pixel(film, |i| film.mean(i).iter().sum::<f64>() / 3.0);
    let mut lit: Vec<f64> = grey.into_iter().filter(|grey| *grey > 0.0).collect();
    if lit.is_empty() {
        return 1.0;
    }
    let middle = lit.len() / 2;
    lit.select_nth_unstable_by(middle, f64::total_cmp).1.clamp(1e-18, 1e18)
}

/// The variance of the mean of either half: half of the squared difference of the means. It is smoothed over 3x3 pixels with
/// similar sample variances, and limited to the larger of the halves' own estimates.
fn smoothed_variance(film: &Film, [a, b]: &[Half; 2], like: Patches) -> [Vec<f32>; 3] {
    let size = film.frame().size().map(|n| n as usize);
    let like = Patches { window: 1, alpha: 4.0, ..like };
    let plane = |values: Vec<f32>| Mirrored::new(size, like.window, &values);
    let half_square = |a: f32, b: f32| 0.5 * (a - b).clamp(-1e15, 1e15) * (a - b).clamp(-1e15, 1e15);
    let of_sample = |half: &Half, i: usize, c: usize| half.sample_variance[c][i].min(1e15);
    let variance = |i, c| half_square(of_sample(a, i, c), of_sample(b, i, c));
    let guide = PatchGuide {
        colour: planes(film, |i, c| of_sample(a, i, c)).map(plane),
        variance: planes(film, variance).map(plane),
    };
    let known = plane(per_pixel(film, |i| f32::from(u8::from(a.count[i] > 0.0 && b.count[i] > 0.0))));
    let [red, green, blue] = planes(film, |i, c| half_square(a.colour[c][i], b.colour[c][i])).map(plane);
    let smooth = patch_means(size, &guide, &[red, green, blue, known], like);
    planes(film, |i, c| {
        let most = a.variance[c][i].max(b.variance[c][i]);
        if smooth[i][3] > 0.0 { smooth[i][c].min(most) } else { most }
    })
}

/// The bytes per pixel at the peak of the filter: planes of both halves, their mirrored copies, results and images.
const FILTER_BYTES: usize = 4 * (2 * 10 + 2 * 3 + 11 + 2 * 5) + 80;

impl FilterMethod for NlmLoopFilterOptions {
    const NAME: &'static str = "nlm-loop";
    const BYTES: usize = FILTER_BYTES;
    const PLANES: ImagePlanes = ImagePlanes::RadianceAndError;

    fn needs(&self) -> Needs {
        Needs::none().with_half_variance()
    }

    fn image(&self, film: &Film, (): &()) -> Result<Filtered, Error> {
        let [a, b] = self.halves(film);
        let combined = |i: usize| {
            let [na, nb] = [0, 1].map(|half| film.half(half, i).unwrap_or_default().count as f32);
            let share = match [a[i][4] > 0.0, b[i][4] > 0.0] {
                [true, true] if na + nb > 0.0 => na / (na + nb),
                [true, true] => 0.5,
                [is_known, _] => f32::from(u8::from(is_known)),
            };
            let colour: [f32; 3] = std::array::from_fn(|c| share * a[i][c] + (1.0 - share) * b[i][c]);
            let apart = |c: usize| f64::from(a[i][c]) - f64::from(b[i][c]);
            let both = a[i][4] > 0.0 && b[i][4] > 0.0;
            let error = if both { [(0..3).map(|c| apart(c) * apart(c)).sum::<f64>() / 12.0, 1.0] } else { [0.0; 2] };
            (colour, error)
        };
        let (radiance, errors): (Vec<_>, Vec<[f64; 2]>) = per_pixel(film, combined).into_iter().unzip();
        let near = convolve(film.frame().size().map(|n| n as usize), &[0.2; 5], &errors);
        let of = |[error, weight]: [f64; 2]| stored(if weight > 0.0 { error / weight } else { f64::INFINITY });
        let error: Vec<f32> = near.into_iter().map(of).collect();
        Ok(Filtered::new(film.frame().size(), radiance).with_error(error))
    }
}

/// The sampler of adaptive rendering with non-local means, as in the authors' program [Rousselle, Knaus and Zwicker 2012].
///
/// After a pilot, each round filters both halves of the samples by [`NlmLoopFilter`], by default with `window` 7 and `alpha`
/// 0.5. For the filtered halves `A` and `B`, a pixel's error is `2 (A - B)^2 (1 / (0.001 + A^2) / n_A + 1 / (0.001 + B^2) /
/// n_B)`, averaged over the channels. `n_A` and `n_B` are the halves' sample counts, averaged with the weights of the
/// filter. New counts are proportional to this error, blurred by a Gaussian of 0.8 pixels. In a round, a pixel gets at most
/// twice the budget's mean samples per pixel.
///
/// *Guarantees*: spends the budget exactly, and takes the pilot in every pixel if the budget allows. *Bias*: sample counts
/// depend on the samples, and all samples are kept [Kirk and Arvo 1991]. *Weaknesses*: filtering once per round takes the
/// time of many samples. The difference of two halves is a noisy estimate, and does not include bias. As published, counts are
/// proportional to the error; counts proportional to its square root would give less error.
pub type NlmLoop<P> = MethodSampler<P, NlmLoopOptions>;

impl NlmLoopOptions {
    /// The relative error of each filtered pixel, divided by the mean number of samples that contribute to it.
    fn errors(&self, film: &Film) -> Vec<f64> {
        let Self { window, patch, k, alpha, variance, .. } = *self;
        let [a, b] = NlmLoopFilterOptions { window, patch, k, alpha, variance }.halves(film);
        let error = |i: usize| {
            let of = |one: &[f32; 5], other: &[f32; 5]| {
                let relative = |c: usize| {
                    let [x, y] = [one[c], other[c]].map(f64::from);
                    2.0 * (x - y) * (x - y) / (1e-3 + x * x)
                };
                (0..3).map(relative).sum::<f64>() / 3.0 / f64::from(one[3]).max(1.0)
            };
            [of(&a[i], &b[i]) + of(&b[i], &a[i])]
        };
        let taps = gaussian_taps(0.8);
        convolve(film.frame().size().map(|n| n as usize), &taps, &per_pixel(film, error)).into_flattened()
    }
}

impl SamplingMethod for NlmLoopOptions {
    const NAME: &'static str = "nlm-loop";
    const PLANNING: usize = FILTER_BYTES;

    fn needs(&self) -> Needs {
        Needs::none().with_half_variance()
    }

    fn pilot_and_rounds(&self, _: u64) -> (u32, Option<u32>) {
        (self.pilot, Some(self.rounds))
    }

    fn refine(&self, seen: &Feedback<'_>, first: u32, _: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error> {
        let total = next_step(seen, first, self.rounds);
        let most = saturating_u32(2 * (seen.budget.total / seen.pixels() as u64).max(1));
        let planned = share(&self.errors(seen.film), 0, &vec![0; seen.pixels()], most, total)?.counts;
        plan.counts = within_ceiling(seen, planned)?;
        Ok(())
    }
}
