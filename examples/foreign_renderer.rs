//! Dapple in your own renderer: clusters, adaptive sampling and denoising for a renderer that shares no code with Dapple.
//!
//! ```sh
//! cargo run --release --example foreign_renderer -- out
//! ```
//!
//! Everything from [`V3`] on is the foreign renderer: vectors, scene, ray tracer, integrator and image files. It passes three
//! things to Dapple: slices of triangles, a closure that finds first hits, and an [`Integrator`].
//!
//! The program renders with uniform and with cluster-adaptive sampling at the same number of samples, filters both images and
//! prints their errors. It writes `image.ppm`, `samples.ppm` (white = many samples) and `clusters.ppm` to the given folder,
//! else to a temporary one.

#![expect(clippy::print_stdout, reason = "the program prints its result")]

use dapple_cluster_adaptive::{BACKGROUND, ClusterThesis, FirstHitSurface, Placement, first_hits};
use dapple_clustering::{ClusterParams, Sides, Triangles, cluster};
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, Filter, Frame, Integrator, Limits};
use dapple_core::{Render, Sampler, Unfiltered, Worker};
use dapple_denoise::{ClusterGaussian, Gaussian};
use dapple_low_discrepancy::Sobol;
use dapple_metrics::{Pixels, compare};
use std::f32::consts::{PI, TAU};
use std::ops::{Add, Mul, Sub};
use std::path::{Path, PathBuf};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const SIZE: [u32; 2] = [144, 80];
const SPP: u64 = 16;
const SEEDS: u64 = 5;
/// Student's t for 95 % and `SEEDS - 1` degrees of freedom.
const STUDENT: f64 = 2.776;
const REFERENCE_SPP: u64 = 256;
/// The number of clusters. Each contains several triangles, and is small enough to separate objects.
const CLUSTERS: u32 = 1000;

fn main() -> Result<()> {
    let folder = std::env::args_os().nth(1).map_or_else(|| std::env::temp_dir().join("dapple-foreign"), PathBuf::from);
    std::fs::create_dir_all(&folder)?;
    let mut scene = Scene::bay();
    let frame = Frame::new(SIZE[0], SIZE[1])?;

    // Triangles in, clusters out.
    let positions: Vec<[f32; 3]> = scene.positions.iter().map(|p| p.0).collect();
    let triangles = Triangles::new(&positions, &scene.triangles).with_materials(&scene.materials);
    // Windings are consistent here, so signed normals separate the near and far side of a small ball.
    let clusters = cluster(&triangles, &ClusterParams { sides: Sides::Signed, ..ClusterParams::for_count(CLUSTERS) })?;

    // First hits in; the sampler turns them into a sample count per pixel. `Centre` needs no points.
    let first_hits = first_hits(&frame, Placement::Centre, &Sobol::new(0), clusters.labels(), |ray| {
        let direction = scene.camera_ray(ray.film);
        let hit = scene.first_hit(EYE, direction, f32::INFINITY)?;
        let (direction, normal) = (direction.0, hit.normal.0);
        Some(FirstHitSurface {
            primitive: hit.triangle,
            direction,
            distance: hit.t,
            normal,
            footprint: hit.t * PIXEL_WIDTH,
        })
    })?;
    println!("{} triangles, {} clusters", clusters.labels().len(), clusters.len());

    let clusters_seen = first_hits.cluster_map();
    let filters: [Box<dyn Filter>; 3] = [
        Box::new(Unfiltered),
        Box::new(Gaussian::default()),
        Box::new(ClusterGaussian::from_map(SIZE, clusters_seen.clone())?),
    ];

    // The reference: two halves with different seeds. Their difference estimates its error.
    let halves = [1001, 1002].map(|seed| image(&mut scene, &mut Uniform::new(Sobol::new(seed)), REFERENCE_SPP / 2));
    let [first, second] = halves.map(|film| film.map(|f| f.image()));
    let (first, second) = (first?, second?);
    let mean = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c: usize| 0.5 * (a[c] + b[c]));
    let reference: Vec<_> = first.iter().zip(&second).map(mean).collect();

    // Only the sampler differs.
    let mut pairs = Vec::new();
    for seed in 1..=SEEDS {
        let mut uniform = Uniform::new(Sobol::new(seed));
        let mut adaptive = ClusterThesis::published(Sobol::new(seed), &first_hits, clusters.clusters())?;
        pairs.push([image(&mut scene, &mut uniform, SPP)?, image(&mut scene, &mut adaptive, SPP)?]);
    }
    print_table(&filters, &pairs, &reference)?;
    let [u, a] = [0, 1].map(|which| pairs.iter().map(|pair| pair[which].record().rays).sum::<u64>());
    let more = 100.0 * ((a + SEEDS * first_hits.cost().rays) as f64 / u as f64 - 1.0);
    println!(
        "\nAdaptive images used {more:.1} % more rays, first-hit rays included. A gain smaller than this vanishes at equal numbers of rays."
    );
    let own = rel_mse(&first, &second)? / 4.0;
    println!("The reference, {REFERENCE_SPP} samples per pixel, has an error of {own:.1e}.");
    write_images(&folder, &pairs[0][1], &clusters_seen)
}

