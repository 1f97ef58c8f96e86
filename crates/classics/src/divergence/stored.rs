//! Scores of a pixel's first samples, which are recorded one by one.

use super::scores::{positive, weighted};
use crate::recorders::Singles;
use dapple_core::{Error, Film};
use std::f64::consts::LN_2;

/// The largest number of samples of a pixel that a score reads.
const MOST: u32 = 8;

/// The samples that scores read, for a pilot of `pilot` samples per pixel.
pub(super) fn reads(pilot: u32) -> Singles {
    Singles::first(pilot.min(MOST))
}

/// The score of each pixel's first samples, for a pilot of `pilot` samples per pixel. `of_channel` returns that of one
/// channel's samples.
///
/// In a film with halves, each half has half of these samples. Further recorded samples are not read.
pub(super) fn scores(film: &Film, pilot: u32, of_channel: impl Fn(&[f64]) -> f64) -> Result<Vec<f64>, Error> {
    let recorded = reads(pilot).of(film, "divergence")?;
    let most = pilot.min(MOST) as usize;
    let shares = if film.needs().halves { [most.div_ceil(2), most / 2] } else { [most, 0] };
    let mut samples = Vec::with_capacity(most);
    let score = |i: usize| {
        weighted(|c| {
            samples.clear();
            for (half, share) in shares.into_iter().enumerate() {
                samples.extend(recorded.of_half(half, i).take(share).map(|(x, _)| f64::from(x[c])));
            }
            of_channel(&samples)
        })
    };
    Ok((0..film.frame().pixels()).map(score).collect())
}

/// The mean of samples; `None` without light or with fewer than two samples.
fn mean(samples: &[f64]) -> Option<f64> {
    // A quotient, so that equal samples have no deviation by rounding.
    let mean = samples.iter().sum::<f64>() / samples.len() as f64;
    (samples.len() >= 2 && mean > 0.0).then_some(mean)
}

/// The fuzzy entropy of the samples' memberships in their mean, times their standard deviation.
pub(super) fn fuzzy(samples: &[f64], k: f64) -> f64 {
    let Some(mean) = mean(samples) else { return 0.0 };
    let deviations = samples.iter().map(|x| (x - mean).abs());
    let squares = deviations.clone().map(|d| d * d).sum::<f64>();
    let memberships = deviations.map(|d| k * mean / (k * mean + d));
    positive(fuzzy_entropy(memberships)) * (squares / (samples.len() - 1) as f64).sqrt()
}

/// The mean entropy of memberships in `[0, 1]`, in bits [De Luca and Termini 1972].
fn fuzzy_entropy(memberships: impl Iterator<Item = f64>) -> f64 {
    let times_log = |m: f64| if m > 0.0 { m * libm::log(m) } else { 0.0 };
    let (mut count, mut sum) = (0.0, 0.0);
    for m in memberships {
        count += 1.0;
        sum -= times_log(m) + times_log(1.0 - m);
    }
    sum / (count * LN_2)
}

/// The mean over the number of samples, times `D^a` of the generalised Hellinger divergence `D` with the exponent `a`.
pub(super) fn generalised_hellinger(samples: &[f64], a: f64) -> f64 {
    mean(samples).map_or(0.0, |mean| mean / samples.len() as f64 * power_of_divergence(samples, a))
}

