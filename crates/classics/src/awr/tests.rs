use super::*;
use crate::test_films::noisy_film;
use dapple_core::{BudgetLeft, Progress, Sampler as _};
use dapple_low_discrepancy::Sobol;

const NEEDS: Needs = Needs::none().with_variance();

fn queue(film: &Film, options: &AwrOptions) -> Queue {
    let total = 4 * film.counts().iter().sum::<u64>();
    let seen = Feedback::new(1, film, BudgetLeft::new(total).with_spent(total / 4));
    Queue::new(&seen, options).expect("a film with variance")
}

fn haar() -> AwrOptions {
    AwrOptions::default().basis(Basis::Haar)
}

/// A constant image with noise of one variance, known exactly.
fn white(seed: u64) -> Film {
    noisy_film([128, 128], 4, NEEDS, seed, |_, _| 10.0, |_, _| 1.0)
}

#[test]
fn on_noise_the_published_priority_cancels_and_the_debiased_key_is_flat_over_levels() {
    let mean = |priority: BlockPriority| -> Vec<f64> {
        let queues = (0..8).map(|seed| queue(&white(seed), &haar().priority(priority)));
        let keys = |queue: Queue| -> Vec<f64> {
            let of =
                |blocks: &Vec<WaveletBlock>| blocks.iter().map(WaveletBlock::key).sum::<f64>() / blocks.len() as f64;
            queue.levels.iter().map(of).collect()
        };
        queues.map(keys).fold(vec![0.0; 6], |sums, keys| sums.iter().zip(keys).map(|(s, k)| s + k / 8.0).collect())
    };
    let [published, debiased] = [BlockPriority::Published, BlockPriority::Debiased].map(mean);
    let variance = 0.25 / 100.0; // 4 samples, relative
    for level in 1..=3 {
        // The mean square of the wavelets is the variance: 3 %, and 6 % of 512 blocks at level 4.
        assert!(published[level].abs() < 0.06 * variance, "level {level}: {}", published[level]);
        // The excess of a sum of three squares over its mean is 0.3 of it on average.
        let ratio = debiased[level] / debiased[1];
        assert!((ratio - 1.0).abs() < 0.06, "level {level}: {ratio}");
    }
    assert!((debiased[0] / variance - 1.0).abs() < 0.03, "{}", debiased[0]);
}

#[test]
fn equal_keys_go_to_the_coarsest_block() {
    let waiting = (0..6).flat_map(|level| (0..4).map(move |block| waiting(1.0, level, block)));
    let order: Vec<u32> = waiting.collect::<BinaryHeap<_>>().into_sorted_vec().iter().rev().map(|w| w.1).collect();
    assert!(order.is_sorted_by(|a, b| a >= b) && order[0] == 5);
}

#[test]
fn an_edge_is_sampled_by_small_blocks_and_flat_noise_by_large_ones() {
    // One edge and noise of equal variance left and right.
    let image = |x: u32, _: u32| if x < 37 { 10.0 } else { 20.0 };
    let film = noisy_film([128, 64], 16, NEEDS, 4, image, |x, _| if x < 37 { 1.0 } else { 2.0 });
    let queue = queue(&film, &haar());
    let keys = |level: usize, columns: std::ops::Range<usize>| {
        let width = queue.sizes[level][0];
        let blocks = queue.levels[level].iter().enumerate().filter(|(i, _)| columns.contains(&(i % width)));
        let (sum, number) = blocks.fold((0.0, 0.0), |(sum, n), (_, block)| (sum + block.key(), n + 1.0));
        sum / number
    };
    for level in 1..=4 {
        let [edge, flat] = [keys(level, 37 >> level..(37 >> level) + 1), keys(level, 64 >> level..128 >> level)];
        assert!(edge < 0.0 && flat > 0.0, "level {level}: {edge} at the edge, {flat} on flat noise");
    }
    assert!(keys(0, 37..38) > 0.0, "the pixels at the edge are sampled by themselves");
}

