//! Cells at hit points.

use dapple_adaptive::{CellOptions, Cells};
use dapple_core::FirstHit;

const SIDE: u32 = 96;

fn hit(position: [f32; 3], normal: [f32; 3], material: u32) -> FirstHit {
    FirstHit::new(position, normal, 1.0).with_albedo([0.5; 3]).with_footprint(1.0).with_material(material)
}

/// A ball of radius 40 on a floor of another material, seen from above with pixels of width 1; black beyond column 90.
fn ball(x: f32, y: f32) -> Option<FirstHit> {
    let [u, v] = [x - 48.0, y - 48.0];
    let inside = 1600.0 - u * u - v * v;
    if x >= 90.0 {
        None
    } else if inside > 0.0 {
        let z = inside.sqrt();
        Some(hit([u, v, z], [u / 40.0, v / 40.0, z / 40.0], 1).with_primitive((x + 3.0 * y) as u32))
    } else {
        Some(hit([u, v, -40.0], [0.0, 0.0, 1.0], 0))
    }
}

/// First hits of `per_pixel` probes along the diagonal of each pixel.
fn image(per_pixel: usize, surface: impl Fn(f32, f32) -> Option<FirstHit>) -> Vec<Option<FirstHit>> {
    let places = (0..SIDE * SIDE).flat_map(|i| (0..per_pixel).map(move |k| (i, (k as f32 + 0.5) / per_pixel as f32)));
    places.map(|(i, offset)| surface((i % SIDE) as f32 + offset, (i / SIDE) as f32 + offset)).collect()
}

fn cells(hits: &[Option<FirstHit>]) -> Cells {
    let per_pixel = hits.len() / (SIDE * SIDE) as usize;
    Cells::new(hits, per_pixel, [SIDE; 2], &CellOptions::default()).unwrap()
}

#[test]
fn cells_are_small_at_the_limb_and_hits_add_up() {
    for per_pixel in [1, 4] {
        let hits = image(per_pixel, ball);
        let cells = cells(&hits);
        assert_eq!(cells.hits().iter().map(|&n| n as usize).sum::<usize>(), hits.len());
        assert_eq!(cells.pixels(), (SIDE * SIDE) as usize);
        assert!(cells.labels().iter().all(|&label| (label as usize) < cells.len()));
        let mean_size = |ring: std::ops::Range<f32>| {
            let inside = (0..cells.pixels()).filter(|&i| {
                let [u, v] = [(i as u32 % SIDE) as f32 - 47.5, (i as u32 / SIDE) as f32 - 47.5];
                ring.contains(&u.hypot(v))
            });
            let rates: Vec<f64> =
                inside.map(|i| per_pixel as f64 / f64::from(cells.hits()[cells.of_pixel(i)[0] as usize])).collect();
            rates.len() as f64 / rates.iter().sum::<f64>()
        };
        let (middle, limb) = (mean_size(0.0..20.0), mean_size(36.0..39.0));
        assert!(limb < 0.5 * middle, "{per_pixel} probes: cells of {limb} pixels at the limb, {middle} in the middle");
        // Cells of the floor and of the ball reach neither into each other nor into the black part.
        let label_at = |x: u32, y: u32| cells.of_pixel((y * SIDE + x) as usize)[0];
        let (floor, top, black) = (label_at(2, 2), label_at(48, 48), label_at(93, 48));
        assert!(floor != top && top != black && floor != black);
        assert_eq!(label_at(92, 1), black, "all misses are one cell");
        assert!(cells.hits()[top as usize] <= 256 * per_pixel as u32, "a cell outgrew its square");
    }
}

#[test]
fn numbers_of_primitives_change_nothing() {
    let hits = image(2, ball);
    let renumbered: Vec<_> = (hits.iter())
        .map(|hit| hit.map(|h| h.with_shape(h.primitive % 3).with_primitive(99 - h.primitive % 7)))
        .collect();
    assert_eq!(cells(&hits), cells(&renumbered));
    let other_materials: Vec<_> = hits.iter().map(|hit| hit.map(|h| h.with_material(7 - 3 * h.material))).collect();
    assert_eq!(cells(&hits), cells(&other_materials));
    // Negative control: the materials of places do matter.
    let one_material: Vec<_> = hits.iter().map(|hit| hit.map(|h| h.with_material(0))).collect();
    let marble: Vec<_> =
        one_material.iter().map(|hit| hit.map(|h| h.with_material(u32::from(h.position[0] > 3.0)))).collect();
    assert_ne!(cells(&one_material), cells(&marble));
}

