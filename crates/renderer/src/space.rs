//! The renderer's own space: the scene moved to the origin and scaled by a power of two.
//!
//! Geometry is f32. Far from the origin f32 has no digits left, and at extreme scales products
//! overflow, so every scene is moved and scaled in f64 on the way in. The scale is a power of two,
//! which changes no digit.

use crate::scene::{Geometry, Scene};
use glam::{DAffine3, DMat3, DVec3};

/// From the file's world space to the renderer's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Space {
    centre: DVec3,
    scale: f64,
}

impl Space {
    /// The space in which the scene's shapes lie around the origin, within a box of half width 1.
    pub fn of(scene: &Scene) -> Self {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut grow = |p: DVec3| (low, high) = (low.min(p), high.max(p));
        for shape in &scene.shapes {
            match &shape.geometry {
                Geometry::Mesh(mesh) => {
                    mesh.positions.iter().for_each(|&p| grow(shape.to_world.transform_point3(p)));
                }
                Geometry::Sphere { radius } => corners(DVec3::splat(*radius)).for_each(|c| {
                    grow(shape.to_world.transform_point3(c));
                }),
                Geometry::Disk { height, radius, .. } => corners(DVec3::new(*radius, *radius, 0.0)).for_each(|c| {
                    grow(shape.to_world.transform_point3(c + DVec3::new(0.0, 0.0, *height)));
                }),
            }
        }
        let half = ((high - low) * 0.5).max_element();
        if !(half.is_finite() && low.is_finite() && high.is_finite()) {
            return Self { centre: DVec3::ZERO, scale: 1.0 };
        }
        let centre = low + (high - low) * 0.5;
        // A scene that is one point keeps its scale.
        let exponent = if half > 0.0 { half.log2().ceil().clamp(-1000.0, 1000.0) } else { 0.0 };
        Self { centre, scale: (-exponent).exp2() }
    }

    /// The same map, from the file's world space to the renderer's.
    pub fn apply(&self, to_world: DAffine3) -> DAffine3 {
        DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::splat(self.scale)) * to_world.matrix3,
            translation: (to_world.translation - self.centre) * self.scale,
        }
    }

    /// A point of the file's world space.
    pub fn point(&self, world: DVec3) -> DVec3 {
        (world - self.centre) * self.scale
    }

    /// Where a point of the renderer's space lies in the file's world space.
    pub fn world(&self, point: [f32; 3]) -> [f64; 3] {
        (DVec3::from_array(point.map(f64::from)) / self.scale + self.centre).to_array()
    }

    /// What lengths are multiplied by: a power of two.
    pub fn scale(&self) -> f64 {
        self.scale
    }
}

fn corners(half: DVec3) -> impl Iterator<Item = DVec3> {
    let sign = |bit: u32| if bit == 0 { -1.0 } else { 1.0 };
    (0..8u32).map(move |k| half * DVec3::new(sign(k & 1), sign(k & 2), sign(k & 4)))
}
