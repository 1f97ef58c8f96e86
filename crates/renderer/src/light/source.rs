//! The trait of all kinds of lights, and its results: samples of arriving light, and rays that leave a light.

use crate::shading::discrete::BELOW_ONE;
use crate::shading::{ShadingFrame, warp};
use dapple_geometry::{Ray, SurfacePoint, spawn_ray, spawn_ray_to, spawn_ray_to_point};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// The functions that each kind of light implements.
pub(crate) trait LightSource {
    /// Samples a direction from the point `from` to the light by random numbers `u` in `[0, 1)^2`. Returns `None` if
    /// no light arrives at `from` from the sampled direction.
    fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample>;

    /// Returns the solid-angle density with which [`Self::sample`] at `from` samples the direction to `point` on the light's
    /// shape.
    ///
    /// Returns 0 for lights without a shape.
    #[inline]
    fn pdf(&self, _from: Vec3, _point: &SurfacePoint) -> f32 {
        0.0
    }

    /// Returns the emission of an area light, averaged if it varies; `None` for lights without a shape.
    #[inline]
    fn lamp(&self) -> Option<&Lamp> {
        None
    }

    /// Returns true for a light that no ray can hit: a point, a spot or a distant light.
    fn is_delta(&self) -> bool {
        false
    }

    /// Returns the area of an area light; 0 for lights without a shape.
    fn area(&self) -> f64 {
        0.0
    }

    /// Samples a ray that leaves the light, as [`Lights::sample_emission`](crate::light::Lights::sample_emission) does. The
    /// caller sets `light` and `pmf`.
    ///
    /// The default is for light from infinity, with directions from [`Self::sample`].
    fn emit(&self, scene: &SceneSphere, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        let sample = self.sample(scene.centre, towards)?;
        Some(scene.parallel(-sample.wi, sample.radiance, sample.pdf, place))
    }

    /// Returns the densities of [`Self::emit`]; see [`Lights::emission_pdf`]. The default is for area lights.
    fn emission_pdf(&self, scene: &SceneSphere, point: &SurfacePoint, direction: Vec3) -> EmissionPdf {
        let cosine = point.normal.dot(direction);
        self.lamp().map_or(scene.parallel_pdf(0.0), |lamp| lamp.emission_pdf(cosine, self.area() as f32))
    }

    /// Returns the luminance of the light's radiant power, divided by pi. For an environment or distant light, this is the
    /// power that enters the scene's bounding sphere, whose radius is `scene_radius`. The default is for area lights.
    fn power(&self, _scene_radius: f64) -> f64 {
        self.area() * self.lamp().map_or(0.0, Lamp::brightness)
    }

    /// Returns an approximation of the light's contribution. Learned selection uses it until samples are available.
    fn expectation(&self) -> Expectation;
}

/// The origin of sampled light.
#[derive(Clone, Copy, Debug)]
pub enum Target {
    /// A point on the surface of an area light.
    Surface(SurfacePoint),
    /// The position of a point or spot light.
    Point(Vec3),
    /// A point at infinity.
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

/// A sample of the light that arrives at a point. Occlusion is not tested.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// The unit direction to the light.
    pub wi: Vec3,
    /// The linear RGB radiance from `wi`. For a delta light: the irradiance on a surface that faces the light.
    pub radiance: Vec3,
    /// The solid-angle density of `wi` times the probability of selecting the light, above 0. For a delta light: the
    /// probability alone.
    pub pdf: f32,
    /// The point that the light comes from.
    pub target: Target,
    /// True for a delta light, which no ray can hit.
    ///
    /// Such a sample gets no multiple-importance weight against BSDF sampling.
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

/// The emission of an area light: its radiance, from one side or from both.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lamp {
    pub(crate) radiance: Vec3,
    pub(crate) two_sided: bool,
}

impl Lamp {
    /// Returns the radiance emitted in a direction. `cosine` is the cosine between that direction and the normal of the
    /// emitting side.
    #[inline]
    pub(super) fn radiance(&self, cosine: f32) -> Vec3 {
        if cosine > 0.0 || (self.two_sided && cosine < 0.0) { self.radiance } else { Vec3::ZERO }
    }

