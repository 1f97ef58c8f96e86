//! Light from beyond the scene.

mod tiles;

pub(crate) use tiles::{Tile, Tiles};

use super::{Expectation, LightSample, LightSource, Target, luminance, octahedral};
use crate::shading::discrete::PiecewiseConstant2d;
use crate::shading::trigonometry::{sin_cos_turn, turn_of};
use crate::shading::warp;
use crate::space::even_scale;
use dapple_scene::image::Image;
use dapple_scene::{EnvironmentRadiance, Source};
use glam::{DMat3, Mat3, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// An environment that cannot be made.
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EnvironmentError {
    /// The radiance is negative or not finite.
    #[error("{at}: the environment's radiance {value:?} is invalid; give finite numbers of at least 0")]
    Radiance {
        /// The line of the scene file that defines the environment.
        at: Source,
        /// The invalid value, linear RGB.
        value: [f32; 3],
    },
    /// A texel is negative or not finite.
    #[error(
        "{at}: texel ({column}, {row}) of the environment image is {value:?}; repair the image: values must be finite and at least 0, also when scaled"
    )]
    Texel {
        /// The line of the scene file that defines the environment.
        at: Source,
        /// The column of the texel, counted from 0 at the left.
        column: usize,
        /// The row of the texel, counted from 0 at the top.
        row: usize,
        /// The invalid value, linear RGB.
        value: [f32; 3],
    },
    /// An equal-area image is not square.
    #[error(
        "{at}: an equal-area environment image must be square, not {} x {}; use a square image, or one in latitude and longitude", size[0], size[1]
    )]
    Square {
        /// The line of the scene file that defines the environment.
        at: Source,
        /// The width and height of the image in pixels.
        size: [u32; 2],
    },
    /// The image has more texels than a distribution can hold.
    #[error("{at}: an environment image of {} x {} is too large; scale it down", size[0], size[1])]
    Size {
        /// The line of the scene file that defines the environment.
        at: Source,
        /// The width and height of the image in pixels.
        size: [u32; 2],
    },
    /// The transform stretches or flattens space, or is not finite.
    #[error(
        "{at}: the environment's transform flattens or stretches space, or is not finite; rotate, mirror and scale uniformly only"
    )]
    Transform {
        /// The line of the scene file that defines the environment.
        at: Source,
    },
}

/// Light from infinitely far, as a function of direction.
#[derive(Clone, Debug)]
pub struct Environment {
    to_light: Mat3,
    to_world: Mat3,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Constant(Vec3),
    Image(Map),
}

/// An environment map. Texels are constant, as in pbrt-v4, so that sampling matches evaluation.
#[derive(Clone, Debug)]
struct Map {
    layout: Layout,
    image: Arc<Image>,
    scale: f32,
    /// The distribution that samples texels by brightness times solid angle.
    cells: PiecewiseConstant2d,
    /// The mean luminance of the map over the sphere.
    average: f64,
}

/// The map from directions to the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    LatLong,
    EqualArea,
}

impl Environment {
    /// Makes an environment in the file's orientation. `None` if it is black.
    ///
    /// # Errors
    ///
    /// If a radiance is negative or not finite, an equal-area image is not square, or the transform does not just
    /// rotate and scale.
    pub fn new(radiance: &EnvironmentRadiance, to_world: DMat3, at: &Source) -> Result<Option<Self>, EnvironmentError> {
        // Directions only: a uniform scale does nothing.
        let inverse = to_world.inverse();
        let sound = to_world.is_finite() && inverse.is_finite() && to_world.determinant().abs() > 0.0;
        // Under a stretch, areas in the image would no longer be areas on the sphere.
        let constant = matches!(radiance, EnvironmentRadiance::Constant(_));
        if !sound || !(constant || even_scale(&to_world).is_some()) {
            return Err(EnvironmentError::Transform { at: at.clone() });
        }
        let kind = match radiance {
            EnvironmentRadiance::Constant(rgb) if !valid(rgb) => {
                return Err(EnvironmentError::Radiance { at: at.clone(), value: *rgb });
            }
            EnvironmentRadiance::Constant(rgb) => (*rgb != [0.0; 3]).then_some(Kind::Constant(Vec3::from_array(*rgb))),
            EnvironmentRadiance::LatLong { image, scale } => {
                Map::new(Layout::LatLong, image, *scale, at)?.map(Kind::Image)
            }
            EnvironmentRadiance::EqualArea { image, scale } => {
                Map::new(Layout::EqualArea, image, *scale, at)?.map(Kind::Image)
            }
        };
        Ok(kind.map(|kind| Self { to_light: normalized(inverse), to_world: normalized(to_world), kind }))
    }

