//! Divergence scores from streaming sums, or from a pixel's recorded first samples.

use crate::recorders::{SampleSums, Singles};
use dapple_core::{Error, Film};
use std::f64::consts::LN_2;

/// The score by which [`Divergence`](super::Divergence) ranks pixels.
///
/// `p_i = x_i / sum x` are the fractions of the `n` samples of one channel, and `mean` is the samples' mean. A divergence `D`
/// gives the score `mean D / n` [after Rigau 2003; the factor is quoted from memory]. An entropy `H` has the contrast `C = 1 -
/// H / H_max`, in `[0, 1]`, and gives the score `mean C`. Channels are weighted by 0.213, 0.715 and 0.072.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DivergenceScore {
    /// The Kullback-Leibler divergence `D = sum p ln(p n) = ln n - H(p)`.
    Kl,
    /// The chi-square divergence `D = n sum p^2 - 1`, the population variance over the squared mean.
    Chi2,
    /// The square root of the Hellinger divergence `1 - sum sqrt(p / n)`.
    #[default]
    Hellinger,
    /// The contrast `C = 1 - H(p) / ln n` of Shannon's entropy [Rigau 2003, GI].
    Entropy,
    /// The contrast of the entropy of the pilot's first hits, without the factor `mean`.
    ///
    /// Hits are weighted by `cos(theta) / d^2`, where `d` is the distance of the surface and `theta` the angle between its
    /// normal and the ray.
    Geometric,
    /// The contrast of the Tsallis entropy `(1 - sum p^q) / (q - 1)`, relative to its largest value.
    Tsallis,
    /// The fuzzy entropy `H` of the pilot's samples, times their standard deviation [after Xu 2008].
    ///
    /// A sample's membership in the mean is `m = 1 / (1 + |x - mean| / (k mean))`. `H` is the mean over the samples of `-m log2
    /// m - (1 - m) log2 (1 - m)` [De Luca and Termini 1972]. The paper of Xu et al. was not available: memberships and factor
    /// are not from it.
    Fuzzy,
    /// A generalised Hellinger divergence `D` of the pilot's samples, as `mean D^a / n` [after Cui 2009].
    ///
    /// `D = sum |p^a - (1/n)^a|^(1/a) / 2`. With `a = 1/2` this is Hellinger's divergence, with `a = 1` the total variation.
    /// Cui's paper was not available: the formula is a guess.
    Gh,
}

dapple_core::choices!(DivergenceScore {
    Kl = "kl",
    Chi2 = "chi2",
    Hellinger = "hellinger",
    Entropy = "entropy",
    Geometric = "geometric",
    Tsallis = "tsallis",
    Fuzzy = "fuzzy",
    Gh = "gh",
});

/// The weights of the channels in a pixel's score [Rigau 2003, GI].
const WEIGHTS: [f64; 3] = [0.213, 0.715, 0.072];

/// The largest divergence that counts as 0: the rounding error of equal samples.
const ROUNDING: f64 = 1e-12;

/// The streaming sums that a score needs; `None` if film moments or single samples suffice.
pub(super) fn sums(by: DivergenceScore, q: f64) -> Option<SampleSums> {
    match by {
        DivergenceScore::Kl | DivergenceScore::Entropy => Some(SampleSums::Logs),
        DivergenceScore::Hellinger => Some(SampleSums::Roots),
        DivergenceScore::Tsallis if q == 1.0 => Some(SampleSums::Logs),
        DivergenceScore::Tsallis if q < 1.0 => Some(SampleSums::Roots),
        _ => None,
    }
}

/// Sums over the samples of one channel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ChannelSums {
    pub(super) count: f64,
    pub(super) mean: f64,
    /// The sum of squared deviations from the mean.
    pub(super) deviations: f64,
    /// The sum of `x ln x`.
    pub(super) log: f64,
    /// The sum of `sqrt x`.
    pub(super) root: f64,
}

impl ChannelSums {
    fn sum(&self) -> f64 {
        self.count * self.mean
    }

    pub(super) fn kl(&self) -> f64 {
        positive(self.log / self.sum() - libm::log(self.mean))
    }

    pub(super) fn chi2(&self) -> f64 {
        positive(self.deviations / self.count / self.mean / self.mean)
    }

    pub(super) fn hellinger(&self) -> f64 {
        positive(1.0 - self.root / (self.count * self.mean.sqrt()))
    }