/// Renders an image with a mean of exactly `spp` samples per pixel. This program's filters need only means and counts, which
/// are always recorded. For other filters, pass their needs to [`Render`] here.
fn image(scene: &mut Scene, sampler: &mut dyn Sampler, spp: u64) -> Result<Film> {
    let frame = Frame::new(SIZE[0], SIZE[1])?;
    let limits = Limits::samples(spp * frame.pixels() as u64);
    Ok(Render::new(frame, &limits).run(scene, sampler)?)
}

fn rel_mse(image: &[[f32; 3]], reference: &[[f32; 3]]) -> Result<f64> {
    Ok(compare(Pixels::new(SIZE, image)?, Pixels::new(SIZE, reference)?)?.rel_mse)
}

/// Prints errors as means over seeds, and ratios as geometric means with a 95 % interval (paired by seed, Student's t).
fn print_table(filters: &[Box<dyn Filter>], pairs: &[[Film; 2]], reference: &[[f32; 3]]) -> Result<()> {
    println!("relMSE at {}x{} pixels, {SPP} samples per pixel on average, {SEEDS} seeds.", SIZE[0], SIZE[1]);
    println!("A ratio below 1 means that the adaptive image has less error.\n");
    println!("| filter | uniform | cluster-adaptive | ratio |\n|---|---|---|---|");
    for filter in filters {
        let errors = |which: usize| -> Result<Vec<f64>> {
            pairs.iter().map(|pair| rel_mse(&filter.apply(&pair[which])?.radiance, reference)).collect()
        };
        let (uniform, adaptive) = (errors(0)?, errors(1)?);
        let n = pairs.len() as f64;
        let mean = |values: &[f64]| values.iter().sum::<f64>() / n;
        let logs: Vec<f64> = adaptive.iter().zip(&uniform).map(|(a, u)| (a / u).ln()).collect();
        let middle = mean(&logs);
        let variance = logs.iter().map(|l| (l - middle).powi(2)).sum::<f64>() / (n - 1.0);
        let half = STUDENT * (variance / n).sqrt();
        let [low, middle, high] = [middle - half, middle, middle + half].map(f64::exp);
        let (name, uniform, adaptive) = (filter.name(), mean(&uniform), mean(&adaptive));
        println!("| {name} | {uniform:.2e} | {adaptive:.2e} | {middle:.3} [{low:.3}, {high:.3}] |");
    }
    Ok(())
}

