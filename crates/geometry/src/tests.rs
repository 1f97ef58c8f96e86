//! Tests that compare the tree with a plain loop over the same triangle test. Integration tests compare that triangle test
//! with f64.

use crate::bvh::key;
use crate::lanes::Pair;
use crate::leaf::Triangles8;
use crate::leaf::{self, Leaf, SPAN, WORDS};
use crate::ray::PreparedRay;
use crate::{Geometry, Hit, Mesh, Ray};
use glam::Vec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Returns the closest hit by a linear search over all triangles, with the triangle test of the tree.
fn linear(mesh: &Mesh, ray: &Ray) -> Option<Hit> {
    let (prepared, scale) =
        PreparedRay::ordinary(ray).map(|prepared| (prepared, 1.0)).or_else(|| PreparedRay::rescaled(ray))?;
    let numbers = (0..mesh.triangles().len() as u32).filter(|&n| !mesh.is_degenerate(n));
    let hits = numbers.filter_map(|n| {
        let (mut triangles, mut words) = (Triangles8::default(), [0.0; SPAN]);
        triangles.put(0, mesh.corners(n));
        leaf::write(&mut words[..WORDS], &triangles, &[0]);
        let leaf = Leaf::at(&words, leaf::place(0, 1));
        let lanes = leaf.intersect::<Pair>((), &prepared, prepared.ray.tmax)?;
        let barycentrics = lanes.weights.map(|w| w[0]);
        Some(Hit { t: lanes.t[0] * scale, shape: 0, primitive: n, barycentrics })
    });
    hits.min_by(|a, b| a.t.total_cmp(&b.t).then(key(0, a.primitive).cmp(&key(0, b.primitive))))
}

fn geometry(mesh: &Mesh) -> Geometry {
    Geometry::build(vec![mesh.clone().into()]).expect("one mesh")
}

/// Returns a scene that contains the mesh twice, and thus has another tree. The second mesh has the larger number and is never
/// hit.
fn in_another_tree(mesh: &Mesh) -> Geometry {
    Geometry::build(vec![mesh.clone().into(), mesh.clone().into()]).expect("two meshes")
}

fn wild(rng: &mut Pcg64Mcg, exponent: f64) -> f32 {
    let size = 10.0_f64.powf(rng.random_range(-exponent..exponent));
    (if rng.random() { size } else { -size }) as f32
}

/// Returns random triangles with uniform coordinates (`exponent` 0, at `scale`) or coordinates over 10^±exponent.
fn soup(rng: &mut Pcg64Mcg, count: usize, exponent: f64, scale: f32) -> Mesh {
    let mut coordinate = || if exponent > 0.0 { wild(rng, exponent) } else { rng.random_range(-1.0..1.0) };
    let positions: Vec<[f32; 3]> = (0..3 * count).map(|_| std::array::from_fn(|_| coordinate() * scale)).collect();
    let triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh::new(positions, triangles).expect("finite and in range")
}

fn aimed_ray(rng: &mut Pcg64Mcg, mesh: &Mesh, exponent: f64, scale: f32) -> Ray {
    let mut coordinate = || if exponent > 0.0 { wild(rng, exponent) } else { rng.random_range(-2.0..2.0) };
    let origin = Vec3::from_array(std::array::from_fn(|_| coordinate() * scale));
    let [a, b, c] = mesh.corners(rng.random_range(0..mesh.triangles().len() as u32));
    let target = match rng.random_range(0..4) {
        0 => a,
        1 => (a + b) * 0.5,
        _ => a * 0.2 + b * 0.3 + c * 0.5,
    };
    let tmin = if rng.random_range(0..4) == 0 { 0.9 } else { 0.0 };
    let tmax = if rng.random_range(0..4) == 0 { 1.0 } else { f32::INFINITY };
    Ray { tmin, tmax, ..Ray::new(origin, target - origin) }
}

