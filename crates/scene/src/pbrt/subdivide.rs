//! Loop's subdivision surfaces, refined to the given level and then moved to their limit
//! [Loop 1987; limit positions and tangents as in Pharr et al. 2016, section 3.8].

use crate::MeshData;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// The index that marks a missing face or vertex.
const NONE: u32 = u32::MAX;

/// A triangle mesh to be subdivided (control mesh), with the adjacency of its faces.
struct Control {
    positions: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    /// For each face, the index of the neighbour across the edge from corner `i` to corner `i + 1`.
    neighbors: Vec<[u32; 3]>,
    /// For each vertex, the index of one of its faces.
    start: Vec<u32>,
    /// For each vertex, the number of its faces.
    count: Vec<u32>,
}

/// The error of a mesh that cannot be subdivided, with the index of the triangle or vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Unfit {
    #[error("triangle {0} has the same corner twice; remove this triangle")]
    Collapsed(usize),
    #[error(
        "the triangles around vertex {0} are not connected; each edge must belong to one or two triangles of the same winding"
    )]
    Tangled(usize),
}

/// Returns the limit surface of a control mesh, sampled after `levels` subdivisions, with normals. Each level
/// multiplies the number of triangles by four.
pub(super) fn subdivide(positions: Vec<DVec3>, faces: Vec<[u32; 3]>, levels: u32) -> Result<MeshData, Unfit> {
    let twice = |f: &[u32; 3]| f[0] == f[1] || f[1] == f[2] || f[2] == f[0];
    if let Some(face) = faces.iter().position(twice) {
        return Err(Unfit::Collapsed(face));
    }
    let mut control = Control::new(positions, faces);
    for _ in 0..levels {
        control = control.refine()?;
    }
    control.limit()
}

fn next(i: usize) -> usize {
    (i + 1) % 3
}

fn previous(i: usize) -> usize {
    (i + 2) % 3
}

/// Returns Loop's weight of each neighbour of an interior vertex with `valence` neighbours.
fn beta(valence: usize) -> f64 {
    if valence == 3 { 3.0 / 16.0 } else { 3.0 / (8.0 * valence as f64) }
}

/// The neighbours of a vertex in order around it, and a flag for vertices on a border.
struct Ring {
    vertices: Vec<u32>,
    border: bool,
}

impl Control {
    fn new(positions: Vec<DVec3>, faces: Vec<[u32; 3]>) -> Self {
        let mut start = vec![NONE; positions.len()];
        let mut count = vec![0; positions.len()];
        for (number, face) in faces.iter().enumerate() {
            for &v in face {
                start[v as usize] = number as u32;
                count[v as usize] += 1;
            }
        }
        let neighbors = neighbors(&edges(&faces), faces.len());
        Self { positions, faces, neighbors, start, count }
    }

    fn corner_of(&self, face: u32, vertex: u32) -> Option<usize> {
        self.faces[face as usize].iter().position(|&v| v == vertex)
    }

    /// Fills `ring` with the neighbours of a vertex. Returns an error if the walk around the vertex would not end.
    fn ring(&self, vertex: u32, ring: &mut Ring) -> Result<(), Unfit> {
        let tangled = Unfit::Tangled(vertex as usize);
        ring.vertices.clear();
        let start = self.start[vertex as usize];
        let mut face = start;
        // Walks from face to face around the vertex, to the first face or to a border.
        for _ in 0..=self.count[vertex as usize] {
            let corner = self.corner_of(face, vertex).ok_or(tangled)?;
            ring.vertices.push(self.faces[face as usize][next(corner)]);
            let across = self.neighbors[face as usize][corner];
            if across == start {
                ring.border = false;
                return Ok(());
            }
            if across == NONE {
                return self.border_ring(vertex, face, ring).ok_or(tangled);
            }
            face = across;
        }
        Err(tangled)
    }

    /// Fills `ring` with the neighbours of a border vertex; `face` is the last face around it. `None` if the walk does
    /// not end at a border.
    fn border_ring(&self, vertex: u32, mut face: u32, ring: &mut Ring) -> Option<()> {
        ring.border = true;
        ring.vertices.clear();
        ring.vertices.push(self.faces[face as usize][next(self.corner_of(face, vertex)?)]);
        for _ in 0..self.count[vertex as usize] {
            let before = previous(self.corner_of(face, vertex)?);
            ring.vertices.push(self.faces[face as usize][before]);
            face = self.neighbors[face as usize][before];
            if face == NONE {
                return Some(());
            }
        }
        None
    }

    /// Returns a vertex's position averaged with its neighbours. Inside the mesh, each neighbour has the weight
    /// `inner(valence)`. On a border, only the two border neighbours count, each with the weight `border`.
    fn drawn(&self, vertex: usize, ring: &Ring, inner: fn(usize) -> f64, border: f64) -> DVec3 {
        let (own, valence) = (self.positions[vertex], ring.vertices.len());
        let at = |i: usize| self.positions[ring.vertices[i] as usize];
        if ring.border {
            return own * (1.0 - 2.0 * border) + (at(0) + at(valence - 1)) * border;
        }
        let weight = inner(valence);
        own * (1.0 - valence as f64 * weight) + (0..valence).map(at).sum::<DVec3>() * weight
    }