    /// Returns the densities of a ray that leaves an area light of this area. `cosine` is the cosine between the ray and the
    /// normal of the emitting side.
    pub(super) fn emission_pdf(&self, cosine: f32, area: f32) -> EmissionPdf {
        let direction = if self.two_sided { 0.5 * cosine.abs() } else { cosine.max(0.0) } * FRAC_1_PI;
        EmissionPdf { position: area.recip(), direction }
    }

    /// Returns the luminance of the radiant exitance, divided by pi and summed over the emitting sides.
    pub(super) fn brightness(&self) -> f64 {
        luminance(self.radiance) * if self.two_sided { 2.0 } else { 1.0 }
    }

    /// Returns the luminance of a flat emitter's radiant intensity along its normal. `area` is the emitter's area.
    pub(super) fn intensity(&self, area: f64) -> f32 {
        (luminance(self.radiance) * area) as f32
    }

    /// Returns `normal` if the light emits from one side, and the zero vector if it emits from both.
    pub(super) fn facing(&self, normal: Vec3) -> Vec3 {
        if self.two_sided { Vec3::ZERO } else { normal }
    }
}

/// Returns the luminance of a linear RGB color, by [`dapple_core::film::luminance`].
pub(super) fn luminance(rgb: Vec3) -> f64 {
    dapple_core::film::luminance(rgb.to_array().map(f64::from))
}

/// Returns the light sample for a point sampled uniformly on `area`. `side` is 1 if the point's normal is on the emitting
/// side, else -1.
#[inline(always)]
pub(super) fn sample_on(lamp: &Lamp, from: Vec3, point: SurfacePoint, side: f32, area: f32) -> Option<LightSample> {
    let to = point.position - from;
    let squared = to.length_squared();
    let wi = to * squared.sqrt().recip();
    let cosine = -side * point.normal.dot(wi);
    let radiance = lamp.radiance(cosine);
    // The same density as `area_to_solid_angle`. It is 0 or NaN if the light touches the point.
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

/// The bounding sphere of a scene. Light from infinity enters it through a disk of the same radius.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SceneSphere {
    pub(crate) centre: Vec3,
    pub(crate) radius: f32,
}

impl SceneSphere {
    /// Returns the area density of a point on the disk; 1 / pi for a scene that is a single point.
    fn disk_pdf(&self) -> f32 {
        FRAC_1_PI / (self.radius * self.radius)
    }

    /// Returns a ray of parallel light in the unit `direction`. `u` in `[0, 1)^2` selects its origin on the disk in front of
    /// the sphere.
    pub(super) fn parallel(&self, direction: Vec3, radiance: Vec3, pdf: f32, u: [f32; 2]) -> EmittedLight {
        let (disk, frame) = (warp::concentric_disk(u), ShadingFrame::from_normal(direction));
        let on = frame.tangent * disk.x + frame.bitangent * disk.y - direction;
        let (position, pdf) = (self.centre + on * self.radius, self.parallel_pdf(pdf));
        EmittedLight { light: 0, pmf: 1.0, source: Target::Far, position, direction, radiance, cosine: 1.0, pdf }
    }

    /// Returns the densities of parallel light whose direction has the solid-angle density `direction`.
    pub(super) fn parallel_pdf(&self, direction: f32) -> EmissionPdf {
        EmissionPdf { position: self.disk_pdf(), direction }
    }
}

/// The densities with which [`Lights::sample_emission`](crate::light::Lights::sample_emission) samples a ray, without the
/// probability of selecting the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissionPdf {
    /// The area density of the ray's origin on an area light. For light from infinity: on a disk of the scene's radius,
    /// perpendicular to the ray. 1 for a point or a spot.
    pub position: f32,
    /// The solid-angle density of the direction. 1 for a distant light.
    pub direction: f32,
}

