//! Selection of a Gaussian's scale for each pixel, from fine to coarse.

use crate::variances::{per_pixel, variances_of_means};
use crate::windows::{convolve, gaussian_taps, squared};
use dapple_core::Film;
use rayon::prelude::*;

/// A bank of Gaussians, and the smoothing of the flags that stop at one of them.
pub(crate) struct Bank {
    /// The standard deviations in pixels, from fine to coarse.
    pub(crate) sigmas: Vec<f64>,
    /// The standard deviation of the Gaussian over a step's flags, in units of the step's own.
    smoothing: f64,
    /// `true` if smoothed flags only remove flags. Otherwise they replace them.
    only_removes: bool,
}

impl Bank {
    /// The bank between rounds: four scales of 1 to 8 pixels.
    pub(crate) fn between_rounds() -> Self {
        Self { sigmas: vec![1.0, 2.0, 4.0, 8.0], smoothing: 1.0, only_removes: false }
    }

    /// The bank of the image: seven scales of 1 to 8 pixels, a factor of the square root of 2 apart.
    pub(crate) fn of_image() -> Self {
        let sigma = |s: i32| f64::from(1 << (s / 2)) * if s % 2 == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
        Self { sigmas: (0..7).map(sigma).collect(), smoothing: 2.0, only_removes: true }
    }

    /// The factor on a step's squared difference of means that makes it a difference of squared biases. It is exact where
    /// the image is a quadratic function of the position.
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
    /// Red, green and blue, the kernel's weight on pixels with samples, and the mean count under the kernel.
    means: Vec<[f64; 5]>,
    /// The variances of the means, averaged over the channels.
    variances: Vec<f64>,
    /// The kernel along an axis.
    taps: Vec<f64>,
}

impl Level {
    /// The pixels themselves.
    fn finest(film: &Film, variances: &[f64]) -> Self {
        let mean = |i: usize| {
            let [r, g, b] = film.mean(i);
            let n = film.count(i) as f64;
            [r, g, b, f64::from(u8::from(n > 0.0)), n]
        };
        Self { means: per_pixel(film, mean), variances: variances.to_vec(), taps: vec![1.0] }
    }

    /// The convolution of this level, the finest, with a Gaussian. Pixels without samples have no weight.
    fn blurred(&self, size: [usize; 2], sigma: f64) -> Self {
        let taps = gaussian_taps(sigma);
        let mut means = convolve(size, &taps, &self.means);
        let mut variances = convolved(size, &squared(&taps), &self.variances);
        let inside = inside(size, &taps);
        means.par_iter_mut().zip(&mut variances).enumerate().with_min_len(1024).for_each(|(i, (mean, variance))| {
            let weight = mean[3];
            if weight > 0.0 {
                (0..3).for_each(|c| mean[c] /= weight);
                *variance /= weight * weight;
            }
            mean[4] /= inside(i);
        });
        Self { means, variances, taps }
    }

    /// The number of samples under this level's kernel, scaled to a peak of 1.
    fn samples(&self, i: usize) -> f64 {
        let peak = self.taps[self.taps.len() / 2];
        self.means[i][4] / (peak * peak)
    }

    fn is_empty(&self, i: usize) -> bool {
        self.means[i][3] <= 0.0
    }
}

/// Convolves one plane.
fn convolved(size: [usize; 2], taps: &[f64], plane: &[f64]) -> Vec<f64> {
    convolve(size, taps, plane.as_chunks::<1>().0).into_flattened()
}

/// The variance, averaged over the channels, of the difference between the means at two scales. `own` holds the variances
/// of the pixels.
fn variances_of_differences(size: [usize; 2], fine: &Level, coarse: &Level, own: &[f64]) -> Vec<f64> {
    let beyond = (coarse.taps.len() - fine.taps.len()) / 2;
    let products: Vec<f64> = fine.taps.iter().zip(&coarse.taps[beyond..]).map(|(f, c)| f * c).collect();
    let mut covariances = convolved(size, &products, own);
    covariances.par_iter_mut().enumerate().with_min_len(1024).for_each(|(i, covariance)| {
        let weights = fine.means[i][3] * coarse.means[i][3];
        let covariance_of_means = if weights > 0.0 { *covariance / weights } else { 0.0 };
        *covariance = fine.variances[i] + coarse.variances[i] - 2.0 * covariance_of_means;
    });
    covariances
}

/// The part of the kernel's weight that lies inside the image, as a function of the pixel at its centre.
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
    /// 1 if the step raises the error, so that the pixel stops before it; else 0.
    flag: f64,
    /// The estimated rise of the squared bias.
    loss: f64,
    /// The fall of the variance.
    gain: f64,
}

/// Compares two scales at pixel `i`: the loss `beta (mu_f - mu_c)^2` with the gain `V_f - V_c`.
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

