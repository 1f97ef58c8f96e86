//! Learned light selection.

use dapple_light_selection::{Guidance, LightCellOptions, LightCells};

const BOX: [[f32; 3]; 2] = [[0.0; 3], [4.0, 2.0, 1.0]];
const UP: [f32; 3] = [0.0, 0.0, 1.0];

fn table(lights: usize, expected: impl Fn([f32; 3], f32, [f32; 3], usize) -> f32 + Sync) -> LightCells {
    let options = LightCellOptions { resolution: 8, ..LightCellOptions::default() };
    LightCells::new(BOX, lights, &options, expected).unwrap().unwrap()
}

/// The same expectation for all lights.
fn alike(_: [f32; 3], _: f32, _: [f32; 3], _: usize) -> f32 {
    1.0
}

fn sums_to_one(cells: &LightCells) {
    for cell in 0..cells.cells() as u32 {
        let shares: Vec<f32> = (0..cells.lights() as u32).map(|light| cells.pmf(cell, light)).collect();
        assert_eq!(shares.iter().map(|p| f64::from(*p)).sum::<f64>(), 1.0);
        let steps = (1 << 24) as f32;
        let least = 0.99 * 0.1 / cells.lights() as f32;
        assert!(shares.iter().all(|p| (p * steps).fract() == 0.0 && *p >= least), "{shares:?}");
    }
}

#[test]
fn cells_separate_places_and_sides() {
    let cells = table(2, alike);
    assert_eq!(cells.cells(), 8 * 4 * 2 * 6);
    let at = |p| cells.cell(p, UP);
    assert_eq!(at([0.1, 0.1, 0.1]), at([0.4, 0.4, 0.4]));
    assert_ne!(at([0.1, 0.1, 0.1]), at([0.6, 0.1, 0.1]));
    let normals = [[1.0, 0.2, -0.3], [-1.0, 0.2, 0.3], [0.2, 1.0, 0.3], [0.2, -1.0, 0.3], UP, [0.0, 0.0, -1.0]];
    let mut sides: Vec<u32> = normals.iter().map(|&n| cells.cell([1.0; 3], n)).collect();
    sides.dedup();
    assert_eq!(sides.len(), 6);
    // Points outside the bounds and invalid points have a cell too.
    for odd in [[-1e30; 3], [1e30; 3], [f32::NAN; 3], [f32::INFINITY; 3], [f32::NEG_INFINITY; 3]] {
        assert!((cells.cell(odd, odd) as usize) < cells.cells(), "{odd:?}");
    }
}

#[test]
fn lights_are_chosen_with_their_stated_probability() {
    for lights in [2, 5, 9, 64, 65, 100] {
        let cells = table(lights, |middle, _, _, light| 1.0 + middle[0] * light as f32);
        sums_to_one(&cells);
        let cell = cells.cell([3.0, 1.0, 0.5], UP);
        let mut found = vec![0u32; lights];
        const STEPS: u32 = 1 << 16;
        for i in 0..STEPS {
            let (light, pmf) = cells.sample(cell, (i as f32 + 0.5) / STEPS as f32);
            assert_eq!(pmf, cells.pmf(cell, light));
            found[light as usize] += 1;
        }
        for (light, &n) in found.iter().enumerate() {
            let wanted = cells.pmf(cell, light as u32) * STEPS as f32;
            assert!((n as f32 - wanted).abs() <= 1.0, "light {light} of {lights}: {n} instead of {wanted}");
        }
        assert_eq!(cells.sample(cell, 1.0).0 as usize, lights - 1, "no coordinate is out of range");
    }
}

/// Light 0 contributes on the left only, light 1 on the right only.
fn notes(cells: &LightCells) -> Vec<(u64, u64, f64)> {
    let mut notes = Vec::new();
    for x in 0..8 {
        let cell = cells.cell([x as f32 * 0.5 + 0.25, 0.6, 0.1], UP);
        for light in 0..2 {
            let lit = (x < 4) == (light == 0);
            notes.push((cells.key(cell, light), 100, if lit { 100.0 } else { 0.0 }));
        }
    }
    notes
}

