//! Where light comes from, sampled by the solid angle it fills.

// `!(x > 0.0)` is meant: it turns away what is not a number, too.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod area;
mod choice;
mod environment;
mod expected;
mod octahedral;
mod punctual;
mod spherical;

pub use area::{DiskLamp, MeshLamp, SphereLamp};
pub use choice::LightChoice;
use environment::Parts;
pub use environment::{Environment, EnvironmentError};
pub(crate) use expected::Expected;
pub use punctual::{DistantLamp, PointLamp, PunctualError, SpotLamp};

use crate::shading::discrete::Discrete;
use crate::shading::power_heuristic;
use dapple_geometry::SurfacePoint;
use glam::Vec3;
use std::sync::Arc;

/// One emitter: a shape that shines, something without extent, or what lies beyond the scene.
#[derive(Clone, Debug)]
pub(crate) enum Light {
    /// Triangles.
    Mesh(MeshLamp),
    /// A sphere.
    Sphere(SphereLamp),
    /// A disk or ring.
    Disk(DiskLamp),
    /// Everything beyond the scene.
    Environment(Arc<Environment>),
    /// A part of that.
    Part(Arc<Parts>, u32),
    /// A point.
    Point(PointLamp),
    /// A point that shines into a cone.
    Spot(SpotLamp),
    /// Parallel light.
    Distant(DistantLamp),
}

/// Where a light sample lies.
#[derive(Clone, Copy, Debug)]
pub enum Target {
    /// On a surface.
    Surface(SurfacePoint),
    /// A point in space.
    Point(Vec3),
    /// Infinitely far.
    Far,
}

/// Light that may arrive at a point, if nothing is in between.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction to the light.
    pub wi: Vec3,
    /// Radiance from there; from a light without extent, the irradiance of a surface that faces it.
    pub radiance: Vec3,
    /// Density of `wi` in solid angle, above 0; of a light without extent, the probability that it was chosen.
    pub pdf: f32,
    /// Where it comes from.
    pub target: Target,
    /// Whether the light has no extent, so that no ray could meet it by chance: the sample counts in full, without
    /// a weight against BSDF sampling.
    pub delta: bool,
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
        luminance(self.radiance) * if self.two_sided { 2.0 } else { 1.0 }
    }
}

/// [`dapple_core::luminance`] of a vector.
fn luminance(rgb: Vec3) -> f64 {
    dapple_core::luminance(rgb.to_array().map(f64::from))
}

/// All lights with the probabilities they are chosen by.
#[derive(Clone, Debug)]
pub struct Lights {
    lights: Vec<Light>,
    choice: Discrete,
    pmf: Vec<f32>,
    /// Those that rays beyond the scene meet.
    skies: Vec<Sky>,
    /// How many there are with each environment in one piece.
    whole: usize,
    has_delta: bool,
    /// Whether integrators are to learn the choice.
    learned: bool,
    scene_radius: f32,
}

/// An environment among the lights.
#[derive(Clone, Debug)]
struct Sky {
    whole: Arc<Environment>,
    /// The light that it is, or its first part.
    light: u32,
    /// Its parts, if it is cut up, and the light that is the second of them: the rest follow.
    cut: Option<(Arc<Parts>, u32)>,
}

impl Sky {
    /// Radiance from unit direction `w`, the density in solid angle with which its light draws it, and that light.
    #[inline(always)]
    fn find(&self, w: Vec3) -> (Vec3, f32, u32) {
        match &self.cut {
            None => {
                let (radiance, pdf) = self.whole.radiance_and_pdf(w);
                (radiance, pdf, self.light)
            }
            Some((parts, second)) => {
                let (radiance, pdf, part) = parts.find(w);
                (radiance, pdf, if part == 0 { self.light } else { second + part - 1 })
            }
        }
    }
}

