//! Claims of the thesis and their consequences.

use crate::support::{Mesh, groups, hills, parts, soup};
use dapple_clustering::{ClusterParams, Clusters, Connection, Error, Grouping, Insertion, Order, Sides};

/// The share of triangles, in 1/1000, whose part in two partitions of a mesh has different first members.
fn moved(a: &Clusters, b: &Clusters) -> f64 {
    let moved = parts(a.labels()).iter().zip(parts(b.labels())).filter(|(a, b)| **a != *b).count();
    1000.0 * moved as f64 / a.labels().len() as f64
}

/// Scaling by 1000 keeps the clusters.
///
/// Labels are exact for powers of two (K05) and for factors that are exact in `f32`, as here: 12 bits times 10.
/// Other factors round coordinates, which turns a normal by up to a rounding error over the triangle's size. Voxels
/// stay the same, since the grid is shifted slightly off the centroids of regular meshes. Clusters stay the same but
/// for triangles exactly at the angle.
#[test]
fn scaling_by_a_thousand_keeps_the_clusters() {
    // 64 voxels by 128 or 192 cells: centroids at thirds of cells, many of them exactly on a face.
    let meshes = [hills(128, 1), hills(192, 2), hills(96, 3), soup(20_000, 0.02, 4)];
    for (number, mesh) in meshes.iter().enumerate() {
        for params in [
            ClusterParams::default(),
            ClusterParams { grouping: Grouping::Connected, ..ClusterParams::default() },
            ClusterParams { order: Order::Input, ..ClusterParams::default() },
            ClusterParams::published(),
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

/// With a clamp of 32 the longest axis has its 32 voxels from N = 1158 (K = 3), 43 (K = 9) and 2 (K = 30) on. Voxels
/// are rounded, so 31.5 suffice. Above, K only adds voxels along the shorter axes, until these have 32 too.
#[test]
fn k_is_almost_meaningless_in_the_published_grid() {
    let longest = |n: u32, k: f64, clamp: u32| {
        let mesh = soup(n, 0.1, 9).map(|[x, y, z]| [x, 0.25 * y, 0.25 * z]);
        let clusters =
            mesh.cluster(&ClusterParams { k, clamp, insertion: Insertion::Centroid, ..ClusterParams::published() });
        clusters.unwrap().report().resolution
    };
    for (k, saturated) in [(3.0, 1158), (9.0, 43), (30.0, 2)] {
        assert!(longest(saturated - 1, k, 32)[0] < 32, "K = {k}");
        assert_eq!(longest(saturated, k, 32)[0], 32, "K = {k}");
    }
    // K = 9 and K = 30 of the thesis: the grids of a cube are equal from 45 triangles on.
    for n in [45, 100, 3000] {
        let mesh = soup(n, 0.1, 9);
        let [nine, thirty] =
            [9.0, 30.0].map(|k| mesh.cluster(&ClusterParams { k, ..ClusterParams::published() }).unwrap());
        assert!(nine.report().resolution[0] == 32 || nine.report().resolution[1] == 32);
        if n >= 100 {
            assert_eq!(nine, thirty);
        }
    }
    // In a box four times as long as wide, K still affects the short axes, and voxels stop being cubes.
    let [nine, thirty] = [9.0, 30.0].map(|k| longest(1000, k, 32));
    assert_eq!((nine[0], thirty), (32, [32; 3]));
    assert!(nine[1] < 32);
    // Without the clamp K has its full effect: 3.33 times as many voxels along each axis.
    assert_eq!([9.0, 30.0].map(|k| longest(1000, k, 1 << 20)[0]), [90, 300]);
}

/// A floor of two triangles beside small ones is put into every voxel under its box and keeps the cluster of the last.
#[test]
fn boxes_make_phantoms_and_the_last_voxel_wins() {
    let mut mesh = soup(1000, 0.02, 10).map(|[x, y, z]| [x, y, 0.2 * z]);
    mesh.materials.clear();
    mesh.add([[-0.5, -0.5, 0.1], [1.5, -0.5, 0.1], [1.5, 1.5, 0.1]]);
    let report = mesh.cluster(&ClusterParams::published()).unwrap().report();
    let [x, y, _] = report.resolution.map(u64::from);
    assert!(report.insertions >= 1000 + x * y, "the floor alone is in every voxel of its layer");
    // The floor keeps its cluster only in the last voxel. Few other triangles are like it.
    assert!(report.phantoms >= x * y * 9 / 10, "{report:?}");
    let centroid =
        mesh.cluster(&ClusterParams { insertion: Insertion::Centroid, ..ClusterParams::published() }).unwrap().report();
    assert_eq!((centroid.insertions, centroid.phantoms), (1001, 0));
    // Two voxels, with a triangle in each and one over both. The third is in the cluster of the second voxel, not of
    // the first.
    let mut row = Mesh::default();
    row.add([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]);
    row.add([[0.9, 0.0, 0.0], [1.0, 0.0, 0.0], [0.9, 0.1, 0.0]]);
    row.add([[0.1, 0.0, 0.0], [0.9, 0.0, 0.0], [0.1, 0.1, 0.0]]);
    let params = ClusterParams { clamp: 2, ..ClusterParams::published() };
    assert_eq!(row.cluster(&params).unwrap().labels(), [0, 1, 1]);
    assert_eq!(row.cluster(&params).unwrap().clusters()[0].bounds, [[0.0; 3], [0.1, 0.1, 0.0]]);
    assert_eq!(row.cluster(&params).unwrap().report().insertions, 4);
}

/// One mesh with some windings flipped.
#[test]
fn flipped_windings_split_one_sided_clusters_only() {
    let mesh = hills(40, 11);
    let mut flipped = mesh.clone();
    for triangle in flipped.indices.iter_mut().step_by(3) {
        triangle.swap(0, 1);
    }
    let count = |mesh: &Mesh, sides| mesh.cluster(&ClusterParams { sides, ..ClusterParams::default() }).unwrap();
    assert_eq!(count(&mesh, Sides::Either).labels(), count(&flipped, Sides::Either).labels());
    assert_eq!(count(&mesh, Sides::Either).len(), count(&mesh, Sides::Signed).len());
    let [whole, split] = [&mesh, &flipped].map(|mesh| count(mesh, Sides::Signed).len());
    assert!(split > whole * 11 / 10, "{split} of {whole}");
}

/// Connected pieces separate parallel sheets in one voxel, by vertex number or by place.
#[test]
fn connected_grouping_separates_sheets() {
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
    let greedy = ClusterParams { clamp: 1, ..ClusterParams::default() };
    let connected = ClusterParams { grouping: Grouping::Connected, ..greedy };
    let by_number = ClusterParams { connection: Connection::Vertex, ..connected };
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

/// Triangles without a normal still have a place.
#[test]
fn triangles_without_normals_join_clusters() {
    let mut mesh = Mesh::default();
    mesh.add([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]]);
    mesh.add([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    mesh.add([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    // Three points on a line that no f32 meets exactly.
    mesh.add([[0.1, 0.7, 0.3], [0.2, 1.4, 0.6], [0.4, 2.8, 1.2]]);
    let params = ClusterParams { clamp: 1, ..ClusterParams::default() };
    let clusters = mesh.cluster(&params).unwrap();
    assert_eq!(clusters.labels(), [0; 4]);
    assert_eq!((clusters.clusters()[0].area, clusters.clusters()[0].normal), (0.5, [0.0, 0.0, 1.0]));
    assert_eq!(clusters.clusters()[0].cone, 1.0);
    // The first two touch the third; nothing touches the last.
    let connected = ClusterParams { grouping: Grouping::Connected, ..params };
    assert_eq!(mesh.cluster(&connected).unwrap().labels(), [0, 0, 0, 1]);
    let last = mesh.cluster(&connected).unwrap().clusters()[1];
    assert_eq!((last.area, last.normal, last.cone), (0.0, [0.0; 3], -1.0));
}

#[test]
fn errors_tell_what_to_do() {
    let mesh = soup(100, 0.1, 12);
    let default = ClusterParams::default();
    for k in [0.0, -1.0, f64::NAN, f64::INFINITY, 2e6] {
        assert!(matches!(mesh.cluster(&ClusterParams { k, ..default }), Err(Error::BadK { .. })));
    }
    for clamp in [0, (1 << 20) + 1, u32::MAX] {
        assert_eq!(mesh.cluster(&ClusterParams { clamp, ..default }), Err(Error::BadClamp { clamp }));
    }
    for angle in [-1.0, 90.1, f64::NAN, f64::INFINITY] {
        assert!(matches!(mesh.cluster(&ClusterParams { angle, ..default }), Err(Error::BadAngle { .. })));
    }
    let refused = |edit: &dyn Fn(&mut Mesh), error: Error| {
        let mut mesh = mesh.clone();
        edit(&mut mesh);
        assert_eq!(mesh.cluster(&default), Err(error.clone()));
        let said = error.to_string();
        assert!(["give", "use", "request", "remove", "correct"].iter().any(|word| said.contains(word)), "{said}");
        mesh
    };
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let error = Error::BadPosition { triangle: 71, vertex: 3 * 71 + 1 };
            let mut mesh = refused(&|mesh| mesh.positions[3 * 71 + 1][axis] = bad, error);
            // Unused by any triangle.
            mesh.indices.remove(71);
            mesh.materials.remove(71);
            assert!(mesh.cluster(&default).is_ok());
        }
    }
    let lost = |mesh: &mut Mesh| (mesh.indices[40][2], mesh.indices[50][0]) = (300, 301);
    refused(&lost, Error::BadIndex { triangle: 40, index: 300, vertices: 300 });
    refused(&|mesh| mesh.materials.truncate(99), Error::BadMaterials { materials: 99, triangles: 100 });
    refused(&|mesh| *mesh = Mesh::default(), Error::Empty);
    // The first bad triangle is named even if it is not in the first chunk.
    let mut many = soup(100_000, 0.1, 13);
    many.positions[3 * 90_000][1] = f32::NAN;
    many.indices[95_000][1] = u32::MAX;
    assert_eq!(many.cluster(&default), Err(Error::BadPosition { triangle: 90_000, vertex: 270_000 }));
}