/// A ray that leaves a light, with its radiance and sampling densities.
#[derive(Clone, Copy, Debug)]
pub struct EmittedLight {
    /// The index of the light in [`Lights`](crate::light::Lights).
    pub light: u32,
    /// The probability with which the light was selected.
    pub pmf: f32,
    /// The point that the ray leaves: [`Target::Surface`] with the normal on the emitting side, [`Target::Point`], or
    /// [`Target::Far`].
    pub source: Target,
    /// The origin of the ray. For light from infinity, a point outside the scene's bounding sphere.
    pub position: Vec3,
    /// The unit direction of the ray.
    pub direction: Vec3,
    /// The linear RGB radiance along the ray. For a point or spot light, the radiant intensity; for a distant light, the
    /// irradiance on a surface that faces it.
    pub radiance: Vec3,
    /// The cosine between the ray and the normal of an area light; 1 for other lights.
    pub cosine: f32,
    /// The densities of the ray.
    pub pdf: EmissionPdf,
}

impl EmittedLight {
    /// Returns the flux of the ray, `radiance * cosine / (pmf * pdf.position * pdf.direction)`. The expected flux is the total
    /// power of all lights.
    pub fn flux(&self) -> Vec3 {
        self.radiance * (self.cosine / (self.pmf * self.pdf.position * self.pdf.direction))
    }

    /// Returns the ray. On an area light, it starts slightly above the surface, so that it does not hit its own start.
    pub fn ray(&self) -> Ray {
        match &self.source {
            Target::Surface(point) => spawn_ray(point, self.direction),
            _ => Ray::new(self.position, self.direction),
        }
    }

    /// Returns a ray that leaves a point on an area light. `point` has its normal on the emitting side. `u` in `[0, 1)^2`
    /// selects the side of a two-sided light and the direction.
    pub(super) fn from_surface(lamp: &Lamp, mut point: SurfacePoint, u: [f32; 2], area: f32) -> Option<Self> {
        let mut u = u;
        if lamp.two_sided {
            let below = u[0] >= 0.5;
            u[0] = (2.0 * u[0] - if below { 1.0 } else { 0.0 }).min(BELOW_ONE);
            point.normal = if below { -point.normal } else { point.normal };
        }
        let local = warp::cosine_hemisphere(u);
        let direction = ShadingFrame::from_normal(point.normal).to_world(local).normalize();
        Self::leaving(lamp, point, direction, area)
    }

    /// Returns the ray from a point on an area light in a direction. The point and the direction were sampled with the
    /// densities of [`Self::from_surface`].
    pub(super) fn leaving(lamp: &Lamp, point: SurfacePoint, direction: Vec3, area: f32) -> Option<Self> {
        let cosine = point.normal.dot(direction);
        let pdf = lamp.emission_pdf(cosine, area);
        let (position, source, radiance) = (point.position, Target::Surface(point), lamp.radiance);
        let emitted = EmittedLight { light: 0, pmf: 1.0, source, position, direction, radiance, cosine, pdf };
        (area > 0.0 && cosine > 0.0).then_some(emitted)
    }

    /// Returns the ray from a point light in a direction sampled with density `pdf`.
    pub(super) fn from_point(position: Vec3, direction: Vec3, intensity: Vec3, pdf: f32) -> Self {
        let (source, pdf) = (Target::Point(position), EmissionPdf { position: 1.0, direction: pdf });
        EmittedLight { light: 0, pmf: 1.0, source, position, direction, radiance: intensity, cosine: 1.0, pdf }
    }
}

/// The strength and position of a light, simplified to approximate the light's contribution anywhere in the scene.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Expectation {
    /// A light within the scene: an area, point or spot light.
    Near {
        middle: Vec3,
        radius: f32,
        /// The mean of the emitting sides' unit normals. The more the normals differ, the shorter it is. It is zero for a light
        /// that emits in all directions.
        facing: Vec3,
        /// The luminance of the radiant intensity along `facing`.
        intensity: f32,
    },
    /// A light from infinity: an environment, a tile of it, or a distant light.
    Far {
        /// The unit direction to the light; zero if light arrives from all directions.
        towards: Vec3,
        irradiance: f32,
    },
}

impl Expectation {
    /// Returns the approximate unoccluded irradiance in a cell: on surfaces within distance `half` of `at` whose
    /// normals are nearest to `axis`.
    ///
    /// The value is positive even if the light is behind `at`, since other points of the cell may see it.
    pub(crate) fn irradiance(&self, at: Vec3, half: f32, axis: Vec3) -> f32 {
        // Normals of a cell deviate from the axis by up to 55 degrees.
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
