//! Exact allocation of an integer budget in proportion to weights.

use super::{Allocation, Range, level};
use crate::{Error, parallel, point_set::mix};
use std::cmp::Ordering;

/// The binary logarithm of the number of units per sample. The budget of each pixel is an integer number of units, so that
/// sums do not depend on their order.
const QUANTUM_BITS: u32 = 20;
const QUANTA: f64 = (1u64 << QUANTUM_BITS) as f64;
/// The number of pixels per partial sum. The sum of 2048 shares below 2^52 units fits into 64 bits.
const CHUNK: usize = 2048;
/// The largest number of steps in [`find_factor`]'s search; about ten suffice if weights span a few decades.
const MOST_ROUNDS: u32 = 64;

/// Distributes `total` samples in proportion to `weights`: all of them, unless every pixel reaches the ceiling.
///
/// Pixel `p` gets `base + factor * weights[p]`, clamped to `floors[p]` and `ceiling` (a floor above the ceiling takes
/// precedence). The factor is the same for all pixels, and makes the counts sum to `total`. Fractions are rounded by the
/// largest-remainder method. Ties go to the larger weight, then by a hash of the pixel's index.
///
/// Counts are thus proportional to the input, for samplers that compute priorities. With
/// [`allocate`](crate::plan::allocate()), counts are proportional to the square roots of the input, the pixels' squared errors.
///
/// NaN and negative weights are replaced by 0, infinite ones by the largest finite weight ([`Allocation::replaced`]). A weight
/// below 1e-60 of the largest is treated as 0: the pixel gets more than `base` samples only if all pixels of larger weight are
/// at the ceiling. If `total` is too small for `base` samples in every pixel, counts are as equal as the floors allow.
///
/// ```
/// let counts = dapple_core::plan::share(&[1.0, 2.0, 3.0], 4, &[0; 3], 100, 72)?.counts;
/// assert_eq!(counts, [14, 24, 34]);
/// # Ok::<(), dapple_core::Error>(())
/// ```
///
/// # Errors
///
/// [`Error::BudgetTooSmall`] if the floors alone exceed `total`.
///
/// # Panics
///
/// If `weights` and `floors` differ in length.
pub fn share(weights: &[f64], base: u32, floors: &[u32], ceiling: u32, total: u64) -> Result<Allocation, Error> {
    assert_eq!(weights.len(), floors.len(), "one floor per weight");
    let sum_at_least = |n: u32| floors.iter().map(|&floor| u64::from(floor.max(n))).sum::<u64>();
    let needed = sum_at_least(0);
    if needed > total {
        return Err(Error::BudgetTooSmall { budget: total, needed, pixels: floors.len() });
    }
    let (range, replaced) = Range::of(weights);
    let weights = range.clean(weights);
    let most = sum_at_least(ceiling);
    if most <= total {
        let counts = floors.iter().map(|&n| n.max(ceiling)).collect();
        return Ok(Allocation { counts, unspent: total - most, replaced });
    }
    let base = base.min(ceiling);
    let lowest = sum_at_least(base);
    if lowest >= total {
        return Ok(Allocation { counts: level(floors, base, total), unspent: 0, replaced });
    }
    let (base, most) = (f64::from(base), f64::from(ceiling));
    let quanta = |weight: f64, floor: u32, factor: f64| -> u64 {
        // Adding 2^52 rounds a smaller number to an integer in the low bits.
        const INTEGERS: f64 = (1u64 << 52) as f64;
        let share = (base + factor * weight).min(most).max(f64::from(floor));
        (share * QUANTA + INTEGERS).to_bits() - INTEGERS.to_bits()
    };
    let spend = |factor: f64| -> u128 {
        let chunk = |number: usize| {
            let chunk = number * CHUNK..weights.len().min((number + 1) * CHUNK);
            let each = weights[chunk.clone()].iter().zip(&floors[chunk]);
            u128::from(each.map(|(&w, &f)| quanta(w, f, factor)).sum::<u64>())
        };
        parallel::sum(weights.len().div_ceil(CHUNK), &chunk)
    };
    // The factor without any bound. Integers are summed, so the order does not matter.
    let sum: u128 = weights.iter().map(|w| u128::from((w * (1u64 << 40) as f64) as u64)).sum();
    let first = (total - lowest) as f64 / (sum.max(1) as f64 / (1u64 << 40) as f64);
    let factor = find_factor(first, u128::from(total) << QUANTUM_BITS, weights.len() as u128, spend);

    let shares: Vec<u64> = weights.iter().zip(floors).map(|(&w, &f)| quanta(w, f, factor)).collect();
    let mut counts: Vec<u32> = shares.iter().map(|s| (s >> QUANTUM_BITS) as u32).collect();
    let left = total - counts.iter().map(|&n| u64::from(n)).sum::<u64>();
    let open = counts.iter().filter(|n| **n < ceiling).count();
    if left > open as u64 {
        // If weights differ by tens of decades, the search stops far from its goal.
        return Ok(Allocation { counts: level(&counts, ceiling, total), unspent: 0, replaced });
    }
    hand_out_remainders(&shares, &weights, &mut counts, ceiling, left as usize);
    Ok(Allocation { counts, unspent: 0, replaced })
}

