//! Blends of two images by shrinkage, after [James and Stein 1961].

use crate::error_map::{Pair, relative_weight};
use crate::planes::{Inputs, Plane, box_mean};
use rayon::prelude::*;

/// The number of standard errors by which a bias must exceed 0 to count. Without it, patches of specks remain up to 16 spp;
/// with 2, 1.5 % more error at 32 spp.
pub(crate) const EVIDENCE: f32 = 1.0;

/// The radii over which a blend pools its two sums, in pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Radii {
    /// The radius for the squared difference that both halves agree on: the bias of the smooth image.
    pub(crate) bias: usize,
    /// The radius for the noise of the difference.
    pub(crate) noise: usize,
}

/// The radii of the last blend of a filter, with the unfiltered image.
pub(crate) const LAST: Radii = Radii { bias: 5, noise: 10 };

/// The radius over which the share of the smooth image is averaged.
const SHARE: usize = 3;

impl Radii {
    /// The rows that [`shrink`] reads above and below its own: the larger sum, the average of the shares, and the relative
    /// weights.
    pub(crate) const fn rows(self) -> usize {
        SHARE + 1 + if self.bias > self.noise { self.bias } else { self.noise }
    }
}

/// Moves the image `narrow` towards `smooth` as far as their difference is noise.
///
/// With `D_A` and `D_B` the differences of the halves, `V` the mean of `(D_A - D_B)^2 / 4` over a window and `B` that of
/// `D_A D_B`, the result is `narrow + a (smooth - narrow)` with `a = V / (V + max(0, B))`. The halves share no sample,
/// so `D_A D_B` estimates the squared bias without noise. It counts as far as it exceeds `evidence` standard errors:
/// otherwise chance would keep patches of noise. Squares are relative to the squared radiance of `smooth`, as
/// in relMSE. A choice between the images by a threshold would keep dark pixels, which look free of noise, and replace
/// bright ones, and so darken the image. Without any pixel that both halves have sampled, the result is `smooth`.
pub(crate) fn shrink(inputs: &Inputs, narrow: &Pair, smooth: &Pair, radii: Radii, evidence: f32) -> Pair {
    let weight = relative_weight(inputs, smooth);
    let [noise, bias] = differences(inputs, narrow, smooth, &weight);
    let noise = box_mean(&noise, inputs.size, radii.noise);
    let squares: Plane = bias.iter().map(|b| b * b).collect();
    let squares = box_mean(&squares, inputs.size, radii.bias);
    let bias = box_mean(&bias, inputs.size, radii.bias);
    // The number of standard errors of a mean over the window, per root of the mean square.
    let errors = evidence / (2 * radii.bias + 1) as f32;
    let certain = bias.iter().zip(&squares).map(|(bias, square)| (bias - errors * square.sqrt()).max(0.0));
    let share: Plane = noise.iter().zip(certain).map(|(v, b)| (v + 1e-12) / (v + b + 1e-12)).collect();
    let share = box_mean(&share, inputs.size, SHARE);
    let rest: Plane = share.iter().map(|share| 1.0 - share).collect();
    Pair::mixed(&[narrow, smooth], &[rest, share])
}

/// The planes of the noise and of the product of the halves' differences, per pixel; 0 where a half has no samples.
fn differences(inputs: &Inputs, narrow: &Pair, smooth: &Pair, weight: &[f32]) -> [Plane; 2] {
    let of = |i: usize| {
        if inputs.halves.iter().any(|half| half.count[i] == 0.0) {
            return [0.0; 2];
        }
        let (mut noise, mut bias) = (0.0, 0.0);
        for c in 0..3 {
            let [a, b] = [0, 1].map(|h: usize| smooth.0[h][c][i] - narrow.0[h][c][i]);
            noise += (a - b) * (a - b) * 0.25;
            bias += a * b;
        }
        [noise, bias].map(|sum: f32| sum * weight[i] / 3.0)
    };
    let all: Vec<[f32; 2]> = (0..inputs.pixels()).into_par_iter().with_min_len(1024).map(of).collect();
    [0, 1].map(|k: usize| all.iter().map(|pair| pair[k]).collect())
}
