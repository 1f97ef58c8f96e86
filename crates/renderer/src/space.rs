//! The renderer's own space: the scene moved to the origin and scaled by a power of two.
//!
//! Geometry is f32. Far from the origin f32 loses precision, and at extreme scales products overflow. Scenes are
//! therefore moved and scaled in f64 when they are loaded. Scaling by a power of two is exact.

use dapple_scene::{Geometry, Scene, Shape};
use glam::{DAffine3, DMat3, DVec3};

/// The map from the scene file's world space to the renderer's space: a translation and a scale by a power of two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Space {
    centre: DVec3,
    scale: f64,
}

impl Space {
    /// Returns the space in which the scene's bounding box is centred at the origin and its largest half width is in (0.5, 1],
    /// or 0 for a point. The box includes all instances, and both end positions of moving shapes.
    pub fn of(scene: &Scene) -> Self {
        let mut extent = Extent::NOTHING;
        for shape in &scene.shapes {
            let ends = [Some(&shape.to_world), shape.moves_to.as_ref()];
            ends.into_iter().flatten().for_each(|end| extent.add_shape(shape, end));
        }
        let objects: Vec<Extent> = scene.objects.iter().map(|object| Extent::of(&object.shapes)).collect();
        for instance in &scene.instances {
            let Some(object) = objects.get(instance.object.0 as usize) else { continue };
            let ends = [Some(&instance.to_world), instance.moves_to.as_ref()];
            ends.into_iter().flatten().for_each(|end| extent.add_box(object, end));
        }
        Self::around(&extent)
    }

    /// Returns the space in which an object's shapes are centred at the origin, in a box of half width 1.
    pub(crate) fn of_shapes(shapes: &[Shape]) -> Self {
        Self::around(&Extent::of(shapes))
    }

    fn around(&Extent { low, high }: &Extent) -> Self {
        let half = ((high - low) * 0.5).max_element();
        if !(half.is_finite() && low.is_finite() && high.is_finite()) {
            return Self { centre: DVec3::ZERO, scale: 1.0 };
        }
        let centre = low + (high - low) * 0.5;
        // A scene that is a single point keeps its scale.
        let exponent = if half > 0.0 { half.log2().ceil().clamp(-1000.0, 1000.0) } else { 0.0 };
        Self { centre, scale: (-exponent).exp2() }
    }

    /// Returns the inverse map, from the renderer's space to the scene file's world space.
    pub(crate) fn inverse(&self) -> DAffine3 {
        let matrix3 = DMat3::from_diagonal(DVec3::splat(self.scale.recip()));
        DAffine3 { matrix3, translation: self.centre }
    }

    /// Returns `to_world` followed by this map: a transform to the renderer's space.
    pub fn apply(&self, to_world: DAffine3) -> DAffine3 {
        DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::splat(self.scale)) * to_world.matrix3,
            translation: (to_world.translation - self.centre) * self.scale,
        }
    }

    /// Maps a point of the scene file's world space to the renderer's space.
    pub fn point(&self, world: DVec3) -> DVec3 {
        (world - self.centre) * self.scale
    }

    /// Maps a point of the renderer's space to the scene file's world space.
    pub fn world(&self, point: [f32; 3]) -> [f64; 3] {
        (DVec3::from_array(point.map(f64::from)) / self.scale + self.centre).to_array()
    }

    /// Returns the scale factor from lengths of the scene file to lengths of the renderer's space, a power of two.
    pub fn scale(&self) -> f64 {
        self.scale
    }
}

/// A bounding box of points in f64.
#[derive(Clone, Copy, Debug)]
struct Extent {
    low: DVec3,
    high: DVec3,
}

impl Extent {
    const NOTHING: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    fn of(shapes: &[Shape]) -> Self {
        let mut extent = Self::NOTHING;
        shapes.iter().for_each(|shape| extent.add_shape(shape, &shape.to_world));
        extent
    }

    fn grow(&mut self, p: DVec3) {
        (self.low, self.high) = (self.low.min(p), self.high.max(p));
    }

