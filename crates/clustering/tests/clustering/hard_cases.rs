//! Hard cases of clustering. Test names end with their catalogue ids.

use crate::soups::check;
use crate::support::{Mesh, Random, groups, hills, parts, soup};
use dapple_clustering::{ClusterParams, Error, Grouping, Insertion, Order, Sides};

fn connected() -> ClusterParams {
    ClusterParams { grouping: Grouping::Connected, ..ClusterParams::default() }
}

/// The six orders of three axes.
const AXES: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

#[test]
fn flat_scenes_have_clusters_k02() {
    let solid = soup(600, 0.1, 2);
    // In a plane, on a line and in a point, each at 0 and off it. The remaining axes separate triangles as before.
    for flat in 1..=3 {
        for off in [0.0, 5.0, -3e30] {
            let mesh = solid.map(|p| std::array::from_fn(|axis| if axis >= 3 - flat { off } else { p[axis] }));
            for params in [ClusterParams::default(), connected(), ClusterParams::published()] {
                let clusters = mesh.cluster(&params).unwrap();
                check(&mesh, &params, &clusters).unwrap();
                let used = clusters.report().resolution.map(|n| n > 1);
                assert_eq!(used, std::array::from_fn(|axis| axis < 3 - flat));
                for order in AXES {
                    let turned = mesh.map(|p| order.map(|axis| p[axis]));
                    let turned_clusters = turned.cluster(&params).unwrap();
                    let last_wins = params.insertion == Insertion::BoundingBox;
                    // The published "last voxel" is ordered by z, then y, then x, so only the numbers agree.
                    if !last_wins {
                        assert_eq!(parts(turned_clusters.labels()), parts(clusters.labels()), "{flat} {off} {order:?}");
                    }
                    assert_eq!(turned_clusters.report().occupied, clusters.report().occupied);
                }
            }
        }
    }
    // A z that is the same for all has no effect.
    let [zero, five] = [0.0, 5.0].map(|z| solid.map(|[x, y, _]| [x, y, z]).cluster(&ClusterParams::default()).unwrap());
    assert_eq!(zero.labels(), five.labels());
    assert!(zero.report().occupied > 100);
}

#[test]
fn few_triangles_have_clusters_k03() {
    assert_eq!(Mesh::default().cluster(&ClusterParams::default()), Err(Error::Empty));
    for n in [1, 2, 100] {
        let mesh = soup(n, 0.1, 3);
        for params in [ClusterParams::default(), connected(), ClusterParams::published()] {
            let clusters = mesh.cluster(&params).unwrap();
            check(&mesh, &params, &clusters).unwrap();
            assert!(!clusters.is_empty());
        }
        assert_eq!(mesh.cluster(&ClusterParams::for_count(0)), Err(Error::BadCount));
        for count in [1, 2, n, n + 1, 1_000_000] {
            for params in [ClusterParams::for_count(count), ClusterParams { count: Some(count), ..connected() }] {
                let clusters = mesh.cluster(&params).unwrap();
                check(&mesh, &params, &clusters).unwrap();
                // Each triangle here has its own place and normal.
                if count >= n {
                    assert_eq!(clusters.len() as u32, n);
                }
            }
        }
    }
    // The materials and normals of one voxel are the lower bound.
    let mesh = hills(100, 3);
    let fewest = mesh.cluster(&ClusterParams { clamp: 1, ..ClusterParams::default() }).unwrap();
    assert!(fewest.len() > 10);
    assert_eq!(mesh.cluster(&ClusterParams::for_count(10)).unwrap(), fewest);
    // Larger counts are met within a factor of 1.5 on this surface.
    for count in [100, 1000, 5000] {
        let made = mesh.cluster(&ClusterParams::for_count(count)).unwrap().len() as f64 / f64::from(count);
        assert!((1.0 / 1.5..1.5).contains(&made), "{count}: {made}");
    }
}

#[test]
fn a_distant_triangle_degenerates_the_grid_k04() {
    let mut mesh = hills(50, 4);
    let healthy = mesh.cluster(&ClusterParams::default()).unwrap();
    assert!(!healthy.report().is_degenerate());
    assert!(healthy.report().occupied > 500);
    mesh.add([[1e6, 0.0, 0.0], [1e6, 1.0, 0.0], [1e6, 0.0, 1.0]]);
    mesh.materials.push(0);
    for params in [ClusterParams::default(), connected(), ClusterParams::published()] {
        let report = mesh.cluster(&params).unwrap().report();
        assert!(report.is_degenerate(), "{report:?}");
        assert!(report.occupied <= 2 && report.requested() >= 32, "{report:?}");
        assert_eq!(report.fullest, report.triangles - 1);
    }
}

/// Pairs of triangles with centroids on the corners of the voxels of an 8^3 grid over [0, 8]^3, including 8.
fn on_faces() -> (Mesh, Vec<[u32; 3]>) {
    let mut mesh = Mesh::default();
    let mut voxels = Vec::new();
    for number in 0..9_u32.pow(3) {
        let corner = [number % 9, number / 9 % 9, number / 81];
        let centre = corner.map(|x| x as f32);
        // The outermost are points, so that the box does not grow.
        let size = if corner.iter().all(|x| (1..8).contains(x)) { 0.25 } else { 0.0 };
        for z in [0.0, size] {
            let offsets = [[size, 0.0, z], [-size, size, 0.0], [0.0, -size, -z]];
            mesh.add(offsets.map(|offset| std::array::from_fn(|axis| centre[axis] + offset[axis])));
            voxels.push(corner.map(|x| x.min(7)));
        }
    }
    (mesh, voxels)
}

