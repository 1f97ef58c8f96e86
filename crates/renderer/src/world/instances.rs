//! Objects, instances of objects, moving shapes, and the time interval in which the shutter is open.

use super::build::{Problems, convert};
use super::{Interaction, Part, World};
use crate::space::Space;
use dapple_geometry::{Geometry, Hit, Instance, Mesh, Motion, Ray, Shape};
use dapple_scene::{MaterialId, MediumId, Scene, Shape as DescribedShape, Source};
use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;

/// The objects and instances of a world that is being built, and the properties of the objects' shapes.
pub(super) struct Placements<'a> {
    space: &'a Space,
    shutter: &'a Shutter,
    objects: Vec<Arc<Geometry>>,
    instances: Vec<Instance>,
    pub(super) parts: Vec<Part>,
    pub(super) dropped_triangles: usize,
    pub(super) moves: bool,
}

impl<'a> Placements<'a> {
    /// Converts the objects and instances of a scene, and adds their errors to `problems`.
    pub(super) fn of(scene: &Scene, space: &'a Space, shutter: &'a Shutter, problems: &mut Problems) -> Self {
        let (objects, instances, parts) = (Vec::new(), Vec::new(), Vec::new());
        let mut all = Self { space, shutter, objects, instances, parts, dropped_triangles: 0, moves: false };
        // The space of each object; `None` for an object with a problem.
        let mut spaces = Vec::with_capacity(scene.objects.len());
        for object in &scene.objects {
            for shape in &object.shapes {
                refuse(shape, problems);
                problems.check_material(scene, shape);
            }
            spaces.push(all.add_object(&object.shapes, &object.source, problems));
        }
        for instance in &scene.instances {
            let object = instance.object.0;
            match spaces.get(object as usize) {
                None => problems.add(
                    &instance.source,
                    format!("the instance refers to object {object}, which does not exist; define it"),
                ),
                Some(None) => {}
                Some(Some(inner)) => {
                    let ends = (instance.to_world, instance.moves_to);
                    all.add_instance(object, ends, inner, &instance.source, problems);
                }
            }
        }
        all
    }

    /// Adds a moving shape as the only instance of an object of its own. The caller replaces it by an empty mesh among the
    /// base shapes, so that indices stay the same.
    pub(super) fn add_moving(&mut self, shape: &DescribedShape, problems: &mut Problems) {
        if shape.emission.is_some() {
            problems.add(&shape.source, "a shape that moves cannot emit light; remove motion or emission".into());
        }
        let inner = DescribedShape { to_world: DAffine3::IDENTITY, moves_to: None, emission: None, ..shape.clone() };
        let object = self.objects.len() as u32;
        if let Some(own) = self.add_object(&[inner], &shape.source, problems) {
            let ends = (shape.to_world, shape.moves_to);
            self.add_instance(object, ends, &own, &shape.source, problems);
        }
    }

    /// Adds an object in its own space, and returns that space. Returns `None` if a problem was reported.
    fn add_object(&mut self, shapes: &[DescribedShape], source: &Source, problems: &mut Problems) -> Option<Space> {
        let own = Space::of_shapes(shapes);
        let mut geometry = Vec::with_capacity(shapes.len());
        for shape in shapes {
            let (shape, part) = problems.note_at(&shape.source, convert(shape, &own))?;
            self.dropped_triangles += if let Shape::Mesh(mesh) = &shape { mesh.degenerate() } else { 0 };
            geometry.push(shape);
            self.parts.push(part);
        }
        let geometry = problems.note_at(source, Geometry::build(geometry))?;
        self.objects.push(Arc::new(geometry));
        Some(own)
    }

    fn add_instance(
        &mut self,
        object: u32,
        (start, end): (DAffine3, Option<DAffine3>),
        inner: &Space,
        source: &Source,
        problems: &mut Problems,
    ) {
        let space = self.space;
        let start = space.apply(start);
        let motion = match end {
            Some(end) => problems.note_at(source, Motion::between(start, space.apply(end))),
            None => Some(Motion::still(start)),
        };
        let Some(motion) = motion else { return };
        let determinant = start.matrix3.determinant();
        if !start.is_finite() || determinant == 0.0 || !determinant.is_finite() {
            problems.add(source, "the transform is not finite or not invertible; check its scales".into());
            return;
        }
        let motion = self.shutter.seen(motion.after(inner.inverse()));
        self.moves |= motion.moves();
        self.instances.push(Instance::new(object, motion));
    }

    /// Builds the geometry of base shapes and instances. Without instances, traversal is faster.
    pub(super) fn build(self, shapes: Vec<Shape>) -> Result<Geometry, dapple_geometry::Error> {
        match self.instances.is_empty() {
            true => Geometry::build(shapes),
            false => Geometry::with_instances(shapes, self.objects, self.instances),
        }
    }
}

/// Returns an empty mesh, which replaces a moving shape among the base shapes.
pub(super) fn empty_mesh() -> Option<Shape> {
    Mesh::new(Vec::new(), Vec::new()).ok().map(Shape::from)
}

/// Reports properties that the shapes of an object must not have: emission and motion.
fn refuse(shape: &DescribedShape, problems: &mut Problems) {
    if shape.emission.is_some() {
        problems.add(&shape.source, "a shape of an object cannot emit light; move the light out of the object".into());
    }
    if shape.moves_to.is_some() {
        problems.add(&shape.source, "a shape of an object cannot move within the object; move the instance".into());
    }
}

impl World {
    /// Returns the index of a shape's material. `shape` is a number as in [`Hit::shape`].
    pub fn shape_material(&self, shape: u32) -> u32 {
        self.part(shape).material
    }