    fn add_shape(&mut self, shape: &Shape, to_world: &DAffine3) {
        match &shape.geometry {
            Geometry::Mesh(mesh) => mesh.positions.iter().for_each(|&p| self.grow(to_world.transform_point3(p))),
            Geometry::Sphere { radius } => self.add_corners(DVec3::ZERO, DVec3::splat(*radius), to_world),
            Geometry::Disk { height, radius, .. } => {
                self.add_corners(DVec3::new(0.0, 0.0, *height), DVec3::new(*radius, *radius, 0.0), to_world);
            }
        }
    }

    /// Adds the corners of another box, transformed by `map`. An empty box adds nothing.
    fn add_box(&mut self, other: &Self, map: &DAffine3) {
        if other.low.cmple(other.high).all() {
            self.add_corners((other.low + other.high) * 0.5, (other.high - other.low) * 0.5, map);
        }
    }

    fn add_corners(&mut self, centre: DVec3, half: DVec3, map: &DAffine3) {
        let sign = |bit: u32| if bit == 0 { -1.0 } else { 1.0 };
        for k in 0..8u32 {
            let corner = half * DVec3::new(sign(k & 1), sign(k & 2), sign(k & 4));
            self.grow(map.transform_point3(centre + corner));
        }
    }
}

/// Returns the scale of a transform that only rotates, mirrors and scales uniformly; `None` for any other.
pub(crate) fn even_scale(m: &DMat3) -> Option<f64> {
    let lengths = [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()];
    let scale = lengths[0];
    let even = lengths.iter().all(|l| (l / scale - 1.0).abs() < 1e-5);
    let square = [m.x_axis.dot(m.y_axis), m.y_axis.dot(m.z_axis), m.z_axis.dot(m.x_axis)];
    (even && square.iter().all(|d| (d / (scale * scale)).abs() < 1e-5)).then_some(scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::add;
    use dapple_scene::MaterialId;

    fn scene(shapes: Vec<Geometry>, to_world: DAffine3) -> Scene {
        let mut scene = Scene::default();
        for geometry in shapes {
            add(&mut scene, geometry, to_world, MaterialId(0), None);
        }
        scene
    }

    #[test]
    fn scenes_lie_around_the_origin() {
        for exponent in [-100, -3, 0, 5, 100] {
            let size = 1.3 * f64::from(exponent).exp2();
            let far = DAffine3::from_translation(DVec3::new(7.0, -2e5, 3.0) * size);
            let disk = Geometry::Disk { height: 3.0 * size, radius: size, inner_radius: 0.0 };
            let space = Space::of(&scene(vec![Geometry::Sphere { radius: size }, disk], far));
            assert_eq!(space.scale().log2().fract(), 0.0, "a power of two");
            let corners = [DVec3::splat(-size), DVec3::new(size, size, 3.0 * size)];
            let moved = corners.map(|c| space.apply(far).transform_point3(c));
            let largest = moved.map(|m| m.abs().max_element()).into_iter().fold(0.0, f64::max);
            assert!((0.5..=1.0 + 1e-9).contains(&largest), "2^{exponent}: {moved:?}");
            let by_point = space.point(far.transform_point3(corners[1]));
            assert!((by_point - moved[1]).length() < 1e-9);
        }
    }

    #[test]
    fn nothing_and_points_keep_their_scale() {
        assert_eq!(Space::of(&Scene::default()), Space { centre: DVec3::ZERO, scale: 1.0 });
        let dot = Geometry::Disk { height: 2.0, radius: 0.0, inner_radius: 0.0 };
        let space = Space::of(&scene(vec![dot], DAffine3::IDENTITY));
        assert_eq!((space.scale(), space.point(DVec3::new(0.0, 0.0, 2.0))), (1.0, DVec3::ZERO));
    }

    #[test]
    fn even_scales_are_told_from_stretches() {
        let turn = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_z(-1.0);
        for scale in [1e-9, 1.0, -3.0, 1e12] {
            let found = even_scale(&(turn * DMat3::from_diagonal(DVec3::splat(scale))));
            assert!(found.is_some_and(|s| (s / scale.abs() - 1.0).abs() < 1e-12), "{scale}: {found:?}");
        }
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.1, 0.995, 0.0), DVec3::Z);
        for stretch in
            [DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1.01)), shear, DMat3::ZERO, DMat3::from_diagonal(DVec3::NAN)]
        {
            assert_eq!(even_scale(&stretch), None, "{stretch}");
        }
    }
}
