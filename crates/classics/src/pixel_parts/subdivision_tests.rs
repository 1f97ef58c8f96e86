use super::*;
use crate::tree::test_scenes::{domain, film_points, render};
use dapple_core::Filter;
use dapple_low_discrepancy::Sobol;

fn subdivision(seed: u64, options: SubdivisionOptions) -> Subdivision<Sobol> {
    Subdivision::new(Sobol::new(seed), &domain(&[]), options).unwrap()
}

/// Adds samples in the middle of each quadrant of the parts that the edge at x = 1/3 does not cross, and of those it crosses
/// after `level` splits.
fn fill(cell: &mut Cell, [x, y, side]: [f32; 3], level: u32) {
    let crossed = 3.0 * x < 1.0 && 3.0 * (x + side) > 1.0;
    for (right, down) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let half = 0.5 * side;
        let (x, y) = (x + right * half, y + down * half);
        if crossed && level > 0 {
            fill(cell, [x, y, half], level - 1);
        } else {
            let mut at = At::default();
            (at[0], at[1]) = (x + 0.5 * half, y + 0.5 * half);
            cell.values.push([f32::from(u8::from(3.0 * at[0] < 1.0)); 3]);
            cell.at.push(at);
        }
    }
}

#[test]
fn the_error_at_an_edge_halves_with_every_split() {
    for (level, expected) in [(0, 0.1667), (1, 0.0833), (2, 0.0417), (3, 0.0208), (4, 0.0104)] {
        let mut cell = Cell { size: [1, 1], axes: 2, ..Cell::default() };
        fill(&mut cell, [0.0, 0.0, 1.0], level);
        let (mut sum, mut parts) = (0.0, 0);
        leaves(&Quadrants, &cell, &mut |leaf| {
            assert_eq!(leaf.items.len(), 4, "a part after {level} splits");
            sum += leaf.bounds.volume(2) * mean(&cell, leaf.items)[0];
            parts += 4;
        });
        assert_eq!(parts, cell.at.len());
        assert!(((sum - 1.0 / 3.0).abs() - expected).abs() < 1e-4, "{level} splits: {sum}");
    }
}

#[test]
fn areas_remove_the_bias_of_split_parts() {
    let edge = |place: [f32; 2], _: [f32; 4]| f32::from(u8::from(place[0].fract() < 0.2));
    let mut sampler = subdivision(4, SubdivisionOptions::default());
    let filter = TreeMean::new(film_points(Sobol::new(4), &[], Some(sampler.placed())), TreeMeanOptions::default());
    let film = render(edge, &mut sampler, [8, 8], 200.0);
    let image = filter.unwrap().apply(&film).unwrap().radiance;
    let error = |image: &[[f32; 3]]| image.iter().map(|x| f64::from(x[0] - 0.2).abs()).sum::<f64>() / 64.0;
    let (plain, weighted) = (error(&film.image()), error(&image));
    assert!(plain > 0.1 && weighted < 0.1 * plain, "{plain} and {weighted}");
}

#[test]
fn a_constant_image_gets_four_samples_per_pixel_and_the_rest_by_index() {
    let constant = |_: [f32; 2], _: [f32; 4]| 0.5;
    let options = SubdivisionOptions::default();
    let film = render(constant, &mut subdivision(1, options), [10, 1], 4.0);
    assert_eq!(film.counts(), [4; 10]);
    let film = render(constant, &mut subdivision(1, options), [10, 1], 4.0 + 3.6);
    assert_eq!(film.counts(), [16, 16, 16, 4, 4, 4, 4, 4, 4, 4]);
}

#[test]
fn the_pilot_has_one_sample_in_each_quadrant() {
    for seed in 0..50 {
        let all = (0..4).fold(0, |bits, number| {
            let at = SubdivisionOptions::default().pilot_sample(number, mix(seed)).unwrap();
            assert!(at[..2].iter().all(|x| (0.0..1.0).contains(x)));
            bits | 1 << part(&at, &Bounds { low: At::default(), high: [1.0; Domain::MOST] }, 2)
        });
        assert_eq!(all, 0xf);
    }
}
