//! Depths from positions alone.

/// The pixels at distance 1 that are as wide as this distance. Only the ratios of depths matter.
const STEPS: f32 = 1e3;

/// The depth of each pixel from the positions around it: the smallest step to a neighbour, times [`STEPS`]. It grows
/// with the distance from the camera, wherever that stands.
pub(super) fn depths([width, height]: [usize; 2], position: &[[f32; 3]], hit: impl Fn(usize) -> bool) -> Vec<f32> {
    let apart = |i: usize, k: usize| {
        let square: f32 = (0..3).map(|c| (position[i][c] - position[k][c]).powi(2)).sum();
        (hit(k) && square > 0.0).then(|| square.sqrt())
    };
    let step = |i: usize| {
        let (x, y) = (i % width, i / width);
        let beside = [
            (x > 0).then(|| i - 1),
            (x + 1 < width).then(|| i + 1),
            (y > 0).then(|| i - width),
            (y + 1 < height).then(|| i + width),
        ];
        beside.into_iter().flatten().filter_map(|k| apart(i, k)).reduce(f32::min)
    };
    (0..position.len()).map(|i| if hit(i) { STEPS * step(i).unwrap_or(1.0 / STEPS) } else { 0.0 }).collect()
}