/// Returns approximately the largest factor for which `spend(factor)` does not exceed `goal`.
///
/// The search starts at `first` and ends within `close` units below `goal`, unless `spend` jumps by more. `spend` must grow
/// with the factor.
fn find_factor(first: f64, goal: u128, close: u128, spend: impl Fn(f64) -> u128) -> f64 {
    let (mut low, mut missing) = (0.0, 0.0);
    let (mut high, mut excess) = (f64::INFINITY, 0.0);
    let mut guess = first;
    let (mut stride, mut last_low) = (0, None);
    for round in 0..MOST_ROUNDS {
        let spent = spend(guess);
        if spent <= goal {
            // Illinois variant: an end that stays twice counts half.
            if last_low == Some(true) {
                excess *= 0.5;
            }
            (low, missing, last_low) = (guess, (goal - spent) as f64, Some(true));
            if goal - spent <= close {
                break;
            }
        } else {
            if last_low == Some(false) {
                missing *= 0.5;
            }
            (high, excess, last_low) = (guess, (spent - goal) as f64, Some(false));
        }
        // Outwards in steps of doubling exponents, inwards by halving exponents, then regula falsi with bisection every
        // eighth round.
        guess = if high == f64::INFINITY || low == 0.0 {
            let step = (1u64 << (1u32 << stride).min(63)) as f64;
            stride = (stride + 1).min(5);
            if low == 0.0 { high / step } else { low * step }
        } else if high > 4.0 * low {
            low.sqrt() * high.sqrt()
        } else if round % 8 == 7 {
            low + (high - low) * 0.5
        } else {
            low + (high - low) * (missing / (missing + excess)).clamp(1e-3, 1.0 - 1e-3)
        };
        if guess <= low || guess >= high {
            break;
        }
    }
    low
}

/// Adds one sample to each of the `left` pixels with the largest fractional shares, among those below the ceiling. Ties
/// go to the larger weight, then by a hash of the pixel's index.
fn hand_out_remainders(shares: &[u64], weights: &[f64], counts: &mut [u32], ceiling: u32, mut left: usize) {
    if left == 0 {
        return;
    }
    let bucket = |share: u64| (share >> (QUANTUM_BITS - 10)) as usize & 1023;
    let remainder = |share: u64| share & ((1 << QUANTUM_BITS) - 1);
    // All pixels above some bucket of remainders get one. Only those in the bucket are compared.
    let mut open = [0usize; 1024];
    counts.iter().zip(shares).filter(|(n, _)| **n < ceiling).for_each(|(_, &s)| open[bucket(s)] += 1);
    let mut last = 1023;
    while last > 0 && open[last] <= left {
        left -= open[last];
        last -= 1;
    }
    let mut tied = Vec::new();
    for (pixel, (count, &share)) in counts.iter_mut().zip(shares).enumerate().filter(|(_, (n, _))| **n < ceiling) {
        match bucket(share).cmp(&last) {
            Ordering::Greater => *count += 1,
            Ordering::Equal => tied.push((remainder(share), pixel)),
            Ordering::Less => {}
        }
    }
    if left < tied.len() {
        tied.select_nth_unstable_by(left, |&(a, p), &(b, q)| {
            let by_weight = || weights[q].total_cmp(&weights[p]);
            b.cmp(&a).then_with(by_weight).then_with(|| mix(q as u64).cmp(&mix(p as u64)))
        });
    }
    tied.iter().take(left).for_each(|&(_, pixel)| counts[pixel] += 1);
}