    /// The contrast `1 - H / ln n` of Shannon's entropy.
    pub(super) fn entropy(&self) -> f64 {
        positive(self.kl() / libm::log(self.count))
    }

    /// The contrast of the Tsallis entropy with index 0.5, 1 or 2.
    pub(super) fn tsallis(&self, q: f64) -> f64 {
        if q == 1.0 {
            self.entropy()
        } else if q < 1.0 {
            // The sum of sqrt p, from 1 to sqrt n.
            let roots = self.root / self.sum().sqrt();
            positive(1.0 - (roots - 1.0) / (self.count.sqrt() - 1.0))
        } else {
            // The sum of p^2 is (1 + chi2) / n.
            let squares = (1.0 + self.chi2()) / self.count;
            positive(1.0 - (1.0 - squares) / (1.0 - 1.0 / self.count))
        }
    }
}

/// Replaces negative values (rounding errors) and NaN by 0.
pub(super) fn positive(divergence: f64) -> f64 {
    if divergence > ROUNDING { divergence } else { 0.0 }
}

/// The score of each pixel from sums over its samples; 0 for pixels without light or with fewer than two samples.
pub(super) fn of_sums(by: DivergenceScore, q: f64, film: &Film) -> Result<Vec<f64>, Error> {
    let kind = sums(by, q);
    let sums = kind.map(|kind| kind.of(film, "divergence")).transpose()?;
    let score = |i: usize| {
        let (moments, sum) = (film.moments(i), sums.map_or([0.0; 3], |sums| sums.sum(i)));
        weighted(|c| {
            let (count, mean, deviations) = (moments.count as f64, moments.mean[c], moments.m2[c]);
            let (log, root) = if kind == Some(SampleSums::Logs) { (sum[c], 0.0) } else { (0.0, sum[c]) };
            of_channel(by, q, &ChannelSums { count, mean, deviations, log, root })
        })
    };
    Ok((0..film.frame().pixels()).map(score).collect())
}

/// The weighted mean of the channels' scores.
pub(super) fn weighted(mut of_channel: impl FnMut(usize) -> f64) -> f64 {
    (0..3).map(|c| WEIGHTS[c] * of_channel(c)).sum::<f64>() / WEIGHTS.iter().sum::<f64>()
}

fn of_channel(by: DivergenceScore, q: f64, sums: &ChannelSums) -> f64 {
    if sums.count < 2.0 || sums.mean <= 0.0 {
        return 0.0;
    }
    let share = sums.mean / sums.count;
    match by {
        DivergenceScore::Kl => share * sums.kl(),
        DivergenceScore::Chi2 => share * sums.chi2(),
        DivergenceScore::Hellinger => share * sums.hellinger().sqrt(),
        DivergenceScore::Entropy => sums.mean * sums.entropy(),
        DivergenceScore::Tsallis => sums.mean * sums.tsallis(q),
        DivergenceScore::Geometric | DivergenceScore::Fuzzy | DivergenceScore::Gh => 0.0,
    }
}

/// The score of each pixel from its first samples: as many as the pilot has per pixel (`pilot`), but at most 8. `of_channel`
/// returns the score of one channel's samples.
///
/// In a film with halves, each half has half of these samples. Further recorded samples are not read.
pub(super) fn of_samples(film: &Film, pilot: u32, of_channel: impl Fn(&[f64]) -> f64) -> Result<Vec<f64>, Error> {
    let recorded = Singles::First.of(film, "divergence")?;
    let most = Singles::FIRST.min(pilot as usize);
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

/// The mean of the samples; `None` without light or with fewer than two samples.
fn mean(samples: &[f64]) -> Option<f64> {
    // A division, so that equal samples have no deviation by rounding.
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

/// The generalised Hellinger divergence `D` with exponent `a`, as `D^a` times the mean over the number of samples.
pub(super) fn generalised_hellinger(samples: &[f64], a: f64) -> f64 {
    mean(samples).map_or(0.0, |mean| mean / samples.len() as f64 * power_of_divergence(samples, a))
}

/// `D^a` of the divergence `D = sum |p^a - (1/n)^a|^(1/a) / 2` between the samples' fractions `p` of their sum and equal
/// fractions.
///
/// The largest difference is factored out of the sum, so that no power underflows.
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
