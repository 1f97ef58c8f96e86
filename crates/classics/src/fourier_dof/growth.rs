//! Values that grow with the distance from their pixels.

/// For each pixel `p`, the least of `values[q] + slope * distance(p, q)` over all pixels `q`, and the index of that `q`.
///
/// Distances are lengths of paths through neighbours, sides and corners: exact along rows, columns and diagonals, and at most
/// 8.3 % above the straight line. Infinite values do not count.
pub(super) fn least_grown([width, height]: [usize; 2], values: Vec<f32>, slope: f32) -> Vec<(f32, u32)> {
    let mut field: Vec<(f32, u32)> = values.into_iter().zip(0..).collect();
    let (side, corner) = (slope, slope * std::f32::consts::SQRT_2);
    let relax = |field: &mut [(f32, u32)], i: usize, from: usize, step: f32| {
        let (value, source) = field[from];
        if value + step < field[i].0 {
            field[i] = (value + step, source);
        }
    };
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            if x > 0 {
                relax(&mut field, i, i - 1, side);
            }
            if y > 0 {
                relax(&mut field, i, i - width, side);
                if x > 0 {
                    relax(&mut field, i, i - width - 1, corner);
                }
                if x + 1 < width {
                    relax(&mut field, i, i - width + 1, corner);
                }
            }
        }
    }
    for i in (0..width * height).rev() {
        let (x, y) = (i % width, i / width);
        if x + 1 < width {
            relax(&mut field, i, i + 1, side);
        }
        if y + 1 < height {
            relax(&mut field, i, i + width, side);
            if x + 1 < width {
                relax(&mut field, i, i + width + 1, corner);
            }
            if x > 0 {
                relax(&mut field, i, i + width - 1, corner);
            }
        }
    }
    field
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_core::mix;

    #[test]
    fn growth_matches_brute_force_over_paths() {
        for (size, slope) in [([13, 9], 1.0), ([1, 7], 0.5), ([8, 1], 2.0), ([1, 1], 1.0)] {
            let [width, height] = size;
            let pick =
                |i: u64| if mix(i).is_multiple_of(7) { (mix(i ^ 99) % 50) as f32 * 0.1 - 3.0 } else { f32::INFINITY };
            let values: Vec<f32> = (0..(width * height) as u64).map(pick).collect();
            let found = least_grown(size, values.clone(), slope);
            for (i, &(value, source)) in found.iter().enumerate() {
                let path = |q: usize| {
                    let d = [(q % width).abs_diff(i % width), (q / width).abs_diff(i / width)];
                    let (long, short) = (d[0].max(d[1]) as f32, d[0].min(d[1]) as f32);
                    values[q] + slope * (long - short + short * std::f32::consts::SQRT_2)
                };
                let least = (0..values.len()).map(path).fold(f32::INFINITY, f32::min);
                assert!(value == least || (value - least).abs() < 1e-4, "{size:?} {i}: {value} and {least}");
                assert!(value.is_infinite() || (path(source as usize) - value).abs() < 1e-4);
            }
        }
    }
}
