//! Clusters of a world's surfaces, and the data of a world that samplers and filters use.

use dapple_cluster_adaptive::{FirstHitRay, FirstHitSurface, TraceFirstHit, TraceVisibility};
use dapple_clustering::{Cluster, ClusterParams, ClusterReport, Clusters, Triangles, cluster};
use dapple_registry::LensFirstHits;
use dapple_renderer::{Interaction, World};
use glam::{Vec2, Vec3};
use std::sync::Arc;
use std::time::Instant;

/// Copies of all triangles of a world, mesh by mesh, in the renderer's space (world space, translated and scaled).
#[derive(Clone, Debug, Default)]
pub struct WorldTriangles {
    /// The positions of the vertices.
    pub positions: Vec<[f32; 3]>,
    /// The three vertex indices of each triangle.
    pub indices: Vec<[u32; 3]>,
    /// The material index of each triangle.
    pub materials: Vec<u32>,
}

impl WorldTriangles {
    /// Copies the triangles of all meshes, in the order of shape indices. Moving instances are copied at their position when
    /// the shutter opens.
    pub fn of(world: &World) -> Self {
        let meshes = || (0..world.geometry().shape_count()).filter_map(|number| world.geometry().shape(number).mesh());
        // Reserved at once, since growing would copy everything again.
        let triangles = meshes().map(|mesh| mesh.triangles().len()).sum();
        let mut all = Self {
            positions: Vec::with_capacity(meshes().map(|mesh| mesh.positions().len()).sum()),
            indices: Vec::with_capacity(triangles),
            materials: Vec::with_capacity(triangles),
        };
        for number in 0..world.geometry().shape_count() {
            let Some(mesh) = world.geometry().shape(number).mesh() else { continue };
            let first = all.positions.len() as u32;
            match world.geometry().to_world(number, world.time(0.0)) {
                None => all.positions.extend_from_slice(mesh.positions()),
                Some(to_world) => {
                    let moved = |p: &[f32; 3]| to_world.transform_point3(Vec3::from_array(*p).as_dvec3());
                    all.positions.extend(mesh.positions().iter().map(|p| moved(p).as_vec3().to_array()));
                }
            }
            all.indices.extend(mesh.triangles().iter().map(|t| t.map(|vertex| first + vertex)));
            all.materials.resize(all.indices.len(), world.shape_material(number));
        }
        all
    }

    /// Borrows the triangles as slices.
    pub fn as_slices(&self) -> Triangles<'_> {
        Triangles::new(&self.positions, &self.indices).with_materials(&self.materials)
    }
}

/// The primitives of a world grouped into clusters. Triangles are grouped by [`dapple_clustering::cluster`]; each
/// sphere and each disk is a cluster of its own.
#[derive(Clone, Debug)]
pub struct WorldClusters {
    params: ClusterParams,
    labels: Arc<[u32]>,
    clusters: Arc<[Cluster]>,
    /// For each shape, the index in `labels` of its first primitive.
    first: Vec<u32>,
    report: Option<ClusterReport>,
    seconds: f64,
}

impl WorldClusters {
    /// Groups the primitives of `world` into clusters.
    ///
    /// # Errors
    ///
    /// The errors of [`dapple_clustering::cluster`].
    pub fn new(world: &World, params: &ClusterParams) -> Result<Self, dapple_clustering::Error> {
        let began = Instant::now();
        let triangles = WorldTriangles::of(world);
        let found = (!triangles.indices.is_empty()).then(|| cluster(&triangles.as_slices(), params)).transpose()?;
        drop(triangles);
        let (of_triangles, in_clusters) = found.as_ref().map(Clusters::shared).unwrap_or_default();
        // Spheres and disks after them.
        let (mut labels, mut clusters) = (Vec::new(), Vec::new());
        let mut first = Vec::with_capacity(world.geometry().shape_count() as usize);
        let mut triangle = 0;
        for number in 0..world.geometry().shape_count() {
            match world.geometry().shape(number).mesh() {
                Some(mesh) => {
                    first.push(triangle);
                    triangle += mesh.triangles().len() as u32;
                }
                None => {
                    first.push((of_triangles.len() + labels.len()) as u32);
                    labels.push((in_clusters.len() + clusters.len()) as u32);
                    let group = clusters.last().or(in_clusters.last()).map_or(0, |c: &Cluster| c.group + 1);
                    clusters.push(whole(world.shape_bounds(number), world.shape_material(number), group));
                }
            }
        }
        let report = found.as_ref().map(Clusters::report);
        let (labels, clusters) = (joined(of_triangles, &labels), joined(in_clusters, &clusters));
        Ok(Self { params: *params, labels, clusters, first, report, seconds: began.elapsed().as_secs_f64() })
    }

