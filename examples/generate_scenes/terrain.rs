//! A scene of fractal mountains about a river plain, under sun and sky.

use super::Assets;
use super::arithmetic::{fbm, gradient_noise, mix, normalize, ridged, smoothstep};
use super::files::{Mesh, lat_long_pfm};

/// Number of cells along each side of the ground's grid. Without cells under water, about 2^17 triangles remain.
const CELLS: usize = 267;
/// y of the near edge of the grid. The grid covers a trapezium along the view: y from NEAR to FAR, and |x| below `HALF
/// + SPREAD (y - NEAR)`.
const NEAR: f64 = -2.0;
const FAR: f64 = 20.0;
const HALF: f64 = 3.0;
const SPREAD: f64 = 0.5;
/// Height below which triangles of the ground are left out. The water lies at z = 0.
const DEPTH_KEPT: f64 = -0.04;
const SEED: u64 = 2016;

/// Number of octaves of noise in the ground. The wavelength of the last octave is about the width of a far cell; more octaves
/// would alias. `COARSE_OCTAVES` make the smoothed ground, whose slope selects the material.
const OCTAVES: u32 = 7;
const COARSE_OCTAVES: u32 = 4;

/// Returns the height of the ground at a point. `octaves` is the number of octaves of noise.
fn height([x, y]: [f64; 2], octaves: u32) -> f64 {
    let river = 1.6 * gradient_noise([0.17 * y, 0.5], SEED + 100) + 0.25 * gradient_noise([0.6 * y, 3.5], SEED + 101);
    let off = (x - river).abs();
    // Mountains rise with the distance from the river, and close the valley far away.
    let rise = smoothstep(0.9, 5.0, off).max(smoothstep(13.0, 18.5, y));
    let far = 0.55 + 0.45 * smoothstep(0.0, 14.0, y);
    let banks = -0.1 + 0.14 * smoothstep(0.35, 0.8, off) + 0.05 * smoothstep(0.7, 2.0, off);
    let plain = 0.05 * fbm([1.3 * x, 1.3 * y], SEED + 200, octaves) * (0.4 + smoothstep(0.6, 2.0, off));
    let mountains = ridged([0.21 * x, 0.21 * y], SEED, octaves);
    let scree = 0.28 * fbm([0.9 * x, 0.9 * y], SEED + 400, octaves);
    banks + plain + rise * far * (2.3 * mountains + 0.5 * rise + scree)
}

/// Returns the point (x, y) of the grid vertex at a column and a row. Rows lie closer together near the camera.
fn place(column: f64, row: f64) -> [f64; 2] {
    let t = row / CELLS as f64;
    let y = NEAR + (FAR - NEAR) * t * (0.35 + 0.65 * t);
    let x = (2.0 * column / CELLS as f64 - 1.0) * (HALF + SPREAD * (y - NEAR));
    [x, y]
}

/// Returns the z component of the smoothed ground's unit normal at a point; 1 where the ground is flat.
fn flatness([x, y]: [f64; 2]) -> f64 {
    const STEP: f64 = 0.08;
    let slope_x = height([x + STEP, y], COARSE_OCTAVES) - height([x - STEP, y], COARSE_OCTAVES);
    let slope_y = height([x, y + STEP], COARSE_OCTAVES) - height([x, y - STEP], COARSE_OCTAVES);
    normalize([-slope_x, -slope_y, 2.0 * STEP])[2]
}

/// Returns the mesh of the ground, without the parts under water.
fn ground() -> Mesh {
    let mut mesh = Mesh::default();
    for row in 0..=CELLS {
        for column in 0..=CELLS {
            let (column, row) = (column as f64, row as f64);
            let [x, y] = place(column, row);
            mesh.add([x, y, height([x, y], OCTAVES)], [0.0; 3]);
        }
    }
    let corner = |column: usize, row: usize| (row * (CELLS + 1) + column) as u32;
    for row in 0..CELLS {
        for column in 0..CELLS {
            let quad = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| corner(column + i, row + j));
            mesh.add_quad(quad);
        }
    }
    mesh.smooth_normals();
    mesh.part(|triangle| mesh.corners(triangle).iter().any(|point| point[2] > DEPTH_KEPT))
}

/// Returns the material of a triangle: rock where steep, snow where high, else grass, with borders perturbed by noise. The
/// slope is measured on the smoothed ground, so that neighbouring triangles get the same material.
fn cover(mesh: &Mesh, triangle: [u32; 3]) -> &'static str {
    let [a, b, c] = mesh.corners(triangle);
    let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0);
    let up = flatness([x, y]);
    let wander = fbm([0.9 * x, 0.9 * y], SEED + 300, 5);
    if z > 2.0 + 0.5 * wander && up > 0.62 + 0.1 * wander {
        "snow"
    } else if up < 0.80 + 0.08 * wander || z > 1.3 + 0.4 * wander {
        "rock"
    } else {
        "grass"
    }
}

/// Returns the sky's radiance from a unit direction: `mix(horizon, zenith, t)`, `t = 1 - (1 - z)^3`. Below the horizon
/// it is constant.
fn sky(direction: [f64; 3]) -> [f64; 3] {
    let low = 1.0 - direction[2].max(0.0);
    mix([0.72, 0.78, 0.86], [0.16, 0.30, 0.62], 1.0 - low * low * low)
}

/// Returns the files beside the scene file: the ground as one mesh per material, and the sky.
pub(crate) fn assets() -> Assets {
    let ground = ground();
    let part = |name| (format!("terrain/{name}.ply"), ground.part(|triangle| cover(&ground, triangle) == name).ply());
    // All columns of the sky are equal; eight columns suit readers that reject very narrow images.
    let sky = ("terrain/sky.pfm".to_owned(), lat_long_pfm(8, 256, sky));
    ["grass", "rock", "snow"].map(part).into_iter().chain([sky]).collect()
}
