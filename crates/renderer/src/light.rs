//! Lights, and the sampling of directions towards them by solid angle.
//!
//! A new kind of light is a file in this directory that implements `LightSource`, and a line in the list of lights
//! below.

// `!(x > 0.0)` is intended: it rejects NaN too.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod environment;
mod environment_map;
mod mesh;
mod punctual;
mod quadrics;
mod selection;
mod source;
mod textured;

pub use environment::Environment;
use environment::{Tile, Tiles};
pub(crate) use mesh::MeshLight;
pub(crate) use punctual::{DistantLight, PointLight, SpotLight};
pub(crate) use quadrics::{DiskLight, SphereLight};
pub use selection::{LightSelection, UnknownLightSelection};
pub use source::{EmissionPdf, EmittedLight, LightSample, Target};
pub(crate) use source::{Expectation, Lamp, LightSource, SceneSphere};
pub(crate) use textured::{TexturedEmission, TexturedLight};

use crate::SceneError;
use crate::shading::discrete::Discrete;
use crate::shading::power_heuristic;
use crate::space::Space;
use dapple_geometry::SurfacePoint;
use dapple_scene::{Light as Described, LightKind};
use glam::Vec3;
use std::sync::Arc;

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

            fn emission_pdf(&self, scene: &SceneSphere, point: &SurfacePoint, direction: Vec3) -> EmissionPdf {
                match self { $(Self::$name(light) => light.emission_pdf(scene, point, direction),)* }
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
    /// A mesh whose emission is a texture.
    Textured(Box<TexturedLight>),
}