    /// Returns the mesh after one level of subdivision.
    fn refine(&self) -> Result<Self, Unfit> {
        let mut ring = Ring { vertices: Vec::new(), border: false };
        let mut positions = Vec::with_capacity(self.positions.len() + 3 * self.faces.len() / 2);
        for vertex in 0..self.positions.len() {
            if self.start[vertex] == NONE {
                positions.push(self.positions[vertex]);
                continue;
            }
            self.ring(vertex as u32, &mut ring)?;
            positions.push(self.drawn(vertex, &ring, beta, 1.0 / 8.0));
        }
        // The vertex in the middle of each edge of each face.
        let mut middles = vec![[NONE; 3]; self.faces.len()];
        for face in 0..self.faces.len() {
            for edge in 0..3 {
                if middles[face][edge] != NONE {
                    continue;
                }
                let middle = positions.len() as u32;
                let [a, b] = [self.faces[face][edge], self.faces[face][next(edge)]];
                let far = self.faces[face][previous(edge)];
                let [pa, pb, pc] = [a, b, far].map(|v| self.positions[v as usize]);
                middles[face][edge] = middle;
                let across = self.neighbors[face][edge];
                if across == NONE {
                    positions.push((pa + pb) * 0.5);
                    continue;
                }
                let other = &self.faces[across as usize];
                let opposite = (0..3).find(|&i| other[i] != a && other[i] != b);
                let opposite = opposite.ok_or(Unfit::Tangled(a as usize))?;
                middles[across as usize][next(opposite)] = middle;
                let pd = self.positions[other[opposite] as usize];
                positions.push((pa + pb) * (3.0 / 8.0) + (pc + pd) * (1.0 / 8.0));
            }
        }
        let faces = self.faces.iter().zip(&middles);
        let parts = faces.flat_map(|(&[a, b, c], &[ab, bc, ca])| [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        Ok(Self::new(positions, parts.collect()))
    }

    /// Returns the mesh with each vertex moved to its limit position, and with normals.
    fn limit(mut self) -> Result<MeshData, Unfit> {
        let mut ring = Ring { vertices: Vec::new(), border: false };
        let gamma = |valence: usize| 1.0 / (valence as f64 + 3.0 / (8.0 * beta(valence)));
        let mut limits = self.positions.clone();
        for (vertex, limit) in limits.iter_mut().enumerate() {
            if self.start[vertex] != NONE {
                self.ring(vertex as u32, &mut ring)?;
                *limit = self.drawn(vertex, &ring, gamma, 1.0 / 5.0);
            }
        }
        self.positions = limits;
        let mut normals = vec![[0.0; 3]; self.positions.len()];
        for (vertex, normal) in normals.iter_mut().enumerate() {
            if self.start[vertex] != NONE {
                self.ring(vertex as u32, &mut ring)?;
                *normal = self.normal(vertex, &ring).normalize_or_zero().as_vec3().to_array();
            }
        }
        Ok(MeshData { positions: self.positions, normals, triangles: self.faces, ..MeshData::default() })
    }

    /// Returns the cross product of the two limit tangents at a vertex, in pbrt's order. It points opposite to the normal of
    /// the winding order.
    fn normal(&self, vertex: usize, ring: &Ring) -> DVec3 {
        let own = self.positions[vertex];
        let n = ring.vertices.len();
        // Relative to the vertex, to keep precision far from the origin.
        let at = |i: usize| self.positions[ring.vertices[i] as usize] - own;
        let (mut s, mut t) = (DVec3::ZERO, DVec3::ZERO);
        if !ring.border {
            for i in 0..n {
                let (sin, cos) = (TAU * i as f64 / n as f64).sin_cos();
                s += at(i) * cos;
                t += at(i) * sin;
            }
            return s.cross(t);
        }
        s += at(n - 1) - at(0);
        t += match n {
            2 => at(0) + at(1),
            3 => at(1),
            4 => -at(0) + 2.0 * at(1) + 2.0 * at(2) - at(3),
            _ => {
                let theta = PI / (n - 1) as f64;
                let ends = (at(0) + at(n - 1)) * theta.sin();
                let inner = (1..n - 1).map(|k| at(k) * ((2.0 * theta.cos() - 2.0) * (k as f64 * theta).sin()));
                -(ends + inner.sum::<DVec3>())
            }
        };
        s.cross(t)
    }
}

/// Returns all edges as (lower vertex, upper vertex, face, edge of the face), sorted, so that the edges of neighbouring
/// faces are adjacent.
fn edges(faces: &[[u32; 3]]) -> Vec<(u32, u32, u32, u8)> {
    let mut edges = Vec::with_capacity(3 * faces.len());
    for (number, face) in faces.iter().enumerate() {
        for i in 0..3 {
            let [a, b] = [face[i], face[next(i)]];
            edges.push((a.min(b), a.max(b), number as u32, i as u8));
        }
    }
    edges.sort_unstable();
    edges
}

/// Returns, for each face, the indices of its neighbours across its three edges. Faces that share an edge are paired in
/// the order of `edges`.
fn neighbors(edges: &[(u32, u32, u32, u8)], faces: usize) -> Vec<[u32; 3]> {
    let mut neighbors = vec![[NONE; 3]; faces];
    let mut rest = edges;
    while let [first, others @ ..] = rest {
        rest = others;
        if let [second, others @ ..] = rest
            && (first.0, first.1) == (second.0, second.1)
        {
            neighbors[first.2 as usize][usize::from(first.3)] = second.2;
            neighbors[second.2 as usize][usize::from(second.3)] = first.2;
            rest = others;
        }
    }
    neighbors
}
