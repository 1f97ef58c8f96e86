//! Lights, and the sampling of directions towards them by solid angle.
//!
//! A new kind of light is a file in this directory that implements `LightSource`, and a line in the list of lights
//! below.

// `!(x > 0.0)` is intended: it rejects NaN too.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod disk;
mod distant;
mod emission;
mod environment;
mod expectation;
mod mesh;
mod octahedral;
mod point;
mod punctual;
mod selection;
mod sphere;
mod spherical;
mod spot;

pub(crate) use disk::DiskLight;
pub(crate) use distant::DistantLight;
pub(crate) use emission::SceneSphere;
pub use emission::{EmissionPdf, EmittedLight};
pub use environment::{Environment, EnvironmentError};
use environment::{Tile, Tiles};
pub(crate) use expectation::Expectation;
pub(crate) use mesh::MeshLight;
pub(crate) use point::PointLight;
pub use punctual::PunctualError;
pub use selection::{LightSelection, UnknownLightSelection};
pub(crate) use sphere::SphereLight;
pub(crate) use spot::SpotLight;

use crate::shading::discrete::Discrete;
use crate::shading::power_heuristic;
use crate::space::Space;
use dapple_geometry::{Ray, SurfacePoint, spawn_ray, spawn_ray_to, spawn_ray_to_point};
use dapple_scene::{Light as Described, LightKind};
use glam::Vec3;
use std::sync::Arc;

/// The functions that each kind of light implements.
pub(crate) trait LightSource {
    /// Samples a direction from the point `from` to the light by random numbers `u` in `[0, 1)^2`. Returns `None` if
    /// no light arrives at `from` from the sampled direction.
    fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample>;

    /// Returns the solid-angle density with which [`Self::sample`] at `from` samples the direction to a `point` on the
    /// light's shape.
    ///
    /// Returns 0 for lights without a shape.
    #[inline]
    fn pdf(&self, from: Vec3, point: &SurfacePoint) -> f32 {
        let _ = (from, point);
        0.0
    }

    /// Returns the emission of an area light; `None` for lights without a shape.
    #[inline]
    fn lamp(&self) -> Option<&Lamp> {
        None
    }

    /// Returns true for a light that no ray can hit: a point, a spot or a distant light.
    fn is_delta(&self) -> bool {
        false
    }

