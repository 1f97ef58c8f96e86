//! Depths from positions alone.

/// The pixels at distance 1 that are as wide as this distance. Only the ratios of depths matter.
const STEPS: f32 = 1e3;
/// The radius in pixels over which steps are averaged.
const NEAR: usize = 3;
/// The distance, in steps, up to which a pixel beside belongs to the same surface.
const SAME: f32 = 3.0;

/// The depth of each pixel from the positions around it: the smallest step to a neighbour, averaged over the surface,
/// times [`STEPS`]. It grows with the distance from the camera, wherever that stands.
///
/// Positions are means over places within their pixels, so single steps are noisy. A noisy depth would part pixels of one
/// surface.
pub(super) fn depths([width, height]: [usize; 2], position: &[[f32; 3]], hit: impl Fn(usize) -> bool) -> Vec<f32> {
    let apart = |i: usize, k: usize| (0..3).map(|c| (position[i][c] - position[k][c]).powi(2)).sum::<f32>().sqrt();
    let step = |i: usize| {
        let (x, y) = (i % width, i / width);
        let beside = [
            (x > 0).then(|| i - 1),
            (x + 1 < width).then(|| i + 1),
            (y > 0).then(|| i - width),
            (y + 1 < height).then(|| i + width),
        ];
        let hits = beside.into_iter().flatten().filter(|&k| hit(k));
        hits.map(|k| apart(i, k)).filter(|&step| step > 0.0).reduce(f32::min).unwrap_or(1.0 / STEPS)
    };
    let steps: Vec<f32> = (0..position.len()).map(|i| if hit(i) { step(i) } else { 0.0 }).collect();
    let average = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (mut sum, mut count) = (0.0, 0.0);
        for row in y.saturating_sub(NEAR)..(y + NEAR + 1).min(height) {
            for column in x.saturating_sub(NEAR)..(x + NEAR + 1).min(width) {
                let k = row * width + column;
                let pixels = (column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2)) as f32;
                if steps[k] > 0.0 && apart(i, k) <= SAME * steps[i] * pixels.sqrt() {
                    sum += steps[k];
                    count += 1.0;
                }
            }
        }
        STEPS * sum / count
    };
    (0..position.len()).map(|i| if steps[i] > 0.0 { average(i) } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_of_noisy_positions_follow_the_distance() {
        // A floor that runs away from the camera: row y is 1 / (y + 1) wide per pixel. Every place is off by up to half a step.
        let size = [24, 16];
        let row = |i: usize| (i / 24) as f32;
        let noise = |i: usize| ((i * 7919) % 1009) as f32 / 1009.0 - 0.5;
        let width = |i: usize| 1.0 + 0.02 * row(i);
        let position: Vec<[f32; 3]> =
            (0..384).map(|i| [width(i) * ((i % 24) as f32 - 12.0 + 0.3 * noise(i)), 0.0, 4.0 * row(i)]).collect();
        let found = depths(size, &position, |_| true);
        for (i, depth) in found.iter().enumerate() {
            let relative = depth / (STEPS * width(i));
            assert!((0.8..1.1).contains(&relative), "pixel {i}: {relative}");
        }
    }

    #[test]
    fn misses_have_no_depth_and_lone_pixels_a_finite_one() {
        let found = depths([3, 1], &[[1.0, 2.0, 3.0], [0.0; 3], [5.0, 2.0, 3.0]], |i| i != 1);
        assert!(found[1] == 0.0 && found[0] > 0.0 && found[2].is_finite(), "{found:?}");
    }
}
