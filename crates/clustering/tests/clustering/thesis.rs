//! What the thesis says, and what follows from it.

use crate::support::{Mesh, groups, hills, parts, soup};
use dapple_clustering::{Clusters, Error, Grouping, Insertion, Order, Params};

/// A sphere of about 4 `side`^2 triangles, cut along parallels and meridians.
fn sphere(side: u32) -> Mesh {
    use std::f64::consts::PI;
    let mut mesh = Mesh::default();
    for row in 0..=side {
        for column in 0..2 * side {
            let (t, p) = (PI * f64::from(row) / f64::from(side), PI * f64::from(column) / f64::from(side));
            mesh.positions.push([t.sin() * p.cos(), t.sin() * p.sin(), t.cos()].map(|x| x as f32));
        }
    }
    for row in 0..side {
        for column in 0..2 * side {
            let next = (column + 1) % (2 * side);
            let [a, b, c, d] =
                [(row, column), (row, next), (row + 1, next), (row + 1, column)].map(|(r, c)| r * 2 * side + c);
            mesh.indices.extend([[a, d, c], [a, c, b]]);
        }
    }
    mesh
}

/// Triangles that two partitions of the same mesh put with another first member, in 1/1000.
fn moved(a: &Clusters, b: &Clusters) -> f64 {
    let moved = parts(a.labels()).iter().zip(parts(b.labels())).filter(|(a, b)| **a != *b).count();
    1000.0 * moved as f64 / a.labels().len() as f64
}

/// THESIS 7, test e. Exact for powers of two (K05), and for any factor that is exact in `f32`, as here: 12 bits times 10.
/// Any other rounds coordinates anew, which turns a normal by up to a rounding error over the triangle's size: voxels
/// stay, since the grid is shifted a little off the places where regular meshes have their centroids, and so do clusters
/// but for triangles that lie at the very angle.
#[test]
fn scaled_by_a_thousand() {
    // 64 voxels by 128 or 192 cells: centroids at thirds of cells, many of them exactly on a face.
    let meshes = [hills(128, 1), hills(192, 2), hills(96, 3), soup(20_000, 0.02, 4), sphere(64)];
    for (number, mesh) in meshes.iter().enumerate() {
        for params in [
            Params::default(),
            Params { grouping: Grouping::Connected, ..Params::default() },
            Params { order: Order::Input, ..Params::default() },
            Params::published(),
        ] {
            let snapped = mesh.map(|p| p.map(|x| (x * 4096.0).round() / 4096.0));
            let clusters = snapped.cluster(&params).unwrap();
            let scaled = snapped.map(|p| p.map(|x| x * 1000.0)).cluster(&params).unwrap();
            assert!(scaled.labels() == clusters.labels(), "mesh {number} {params:?}");
            assert_eq!(scaled.report(), clusters.report());

            let clusters = mesh.cluster(&params).unwrap();
            for scale in [1000.0, 0.001, 3.7] {
                let scaled = mesh.map(|p| p.map(|x| x * scale)).cluster(&params).unwrap();
                if params.insertion == Insertion::Centroid {
                    assert!(parts(&groups(&scaled)) == parts(&groups(&clusters)), "mesh {number} {scale} {params:?}");
                }
                let moved = moved(&scaled, &clusters);
                assert!(moved <= 1.0, "mesh {number} {scale} {params:?}: {moved} of 1000");
            }
        }
    }
}

/// THESIS 6, first item: with a clamp of 32 the longest axis has its 32 voxels from N = 1158 (K = 3), 43 (K = 9) and 2
/// (K = 30) on: voxels are rounded, so 31.5 do. Above, K only adds voxels along the shorter axes, until those have 32 too.
#[test]
fn k_is_almost_meaningless_in_the_published_grid() {
    let longest = |n: u32, k: f64, clamp: u32| {
        let mesh = soup(n, 0.1, 9).map(|[x, y, z]| [x, 0.25 * y, 0.25 * z]);
        let clusters = mesh.cluster(&Params { k, clamp, insertion: Insertion::Centroid, ..Params::published() });
        clusters.unwrap().report().resolution
    };
    for (k, saturated) in [(3.0, 1158), (9.0, 43), (30.0, 2)] {
        assert!(longest(saturated - 1, k, 32)[0] < 32, "K = {k}");
        assert_eq!(longest(saturated, k, 32)[0], 32, "K = {k}");
    }
    // The thesis' K = 9 and K = 30: a cube's grids are the same from 45 triangles on.
    for n in [45, 100, 3000] {
        let mesh = soup(n, 0.1, 9);
        let [nine, thirty] = [9.0, 30.0].map(|k| mesh.cluster(&Params { k, ..Params::published() }).unwrap());
        assert!(nine.report().resolution[0] == 32 || nine.report().resolution[1] == 32);
        if n >= 100 {
            assert_eq!(nine, thirty);
        }
    }
    // A box four times as long as wide: K still tells on the short axes, and voxels stop being cubes.
    let [nine, thirty] = [9.0, 30.0].map(|k| longest(1000, k, 32));
    assert_eq!((nine[0], thirty), (32, [32; 3]));
    assert!(nine[1] < 32);
    // Without the clamp K is what it says: 3.33 times as many voxels along each axis.
    assert_eq!([9.0, 30.0].map(|k| longest(1000, k, 1 << 20)[0]), [90, 300]);
}

