//! Parts of filters that images alone hardly show: kernels, functions, copies of planes, votes and depths.

use crate::buffers::film::{STEPS, depths};
use crate::cluster_gaussian::Votes;
use crate::features::ln;
use crate::gaussian::{NEGLIGIBLE, erfc, gaussian_weights};
use crate::graph::{Graph, Plane, Reach, all};
use crate::inputs::BACKGROUND;
use crate::planes::{box_mean_of, map, planes_of};
use crate::tile::{self, COLUMNS, MARGIN, Place, Stack, WIDTH, exp_minus};
use std::sync::Mutex;

#[test]
fn exponentials_and_logarithms_are_accurate() {
    for k in 0..80_000 {
        let x = k as f32 * 1e-3;
        let (got, wanted) = (f64::from(exp_minus(x)), (-f64::from(x)).exp());
        // Rounding x * log2 e costs another x * 6e-8.
        assert!((got / wanted - 1.0).abs() < 4e-6 + 2e-7 * f64::from(x), "{x}: {got}, not {wanted}");
    }
    assert_eq!((exp_minus(0.0), ln(1.0)), (1.0, 0.0));
    assert!(exp_minus(f32::INFINITY) < 1e-34 && exp_minus(1e9) > 0.0);
    let near_one = (0..20_000).map(|k| 0.5 + k as f32 * 1e-4);
    let all = (-59..=59).map(|e| 2.0f32.powi(e) * 1.1).chain(near_one).chain([1e-18, 1e18, 2e18, f32::MIN_POSITIVE]);
    for x in all {
        let (got, wanted) = (f64::from(ln(x)), f64::from(x).ln());
        assert!((got - wanted).abs() <= 2.4e-7 * wanted.abs().max(1.0), "{x}: {got}, not {wanted}");
    }
}

/// Composite Simpson rule over the pixel with 20,000 intervals.
fn by_simpson(alpha: f64, radius: f64, k: f64) -> f64 {
    let kernel = |x: f64| ((-alpha * x * x).exp() - (-alpha * radius * radius).exp()).max(0.0);
    let (a, b) = ((k - 0.5).max(-radius), (k + 0.5).min(radius));
    let n = 20_000;
    let h = (b - a) / f64::from(n);
    let inner: f64 = (1..n).map(|i| kernel(a + h * f64::from(i)) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
    h / 3.0 * (kernel(a) + inner + kernel(b))
}

const CASES: [[f64; 2]; 10] = [
    [0.5, 4.0],
    [0.5, 8.0],
    [2.0, 1.5],
    [2.0, 0.3],
    [0.01, 64.0],
    [1e-4, 20.0],
    [3.9, 0.5],
    [30.0, 2.0],
    [0.062, 4.0],
    [0.063, 4.0],
];

#[test]
fn weights_are_the_integrals_of_the_kernel_f08() {
    for [alpha, radius] in CASES {
        let weights = gaussian_weights(alpha, radius);
        let n = (weights.len() / 2) as i32;
        let reach = n + 5;
        let integrals: Vec<f64> = (-reach..=reach)
            .map(|k| if f64::from(k.abs()) - 0.5 < radius { by_simpson(alpha, radius, k.into()) } else { 0.0 })
            .collect();
        let total: f64 = integrals.iter().sum();
        for k in -reach..=reach {
            let got = if k.abs() <= n { weights[(k + n) as usize] } else { 0.0 };
            let wanted = integrals[(k + reach) as usize] / total;
            assert!((got - wanted).abs() < 1e-12, "alpha {alpha} radius {radius} pixel {k}: {got}, not {wanted}");
        }
    }
}

#[test]
fn weights_are_symmetric_positive_end_at_the_radius_and_sum_to_one_f08() {
    let extreme = [[f64::MIN_POSITIVE, 64.0], [f64::MAX, 64.0], [1.0, f64::MIN_POSITIVE], [1e-12, 3.0], [1e12, 3.0]];
    for [alpha, radius] in CASES.into_iter().chain(extreme) {
        let weights = gaussian_weights(alpha, radius);
        let n = weights.len() / 2;
        assert_eq!(weights.len() % 2, 1);
        assert!(n as f64 - 0.5 < radius, "alpha {alpha} radius {radius}: {n} pixels to a side");
        assert!(weights.iter().all(|w| *w >= NEGLIGIBLE && *w <= 1.0 + 1e-15), "alpha {alpha} radius {radius}");
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14, "alpha {alpha} radius {radius}");
        for k in 0..n {
            assert_eq!(weights[k].to_bits(), weights[2 * n - k].to_bits());
            assert!(weights[k] <= weights[k + 1]);
        }
    }
}