#[test]
fn learned_probabilities_follow_the_root_of_the_second_moment() {
    let mut cells = table(2, alike);
    let known = notes(&cells);
    cells.learn(known.iter().copied(), alike);
    assert_eq!(cells.guidance(), Guidance::Cells);
    sums_to_one(&cells);
    let (left, right) = (cells.cell([0.3, 0.6, 0.1], UP), cells.cell([3.7, 0.6, 0.1], UP));
    // The mean of both lights, 0.5, weighs 4 samples beside 100 that saw 1 or 0: roots of (100 + 2) and of 2.
    let wanted = 0.9 * 102.0_f64.sqrt() / (102.0_f64.sqrt() + 2.0_f64.sqrt()) + 0.05;
    for (cell, light) in [(left, 0), (right, 1)] {
        assert!((f64::from(cells.pmf(cell, light)) - wanted).abs() < 0.01, "{} {wanted}", cells.pmf(cell, light));
    }
    // The order of training passes with the same keys changes only rounding; the same notes give the same bits.
    let mut again = table(2, alike);
    again.learn(known.iter().copied(), alike);
    assert_eq!(again, cells);
}

/// An unseen cell has the expectation of three voxels each way; a seen one has its own.
#[test]
fn a_cell_begins_with_its_expectation() {
    let expected = |middle: [f32; 3], _: f32, axis: [f32; 3], light: usize| match light {
        0 => middle[0],
        _ => 1.0 + axis[2],
    };
    let mut cells = table(2, expected);
    let wanted = |a: f32, b: f32| 0.9 * a / (a + b) + 0.05;
    // Voxels are half a unit wide: the middle of three lies at 0.75.
    for x in [0.25, 0.75, 1.25] {
        let up = cells.cell([x, 1.0, 0.25], UP);
        assert!((cells.pmf(up, 0) - wanted(0.75, 2.0)).abs() < 1e-3, "{x}: {}", cells.pmf(up, 0));
    }
    let below = cells.cell([0.25, 1.0, 0.25], [0.0, 0.0, -1.0]);
    assert!((cells.pmf(below, 0) - 0.95).abs() < 1e-3, "{}", cells.pmf(below, 0));
    // After a few samples it is still close to the expectation.
    let [first, second] = [0.25, 1.25].map(|x| cells.cell([x, 1.0, 0.25], UP));
    let squares = |x: f64, light| if light == 0 { (x / (x + 2.0)).powi(2) } else { (2.0 / (x + 2.0)).powi(2) };
    let notes = [(first, 0.25), (second, 1.25)]
        .into_iter()
        .flat_map(|(cell, x)| [0, 1].map(|light| (cells.key(cell, light), 1, squares(x, light))))
        .collect::<Vec<_>>();
    cells.learn(notes.into_iter(), expected);
    assert_eq!(cells.guidance(), Guidance::Cells);
    for (cell, x) in [(first, 0.25), (second, 1.25)] {
        assert!((cells.pmf(cell, 0) - wanted(x, 2.0)).abs() < 1e-3, "{x}: {}", cells.pmf(cell, 0));
    }
    let between = cells.cell([0.75, 1.0, 0.25], UP);
    assert!((cells.pmf(between, 0) - wanted(0.75, 2.0)).abs() < 1e-3, "{}", cells.pmf(between, 0));
}