fn write_images(folder: &Path, film: &Film, clusters: &[u32]) -> Result<()> {
    let most = film.counts().into_iter().max().unwrap_or(1) as f32;
    let counts: Vec<[f32; 3]> = film.counts().iter().map(|&n| [n as f32 / most; 3]).collect();
    // A pseudo-random colour per cluster.
    let byte = |cluster: u32, c: u32| (cluster.wrapping_mul(0x9E37_79B1) >> (8 * c)) as u8;
    let colour = |&cluster: &u32| match cluster {
        BACKGROUND => [0.0; 3],
        _ => [1, 2, 3].map(|c| 0.2 + 0.8 * f32::from(byte(cluster, c)) / 255.0),
    };
    let colours = clusters.iter().map(colour).collect();
    let display = film.image().iter().map(|p| p.map(|x| x.powf(1.0 / 2.2))).collect();
    for (name, pixels) in [("image.ppm", display), ("samples.ppm", counts), ("clusters.ppm", colours)] {
        let path = folder.join(name);
        write_ppm(&path, &pixels)?;
        println!("wrote {}", path.display());
    }
    Ok(())
}

// From here on: the foreign renderer. It uses Dapple only in `impl Integrator`.

/// The renderer's own vector type.
#[derive(Clone, Copy)]
struct V3([f32; 3]);

const fn v3(x: f32, y: f32, z: f32) -> V3 {
    V3([x, y, z])
}

impl Add for V3 {
    type Output = V3;
    fn add(self, o: V3) -> V3 {
        self.zip(o, |a, b| a + b)
    }
}

impl Sub for V3 {
    type Output = V3;
    fn sub(self, o: V3) -> V3 {
        self.zip(o, |a, b| a - b)
    }
}

impl Mul<f32> for V3 {
    type Output = V3;
    fn mul(self, s: f32) -> V3 {
        V3(self.0.map(|a| a * s))
    }
}

impl V3 {
    fn zip(self, V3([x, y, z]): V3, f: impl Fn(f32, f32) -> f32) -> V3 {
        v3(f(self.0[0], x), f(self.0[1], y), f(self.0[2], z))
    }
    fn dot(self, o: V3) -> f32 {
        let V3([x, y, z]) = self.zip(o, |a, b| a * b);
        x + y + z
    }
    fn cross(self, V3([x, y, z]): V3) -> V3 {
        let V3([a, b, c]) = self;
        v3(b * z - c * y, c * x - a * z, a * y - b * x)
    }
    fn unit(self) -> V3 {
        self * (1.0 / self.dot(self).sqrt())
    }
}

/// The largest number of triangles in a leaf of the tree.
const LEAF: usize = 4;
const EYE: V3 = v3(0.0, -9.0, 3.2);
/// The width of a pixel at distance 1.
const PIXEL_WIDTH: f32 = 1.1 / SIZE[0] as f32;
/// The centre of the light: a square facing down, invisible to the camera.
const LAMP: V3 = v3(3.0, -2.0, 6.0);
const LAMP_SIDE: f32 = 2.0;
const LAMP_RADIANCE: f32 = 16.0;
/// The albedos of water, clay and chalk.
const ALBEDO: [[f32; 3]; 3] = [[0.25, 0.4, 0.45], [0.75, 0.35, 0.2], [0.8, 0.8, 0.75]];

fn sky(direction: V3) -> [f32; 3] {
    let up = direction.0[2].max(0.0);
    [0.75 - 0.5 * up, 0.8 - 0.4 * up, 0.85 - 0.2 * up]
}

struct Hit {
    t: f32,
    triangle: u32,
    /// The unit normal on the ray's side.
    normal: V3,
}

#[derive(Default)]
struct Scene {
    positions: Vec<V3>,
    triangles: Vec<[u32; 3]>,
    materials: Vec<u32>,
    /// The triangles in the order of the tree's leaves. Each of the children `2 i + 1` and `2 i + 2` of node `i` has half of
    /// its triangles.
    order: Vec<u32>,
    boxes: Vec<[V3; 2]>,
}