impl Lights {
    /// Lights, chosen by power; those that give no light must have been left out.
    pub(crate) fn new(lights: Vec<Light>, scene_radius: f32) -> Self {
        let sky = |(light, of): (usize, &Light)| match of {
            Light::Environment(whole) => Some(Sky { whole: whole.clone(), light: light as u32, cut: None }),
            _ => None,
        };
        let skies = lights.iter().enumerate().filter_map(sky).collect();
        let has_delta = lights.iter().any(|l| matches!(l, Light::Point(_) | Light::Spot(_) | Light::Distant(_)));
        let (choice, pmf) = (choice::by_power(&[]), Vec::new());
        let whole = lights.len();
        let mut lights = Self { lights, choice, pmf, skies, whole, has_delta, learned: false, scene_radius };
        lights.set_choice(LightChoice::default());
        lights
    }

    /// Sets how a light is chosen. Whatever it is, every light has a chance.
    pub(crate) fn set_choice(&mut self, choice: LightChoice) {
        self.learned = choice == LightChoice::Cells;
        self.join();
        if self.learned {
            self.cut();
        }
        let weight = |light: &Light| match choice {
            LightChoice::Power | LightChoice::Cells => light.power(f64::from(self.scene_radius)),
            LightChoice::Uniform => 1.0,
        };
        self.choice = choice::by_power(&self.lights.iter().map(weight).collect::<Vec<_>>());
        self.pmf = (0..self.lights.len()).map(|i| self.choice.pmf(i)).collect();
    }

    /// Makes a light of each part of an environment, so that the choice among them can be learned.
    fn cut(&mut self) {
        for sky in &mut self.skies {
            let Some(parts) = Parts::new(&sky.whole).map(Arc::new) else { continue };
            let second = self.lights.len() as u32;
            self.lights[sky.light as usize] = Light::Part(parts.clone(), 0);
            self.lights.extend((1..parts.len() as u32).map(|part| Light::Part(parts.clone(), part)));
            sky.cut = Some((parts, second));
        }
    }

    /// Undoes that.
    fn join(&mut self) {
        self.lights.truncate(self.whole);
        for sky in &mut self.skies {
            self.lights[sky.light as usize] = Light::Environment(sky.whole.clone());
            sky.cut = None;
        }
    }

    /// What each light is expected to give.
    pub(crate) fn expected(&self) -> Vec<Expected> {
        self.lights.iter().map(Expected::of).collect()
    }

    /// How many lights there are to choose among: an environment counts as its parts where the choice is learned.
    pub fn len(&self) -> usize {
        self.lights.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// Whether the choice is to be learned, and there is one.
    pub(crate) fn is_choice_learned(&self) -> bool {
        self.learned && self.lights.len() > 1
    }

    /// Whether light comes from beyond the scene that rays can meet.
    #[inline]
    pub fn has_sky(&self) -> bool {
        !self.skies.is_empty()
    }

    /// Whether there is a light without extent.
    #[inline]
    pub fn has_delta(&self) -> bool {
        self.has_delta
    }

    /// Radiance from beyond the scene along a unit direction, all infinite lights summed. `last_pdf` is the density
    /// in solid angle with which the direction was drawn: each light's part is then weighted by the power heuristic
    /// against [`Lights::sample`]; `None` if light sampling could not have found it.
    #[inline]
    pub fn sky(&self, direction: Vec3, last_pdf: Option<f32>) -> Vec3 {
        self.sky_chosen(direction, last_pdf, |light| self.pmf(light))
    }

    /// [`Lights::sky`] where lights are chosen with other probabilities.
    #[inline(always)]
    pub(crate) fn sky_chosen(&self, direction: Vec3, last_pdf: Option<f32>, pmf: impl Fn(u32) -> f32) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for sky in &self.skies {
            sum += match last_pdf {
                Some(last) => {
                    let (radiance, pdf, light) = sky.find(direction);
                    radiance * power_heuristic(last, pdf * pmf(light))
                }
                None => sky.whole.radiance(direction),
            };
        }
        sum
    }

