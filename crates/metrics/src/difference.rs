//! The difference of two images, each known only by noisy renders.

use crate::compare::RELATIVE_EPSILON;
use crate::sum::Sum;
use crate::{MetricsError, Pixels};

/// The fewest renders of each image that [`difference`] accepts: two for the numerator, two more for the denominator.
pub const LEAST_RENDERS: usize = 4;

/// An estimate from independent renders, with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The estimated value.
    pub value: f64,
    /// The standard error of `value` by the jackknife over n renders, with n - 1 degrees of freedom [after Tukey 1958].
    pub standard_error: f64,
}

/// The difference of two images without the noise of their renders, from [`difference`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Difference {
    /// Mean of `(b - a)^2 / (a^2 + 0.01)` over pixels and channels: relMSE of the noiseless `b` against the noiseless
    /// `a`. The numerator is unbiased, so the estimate can be below 0 if the images hardly differ.
    pub rel_mse: Measured,
    /// The fraction of the mean radiance of `a`, over all channels, that is missing in `b`; below 0 if `b` is brighter.
    pub mean_lost: Measured,
}

/// Estimates the difference of images `a` and `b` from independent renders of each.
///
/// Renders `a[i]` and `b[i]` may share a seed, which reduces the noise of their difference. `a[i]` and `a[j]` must not.
///
/// The square of `b - a` is estimated by `(b[s] - a[s]) (b[t] - a[t])`, averaged over all pairs of renders s and t.
/// Independent noise then cancels. The `a` of the denominator is the mean of the remaining renders. (If it included all
/// renders, numerator and denominator would share noise. At a difference of a tenth and noise of a quarter, the value
/// would be a fifth too small.) The nonlinear denominator leaves a bias: with a relative noise `s` of its mean, the
/// value is too large by about `3 s^2`. A non-finite channel counts as 0.
///
/// ```
/// # use dapple_metrics::{Pixels, difference};
/// let noisy = |value: f32| [-0.01, 0.01, 0.02, -0.02].map(|noise| vec![[value + noise; 3]; 16]);
/// let [a, b] = [noisy(0.5), noisy(0.4)];
/// # fn pixels(renders: &[Vec<[f32; 3]>]) -> Result<Vec<Pixels<'_>>, dapple_metrics::MetricsError> {
/// #     renders.iter().map(|render| Pixels::new([4, 4], render)).collect()
/// # }
/// let found = difference(&pixels(&a)?, &pixels(&b)?)?;
/// assert!((found.mean_lost.value - 0.2).abs() < 1e-6);
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
///
/// # Errors
/// [`MetricsError::FewRenders`] below [`LEAST_RENDERS`] or for different numbers of renders; [`MetricsError::Sizes`] if
/// any two renders differ in size.
pub fn difference(a: &[Pixels<'_>], b: &[Pixels<'_>]) -> Result<Difference, MetricsError> {
    let n = a.len();
    if n < LEAST_RENDERS || b.len() != n {
        return Err(MetricsError::FewRenders { renders: [n, b.len()] });
    }
    if let Some(other) = a.iter().chain(b).find(|p| p.size != a[0].size) {
        return Err(MetricsError::Sizes { image: other.size, reference: a[0].size });
    }
    let channels = 3 * a[0].values.len();
    let mut products = vec![Sum::default(); n * n];
    let (mut means_a, mut means_b) = (vec![Sum::default(); n], vec![Sum::default(); n]);
    let (mut known, mut apart) = (vec![0.0; n], vec![0.0; n]);
    for i in 0..channels {
        let value = |p: &Pixels<'_>| {
            let x = p.values[i / 3][i % 3];
            if x.is_finite() { f64::from(x) } else { 0.0 }
        };
        for k in 0..n {
            let (x, y) = (value(&a[k]), value(&b[k]));
            means_a[k].add(x);
            means_b[k].add(y);
            (known[k], apart[k]) = (x, y - x);
        }
        let sum: f64 = known.iter().sum();
        for (s, t) in pairs(n, n) {
            let mean = (sum - known[s] - known[t]) / (n - 2) as f64;
            products[s * n + t].add(apart[s] * apart[t] / (mean * mean + RELATIVE_EPSILON));
        }
    }
    let products: Vec<f64> = products.into_iter().map(|s| s.value() / channels as f64).collect();
    let rel_mse = |skip: usize| {
        let of: Vec<f64> = pairs(n, skip).map(|(s, t)| products[s * n + t]).collect();
        of.iter().sum::<f64>() / of.len() as f64
    };
    let rel_mse: Vec<f64> = (0..=n).map(rel_mse).collect();
    let [a, b] = [means_a, means_b].map(|means| means.into_iter().map(Sum::value).collect::<Vec<_>>());
    let lost = |skip: usize| {
        let of = |sums: &[f64]| sums.iter().enumerate().filter(|(k, _)| *k != skip).map(|(_, s)| s).sum::<f64>();
        let (a, b) = (of(&a), of(&b));
        if a == b { 0.0 } else { (a - b) / a.abs().max(1e-20) }
    };
    let mean_lost: Vec<f64> = (0..=n).map(lost).collect();
    Ok(Difference { rel_mse: jackknife(&rel_mse), mean_lost: jackknife(&mean_lost) })
}

/// All pairs of two numbers in `0..n` other than `skip`, each pair once.
fn pairs(n: usize, skip: usize) -> impl Iterator<Item = (usize, usize)> {
    let kept = move |k: &usize| *k != skip;
    (0..n).filter(kept).flat_map(move |s| (s + 1..n).filter(kept).map(move |t| (s, t)))
}

