//! Patches: clusters of small pieces of all surfaces.
//!
//! Triangles are divided into equal parts until none is larger than a fraction of a patch; spheres and disks are divided into
//! cells of their parameters. A patch is a group of nearby pieces with the same material and similar normals.

mod parts;

use dapple_clustering::{ClusterParams, Triangles, cluster};
use dapple_geometry::Shape;
use dapple_renderer::{Interaction, World};
use glam::{DAffine3, DVec3, Vec3};
use parts::{divide, part_at, triangle_area};
use std::f64::consts::{PI, TAU};

/// The mean number of pieces per patch.
const PIECES: f64 = 6.0;
/// The largest number of parts along an edge of a triangle, or of cells along a parameter.
const MOST_PARTS: f64 = 1024.0;
/// The largest number of pieces of all shapes together.
const MOST_PIECES: u64 = 1 << 24;
/// The memory in bytes per piece while patches are computed.
const OF_A_PIECE: u64 = 70;
/// The smallest number of cells from pole to pole, or from rim to centre.
const LEAST_CELLS: f64 = 4.0;

/// The division of a world's surfaces into pieces, which are later grouped into patches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Division {
    /// The desired number of patches.
    pub(crate) count: u32,
    /// The largest area of a piece.
    largest: f64,
    /// The number of pieces.
    pub(crate) pieces: u64,
}

impl Division {
    /// Chooses the size of pieces for about `count` patches.
    ///
    /// # Errors
    ///
    /// A message, if there are too many triangles, or if areas overflow.
    pub(crate) fn new(world: &World, count: u32) -> Result<Self, String> {
        let shapes = || 0..world.geometry().shape_count();
        let area: f64 = shapes().map(|shape| area_of(world, shape)).sum();
        if !area.is_finite() {
            return Err("the total area of the scene's surfaces overflows; use integrator \"path\"".into());
        }
        let largest = (area / (f64::from(count) * PIECES)).max(f64::MIN_POSITIVE);
        let of_shape = |shape: u32| -> u64 {
            match triangles_of(world, shape) {
                Some(triangles) => triangles.map(|corners| u64::from(parts_along(corners, largest)).pow(2)).sum(),
                None => cells_across(world, shape, largest).map(u64::from).iter().product(),
            }
        };
        let pieces = shapes().map(of_shape).sum();
        if pieces > MOST_PIECES {
            return Err(format!(
                "the scene has too many triangles for patches (limit {MOST_PIECES}); use integrator \"path\""
            ));
        }
        Ok(Self { count, largest, pieces })
    }

    /// Returns the memory in bytes needed to compute the patches.
    pub(crate) fn bytes(&self) -> u64 {
        OF_A_PIECE * self.pieces
    }
}

/// Returns the number of parts along each edge of a triangle, such that no part has an area above `largest`.
fn parts_along(corners: [DVec3; 3], largest: f64) -> u32 {
    (triangle_area(corners) / largest).sqrt().ceil().clamp(1.0, MOST_PARTS) as u32
}

/// Returns the numbers of cells of a sphere or disk along `u` and `v`, such that no cell's area is much above `largest`.
fn cells_across(world: &World, shape: u32, largest: f64) -> [u32; 2] {
    let across = (area_of(world, shape) / largest / 2.0).sqrt().ceil().clamp(LEAST_CELLS, MOST_PARTS) as u32;
    [2 * across, across]
}

/// The patches of a world's surfaces.
#[derive(Clone, Debug, Default)]
pub(crate) struct Patches {
    /// The location of each shape's pieces.
    shapes: Vec<Pieces>,
    /// The index of each triangle's first piece, and the number of parts along the triangle's edges.
    triangles: Vec<[u32; 2]>,
    /// The patch index of each piece.
    labels: Vec<u32>,
    /// The area of each patch, in the renderer's units.
    pub(crate) areas: Vec<f64>,
    /// The mean normal of each patch, zero if its normals cancel.
    normals: Vec<Vec3>,
}

/// The location of a shape's pieces.
#[derive(Clone, Copy, Debug)]
enum Pieces {
    /// The pieces of a mesh; `first` is the number of the mesh's first triangle.
    Mesh { first: u32 },
    /// The pieces of a sphere or a disk: the index of the first, and the numbers of cells along `u` and `v`.
    Cells { first: u32, cells: [u32; 2] },
}

/// The pieces as triangles, the input of clustering.
#[derive(Default)]
struct Soup {
    positions: Vec<[f32; 3]>,
    materials: Vec<u32>,
    areas: Vec<f64>,
}

impl Soup {
    fn add(&mut self, corners: [DVec3; 3], area: f64, material: u32) {
        self.positions.extend(corners.map(|corner| corner.as_vec3().to_array()));
        self.materials.push(material);
        self.areas.push(area);
    }

    fn len(&self) -> u32 {
        self.areas.len() as u32
    }
}

