//! What keeps rays right, and rays without one of it: to see what it costs and what it is good for.
//!
//! [`Geometry`] has all of them. The functions here are the same code with a safeguard left out at compile time; nobody
//! who does not call them has any of it. `dapple price` measures with them. Instances and meshes that move keep all.

use crate::{Error, Geometry, Hit, Preset, Ray, Shape, SurfacePoint, surface};
use glam::Vec3;

/// Which safeguards there are: all, unless a type says otherwise.
pub trait Safeguards: Copy + 'static {
    /// Triangles are finished in f64 where f32 cannot tell.
    const EXACT: bool = true;
    /// Boxes grow by what rounding asks for, and are left a little later than computed.
    const PADDING: bool = true;
    /// Of hits at the same distance the smallest number wins; else the one that is met first.
    const TIES: bool = true;
    /// Rays leave surfaces by a bound on the point's error; else by 1e-4, whatever the scene.
    const OFFSETS: bool = true;
}

/// What everybody has.
#[derive(Clone, Copy, Debug)]
pub struct All;

impl Safeguards for All {}

/// All but [`Safeguards::EXACT`].
#[derive(Clone, Copy, Debug)]
pub struct WithoutExact;

impl Safeguards for WithoutExact {
    const EXACT: bool = false;
}

/// All but [`Safeguards::PADDING`].
#[derive(Clone, Copy, Debug)]
pub struct WithoutPadding;

impl Safeguards for WithoutPadding {
    const PADDING: bool = false;
}

/// All but [`Safeguards::TIES`].
#[derive(Clone, Copy, Debug)]
pub struct WithoutTies;

impl Safeguards for WithoutTies {
    const TIES: bool = false;
}

/// All but [`Safeguards::OFFSETS`].
#[derive(Clone, Copy, Debug)]
pub struct WithoutOffsets;

impl Safeguards for WithoutOffsets {
    const OFFSETS: bool = false;
}

/// [`Geometry::build`], with boxes padded or not.
///
/// # Errors
/// As [`Geometry::build`].
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
