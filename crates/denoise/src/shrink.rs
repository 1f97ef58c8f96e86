//! Blends of two images by shrinkage, after [James and Stein 1961].

use crate::error_map::{Channels, Pair, relative_weight};
use crate::maps::{box_mean, map, update};
use crate::planes::{Inputs, Plane};

/// The number of standard errors by which a bias must exceed 0 to count in the last blend. Without it, patches of specks remain
/// up to 16 spp; with 2, 1.5 % more error at 32 spp.
pub(crate) const EVIDENCE: f32 = 1.0;

/// The radii over which a blend pools its two sums, in pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Radii {
    /// The radius for the squared difference that both halves agree on: the bias of the smooth image.
    pub(crate) bias: usize,
    /// The radius for the noise of the difference.
    pub(crate) noise: usize,
    /// The radius over which the noise of a filtered image is alike; 0 if the noise of every pixel is its own.
    pub(crate) alike: usize,
}

/// The radii of the last blend of a filter, with the unfiltered image.
pub(crate) const LAST: Radii = Radii { bias: 5, noise: 10, alike: 0 };

/// The radius over which the share of the smooth image is averaged.
const SHARE: usize = 3;

impl Radii {
    /// The rows that [`shrink`] reads above and below its own: the larger sum, the average of the shares, and the relative
    /// weights.
    pub(crate) const fn rows(self) -> usize {
        let bias = self.bias + self.alike;
        SHARE + 1 + if bias > self.noise { bias } else { self.noise }
    }
}

/// Moves the image `narrow` towards `smooth` as far as their difference is noise.
///
/// With `D_A` and `D_B` the differences of the halves, `V` the mean of `(D_A - D_B)^2 / 4` over a window and `B` that of
/// `D_A D_B`, the result is `narrow + a (smooth - narrow)` with `a = V / (V + max(0, B))`. The halves share no sample,
/// so `D_A D_B` estimates the squared bias without noise. It counts as far as it exceeds `evidence` standard errors:
/// otherwise chance would keep patches of noise. If every pixel has its own noise, the products themselves give their standard
/// error. In a filtered image, patches of pixels have the same noise, and products of strong detail are large: there, without
/// bias, a product's mean square is `4 V^2`, with `V` over a patch, and a patch counts once. Squares are relative to the
/// squared radiance of `smooth`, as in relMSE. A choice between the images by a threshold would keep dark pixels, which look free of noise, and replace
/// bright ones, and so darken the image. Without any pixel that both halves have sampled, the result is `smooth`.
pub(crate) fn shrink(inputs: &Inputs, narrow: Channels<'_>, smooth: &Pair, radii: Radii, evidence: f32) -> Pair {
    let weight = relative_weight(inputs, smooth);
    let smooth = smooth.channels();
    let [noise, bias] = differences(inputs, narrow, smooth, &weight);
    let [squares] = if radii.alike > 0 {
        let patch = box_mean(&noise, inputs.size, radii.alike);
        map([&patch], |[noise]| [4.0 * noise * noise])
    } else {
        map([&bias], |[bias]| [bias * bias])
    };
    let mut share = box_mean(&noise, inputs.size, radii.noise);
    let [bias, squares] = [bias, squares].map(|plane| box_mean(&plane, inputs.size, radii.bias));
    // The number of standard errors of a mean over the window, per root of the mean square.
    let errors = evidence * (2 * radii.alike + 1) as f32 / (2 * radii.bias + 1) as f32;
    update(&mut share, [&bias, &squares], |noise, [bias, square]| {
        let certain = (bias - errors * square.sqrt()).max(0.0);
        (noise + 1e-12) / (noise + certain + 1e-12)
    });
    let share = box_mean(&share, inputs.size, SHARE);
    let blend = |k: usize| {
        let [plane] =
            map([narrow[k], smooth[k], &share], |[narrow, smooth, share]| [(1.0 - share) * narrow + share * smooth]);
        plane
    };
    Pair::new(std::array::from_fn(blend))
}

/// The planes of the noise and of the product of the halves' differences, per pixel; 0 where a half has no samples.
fn differences(inputs: &Inputs, narrow: Channels<'_>, smooth: Channels<'_>, weight: &[f32]) -> [Plane; 2] {
    let ([nra, nga, nba, nrb, ngb, nbb], [sra, sga, sba, srb, sgb, sbb]) = (narrow, smooth);
    let [na, nb] = inputs.counts();
    map([nra, nga, nba, nrb, ngb, nbb, sra, sga, sba, srb, sgb, sbb, na, nb, weight], |values| {
        let [nra, nga, nba, nrb, ngb, nbb, sra, sga, sba, srb, sgb, sbb, na, nb, weight] = values;
        let (mut noise, mut bias) = (0.0, 0.0);
        for [a, b] in [[sra - nra, srb - nrb], [sga - nga, sgb - ngb], [sba - nba, sbb - nbb]] {
            noise += (a - b) * (a - b) * 0.25;
            bias += a * b;
        }
        let known = na != 0.0 && nb != 0.0;
        [noise, bias].map(|sum: f32| if known { sum * weight / 3.0 } else { 0.0 })
    })
}