    /// The parameters of clustering.
    pub fn params(&self) -> &ClusterParams {
        &self.params
    }

    /// The cluster index of each primitive: triangles first, mesh by mesh, then spheres and disks.
    pub fn labels(&self) -> &Arc<[u32]> {
        &self.labels
    }

    /// The clusters, in the order of their indices.
    pub fn clusters(&self) -> &Arc<[Cluster]> {
        &self.clusters
    }

    /// The index in [`labels`](Self::labels) of primitive `primitive` of shape `shape`.
    #[inline]
    pub fn primitive(&self, shape: u32, primitive: u32) -> u32 {
        self.first[shape as usize] + primitive
    }

    /// The index of the cluster that contains primitive `primitive` of shape `shape`; `None` if there is no such primitive.
    pub fn label(&self, shape: u32, primitive: u32) -> Option<u32> {
        let first = self.first.get(shape as usize)?;
        self.labels.get(*first as usize + primitive as usize).copied()
    }

    /// Statistics of the clustering grid; `None` in a world without triangles.
    pub fn report(&self) -> Option<ClusterReport> {
        self.report
    }

    /// Wall-clock seconds spent on clustering.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }
}

/// The concatenation of both slices; `all` itself, uncopied, if `more` is empty.
fn joined<T: Copy>(all: Arc<[T]>, more: &[T]) -> Arc<[T]> {
    if more.is_empty() { all } else { all.iter().chain(more).copied().collect() }
}

/// The cluster that consists of one sphere or disk with this bounding box.
fn whole([low, high]: [Vec3; 2], material: u32, group: u32) -> Cluster {
    let d = (high - low).as_dvec3();
    // The area of the bounding box, from which projected sizes are computed as well.
    let area = 2.0 * (d.x * d.y + d.y * d.z + d.z * d.x);
    let bounds = [low.to_array(), high.to_array()];
    Cluster::without_triangles(bounds, area, material, group)
}

/// A function that traces first-hit rays: it returns the first hits of rays in the world.
pub(crate) fn shoot(world: Arc<World>, clusters: Arc<WorldClusters>) -> TraceFirstHit {
    Arc::new(move |first_hit: FirstHitRay| {
        let ([origin, direction], at) = first_hit_at(&world, &first_hit)?;
        let (hit, point) = (at.hit(), at.point());
        let distance = (point.position - origin).length();
        Some(FirstHitSurface {
            primitive: clusters.primitive(hit.shape, hit.primitive),
            direction: direction.to_array(),
            distance,
            normal: point.normal.to_array(),
            footprint: world.camera().footprint(distance),
        })
    })
}

/// The origin and direction of a first-hit ray, and its first hit when the shutter opens.
fn first_hit_at<'w>(world: &'w World, first_hit: &FirstHitRay) -> Option<([Vec3; 2], Interaction<'w>)> {
    let [x, y] = first_hit.pixel.map(|n| n as f32 + 0.5);
    let offset = Vec2::new(first_hit.film[0] - x, first_hit.film[1] - y);
    let time = world.time(0.0);
    let ray = world.camera().ray_at(world.camera().place(first_hit.pixel, offset), first_hit.lens, time);
    Some(([ray.origin, ray.direction], world.closest_hit(&ray, time)?))
}

/// A function that traces shadow rays from first hits to points on the world's lights.
pub(crate) fn visibility(world: Arc<World>) -> TraceVisibility {
    Arc::new(move |first_hit: FirstHitRay, [choice, u, v]: [f32; 3]| {
        let Some((_, at)) = first_hit_at(&world, &first_hit) else { return false };
        let light = world.lights().sample(at.point().position, choice, [u, v]);
        light.is_some_and(|light| !world.occluded(&light.shadow_ray(at.point()), world.time(0.0)))
    })
}

/// A function that traces the ray through the centres of a pixel and the lens when the shutter opens. It returns the first hit
/// and the circle of confusion.
pub(crate) fn lens_first_hits(world: Arc<World>) -> LensFirstHits {
    let has_lens = world.camera().has_lens();
    let trace = move |pixel: [u32; 2]| {
        let time = world.time(0.0);
        let camera = world.camera();
        let ray = camera.ray_at(camera.place(pixel, Vec2::ZERO), [0.5; 2], time);
        let hit = world.closest_hit(&ray, time);
        let blur = camera.circle_of_confusion(hit.as_ref().map(|at| at.point().position), time);
        (hit.map(|at| world.first_hit(&ray, &at, 0.5)), blur)
    };
    LensFirstHits { trace: Arc::new(trace), has_lens }
}
