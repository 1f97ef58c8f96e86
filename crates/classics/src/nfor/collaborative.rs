//! First-order regression on features, whose fits serve every pixel of their window.

use super::weights::{Guide, Kernel, TILE, TileWeights};
use super::{FEATURES, Rgb};
use crate::windows::PixelTile;
use rayon::prelude::*;

/// The unknowns of a fit: the mean and a slope per feature.
const UNKNOWNS: usize = FEATURES + 1;

/// The pivot of the normal equations, relative to the largest, below which a regressor is left out.
const DEPENDENT: f64 = 1e-10;

/// The data of a regression: colours, the pixels that have one, and the features of all.
#[derive(Clone, Copy)]
pub(super) struct Data<'a> {
    pub(super) colour: &'a [[f64; 3]],
    pub(super) known: &'a [bool],
    pub(super) features: &'a [[f64; FEATURES]],
}

/// Fits the colours in the window of each pixel by an affine function of the features [Bitterli 2016].
///
/// All fitted values of a pixel are averaged with the weights of their windows.
///
/// Pixels that no window reaches keep their colour. Bands of rows are summed in order, so that the result does not depend
/// on threads.
pub(super) fn regress(guide: &Guide<'_>, kernel: Kernel, data: &Data<'_>) -> Rgb {
    let [width, height] = guide.size;
    let bands = height.div_ceil(TILE[1]);
    let splat = |band: usize| -> Band {
        let mut weights = TileWeights::new(kernel);
        let mut sums = Band::new(guide.size, band, kernel.radius);
        for tile in PixelTile::of_band(guide.size, TILE, band) {
            weights.compute(guide, kernel, tile);
            for (pixel, [x, y]) in tile.pixels().enumerate() {
                sums.fit(guide.size, kernel, data, y * width + x, weights.of(pixel));
            }
        }
        sums
    };
    let all: Vec<Band> = (0..bands).into_par_iter().map(splat).collect();
    let mut sums = vec![[0.0; 4]; width * height];
    for band in all {
        let places = &mut sums[band.first * width..];
        places.iter_mut().zip(&band.sums).for_each(|(sum, value)| (0..4).for_each(|c| sum[c] += value[c]));
    }
    let mean = |(&[weight, r, g, b], colour): (&[f64; 4], &[f64; 3])| {
        if weight > 0.0 { [r / weight, g / weight, b / weight] } else { *colour }
    };
    sums.iter().zip(data.colour).map(mean).collect()
}

/// Sums of weights and of weighted fits over the rows that the windows of a band of rows reach.
struct Band {
    first: usize,
    sums: Vec<[f64; 4]>,
}

impl Band {
    fn new([width, height]: [usize; 2], band: usize, radius: usize) -> Self {
        let first = (band * TILE[1]).saturating_sub(radius);
        let end = ((band + 1) * TILE[1] + radius).min(height);
        Self { first, sums: vec![[0.0; 4]; (end - first) * width] }
    }

    /// Fits the window around pixel `i`, and adds the fitted values.
    fn fit(&mut self, [width, _]: [usize; 2], kernel: Kernel, data: &Data<'_>, i: usize, weights: &[f64]) {
        let near = || {
            let window = weights.iter().zip(kernel.offsets()).filter(|(w, _)| **w > 0.0);
            window.map(|(&w, [dx, dy])| (w, (i as isize + dy * width as isize + dx) as usize))
        };
        let own = &data.features[i];
        let row = |q: usize| -> [f64; UNKNOWNS] {
            let feature = &data.features[q];
            std::array::from_fn(|k| if k == 0 { 1.0 } else { feature[k - 1] - own[k - 1] })
        };
        let mut equations = NormalEquations::default();
        near().filter(|&(_, q)| data.known[q]).for_each(|(w, q)| equations.add(w, &row(q), &data.colour[q]));
        let Some(fit) = equations.solved() else { return };
        for (w, q) in near() {
            let x = row(q);
            let sums = &mut self.sums[q - self.first * width];
            sums[0] += w;
            for c in 0..3 {
                let fitted: f64 = (0..UNKNOWNS).map(|k| x[k] * fit[k][c]).sum();
                sums[1 + c] += w * fitted;
            }
        }
    }
}

/// The normal equations of a weighted fit of three channels.
#[derive(Clone, Copy, Default)]
pub(super) struct NormalEquations {
    /// The lower triangle counts.
    matrix: [[f64; UNKNOWNS]; UNKNOWNS],
    right: [[f64; 3]; UNKNOWNS],
}

