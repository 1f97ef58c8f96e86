//! The hashing of the crate, compiled into this program: keys, permutations and unit numbers.

use crate::keys::{Seed, mix64, permute, unit};
use crate::support::id;
/// Flipping any bit of (seed, pixel, stream, block, batch) flips each bit of the key with probability 1/2.
///
/// 256 input bits x 64 output bits over 4096 fixed inputs. The bound of 6 standard errors has a false alarm rate of
/// 2e-9 each, 3e-5 in all.
#[test]
fn every_input_bit_reaches_every_key_bit() {
    let trials = 4096;
    let key = |w: [u64; 4]| {
        let s = id([w[1] as u32, (w[1] >> 32) as u32], w[2] as u32, 0);
        Seed::new(w[0]).key(&s, (w[2] >> 32) as u32, w[3])
    };
    let mut worst = 0.0_f64;
    for word in 0..4 {
        for bit in 0..64 {
            let mut flips = [0_u32; 64];
            for t in 0..trials {
                // Small numbers, as pixels, streams and blocks are in practice.
                let mut w = [t, (t % 61) | ((t / 61) << 32), (t % 7) | ((t % 11) << 32), t % 3];
                let before = key(w);
                w[word] ^= 1 << bit;
                let changed = before ^ key(w);
                for (k, f) in flips.iter_mut().enumerate() {
                    *f += (changed >> k & 1) as u32;
                }
            }
            for f in flips {
                let z = (f64::from(f) - 0.5 * trials as f64) / (0.25 * trials as f64).sqrt();
                worst = worst.max(z.abs());
            }
        }
    }
    assert!(worst < 6.0, "an output bit follows an input bit: {worst} standard errors");
}

/// No two of 2^21 samples with small coordinates share a key. One collision is expected in 2^23 such tests.
#[test]
fn small_names_have_different_keys() {
    let mut keys = Vec::new();
    for seed in 0..4 {
        for x in 0..64 {
            for y in 0..64 {
                for stream in 0..4 {
                    for block in 0..32 {
                        keys.push(Seed::new(seed).key(&id([x, y], stream, 0), block, 0));
                    }
                }
            }
        }
    }
    let all = keys.len();
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), all);
}

#[test]
fn permutations_are_bijections() {
    for n in (1..70).chain([100, 128, 1000, 1024, 4096]) {
        for k in 0..20 {
            let mut seen = vec![false; n as usize];
            for i in 0..n {
                let to = permute(i, n, mix64(k));
                assert!(!std::mem::replace(&mut seen[to as usize], true), "n = {n}, key {k}");
            }
        }
    }
}

/// Each number is moved to each position equally often, and so is each pair of neighbours. Chi-square over 64 and over 240
/// cells, 250,000 fixed keys, bound at 6 standard deviations.
#[test]
fn permutations_are_uniform() {
    for n in [8_usize, 16] {
        let draws = 250_000;
        let mut single = vec![0_u32; n * n];
        let mut pairs = vec![0_u32; n * n];
        for k in 0..draws {
            let key = mix64(k * 3 + 1);
            for i in 0..n {
                single[i * n + permute(i as u32, n as u32, key) as usize] += 1;
            }
            let (a, b) = (permute(2, n as u32, key) as usize, permute(3, n as u32, key) as usize);
            pairs[a * n + b] += 1;
        }
        let chi2 = |cells: &mut dyn Iterator<Item = u32>, expected: f64| -> f64 {
            cells.map(|c| (f64::from(c) - expected).powi(2) / expected).sum()
        };
        let s = chi2(&mut single.iter().copied(), draws as f64 / n as f64);
        let dof = ((n - 1) * (n - 1)) as f64;
        assert!(s < dof + 6.0 * (2.0 * dof).sqrt() * 1.2, "n = {n}: chi2 {s} with {dof} degrees of freedom");
        let off = (0..n * n).filter(|c| c / n != c % n).map(|c| pairs[c]);
        let p = chi2(&mut off.into_iter(), draws as f64 / (n * (n - 1)) as f64);
        let dof = (n * (n - 1) - 1) as f64;
        assert!(p < dof + 6.0 * (2.0 * dof).sqrt(), "n = {n}: pairs' chi2 {p} with {dof} degrees of freedom");
    }
}

#[test]
fn all_ones_stay_below_one_s01() {
    assert_eq!(unit(u32::MAX), 1.0 - 1.0 / 16_777_216.0);
    assert_eq!(unit(0), 0.0);
    for n in 1..=1_u32 << 24 {
        assert_eq!((unit(u32::MAX) * n as f32) as u32, n - 1, "an index beyond {n} choices");
    }
}