impl Patches {
    /// Computes the patches of a world's surfaces, at the time when the shutter opens.
    pub(crate) fn new(world: &World, division: &Division) -> Self {
        let largest = division.largest;
        let (mut soup, mut shapes, mut triangles) = (Soup::default(), Vec::new(), Vec::new());
        for shape in 0..world.geometry().shape_count() {
            let material = world.shape_material(shape);
            match triangles_of(world, shape) {
                Some(of_mesh) => {
                    shapes.push(Pieces::Mesh { first: triangles.len() as u32 });
                    for corners in of_mesh {
                        let parts = parts_along(corners, largest);
                        triangles.push([soup.len(), parts]);
                        divide(corners, parts, |part| soup.add(part, triangle_area(part), material));
                    }
                }
                None => {
                    let cells = cells_across(world, shape, largest);
                    shapes.push(Pieces::Cells { first: soup.len(), cells });
                    cells_of(world, shape, cells, |part, area| soup.add(part, area, material));
                }
            }
        }
        let indices: Vec<[u32; 3]> = (0..soup.len()).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let pieces = Triangles::new(&soup.positions, &indices).with_materials(&soup.materials);
        // There are pieces and they are finite, so clustering does not fail. If it did, each piece would be a patch.
        let (labels, normals) = match cluster(&pieces, &ClusterParams::for_count(division.count)) {
            Ok(found) => {
                let normals = found.clusters().iter().map(|cluster| Vec3::from(cluster.normal)).collect();
                (found.labels().to_vec(), normals)
            }
            Err(_) => ((0..soup.len()).collect(), vec![Vec3::ZERO; soup.areas.len()]),
        };
        let mut areas = vec![0.0; normals.len()];
        labels.iter().zip(&soup.areas).for_each(|(label, area)| areas[*label as usize] += area);
        Self { shapes, triangles, labels, areas, normals }
    }

    /// Returns the index of the patch side from which a direction arrives at a hit: twice the patch's index, plus 0 or 1.
    pub(crate) fn side_at(&self, world: &World, at: &Interaction<'_>, direction: Vec3) -> usize {
        let (hit, position) = (at.hit(), at.point().position);
        let piece = match self.shapes[hit.shape as usize] {
            Pieces::Mesh { first } => {
                let [piece, parts] = self.triangles[(first + hit.primitive) as usize];
                piece + part_at(hit.barycentrics, parts)
            }
            Pieces::Cells { first, cells } => {
                let uv = world.geometry().parametric_at(hit, position, at.time());
                let [u, v] = [0, 1].map(|k| ((uv[k] * cells[k] as f32) as u32).min(cells[k] - 1));
                first + v * cells[0] + u
            }
        };
        let patch = self.labels[piece as usize] as usize;
        let normal = at.point().normal;
        let turned = self.normals[patch].dot(normal) < 0.0;
        2 * patch + usize::from((normal.dot(direction) < 0.0) != turned)
    }
}

/// Returns the map from a shape's space to the world's.
fn to_world(world: &World, shape: u32) -> DAffine3 {
    world.geometry().to_world(shape, world.time(0.0)).unwrap_or(DAffine3::IDENTITY)
}

/// Returns the corners of each triangle of a mesh; `None` for a sphere or a disk.
fn triangles_of(world: &World, shape: u32) -> Option<impl Iterator<Item = [DVec3; 3]>> {
    let (mesh, to_world) = (world.geometry().shape(shape).mesh()?, to_world(world, shape));
    let corners = move |number| mesh.corners(number).map(|corner| to_world.transform_point3(corner.as_dvec3()));
    Some((0..mesh.triangles().len() as u32).map(corners))
}

/// Returns the area of a shape. Spheres and disks are approximated by cells.
fn area_of(world: &World, shape: u32) -> f64 {
    match triangles_of(world, shape) {
        Some(triangles) => triangles.map(triangle_area).sum(),
        None => {
            let mut sum = 0.0;
            cells_of(world, shape, [16, 8], |_, area| sum += area);
            sum
        }
    }
}

/// Divides a sphere or disk into cells of its parameters. Calls `add` with each cell as a triangle around its centre, and with
/// the cell's area.
fn cells_of(world: &World, shape: u32, cells: [u32; 2], mut add: impl FnMut([DVec3; 3], f64)) {
    let (to_world, shape) = (to_world(world, shape), world.geometry().shape(shape));
    for v in 0..cells[1] {
        for u in 0..cells[0] {
            let [u, v] = [(u, 0), (v, 1)].map(|(i, k)| (f64::from(i) + 0.5) / f64::from(cells[k]));
            let (sine, cosine) = libm::sincos(u * TAU);
            let (point, along) = match shape {
                Shape::Sphere(sphere) => {
                    let (height, across) = libm::sincos((v - 0.5) * PI);
                    let point = DVec3::new(cosine * across, sine * across, height) * sphere.radius();
                    let point = sphere.to_world().transform_point3(point);
                    (point, sphere.derivatives(point.as_vec3()))
                }
                Shape::Disk(disk) => {
                    let [height, outer, inner] = disk.extent();
                    let across = outer + (inner - outer) * v;
                    let point = DVec3::new(cosine * across, sine * across, height);
                    let point = disk.to_world().transform_point3(point);
                    (point, disk.derivatives(point.as_vec3()))
                }
                Shape::Mesh(_) | Shape::Moving(_) => return,
            };
            let middle = to_world.transform_point3(point);
            let [a, b] = [0, 1].map(|k| to_world.matrix3 * along[k].as_dvec3() / f64::from(cells[k]));
            let [x, y] = [a / 3.0, b / 3.0];
            add([middle + x, middle + y, middle - x - y], a.cross(b).length());
        }
    }
}
