//! Pixels whose parts count by their volume.

use crate::hierarchical::ContrastingHalves;
use crate::method::{SamplesFilter, SamplesMethod};
use crate::recorders::FilmSamples;
use crate::subdivision::Quadrants;
use crate::tree::{Cells, Division, leaves, mean};
use crate::{Domain, FilmPoints};
use dapple_core::Filtered;

dapple_core::options! {
    /// The parameters of [`TreeMean`].
    pub struct TreeMeanOptions {
        /// Parts: quadrants (of the pixel, as subdivision has them) or contrast (of all axes, as hierarchical has them).
        pub tree: PartRule = PartRule::Quadrants => "quadrants";
        /// Samples of a part from which it is split, with tree=contrast.
        pub split: u32 = 4, |n| (2..=64).contains(&n), "2 to 64 samples";
    }
}

/// The parts of a pixel that [`TreeMean`] weighs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PartRule {
    /// Quadrants of quadrants, as far as the sampler [`Subdivision`](crate::Subdivision) has filled them.
    #[default]
    Quadrants,
    /// Halves along the axes whose halves' means differ most, as of the sampler [`Hierarchical`](crate::Hierarchical).
    Contrast,
}

dapple_core::choices!(PartRule { Quadrants = "quadrants", Contrast = "contrast" });

/// A pixel as the sum over its parts of their volume times their mean: the estimate of hierarchical integration
/// [after Kajiya 1986; after Whitted 1980].
///
/// It is made for samplers that refine parts of a pixel, whose plain mean is biased towards these parts. It works on the
/// samples of any sampler, whose coordinates come from [`FilmPoints`]. A part without samples is left out. Pixels without
/// samples are black. There is no error estimate.
///
/// *Bias*: with `tree=contrast` the samples' values decide the parts. *Weaknesses*: with well-distributed points of equal
/// counts, the plain mean is better.
pub type TreeMean = SamplesFilter<TreeMeanOptions>;

impl SamplesMethod for TreeMeanOptions {
    const NAME: &'static str = "tree-mean";

    fn dimensions(&self, domain: &Domain) -> Domain {
        match self.tree {
            PartRule::Quadrants => domain.place(),
            PartRule::Contrast => domain.clone(),
        }
    }

    fn image(&self, samples: &FilmSamples<'_>, points: &FilmPoints) -> Filtered {
        let halves = ContrastingHalves { split: self.split };
        let rule: &dyn Division = match self.tree {
            PartRule::Quadrants => &Quadrants,
            PartRule::Contrast => &halves,
        };
        Cells::new(samples.film.frame(), 1).image(samples, points, |cell, image| {
            let (mut sum, mut volume) = ([0.0; 3], 0.0);
            leaves(rule, cell, &mut |leaf| {
                if !leaf.items.is_empty() {
                    let (mean, of_leaf) = (mean(cell, leaf.items), leaf.bounds.volume(cell.axes));
                    (0..3).for_each(|c| sum[c] += of_leaf * mean[c]);
                    volume += of_leaf;
                }
            });
            image[0] = sum.map(|x| if volume > 0.0 { (x / volume) as f32 } else { 0.0 });
        })
    }
}