/// `D^a` of the divergence `D = sum |p^a - (1/n)^a|^(1/a) / 2` between the samples' shares `p` in their sum and equal ones.
///
/// The largest difference is taken out of the sum, so that no power underflows.
fn power_of_divergence(samples: &[f64], a: f64) -> f64 {
    let (sum, equal) = (samples.iter().sum::<f64>(), libm::pow(1.0 / samples.len() as f64, a));
    let differences = samples.iter().map(|x| (libm::pow(x / sum, a) - equal).abs());
    let largest = positive(differences.clone().fold(0.0, f64::max));
    if largest == 0.0 {
        return 0.0;
    }
    let relative: f64 = differences.map(|d| libm::pow(d / largest, 1.0 / a)).sum();
    largest * libm::pow(0.5 * relative, a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::frame;
    use dapple_core::Needs;

    #[track_caller]
    fn close(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{found}, not {expected}");
    }

    #[test]
    fn samples_at_a_membership_of_one_half_have_an_entropy_of_one_bit() {
        // The mean is 1, and all samples deviate by 1.
        close(fuzzy(&[0.0, 2.0, 0.0, 2.0], 1.0), (4.0f64 / 3.0).sqrt());
        // The mean is 2: two samples deviate by 2, two are the mean.
        close(fuzzy(&[0.0, 4.0, 2.0, 2.0], 1.0), 0.5 * (8.0f64 / 3.0).sqrt());
        // A membership of 3/4.
        let entropy = -(0.75f64.log2() * 0.75 + 0.25f64.log2() * 0.25);
        close(fuzzy(&[0.0, 2.0], 3.0), entropy * 2.0f64.sqrt());
    }

    #[test]
    fn fuzzy_scores_scale_with_the_samples() {
        let (once, scaled) = ([0.25, 1.5, 0.0, 3.0], [16.0, 96.0, 0.0, 192.0]);
        close(fuzzy(&scaled, 1.0), 64.0 * fuzzy(&once, 1.0));
        assert!(fuzzy(&once, 1.0) > 0.5, "{}", fuzzy(&once, 1.0));
    }

    /// Black samples, single ones and equal ones.
    fn without_contrast() -> Vec<Vec<f64>> {
        let equal = (2..=8).flat_map(|n| [0.1f32, 0.7, 1e20, f32::MAX].map(|x| vec![f64::from(x); n]));
        [vec![], vec![3.0], vec![0.0], vec![0.0; 8]].into_iter().chain(equal).collect()
    }

    #[test]
    fn constant_black_and_single_samples_have_a_fuzzy_score_of_zero() {
        for samples in without_contrast() {
            [0.001, 1.0, 1000.0].into_iter().for_each(|k| assert_eq!(fuzzy(&samples, k), 0.0, "{samples:?}, {k}"));
        }
        for samples in [&[f64::from(f32::MAX), 0.0][..], &[1e-45, 0.0, 0.0]] {
            assert!([0.001, 1.0, 1000.0].into_iter().all(|k| (0.0..1e39).contains(&fuzzy(samples, k))));
        }
    }

    const EXPONENTS: [f64; 6] = [1e-9, 0.01, 0.25, 0.5, 0.75, 1.0];

    #[test]
    fn an_exponent_of_one_half_is_hellinger_and_one_is_total_variation() {
        for samples in [&[0.25, 1.5, 0.0, 3.0, 0.75][..], &[2.0, 2.5], &[1.0, 0.0, 0.0, 8.0]] {
            let (n, sum) = (samples.len() as f64, samples.iter().sum::<f64>());
            let roots: f64 = samples.iter().map(|x| x.sqrt()).sum();
            let hellinger = 1.0 - roots / (n * sum).sqrt();
            close(power_of_divergence(samples, 0.5).powi(2), hellinger);
            close(generalised_hellinger(samples, 0.5), sum / (n * n) * hellinger.sqrt());
            let variation = samples.iter().map(|x| (x / sum - 1.0 / n).abs()).sum::<f64>() / 2.0;
            close(power_of_divergence(samples, 1.0), variation);
            close(power_of_divergence(samples, 0.25).powi(4), divergence(samples, 0.25));
            close(power_of_divergence(samples, 0.75).powf(4.0 / 3.0), divergence(samples, 0.75));
        }
    }

    /// The definition.
    fn divergence(samples: &[f64], a: f64) -> f64 {
        let (n, sum) = (samples.len() as f64, samples.iter().sum::<f64>());
        let term = |x: &f64| ((x / sum).powf(a) - (1.0 / n).powf(a)).abs().powf(1.0 / a);
        samples.iter().map(term).sum::<f64>() / 2.0
    }

    /// One share is 1, the others are 0.
    #[test]
    fn one_sample_with_light_has_the_divergence_of_the_closed_form() {
        for (n, a) in [2usize, 3, 8].into_iter().flat_map(|n| EXPONENTS.map(|a| (n, a))).filter(|(_, a)| *a >= 0.25) {
            let mut samples = vec![0.0; n];
            samples[n / 2] = 0.5;
            let n = n as f64;
            let expected = ((1.0 - n.powf(-a)).powf(1.0 / a) + (n - 1.0) / n) / 2.0;
            close(power_of_divergence(&samples, a).powf(1.0 / a), expected);
        }
    }

    #[test]
    fn constant_black_and_single_samples_have_a_generalised_divergence_of_zero() {
        for samples in without_contrast() {
            EXPONENTS.into_iter().for_each(|a| assert_eq!(generalised_hellinger(&samples, a), 0.0, "{samples:?}, {a}"));
        }
        // Powers that underflow without their common factor.
        for samples in [&[1.0, 2.0][..], &[f64::from(f32::MAX), 0.0], &[1e-45, 0.0, 0.0]] {
            assert!(EXPONENTS.into_iter().all(|a| (1e-12..=1.0).contains(&power_of_divergence(samples, a))));
        }
    }

    #[test]
    fn scores_read_the_first_samples_of_all_halves_and_no_more() {
        let values: Vec<f32> = (0..24).map(|k| 1.0 + (k * k % 7) as f32).collect();
        let film = |needs: Needs, pilot: u32, taken: usize| {
            let mut film = Film::with_recorders(frame(1, 1), needs, reads(pilot).list());
            let half = |k: usize| if needs.halves { k % 2 } else { 0 };
            (0..taken).for_each(|k| film.push(0, half(k), [0.0, values[k], 0.0]));
            film
        };
        let sum = |film: &Film, pilot| scores(film, pilot, |x| x.iter().sum()).unwrap()[0] / 0.715;
        let expected = |n: usize| values[..n].iter().map(|&x| f64::from(x)).sum::<f64>();
        for (pilot, read) in [(8, 8), (5, 5), (20, 8)] {
            assert_eq!(reads(pilot), Singles::first(read as u32));
            for needs in [Needs::none(), Needs::none().with_halves()] {
                [read, 24].into_iter().for_each(|taken| close(sum(&film(needs, pilot, taken), pilot), expected(read)));
            }
        }
        close(sum(&film(Needs::none(), 8, 3), 8), expected(3));
    }
}