impl Light {
    /// Prepares a light of the scene. Returns `None` if it emits nothing.
    ///
    /// # Errors
    ///
    /// [`SceneError`] if a parameter or the transform is invalid.
    pub(crate) fn of(described: &Described, space: &Space) -> Result<Option<Self>, SceneError> {
        let (to_world, at) = (described.to_world, &described.source);
        Ok(match &described.kind {
            LightKind::Infinite { radiance } => Environment::new(radiance, to_world.matrix3, at)?
                .map(|environment| Self::Environment(Arc::new(environment))),
            LightKind::Point { intensity } => PointLight::new(*intensity, to_world, space, at)?.map(Self::Point),
            LightKind::Spot { intensity, cone, falloff_start, falloff } => {
                SpotLight::new(*intensity, [*cone, *falloff_start], *falloff, to_world, space, at)?.map(Self::Spot)
            }
            LightKind::Distant { irradiance } => DistantLight::new(*irradiance, to_world, at)?.map(Self::Distant),
        })
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

/// All lights of a scene, with the probabilities of their selection.
#[derive(Clone, Debug)]
pub struct Lights {
    lights: Vec<Light>,
    distribution: Discrete,
    pmf: Vec<f32>,
    environments: Vec<SelectableEnvironment>,
    /// The number of lights, with each environment counted as one.
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
    /// The environment's tiles, and the light index of the second tile. The lights of further tiles follow it. `None` if the
    /// environment is not divided.
    tiles: Option<(Arc<Tiles>, u32)>,
}

impl SelectableEnvironment {
    /// Returns the radiance from the unit direction `w`, and the index of the light that it belongs to. Also returns the
    /// solid-angle density with which that light, once selected, samples `w`.
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
    /// Makes the set of lights, selected in proportion to their power. Each light must emit light.
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

    /// Restores each divided environment map to a single light.
    fn join_tiles(&mut self) {
        self.lights.truncate(self.whole);
        for environment in &mut self.environments {
            self.lights[environment.light as usize] = Light::Environment(environment.whole.clone());
            environment.tiles = None;
        }
    }

    /// Returns an approximation of each light's contribution. Learned selection uses it until samples are available.
    pub(crate) fn expectations(&self) -> Vec<Expectation> {
        self.lights.iter().map(LightSource::expectation).collect()
    }

    /// Returns the number of lights to select from. With learned selection, an environment map is divided into several lights.
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

    /// Returns true if one of the lights is an environment.
    #[inline]
    pub fn has_environment(&self) -> bool {
        !self.environments.is_empty()
    }

    /// Returns true if at least one light is a delta light: a point, a spot or a distant light.
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

    /// Returns the radiance of all environments from a `direction` sampled from a BSDF with the solid-angle density `bsdf_pdf`.
    ///
    /// Each environment's radiance is multiplied by the power heuristic against light sampling. `pmf` returns the probability
    /// with which light sampling selects a light. If lights are sampled by [`Lights::sample`], pass [`Lights::pmf`].
    #[inline(always)]
    pub fn environment_weighted(&self, direction: Vec3, bsdf_pdf: f32, pmf: impl Fn(u32) -> f32) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for environment in &self.environments {
            let (radiance, pdf, light) = environment.find(direction);
            sum += radiance * power_heuristic(bsdf_pdf, pdf * pmf(light));
        }
        sum
    }

    /// Samples light that arrives at the point `from`. `choice` in `[0, 1)` selects a light, and `u` in `[0, 1)^2` a direction
    /// to it.
    ///
    /// The density includes the probability of selecting the light. Returns `None` if the scene has no light, or if no light
    /// arrives from the sampled direction.
    #[inline(always)]
    pub fn sample(&self, from: Vec3, choice: f32, u: [f32; 2]) -> Option<LightSample> {
        self.sample_selected(self.select(choice)?, from, u)
    }

    /// Selects a light by a random number `u` in `[0, 1)`. Returns `None` if the scene has no light.
    #[inline(always)]
    pub fn select(&self, u: f32) -> Option<SelectedLight> {
        match self.lights.len() {
            1 => Some(SelectedLight { index: 0, pmf: 1.0 }),
            _ => self.distribution.sample(u).map(|c| SelectedLight { index: c.index as u32, pmf: c.pmf }),
        }
    }

    /// Samples a direction from the point `from` to a selected light, by `u` in `[0, 1)^2`. The density includes the
    /// probability of selecting the light. Returns `None` if no light arrives from the sampled direction.
    #[inline(always)]
    pub fn sample_selected(&self, light: SelectedLight, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let mut sample = self.lights[light.index as usize].sample(from, u)?;
        sample.pdf *= light.pmf;
        // A density that overflowed to infinity would give weight 0, and a density of 0 infinite weight.
        (sample.pdf > 0.0 && sample.pdf < f32::INFINITY).then_some(sample)
    }

    /// Returns the solid-angle density with which [`Lights::sample`] samples the direction from `from` to `point` on
    /// the shape of an area light, including the probability of selecting the light. Returns 0 for other lights.
    #[inline]
    pub fn pdf(&self, light: u32, from: Vec3, point: &SurfacePoint) -> f32 {
        self.direction_pdf(light, from, point) * self.pmf(light)
    }

    /// Returns the same density as [`Lights::pdf`], but without the probability of selecting the light.
    #[inline(always)]
    pub fn direction_pdf(&self, light: u32, from: Vec3, point: &SurfacePoint) -> f32 {
        self.lights[light as usize].pdf(from, point)
    }

    /// Returns the radiance that a point of an area light emits at this `cosine` to the emitting side's normal.
    /// Returns black for other lights, for unused indices, for a `cosine` of 0, and for a negative one unless both sides emit.
    #[inline(always)]
    pub fn emitted(&self, light: u32, point: &SurfacePoint, cosine: f32) -> Vec3 {
        let Some(light) = self.lights.get(light as usize) else { return Vec3::ZERO };
        let Some(lamp) = light.lamp() else { return Vec3::ZERO };
        let mean = lamp.radiance(cosine);
        match light {
            Light::Textured(light) if mean != Vec3::ZERO => light.radiance(point),
            _ => mean,
        }
    }

    /// Returns the probability with which [`Lights::select`] returns `light`.
    #[inline]
    pub fn pmf(&self, light: u32) -> f32 {
        self.pmf[light as usize]
    }

    /// Samples a ray that leaves a light. `choice` in `[0, 1)` selects the light as [`Lights::select`] does. `place` and
    /// `towards` in `[0, 1)^2` select the point on the light and the direction.
    ///
    /// Points are uniform on area lights; on textured ones, triangles are selected by mean emission. Light from infinity
    /// leaves a disk perpendicular to its direction, with the radius of the scene's bounding sphere. Directions are
    /// cosine-weighted for area lights, sampled by luminance for environment maps, and uniform for a point light and in a
    /// spot light's cone. Returns `None` without lights, and if the light emits nothing in the sampled direction.
    pub fn sample_emission(&self, choice: f32, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        self.sample_emission_of(self.select(choice)?, place, towards)
    }

    /// Samples a ray that leaves a selected light, as [`Lights::sample_emission`] does.
    pub fn sample_emission_of(
        &self,
        selected: SelectedLight,
        place: [f32; 2],
        towards: [f32; 2],
    ) -> Option<EmittedLight> {
        let light = &self.lights[selected.index as usize];
        let mut emitted = light.emit(&self.scene, place, towards)?;
        (emitted.light, emitted.pmf) = (selected.index, selected.pmf);
        let flux = emitted.flux();
        (flux != Vec3::ZERO && flux.is_finite()).then_some(emitted)
    }

    /// Returns the densities of origin and direction with which [`Lights::sample_emission`] samples a ray in the unit
    /// `direction`, without the probability of selecting the light.
    ///
    /// For an area light, `point` is the ray's origin, with its normal on the emitting side; other lights ignore `point`. The
    /// density of a direction without emission is 0. For a distant light, the density of every direction is 1.
    pub fn emission_pdf(&self, light: u32, point: &SurfacePoint, direction: Vec3) -> EmissionPdf {
        self.lights[light as usize].emission_pdf(&self.scene, point, direction)
    }

    /// Returns the solid-angle density with which [`Lights::sample_emission`] samples environment light that arrives from the
    /// unit direction `w`, including the probability of selecting the light. Returns 0 without an environment.
    pub fn environment_emission_pdf(&self, w: Vec3) -> f32 {
        let density = |(_, pdf, light): (Vec3, f32, u32)| pdf * self.pmf(light);
        self.environments.iter().map(|environment| density(environment.find(w))).sum()
    }

    /// Returns the luminance of a light's radiant power. For an environment or a distant light, this is the power that enters
    /// the scene's bounding sphere.
    pub fn power(&self, light: u32) -> f64 {
        std::f64::consts::PI * self.lights[light as usize].power(f64::from(self.scene.radius))
    }

    /// Returns true for a delta light: a point, a spot or a distant light.
    pub fn is_delta(&self, light: u32) -> bool {
        self.lights[light as usize].is_delta()
    }

    /// Returns the centre and the radius of a light's bounding sphere; `None` for light from infinity.
    pub fn light_sphere(&self, light: u32) -> Option<(Vec3, f32)> {
        match self.lights[light as usize].expectation() {
            Expectation::Near { middle, radius, .. } => Some((middle, radius)),
            Expectation::Far { .. } => None,
        }
    }

    /// Returns the centre, the radius and the radiance of a sphere that emits outwards; `None` for other lights.
    pub fn ball(&self, light: u32) -> Option<(Vec3, f32, Vec3)> {
        match &self.lights[light as usize] {
            Light::Sphere(sphere) => sphere.seen_from_outside(),
            _ => None,
        }
    }

    /// Returns the largest radiant intensity of a point or spot light; `None` for other lights.
    pub fn intensity(&self, light: u32) -> Option<Vec3> {
        match &self.lights[light as usize] {
            Light::Point(point) => Some(point.intensity),
            Light::Spot(spot) => Some(spot.point.intensity),
            _ => None,
        }
    }

    /// Returns the centre and the radius of the scene's bounding sphere.
    pub fn scene_sphere(&self) -> (Vec3, f32) {
        (self.scene.centre, self.scene.radius)
    }
}