    /// Draws light arriving at `from`: `choice` chooses among several lights, `u` the direction. `pdf`
    /// includes the choice. `None` where the light chosen cannot shine on `from`.
    #[inline(always)]
    pub fn sample(&self, from: Vec3, choice: f32, u: [f32; 2]) -> Option<LightSample> {
        let (index, pmf) = match self.lights.len() {
            1 => (0, 1.0),
            _ => self.choice.sample(choice).map(|c| (c.index, c.pmf))?,
        };
        self.sample_one(index, pmf, from, u)
    }

    /// [`Lights::sample`] of the light `index`, which was chosen with probability `pmf`.
    #[inline(always)]
    pub(crate) fn sample_one(&self, index: usize, pmf: f32, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let mut sample = match &self.lights[index] {
            Light::Mesh(lamp) => lamp.sample(from, u),
            Light::Sphere(lamp) => lamp.sample(from, u),
            Light::Disk(lamp) => lamp.sample(from, u),
            Light::Environment(sky) => sky.sample(u),
            Light::Part(parts, part) => parts.sample(*part, u),
            Light::Point(lamp) => lamp.sample(from),
            Light::Spot(lamp) => lamp.sample(from),
            Light::Distant(lamp) => Some(lamp.sample()),
        }?;
        sample.pdf *= pmf;
        // A density that overflowed would count for nothing, one that vanished for everything.
        (sample.pdf > 0.0 && sample.pdf < f32::INFINITY).then_some(sample)
    }

    /// Density in solid angle with which [`Lights::sample`] at `from` draws the direction to `point` on
    /// the emitting shape `light`, the choice included.
    #[inline]
    pub fn pdf(&self, light: u32, from: Vec3, point: &SurfacePoint) -> f32 {
        self.pdf_chosen(light, self.pmf(light), from, point)
    }

    /// [`Lights::pdf`] where the light is chosen with probability `pmf`.
    #[inline(always)]
    pub(crate) fn pdf_chosen(&self, light: u32, pmf: f32, from: Vec3, point: &SurfacePoint) -> f32 {
        let pdf = match &self.lights[light as usize] {
            Light::Mesh(lamp) => lamp.pdf(from, point),
            Light::Sphere(lamp) => lamp.pdf(from, point),
            Light::Disk(lamp) => lamp.pdf(from, point),
            Light::Environment(_) | Light::Part(..) | Light::Point(_) | Light::Spot(_) | Light::Distant(_) => 0.0,
        };
        pdf * pmf
    }

    /// The lamp of an emitting shape.
    #[inline]
    pub fn lamp(&self, light: u32) -> Option<&Lamp> {
        match self.lights.get(light as usize)? {
            Light::Mesh(lamp) => Some(lamp.lamp()),
            Light::Sphere(lamp) => Some(lamp.lamp()),
            Light::Disk(lamp) => Some(lamp.lamp()),
            Light::Environment(_) | Light::Part(..) | Light::Point(_) | Light::Spot(_) | Light::Distant(_) => None,
        }
    }

    /// Probability that a light is chosen.
    #[inline]
    pub fn pmf(&self, light: u32) -> f32 {
        self.pmf[light as usize]
    }
}

impl Light {
    /// Radiant power over pi, luminance-weighted; of light from far away, what enters the scene's bounding sphere.
    fn power(&self, scene_radius: f64) -> f64 {
        match self {
            Self::Mesh(lamp) => lamp.area() * lamp.lamp().brightness(),
            Self::Sphere(lamp) => lamp.area() * lamp.lamp().brightness(),
            Self::Disk(lamp) => lamp.area() * lamp.lamp().brightness(),
            Self::Environment(sky) => sky.power(scene_radius),
            Self::Part(parts, part) => parts.whole().power(scene_radius) * parts.share(*part),
            // Intensity times 4 pi.
            Self::Point(lamp) => 4.0 * luminance(lamp.intensity()),
            Self::Spot(lamp) => 4.0 * luminance(lamp.intensity()) * lamp.share_of_sphere(),
            // Irradiance times the disk pi r^2.
            Self::Distant(lamp) => luminance(lamp.irradiance()) * scene_radius * scene_radius,
        }
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