impl NormalEquations {
    pub(super) fn add(&mut self, weight: f64, row: &[f64; UNKNOWNS], colour: &[f64; 3]) {
        for a in 0..UNKNOWNS {
            let weighted = weight * row[a];
            (0..=a).for_each(|b| self.matrix[a][b] += weighted * row[b]);
            (0..3).for_each(|c| self.right[a][c] += weighted * colour[c]);
        }
    }

    /// The solution by a pivoted Cholesky decomposition; regressors that depend on others have slope 0. `None` without data.
    pub(super) fn solved(&self) -> Option<[[f64; 3]; UNKNOWNS]> {
        let full = |a: usize, b: usize| self.matrix[a.max(b)][a.min(b)];
        let largest = (0..UNKNOWNS).map(|k| full(k, k)).fold(0.0, f64::max);
        if largest <= 0.0 || !largest.is_finite() {
            return None;
        }
        // Row k of the factor belongs to the regressor order[k].
        let mut order: [usize; UNKNOWNS] = std::array::from_fn(|k| k);
        let mut factor = [[0.0; UNKNOWNS]; UNKNOWNS];
        let mut rank = 0;
        while rank < UNKNOWNS {
            let rest =
                |k: usize| full(order[k], order[k]) - (0..rank).map(|j| factor[k][j] * factor[k][j]).sum::<f64>();
            let best = (rank..UNKNOWNS).fold(rank, |best, k| if rest(k) > rest(best) { k } else { best });
            let pivot = rest(best);
            if pivot <= DEPENDENT * largest {
                break;
            }
            order.swap(rank, best);
            factor.swap(rank, best);
            factor[rank][rank] = pivot.sqrt();
            for k in rank + 1..UNKNOWNS {
                let known: f64 = (0..rank).map(|j| factor[k][j] * factor[rank][j]).sum();
                factor[k][rank] = (full(order[k], order[rank]) - known) / factor[rank][rank];
            }
            rank += 1;
        }
        let mut solution = [[0.0; 3]; UNKNOWNS];
        for c in [0, 1, 2] {
            let mut y = [0.0; UNKNOWNS];
            for k in 0..rank {
                let known: f64 = (0..k).map(|j| factor[k][j] * y[j]).sum();
                y[k] = (self.right[order[k]][c] - known) / factor[k][k];
            }
            for k in (0..rank).rev() {
                let known: f64 = (k + 1..rank).map(|j| factor[j][k] * y[j]).sum();
                y[k] = (y[k] - known) / factor[k][k];
                solution[order[k]][c] = y[k];
            }
        }
        Some(solution)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::near_normal;

    fn row(seed: u64) -> [f64; UNKNOWNS] {
        std::array::from_fn(|k| if k == 0 { 1.0 } else { near_normal(seed, k as u64) })
    }

    #[test]
    fn affine_functions_are_fitted_exactly() {
        let slopes: [[f64; 3]; UNKNOWNS] = std::array::from_fn(|k| [0.3 * k as f64, 1.0 - k as f64, 2.0]);
        let mut equations = NormalEquations::default();
        for seed in 0..30 {
            let x = row(seed);
            let value = |c: usize| (0..UNKNOWNS).map(|k| x[k] * slopes[k][c]).sum::<f64>();
            equations.add(0.1 + seed as f64, &x, &[value(0), value(1), value(2)]);
        }
        let found = equations.solved().unwrap();
        let off = |k: usize, c: usize| (found[k][c] - slopes[k][c]).abs();
        assert!((0..UNKNOWNS).all(|k| (0..3).all(|c| off(k, c) < 1e-9)), "{found:?}");
    }

    #[test]
    fn dependent_regressors_change_no_fitted_value() {
        let mut equations = NormalEquations::default();
        // Slopes of the second and third regressor cannot be told apart; the others are constant.
        let x = |k: usize| [1.0, k as f64, 2.0 * k as f64, 0.0, 0.0, 0.0, 0.0, 0.0];
        (0..9).for_each(|k| equations.add(1.0, &x(k), &[3.0 + 5.0 * k as f64, 7.0, 0.0]));
        let fit = equations.solved().unwrap();
        for k in 0..9 {
            let value = |c: usize| (0..UNKNOWNS).map(|j| x(k)[j] * fit[j][c]).sum::<f64>();
            assert!((value(0) - 3.0 - 5.0 * k as f64).abs() < 1e-9 && (value(1) - 7.0).abs() < 1e-9, "{fit:?}");
        }
        assert!(NormalEquations::default().solved().is_none());
    }
}