/// The jackknife estimate and its standard error [after Tukey 1958]. The last of `estimates` uses all renders; each of
/// the others leaves out one render.
fn jackknife(estimates: &[f64]) -> Measured {
    let (without, all) = (&estimates[..estimates.len() - 1], estimates[estimates.len() - 1]);
    let n = without.len() as f64;
    let mean = without.iter().sum::<f64>() / n;
    let squares: f64 = without.iter().map(|x| (x - mean).powi(2)).sum();
    Measured { value: all, standard_error: ((n - 1.0) / n * squares).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare;

    const SIZE: [u32; 2] = [16, 16];

    /// Uniform noise of mean 0 and variance `scale^2 / 12`, a hash of `counter`.
    fn noise(counter: u64, scale: f32) -> f32 {
        let mut x = counter.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x1234_5678_9ABC_DEF1;
        for shift in [30, 27, 31] {
            x = (x ^ (x >> shift)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        }
        ((x >> 40) as f32 / (1 << 24) as f32 - 0.5) * scale
    }

    /// `n` noisy renders of an image whose true value is `value` in every pixel.
    fn renders(value: f32, n: u64, seed: u64) -> Vec<Vec<[f32; 3]>> {
        let pixel = |r: u64, p: u64| [0, 1, 2].map(|c| value + noise(((seed * 100 + r) * 1000 + p) * 3 + c, 0.2));
        (0..n).map(|r| (0..256).map(|p| pixel(r, p)).collect()).collect()
    }

    fn of(a: &[Vec<[f32; 3]>], b: &[Vec<[f32; 3]>]) -> Difference {
        let [a, b]: [Vec<Pixels<'_>>; 2] = [a, b].map(|r| r.iter().map(|v| Pixels { size: SIZE, values: v }).collect());
        difference(&a, &b).expect("as many, of one size")
    }

    #[test]
    fn noise_cancels() {
        let truth = 0.1 * 0.1 / (0.5 * 0.5 + 0.01);
        let (mut inside, mut mean, runs) = (0, 0.0, 40);
        for seed in 0..runs {
            let found = of(&renders(0.5, 4, 2 * seed), &renders(0.4, 4, 2 * seed + 1)).rel_mse;
            mean += found.value / runs as f64;
            // Student's t for 95 % and 3 degrees of freedom.
            inside += u32::from((found.value - truth).abs() < 3.182 * found.standard_error);
        }
        // The denominator's noise has variance 1/12 0.2^2 / 2, which makes it 1.8 % too much.
        assert!((mean / truth - 1.018).abs() < 0.01, "{mean} {truth}");
        // 95 % of 40, and by chance never below 32 (p < 1e-3).
        assert!(inside >= 32, "{inside}");
        // The control: the plain relMSE contains the noise of both.
        let (a, b) = (&renders(0.5, 1, 0)[0], &renders(0.4, 1, 1)[0]);
        let plain = compare(Pixels { size: SIZE, values: b }, Pixels { size: SIZE, values: a }).expect("one size");
        assert!(plain.rel_mse > 1.3 * truth, "{}", plain.rel_mse);
    }

    #[test]
    fn equal_images_have_no_difference() {
        let (mut signs, mut inside) = (0, 0);
        for seed in 0..40 {
            let found = of(&renders(0.5, 4, 2 * seed), &renders(0.5, 4, 2 * seed + 1));
            signs += i32::from(found.rel_mse.value > 0.0);
            inside += u32::from(found.mean_lost.value.abs() < 3.182 * found.mean_lost.standard_error);
        }
        assert!((8..=32).contains(&signs) && inside >= 32, "{signs} {inside}");
        let same = renders(0.5, 4, 0);
        let none = Measured { value: 0.0, standard_error: 0.0 };
        assert_eq!(of(&same, &same), Difference { rel_mse: none, mean_lost: none });
    }

    #[test]
    fn mean_lost_is_a_share_of_the_mean() {
        let a = vec![vec![[2.0, 1.0, 1.0]; 256]; 4];
        let b = vec![vec![[2.0, 0.0, 1.0]; 256]; 4];
        let found = of(&a, &b);
        assert!((found.mean_lost.value - 0.25).abs() < 1e-12 && found.mean_lost.standard_error == 0.0);
        assert!((found.rel_mse.value - 1.0 / 1.01 / 3.0).abs() < 1e-12, "{found:?}");
        // A brighter image lost less than 0; a black one has nothing to lose.
        assert!((of(&b, &a).mean_lost.value + 1.0 / 3.0).abs() < 1e-12);
        let black = vec![vec![[0.0; 3]; 256]; 4];
        assert_eq!(of(&black, &black).mean_lost.value, 0.0);
        let broken = vec![vec![[f32::NAN, 1.0, f32::INFINITY]; 256]; 4];
        assert!((of(&a, &broken).mean_lost.value - 0.75).abs() < 1e-12);
    }

    #[test]
    fn too_few_renders_and_different_sizes_are_refused() {
        let values = vec![[0.0; 3]; 4];
        let square = Pixels::new([2, 2], &values).expect("four pixels");
        let line = Pixels::new([4, 1], &values).expect("four pixels");
        let few = |a: usize, b: usize| difference(&vec![square; a], &vec![square; b]).err();
        assert_eq!(few(3, 3), Some(MetricsError::FewRenders { renders: [3, 3] }));
        assert_eq!(few(4, 3), Some(MetricsError::FewRenders { renders: [4, 3] }));
        assert_eq!(few(4, 4), None);
        let unlike = difference(&[square; 4], &[square, square, line, square]).err();
        assert_eq!(unlike, Some(MetricsError::Sizes { image: [4, 1], reference: [2, 2] }));
    }
}
