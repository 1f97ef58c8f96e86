//! Triangles of one voxel are classified by first fit, whichever way is fast: in vector lanes, in passes, or in passes and a sweep.

use crate::support::{Mesh, Random};
use dapple_clustering::{ClusterParams, Order, Sides};

/// The unit normal of the triangle from the origin along two edges; not finite if they are parallel.
fn normal(edges: [[f32; 3]; 2]) -> [f32; 3] {
    let [u, v] = edges.map(|edge| edge.map(f64::from));
    let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let inverse = 1.0 / (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
    n.map(|x| (x * inverse) as f32)
}

/// Pairs of edges. Some normals repeat, some lie on the equator; if `coarse`, many are equal in z, in y too, or altogether.
fn edges(count: usize, coarse: bool, random: &mut Random) -> Vec<[[f32; 3]; 2]> {
    let mut found: Vec<[[f32; 3]; 2]> = Vec::new();
    while found.len() < count {
        let scale = if coarse { 2.0 } else { 1e6 };
        let mut edges = [[0; 3]; 2].map(|edge| edge.map(|_| (scale * (2.0 * random.unit() - 1.0)).round()));
        match found.len() % 7 {
            0 => edges[0] = [0.0, 0.0, 1.0],
            1 => edges = found[found.len() / 2],
            _ => {}
        }
        if normal(edges)[0].is_finite() {
            found.push(edges);
        }
    }
    found
}

/// The published loop, literally: join the first cluster with a similar representative, or open one.
fn first_fit(normals: &[[f32; 3]], params: &ClusterParams) -> Vec<u32> {
    let two_sided = params.sides == Sides::Either;
    let least = (params.angle.to_radians().cos() - 2.0_f64.powi(-21)) as f32;
    let upward = |n: &[f32; 3]| if two_sided && n.iter().rev().lt(&[0.0; 3]) { n.map(|x| -x) } else { *n };
    let normals: Vec<_> = normals.iter().map(upward).collect();
    let mut order: Vec<usize> = (0..normals.len()).collect();
    if params.order == Order::Canonical {
        order.sort_by(|&a, &b| normals[b].iter().rev().partial_cmp(normals[a].iter().rev()).unwrap());
    }
    let mut representatives: Vec<[f32; 3]> = Vec::new();
    let mut class = vec![0; normals.len()];
    for i in order {
        let cosine = |n: &[f32; 3]| {
            let dot = n[0] * normals[i][0] + n[1] * normals[i][1] + n[2] * normals[i][2];
            if two_sided { dot.abs() } else { dot }
        };
        let found = representatives.iter().position(|n| cosine(n) >= least);
        class[i] = found.unwrap_or_else(|| {
            representatives.push(normals[i]);
            representatives.len() - 1
        }) as u32;
    }
    class
}

fn compare(count: usize, coarse: bool, params: ClusterParams, random: &mut Random) {
    let params = ClusterParams { clamp: 1, ..params };
    let edges = edges(count, coarse, random);
    let mut mesh = Mesh::default();
    edges.iter().for_each(|[u, v]| mesh.add([[0.0; 3], *u, *v]));
    let normals: Vec<_> = edges.into_iter().map(normal).collect();
    assert!(mesh.cluster(&params).unwrap().labels() == first_fit(&normals, &params), "{count} {params:?}");
}

#[test]
fn passes_and_sweep_compute_first_fit() {
    // From one class to thousands, so that few triangles, passes alone, and passes then sweep all occur.
    for (count, angle) in [(1, 10.0), (40, 10.0), (40, 0.0), (3000, 90.0), (3000, 20.0), (3000, 2.0), (3000, 0.0)] {
        for sides in [Sides::Signed, Sides::Either] {
            for order in [Order::Canonical, Order::Input] {
                compare(
                    count,
                    false,
                    ClusterParams { angle, sides, order, ..ClusterParams::default() },
                    &mut Random(2016),
                );
            }
        }
    }
}

/// Groups of up to 256 triangles, some with more classes than lanes take.
#[test]
fn lanes_compute_first_fit() {
    let random = &mut Random(2016);
    for (round, count) in (0..600).zip((1..=256).cycle().step_by(7)) {
        let sides = [Sides::Either, Sides::Signed][round % 2];
        compare(
            count,
            true,
            ClusterParams { angle: [8.0, 26.0, 60.0][round % 3], sides, ..ClusterParams::default() },
            random,
        );
    }
}
