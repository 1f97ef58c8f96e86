//! Steps in the order of their gain, and the division of the last samples among them.

use super::{Demand, Steps, mix};
use crate::own_rows::unreadable;
use crate::snapshot::bytes::{Reader, Writer};
use crate::{Error, OwnRows};
use std::cmp::{Ordering, Reverse};

/// A step of a pixel: from `count` to the next count.
#[derive(Clone, Copy)]
pub(super) struct Waiting {
    /// The error decrease per sample, above 0.
    pub(super) gain: f64,
    pub(super) count: u32,
    // 32 bits keep the struct at 16 bytes: if many scores are equal, many pixels wait.
    /// The pixel's index in the window.
    pub(super) pixel: u32,
}

/// The place of a step in the order: larger gains first, then smaller counts, then a hash of the pixel's index. Words of
/// 32 bits, of which the smallest comes first.
type Key = [u32; 5];

/// The bits of a digit of a key.
const DIGIT: u32 = 11;
/// The number of digits of a word.
const DIGITS: u32 = 32_u32.div_ceil(DIGIT);
/// The number of steps that processes send each other one by one.
const FEW: u64 = 2048;

impl Waiting {
    fn key(&self) -> Key {
        // The bits of a positive float have the float's order.
        let (gain, hash) = (!self.gain.to_bits(), mix(self.pixel.into()));
        [(gain >> 32) as u32, gain as u32, self.count, (hash >> 32) as u32, hash as u32]
    }
}

/// Digit `number` of a key, from the first.
fn digit(key: &Key, number: u32) -> usize {
    let word = key[(number / DIGITS) as usize];
    let shift = 32_u32.saturating_sub(DIGIT * (number % DIGITS + 1));
    let bits = (32 - DIGIT * (number % DIGITS)).min(DIGIT);
    ((word >> shift) & ((1 << bits) - 1)) as usize
}

/// All steps from the present counts whose error decrease per sample is at least `threshold`.
pub(super) fn steps_above(
    threshold: f64,
    counts: &[u32],
    demand: &Demand<'_>,
    steps: &impl Steps,
    part: &OwnRows<'_>,
) -> Vec<Waiting> {
    let mut waiting = Vec::new();
    for (k, (&n, &score)) in counts.iter().zip(demand.scores).enumerate() {
        // Rounding must not hide a step, so the quick test is a little lower.
        if threshold > 0.0 && steps.reach(threshold * (1.0 - 1e-9) / score) <= n {
            continue;
        }
        let mut count = n;
        while count < demand.ceiling {
            let next = steps.next(count);
            let gain = score * steps.gain(count, next);
            if gain < threshold {
                break;
            }
            waiting.push(Waiting { gain, count, pixel: part.pixel(k) as u32 });
            count = next;
        }
    }
    waiting
}

/// Raises pixels by everyone's `waiting` steps in their order, until none of the `left` samples remains. Returns the
/// samples left over. A step from a count goes to `end` of it; the last one may end before.
pub(super) fn hand_out(
    waiting: Vec<Waiting>,
    counts: &mut [u32],
    left: u64,
    end: impl Fn(u32) -> u32,
    part: &mut OwnRows<'_>,
) -> Result<u64, Error> {
    let width = |step: &Waiting| u64::from(end(step.count) - step.count);
    let [all] = part.sums([waiting.iter().map(width).sum()])?;
    let last = if all <= left { None } else { Some(last_step(&waiting, left, width, part)?) };
    for step in waiting {
        let samples = match last.map(|(key, samples)| (step.key().cmp(&key), samples)) {
            None | Some((Ordering::Less, _)) => width(&step) as u32,
            Some((Ordering::Equal, samples)) => samples,
            Some((Ordering::Greater, _)) => continue,
        };
        let count = &mut counts[part.position(step.pixel as usize)];
        *count = (*count).max(step.count + samples);
    }
    Ok(left.saturating_sub(all))
}

/// The last of everyone's steps that get one of `left` samples, and the number that it gets. Requires steps that take
/// more samples than are left, and one that is left.
///
/// Counts of the samples by digits of the keys narrow the steps down to few, which are gathered.
fn last_step(
    waiting: &[Waiting],
    mut left: u64,
    width: impl Fn(&Waiting) -> u64,
    part: &mut OwnRows<'_>,
) -> Result<(Key, u32), Error> {
    let mut open: Vec<&Waiting> = waiting.iter().collect();
    for number in 0..5 * DIGITS {
        if part.sums([open.len() as u64])?[0] <= FEW {
            break;
        }
        let mut samples = vec![0; 1 << DIGIT];
        open.iter().for_each(|step| samples[digit(&step.key(), number)] += width(step));
        part.add(&mut samples)?;
        let mut last = 0;
        while samples[last] < left {
            left -= samples[last];
            last += 1;
        }
        open.retain(|step| digit(&step.key(), number) == last);
    }
    let mut to = Writer::with_capacity(28 * open.len());
    for step in &open {
        to.number(step.key());
        to.number(width(step) as u32);
    }
    let mut few: Vec<(Key, u32)> = Vec::new();
    for (rank, bytes) in part.gather(to.finish())?.iter().enumerate() {
        let mut from = Reader::new(bytes);
        while !from.is_empty() {
            let take = |from: &mut Reader<'_>| Ok((from.number()?, from.number()?));
            few.push(take(&mut from).map_err(|e| unreadable(rank, &e))?);
        }
    }
    few.sort_unstable_by_key(|(key, _)| Reverse(*key));
    while let Some((key, samples)) = few.pop() {
        if left <= u64::from(samples) {
            return Ok((key, left as u32));
        }
        left -= u64::from(samples);
    }
    Err(Error::Exchange { what: "processes count different samples in the allocation".into() })
}