    /// Samples a ray that leaves the light, as [`Lights::sample_emission`] does. `light` and `pmf` are left to the caller.
    fn emit(&self, scene: &SceneSphere, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight>;

    /// Returns the densities of [`Self::emit`]; see [`Lights::emission_pdf`].
    fn emission_pdf(&self, scene: &SceneSphere, normal: Vec3, direction: Vec3) -> EmissionPdf;

    /// Returns the luminance of the light's radiant power, divided by pi. An environment or distant light counts with
    /// the power that enters the scene's bounding sphere. `scene_radius` is the sphere's radius.
    fn power(&self, scene_radius: f64) -> f64;

    /// Returns an approximation of the light's contribution, which learned selection uses before it has samples.
    fn expectation(&self) -> Expectation;
}

/// Declares the enum of all lights, which dispatches without a virtual table.
macro_rules! lights {
    ($($(#[$about:meta])* $name:ident($source:ty),)*) => {
        /// A light of the scene: an area light, a point or spot light, or light from infinity.
        #[derive(Clone, Debug)]
        pub(crate) enum Light {
            $($(#[$about])* $name($source),)*
        }

        impl LightSource for Light {
            #[inline(always)]
            fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
                match self { $(Self::$name(light) => light.sample(from, u),)* }
            }

            #[inline(always)]
            fn pdf(&self, from: Vec3, point: &SurfacePoint) -> f32 {
                match self { $(Self::$name(light) => light.pdf(from, point),)* }
            }

            #[inline(always)]
            fn lamp(&self) -> Option<&Lamp> {
                match self { $(Self::$name(light) => light.lamp(),)* }
            }

            fn is_delta(&self) -> bool {
                match self { $(Self::$name(light) => light.is_delta(),)* }
            }

            fn emit(&self, scene: &SceneSphere, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
                match self { $(Self::$name(light) => light.emit(scene, place, towards),)* }
            }

            fn emission_pdf(&self, scene: &SceneSphere, normal: Vec3, direction: Vec3) -> EmissionPdf {
                match self { $(Self::$name(light) => light.emission_pdf(scene, normal, direction),)* }
            }

            fn power(&self, scene_radius: f64) -> f64 {
                match self { $(Self::$name(light) => light.power(scene_radius),)* }
            }

            fn expectation(&self) -> Expectation {
                match self { $(Self::$name(light) => light.expectation(),)* }
            }
        }
    };
}

lights! {
    /// A mesh of triangles that emit light.
    Mesh(MeshLight),
    /// A sphere that emits light.
    Sphere(SphereLight),
    /// A disk or ring that emits light.
    Disk(DiskLight),
    /// A whole environment, selected as one light.
    Environment(Arc<Environment>),
    /// A rectangle of an environment map, selected as a light of its own.
    Tile(Tile),
    /// A point that emits in all directions.
    Point(PointLight),
    /// A point that emits into a cone.
    Spot(SpotLight),
    /// Parallel light from infinity.
    Distant(DistantLight),
}

impl Light {
    /// Prepares a light of the scene. Returns `None` if it emits nothing.
    ///
    /// # Errors
    ///
    /// An error message with the light's line in the scene file, if a parameter or the transform is invalid.
    pub(crate) fn of(described: &Described, space: &Space) -> Result<Option<Self>, String> {
        let (to_world, at) = (described.to_world, &described.source);
        let light = match &described.kind {
            LightKind::Infinite { radiance } => Environment::new(radiance, to_world.matrix3, at)
                .map_err(|e| e.to_string())?
                .map(|environment| Self::Environment(Arc::new(environment))),
            LightKind::Point { intensity } => {
                PointLight::new(*intensity, to_world, space, at).map_err(|e| e.to_string())?.map(Self::Point)
            }
            LightKind::Spot { intensity, cone, falloff_start, falloff } => {
                SpotLight::new(*intensity, [*cone, *falloff_start], *falloff, to_world, space, at)
                    .map_err(|e| e.to_string())?
                    .map(Self::Spot)
            }
            LightKind::Distant { irradiance } => {
                DistantLight::new(*irradiance, to_world, at).map_err(|e| e.to_string())?.map(Self::Distant)
            }
        };
        Ok(light)
    }
}

/// The place that a light sample comes from.
#[derive(Clone, Copy, Debug)]
pub enum Target {
    /// A point on the surface of an area light.
    Surface(SurfacePoint),
    /// The position of a point or spot light.
    Point(Vec3),
    /// A place infinitely far away.
    Far,
}

impl Target {
    /// Returns the ray from a surface point to the target. `direction` is the unit direction to the target.
    #[inline(always)]
    pub(crate) fn ray_from(&self, from: &SurfacePoint, direction: Vec3) -> Ray {
        match self {
            Self::Surface(point) => spawn_ray_to(from, point),
            Self::Point(position) => spawn_ray_to_point(from, *position),
            Self::Far => spawn_ray(from, direction),
        }
    }
}

/// A sample of the light that arrives at a point, without regard to occlusion.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// The unit direction to the light.
    pub wi: Vec3,
    /// The linear RGB radiance from `wi`. For a light without extent, the irradiance on a surface that faces the
    /// light.
    pub radiance: Vec3,
    /// The solid-angle density of `wi` times the probability of selecting the light, above 0. For a light without
    /// extent, the probability alone.
    pub pdf: f32,
    /// The place that the light comes from.
    pub target: Target,
    /// True if the light has no extent, so that no ray can hit it.
    ///
    /// The sample then gets no multiple-importance weight against BSDF sampling.
    pub delta: bool,
}

impl LightSample {
    /// Returns the ray from the shaded point to the light. The light is visible if nothing is hit before the ray's
    /// `tmax`.
    #[inline(always)]
    pub fn shadow_ray(&self, from: &SurfacePoint) -> Ray {
        self.target.ray_from(from, self.wi)
    }
}

/// A light selected at random, with its probability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelectedLight {
    /// The index of the light in [`Lights`].
    pub index: u32,
    /// The probability with which the light was selected.
    pub pmf: f32,
}

/// The emission of an area light: its radiance, from one side or from both.
#[derive(Clone, Copy, Debug)]
pub struct Lamp {
    pub(crate) radiance: Vec3,
    pub(crate) two_sided: bool,
}

impl Lamp {
    /// Returns the emitted radiance in a direction. `cosine` is taken between the direction and the normal of the
    /// emitting side.
    #[inline]
    pub fn radiance(&self, cosine: f32) -> Vec3 {
        if cosine > 0.0 || (self.two_sided && cosine < 0.0) { self.radiance } else { Vec3::ZERO }
    }

    /// Returns the luminance of the radiant exitance, divided by pi and summed over the emitting sides.
    fn brightness(&self) -> f64 {
        luminance(self.radiance) * if self.two_sided { 2.0 } else { 1.0 }
    }

    /// Returns the luminance of the radiant intensity that a flat emitter of this area has along its normal.
    fn intensity(&self, area: f64) -> f32 {
        (luminance(self.radiance) * area) as f32
    }

    /// Returns `normal` if the light emits from one side, and the zero vector if it emits from both.
    fn facing(&self, normal: Vec3) -> Vec3 {
        if self.two_sided { Vec3::ZERO } else { normal }
    }
}

/// Returns the luminance of a linear RGB color, by [`dapple_core::luminance`].
fn luminance(rgb: Vec3) -> f64 {
    dapple_core::luminance(rgb.to_array().map(f64::from))
}

/// All lights of a scene, with the probabilities of their selection.
#[derive(Clone, Debug)]
pub struct Lights {
    lights: Vec<Light>,
    distribution: Discrete,
    pmf: Vec<f32>,
    environments: Vec<SelectableEnvironment>,
    /// The number of lights if each environment counts as one.
    whole: usize,
    has_delta: bool,
    is_learned: bool,
    scene: SceneSphere,
}

/// An environment with the indices of its lights.
#[derive(Clone, Debug)]
struct SelectableEnvironment {
    whole: Arc<Environment>,
    /// The index of the environment's light, or of its first tile.
    light: u32,
    /// The environment's tiles and the index of the second tile's light, if the environment is divided; further tiles
    /// follow.
    tiles: Option<(Arc<Tiles>, u32)>,
}

impl SelectableEnvironment {
    /// Returns the radiance from the unit direction `w`, the solid-angle density of `w` under light sampling once its
    /// light is selected, and the index of that light.
    #[inline(always)]
    fn find(&self, w: Vec3) -> (Vec3, f32, u32) {
        match &self.tiles {
            None => {
                let (radiance, pdf) = self.whole.radiance_and_pdf(w);
                (radiance, pdf, self.light)
            }
            Some((tiles, second)) => {
                let (radiance, pdf, tile) = tiles.find(w);
                (radiance, pdf, if tile == 0 { self.light } else { second + tile - 1 })
            }
        }
    }
}

impl Lights {
    /// Makes the set of lights, selected in proportion to their power. Every light must emit something.
    pub(crate) fn new(lights: Vec<Light>, scene: SceneSphere) -> Self {
        let environment = |(light, of): (usize, &Light)| match of {
            Light::Environment(whole) => {
                Some(SelectableEnvironment { whole: whole.clone(), light: light as u32, tiles: None })
            }
            _ => None,
        };
        let mut lights = Self {
            environments: lights.iter().enumerate().filter_map(environment).collect(),
            has_delta: lights.iter().any(LightSource::is_delta),
            whole: lights.len(),
            lights,
            distribution: selection::by_power(&[]),
            pmf: Vec::new(),
            is_learned: false,
            scene,
        };
        lights.set_selection(LightSelection::default());
        lights
    }

    /// Sets the distribution by which lights are selected. Every light keeps a positive probability.
    pub(crate) fn set_selection(&mut self, selection: LightSelection) {
        self.is_learned = selection == LightSelection::Learned;
        self.join_tiles();
        if self.is_learned {
            self.cut_into_tiles();
        }
        let weight = |light: &Light| match selection {
            LightSelection::Power | LightSelection::Learned => light.power(f64::from(self.scene.radius)),
            LightSelection::Uniform => 1.0,
        };
        self.distribution = selection::by_power(&self.lights.iter().map(weight).collect::<Vec<_>>());
        self.pmf = (0..self.lights.len()).map(|i| self.distribution.pmf(i)).collect();
    }

    /// Divides each environment map into one light per tile, so that the selection of tiles can be learned.
    fn cut_into_tiles(&mut self) {
        for environment in &mut self.environments {
            let Some(tiles) = Tiles::new(&environment.whole).map(Arc::new) else { continue };
            let second = self.lights.len() as u32;
            self.lights[environment.light as usize] = Light::Tile(Tile::new(&tiles, 0));
            self.lights.extend((1..tiles.len() as u32).map(|tile| Light::Tile(Tile::new(&tiles, tile))));
            environment.tiles = Some((tiles, second));
        }
    }

    /// Makes each divided environment map a single light again.
    fn join_tiles(&mut self) {
        self.lights.truncate(self.whole);
        for environment in &mut self.environments {
            self.lights[environment.light as usize] = Light::Environment(environment.whole.clone());
            environment.tiles = None;
        }
    }

    /// Returns an approximation of each light's contribution, which learned selection uses before it has samples.
    pub(crate) fn expectations(&self) -> Vec<Expectation> {
        self.lights.iter().map(LightSource::expectation).collect()
    }

    /// Returns the number of lights to select from. With learned selection, each tile of an environment map is a
    /// light.
    pub fn len(&self) -> usize {
        self.lights.len()
    }

    /// Returns true if there is no light.
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// Returns true if the selection is learned and there are several lights.
    pub(crate) fn is_selection_learned(&self) -> bool {
        self.is_learned && self.lights.len() > 1
    }

    /// Returns true if there is an environment among the lights.
    #[inline]
    pub fn has_environment(&self) -> bool {
        !self.environments.is_empty()
    }

    /// Returns true if a light has no extent: a point, a spot or a distant light.
    #[inline]
    pub fn has_delta(&self) -> bool {
        self.has_delta
    }

    /// Returns the summed radiance of all environments from a unit direction.
    #[inline]
    pub fn environment(&self, direction: Vec3) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for environment in &self.environments {
            sum += environment.whole.radiance(direction);
        }
        sum
    }

    /// Returns the radiance of all environments from a direction that BSDF sampling chose with solid-angle density
    /// `bsdf_pdf`, with its multiple-importance weights.
    ///
    /// The weight of each environment is the power heuristic against light sampling. `pmf` returns the probability
    /// with which light sampling selects a light: [`Lights::pmf`] if directions come from [`Lights::sample`].
    #[inline(always)]
    pub fn environment_weighted(&self, direction: Vec3, bsdf_pdf: f32, pmf: impl Fn(u32) -> f32) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for environment in &self.environments {
            let (radiance, pdf, light) = environment.find(direction);
            sum += radiance * power_heuristic(bsdf_pdf, pdf * pmf(light));
        }
        sum
    }

