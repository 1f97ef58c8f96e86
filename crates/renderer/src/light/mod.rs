//! Where light comes from, sampled by the solid angle it fills.

mod area;
mod environment;

pub use area::{DiskLamp, MeshLamp, SphereLamp};
pub use environment::{Environment, EnvironmentError};

use crate::shading::discrete::Discrete;
use dapple_geometry::SurfacePoint;
use glam::Vec3;

/// One emitter: a shape that shines, or the environment.
#[derive(Clone, Debug)]
pub enum Light {
    /// Triangles.
    Mesh(MeshLamp),
    /// A sphere.
    Sphere(SphereLamp),
    /// A disk or ring.
    Disk(DiskLamp),
    /// Everything beyond the scene.
    Environment(Environment),
}

/// Where a light sample lies.
#[derive(Clone, Copy, Debug)]
pub enum Target {
    /// On a surface.
    Surface(SurfacePoint),
    /// Infinitely far.
    Far,
}

/// Light that may arrive at a point, if nothing is in between.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction to the light.
    pub wi: Vec3,
    /// Radiance from there.
    pub radiance: Vec3,
    /// Density of `wi` in solid angle, above 0.
    pub pdf: f32,
    /// Where it comes from.
    pub target: Target,
}

/// The radiance of an emitting shape, and the sides it shines from.
#[derive(Clone, Copy, Debug)]
pub struct Lamp {
    pub(crate) radiance: Vec3,
    pub(crate) two_sided: bool,
}

impl Lamp {
    /// Radiance towards a unit direction that makes this cosine with the lamp's oriented normal.
    #[inline]
    pub fn radiance(&self, cosine: f32) -> Vec3 {
        if cosine > 0.0 || (self.two_sided && cosine < 0.0) { self.radiance } else { Vec3::ZERO }
    }

    /// Radiant exitance summed over channels with luminance weights, sides counted.
    fn brightness(&self) -> f64 {
        f64::from(luminance(self.radiance)) * if self.two_sided { 2.0 } else { 1.0 }
    }
}

/// [`dapple_core::luminance`] of a vector.
#[inline]
pub(crate) fn luminance(rgb: Vec3) -> f32 {
    dapple_core::luminance(rgb.to_array().map(f64::from)) as f32
}

/// All lights with the probabilities they are chosen by: proportional to power.
#[derive(Clone, Debug)]
pub struct Lights {
    lights: Vec<Light>,
    choice: Discrete,
    pmf: Vec<f32>,
    environment: Option<u32>,
}

impl Lights {
    /// Lights and their powers; those whose power is zero must have been left out.
    pub(crate) fn new(lights: Vec<Light>, scene_radius: f32) -> Self {
        let powers: Vec<f32> = lights.iter().map(|l| l.power(scene_radius)).collect();
        let choice = Discrete::new(&powers).or_else(|_| Discrete::new(&vec![1.0; powers.len()]));
        // Neither fails: powers are finite and few, and all-equal weights always do.
        let choice = choice.unwrap_or_else(|_| unreachable!("equal weights are weights"));
        // A single light is always chosen, even where its power is too small for f32.
        let pmf = (0..lights.len()).map(|i| if lights.len() == 1 { 1.0 } else { choice.pmf(i) }).collect();
        let environment = lights.iter().position(|l| matches!(l, Light::Environment(_))).map(|i| i as u32);
        Self { lights, choice, pmf, environment }
    }

    /// How many lights there are.
    pub fn len(&self) -> usize {
        self.lights.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// The environment, if it shines.
    #[inline]
    pub fn environment(&self) -> Option<(&Environment, f32)> {
        match self.lights.get(self.environment? as usize) {
            Some(Light::Environment(e)) => Some((e, self.pmf(self.environment?))),
            _ => None,
        }
    }

    /// Draws light arriving at `from`: `choice` chooses among several lights, `u` the direction. `pdf`
    /// includes the choice. `None` where the light chosen cannot shine on `from`.
    #[inline(always)]
    pub fn sample(&self, from: Vec3, choice: f32, u: [f32; 2]) -> Option<LightSample> {
        let (index, pmf) = match self.lights.len() {
            1 => (0, 1.0),
            _ => self.choice.sample(choice).map(|c| (c.index, c.pmf))?,
        };
        let mut sample = match &self.lights[index] {
            Light::Mesh(lamp) => lamp.sample(from, u),
            Light::Sphere(lamp) => lamp.sample(from, u),
            Light::Disk(lamp) => lamp.sample(from, u),
            Light::Environment(sky) => sky.sample(u),
        }?;
        sample.pdf *= pmf;
        // A density that overflowed would count for nothing, one that vanished for everything.
        (sample.pdf > 0.0 && sample.pdf < f32::INFINITY).then_some(sample)
    }

    /// Density in solid angle with which [`Lights::sample`] at `from` draws the direction to `point` on
    /// the emitting shape `light`, the choice included.
    #[inline]
    pub fn pdf(&self, light: u32, from: Vec3, point: &SurfacePoint) -> f32 {
        let pdf = match &self.lights[light as usize] {
            Light::Mesh(lamp) => lamp.pdf(from, point),
            Light::Sphere(lamp) => lamp.pdf(from, point),
            Light::Disk(lamp) => lamp.pdf(from, point),
            Light::Environment(_) => 0.0,
        };
        pdf * self.pmf(light)
    }

    /// The lamp of an emitting shape.
    #[inline]
    pub fn lamp(&self, light: u32) -> Option<&Lamp> {
        match self.lights.get(light as usize)? {
            Light::Mesh(lamp) => Some(lamp.lamp()),
            Light::Sphere(lamp) => Some(lamp.lamp()),
            Light::Disk(lamp) => Some(lamp.lamp()),
            Light::Environment(_) => None,
        }
    }

    /// Probability that a light is chosen.
    #[inline]
    pub fn pmf(&self, light: u32) -> f32 {
        self.pmf[light as usize]
    }
}

impl Light {
    /// Radiant power, luminance-weighted; an environment's is what enters the scene's bounding sphere.
    fn power(&self, scene_radius: f32) -> f32 {
        let power = match self {
            Self::Mesh(lamp) => lamp.area() * lamp.lamp().brightness(),
            Self::Sphere(lamp) => lamp.area() * lamp.lamp().brightness(),
            Self::Disk(lamp) => lamp.area() * lamp.lamp().brightness(),
            // Radiance times 4 pi times the disk pi r^2, over the pi of the others.
            Self::Environment(sky) => {
                4.0 * std::f64::consts::PI * f64::from(scene_radius).powi(2) * sky.average_luminance()
            }
        };
        power.min(f64::from(f32::MAX) / 1e6) as f32
    }
}

/// Density in solid angle at `from` of a point drawn uniformly on `area`: `d^2 / (|cos| area)`.
#[inline]
pub(crate) fn area_to_solid_angle(from: Vec3, point: &SurfacePoint, area: f32) -> f32 {
    let to = point.position - from;
    let squared = to.length_squared();
    let cosine = point.normal.dot(to).abs() / squared.sqrt();
    squared / (cosine * area)
}