    /// Returns the properties of the shape with this number.
    #[inline]
    pub(crate) fn part(&self, shape: u32) -> &Part {
        match self.parts.get(shape as usize) {
            Some(part) => part,
            None => &self.object_parts[self.geometry.original(shape) as usize - self.parts.len()],
        }
    }

    /// Returns the interaction for a hit of an instance. Normals are transformed by the inverse transpose, so that a mirroring
    /// transform does not flip them to the other side.
    #[inline(never)]
    pub(super) fn instance_interaction(&self, ray: &Ray, hit: Hit, time: f32) -> Interaction<'_> {
        let mut point = self.geometry.surface_at(ray, &hit, time);
        let part = self.part(hit.shape);
        point.normal *= part.flip;
        let mut shading_normal = point.normal;
        if !part.normals.is_empty()
            && let Shape::Mesh(mesh) = self.geometry.shape(hit.shape)
            && let Some(to_world) = self.geometry.to_world(hit.shape, time)
        {
            let [a, b, c] = mesh.triangles()[hit.primitive as usize].map(|v| part.normals[v as usize]);
            let [v, w] = hit.barycentrics;
            let inner = a * (1.0 - v - w) + b * v + c * w;
            let normal = to_world.matrix3.inverse().transpose() * inner.as_dvec3();
            shading_normal = normal.normalize_or_zero().as_vec3();
            // Shading normals determine the side [Pharr et al. 2023, sec. 6.5.3].
            if shading_normal.dot(point.normal) < 0.0 {
                point.normal = -point.normal;
            }
        }
        Interaction { part, hit, point, shading_normal, time }
    }

    /// Returns the lower and upper corner of a shape's bounding box at the time when the shutter opens, up to rounding and in
    /// the renderer's space ([`World::space`]). The box of an empty mesh is a point.
    pub fn shape_bounds(&self, shape: u32) -> [Vec3; 2] {
        let [low, high] = self.geometry.shape(shape).bounds().unwrap_or_default();
        let Some(to_world) = self.geometry.to_world(shape, self.time(0.0)) else { return [low, high] };
        Motion::still(to_world).bounds(low.as_dvec3(), high.as_dvec3()).map(DVec3::as_vec3)
    }
}

impl Problems {
    /// Reports references to media that do not exist, and area lights with holes (alpha).
    pub(super) fn check_media(&mut self, scene: &Scene) {
        let missing = |medium: &Option<MediumId>| medium.is_some_and(|m| m.0 as usize >= scene.media.len());
        for shape in scene.shapes.iter().chain(scene.objects.iter().flat_map(|object| &object.shapes)) {
            if shape.media.is_some_and(|m| missing(&m.inside) || missing(&m.outside)) {
                self.add(&shape.source, "the shape borders on a medium that does not exist; define it".into());
            }
            if shape.emission.is_some() && shape.alpha.is_some() {
                let what = "a shape with holes (alpha) cannot emit light; remove its alpha, or the emission";
                self.add(&shape.source, what.into());
            }
        }
        if missing(&scene.camera.medium) {
            self.add(&scene.camera.source, "the camera is in a medium that does not exist; define it".into());
        }
    }

    pub(super) fn check_material(&mut self, scene: &Scene, shape: &DescribedShape) {
        let MaterialId(material) = shape.material;
        if material as usize >= scene.materials.len() {
            self.add(&shape.source, format!("the shape has material {material}, which does not exist; define it"));
        }
    }
}

/// The interval in which the camera's shutter is open, relative to the time span of the scene's motion.
pub(super) struct Shutter {
    /// The opening and closing time. The motion starts at time 0 and ends at 1. Both times are 0 if nothing moves.
    pub(super) open: [f32; 2],
}

impl Shutter {
    /// Returns the interval in which the shutter of a scene is open.
    ///
    /// # Errors
    ///
    /// Returns a message if the scene has motion and its times are not finite or not in order.
    pub(super) fn of(scene: &Scene) -> Result<Self, String> {
        let moves = scene.camera.moves_to.is_some()
            || scene.shapes.iter().any(|shape| shape.moves_to.is_some())
            || scene.instances.iter().any(|instance| instance.moves_to.is_some());
        if !moves {
            return Ok(Self { open: [0.0; 2] });
        }
        let [from, to] = scene.motion();
        let [opens, closes] = scene.camera.shutter;
        let sound = [from, to, opens, closes].iter().all(|t| t.is_finite());
        if !sound || from > to || opens > closes {
            let at = &scene.camera.source;
            return Err(format!(
                "{at}: the shutter is open from {opens} to {closes}, and the motion lasts from {from} to {to}; use \
                 finite times, with each start before its end"
            ));
        }
        Ok(Self { open: [opens, closes].map(|t| ((t - from) / (to - from)).clamp(0.0, 1.0) as f32) })
    }

    /// Returns the motion; if the shutter opens and closes at the same time, returns the constant pose of that time.
    pub(super) fn seen(&self, motion: Motion) -> Motion {
        if self.open[0] == self.open[1] { Motion::still(motion.at(self.open[0])) } else { motion }
    }
}

impl World {
    /// Maps a random number `u` in `[0, 1)` linearly to the interval in which the shutter is open. Time 0 is the start of the
    /// scene's motion, and 1 its end. Without motion, returns 0.
    #[inline]
    pub fn time(&self, u: f32) -> f32 {
        let [opens, closes] = self.open;
        (opens + (closes - opens) * u).clamp(0.0, 1.0)
    }
}
