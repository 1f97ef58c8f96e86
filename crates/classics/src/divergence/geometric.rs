//! The entropy of the surfaces that a pixel's pilot samples hit.

use dapple_core::{Film, FirstHit};

/// The contrast `1 - H / ln n` of each pixel's first hits, with shares in proportion to `cos(theta) / d^2` [Rigau 2003,
/// GI]. Misses have no share. 0 for pixels without hits, or with fewer than two samples.
pub(super) fn scores(film: &Film) -> Vec<f64> {
    let eye = eye(film);
    let score = |i: usize| {
        let hits = film.first_hits(i);
        // Places of samples that were not traced hold no hit.
        let taken = hits.len().min(usize::try_from(film.count(i)).unwrap_or(usize::MAX));
        contrast(hits[..taken].iter().map(|hit| hit.as_ref().map_or(0.0, |hit| projected(hit, eye))))
    };
    (0..film.frame().pixels()).map(score).collect()
}

/// The contrast of non-negative values.
fn contrast(values: impl Iterator<Item = f64>) -> f64 {
    let (mut count, mut sum, mut logs) = (0.0, 0.0, 0.0);
    for value in values {
        count += 1.0;
        sum += value;
        logs += if value > 0.0 { value * libm::log(value) } else { 0.0 };
    }
    if count < 2.0 || sum <= 0.0 {
        return 0.0;
    }
    let divergence = logs / sum - libm::log(sum / count);
    if divergence > 1e-12 { divergence / libm::log(count) } else { 0.0 }
}

/// `cos(theta) / d^2` of a hit, seen from `eye`. Without it the cosine is taken as 1.
fn projected(hit: &FirstHit, eye: Option<[f64; 3]>) -> f64 {
    let depth = f64::from(hit.depth).max(1e-9);
    let cosine = eye.map_or(1.0, |eye| {
        let (mut dot, mut square) = (0.0, 0.0);
        for ((eye, position), normal) in eye.into_iter().zip(hit.position).zip(hit.geometric_normal) {
            let d = eye - f64::from(position);
            dot += d * f64::from(normal);
            square += d * d;
        }
        if square > 0.0 { (dot.abs() / square.sqrt()).clamp(1e-3, 1.0) } else { 1.0 }
    });
    cosine / (depth * depth)
}

/// The point whose distances from all first hits are their depths: the camera. `None` if hits do not determine it, because
/// all lie in a plane.
///
/// `|p - e|^2 = d^2` is linear in `e` and `|e|^2`, and solved by least squares.
fn eye(film: &Film) -> Option<[f64; 3]> {
    let hits = || (0..film.frame().pixels()).flat_map(|i| film.first_hits(i)).flatten();
    let (mut count, mut centre) = (0.0, [0.0; 3]);
    for hit in hits() {
        count += 1.0;
        (0..3).for_each(|c| centre[c] += f64::from(hit.position[c]));
    }
    let centre = centre.map(|sum| sum / f64::max(count, 1.0));
    // Rows of the normal equations, the right side last.
    let mut rows = [[0.0; 5]; 4];
    for hit in hits() {
        let p: [f64; 3] = std::array::from_fn(|c| f64::from(hit.position[c]) - centre[c]);
        let square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
        let row = [2.0 * p[0], 2.0 * p[1], 2.0 * p[2], -1.0, square - f64::from(hit.depth).powi(2)];
        for k in 0..4 {
            (0..5).for_each(|c| rows[k][c] += row[k] * row[c]);
        }
    }
    let [x, y, z, _] = solved(rows)?;
    Some([x + centre[0], y + centre[1], z + centre[2]])
}