/// If cells differ by noise alone, one distribution serves all.
#[test]
fn cells_that_do_not_pay_are_not_used() {
    let mut cells = table(2, alike);
    let same: Vec<_> = (0..8)
        .flat_map(|x| {
            let cell = cells.cell([x as f32 * 0.5 + 0.25, 0.6, 0.1], UP);
            [(cells.key(cell, 0), 100, 900.0 + f64::from(x)), (cells.key(cell, 1), 100, 100.0)]
        })
        .collect();
    cells.learn(same.iter().copied(), alike);
    assert_eq!(cells.guidance(), Guidance::Global);
    sums_to_one(&cells);
    let shares: Vec<f32> = (0..cells.cells() as u32).map(|cell| cells.pmf(cell, 0)).collect();
    assert!(shares.iter().all(|p| *p == shares[0]) && (shares[0] - (0.9 * 0.75 + 0.05)).abs() < 0.01);
    // They return when cells really differ.
    let more: Vec<_> = notes(&cells).into_iter().map(|(key, n, s)| (key, 1000 * n, 1e5 * s)).collect();
    cells.learn(more.into_iter(), alike);
    assert_eq!(cells.guidance(), Guidance::Cells);
    sums_to_one(&cells);
}

#[test]
fn odd_input_is_refused_or_passed_over() {
    let good = LightCellOptions::default();
    for lights in [0, 1, (1 << 16) + 1] {
        assert_eq!(LightCells::new(BOX, lights, &good, alike), Ok(None), "{lights} lights");
    }
    let most = LightCells::new(BOX, 1 << 16, &good, alike).unwrap().unwrap();
    assert!(most.cells() * most.lights() <= 1 << 21);
    for options in [
        LightCellOptions { resolution: 0, ..good },
        LightCellOptions { prior: 0.0, ..good },
        LightCellOptions { defensive: 0.0, ..good },
        LightCellOptions { defensive: 1.5, ..good },
    ] {
        assert!(LightCells::new(BOX, 2, &options, alike).is_err(), "{options:?}");
    }
    for bounds in [[[1.0; 3], [0.0; 3]], [[f32::NAN; 3], [1.0; 3]], [[0.0; 3], [f32::INFINITY; 3]]] {
        assert!(LightCells::new(bounds, 2, &good, alike).is_err(), "{bounds:?}");
    }
    assert!(LightCells::new([[1.0; 3]; 2], 2, &good, alike).unwrap().is_some(), "a point is a box");
    for expected in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::MAX] {
        let cells = table(3, |_, _, _, _| expected);
        sums_to_one(&cells);
        assert!((cells.pmf(0, 1) - 1.0 / 3.0).abs() < 1e-6, "{expected}");
    }
    let mut cells = table(2, alike);
    let before = cells.clone();
    cells.learn([(u64::MAX, 1, 1.0), (0, 1, f64::NAN), (1, 1, -1.0), (1, 1, f64::INFINITY)].into_iter(), alike);
    assert_eq!(cells, before);
}

/// The bytes of a table's lists. They end its debug text, beside the number of shared rows, and each number takes four.
fn bytes(cells: &LightCells) -> u64 {
    let shown = format!("{cells:?}");
    let (_, lists) = shown.split_once("rows: ").unwrap();
    let numbers = lists.split([' ', '[']).filter(|word| word.starts_with(|c: char| c.is_ascii_digit()));
    4 * (numbers.count() as u64 - 1)
}

#[test]
fn the_memory_of_a_table_is_bounded_by_its_notes_and_its_cells() {
    let options = LightCellOptions { resolution: 6, ..LightCellOptions::default() };
    let mut cells = LightCells::new([[0.0; 3], [1.0; 3]], 5, &options, alike).unwrap().unwrap();
    let keys = cells.key(cells.cells() as u32, 0);
    assert_eq!(bytes(&cells), cells.memory(0));
    // Each note opens a cell of its own, then all cells are open.
    cells.learn((0..40).map(|cell| (5 * cell, 1, 0.5)), alike);
    assert_eq!(bytes(&cells), cells.memory(40));
    cells.learn((0..keys).map(|key| (key, 1, 0.5)), alike);
    assert_eq!(bytes(&cells), cells.memory(u64::MAX));
}
