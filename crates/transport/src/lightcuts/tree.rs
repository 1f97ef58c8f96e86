//! Trees of lights reduced to points, and upper bounds on the contributions of their nodes.

use dapple_renderer::light::Target;
use glam::Vec3;

/// The number of sets of representative lights. Their errors average out over samples.
pub(super) const SETS: usize = 4;

/// A light reduced to a point, or to a direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct PointLight {
    /// The target of shadow rays.
    pub(super) target: Target,
    /// The position. For light from infinity, the unit direction towards it.
    pub(super) position: Vec3,
    /// The unit normal of a flat emitter, whose light falls off with the cosine; zero if it emits in all directions.
    pub(super) facing: Vec3,
    /// The largest linear RGB radiant intensity. For light from infinity, the irradiance.
    pub(super) intensity: Vec3,
    /// The radius of a spherical light around the position, on which shadow rays end; 0 for other lights.
    pub(super) radius: f32,
    /// The index of a delta light, whose intensity depends on the direction; `u32::MAX` for other lights.
    pub(super) delta: u32,
}

impl PointLight {
    /// Makes a point on a surface, in space, or at infinity.
    pub(super) fn new(position: Vec3, facing: Vec3, intensity: Vec3, target: Target) -> Self {
        Self { target, position, facing, intensity, radius: 0.0, delta: u32::MAX }
    }
}

/// A node of a tree: a group of lights.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// The corners of the positions' bounding box.
    pub(super) low: Vec3,
    pub(super) high: Vec3,
    /// Half of the box's diagonal.
    reach: f32,
    /// The axis of a cone that contains all normals, and the cosine and sine of its half-angle. The cosine is -1 for lights
    /// that emit in all directions.
    pub(super) axis: Vec3,
    pub(super) cone: [f32; 2],
    /// The sum of the intensities, and its luminance.
    pub(super) intensity: Vec3,
    pub(super) strength: f32,
    /// The two children; `None` for a leaf.
    pub(super) children: Option<[u32; 2]>,
    /// The representative light of the group, in each set.
    pub(super) lights: [u32; SETS],
}

/// A binary tree over lights of one kind. Node 0 is the root.
#[derive(Clone, Debug, Default)]
pub(super) struct LightTree {
    pub(super) lights: Vec<PointLight>,
    pub(super) nodes: Vec<Node>,
    /// True for light from infinity, whose positions are directions towards the light.
    pub(super) far: bool,
}

impl LightTree {
    /// Builds a tree by splitting groups at the median of their box's longest side. Normals count as further coordinates,
    /// scaled to the size of the scene, so that nearby lights with different normals are separated. Walter et al. merge the
    /// cheapest pairs instead, which gives cuts of the same size on the scene `many-lights`.
    pub(super) fn new(lights: Vec<PointLight>, far: bool, scene_radius: f32) -> Self {
        let mut tree = Self { nodes: Vec::with_capacity(2 * lights.len()), lights, far };
        if !tree.lights.is_empty() {
            let mut order: Vec<u32> = (0..tree.lights.len() as u32).collect();
            tree.build(&mut order, scene_radius);
        }
        tree
    }

    fn build(&mut self, group: &mut [u32], scene_radius: f32) -> u32 {
        let number = self.nodes.len() as u32;
        if let [light] = *group {
            self.nodes.push(Node::leaf(light, &self.lights[light as usize]));
            return number;
        }
        let coordinate = |light: u32, axis: usize| {
            let PointLight { position, facing, .. } = self.lights[light as usize];
            if axis < 3 { position[axis] } else { facing[axis - 3] * scene_radius }
        };
        let width = |axis: usize| {
            let values = group.iter().map(|&light| coordinate(light, axis));
            values.clone().fold(f32::MIN, f32::max) - values.fold(f32::MAX, f32::min)
        };
        let longest = (0..6).map(|axis| (width(axis), axis)).fold((-1.0, 0), |a, b| if b.0 > a.0 { b } else { a }).1;
        let middle = group.len() / 2;
        let key = |light: &u32| coordinate(*light, longest);
        group.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
        // A placeholder, whose number is below its children's.
        self.nodes.push(Node::leaf(group[0], &self.lights[group[0] as usize]));
        let (first, second) = group.split_at_mut(middle);
        let children = [self.build(first, scene_radius), self.build(second, scene_radius)];
        self.nodes[number as usize] = self.around(number, children);
        number
    }

    /// Returns the group that combines the groups of two nodes. `number` is the index of the new node.
    fn around(&self, number: u32, children: [u32; 2]) -> Node {
        let [a, b] = children.map(|child| self.nodes[child as usize]);
        let (axis, cone) = join([(a.axis, a.cone), (b.axis, b.cone)]);
        let strength = a.strength + b.strength;
        // The light of one child represents both children. It is selected at random in proportion to intensity.
        let lights = std::array::from_fn(|set| {
            let u = hash(number, set as u32);
            if u * strength < a.strength { a.lights[set] } else { b.lights[set] }
        });
        let (low, high, intensity) = (a.low.min(b.low), a.high.max(b.high), a.intensity + b.intensity);
        // Rounding must not make the box too small.
        let reach = 0.5001 * (high - low).length();
        Node { low, high, reach, axis, cone, intensity, strength, children: Some(children), lights }
    }
}