    /// Samples light that arrives at the point `from`. `choice` in `[0, 1)` selects a light, and `u` in `[0, 1)^2` a
    /// direction to it.
    ///
    /// The density includes the probability of selecting the light. Returns `None` if no light arrives from the
    /// sampled direction.
    #[inline(always)]
    pub fn sample(&self, from: Vec3, choice: f32, u: [f32; 2]) -> Option<LightSample> {
        self.sample_selected(self.select(choice)?, from, u)
    }

    /// Selects a light by a random number `u` in `[0, 1)`. Returns `None` if there is no light.
    #[inline(always)]
    pub fn select(&self, u: f32) -> Option<SelectedLight> {
        match self.lights.len() {
            1 => Some(SelectedLight { index: 0, pmf: 1.0 }),
            _ => self.distribution.sample(u).map(|c| SelectedLight { index: c.index as u32, pmf: c.pmf }),
        }
    }

    /// Samples a direction from the point `from` to a selected light, by `u` in `[0, 1)^2`. The density includes the
    /// probability of the selection. Returns `None` if no light arrives from there.
    #[inline(always)]
    pub fn sample_selected(&self, light: SelectedLight, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let mut sample = self.lights[light.index as usize].sample(from, u)?;
        sample.pdf *= light.pmf;
        // A density that overflowed to infinity would give weight 0, and a density of 0 infinite weight.
        (sample.pdf > 0.0 && sample.pdf < f32::INFINITY).then_some(sample)
    }