/// A floor of two triangles beside small ones: put into every voxel under its box, it keeps the last one's cluster.
#[test]
fn boxes_make_phantoms_and_the_last_voxel_wins() {
    let mut mesh = soup(1000, 0.02, 10).map(|[x, y, z]| [x, y, 0.2 * z]);
    mesh.materials.clear();
    mesh.add([[-0.5, -0.5, 0.1], [1.5, -0.5, 0.1], [1.5, 1.5, 0.1]]);
    let report = mesh.cluster(&Params::published()).unwrap().report();
    let [x, y, _] = report.resolution.map(u64::from);
    assert!(report.insertions >= 1000 + x * y, "the floor alone is in every voxel of its layer");
    // In no voxel but the last does the floor's cluster keep it; few others there are like it.
    assert!(report.phantoms >= x * y * 9 / 10, "{report:?}");
    let centroid = mesh.cluster(&Params { insertion: Insertion::Centroid, ..Params::published() }).unwrap().report();
    assert_eq!((centroid.insertions, centroid.phantoms), (1001, 0));
    // Two voxels, a triangle in each and one over both: the second voxel's cluster has the third, the first's has not.
    let mut row = Mesh::default();
    row.add([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]);
    row.add([[0.9, 0.0, 0.0], [1.0, 0.0, 0.0], [0.9, 0.1, 0.0]]);
    row.add([[0.1, 0.0, 0.0], [0.9, 0.0, 0.0], [0.1, 0.1, 0.0]]);
    let params = Params { clamp: 2, ..Params::published() };
    assert_eq!(row.cluster(&params).unwrap().labels(), [0, 1, 1]);
    assert_eq!(row.cluster(&params).unwrap().clusters()[0].bounds, [[0.0; 3], [0.1, 0.1, 0.0]]);
    assert_eq!(row.cluster(&params).unwrap().report().insertions, 4);
}

/// One mesh, its winding flipped here and there.
#[test]
fn flipped_windings_split_one_sided_clusters_only() {
    let mesh = hills(40, 11);
    let mut flipped = mesh.clone();
    for triangle in flipped.indices.iter_mut().step_by(3) {
        triangle.swap(0, 1);
    }
    let count = |mesh: &Mesh, two_sided| mesh.cluster(&Params { two_sided, ..Params::default() }).unwrap();
    assert_eq!(count(&mesh, true).labels(), count(&flipped, true).labels());
    assert_eq!(count(&mesh, true).len(), count(&mesh, false).len());
    let [whole, split] = [&mesh, &flipped].map(|mesh| count(mesh, false).len());
    assert!(split > whole * 11 / 10, "{split} of {whole}");
}

/// The remedy that the thesis names: parallel sheets in one voxel are told apart, by number or by place.
#[test]
fn connected_tells_sheets_apart() {
    let sheets = |welded: bool| {
        let mut mesh = Mesh::default();
        for z in [0.0, 0.1] {
            for x in [0.0, 1.0, 2.0] {
                let quad = [[x, 0.0, z], [x + 1.0, 0.0, z], [x + 1.0, 1.0, z], [x, 1.0, z]];
                mesh.add([quad[0], quad[1], quad[2]]);
                mesh.add([quad[0], quad[2], quad[3]]);
            }
        }
        if welded {
            let places = mesh.positions.clone();
            let first = |v: u32| places.iter().position(|&p| p == places[v as usize]).unwrap() as u32;
            mesh.indices = mesh.indices.iter().map(|triangle| triangle.map(first)).collect();
        }
        mesh
    };
    let greedy = Params { clamp: 1, ..Params::default() };
    let connected = Params { grouping: Grouping::Connected, ..greedy };
    let by_number = Params { weld: false, ..connected };
    assert_eq!(sheets(false).cluster(&greedy).unwrap().len(), 1);
    let two = [[0; 6], [1; 6]].concat();
    assert_eq!(sheets(false).cluster(&connected).unwrap().labels(), two);
    assert_eq!(sheets(true).cluster(&connected).unwrap().labels(), two);
    assert_eq!(sheets(true).cluster(&by_number).unwrap().labels(), two);
    assert_eq!(sheets(false).cluster(&by_number).unwrap().len(), 12, "a soup is connected by place only");
    // 0.0 and -0.0 are one place.
    let minus = sheets(false).map(|p| p.map(|x| if x == 0.0 { -0.0 } else { x }));
    assert_eq!(minus.cluster(&connected).unwrap().labels(), two);
}

