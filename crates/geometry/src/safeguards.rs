//! The safeguards against rounding errors in ray intersection, and variants of the code without one of them. The
//! variants measure a safeguard's cost and effect.
//!
//! [`Geometry`] itself always has all safeguards. The functions here compile the same code with one safeguard left
//! out; programs that do not call them pay nothing. Instances and moving meshes always keep all safeguards.

use crate::{Error, Geometry, Hit, Preset, Ray, Shape, SurfacePoint, surface};
use glam::Vec3;

/// A set of safeguards. It contains all of them by default; a type overrides a constant to leave one out.
pub trait Safeguards: Copy + 'static {
    /// True if triangles are intersected again in f64 where f32 cannot decide.
    const EXACT: bool = true;
    /// True if boxes are padded by the bounds on rounding errors, and the exit distance of boxes is increased
    /// slightly.
    const PADDING: bool = true;
    /// True if, of hits at the same distance, the one with the smallest shape and primitive number wins. If false, the
    /// hit tested first wins.
    const TIES: bool = true;
    /// True if a new ray's origin moves off its surface by the bound on the point's rounding error. If false, it moves
    /// by 1e-4 scene units.
    const OFFSETS: bool = true;
}

/// The set of all safeguards, which [`Geometry`] uses.
#[derive(Clone, Copy, Debug)]
pub struct All;

impl Safeguards for All {}

/// The set of all safeguards except [`Safeguards::EXACT`], the f64 intersection.
#[derive(Clone, Copy, Debug)]
pub struct WithoutExact;

impl Safeguards for WithoutExact {
    const EXACT: bool = false;
}

/// The set of all safeguards except [`Safeguards::PADDING`] of boxes.
#[derive(Clone, Copy, Debug)]
pub struct WithoutPadding;

impl Safeguards for WithoutPadding {
    const PADDING: bool = false;
}

/// The set of all safeguards except [`Safeguards::TIES`], the fixed order of hits at the same distance.
#[derive(Clone, Copy, Debug)]
pub struct WithoutTies;

impl Safeguards for WithoutTies {
    const TIES: bool = false;
}

/// The set of all safeguards except [`Safeguards::OFFSETS`], the error bounds on a ray's origin.
#[derive(Clone, Copy, Debug)]
pub struct WithoutOffsets;

impl Safeguards for WithoutOffsets {
    const OFFSETS: bool = false;
}

/// Builds a scene as [`Geometry::build`] does, with boxes padded for rounding if [`Safeguards::PADDING`] is true.
///
/// # Errors
/// The errors of [`Geometry::build`].
pub fn build<S: Safeguards>(shapes: Vec<Shape>, preset: Preset) -> Result<Geometry, Error> {
    Geometry::build_padded(shapes, preset, S::PADDING)
}

/// Returns the closest hit as [`Geometry::closest`] does, with the safeguards `S` only.
#[inline(always)]
#[must_use]
pub fn closest<S: Safeguards>(scene: &Geometry, ray: &Ray) -> Option<Hit> {
    scene.closest_with::<S>(ray, 0.0)
}

/// Returns true if anything is hit, as [`Geometry::occluded`] does, with the safeguards `S` only.
#[inline(always)]
#[must_use]
pub fn occluded<S: Safeguards>(scene: &Geometry, ray: &Ray) -> bool {
    scene.occluded_with::<S>(ray, 0.0)
}

/// Returns a ray that leaves a surface, as [`spawn_ray`](crate::spawn_ray) does, with the safeguards `S` only.
#[inline(always)]
#[must_use]
pub fn spawn_ray<S: Safeguards>(from: &SurfacePoint, direction: Vec3) -> Ray {
    surface::spawn_ray_with::<S>(from, direction)
}
