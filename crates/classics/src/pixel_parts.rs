//! Samplers that refine parts of pixels by hierarchical integration or adaptive subdivision, and the filter that weights parts
//! by their volume.

use crate::method::{FilterMethod, MethodFilter};
use crate::recorders::Singles;
use crate::tree::{At, Bounds, Cell, Division, Items, Leaf, Refinement, TreeSampler, image_of_boxes, mean, unit};
use crate::{Domain, FilmPoints};
use dapple_core::plan::{PilotPolicy, Stopping};
use dapple_core::{Error, Film, Filtered, film::luminance, point_set::mix};

dapple_core::options! {
    /// The parameters of [`Hierarchical`].
    pub struct HierarchicalOptions {
        /// Split a cell once it has this many samples.
        pub split: u32 = 4, |n| (2..=64).contains(&n), "2 to 64 samples";
        /// Pilot samples per pixel.
        pub pilot: u32 = 4, |n| n >= 1, "at least one sample";
        /// Added to the denominator (mean^2) of relative variances.
        ///
        /// The mean is that of a part of the pixel. In the paper, variances are absolute.
        pub epsilon: f64 = 0.01 => "0.01", |e| e > 0.0 && e.is_finite(), "a finite number above 0";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// The number of halvings after which a part is not split further.
const DEEPEST: u32 = 24;

impl Division for HierarchicalOptions {
    /// Halves a part along the axis whose two halves differ most in mean. Both halves must contain samples. Ties go to the
    /// first axis.
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

    fn pilot_samples(&self) -> u32 {
        self.pilot
    }

    /// The decrease of the part's variance by one more sample, `V^2 s^2 / (n (n + 1))`, relative to its mean. For a part with
    /// one sample, whose variance is unknown, the squared luminance is used.
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

    /// The score falls with the square of the sample count. The sample count at most doubles, since variances of few samples
    /// mislead.
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

/// Hierarchical integration of each pixel over image position, lens, time and light [after Kajiya 1986].
///
/// A pixel's domain is a tree of parts. The next sample goes to the part whose variance it reduces most. A part with four
/// samples is halved, along the axis whose two halves differ most in mean. Kajiya leaves both rules open; the defaults are not
/// in the paper. The tree is rebuilt from all samples before each round.
///
/// The filter [`TreeMean`] with `tree=contrast` weights parts by their volume. Plain pixel means give parts with many samples
/// too much weight.
///
/// *Guarantees*: spends the budget exactly. *Bias*: the values of samples determine where later ones lie, and all samples are
/// kept [Kirk and Arvo 1991]. *Weaknesses*: well-distributed points with equal counts give less error. Each round reads the
/// coordinates of all samples.
pub type Hierarchical<P> = TreeSampler<P, HierarchicalOptions>;

dapple_core::options! {
    /// The parameters of [`Subdivision`].
    pub struct SubdivisionOptions {
        /// Contrast of red above which a quadrant is split; the three defaults are those of Mitchell 1987.
        pub red: f64 = 0.4, |red| red > 0.0 && red <= 1.0, "above 0 and at most 1";
        /// Contrast of green above which a quadrant is split.
        pub green: f64 = 0.3, |green| green > 0.0 && green <= 1.0, "above 0 and at most 1";
        /// Contrast of blue above which a quadrant is split.
        pub blue: f64 = 0.6, |blue| blue > 0.0 && blue <= 1.0, "above 0 and at most 1";
        /// Maximum subdivision depth.
        pub depth: u32 = 4, |depth| (1..=10).contains(&depth), "1 to 10 splits";
        /// Stopping rule: budget (largest contrast x area first, until spent) or threshold (split quadrants above it, within the budget).
        pub mode: Stopping = Stopping::Budget => "budget";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// The number added to the denominator to avoid a division by zero in black parts.
const BLACK: f64 = 1e-3;
/// The least contrast and relative variance, so that every part gets samples.
const LEAST: f64 = 1e-5;

/// The number of the part that contains a sample, if a box is divided into `parts` x `parts` equal parts, row by row.
fn part(at: &At, bounds: &Bounds, parts: usize) -> usize {
    let along = |axis: usize| {
        let share = (f64::from(at[axis]) - f64::from(bounds.low[axis])) / bounds.extent(axis);
        ((share * parts as f64) as usize).min(parts - 1)
    };
    along(1) * parts + along(0)
}

/// A bit mask of the `parts` x `parts` equal parts of a box that contain samples.
fn occupied(cell: &Cell, items: &Items, bounds: &Bounds, parts: usize) -> u32 {
    items.iter().fold(0, |bits, &item| bits | 1 << part(&cell.at[item as usize], bounds, parts))
}

impl Division for SubdivisionOptions {
    /// Splits a part into quadrants by two cuts, along x and then along y, if all four quadrants of each of its quadrants
    /// contain samples. These are exactly the parts that a sampler has split, so contrast need not be computed again.
    fn cut(&self, cell: &Cell, items: &mut Items, bounds: &Bounds, depth: u32) -> Option<(usize, f32)> {
        let axis = (depth % 2) as usize;
        let is_split = axis == 1 || items.len() >= 16 && occupied(cell, items, bounds, 4) == 0xffff;
        is_split.then(|| (axis, bounds.low[axis] + 0.5 * (bounds.high[axis] - bounds.low[axis])))
    }
}

/// A part's contrast `(max - min) / (max + min)` relative to the channel's threshold, for the channel with the largest ratio.
fn contrast(cell: &Cell, items: &Items, thresholds: [f64; 3]) -> f64 {
    let of = |c: usize| {
        let values = items.iter().map(|&item| f64::from(cell.values[item as usize][c]));
        let (low, high) = values.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
        if low <= high { (high - low) / (high + low + BLACK) / thresholds[c] } else { 0.0 }
    };
    (0..3).map(of).fold(0.0, f64::max)
}

impl Refinement for SubdivisionOptions {
    const NAME: &'static str = "subdivision";
    const SIDE: u32 = 1;

    /// Returns the axes of the position in the pixel only.
    fn dimensions(&self, domain: &Domain) -> Result<Domain, Error> {
        Ok(domain.place())
    }

    fn is_exact(&self) -> bool {
        self.mode == Stopping::Budget
    }

    fn pilot_samples(&self) -> u32 {
        4
    }

    /// One jittered sample in each quadrant, in an order that depends on the pixel.
    fn pilot_sample(&self, number: u32, seed: u64) -> Option<At> {
        let quadrant = (number < 4).then_some(number ^ (seed % 4) as u32)?;
        let mut at = At::default();
        for (axis, x) in at[..2].iter_mut().enumerate() {
            let jitter = unit(mix(seed ^ u64::from(number) << 32) ^ axis as u64);
            *x = 0.5 * ((quadrant >> axis & 1) as f32 + jitter);
        }
        Some(at)
    }

    fn score(&self, cell: &Cell, leaf: &Leaf<'_>) -> f64 {
        let area = leaf.bounds.volume(2);
        if occupied(cell, leaf.items, leaf.bounds, 2) != 0xf {
            // Another sampler left quadrants of this part empty.
            return 2.0 + area;
        }
        if leaf.depth / 2 >= self.depth {
            return 0.0;
        }
        let contrast = contrast(cell, leaf.items, [self.red, self.green, self.blue]);
        match self.mode {
            // At most 1: contrasts are at most 1, and multiplying by the least threshold keeps that bound.
            Stopping::Budget => area * (contrast * self.red.min(self.green).min(self.blue) + LEAST) * 0.5,
            Stopping::Threshold if contrast > 1.0 => area,
            Stopping::Threshold => 0.0,
        }
    }

    /// A split needs twelve samples; an incomplete part needs the samples that it lacks.
    fn wanted(&self, score: f64, samples: u32, level: f64) -> u32 {
        if score > level { 16 - samples.min(4) } else { 0 }
    }

    /// Places one jittered sample in each empty quadrant of the part, or of its quadrants.
    fn place(&self, cell: &Cell, leaf: &Leaf<'_>, count: u32, seed: u64, to: &mut Vec<At>) {
        let parts = if occupied(cell, leaf.items, leaf.bounds, 2) == 0xf { 4 } else { 2 };
        let there = occupied(cell, leaf.items, leaf.bounds, parts);
        for empty in (0..parts * parts).filter(|part| there >> part & 1 == 0).take(count as usize) {
            let place = [empty % parts, empty / parts];
            let jitter = |axis: usize| unit(mix(seed ^ (empty as u64) << 8) ^ axis as u64);
            to.push(leaf.bounds.point(2, |axis| (place[axis] as f32 + jitter(axis)) / parts as f32));
        }
    }
}

/// Adaptive subdivision of pixels [after Whitted 1980].
///
/// A pixel starts with four samples, one in each quadrant. A part whose samples have high contrast is split into quadrants.
/// Each of these quadrants then holds one sample and gets three more. The part with the largest product of area and contrast is
/// split first. Whitted's samples lie at corners and are shared between pixels; a sample here belongs to one pixel. Whitted's
/// threshold was not available.
///
/// The filter [`TreeMean`] weights parts by their area. Plain pixel means give split parts too much weight.
///
/// *Guarantees*: spends the budget exactly, or at most the budget with [`Stopping::Threshold`]. *Bias*: the values of samples
/// determine where later ones lie, and all samples are kept [Kirk and Arvo 1991]. *Weaknesses*: misses whatever the first four
/// samples miss. The method assumes functions without noise: with noise, contrast never falls, and all parts are split.
pub type Subdivision<P> = TreeSampler<P, SubdivisionOptions>;

dapple_core::options! {
    /// The parameters of [`TreeMean`].
    pub struct TreeMeanOptions {
        /// Must match the sampler: quadrants for subdivision, contrast (split along any dimension) for hierarchical.
        pub tree: PartRule = PartRule::Quadrants => "quadrants";
        /// With tree=contrast: split a cell once it has this many samples.
        pub split: u32 = 4, |n| (2..=64).contains(&n), "2 to 64 samples";
    }
}

/// The rule by which [`TreeMean`] divides a pixel into parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PartRule {
    /// Nested quadrants, down to the level that the sampler [`Subdivision`] has filled.
    #[default]
    Quadrants,
    /// Halves along the axes whose two halves differ most in mean, as in the sampler [`Hierarchical`].
    Contrast,
}

dapple_core::choices!(PartRule { Quadrants = "quadrants", Contrast = "contrast" });

/// The mean over a pixel's parts, weighted by volume: `sum(volume * mean) / sum(volume)`, the estimate of hierarchical
/// integration [after Kajiya 1986; after Whitted 1980].
///
/// The filter is made for samplers that refine parts of a pixel; the plain mean would give refined parts too much weight. It
/// works with any sampler; [`FilmPoints`] provides the coordinates. Parts without samples are left out of both sums. Pixels
/// without samples are black. There is no error estimate.
///
/// *Bias*: with `tree=contrast` the parts depend on the samples' values. *Weaknesses*: for well-distributed points with equal
/// counts, the plain mean is better.
pub type TreeMean = MethodFilter<TreeMeanOptions, FilmPoints>;

impl FilterMethod<FilmPoints> for TreeMeanOptions {
    const NAME: &'static str = "tree-mean";
    const SAMPLES: Option<Singles> = Some(Singles::All);

    fn image(&self, film: &Film, points: &FilmPoints) -> Result<Filtered, Error> {
        let (quadrants, halves) = (SubdivisionOptions::default(), HierarchicalOptions::default().split(self.split));
        let (rule, domain): (&dyn Division, Domain) = match self.tree {
            PartRule::Quadrants => (&quadrants, points.domain().place()),
            PartRule::Contrast => (&halves, points.domain().clone()),
        };
        image_of_boxes((film, Self::NAME), 1, points, &domain, rule)
    }
}