#[test]
fn a_flat_gaussian_is_a_parabola() {
    // The kernel tends to alpha (r^2 - x^2): over -1/2 .. 1/2 and the two parts up to r = 1.
    let weights = gaussian_weights(1e-200, 1.0);
    let centre = (1.0 - 1.0 / 12.0) / (4.0 / 3.0);
    assert!((weights[1] - centre).abs() < 1e-15, "{weights:?}");
}

#[test]
fn erfc_matches_published_values() {
    // [Abramowitz and Stegun 1964, table 7.1] for erf 0.5 and 1; at 3 series and fraction meet.
    assert!((erfc(0.5) - (1.0 - 0.520_499_877_8)).abs() < 1e-10);
    assert!((erfc(1.0) - (1.0 - 0.842_700_792_9)).abs() < 1e-10);
    assert_eq!(erfc(0.0), 1.0);
    let (below, above) = (erfc(3.0 - 1e-15), erfc(3.0));
    assert!((below - above).abs() < 1e-15, "{below} {above}");
    assert_eq!(erfc(1e200), 0.0);
}

/// Rows are made some at a time, which must not show.
#[test]
fn means_over_windows_are_those_of_all_their_pixels() {
    for ([width, height], radius) in [([37, 150], 1), ([70, 97], 3), ([5, 200], 10), ([64, 33], 20), ([1, 1], 2)] {
        let plane: Vec<f32> = (0..width * height).map(|i| ((i * 7919) % 1009) as f32).collect();
        let mean = box_mean_of(&plane, [width, height], radius);
        let near = |k: usize, end: usize| (0..=2 * radius).map(move |d| (k + d).saturating_sub(radius).min(end - 1));
        for (i, found) in mean.iter().enumerate() {
            let value = |y: usize| near(i % width, width).map(|x| f64::from(plane[y * width + x])).sum::<f64>();
            let wanted = near(i / width, height).map(value).sum::<f64>() / ((2 * radius + 1) as f64).powi(2);
            let apart = (f64::from(*found) - wanted).abs();
            assert!(apart <= 1e-5 * wanted, "{found}, not {wanted}: {i}, radius {radius}");
        }
    }
}

#[test]
fn planes_hold_what_is_computed_of_each_pixel() {
    let graph = Graph::new([100, 90]);
    let [a, b] = planes_of(&graph, |i| [i as f32, 2.0 * i as f32]);
    let planes = map(&graph, [a, b], |[a, b]| [a + b, b - a]);
    let [sum, difference] = graph.collect(planes);
    assert!((0..9000).all(|i| sum[i] == (3 * i) as f32 && difference[i] == i as f32));
}

/// A pass makes every row that is read, once and in order, and no plane keeps more rows than its readers reach.
#[test]
fn rows_are_made_once_as_they_are_read() {
    let made = Mutex::new(Vec::new());
    let graph = Graph::new([3, 200]);
    let [own] = graph.rows(Vec::new(), |_, y, [to]: [&mut [f32]; 1]| {
        made.lock().unwrap().push(y);
        to.fill(y as f32);
    });
    let [unread] = graph.rows(all([own], Reach::rows(0)), |_, _, _: [&mut [f32]; 1]| panic!("nothing reads this"));
    assert_ne!(format!("{own:?}"), format!("{unread:?}"));
    let coarse = graph.tiles(
        ([1, 20], 1),
        all([own], Reach::from_fine(10, 0)),
        || (),
        |(), rows, [_, tile]| vec![(10 * tile..10 * tile + 10).map(|y| rows.row(own, y)[0]).sum()],
    )[0];
    let mut reads = all([own], Reach::rows(7));
    reads.extend(all([coarse], Reach::from_coarse(10, 0)));
    let [sum] = graph.rows(reads, |rows, y, [to]: [&mut [f32]; 1]| {
        let near = (y.saturating_sub(7)..(y + 8).min(200)).map(|y| rows.row(own, y)[0]).sum::<f32>();
        to.fill(near + rows.row(coarse, y / 10)[0]);
    });
    graph.run(&[sum], |rows, range| {
        for y in range.clone() {
            let near = (y.saturating_sub(7)..(y + 8).min(200)).sum::<usize>();
            let tile = (y / 10 * 10..y / 10 * 10 + 10).sum::<usize>();
            assert_eq!(rows.row(sum, y), [(near + tile) as f32; 3]);
        }
        assert!(rows.kept(own) <= 15 + 10 && rows.kept(sum) == range.len() && rows.kept(unread) == 0);
    });
    let mut made = made.into_inner().unwrap();
    made.sort_unstable();
    assert_eq!(made, (0..200).collect::<Vec<_>>());
}

