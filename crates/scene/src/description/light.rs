//! Lights that are not shapes.

use super::Source;
use crate::image::Image;
use dapple_core::film::luminance;
use glam::DAffine3;
use std::f64::consts::PI;
use std::sync::Arc;

/// A light that is not a shape: point, spot, distant light or environment.
#[derive(Clone, Debug)]
pub struct Light {
    /// The kind of light, with its parameters.
    pub kind: LightKind,
    /// The transform from the light's space to world space.
    pub to_world: DAffine3,
    /// File and line of the light, for messages.
    pub source: Source,
}

/// The kind of a light, with its parameters.
#[derive(Clone, Debug)]
pub enum LightKind {
    /// An environment: radiance from all directions, infinitely far away.
    Infinite {
        /// Radiance by direction.
        radiance: EnvironmentRadiance,
    },
    /// A point light at the origin of the light's space, with equal intensity in all directions.
    Point {
        /// Radiant intensity, linear RGB.
        intensity: [f32; 3],
    },
    /// A cone of light from the origin of the light's space, along +z.
    Spot {
        /// Radiant intensity along the axis, linear RGB.
        intensity: [f32; 3],
        /// Angle in degrees between the axis and the edge of the cone, beyond which intensity is 0.
        cone: f32,
        /// Angle in degrees between the axis and the start of the falloff; at most `cone`.
        falloff_start: f32,
        /// The shape of the falloff from `falloff_start` to `cone`.
        falloff: SpotFalloff,
    },
    /// Parallel light from infinitely far away. It arrives from the direction +z of the light's space.
    Distant {
        /// Irradiance of a surface that faces the light, linear RGB.
        irradiance: [f32; 3],
    },
}

impl LightKind {
    /// Returns a short name of the kind, such as "spot", for messages.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Infinite { radiance: EnvironmentRadiance::Constant(_) } => "uniform environment",
            Self::Infinite { .. } => "environment image",
            Self::Point { .. } => "point",
            Self::Spot { .. } => "spot",
            Self::Distant { .. } => "distant",
        }
    }

    /// Returns the radiance of an infinite light; `None` for all other kinds.
    pub fn environment(&self) -> Option<&EnvironmentRadiance> {
        if let Self::Infinite { radiance } = self { Some(radiance) } else { None }
    }

    /// Returns true if the light is not black. NaN counts as not black; the renderer's validation rejects it later.
    pub(crate) fn shines(&self) -> bool {
        self.power(1.0) != 0.0
    }

    /// Returns the luminance of the radiant power. `disk` is the area of the cross-section of the scene's bounding sphere,
    /// through which infinitely far light enters.
    pub(crate) fn power(&self, disk: f64) -> f64 {
        let brightness = |rgb: &[f32; 3]| luminance(rgb.map(f64::from));
        match self {
            Self::Infinite { radiance } => {
                let mean = match radiance {
                    EnvironmentRadiance::Constant(rgb) => brightness(rgb),
                    EnvironmentRadiance::LatLong { image, scale } => {
                        let [w, h] = image.size.map(|n| n as usize);
                        let share = |y: usize| ((y as f64 + 0.5) / h as f64 * PI).sin();
                        let rows = image.pixels.chunks_exact(w.max(1)).enumerate().map(|(y, row)| (share(y), row));
                        let sum: f64 =
                            rows.flat_map(|(share, row)| row.iter().map(move |p| brightness(p) * share)).sum();
                        // The sines of all rows sum up to 2 h / pi.
                        f64::from(*scale) * sum / w as f64 * PI / (2.0 * h as f64)
                    }
                    EnvironmentRadiance::EqualArea { image, scale } => {
                        f64::from(*scale) * image.pixels.iter().map(brightness).sum::<f64>() / image.pixels.len() as f64
                    }
                };
                4.0 * PI * disk * mean
            }
            Self::Point { intensity } => 4.0 * PI * brightness(intensity),
            Self::Spot { intensity, cone, falloff_start, falloff } => {
                let [edge, start] = [*cone, *falloff_start].map(|degrees| f64::from(degrees).to_radians().cos());
                // The falloff's mean over the cosine of the angle.
                let mean = match falloff {
                    SpotFalloff::Smoothstep => 0.5,
                    SpotFalloff::Quartic => 0.2,
                };
                2.0 * PI * brightness(intensity) * ((1.0 - start) + (start - edge) * mean)
            }
            Self::Distant { irradiance } => disk * brightness(irradiance),
        }
    }
}

impl EnvironmentRadiance {
    /// Returns the image of an environment map; `None` for constant radiance.
    pub fn image(&self) -> Option<&Arc<Image>> {
        match self {
            Self::Constant(_) => None,
            Self::LatLong { image, .. } | Self::EqualArea { image, .. } => Some(image),
        }
    }
}

/// The falloff of a spot light towards the edge of its cone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpotFalloff {
    /// pbrt-v4's falloff: `3 x^2 - 2 x^3`, where x is linear in the cosine.
    Smoothstep,
    /// The falloff of pbrt-v2 and v3: `x^4`, where x is linear in the cosine.
    Quartic,
}

/// The radiance of an environment by direction.
#[derive(Clone, Debug)]
pub enum EnvironmentRadiance {
    /// The same radiance from all directions, linear RGB.
    Constant([f32; 3]),
    /// A latitude-longitude image: with `u = (column + 0.5) / width`, `v = (row + 0.5) / height`, row 0 on top,
    /// `theta = pi v`, `phi = 2 pi u`, the direction in the light's frame is
    /// `(sin theta cos phi, sin theta sin phi, cos theta)`.
    LatLong {
        /// The image, linear RGB, top row first.
        image: Arc<Image>,
        /// Factor applied to every pixel value.
        scale: f32,
    },
    /// A square equal-area octahedral image [Clarberg 2008], as in pbrt-v4; z is up in the light's frame.
    EqualArea {
        /// The square image, linear RGB, top row first.
        image: Arc<Image>,
        /// Factor applied to every pixel value.
        scale: f32,
    },
}