/// A strip that turns by 2 degrees from one quad to the next: no cluster turns by more than twice the angle.
#[test]
fn connected_does_not_drift_along_a_curve() {
    let mut mesh = Mesh::default();
    let at = |i: u32, y: f32| {
        let angle = (2.0 * i as f32).to_radians();
        [angle.cos(), y, angle.sin()]
    };
    for i in 0..90 {
        mesh.add([at(i, 0.0), at(i + 1, 0.0), at(i + 1, 0.1)]);
        mesh.add([at(i, 0.0), at(i + 1, 0.1), at(i, 0.1)]);
    }
    let params = Params { clamp: 1, grouping: Grouping::Connected, ..Params::default() };
    let clusters = mesh.cluster(&params).unwrap();
    assert!((9..=36).contains(&clusters.len()), "{}", clusters.len());
    for cluster in clusters.clusters() {
        assert!(cluster.cone > 20_f32.to_radians().cos());
    }
}

/// Triangles without a normal have a place all the same.
#[test]
fn triangles_without_normals() {
    let mut mesh = Mesh::default();
    mesh.add([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]]);
    mesh.add([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    mesh.add([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    // Three points on a line that no f32 meets exactly.
    mesh.add([[0.1, 0.7, 0.3], [0.2, 1.4, 0.6], [0.4, 2.8, 1.2]]);
    let params = Params { clamp: 1, ..Params::default() };
    let clusters = mesh.cluster(&params).unwrap();
    assert_eq!(clusters.labels(), [0; 4]);
    assert_eq!((clusters.clusters()[0].area, clusters.clusters()[0].normal), (0.5, [0.0, 0.0, 1.0]));
    assert_eq!(clusters.clusters()[0].cone, 1.0);
    // The first two touch the third; nothing touches the last.
    let connected = Params { grouping: Grouping::Connected, ..params };
    assert_eq!(mesh.cluster(&connected).unwrap().labels(), [0, 0, 0, 1]);
    let last = mesh.cluster(&connected).unwrap().clusters()[1];
    assert_eq!((last.area, last.normal, last.cone), (0.0, [0.0; 3], -1.0));
}

#[test]
fn refusals_say_what_to_do() {
    let mesh = soup(100, 0.1, 12);
    let refused = |mesh: &Mesh, params: Params| mesh.cluster(&params).unwrap_err();
    let default = Params::default();
    for k in [0.0, -1.0, f64::NAN, f64::INFINITY, 2e6] {
        assert!(matches!(refused(&mesh, Params { k, ..default }), Error::BadK { .. }));
    }
    for clamp in [0, (1 << 20) + 1, u32::MAX] {
        assert_eq!(refused(&mesh, Params { clamp, ..default }), Error::BadClamp { clamp });
    }
    for angle in [-1.0, 90.1, f64::NAN, f64::INFINITY] {
        assert!(matches!(refused(&mesh, Params { angle, ..default }), Error::BadAngle { .. }));
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let mut mesh = mesh.clone();
            mesh.positions[3 * 71 + 1][axis] = bad;
            assert_eq!(refused(&mesh, default), Error::BadPosition { triangle: 71, vertex: 3 * 71 + 1 });
            // No triangle uses it: no matter.
            mesh.indices.remove(71);
            mesh.materials.remove(71);
            assert!(mesh.cluster(&default).is_ok());
        }
    }
    let mut lost = mesh.clone();
    lost.indices[40_usize][2] = 300;
    lost.indices[50_usize][0] = 301;
    assert_eq!(refused(&lost, default), Error::BadIndex { triangle: 40, index: 300, vertices: 300 });
    let mut materials = mesh.clone();
    materials.materials.pop();
    assert_eq!(refused(&materials, default), Error::BadMaterials { materials: 99, triangles: 100 });
    let messages =
        [Error::Empty, Error::BadCount, refused(&lost, default), refused(&mesh, Params { k: 0.0, ..default })];
    for message in messages {
        let message = message.to_string();
        assert!(["give", "ask", "stay below", "leave"].iter().any(|word| message.contains(word)), "{message}");
    }
    // The first unfit triangle is named even where it is not in the first chunk.
    let mut many = soup(100_000, 0.1, 13);
    many.positions[3 * 90_000][1] = f32::NAN;
    many.indices[95_000][1] = u32::MAX;
    assert_eq!(refused(&many, default), Error::BadPosition { triangle: 90_000, vertex: 270_000 });
}