#[test]
fn the_tree_agrees_with_a_loop_bit_for_bit_g08() {
    let mut rng = Pcg64Mcg::seed_from_u64(8);
    let mut hits = 0;
    for i in 0..120 {
        let count = [1, 3, 40, 150][i % 4];
        let exponent = [0.0, 1.0, 8.0][i % 3];
        let scale = [1.0, 1e-9, 1e9, 1e-3][i / 3 % 4] * if exponent > 1.0 { 0.0 } else { 1.0 };
        let scale = if scale == 0.0 { 1.0 } else { scale };
        let mut mesh = soup(&mut rng, count, exponent, scale);
        // Few distinct coordinates: shared vertices, coplanar and degenerate triangles.
        let grid = i % 5 == 4;
        if grid {
            let positions = (0..3 * count).map(|_| std::array::from_fn(|_| rng.random_range(-2..3) as f32)).collect();
            mesh = Mesh::new(positions, mesh.triangles().to_vec()).expect("valid");
        }
        let scenes = [geometry(&mesh), in_another_tree(&mesh)];
        // Machines without AVX2 use the traversal in pairs of four lanes.
        let scenes = scenes.into_iter().flat_map(|scene| [scene.clone(), scene.in_pairs()]).collect::<Vec<_>>();
        for _ in 0..150 {
            let mut ray = aimed_ray(&mut rng, &mesh, exponent, scale);
            if grid {
                (ray.origin, ray.direction) = (ray.origin.round(), ray.direction.round());
            }
            let expected = linear(&mesh, &ray);
            hits += usize::from(expected.is_some());
            for scene in &scenes {
                assert_eq!(scene.closest(&ray), expected, "soup {i}, {ray:?}");
                assert_eq!(scene.occluded(&ray), expected.is_some(), "soup {i}, {ray:?}");
            }
        }
    }
    assert!(hits > 5000, "{hits} hits");
}

#[test]
fn barycentrics_are_those_of_the_corners_g09() {
    let mut rng = Pcg64Mcg::seed_from_u64(9);
    for k in -6..=6 {
        let leg = 10.0_f32.powi(k);
        let corners = [[0.0, 0.0, 0.0], [leg, 0.0, 0.0], [0.0, leg, 0.0]];
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            let scene = geometry(&Mesh::new(corners.to_vec(), vec![order]).expect("valid"));
            for _ in 0..200 {
                let (x, y) = (rng.random_range(0.01..0.49_f32), rng.random_range(0.01..0.49_f32));
                let ray = Ray::new(Vec3::new(x, y, 1.0) * leg, Vec3::NEG_Z);
                let hit = scene.closest(&ray).expect("inside");
                let [b1, b2] = hit.barycentrics;
                let exact = order.map(|corner| [1.0 - x - y, x, y][corner as usize]);
                let off = Vec3::new(1.0 - b1 - b2, b1, b2) - Vec3::from_array(exact);
                assert!(off.abs().max_element() <= 1e-5, "{off}");
                let point = scene.surface(&ray, &hit).position;
                assert!((point - ray.origin.with_z(0.0)).length() <= 1e-6 * leg);
            }
        }
    }
}

/// Returns triangles across one corner of a cube. Each is half as large as the previous one; the last `count` have almost the
/// same size.
fn shrinking(levels: i32, count: u32) -> Mesh {
    let sizes = (0..levels).map(|n| 0.5_f32.powi(n));
    let sizes = sizes.chain((0..count).map(|n| 0.5_f32.powi(levels) * (1.0 + n as f32 / count as f32)));
    let corners = |size| [[size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]];
    let positions: Vec<[f32; 3]> = sizes.flat_map(corners).collect();
    let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh::new(positions, triangles).expect("finite and in range")
}

/// Rays push more entries than the next smaller stack holds, except for the smallest stack.
#[test]
fn stacks_of_each_size_hold_what_a_ray_puts_aside() {
    for (levels, count, sizes) in [(20, 10, 1..=24), (40, 1000, 25..=64), (40, 10_000, 65..=96), (66, 80_000, 97..=256)]
    {
        let mesh = shrinking(levels, count);
        let scene = geometry(&mesh);
        let stack = scene.tree.bvh.stack;
        assert!(sizes.contains(&stack), "{stack} for {levels} and {count}");
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let mut ray = Ray::new(Vec3::splat(-1.0), Vec3::new(1.0, 1.0, 1.0));
        for _ in 0..20 {
            assert_eq!(scene.closest(&ray), linear(&mesh, &ray));
            assert_eq!(scene.occluded(&ray), linear(&mesh, &ray).is_some());
            ray = aimed_ray(&mut rng, &mesh, 0.0, 1.0);
        }
    }
}

