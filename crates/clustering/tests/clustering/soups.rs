//! Properties of clusters of any triangles.

use crate::support::Mesh;
use dapple_clustering::{ClusterParams, Clusters, Connection, Grouping, Insertion, Order, Sides};
use proptest::prelude::*;

/// Coordinates from few values, so that vertices, edges, planes and voxel faces coincide, or from many.
fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        3 => (-4_i32..=4).prop_map(|i| i as f32 * 0.5),
        1 => -2.0_f32..2.0,
        1 => prop_oneof![Just(0.0), Just(-0.0), Just(1e-30), Just(-1e20), Just(3e38), Just(f32::MIN_POSITIVE)],
    ]
}

fn mesh() -> impl Strategy<Value = Mesh> {
    let positions = prop::collection::vec([coordinate(), coordinate(), coordinate()], 1..40);
    (positions, any::<bool>()).prop_flat_map(|(positions, one_material)| {
        let vertex = 0..positions.len() as u32;
        let indices = prop::collection::vec(([vertex.clone(), vertex.clone(), vertex], 0_u32..3), 1..120);
        indices.prop_map(move |triangles| {
            let (indices, materials): (_, Vec<u32>) = triangles.into_iter().unzip();
            let materials = if one_material { Vec::new() } else { materials };
            Mesh { positions: positions.clone(), indices, materials }
        })
    })
}

fn params() -> impl Strategy<Value = ClusterParams> {
    let choices = [any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>()];
    let counts = prop_oneof![4 => Just(None), 1 => (1_u32..200).prop_map(Some)];
    (0.01_f64..20.0, 1_u32..40, 0.0_f64..=90.0, choices, counts).prop_map(
        |(k, clamp, angle, [boxes, connected, input, two_sided, weld], count)| {
            ClusterParams {
                k,
                // Boxes as large as the grid go into all of its voxels.
                clamp: if boxes { clamp.div_ceil(4) } else { clamp },
                angle,
                insertion: if boxes { Insertion::BoundingBox } else { Insertion::Centroid },
                grouping: if connected { Grouping::Connected } else { Grouping::Greedy },
                order: if input { Order::Input } else { Order::Canonical },
                sides: if two_sided { Sides::Either } else { Sides::Signed },
                connection: if weld { Connection::Place } else { Connection::Vertex },
                count,
            }
        },
    )
}

/// Twice the area times the normal, in f64.
fn cross(mesh: &Mesh, triangle: u32) -> [f64; 3] {
    let [a, b, c] = mesh.corners(triangle).map(|corner| corner.map(f64::from));
    let [u, v]: [[f64; 3]; 2] = [b, c].map(|end| std::array::from_fn(|axis| end[axis] - a[axis]));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

/// Every triangle is in one cluster whose members, bounds, areas, cones and materials are correct.
pub(crate) fn check(mesh: &Mesh, params: &ClusterParams, clusters: &Clusters) -> Result<(), TestCaseError> {
    let mut seen = vec![0; mesh.indices.len()];
    // Sums over triangles that certainly have a normal, and over all.
    let (mut certain, mut possible, mut areas) = (0.0, 0.0, 0.0);
    for (number, cluster) in clusters.clusters().iter().enumerate() {
        let members = clusters.members(number as u32);
        prop_assert!(!members.is_empty() && members.is_sorted_by(|a, b| a < b));
        prop_assert_eq!(members.len() as u32, cluster.triangles);
        areas += cluster.area;
        let mut directions = Vec::new();
        for &triangle in members {
            seen[triangle as usize] += 1;
            prop_assert_eq!(clusters.labels()[triangle as usize], number as u32);
            prop_assert_eq!(mesh.materials.get(triangle as usize).copied().unwrap_or(0), cluster.material);
            for corner in mesh.corners(triangle) {
                for (axis, x) in corner.into_iter().enumerate() {
                    prop_assert!(cluster.bounds[0][axis] <= x && x <= cluster.bounds[1][axis]);
                }
            }
            let cross = cross(mesh, triangle);
            possible += 0.5 * length(cross);
            let edges: Vec<f64> = {
                let [a, b, c] = mesh.corners(triangle).map(|corner| corner.map(f64::from));
                [b, c].iter().map(|end| length(std::array::from_fn(|axis| end[axis] - a[axis]))).collect()
            };
            // Away from the least sine that counts as an angle, where rounding decides.
            if length(cross) > 1e-12 * edges[0] * edges[1] {
                certain += 0.5 * length(cross);
                directions.push(cross.map(|x| x / length(cross)));
            }
        }
        let normal = cluster.normal.map(f64::from);
        let alike = |a, b| if params.sides == Sides::Either { dot(a, b).abs() } else { dot(a, b) };
        for &a in &directions {
            prop_assert!(alike(a, normal) >= f64::from(cluster.cone) - 1e-6 || cluster.cone == -1.0);
            // Within the angle of one representative, so within twice the angle of each other.
            let widest = (2.0 * params.angle).to_radians();
            for &b in &directions {
                prop_assert!(alike(a, b).clamp(-1.0, 1.0).acos() <= widest + 3e-3);
            }
        }
        if cluster.normal != [0.0; 3] {
            prop_assert!((length(normal) - 1.0).abs() < 1e-6);
        }
    }
    prop_assert!(seen.iter().all(|&times| times == 1));
    prop_assert!(areas >= (1.0 - 1e-9) * certain && areas <= (1.0 + 1e-9) * possible);
    prop_assert!(clusters.members(clusters.len() as u32).is_empty());
    Ok(())
}

/// Tests if some triangles are connected by shared places, or by vertex numbers without welding.
fn is_connected(mesh: &Mesh, members: &[u32], connection: Connection) -> bool {
    let share = |a: u32, b: u32| {
        let vertices = |triangle: u32| mesh.indices[triangle as usize];
        vertices(a).iter().any(|&v| {
            let at = mesh.positions[v as usize];
            vertices(b).iter().any(|&w| v == w || (connection == Connection::Place && at == mesh.positions[w as usize]))
        })
    };
    let mut reached = vec![members[0]];
    let mut left = members[1..].to_vec();
    let mut next = 0;
    while next < reached.len() {
        let (touching, rest): (Vec<u32>, Vec<u32>) = left.iter().partition(|&&other| share(reached[next], other));
        reached.extend(touching);
        left = rest;
        next += 1;
    }
    left.is_empty()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, rng_seed: proptest::test_runner::RngSeed::Fixed(2016), ..ProptestConfig::default() })]

    #[test]
    fn every_triangle_is_in_one_correct_cluster(mesh in mesh(), params in params()) {
        let clusters = mesh.cluster(&params).unwrap();
        check(&mesh, &params, &clusters)?;
        let report = clusters.report();
        prop_assert!(report.occupied >= 1 && report.occupied <= report.requested());
        prop_assert!(report.fullest >= 1 && report.fullest <= report.triangles);
        if params.insertion == Insertion::Centroid {
            prop_assert_eq!((report.insertions, report.phantoms), (u64::from(report.triangles), 0));
            if params.grouping == Grouping::Connected {
                for number in 0..clusters.len() as u32 {
                    prop_assert!(is_connected(&mesh, clusters.members(number), params.connection));
                }
            }
        }
    }
}