impl Scene {
    /// Waves and two balls.
    fn bay() -> Self {
        let mut scene = Self::default();
        let wave = |x: f32, y: f32| 0.12 * (1.7 * x + 0.6 * y).sin() + 0.1 * (2.3 * y - 0.4 * x).sin();
        scene.sheet([40, 40], 0, |u, v| {
            let (x, y) = (14.0 * u - 7.0, 14.0 * v - 7.0);
            v3(x, y, wave(x, y))
        });
        for (centre, radius, material) in [(v3(-1.5, 0.0, 1.2), 1.3, 1), (v3(1.3, -2.0, 0.8), 0.8, 2)] {
            scene.sheet([32, 16], material, |u, v| {
                let (ring, height) = (PI * v).sin_cos();
                let (y, x) = (TAU * u).sin_cos();
                centre + v3(ring * x, ring * y, height) * radius
            });
        }
        scene.order = (0..scene.triangles.len() as u32).collect();
        scene.build(0, 0, scene.order.len());
        scene
    }

    /// Adds a surface over the unit square, with two triangles per cell.
    fn sheet(&mut self, cells: [u32; 2], material: u32, point: impl Fn(f32, f32) -> V3) {
        let [columns, rows] = cells;
        let first = self.positions.len() as u32;
        let at = |i, n| i as f32 / n as f32;
        for j in 0..=rows {
            self.positions.extend((0..=columns).map(|i| point(at(i, columns), at(j, rows))));
        }
        for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
            let a = first + j * (columns + 1) + i;
            let c = a + columns + 1;
            self.triangles.extend([[a, a + 1, c + 1], [a, c + 1, c]]);
            self.materials.extend([material; 2]);
        }
    }

    fn corners(&self, triangle: u32) -> [V3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    /// Builds the tree below `node`: halves the triangles from `start` to `end` along the longest axis of their box until they
    /// fit into a leaf.
    fn build(&mut self, node: usize, start: usize, end: usize) {
        let mut part = self.order[start..end].to_vec();
        let corners = || part.iter().flat_map(|&t| self.corners(t));
        let low = corners().fold(v3(1e9, 1e9, 1e9), |a, b| a.zip(b, f32::min));
        let high = corners().fold(v3(-1e9, -1e9, -1e9), |a, b| a.zip(b, f32::max));
        self.boxes.resize(self.boxes.len().max(node + 1), [low, high]);
        self.boxes[node] = [low, high];
        if part.len() <= LEAF {
            return;
        }
        let size = (high - low).0;
        let axis = (0..3).fold(0, |best, a| if size[a] > size[best] { a } else { best });
        let key = |t: &u32| self.corners(*t).iter().map(|c| c.0[axis]).sum::<f32>();
        part.sort_unstable_by(|a, b| key(a).total_cmp(&key(b)));
        self.order[start..end].copy_from_slice(&part);
        let middle = (start + end) / 2;
        self.build(2 * node + 1, start, middle);
        self.build(2 * node + 2, middle, end);
    }

    /// The nearest triangle within distance `reach`.
    fn first_hit(&self, from: V3, direction: V3, reach: f32) -> Option<Hit> {
        let inverse = V3(direction.0.map(|x| 1.0 / x));
        let (mut nearest, mut found) = (reach, None);
        let (mut stack, mut depth) = ([(0, 0, self.order.len()); 32], 1);
        while depth > 0 {
            depth -= 1;
            let (node, start, end) = stack[depth];
            let [a, b] = self.boxes[node].map(|corner| (corner - from).zip(inverse, |a, b| a * b));
            let enter = a.zip(b, f32::min).0.into_iter().fold(0.0, f32::max);
            let leave = a.zip(b, f32::max).0.into_iter().fold(nearest, f32::min);
            if enter > leave {
                continue;
            }
            if end - start > LEAF {
                let middle = (start + end) / 2;
                stack[depth] = (2 * node + 2, middle, end);
                stack[depth + 1] = (2 * node + 1, start, middle);
                depth += 2;
                continue;
            }
            for &triangle in &self.order[start..end] {
                if let Some(t) = intersect(self.corners(triangle), from, direction).filter(|&t| t < nearest) {
                    (nearest, found) = (t, Some(triangle));
                }
            }
        }
        let triangle = found?;
        let [a, b, c] = self.corners(triangle);
        let normal = (b - a).cross(c - a).unit();
        let side = if normal.dot(direction) < 0.0 { 1.0 } else { -1.0 };
        Some(Hit { t: nearest, triangle, normal: normal * side })
    }

    /// The unit direction from the eye through a point on the film, in pixels from the upper left corner.
    fn camera_ray(&self, film: [f32; 2]) -> V3 {
        let forward = (v3(0.0, 0.0, 0.5) - EYE).unit();
        let right = forward.cross(v3(0.0, 0.0, 1.0)).unit();
        let [x, y] = [0, 1].map(|k: usize| (film[k] - 0.5 * SIZE[k] as f32) * PIXEL_WIDTH);
        (forward + right * x - right.cross(forward) * y).unit()
    }

    /// The radiance that `place` reflects from a point on the light, divided by the albedo. `None` if it is 0 without tracing a
    /// ray.
    fn lamp_light(&self, place: V3, normal: V3, [u, v]: [f32; 2]) -> Option<f32> {
        let to = LAMP + v3(u - 0.5, v - 0.5, 0.0) * LAMP_SIDE - place;
        let distance = to.dot(to).sqrt();
        let direction = to * (1.0 / distance);
        let cosines = normal.dot(direction).max(0.0) * direction.0[2].max(0.0);
        let light = LAMP_RADIANCE * cosines * LAMP_SIDE * LAMP_SIDE / (PI * distance * distance);
        let seen = |light| if self.first_hit(place, direction, distance).is_none() { light } else { 0.0 };
        (light > 0.0).then_some(light).map(seen)
    }
}