fn place(size: [usize; 2], origin: [usize; 2]) -> Place {
    Place { size, origin, margin: MARGIN }
}

/// A copy of a tile of two planes whose values are those of `value` at each pixel.
fn copied(size: [usize; 2], origins: &[[usize; 2]], value: impl Fn(usize) -> f32 + Sync) -> Stack<2> {
    let tile = Mutex::new(Stack::default());
    let graph = Graph::new(size);
    let planes: [Plane; 2] = planes_of(&graph, |i| [value(i); 2]);
    let reads = all(planes, Reach::from_fine(size[1], 0));
    let whole = graph.tiles(
        ([1, 1], 1),
        reads,
        || (),
        |(), rows, _| {
            origins.iter().for_each(|origin| tile.lock().unwrap().copy(rows, planes, place(size, *origin)));
            Vec::new()
        },
    );
    let end = graph.rows(all(whole, Reach::from_coarse(size[1], 0)), |_, _, _| ());
    let [_] = graph.collect(end);
    tile.into_inner().unwrap()
}

#[test]
fn moved_rows_hold_the_moved_pixels() {
    let tile = copied([150, 40], &[[0, 0], [64, 16]], |i| i as f32);
    for (y, parity, dx, dy) in [(0, 0, 0, 0), (3, 1, -7, 7), (15, 0, -7, -7), (8, 1, 7, 0), (8, 0, 6, 1)] {
        let row = tile.moved(y, parity, [dx, dy]);
        assert_eq!(row.len(), COLUMNS + tile::LANES);
        for (i, value) in row[COLUMNS..].iter().enumerate() {
            let x = (64 + 2 * i as isize + parity as isize + dx).clamp(0, 149);
            let y = (16 + y as isize + dy).clamp(0, 39);
            assert_eq!(*value, (y * 150 + x) as f32);
        }
    }
}

#[test]
fn planes_are_cleared_beyond_the_frame_only() {
    for (width, height, origin) in [(150, 40, [0, 0]), (150, 40, [128, 32]), (3, 1, [0, 0]), (65, 17, [64, 16])] {
        let mut tile = copied([width, height], &[origin], |_| 1.0);
        tile.clear_outside(1, place([width, height], origin));
        for (at, value) in tile.0.iter().enumerate() {
            let (row, within) = (at / (4 * COLUMNS), at % (4 * COLUMNS));
            let (parity, k, column) = (within / (2 * COLUMNS), within / COLUMNS % 2, within % COLUMNS);
            if 2 * column + parity >= WIDTH + 2 * MARGIN {
                continue;
            }
            let inside = (MARGIN..MARGIN + width).contains(&(origin[0] + 2 * column + parity))
                && (MARGIN..MARGIN + height).contains(&(origin[1] + row));
            assert_eq!(*value, f32::from(u8::from(inside || k == 0)), "row {row}, column {column}, {parity}, {k}");
        }
    }
}

fn votes(labels: &[u32]) -> Votes {
    Votes::of(labels.iter().copied())
}

#[test]
fn overlap_is_the_common_share() {
    let cases: [(&[u32], &[u32], f64); 9] = [
        (&[3], &[3], 1.0),
        (&[3], &[4], 0.0),
        (&[3, 3, 3], &[3], 1.0),
        (&[BACKGROUND], &[BACKGROUND, BACKGROUND], 1.0),
        (&[7, 3, 7, 3], &[3, 3], 0.5),
        (&[9, 1, 1, 1], &[1, 9, 9, 9], 0.5),
        (&[1, 2, 3, 4, 5, 6, 7, 8], &[8, 7, 6, 5, 4, 3, 2, 1], 1.0),
        (&[1, 2, 3, 4, 5, 6, 7, 8], &[0, 8, 9], 0.125),
        (&[], &[5, 6], 1.0),
    ];
    for (a, b, wanted) in cases {
        assert_eq!(votes(a).overlap(&votes(b)), wanted, "{a:?} {b:?}");
        assert_eq!(votes(b).overlap(&votes(a)), wanted, "{b:?} {a:?}");
    }
}

#[test]
fn a_ninth_vote_is_not_counted() {
    assert_eq!(votes(&[2; 9]), votes(&[2; 8]));
}

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