#[test]
fn samples_go_where_the_variance_is_and_lower_it() {
    for basis in [Basis::Cdf97, Basis::Cdf53, Basis::Haar] {
        let film = noisy_film([64, 64], 4, NEEDS, 6, |_, _| 10.0, |x, _| if x < 32 { 0.1 } else { 2.0 });
        let mut queue = queue(&film, &AwrOptions::default().basis(basis));
        let before = queue.levels[5].iter().map(|block| block.sum).sum::<f64>();
        assert_eq!(queue.hand_out(4096), 0);
        let added: Vec<u32> = queue.pixels.iter().map(|pixel| pixel.added).collect();
        assert_eq!(added.iter().sum::<u32>(), 4096);
        let right: u32 = added.iter().enumerate().filter(|(i, _)| i % 64 >= 32).map(|(_, n)| n).sum();
        assert!(right > 3500, "{basis:?}: {right} of 4096");
        let after = queue.levels[5].iter().map(|block| block.sum).sum::<f64>();
        let of = |pixel: &PixelCount| pixel.variance / f64::from(pixel.before + pixel.added);
        let exact = queue.pixels.iter().map(of).sum::<f64>();
        assert!(after < before && (after / exact - 1.0).abs() < 1e-9, "{before} {after} {exact}");
    }
}

#[test]
fn constant_images_get_even_counts() {
    let film = noisy_film([32, 32], 4, NEEDS, 6, |_, _| 10.0, |_, _| 0.0);
    let mut plan = Plan::empty(1024);
    let seen = Feedback::new(1, &film, BudgetLeft::new(8 * 1024).with_spent(4 * 1024));
    let answer = Awr::new(Sobol::new(1)).next_round(&seen, &mut plan);
    assert!(matches!(answer, Ok(Progress::Trace)), "{answer:?}");
    assert!(plan.counts.iter().all(|n| *n == 1), "a quarter of what is left, evenly");
}

/// Blocks whose variance never falls would take all samples.
#[test]
fn a_small_noisy_lamp_shares_its_samples_evenly() {
    let is_lamp = |x: u32, y: u32| (29..37).contains(&x) && (13..21).contains(&y);
    let image = move |x: u32, y: u32| if is_lamp(x, y) { 1000.0 } else { 1.0 };
    let noise = move |x: u32, y: u32| if is_lamp(x, y) { 200.0 } else { 0.01 };
    let film = noisy_film([64, 64], 4, NEEDS, 6, image, noise);
    for basis in [Basis::Cdf97, Basis::Cdf53, Basis::Haar] {
        let mut queue = queue(&film, &AwrOptions::default().basis(basis));
        queue.hand_out(4096);
        let near = |i: &usize| (27..39).contains(&(i % 64)) && (11..23).contains(&(i / 64));
        let (lamp, rest): (Vec<usize>, Vec<usize>) = (0..4096).partition(near);
        let added = |pixels: &[usize]| pixels.iter().map(|&i| queue.pixels[i].added).sum::<u32>();
        assert!(added(&lamp) > 2 * added(&rest), "{basis:?}: {} in the lamp", added(&lamp));
        let most = queue.pixels.iter().map(|pixel| pixel.added).max();
        assert!(most < Some(4 * 4096 / 64), "{basis:?}: a pixel gets {most:?} samples of 64 on average");
    }
}

#[test]
fn a_large_block_samples_all_its_pixels() {
    let mut queue = queue(&white(1), &haar());
    assert_eq!((0..64).map(|_| queue.sample(5, 0, 64)).sum::<u64>(), 4096);
    let block: Vec<u32> = (0..1024).map(|i| queue.pixels[i / 32 * 128 + i % 32].added).collect();
    assert!(block.iter().all(|n| (1..=9).contains(n)), "{:?}", block.iter().min().zip(block.iter().max()));
    assert_eq!(block.iter().sum::<u32>(), 4096);
}
