//! Bounds of trees of lights.

#[path = "../../src/lightcuts/tree.rs"]
#[allow(dead_code, reason = "the library uses more of it")]
mod tree;

use dapple_renderer::light::Target;
use glam::Vec3;
use tree::{LightTree, PointLight, luminance};

/// A Weyl sequence in `[0, 1)^6`.
fn numbers(i: u32) -> [f32; 6] {
    [0.754_877, 0.569_840, 0.321_927, 0.245_122, 0.138_996, 0.618_034]
        .map(|a: f64| (f64::from(i + 1) * a).fract() as f32)
}

fn lights(count: u32, oriented: bool) -> Vec<PointLight> {
    let light = |i| {
        let [x, y, z, u, v, w] = numbers(i);
        let facing = Vec3::new(u - 0.5, v - 0.5, -0.8 + 0.2 * w).normalize();
        let facing = if oriented { facing } else { Vec3::ZERO };
        let intensity = Vec3::new(0.1 + u, 0.1 + v, 0.1 + w * w);
        PointLight::new(Vec3::new(x, y, 1.0 + 0.3 * z), facing, intensity, Target::Far)
    };
    (0..count).map(light).collect()
}

fn irradiance(light: &PointLight, position: Vec3, normal: Vec3) -> f32 {
    let to = light.position - position;
    let squared = to.length_squared();
    let wi = to / squared.sqrt();
    let at_light = if light.facing == Vec3::ZERO { 1.0 } else { (-light.facing.dot(wi)).max(0.0) };
    luminance(light.intensity) * normal.dot(wi).max(0.0) * at_light / squared
}

#[test]
fn no_node_contributes_more_than_its_bound() {
    for oriented in [false, true] {
        let tree = LightTree::new(lights(200, oriented), false, 1.0);
        // The lights of each node, from the leaves up.
        let mut below: Vec<Vec<u32>> = vec![Vec::new(); tree.nodes.len()];
        for number in (0..tree.nodes.len()).rev() {
            let node = tree.nodes[number];
            below[number] = match node.children {
                None => vec![node.lights[0]],
                Some([a, b]) => [below[a as usize].clone(), below[b as usize].clone()].concat(),
            };
            let sum: f32 = below[number].iter().map(|l| luminance(tree.lights[*l as usize].intensity)).sum();
            assert!((node.strength / sum - 1.0).abs() < 1e-4, "a node has the sum of its lights");
        }
        let mut tight = 0;
        for i in 0..300 {
            let [x, y, z, u, v, _] = numbers(1000 + i);
            let position = Vec3::new(2.0 * x - 0.5, 2.0 * y - 0.5, 1.5 * z);
            let normal = Vec3::new(u - 0.5, v - 0.5, 0.3).normalize();
            for (node, below) in tree.nodes.iter().zip(&below) {
                let bound = node.bound(false, position, normal, 0.0);
                let all: f32 = below.iter().map(|l| irradiance(&tree.lights[*l as usize], position, normal)).sum();
                assert!(all <= 1.0001 * bound + 1e-6, "{all} of at most {bound}");
                // The node's representative light is within the bound as well.
                let light = &tree.lights[node.lights[1] as usize];
                let stands = irradiance(light, position, normal) * node.strength / luminance(light.intensity);
                assert!(stands <= 1.0001 * bound + 1e-6);
                tight += usize::from(all > 0.3 * bound && node.children.is_some());
            }
        }
        assert!(tight > 10_000, "bounds are not infinite: {tight}");
    }
}

#[test]
fn directions_have_bounds_too() {
    let directions: Vec<PointLight> = lights(100, false)
        .into_iter()
        .map(|light| PointLight { position: (light.position - Vec3::splat(0.5)).normalize(), ..light })
        .collect();
    let tree = LightTree::new(directions, true, 1.0);
    for i in 0..200 {
        let [x, y, z, ..] = numbers(i);
        let normal = (Vec3::new(x, y, z) - Vec3::splat(0.5)).normalize();
        let all = tree.lights.iter().map(|l| luminance(l.intensity) * normal.dot(l.position).max(0.0)).sum::<f32>();
        assert!(all <= 1.0001 * tree.nodes[0].bound(true, Vec3::ZERO, normal, 0.0));
    }
}
