//! Normal equations of weighted regressions, one window in each lane of a vector.
//!
//! Each sum has a fixed order and no operation is fused, so every machine computes the same bits.

#![expect(clippy::needless_range_loop, reason = "several arrays run along, as in the formulas")]

use pulp::Simd;

/// The ridge added to the diagonal of the normal equations, as a fraction of the total weight.
const RIDGE: f32 = 2e-4;
/// The smallest pivot of the normal equations, relative to its diagonal entry. Smaller pivots are rounding errors and are
/// raised to this.
const PIVOT: f32 = 1e-5;

/// The linear function fitted in a window, for each colour channel: the value at the window's centre, and the slope of
/// each of `R` regressors. A vector holds several windows.
pub(crate) struct Fit<S: Simd, const R: usize> {
    pub(crate) intercept: [S::f32s; 3],
    pub(crate) slopes: [[S::f32s; 3]; R],
}

/// The weighted sums of the normal equations. Entry `[a][b]` sums the products of regressor `a - 1` (or 1, if `a` is 0)
/// and value `b`. Values are the regressors, then the colours. `V` and `N` are the numbers of values and of rows.
pub(crate) type Sums<S, const V: usize, const N: usize> = [[<S as Simd>::f32s; V]; N];

/// Adds products of weighted rows and three values to `sums`, for the pixels in the range `of`. Rows run from 0 to `last`, and
/// the three values start at number `b`.
///
/// Six sums at a time hide the latency of additions, and fit into the registers of every machine.
#[inline(always)]
pub(crate) fn add_products<S: Simd, const V: usize, const N: usize, const M: usize>(
    simd: S,
    weighted: &[[S::f32s; N]; M],
    values: [&[S::f32s; N]; 3],
    sums: &mut Sums<S, V, M>,
    [b, last]: [usize; 2],
    of: [usize; 2],
) {
    for a in (0..=last).step_by(2) {
        if a + 1 < M {
            add_rows::<S, V, N, M, 2>(simd, weighted, values, sums, [a, b], of);
        } else {
            add_rows::<S, V, N, M, 1>(simd, weighted, values, sums, [a, b], of);
        }
    }
}

/// Adds the products of `A` rows, starting at row `a`, for the pixels from `first` to `end`.
#[inline(always)]
fn add_rows<S: Simd, const V: usize, const N: usize, const M: usize, const A: usize>(
    simd: S,
    weighted: &[[S::f32s; N]; M],
    values: [&[S::f32s; N]; 3],
    sums: &mut Sums<S, V, M>,
    [a, b]: [usize; 2],
    [first, end]: [usize; 2],
) {
    let mut all = [[simd.splat_f32s(0.0); 3]; A];
    for i in 0..A {
        all[i] = [sums[a + i][b], sums[a + i][b + 1], sums[a + i][b + 2]];
    }
    for k in first..end.min(N) {
        for i in 0..A {
            for c in 0..3 {
                all[i][c] = simd.add_f32s(all[i][c], simd.mul_f32s(weighted[a + i][k], values[c][k]));
            }
        }
    }
    for i in 0..A {
        [sums[a + i][b], sums[a + i][b + 1], sums[a + i][b + 2]] = all[i];
    }
}

/// The weighted covariance of regressor `a` and value `b`. `share` is one over the total weight.
#[inline(always)]
fn covariance<S: Simd, const V: usize, const N: usize>(
    simd: S,
    sums: &Sums<S, V, N>,
    mean: &[S::f32s; V],
    share: S::f32s,
    a: usize,
    b: usize,
) -> S::f32s {
    simd.sub_f32s(simd.mul_f32s(sums[a + 1][b], share), simd.mul_f32s(mean[a], mean[b]))
}

/// Solves the normal equations, centred at the weighted means, by the decomposition `L D L^T`. The right-hand sides are the
/// three colour channels, which start at value number `colours`.
#[inline(always)]
pub(crate) fn solve<S: Simd, const R: usize, const V: usize, const N: usize>(
    simd: S,
    total: S::f32s,
    sums: &Sums<S, V, N>,
    colours: usize,
    reference: &[S::f32s; 3],
) -> Fit<S, R> {
    let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
    let share = simd.div_f32s(one, simd.max_f32s(total, simd.splat_f32s(1e-20)));
    let mut mean = sums[0];
    for value in &mut mean {
        *value = simd.mul_f32s(*value, share);
    }
    // `lower[i][j]`, j < i; `right` is the right-hand side, then the solution.
    let mut lower = [[zero; R]; R];
    let mut pivots = [zero; R];
    let mut right = [[zero; 3]; R];
    for j in 0..R {
        for i in j..R {
            let mut entry = covariance(simd, sums, &mean, share, j, i);
            let diagonal = simd.add_f32s(simd.max_f32s(entry, zero), simd.splat_f32s(RIDGE));
            if i == j {
                entry = diagonal;
            }
            for k in 0..j {
                let product = simd.mul_f32s(lower[i][k], lower[j][k]);
                entry = simd.sub_f32s(entry, simd.mul_f32s(product, pivots[k]));
            }
            if i == j {
                pivots[j] = simd.max_f32s(entry, simd.mul_f32s(diagonal, simd.splat_f32s(PIVOT)));
            } else {
                lower[i][j] = simd.div_f32s(entry, pivots[j]);
            }
        }
        for c in 0..3 {
            let mut value = covariance(simd, sums, &mean, share, j, colours + c);
            for k in 0..j {
                value = simd.sub_f32s(value, simd.mul_f32s(lower[j][k], right[k][c]));
            }
            right[j][c] = value;
        }
    }
    let mut intercept = *reference;
    for c in 0..3 {
        intercept[c] = simd.add_f32s(intercept[c], mean[colours + c]);
        for j in (0..R).rev() {
            let mut value = simd.div_f32s(right[j][c], pivots[j]);
            for i in j + 1..R {
                value = simd.sub_f32s(value, simd.mul_f32s(lower[i][j], right[i][c]));
            }
            right[j][c] = value;
            intercept[c] = simd.sub_f32s(intercept[c], simd.mul_f32s(value, mean[j]));
        }
    }
    Fit { intercept, slopes: right }
}