#[test]
fn the_unit_of_length_changes_nothing() {
    let hits = image(1, ball);
    let scaled = |h: FirstHit, scale: f32| {
        let position = h.position.map(|x| x * scale);
        FirstHit::new(position, h.geometric_normal, h.depth * scale)
            .with_shading_normal(h.shading_normal)
            .with_albedo(h.albedo)
            .with_footprint(h.footprint * scale)
            .with_roughness(h.roughness)
            .with_material(h.material)
            .with_shape(h.shape)
            .with_primitive(h.primitive)
    };
    for scale in [1024.0, 0.125] {
        let scaled: Vec<_> = hits.iter().map(|hit| hit.map(|h| scaled(h, scale))).collect();
        assert_eq!(cells(&hits), cells(&scaled), "by {scale}, exact in binary");
    }
    // A factor of a thousand rounds: hardly any pixel changes its neighbours' cell.
    let thousand: Vec<_> = hits.iter().map(|hit| hit.map(|h| scaled(h, 1000.0))).collect();
    let (a, b) = (cells(&hits), cells(&thousand));
    let border = |cells: &Cells, i: usize| cells.of_pixel(i) == cells.of_pixel(i + 1);
    let differ = (0..a.pixels() - 1).filter(|&i| border(&a, i) != border(&b, i)).count();
    assert!(differ * 200 < a.pixels(), "{differ} borders moved");
}

#[test]
fn odd_hits_make_cells_too() {
    let edge_on = |x: f32, y: f32| {
        let odd = (x as u32) % 5;
        let normal = [[1.0, 0.0, 0.0], [0.0; 3], [f32::NAN; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]][odd as usize];
        let footprint = [0.0, 1e-38, 1e38, f32::INFINITY, 1.0][(y as usize) % 5];
        Some(hit([x, y, 1e30], normal, 0).with_footprint(footprint))
    };
    let hits = image(2, edge_on);
    let cells = cells(&hits);
    assert_eq!(cells.hits().iter().map(|&n| n as usize).sum::<usize>(), hits.len());
    let nothing = Cells::new(&[None], 1, [1, 1], &CellOptions::default()).unwrap();
    assert_eq!((nothing.len(), nothing.hits()), (1, &[1][..]));
}

#[test]
fn wrong_cells_are_refused() {
    let hits = image(1, ball);
    for options in [
        CellOptions::default().edge(0.0),
        CellOptions::default().edge(f32::NAN),
        CellOptions::default().normals(0.0),
        CellOptions::default().normals(91.0),
    ] {
        assert!(Cells::new(&hits, 1, [SIDE; 2], &options).is_err(), "{options:?}");
    }
    assert!(Cells::new(&hits, 2, [SIDE; 2], &CellOptions::default()).is_err());
    assert!(Cells::new(&hits, 0, [SIDE; 2], &CellOptions::default()).is_err());
}

/// A flat floor is cut into squares of the greatest cell size, so that their seams stay.
#[test]
fn a_floor_is_cut_into_squares() {
    let cells = cells(&image(1, |x, y| Some(hit([x, y, 0.0], [0.0, 0.0, 1.0], 0))));
    assert_eq!(cells.len(), 36, "96 pixels of 16 along each axis");
    assert!(cells.hits().iter().all(|&n| n == 256));
}

/// Two floors whose pixels are 8 times as wide on the left as on the right. They meet at their corners, so that the cubes
/// there have the same place, but another size.
#[test]
fn each_cell_has_the_size_of_its_own_pixels() {
    let surface = |x: f32, y: f32| {
        let (across, width) = if x < 48.0 { (48.0 - x, 8.0) } else { (x - 48.0, 1.0) };
        Some(hit([width * across, width * y, 0.0], [0.0, 0.0, 1.0], 0).with_footprint(width))
    };
    let cells = cells(&image(1, surface));
    assert_eq!(cells.len(), 36, "squares of 16 pixels on either side: {:?}", cells.hits());
    assert!(cells.hits().iter().all(|&n| n == 256), "{:?}", cells.hits());
}