#[test]
fn centroids_on_faces_keep_their_voxels_at_any_scale_k05() {
    let (mesh, voxels) = on_faces();
    let params = ClusterParams { clamp: 8, angle: 90.0, ..ClusterParams::default() };
    let clusters = mesh.cluster(&params).unwrap();
    assert_eq!(clusters.report().resolution, [8; 3]);
    let numbers: Vec<u32> = voxels.iter().map(|[x, y, z]| (z * 8 + y) * 8 + x).collect();
    assert_eq!(clusters.labels(), numbers, "a face belongs to the voxel above, the last one to the last");
    // All coordinates are multiples of 1/4 up to 8: exact from the least subnormal, 2^-149, to below 2^128.
    for k in (-147..=124).filter(|k| k % 3 == 0 || *k < -140 || *k > 120) {
        let scale = 2_f64.powi(k);
        let scaled = mesh.map(|p| p.map(|x| (f64::from(x) * scale) as f32));
        assert_eq!(scaled.cluster(&params).unwrap().labels(), clusters.labels(), "2^{k}");
        let all = ClusterParams { angle: 10.0, ..connected() };
        assert_eq!(scaled.cluster(&all).unwrap().labels(), mesh.cluster(&all).unwrap().labels(), "2^{k}");
    }
}

/// 2^20 times as far from the origin as it is wide: 16 places are left along each axis, each in its own voxel.
#[test]
fn a_scene_far_from_the_origin_has_clusters_k05() {
    let mut mesh = Mesh::default();
    for i in 0..16_u32.pow(2) {
        let place = [(1 << 23) + i % 16, (1 << 23) + i / 16].map(|x| x as f32);
        mesh.add([[place[0], place[1], 0.0]; 3]);
    }
    let clusters = mesh.cluster(&ClusterParams { k: 100.0, clamp: 15, ..ClusterParams::default() }).unwrap();
    // 15 voxels: the last place is on the upper bound, together with the one before it.
    assert_eq!((clusters.report().resolution, clusters.len()), ([15, 15, 1], 225));
}

/// The extremes of `f32` together: nothing overflows and nothing vanishes.
#[test]
fn huge_and_tiny_triangles_have_clusters_k05() {
    let mut mesh = Mesh::default();
    let (huge, tiny) = (f32::MAX, f32::from_bits(1));
    mesh.add([[-huge, -huge, 0.0], [huge, -huge, 0.0], [0.0, huge, 0.0]]);
    mesh.add([[0.0, 0.0, 0.0], [tiny, 0.0, 0.0], [0.0, tiny, 0.0]]);
    mesh.add([[huge, huge, huge], [-huge, -huge, -huge], [huge, -huge, huge]]);
    for params in [ClusterParams::default(), connected(), ClusterParams::published()] {
        let clusters = mesh.cluster(&params).unwrap();
        check(&mesh, &params, &clusters).unwrap();
        for cluster in clusters.clusters() {
            assert!(cluster.area.is_finite() && cluster.area > 0.0);
            let length: f32 = cluster.normal.iter().map(|x| x * x).sum();
            assert!((length - 1.0).abs() < 1e-6 && cluster.cone.is_finite());
        }
    }
}

#[test]
fn order_and_threads_change_no_label_k07() {
    for (number, mesh) in [hills(60, 7), soup(4000, 0.1, 7), soup(500, 0.5, 8)].into_iter().enumerate() {
        let boxes = ClusterParams { insertion: Insertion::BoundingBox, ..ClusterParams::default() };
        for params in
            [ClusterParams::default(), connected(), boxes, ClusterParams { sides: Sides::Signed, ..connected() }]
        {
            let clusters = mesh.cluster(&params).unwrap();
            let mut random = Random(number as u64);
            for _ in 0..10 {
                let (shuffled, order) = mesh.shuffle(&mut random);
                let found = shuffled.cluster(&params).unwrap();
                let expected: Vec<u32> = order.iter().map(|&old| clusters.labels()[old as usize]).collect();
                assert_eq!(found.labels(), expected, "the very labels, not only the partition");
                assert_eq!(found.report(), clusters.report());
                for (found, cluster) in found.clusters().iter().zip(clusters.clusters()) {
                    assert!((found.area - cluster.area).abs() <= 1e-12 * cluster.area);
                    assert_eq!((found.bounds, found.group), (cluster.bounds, cluster.group));
                }
            }
        }
    }
    // More than one chunk of triangles and many ranges of voxels, so that threads share work.
    let mesh = hills(200, 7);
    for params in [ClusterParams::default(), connected(), ClusterParams::published()] {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| mesh.cluster(&params).unwrap())
        };
        let one = with(1);
        for threads in 2..=16 {
            assert_eq!(with(threads), one, "{threads} threads");
        }
    }
}

/// First fit in input order is not a function of the set of triangles. Only its groups are.
#[test]
fn published_clusters_depend_on_the_order_of_triangles_k07() {
    let mesh = hills(60, 7);
    for params in [ClusterParams { order: Order::Input, ..ClusterParams::default() }, ClusterParams::published()] {
        let clusters = mesh.cluster(&params).unwrap();
        let mut random = Random(7);
        let mut differ = 0;
        for _ in 0..20 {
            let (shuffled, order) = mesh.shuffle(&mut random);
            let found = shuffled.cluster(&params).unwrap();
            let back = |new: &[u32]| {
                let mut old = vec![0; new.len()];
                for (&number, &value) in order.iter().zip(new) {
                    old[number as usize] = value;
                }
                old
            };
            // Where a phantom takes a group's last triangle, numbers shift but parts stay.
            assert_eq!(parts(&back(&groups(&found))), parts(&groups(&clusters)), "voxels and materials hold");
            differ += u32::from(parts(&back(found.labels())) != parts(clusters.labels()));
        }
        assert_eq!(differ, 20, "all shuffles change the clusters");
    }
}