/// Returns a hash of a tree, node by node and leaf by leaf.
fn hash_of(geometry: &Geometry) -> u64 {
    let tree = &geometry.tree.bvh;
    let nodes = tree.nodes.iter().flat_map(|node| {
        let bounds = node.bounds.as_flattened().iter().flat_map(|bounds| bounds.0.map(f32::to_bits));
        bounds.chain(node.children.0)
    });
    let leaves = tree.leaves.iter().map(|word| word.to_bits());
    nodes
        .chain(leaves)
        .fold(0xcbf2_9ce4_8422_2325, |hash, word| (hash ^ u64::from(word)).wrapping_mul(0x0100_0000_01b3))
}

/// Trees are identical, whether one or several are built at a time, by one thread or several.
#[test]
fn parallel_builds_make_equal_trees_d05() {
    let hash = built_side_by_side(&scattered(9000), &[2, 4, 8]);
    // Control: another mesh has another tree.
    assert_ne!(hash, hash_of(&geometry(&scattered(9001))));
    built_side_by_side(&scattered(250_000), &[2]);
}

/// Equal boxes are ties in every step that sorts by area.
#[test]
fn parallel_builds_of_equal_triangles_make_equal_trees_d05() {
    built_side_by_side(&grid(316), &[]);
}

/// Hits are bit-identical for different trees, and so are images.
#[test]
fn hits_at_shared_corners_do_not_depend_on_the_tree_g13() {
    let mesh = grid(40);
    let last = mesh.triangles().len() as u32 - 1;
    let backwards = mesh.triangles().iter().rev().copied().collect();
    let reversed = Mesh::new(mesh.positions().to_vec(), backwards).expect("sound");
    let scenes = [geometry(&mesh), in_another_tree(&mesh)];
    // Controls: the trees differ, and the number of a triangle decides.
    assert_ne!(hash_of(&scenes[0]), hash_of(&scenes[1]));
    let (reversed, mut others) = (geometry(&reversed), 0);
    let mut rng = Pcg64Mcg::seed_from_u64(13);
    for corner in mesh.positions().iter().map(|&corner| Vec3::from(corner)) {
        let eye = corner + Vec3::new(rng.random_range(-2.0..2.0), rng.random_range(-2.0..2.0), 3.0);
        for direction in [corner - eye, Vec3::NEG_Z] {
            let ray = Ray::new(corner - direction, direction);
            let hits = scenes.each_ref().map(|scene| scene.closest(&ray));
            assert!(hits.iter().all(|hit| *hit == hits[0]), "{ray:?}: {hits:?}");
            let same = hits[0].zip(reversed.closest(&ray)).is_none_or(|(a, b)| a.primitive == last - b.primitive);
            others += usize::from(!same);
        }
    }
    assert!(others > 1000, "{others}");
}

/// Returns a flat grid of squares, of two triangles each.
fn grid(side: u32) -> Mesh {
    let positions = (0..(side + 1).pow(2)).map(|i| [i % (side + 1), i / (side + 1), 0].map(|x| x as f32)).collect();
    let square = |i: u32| {
        let [a, b] = [0, 1].map(|above| (i / side + above) * (side + 1) + i % side);
        [[a, a + 1, b + 1], [a, b + 1, b]]
    };
    Mesh::new(positions, (0..side * side).flat_map(square).collect()).expect("sound")
}

/// Returns `count` small triangles at random positions.
fn scattered(count: u32) -> Mesh {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let mut point = || [0; 3].map(|_| rng.random_range(-10.0_f32..10.0));
    let positions: Vec<[f32; 3]> = (0..count)
        .flat_map(|_| {
            let [x, y, z] = point();
            [[x, y, z], [x + 0.1, y, z], [x, y + 0.2, z + 0.1]]
        })
        .collect();
    let triangles = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh::new(positions, triangles).expect("sound")
}

/// Returns the hash of the tree, after asserting that it is the same for one thread, five threads, and several builders at
/// once.
fn built_side_by_side(mesh: &Mesh, builders: &[usize]) -> u64 {
    let count = mesh.triangles().len();
    let [alone, by_five] = [1, 5].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| hash_of(&geometry(mesh)))
    });
    assert_eq!(by_five, alone, "by five threads, {count}");
    for &builders in builders {
        std::thread::scope(|scope| {
            let all: Vec<_> = (0..builders).map(|_| scope.spawn(|| hash_of(&geometry(mesh)))).collect();
            for one in all {
                assert_eq!(one.join().expect("it builds"), alone, "{builders} at once, {count}");
            }
        });
    }
    alone
}
