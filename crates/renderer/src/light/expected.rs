//! What a light is expected to give before anything was traced: a first guess for whoever learns it.

use super::{Light, luminance};
use glam::Vec3;

/// A light, as far as a guess of what it gives takes.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Expected {
    /// Somewhere in the scene.
    Near {
        middle: Vec3,
        radius: f32,
        /// Mean of its normals; shorter the more they differ, zero where it shines both ways.
        facing: Vec3,
        /// Radiant intensity along `facing`.
        intensity: f32,
    },
    /// Beyond it.
    Far {
        /// Unit, towards the light; zero where it comes from all sides.
        towards: Vec3,
        irradiance: f32,
    },
}

impl Expected {
    /// Of a light.
    pub(crate) fn of(light: &Light) -> Self {
        let one_sided = |two_sided: bool, facing: Vec3| if two_sided { Vec3::ZERO } else { facing };
        match light {
            Light::Mesh(lamp) => {
                let (middle, radius, facing) = lamp.extent();
                let facing = one_sided(lamp.lamp().two_sided, facing);
                let intensity = (luminance(lamp.lamp().radiance) * lamp.area()) as f32;
                Self::Near { middle, radius, facing, intensity }
            }
            Light::Disk(lamp) => {
                let (middle, radius, normal) = lamp.extent();
                let facing = one_sided(lamp.lamp().two_sided, normal);
                let intensity = (luminance(lamp.lamp().radiance) * lamp.area()) as f32;
                Self::Near { middle, radius, facing, intensity }
            }
            Light::Sphere(lamp) => {
                let (middle, radius) = lamp.extent();
                // The disk that is seen of it is a quarter of its surface.
                let intensity = (luminance(lamp.lamp().radiance) * lamp.area() * 0.25) as f32;
                Self::Near { middle, radius, facing: Vec3::ZERO, intensity }
            }
            Light::Point(lamp) => Self::at_a_point(lamp.position(), luminance(lamp.intensity())),
            // Its cone is left to be learned: it may cross a cell anywhere.
            Light::Spot(lamp) => {
                Self::at_a_point(lamp.position(), luminance(lamp.intensity()) * lamp.share_of_sphere())
            }
            Light::Distant(lamp) => {
                Self::Far { towards: lamp.towards(), irradiance: luminance(lamp.irradiance()) as f32 }
            }
            Light::Environment(sky) => {
                Self::Far { towards: Vec3::ZERO, irradiance: (std::f64::consts::PI * sky.average_luminance()) as f32 }
            }
            Light::Part(parts, part) => {
                let (towards, irradiance) = parts.expected(*part);
                Self::Far { towards, irradiance }
            }
        }
    }

    fn at_a_point(middle: Vec3, intensity: f64) -> Self {
        Self::Near { middle, radius: 0.0, facing: Vec3::ZERO, intensity: intensity as f32 }
    }

    /// About the irradiance of surfaces within `half` of `middle` whose normals are nearest to `axis`, nothing in
    /// between. Never 0 for a light on the wrong side: cells are not points.
    pub(crate) fn irradiance(&self, at: Vec3, half: f32, axis: Vec3) -> f32 {
        // Normals are up to 55 degrees off the axis.
        let received = |cosine: f32| ((cosine + 0.5) / 1.5).clamp(0.05, 1.0);
        match *self {
            Self::Near { middle, radius, facing, intensity } => {
                let to = middle - at;
                let wi = to.normalize_or_zero();
                let emitted = (-facing.dot(wi)).max(0.0) + 0.5 * (1.0 - facing.length()).max(0.0) + 0.05;
                let squared = to.length_squared() + radius * radius + half * half;
                intensity * emitted * received(axis.dot(wi)) / squared
            }
            Self::Far { towards, irradiance } if towards == Vec3::ZERO => irradiance,
            Self::Far { towards, irradiance } => irradiance * received(axis.dot(towards)),
        }
    }
}
