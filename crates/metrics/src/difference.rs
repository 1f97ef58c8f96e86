//! How far apart two images are of which only noisy renders are known.

use crate::compare::RELATIVE_EPSILON;
use crate::sum::Sum;
use crate::{Error, Pixels};

/// Renders of each image that [`difference`] needs at least: a pair for the numerator, and two more for the
/// denominator.
pub const LEAST_RENDERS: usize = 4;

/// A figure estimated from independent renders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The estimate.
    pub value: f64,
    /// Its standard error, by the jackknife over renders: one degree of freedom less than there are renders.
    pub standard_error: f64,
}

/// How far two images are apart, beyond the noise of their renders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Mean of `(b - a)^2 / (a^2 + 0.01)` over pixels and channels, as relMSE but of the noiseless `a` and `b` in
    /// its numerator. Without bias there, and so below 0 by chance where the images hardly differ.
    pub rel_mse: Measured,
    /// Share of the mean radiance of `a`, all channels together, that `b` has less; below 0 where it has more.
    pub mean_lost: Measured,
}

/// How far `b` is from `a`, from independent renders of each: `a[i]` and `b[i]` may have a seed in common (which
/// takes noise out of their difference), `a[i]` and `a[j]` must not.
///
/// The square of `b - a` is taken as the product of two renders' differences, and the `a` of its denominator as the
/// mean of all other renders, averaged over all pairs of renders: the noise of each is independent, so that none
/// adds up. (With `a` from all renders, numerator and denominator share noise: at a tenth of difference and a
/// quarter of noise, a fifth of the figure was missing.) What is left is the curvature of the denominator: at a
/// relative noise `s` of that mean, a share of about `3 s^2` too much. A channel that is NaN or infinite counts
/// as 0.
///
/// # Errors
/// [`Error::FewRenders`] below [`LEAST_RENDERS`], or where there are not as many of both; [`Error::Sizes`] where
/// any two differ in size.
pub fn difference(a: &[Pixels<'_>], b: &[Pixels<'_>]) -> Result<Difference, Error> {
    let n = a.len();
    if n < LEAST_RENDERS || b.len() != n {
        return Err(Error::FewRenders { renders: [n, b.len()] });
    }
    if let Some(other) = a.iter().chain(b).find(|p| p.size != a[0].size) {
        return Err(Error::Sizes { image: other.size, reference: a[0].size });
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

/// All pairs of `n` renders, but for those with one of them.
fn pairs(n: usize, skip: usize) -> impl Iterator<Item = (usize, usize)> {
    let kept = move |k: &usize| *k != skip;
    (0..n).filter(kept).flat_map(move |s| (s + 1..n).filter(kept).map(move |t| (s, t)))
}

/// The estimate without each render, and last the one from all [after Tukey 1958].
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

    /// Uniform noise of mean 0 and variance 1/12 `scale^2`, by a hashed counter.
    fn noise(counter: u64, scale: f32) -> f32 {
        let mut x = counter.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x1234_5678_9ABC_DEF1;
        for shift in [30, 27, 31] {
            x = (x ^ (x >> shift)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        }
        ((x >> 40) as f32 / (1 << 24) as f32 - 0.5) * scale
    }

    /// Renders of an image that is `value` everywhere.
    fn renders(value: f32, n: u64, seed: u64) -> Vec<Vec<[f32; 3]>> {
        let pixel = |r: u64, p: u64| [0, 1, 2].map(|c| value + noise(((seed * 100 + r) * 1000 + p) * 3 + c, 0.2));
        (0..n).map(|r| (0..256).map(|p| pixel(r, p)).collect()).collect()
    }

    fn of(a: &[Vec<[f32; 3]>], b: &[Vec<[f32; 3]>]) -> Difference {
        let [a, b]: [Vec<Pixels<'_>>; 2] = [a, b].map(|r| r.iter().map(|v| Pixels { size: SIZE, values: v }).collect());
        difference(&a, &b).expect("as many, of one size")
    }

    #[test]
    fn noise_drops_out() {
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
        // The control: the plain figure has the noise of both in it.
        let (a, b) = (&renders(0.5, 1, 0)[0], &renders(0.4, 1, 1)[0]);
        let plain = compare(Pixels { size: SIZE, values: b }, Pixels { size: SIZE, values: a }).expect("one size");
        assert!(plain.rel_mse > 1.3 * truth, "{}", plain.rel_mse);
    }

    #[test]
    fn equal_images_differ_by_nothing() {
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
    fn what_is_lost_is_a_share() {
        let a = vec![vec![[2.0, 1.0, 1.0]; 256]; 4];
        let b = vec![vec![[2.0, 0.0, 1.0]; 256]; 4];
        let found = of(&a, &b);
        assert!((found.mean_lost.value - 0.25).abs() < 1e-12 && found.mean_lost.standard_error == 0.0);
        assert!((found.rel_mse.value - 1.0 / 1.01 / 3.0).abs() < 1e-12, "{found:?}");
        // More is less than nothing; nothing to lose is nothing lost.
        assert!((of(&b, &a).mean_lost.value + 1.0 / 3.0).abs() < 1e-12);
        let black = vec![vec![[0.0; 3]; 256]; 4];
        assert_eq!(of(&black, &black).mean_lost.value, 0.0);
        let broken = vec![vec![[f32::NAN, 1.0, f32::INFINITY]; 256]; 4];
        assert!((of(&a, &broken).mean_lost.value - 0.75).abs() < 1e-12);
    }

    #[test]
    fn too_few_or_unlike_are_refused() {
        let values = vec![[0.0; 3]; 4];
        let square = Pixels::new([2, 2], &values).expect("four pixels");
        let line = Pixels::new([4, 1], &values).expect("four pixels");
        let few = |a: usize, b: usize| difference(&vec![square; a], &vec![square; b]).err();
        assert_eq!(few(3, 3), Some(Error::FewRenders { renders: [3, 3] }));
        assert_eq!(few(4, 3), Some(Error::FewRenders { renders: [4, 3] }));
        assert_eq!(few(4, 4), None);
        let unlike = difference(&[square; 4], &[square, square, line, square]).err();
        assert_eq!(unlike, Some(Error::Sizes { image: [4, 1], reference: [2, 2] }));
    }
}