    /// Returns the solid-angle density with which [`Lights::sample`] samples the direction from `from` to `point` on
    /// the shape of an area light.
    ///
    /// The density includes the probability of selecting the light.
    #[inline]
    pub fn pdf(&self, light: u32, from: Vec3, point: &SurfacePoint) -> f32 {
        self.direction_pdf(light, from, point) * self.pmf(light)
    }

    /// Returns the density as [`Lights::pdf`] does, without the probability of selecting the light.
    #[inline(always)]
    pub fn direction_pdf(&self, light: u32, from: Vec3, point: &SurfacePoint) -> f32 {
        self.lights[light as usize].pdf(from, point)
    }

    /// Returns the emission of an area light by its index; `None` for other lights and unused indices.
    #[inline]
    pub fn lamp(&self, light: u32) -> Option<&Lamp> {
        self.lights.get(light as usize)?.lamp()
    }

    /// Returns the probability with which [`Lights::select`] returns `light`.
    #[inline]
    pub fn pmf(&self, light: u32) -> f32 {
        self.pmf[light as usize]
    }
}

/// Returns the light sample of a point that was sampled uniformly on `area`. `side` is 1 if the point's normal is on
/// the emitting side, and -1 if it is on the other.
#[inline(always)]
fn sample_on(lamp: &Lamp, from: Vec3, point: SurfacePoint, side: f32, area: f32) -> Option<LightSample> {
    let to = point.position - from;
    let squared = to.length_squared();
    let wi = to * squared.sqrt().recip();
    let cosine = -side * point.normal.dot(wi);
    let radiance = lamp.radiance(cosine);
    // The density is the one of `area_to_solid_angle`. It is 0 or NaN if the light touches the point.
    let pdf = squared / (cosine.abs() * area);
    let target = Target::Surface(point);
    (radiance != Vec3::ZERO && pdf > 0.0).then_some(LightSample { wi, radiance, pdf, target, delta: false })
}

/// Returns the solid-angle density at `from` of a point sampled uniformly on `area`: `d^2 / (|cos| area)` at distance
/// `d`.
#[inline]
pub(crate) fn area_to_solid_angle(from: Vec3, point: &SurfacePoint, area: f32) -> f32 {
    let to = point.position - from;
    let squared = to.length_squared();
    let cosine = point.normal.dot(to).abs() / squared.sqrt();
    squared / (cosine * area)
}