/// Solves four linear equations by Gaussian elimination with pivots; `None` if they are nearly dependent.
fn solved(mut rows: [[f64; 5]; 4]) -> Option<[f64; 4]> {
    let largest = [0, 1, 2, 3].map(|k| rows[k][k].abs());
    for k in 0..4 {
        let pivot = (k..4).max_by(|&a, &b| rows[a][k].abs().total_cmp(&rows[b][k].abs()))?;
        rows.swap(k, pivot);
        if !rows[k][k].is_finite() || rows[k][k].abs() <= 1e-9 * largest[k] {
            return None;
        }
        for below in k + 1..4 {
            let factor = rows[below][k] / rows[k][k];
            let pivot = rows[k];
            rows[below].iter_mut().zip(pivot).skip(k).for_each(|(value, pivot)| *value -= factor * pivot);
        }
    }
    let mut solution = [0.0; 4];
    for k in (0..4).rev() {
        let known: f64 = (k + 1..4).map(|c| rows[k][c] * solution[c]).sum();
        solution[k] = (rows[k][4] - known) / rows[k][k];
    }
    solution.iter().all(|x| x.is_finite()).then_some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_core::{Estimate, Frame, Needs};

    const EYE: [f64; 3] = [3.0, -2.0, 5.0];

    fn hit(position: [f32; 3], normal: [f32; 3]) -> FirstHit {
        let d: f64 = (0..3).map(|c| (f64::from(position[c]) - EYE[c]).powi(2)).sum();
        FirstHit::new(position, normal, d.sqrt() as f32)
    }

    fn film(hits: impl Fn(usize, u32) -> Option<FirstHit>) -> Film {
        let mut film = Film::new(Frame::new(4, 4).unwrap(), Needs::none().with_first_hits(4));
        for i in 0..16 {
            for k in 0..4 {
                film.push_estimate(i, 0, &Estimate::new([1.0; 3]).with_first_hit(hits(i, k)));
            }
        }
        film
    }

    #[test]
    fn the_camera_is_found_from_depths() {
        let curved = film(|i, k| Some(hit([i as f32, k as f32, (i * i % 7) as f32], [0.0, 0.0, 1.0])));
        let found = eye(&curved).unwrap();
        assert!((0..3).all(|c| (found[c] - EYE[c]).abs() < 1e-3), "{found:?}");
        assert_eq!(eye(&film(|i, k| Some(hit([i as f32, k as f32, 0.0], [0.0, 0.0, 1.0])))), None);
        assert_eq!(eye(&film(|_, _| None)), None);
    }

    #[test]
    fn edges_have_contrast_and_parallel_surfaces_have_little() {
        let near = |i: usize, k: u32| [3.0 + 0.01 * i as f32, -2.0 + 0.01 * k as f32, 0.01 * (i * i % 5) as f32];
        let scores = scores(&film(|i, k| match i {
            // One sample of four misses.
            0 => (k > 0).then(|| hit(near(i, k), [0.0, 0.0, 1.0])),
            // One sample of four sees a surface at twice the distance.
            1 if k == 0 => Some(hit([3.0, -2.0, -5.0], [0.0, 0.0, 1.0])),
            2 => None,
            _ => Some(hit(near(i, k), [0.0, 0.0, 1.0])),
        }));
        let entropy = |p: &[f64]| 1.0 + p.iter().map(|p| p * p.ln()).sum::<f64>() / 4f64.ln();
        assert!((scores[0] - entropy(&[1.0 / 3.0; 3])).abs() < 1e-3, "{}", scores[0]);
        assert!((scores[1] - entropy(&[1.0 / 13.0, 4.0 / 13.0, 4.0 / 13.0, 4.0 / 13.0])).abs() < 1e-3, "{}", scores[1]);
        assert_eq!(scores[2], 0.0);
        assert!(scores[3..].iter().all(|&s| s < 1e-3), "{scores:?}");
    }

    #[test]
    fn the_order_of_hits_changes_no_score() {
        let place = |k: u32| [3.0 + 0.1 * k as f32, -2.0 + (k * k % 3) as f32, [0.0, -1.0, 2.0, -4.0][k as usize]];
        let seen = |order: [u32; 4]| scores(&film(|_, k| Some(hit(place(order[k as usize]), [0.0, 0.0, 1.0]))))[0];
        let once = seen([0, 1, 2, 3]);
        assert!(once > 0.01, "{once}");
        for order in [[3, 2, 1, 0], [1, 0, 3, 2], [2, 3, 0, 1], [1, 2, 3, 0]] {
            assert!((seen(order) - once).abs() < 1e-6 * once, "{order:?}: {} and {once}", seen(order));
        }
    }
}