/// The distance along the ray [Möller and Trumbore 1997].
fn intersect([a, b, c]: [V3; 3], from: V3, direction: V3) -> Option<f32> {
    let (e1, e2, s) = (b - a, c - a, from - a);
    let (p, q) = (direction.cross(e2), s.cross(e1));
    let scale = 1.0 / e1.dot(p);
    let (u, v, t) = (s.dot(p) * scale, direction.dot(q) * scale, e2.dot(q) * scale);
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}

/// Named groups of four random numbers: for the pixel, and for the light.
const FILM: Block = Block::new(0);
const LIGHTS: Block = Block::new(1);

/// The interface to Dapple: the random numbers of one sample in, its radiance out. The radiance is direct lighting by the light
/// and the sky.
impl Integrator for Scene {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, v, ..] = draws.block(FILM);
        let [x, y] = draws.pixel().map(|p| p as f32);
        let direction = self.camera_ray([x + u, y + v]);
        let Some(hit) = self.first_hit(EYE, direction, f32::INFINITY) else {
            return Estimate::new(sky(direction));
        };
        let albedo = ALBEDO[self.materials[hit.triangle as usize] as usize];
        let off = EYE + direction * hit.t + hit.normal * 1e-3;

        let [lamp_u, lamp_v, u, v] = draws.block(LIGHTS);
        let lamp = self.lamp_light(off, hit.normal, [lamp_u, lamp_v]);
        // The normal plus a random unit vector is a cosine-weighted direction.
        let (height, (sin, cos)) = (1.0 - 2.0 * u, (TAU * v).sin_cos());
        let ring = (1.0 - height * height).max(0.0).sqrt();
        let bounce = (hit.normal * 1.0001 + v3(ring * cos, ring * sin, height)).unit();
        let open = self.first_hit(off, bounce, f32::INFINITY).is_none();
        let ambient = if open { sky(bounce) } else { [0.0; 3] };
        let radiance = [0, 1, 2].map(|c: usize| albedo[c] * (lamp.unwrap_or(0.0) + ambient[c]));

        // A filter that needs first hits (`draws.wants_first_hit()`) would get them here.
        Estimate::new(radiance).with_cost(2 + u32::from(lamp.is_some()))
    }
}

/// Writes a binary PPM of values in `[0, 1]`. Larger values are clipped.
fn write_ppm(path: &Path, pixels: &[[f32; 3]]) -> Result<()> {
    let mut file = format!("P6\n{} {}\n255\n", SIZE[0], SIZE[1]).into_bytes();
    file.extend(pixels.iter().flatten().map(|x| (255.0 * x + 0.5) as u8));
    Ok(std::fs::write(path, file)?)
}
