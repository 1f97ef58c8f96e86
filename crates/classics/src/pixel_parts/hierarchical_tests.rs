use super::*;
use crate::Role;
use crate::tree::test_scenes::{domain, film_points, render};
use dapple_core::Filter;
use dapple_core::samplers::Uniform;
use dapple_low_discrepancy::Random;

fn hierarchical(seed: u64) -> Hierarchical<Random> {
    Hierarchical::new(Random::new(seed), &domain(&[Role::Time]), HierarchicalOptions::default()).unwrap()
}

#[test]
fn a_step_over_time_has_less_error_than_random_samples() {
    let step = |_: [f32; 2], rest: [f32; 4]| f32::from(u8::from(rest[2] < 0.3));
    // Error of the parts' sum, of the plain mean of the same samples, and of random samples; 64 samples in one pixel.
    let errors = |seed| {
        let mut sampler = hierarchical(seed);
        let points = film_points(Random::new(seed), &[Role::Time], Some(sampler.placed()));
        let filter = TreeMean::new(points, TreeMeanOptions::default().tree(PartRule::Contrast)).unwrap();
        let film = render(step, &mut sampler, [1, 1], 64.0);
        let random = render(step, &mut Uniform::new(Random::new(seed)), [1, 1], 64.0);
        let images = [filter.apply(&film).unwrap().radiance[0], film.image()[0], random.image()[0]];
        images.map(|x| f64::from(x[0]) - 0.3)
    };
    let all: Vec<[f64; 3]> = (0..200).map(errors).collect();
    let mean = |of: &dyn Fn(&[f64; 3]) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
    let [parts, plain, random] = [0, 1, 2].map(|k| (mean(&|e| e[k] * e[k]), mean(&|e| e[k])));
    // The variance of random samples is 0.21 / 64 = 0.0033, with a standard error of 10 % over 200 pixels.
    assert!((random.0 - 0.0033).abs() < 0.0007, "{random:?}");
    assert!(parts.0 < 0.15 * random.0 && parts.1.abs() < 0.005, "parts {parts:?}, random {random:?}");
    assert!(plain.1.abs() > 0.03, "the plain mean of these samples is biased: {plain:?}");
}

#[test]
fn volumes_of_parts_sum_to_one_exactly() {
    let mut cell = Cell { size: [1, 1], axes: 5, ..Cell::default() };
    for k in 0..500 {
        let mut at = At::default();
        (0..5).for_each(|axis| at[axis] = unit(k * 8 + axis as u64));
        cell.values.push([at[3] + at[0] * at[4]; 3]);
        cell.at.push(at);
    }
    let (mut volume, mut samples) = (0.0, 0);
    leaves(&ContrastingHalves { split: 4 }, &cell, &mut |leaf| {
        volume += leaf.bounds.volume(5);
        samples += leaf.items.len();
    });
    assert_eq!((volume, samples), (1.0, 500));
}

#[test]
fn the_first_cut_follows_the_axis_of_the_function() {
    for axis in 0..4 {
        let mut cell = Cell { size: [1, 1], axes: 4, ..Cell::default() };
        for k in 0..64 {
            let mut at = At::default();
            (0..4).for_each(|axis| at[axis] = unit(k * 8 + axis as u64));
            cell.values.push([f32::from(u8::from(at[axis] < 0.5)); 3]);
            cell.at.push(at);
        }
        let bounds = Bounds { low: At::default(), high: [1.0; Domain::MOST] };
        let mut items: Vec<u32> = (0..64).collect();
        let cut = ContrastingHalves { split: 4 }.cut(&cell, &mut items, &bounds, 0);
        assert_eq!(cut, Some((axis, 0.5)));
    }
}
