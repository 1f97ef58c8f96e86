//! Construction of meshes, and encoding of meshes as binary PLY files, of radiance as PFM and of colours as TGA images.

use super::arithmetic::{add, cross, dot, lat_long_direction, normalize, sub};

/// Indexed triangles with one normal per vertex.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    pub(crate) positions: Vec<[f64; 3]>,
    /// Unit vertex normals, one per position.
    pub(crate) normals: Vec<[f64; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Adds a vertex and returns its index.
    pub(crate) fn add(&mut self, position: [f64; 3], normal: [f64; 3]) -> u32 {
        self.positions.push(position);
        self.normals.push(normal);
        (self.positions.len() - 1) as u32
    }

    /// Adds the quadrilateral `a b c d` as two triangles of the same winding. Skips triangles with two equal vertices.
    pub(crate) fn add_quad(&mut self, [a, b, c, d]: [u32; 4]) {
        for triangle in [[a, b, c], [a, c, d]] {
            if triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0] {
                self.triangles.push(triangle);
            }
        }
    }

    /// Returns the positions of a triangle's vertices.
    pub(crate) fn corners(&self, triangle: [u32; 3]) -> [[f64; 3]; 3] {
        triangle.map(|corner| self.positions[corner as usize])
    }

    /// Returns the normal of a triangle, oriented by its winding. Its length is twice the triangle's area.
    pub(crate) fn face_normal(&self, triangle: [u32; 3]) -> [f64; 3] {
        let [a, b, c] = self.corners(triangle);
        cross(sub(b, a), sub(c, a))
    }

    /// Sets the vertex normals of a height field (z up) to the area-weighted mean of the adjoining triangles' normals.
    ///
    /// On sharp ridges, a mean can point to the inner side of an adjoining triangle. It is then tilted upwards until it does
    /// not.
    pub(crate) fn smooth_normals(&mut self) {
        const LEAST_COSINE: f64 = 0.05;
        let mut sums = vec![[0.0; 3]; self.positions.len()];
        for &triangle in &self.triangles {
            let normal = self.face_normal(triangle);
            for corner in triangle {
                sums[corner as usize] = add(sums[corner as usize], normal);
            }
        }
        self.normals = sums.into_iter().map(normalize).collect();
        let mut lift = vec![0.0f64; self.positions.len()];
        for &triangle in &self.triangles {
            let face = normalize(self.face_normal(triangle));
            for corner in triangle {
                let missing = LEAST_COSINE - dot(self.normals[corner as usize], face);
                lift[corner as usize] = lift[corner as usize].max(missing / face[2]);
            }
        }
        for (normal, lift) in self.normals.iter_mut().zip(lift) {
            *normal = normalize(add(*normal, [0.0, 0.0, lift]));
        }
    }

    /// Returns a mesh of the triangles for which `keep` returns true, without unused vertices.
    pub(crate) fn part(&self, keep: impl Fn([u32; 3]) -> bool) -> Self {
        let mut part = Self::default();
        let mut number = vec![u32::MAX; self.positions.len()];
        for &triangle in self.triangles.iter().filter(|&&triangle| keep(triangle)) {
            let moved = triangle.map(|corner| {
                let corner = corner as usize;
                if number[corner] == u32::MAX {
                    number[corner] = part.add(self.positions[corner], self.normals[corner]);
                }
                number[corner]
            });
            part.triangles.push(moved);
        }
        part
    }

    /// Encodes the mesh as a binary little-endian PLY file: x y z nx ny nz as f32, and vertex indices as u16 if possible, else
    /// u32.
    pub(crate) fn ply(&self) -> Vec<u8> {
        // With u32, about half of the file would be indices. Terrain is cut into parts that fit u16.
        let short = self.positions.len() <= usize::from(u16::MAX) + 1;
        let index = if short { "ushort" } else { "uint" };
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\ncomment Made by the Dapple developers; MIT OR Apache-2.0\n\
             element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             property float nx\nproperty float ny\nproperty float nz\n\
             element face {}\nproperty list uchar {index} vertex_indices\nend_header\n",
            self.positions.len(),
            self.triangles.len()
        )
        .into_bytes();
        for (position, normal) in self.positions.iter().zip(&self.normals) {
            for value in position.iter().chain(normal) {
                bytes.extend((*value as f32).to_le_bytes());
            }
        }
        for triangle in &self.triangles {
            bytes.push(3);
            for &corner in triangle {
                if short {
                    bytes.extend((corner as u16).to_le_bytes());
                } else {
                    bytes.extend(corner.to_le_bytes());
                }
            }
        }
        bytes
    }
}

/// Encodes a latitude-longitude PFM image. `radiance` returns the RGB radiance from a unit direction (z up); it is
/// called for each pixel's centre.
pub(crate) fn lat_long_pfm(width: usize, height: usize, radiance: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<u8> {
    let mut bytes = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    // PFM begins with the bottom row.
    for row in (0..height).rev() {
        for column in 0..width {
            for channel in radiance(lat_long_direction(column, row, width, height)) {
                bytes.extend((channel as f32).to_le_bytes());
            }
        }
    }
    bytes
}

/// Encodes an uncompressed TGA image of grey, RGB or RGBA bytes. `pixel` returns the bytes at a column and a row, counted from
/// the top left.
pub(crate) fn tga<const N: usize>([width, height]: [u16; 2], pixel: impl Fn(u16, u16) -> [u8; N]) -> Vec<u8> {
    // True colour, or grey.
    let kind = if N == 1 { 3 } else { 2 };
    // The fields: no id, no palette, the kind, palette and origin all 0, size, bits per pixel, and the descriptor (rows from
    // the top left; 8 bits of opacity or none).
    let mut bytes = vec![0, 0, kind, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    bytes.extend(width.to_le_bytes());
    bytes.extend(height.to_le_bytes());
    bytes.extend([8 * N as u8, if N == 4 { 0x28 } else { 0x20 }]);
    for row in 0..height {
        for column in 0..width {
            let mut pixel = pixel(column, row);
            // The file's order is blue, green, red.
            if N > 1 {
                pixel.swap(0, 2);
            }
            bytes.extend(pixel);
        }
    }
    // The footer of TGA 2.0, without which some readers do not know the format; no extensions.
    bytes.extend([0; 8]);
    bytes.extend(b"TRUEVISION-XFILE.\0");
    bytes
}