/// Returns a small cone that contains two cones. The axis lies between the axes of both, and the result does not depend on the
/// order of the cones.
fn join([(a, of_a), (b, of_b)]: [(Vec3, [f32; 2]); 2]) -> (Vec3, [f32; 2]) {
    const ALL: (Vec3, [f32; 2]) = (Vec3::ZERO, [-1.0, 0.0]);
    if of_a[0] <= -1.0 || of_b[0] <= -1.0 {
        return ALL;
    }
    let Some(axis) = (a + b).try_normalize() else { return ALL };
    // The cosine of the sum of two angles; beyond a half turn the cone is the whole sphere.
    let beyond = |to: Vec3, cone: [f32; 2]| {
        let cosine = axis.dot(to).clamp(-1.0, 1.0);
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let sum = cosine * cone[0] - sine * cone[1];
        if sine * cone[0] + cosine * cone[1] < 0.0 { -1.0 } else { sum }
    };
    // Rounding must not make the cone too narrow.
    let cosine = beyond(a, of_a).min(beyond(b, of_b)) - 1e-5;
    if cosine <= -1.0 { ALL } else { (axis, [cosine, (1.0 - cosine * cosine).max(0.0).sqrt()]) }
}

/// Returns a hash of a node and a set, in `[0, 1)`.
fn hash(node: u32, set: u32) -> f32 {
    let mut x = node.wrapping_mul(0x9e37_79b9) ^ set.wrapping_mul(0x85eb_ca6b) ^ 0x5bd1_e995;
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    (x >> 8) as f32 / (1 << 24) as f32
}

pub(super) fn luminance(rgb: Vec3) -> f32 {
    dapple_core::film::luminance(rgb.to_array().map(f64::from)) as f32
}

impl Node {
    fn leaf(number: u32, light: &PointLight) -> Self {
        let &PointLight { position, facing, intensity, .. } = light;
        let cone = if facing == Vec3::ZERO { [-1.0, 0.0] } else { [1.0, 0.0] };
        let strength = luminance(intensity);
        let (low, high, axis) = (position, position, facing);
        Self { low, high, reach: 0.0, axis, cone, intensity, strength, children: None, lights: [number; SETS] }
    }

    /// Returns an upper bound on the luminance of the irradiance from the group's lights at a point. The point's unit normal
    /// is on the lit side. A bound far below `enough` need not be tight.
    ///
    /// The bound is the group's intensity times the largest cosine at the surface and the largest cosine at the lights, divided
    /// by the smallest squared distance. Each extreme is taken over the whole box and cone [Walter et al. 2005].
    pub(super) fn bound(&self, far: bool, position: Vec3, normal: Vec3, enough: f32) -> f32 {
        if far {
            // The box contains the directions towards the lights.
            let most = self.low.max(self.high);
            let best = (normal * self.low).max(normal * most);
            return self.strength * (best.x + best.y + best.z).clamp(0.0, 1.0);
        }
        let (low, high) = (self.low - position, self.high - position);
        let squared = Vec3::ZERO.clamp(low, high).length_squared();
        let without_cosines = self.strength / squared.max(f32::MIN_POSITIVE);
        if without_cosines <= 0.5 * enough {
            return without_cosines;
        }
        let at_surface = largest_cosine([low, high], squared, self.reach, normal);
        if at_surface <= 0.0 {
            return 0.0;
        }
        // The cosine at a light equals the cosine between the opposite axis and the vector from the point to the light.
        let at_lights = match self.cone[0] <= -1.0 {
            true => 1.0,
            false => widened(largest_cosine([low, high], squared, self.reach, -self.axis), self.cone),
        };
        without_cosines * at_surface * at_lights
    }
}

/// Returns an upper bound, at most 1, on the cosine between a unit axis and the vectors from the origin to a box. `squared` is
/// the smallest squared distance between the box and the origin, and `reach` half of the box's diagonal.
#[inline]
fn largest_cosine([low, high]: [Vec3; 2], squared: f32, reach: f32, axis: Vec3) -> f32 {
    let best = (axis * low).max(axis * high);
    let along = best.x + best.y + best.z;
    if along <= 0.0 {
        return 0.0;
    }
    // A lower bound on the distance between the axis and any point of the box. The length of a vector is at least the smallest
    // distance of the box.
    let middle = (low + high) * 0.5;
    let across = ((middle - axis * middle.dot(axis)).length() - reach).max(0.0);
    (along / (along * along + across * across).max(squared).sqrt()).min(1.0)
}

/// Returns the largest cosine after a rotation by at most the half-angle of a cone.
fn widened(cosine: f32, [cone_cosine, cone_sine]: [f32; 2]) -> f32 {
    if cosine >= cone_cosine {
        return 1.0;
    }
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    (cosine * cone_cosine + sine * cone_sine).clamp(0.0, 1.0)
}