    /// Returns the radiance from unit direction `w`.
    #[inline]
    pub fn radiance(&self, w: Vec3) -> Vec3 {
        match &self.kind {
            Kind::Constant(rgb) => *rgb,
            Kind::Image(map) => map.radiance(map.layout.to_uv(self.to_light * w)),
        }
    }

    /// Returns direction, radiance and solid-angle density of a point drawn in the image.
    #[inline(always)]
    fn drawn(&self, map: &Map, (uv, density): ([f32; 2], f32)) -> (Vec3, Vec3, f32) {
        let (local, pdf) = map.layout.to_sphere(uv, density);
        // Radiance and density both of the cell that was drawn: its direction may round into the next.
        ((self.to_world * local).normalize(), map.radiance(uv), pdf)
    }

    /// Returns the solid-angle density with which light sampling draws direction `w`.
    #[inline]
    pub fn direction_pdf(&self, w: Vec3) -> f32 {
        self.radiance_and_pdf(w).1
    }

    /// Returns [`Self::radiance`] and [`Self::direction_pdf`] by one look-up.
    #[inline]
    pub(super) fn radiance_and_pdf(&self, w: Vec3) -> (Vec3, f32) {
        match &self.kind {
            Kind::Constant(rgb) => (*rgb, warp::uniform_sphere_pdf()),
            Kind::Image(map) => {
                let (_, radiance, pdf) = self.looked_up(map, w);
                (radiance, pdf)
            }
        }
    }

    /// Returns position in the image, radiance, and solid-angle density for unit direction `w`.
    #[inline(always)]
    fn looked_up(&self, map: &Map, w: Vec3) -> ([f32; 2], Vec3, f32) {
        let uv = map.layout.to_uv(self.to_light * w);
        (uv, map.radiance(uv), map.layout.pdf(uv, map.cells.pdf(uv)))
    }

    /// Returns the mean luminance over the sphere.
    pub(super) fn average_luminance(&self) -> f64 {
        match &self.kind {
            Kind::Constant(rgb) => luminance(*rgb),
            Kind::Image(map) => map.average,
        }
    }
}

impl LightSource for Environment {
    /// Samples a direction with a density nearly proportional to brightness.
    #[inline]
    fn sample(&self, _: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let (wi, radiance, pdf) = match &self.kind {
            Kind::Constant(rgb) => (warp::uniform_sphere(u), *rgb, warp::uniform_sphere_pdf()),
            Kind::Image(map) => self.drawn(map, map.cells.sample_near(u, |i| map.look(i))?),
        };
        let shines = pdf.is_finite() && radiance != Vec3::ZERO;
        shines.then_some(LightSample { wi, radiance, pdf, target: Target::Far, delta: false })
    }

    /// Returns mean luminance times 4 pi, times the scene's disk `pi r^2`, over pi.
    fn power(&self, scene_radius: f64) -> f64 {
        4.0 * std::f64::consts::PI * scene_radius * scene_radius * self.average_luminance()
    }

    fn expectation(&self) -> Expectation {
        let irradiance = (std::f64::consts::PI * self.average_luminance()) as f32;
        Expectation::Far { towards: Vec3::ZERO, irradiance }
    }
}

