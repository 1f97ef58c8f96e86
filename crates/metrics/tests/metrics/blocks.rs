//! Block means, their ratios, and averaging to another size.

use approx::assert_relative_eq;
use dapple_metrics::{MetricsError, Pixels, block_means, block_ratios, downsample};

fn pixels(size: [u32; 2], values: &[[f32; 3]]) -> Pixels<'_> {
    Pixels::new(size, values).unwrap()
}

fn ramp(count: usize) -> Vec<[f32; 3]> {
    (0..count).map(|i| [i as f32, 2.0 * i as f32, 1.0]).collect()
}

#[test]
fn block_means_are_those_of_whole_blocks() {
    let image = ramp(35);
    let blocks = block_means(pixels([7, 5], &image), [3, 2]).unwrap();
    assert_eq!(blocks.count, [2, 2]);
    // The first block: 0, 1, 2, 7, 8, 9; the next is 3 to the right, then 14 down.
    assert_eq!(blocks.means.iter().map(|m| m[0]).collect::<Vec<_>>(), [4.5, 7.5, 18.5, 21.5]);
    assert_eq!(blocks.means[3], [21.5, 43.0, 1.0]);
    for block in [[0, 1], [8, 1], [1, 6]] {
        assert_eq!(block_means(pixels([7, 5], &image), block), Err(MetricsError::Block { block, size: [7, 5] }));
    }
}

#[test]
fn dark_blocks_do_not_count_in_ratios_and_percentiles() {
    // Blocks of one pixel. The median is 2; 2 % of it is 0.04, so 0 and 0.03 do not count, 0.05 does.
    let reference = [0.0, 0.03, 0.05, 2.0, 2.0, 4.0, 8.0].map(|v| [v; 3]);
    let image = [9.0, 9.0, 0.05, 1.0, 2.0, 6.0, 16.0].map(|v| [v, v, 0.0]);
    let ratios = block_ratios(pixels([7, 1], &image), pixels([7, 1], &reference), [1, 1]).unwrap();
    assert_eq!(ratios.count(0), 5);
    assert_eq!(ratios.sorted(1), [0.5, 1.0, 1.0, 1.5, 2.0]);
    assert_eq!([ratios.percentile(0.0)[0], ratios.percentile(50.0)[0], ratios.percentile(100.0)[0]], [0.5, 1.0, 2.0]);
    assert_relative_eq!(ratios.percentile(90.0)[1], 1.8, max_relative = 1e-12);
    assert_eq!(ratios.percentile(50.0)[2], 0.0);
    // A channel that is dark beside the others does not count: 2 % of the median of 1, 1 and 0.01 is 0.02.
    let blue = block_ratios(pixels([1, 1], &image[..1]), pixels([1, 1], &[[1.0, 1.0, 0.01]]), [1, 1]).unwrap();
    assert_eq!([0, 1, 2].map(|c| blue.count(c)), [1, 1, 0]);
    let black = [[0.0; 3]; 7];
    let none = block_ratios(pixels([7, 1], &image), pixels([7, 1], &black), [1, 1]).unwrap();
    assert!(none.count(0) == 0 && none.percentile(50.0)[0].is_nan());
}

#[test]
fn downsampling_averages_by_area() {
    let image = ramp(6);
    // Three columns to two: each new one holds an old one and half of the middle one.
    let found = downsample(pixels([3, 2], &image), [2, 1]).unwrap();
    // Columns hold 0, 3 | 1, 4 | 2, 5: means 1.5, 2.5, 3.5.
    assert_relative_eq!(found[0][0], (1.5 + 0.5 * 2.5) / 1.5, max_relative = 1e-6);
    assert_relative_eq!(found[1][0], (0.5 * 2.5 + 3.5) / 1.5, max_relative = 1e-6);
    assert_eq!(downsample(pixels([3, 2], &image), [3, 2]).unwrap(), image);
    for target in [[4, 2], [3, 3], [0, 1]] {
        assert_eq!(downsample(pixels([3, 2], &image), target), Err(MetricsError::Target { size: [3, 2], target }));
    }
}

#[test]
fn downsampling_by_whole_numbers_gives_block_means() {
    let image = ramp(12 * 6);
    let found = downsample(pixels([12, 6], &image), [4, 3]).unwrap();
    let means = block_means(pixels([12, 6], &image), [3, 2]).unwrap().means;
    assert_eq!(found, means.iter().map(|m| m.map(|v| v as f32)).collect::<Vec<_>>());
}
