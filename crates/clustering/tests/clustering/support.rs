//! Meshes and partitions for tests.
#![allow(dead_code, unreachable_pub)]

use dapple_clustering::{ClusterParams, Clusters, Error, Triangles, cluster};

/// A mesh that owns its arrays.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    pub positions: Vec<[f32; 3]>,
    pub indices: Vec<[u32; 3]>,
    pub materials: Vec<u32>,
}

impl Mesh {
    pub fn cluster(&self, params: &ClusterParams) -> Result<Clusters, Error> {
        let Self { positions, indices, materials } = self;
        cluster(&Triangles::new(positions, indices).with_materials(materials), params)
    }

    pub fn add(&mut self, corners: [[f32; 3]; 3]) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners);
        self.indices.push([first, first + 1, first + 2]);
    }

    pub fn corners(&self, triangle: u32) -> [[f32; 3]; 3] {
        self.indices[triangle as usize].map(|vertex| self.positions[vertex as usize])
    }

    /// Maps each vertex.
    pub fn map(&self, f: impl Fn([f32; 3]) -> [f32; 3]) -> Self {
        Self { positions: self.positions.iter().map(|&p| f(p)).collect(), ..self.clone() }
    }

    /// Shuffles triangles and vertices. `order[i]` is the old number of triangle i.
    pub fn shuffle(&self, random: &mut Random) -> (Self, Vec<u32>) {
        let order = random.permutation(self.indices.len());
        let places = random.permutation(self.positions.len());
        let mut new = vec![0; places.len()];
        for (i, &old) in places.iter().enumerate() {
            new[old as usize] = i as u32;
        }
        let mesh = Self {
            positions: places.iter().map(|&old| self.positions[old as usize]).collect(),
            indices: order.iter().map(|&old| self.indices[old as usize].map(|v| new[v as usize])).collect(),
            materials: order.iter().filter_map(|&old| self.materials.get(old as usize).copied()).collect(),
        };
        (mesh, order)
    }
}

/// The SplitMix64 generator [after Steele 2014].
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// The next number in [0, 1), with 24 bits.
    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }

    pub fn permutation(&mut self, n: usize) -> Vec<u32> {
        let mut order: Vec<u32> = (0..n as u32).collect();
        for i in (1..n).rev() {
            order.swap(i, (self.next() % (i as u64 + 1)) as usize);
        }
        order
    }
}

/// Small triangles anywhere in the unit cube, with three materials.
pub fn soup(triangles: u32, size: f32, seed: u64) -> Mesh {
    let mut random = Random(seed);
    let mut mesh = Mesh::default();
    for _ in 0..triangles {
        let centre = [0; 3].map(|_| random.unit());
        mesh.add([0; 3].map(|_| centre.map(|x| x + size * (random.unit() - 0.5))));
        mesh.materials.push((random.next() % 3) as u32);
    }
    mesh
}

/// A bumpy height field over the unit square, with two materials.
pub fn hills(side: u32, seed: u64) -> Mesh {
    let mut random = Random(seed);
    let mut mesh = Mesh::default();
    for row in 0..=side {
        for column in 0..=side {
            let [x, y] = [column, row].map(|i| i as f32 / side as f32);
            let z = 0.1 * (7.0 * x).sin() * (5.0 * y).cos() + 0.2 * random.unit() / side as f32;
            mesh.positions.push([x, y, z]);
        }
    }
    for row in 0..side {
        for column in 0..side {
            let [a, b] = [row, row + 1].map(|row| row * (side + 1) + column);
            mesh.indices.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
            mesh.materials.extend([u32::from(column > side / 3); 2]);
        }
    }
    mesh
}

/// A partition by the first members of its parts; equal partitions give equal results, however numbered.
pub fn parts(labels: &[u32]) -> Vec<usize> {
    let mut first = vec![usize::MAX; labels.len()];
    let mut parts = Vec::new();
    for (i, &label) in labels.iter().enumerate() {
        let first = &mut first[label as usize];
        *first = i.min(*first);
        parts.push(*first);
    }
    parts
}

/// The group of each triangle's cluster.
pub fn groups(clusters: &Clusters) -> Vec<u32> {
    clusters.labels().iter().map(|&label| clusters.clusters()[label as usize].group).collect()
}