/// The factor on the loss in units of which false stops are `gamma` of all steps on white noise:
/// `-ln(1 - (1.9 gamma)^(1 / sqrt 2))`.
fn strictness(gamma: f64) -> f64 {
    -libm::log(1.0 - libm::pow(1.9 * gamma, std::f64::consts::FRAC_1_SQRT_2))
}

/// Smooths the flags of a step by a Gaussian in which the pixel's own flag has at most 1 % of the weight, and rounds them.
fn smoothed(size: [usize; 2], sigma: f64, flags: &[[f64; 1]]) -> Vec<bool> {
    let taps = gaussian_taps(sigma);
    let (inside, peak) = (inside(size, &taps), taps[taps.len() / 2]);
    let sums = convolve(size, &taps, flags);
    let round = |(i, [sum]): (usize, &[f64; 1])| {
        let weight = inside(i);
        let own = (peak * peak - 0.01 * weight).max(0.0);
        sum - own * flags[i][0] >= 0.5 * (weight - own)
    };
    sums.par_iter().enumerate().with_min_len(1024).map(round).collect()
}

/// The scale of each pixel, and the image there.
pub(crate) struct Selection {
    /// The number of steps taken: 0 for the pixel's own mean, `s` for the bank's Gaussian `s - 1`.
    pub(crate) scales: Vec<u8>,
    /// The mean at that scale, linear RGB.
    pub(crate) means: Vec<[f64; 3]>,
    /// The estimated squared error there as published, averaged over the channels: the variance plus all losses. Noise
    /// raises the losses.
    pub(crate) errors: Vec<f64>,
    /// The estimated squared bias there, averaged over the channels and free of the share of noise. Single values may be
    /// negative. All are 0 for a bank that is not the image's.
    pub(crate) biases: Vec<f64>,
    /// The variance there, averaged over the channels.
    pub(crate) variances: Vec<f64>,
    /// The number of samples under the kernel of peak 1.
    pub(crate) samples: Vec<f64>,
}

impl Selection {
    /// The bytes per pixel at the peak of [`select`].
    pub(crate) const BYTES: usize = {
        let level = size_of::<[f64; 5]>() + 8;
        let own = 1 + 24 + 4 * 8;
        // The finest level, two more, the sums along rows of one, variances, errors, biases and marks, steps and flags.
        3 * level + size_of::<[f64; 5]>() + 25 + size_of::<Step>() + 17 + 8 + own
    };

    fn new(level: &Level) -> Self {
        let pixels = level.means.len();
        Self {
            scales: vec![0; pixels],
            means: level.means.iter().map(|[r, g, b, ..]| [*r, *g, *b]).collect(),
            errors: level.variances.clone(),
            biases: vec![0.0; pixels],
            variances: level.variances.clone(),
            samples: level.means.iter().map(|mean| mean[4]).collect(),
        }
    }

    fn take(&mut self, i: usize, level: &Level, step: usize, [error, bias]: [f64; 2]) {
        let [r, g, b, ..] = level.means[i];
        self.scales[i] = step as u8 + 1;
        self.means[i] = [r, g, b];
        self.errors[i] = error;
        self.biases[i] = bias;
        self.variances[i] = level.variances[i];
        self.samples[i] = level.samples(i);
    }
}

/// Selects each pixel's scale. A pixel goes from scale to scale until the first step that is flagged.
///
/// If nothing is known of the noise, as in an image of one sample, no scale is selected.
pub(crate) fn select(film: &Film, bank: &Bank, gamma: f64) -> Selection {
    let size = film.frame().size().map(|n| n as usize);
    let variances = variances_of_means(film);
    let finest = Level::finest(film, &variances);
    let mut selection = Selection::new(&finest);
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
        let pixels = (0..errors.len()).into_par_iter().with_min_len(1024);
        let steps: Vec<Step> = pixels.map(|i| compare(fine, &coarse, beta, strictness, i)).collect();
        let flags: Vec<[f64; 1]> = steps.iter().map(|step| [step.flag]).collect();
        let stops = smoothed(size, bank.smoothing * sigma, &flags);
        let noise = bank.only_removes.then(|| variances_of_differences(size, fine, &coarse, &variances));
        for (i, Step { flag, loss, gain }) in steps.into_iter().enumerate() {
            let bias = noise.as_ref().map_or(0.0, |noise| loss - beta * noise[i]);
            let [error, squared_bias] = errors[i];
            let is_new = fine.is_empty(i);
            errors[i] = if is_new { [coarse.variances[i], 0.0] } else { [error + loss - gain, squared_bias + bias] };
            let stops = stops[i] && (!bank.only_removes || flag > 0.0) && !is_new;
            open[i] &= !stops;
            if open[i] {
                selection.take(i, &coarse, step, errors[i]);
            }
        }
        last = Some(coarse);
    }
    selection
}

#[cfg(test)]
mod tests;