impl Map {
    fn new(layout: Layout, image: &Arc<Image>, scale: f32, at: &Source) -> Result<Option<Self>, EnvironmentError> {
        let [width, height] = image.size.map(|n| n as usize);
        if layout == Layout::EqualArea && width != height {
            return Err(EnvironmentError::Square { at: at.clone(), size: image.size });
        }
        if !(scale.is_finite() && scale >= 0.0) {
            return Err(EnvironmentError::Radiance { at: at.clone(), value: [scale; 3] });
        }
        if let Some(i) = image.pixels.iter().position(|p| !(valid(p) && valid(&p.map(|x| x * scale)))) {
            let (column, row, value) = (i % width, i / width, image.pixels[i]);
            return Err(EnvironmentError::Texel { at: at.clone(), column, row, value });
        }
        // Brightness of a texel times its share of the sphere, which in latitude and longitude goes with the sine.
        let share = |row: usize| match layout {
            Layout::LatLong => sin_cos_turn(0.5 * (row as f32 + 0.5) / height as f32).0,
            Layout::EqualArea => 1.0,
        };
        let brightness = |i: usize| luminance(Vec3::from_array(image.pixels[i])) as f32;
        let weights: Vec<f32> = (0..width * height).map(|i| brightness(i) * share(i / width)).collect();
        let Ok(cells) = PiecewiseConstant2d::new(&weights, [width, height]) else {
            return Err(EnvironmentError::Size { at: at.clone(), size: image.size });
        };
        if cells.is_empty() || scale == 0.0 {
            return Ok(None);
        }
        // The sine averages to 2/pi over rows.
        let mean_share = if layout == Layout::LatLong { std::f64::consts::FRAC_2_PI } else { 1.0 };
        let average = cells.mean() * f64::from(scale) / mean_share;
        Ok(Some(Self { layout, image: image.clone(), scale, cells, average }))
    }

    #[inline]
    fn radiance(&self, uv: [f32; 2]) -> Vec3 {
        let [column, row] = self.texel(uv);
        Vec3::from_array(self.image.pixels[(row * self.image.size[0] + column) as usize]) * self.scale
    }

    /// Returns the column and row of the texel at a position in the image.
    #[inline]
    fn texel(&self, [u, v]: [f32; 2]) -> [u32; 2] {
        let [width, height] = self.image.size;
        [((u * width as f32) as u32).min(width - 1), ((v * height as f32) as u32).min(height - 1)]
    }

    /// Loads the cache line of a pixel that is needed soon.
    #[inline(always)]
    fn look(&self, pixel: usize) {
        std::hint::black_box(self.image.pixels[pixel][0]);
    }
}

impl Layout {
    /// Returns the position in the image of a direction in the light's frame (z up): `[0, 1]^2`, row 0 at `v = 0`.
    #[inline]
    fn to_uv(self, w: Vec3) -> [f32; 2] {
        match self {
            // The polar angle from both coordinates keeps its digits near the poles.
            Self::LatLong => [turn_of(w.y, w.x), 2.0 * turn_of((w.x * w.x + w.y * w.y).sqrt(), w.z)],
            Self::EqualArea => octahedral::to_square(w.normalize()),
        }
    }

    /// Returns the direction at a position in the image, and a density there converted to solid angle.
    #[inline]
    fn to_sphere(self, uv: [f32; 2], density: f32) -> (Vec3, f32) {
        match self {
            Self::LatLong => {
                let (sin, cos) = sin_cos_turn(0.5 * uv[1]);
                let (y, x) = sin_cos_turn(uv[0]);
                (Vec3::new(sin * x, sin * y, cos), density / (2.0 * PI * PI * sin))
            }
            Self::EqualArea => (octahedral::to_sphere(uv), density * warp::uniform_sphere_pdf()),
        }
    }

    /// Returns a density at a position in the image, converted to solid angle.
    #[inline]
    fn pdf(self, uv: [f32; 2], density: f32) -> f32 {
        match self {
            Self::LatLong => {
                let sin = sin_cos_turn(0.5 * uv[1]).0;
                if sin > 0.0 { density / (2.0 * PI * PI * sin) } else { 0.0 }
            }
            Self::EqualArea => density * warp::uniform_sphere_pdf(),
        }
    }
}

/// Returns true if a radiance is finite and not negative.
fn valid(rgb: &[f32; 3]) -> bool {
    rgb.iter().all(|x| x.is_finite() && *x >= 0.0)
}

/// Returns the rotation (and reflection) in a matrix that may also scale uniformly.
fn normalized(m: DMat3) -> Mat3 {
    let scale = m.determinant().abs().cbrt();
    (m * (1.0 / scale)).as_mat3()
}
