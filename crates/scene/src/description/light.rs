//! Lights that are no shapes.

use super::Source;
use crate::image::Image;
use glam::DAffine3;
use std::sync::Arc;

/// A light that is no shape.
#[derive(Clone, Debug)]
pub struct Light {
    /// What it is.
    pub kind: LightKind,
    /// From its space to world space.
    pub to_world: DAffine3,
    /// Where the file says so.
    pub source: Source,
}

/// What a light is.
#[derive(Clone, Debug)]
pub enum LightKind {
    /// Radiance from everywhere beyond the scene.
    Infinite {
        /// What it looks like.
        radiance: EnvironmentRadiance,
    },
    /// A point at the origin of the light's space that shines alike in all directions.
    Point {
        /// Radiant intensity, linear RGB.
        intensity: [f32; 3],
    },
    /// A point at the origin of the light's space that shines along +z.
    Spot {
        /// Radiant intensity along the axis, linear RGB.
        intensity: [f32; 3],
        /// Angle between the axis and the cone's edge, where light ends, degrees.
        cone: f32,
        /// Angle between the axis and where light begins to fall off, degrees; at most `cone`.
        falloff_start: f32,
        /// How it falls off between the two.
        falloff: SpotFalloff,
    },
    /// Parallel light from infinitely far, out of the direction +z of the light's space.
    Distant {
        /// Irradiance of a surface that faces the light, linear RGB.
        irradiance: [f32; 3],
    },
}

/// How a spot falls off towards the edge of its cone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpotFalloff {
    /// `3 x^2 - 2 x^3`, x linear in the cosine: pbrt-v4.
    Smoothstep,
    /// `x^4`, x linear in the cosine: pbrt-v2 and v3.
    Quartic,
}

/// What an environment looks like.
#[derive(Clone, Debug)]
pub enum EnvironmentRadiance {
    /// The same in all directions, linear RGB.
    Constant([f32; 3]),
    /// A latitude-longitude image: with `u = (column + .5) / width`, `v = (row + .5) / height`, row 0
    /// on top, `theta = pi v`, `phi = 2 pi u`, the direction in the light's frame is
    /// `(sin theta cos phi, sin theta sin phi, cos theta)`.
    LatLong {
        /// Linear RGB, top row first.
        image: Arc<Image>,
        /// Every value is multiplied by this.
        scale: f32,
    },
    /// A square equal-area octahedral image [Clarberg 2008], as pbrt-v4 has it; z is up in the light's frame.
    EqualArea {
        /// Linear RGB, top row first, as many rows as columns.
        image: Arc<Image>,
        /// Every value is multiplied by this.
        scale: f32,
    },
}
