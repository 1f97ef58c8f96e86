//! Hierarchical integration of pixels.

use crate::Domain;
use crate::tree::{At, Bounds, Cell, Division, Items, Leaf, Refinement, TreeSampler, mean, unit};
use dapple_core::{Error, PilotPolicy, luminance, mix};

dapple_core::options! {
    /// The parameters of [`Hierarchical`].
    pub struct HierarchicalOptions {
        /// Samples of a part from which it is split.
        pub split: u32 = 4, |n| (2..=64).contains(&n), "2 to 64 samples";
        /// Samples per pixel of the pilot.
        pub pilot: u32 = 4, |n| n >= 1, "at least one sample";
        /// Term of the denominator of relative variances.
        ///
        /// Variances are divided by `mean^2 + epsilon` of the part; the published ones are absolute.
        pub epsilon: f64 = 0.01 => "0.01", |e| e > 0.0 && e.is_finite(), "a finite number above 0";
        /// Use in the image of the samples that decide where others lie: keep (biased, as published), the only one.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "keep; there is no other";
    }
}

/// The rule of hierarchical integration: a part is halved along the axis whose halves' means differ most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContrastingHalves {
    pub(crate) split: u32,
}

/// The number of halvings after which a part is left whole.
const DEEPEST: u32 = 24;

impl Division for ContrastingHalves {
    /// Only cuts that leave samples on both sides. Ties go to the first axis.
    fn cut(&self, cell: &Cell, items: &mut Items, bounds: &Bounds, depth: u32) -> Option<(usize, f32)> {
        if items.len() < self.split as usize || depth >= DEEPEST {
            return None;
        }
        let mut best: Option<(f64, usize, f32)> = None;
        for axis in 0..cell.axes {
            let middle = bounds.low[axis] + 0.5 * (bounds.high[axis] - bounds.low[axis]);
            let (mut sums, mut counts) = ([0.0; 2], [0_u32; 2]);
            for &item in &*items {
                let side = usize::from(cell.at[item as usize][axis] >= middle);
                sums[side] += luminance(cell.values[item as usize].map(f64::from));
                counts[side] += 1;
            }
            if counts[0] > 0 && counts[1] > 0 {
                let apart = (sums[0] / f64::from(counts[0]) - sums[1] / f64::from(counts[1])).abs();
                if best.is_none_or(|(largest, ..)| apart > largest) {
                    best = Some((apart, axis, middle));
                }
            }
        }
        best.map(|(_, axis, middle)| (axis, middle))
    }
}

impl Refinement for HierarchicalOptions {
    const NAME: &'static str = "hierarchical";
    const SIDE: u32 = 1;
    type Division = ContrastingHalves;

    fn division(&self) -> ContrastingHalves {
        ContrastingHalves { split: self.split }
    }

    fn dimensions(&self, domain: &Domain) -> Result<Domain, Error> {
        Ok(domain.clone())
    }

    fn pilot_samples(&self) -> u32 {
        self.pilot
    }

    /// The variance that one more sample takes from the part, `V^2 s^2 / (n (n + 1))`, relative to its mean. A part with one
    /// sample has the square of its luminance as variance, since its own is unknown.
    fn score(&self, cell: &Cell, leaf: &Leaf<'_>) -> f64 {
        let (n, volume) = (leaf.items.len() as f64, leaf.bounds.volume(cell.axes));
        let level = luminance(mean(cell, leaf.items));
        let variance = if leaf.items.len() < 2 {
            level * level
        } else {
            let squares = leaf.items.iter().map(|&item| {
                let apart = luminance(cell.values[item as usize].map(f64::from)) - level;
                apart * apart
            });
            squares.sum::<f64>() / (n - 1.0)
        };
        let relative = (variance / (level * level + self.epsilon)).max(LEAST);
        volume * volume * relative / (n.max(1.0) * (n + 1.0))
    }

    /// The score falls with the square of the samples. At most as many as there are, since variances of few samples mislead.
    fn wanted(&self, score: f64, samples: u32, level: f64) -> u32 {
        let more = f64::from(samples.max(1)) * ((score / level).sqrt() - 1.0);
        more.ceil().clamp(0.0, f64::from(samples.max(1))) as u32
    }

    fn place(&self, cell: &Cell, leaf: &Leaf<'_>, count: u32, seed: u64, to: &mut Vec<At>) {
        for number in 0..u64::from(count) {
            to.push(leaf.bounds.point(cell.axes, |axis| unit(mix(seed ^ number << 40) ^ (axis as u64 + 1))));
        }
    }
}

/// The least relative variance, so that no part starves.
const LEAST: f64 = 1e-5;

/// Hierarchical integration of each pixel over place, lens, time and light [after Kajiya 1986].
///
/// A pixel's domain is a tree of parts. The next sample goes to the part whose variance it reduces most. A part with four
/// samples is halved, along the axis whose halves' means differ most. Kajiya leaves both rules open; the defaults are ours.
/// The tree follows anew from all samples before each round.
///
/// The filter [`TreeMean`](crate::TreeMean) with `tree=contrast` weighs parts by their volume. A pixel's plain mean
/// overweights parts with many samples.
///
/// *Guarantees*: spends the budget exactly. *Bias*: samples decide where others lie, and stay [Kirk and Arvo 1991].
/// *Weaknesses*: a well-distributed point set of a count known beforehand beats it. It reads the coordinates of all
/// samples in each round.
pub type Hierarchical<P> = TreeSampler<P, HierarchicalOptions>;

#[cfg(test)]
mod tests;
