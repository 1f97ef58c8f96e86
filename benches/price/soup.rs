//! Triangle soups for failures.

use super::Result;
use dapple_geometry::safeguards::{self, Safeguards};
use dapple_geometry::{Geometry, Mesh, Preset, Shape};
use glam::{DVec3, Vec3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

pub(crate) type Soup = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// A grid of `n x m` quads mapped by `place`.
pub(crate) fn grid(n: u32, m: u32, place: impl Fn(f64, f64) -> DVec3) -> Soup {
    let points = (0..=m).flat_map(|j| (0..=n).map(move |i| (i, j)));
    let positions =
        points.map(|(i, j)| place(f64::from(i) / f64::from(n), f64::from(j) / f64::from(m)).as_vec3().to_array());
    let corner = |i: u32, j: u32| j * (n + 1) + i;
    let quads = (0..m).flat_map(|j| (0..n).map(move |i| (i, j)));
    let triangles = quads.flat_map(|(i, j)| {
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    (positions.collect(), triangles.collect())
}

/// A closed sphere of radius 2 with `2 n` meridians and `n` parallels; the seam and the poles are single places.
pub(crate) fn sphere(n: u32, centre: DVec3) -> Soup {
    let (mut positions, triangles) = grid(2 * n, n, |u, v| {
        let (theta, phi) = (v * PI, u * TAU);
        centre + DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()) * 2.0
    });
    let wide = 2 * n as usize;
    for (row, j) in positions.chunks_mut(wide + 1).zip(0..) {
        row[wide] = row[0];
        if j == 0 || j == n {
            let pole = row[0];
            row.fill(pole);
        }
    }
    (positions, triangles)
}

/// Builds a geometry with each soup as a shape.
pub(crate) fn build<S: Safeguards>(soups: Vec<Soup>, preset: Preset) -> Result<Geometry> {
    let mut shapes = Vec::with_capacity(soups.len());
    for (positions, triangles) in soups {
        shapes.push(Shape::from(Mesh::new(positions, triangles)?));
    }
    Ok(safeguards::build::<S>(shapes, preset)?)
}

/// A direction, uniform on the sphere.
pub(crate) fn direction(rng: &mut Pcg64Mcg) -> Vec3 {
    loop {
        let v = Vec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}
