//! The safeguards that keep rays exact, and rays without one of them to measure its cost and effect.
//!
//! [`Geometry`] has all safeguards. The functions here are the same code with one left out at compile time; unused,
//! they cost nothing. Instances and moving meshes keep all.

use crate::{Error, Geometry, Hit, Preset, Ray, Shape, SurfacePoint, surface};
use glam::Vec3;

/// A set of safeguards: all, unless a type leaves some out.
pub trait Safeguards: Copy + 'static {
    /// True: triangles are intersected in f64 where f32 cannot decide.
    const EXACT: bool = true;
    /// True: boxes grow by the bounds on rounding errors, and rays leave them slightly later.
    const PADDING: bool = true;
    /// True: the smallest shape and primitive number wins among hits at the same distance. False: the first one tested.
    const TIES: bool = true;
    /// True: a ray's origin moves off the surface by the bound on the point's rounding error. False: by 1e-4 in any scene.
    const OFFSETS: bool = true;
}

/// All safeguards, as [`Geometry`] has them.
#[derive(Clone, Copy, Debug)]
pub struct All;

impl Safeguards for All {}

/// All safeguards but [`Safeguards::EXACT`].
#[derive(Clone, Copy, Debug)]
pub struct WithoutExact;

impl Safeguards for WithoutExact {
    const EXACT: bool = false;
}

/// All safeguards but [`Safeguards::PADDING`].
#[derive(Clone, Copy, Debug)]
pub struct WithoutPadding;

impl Safeguards for WithoutPadding {
    const PADDING: bool = false;
}

/// All safeguards but [`Safeguards::TIES`].
#[derive(Clone, Copy, Debug)]
pub struct WithoutTies;

impl Safeguards for WithoutTies {
    const TIES: bool = false;
}

/// All safeguards but [`Safeguards::OFFSETS`].
#[derive(Clone, Copy, Debug)]
pub struct WithoutOffsets;

impl Safeguards for WithoutOffsets {
    const OFFSETS: bool = false;
}

/// [`Geometry::build`], with padded boxes or without.
///
/// # Errors
/// The errors of [`Geometry::build`].
pub fn build<S: Safeguards>(shapes: Vec<Shape>, preset: Preset) -> Result<Geometry, Error> {
    Geometry::build_padded(shapes, preset, S::PADDING)
}

/// [`Geometry::closest`] with these safeguards.
#[inline(always)]
#[must_use]
pub fn closest<S: Safeguards>(scene: &Geometry, ray: &Ray) -> Option<Hit> {
    scene.closest_with::<S>(ray, 0.0)
}

/// [`Geometry::occluded`] with these safeguards.
#[inline(always)]
#[must_use]
pub fn occluded<S: Safeguards>(scene: &Geometry, ray: &Ray) -> bool {
    scene.occluded_with::<S>(ray, 0.0)
}

/// [`spawn_ray`](crate::spawn_ray) with these safeguards.
#[inline(always)]
#[must_use]
pub fn spawn_ray<S: Safeguards>(from: &SurfacePoint, direction: Vec3) -> Ray {
    surface::spawn_ray_with::<S>(from, direction)
}
