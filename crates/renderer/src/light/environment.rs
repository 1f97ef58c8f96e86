//! Light from beyond the scene.

use super::{LightSample, Target, luminance};
use crate::image::Picture;
use crate::scene::{EnvironmentRadiance, Source};
use crate::shading::discrete::PiecewiseConstant2d;
use crate::shading::trigonometry::{sin_cos_turn, turn_of};
use crate::space::even_scale;
use glam::{DMat3, Mat3, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// What is wrong with an environment.
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EnvironmentError {
    /// Its radiance is none.
    #[error("{at}: the environment's radiance {value:?} is none: give finite numbers of at least 0")]
    Radiance {
        /// Where it is said.
        at: Source,
        /// The value.
        value: [f32; 3],
    },
    /// A texel is no radiance.
    #[error(
        "{at}: texel ({column}, {row}) of the environment picture is {value:?}: mend the picture, its values must be finite and at least 0"
    )]
    Texel {
        /// Where it is said.
        at: Source,
        /// From the left, from 0.
        column: usize,
        /// From the top, from 0.
        row: usize,
        /// The value.
        value: [f32; 3],
    },
    /// Its transform.
    #[error(
        "{at}: the environment's transform flattens or stretches space, or is not finite: it may turn, mirror and scale evenly"
    )]
    Transform {
        /// Where it is said.
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
    /// Texels are constant, so that what is sampled is what is seen.
    LatLong {
        picture: Arc<Picture>,
        scale: f32,
        cells: PiecewiseConstant2d,
        average: f64,
    },
}

impl Environment {
    /// An environment, in the file's orientation. `None` if it is black.
    ///
    /// # Errors
    ///
    /// When a radiance is negative or not finite, or the transform is no rotation or scale.
    pub fn new(radiance: &EnvironmentRadiance, to_world: DMat3, at: &Source) -> Result<Option<Self>, EnvironmentError> {
        // Directions only: a uniform scale does nothing.
        let inverse = to_world.inverse();
        let sound = to_world.is_finite() && inverse.is_finite() && to_world.determinant().abs() > 0.0;
        // Under a stretch, areas in the picture would no longer be areas on the sphere.
        let constant = matches!(radiance, EnvironmentRadiance::Constant(_));
        if !sound || !(constant || even_scale(&to_world).is_some()) {
            return Err(EnvironmentError::Transform { at: at.clone() });
        }
        let valid = |rgb: &[f32; 3]| rgb.iter().all(|x| x.is_finite() && *x >= 0.0);
        let kind = match radiance {
            EnvironmentRadiance::Constant(rgb) if !valid(rgb) => {
                return Err(EnvironmentError::Radiance { at: at.clone(), value: *rgb });
            }
            EnvironmentRadiance::Constant(rgb) if *rgb == [0.0; 3] => return Ok(None),
            EnvironmentRadiance::Constant(rgb) => Kind::Constant(Vec3::from_array(*rgb)),
            EnvironmentRadiance::LatLong { picture, scale } | EnvironmentRadiance::EqualArea { picture, scale } => {
                let [width, height] = picture.size.map(|n| n as usize);
                if let Some(i) = picture.pixels.iter().position(|p| !valid(p)) {
                    let (column, row, value) = (i % width, i / width, picture.pixels[i]);
                    return Err(EnvironmentError::Texel { at: at.clone(), column, row, value });
                }
                if !(scale.is_finite() && *scale >= 0.0) {
                    return Err(EnvironmentError::Radiance { at: at.clone(), value: [*scale; 3] });
                }
                // Brightness of a texel times the sine of its row: its share of the sphere.
                let weights: Vec<f32> = (0..width * height)
                    .map(|i| {
                        let v = ((i / width) as f32 + 0.5) / height as f32;
                        luminance(Vec3::from_array(picture.pixels[i])) * sin_cos_turn(0.5 * v).0
                    })
                    .collect();
                let Ok(cells) = PiecewiseConstant2d::new(&weights, [width, height]) else {
                    return Err(EnvironmentError::Radiance { at: at.clone(), value: [*scale; 3] });
                };
                if cells.is_empty() || *scale == 0.0 {
                    return Ok(None);
                }
                // The sine averages to 2/pi over rows.
                let average = cells.mean() * f64::from(*scale) * std::f64::consts::FRAC_PI_2;
                Kind::LatLong { picture: picture.clone(), scale: *scale, cells, average }
            }
        };
        Ok(Some(Self { to_light: normalized(inverse), to_world: normalized(to_world), kind }))
    }

    /// Radiance from unit direction `w`.
    #[inline]
    pub fn radiance(&self, w: Vec3) -> Vec3 {
        match &self.kind {
            Kind::Constant(rgb) => *rgb,
            Kind::LatLong { picture, scale, .. } => {
                let [u, v] = to_uv((self.to_light * w).normalize());
                let [width, height] = picture.size;
                let column = ((u * width as f32) as u32).min(width - 1);
                let row = ((v * height as f32) as u32).min(height - 1);
                Vec3::from_array(picture.pixels[(row * width + column) as usize]) * *scale
            }
        }
    }

    /// Draws a direction with density near the brightness.
    #[inline]
    pub(super) fn sample(&self, u: [f32; 2]) -> Option<LightSample> {
        let (wi, pdf) = match &self.kind {
            Kind::Constant(_) => (crate::shading::warp::uniform_sphere(u), 0.25 / PI),
            Kind::LatLong { cells, .. } => {
                let (uv, density) = cells.sample(u)?;
                let (sin, cos) = sin_cos_turn(0.5 * uv[1]);
                let (y, x) = sin_cos_turn(uv[0]);
                let local = Vec3::new(sin * x, sin * y, cos);
                ((self.to_world * local).normalize(), density / (2.0 * PI * PI * sin))
            }
        };
        let radiance = self.radiance(wi);
        (pdf.is_finite() && radiance != Vec3::ZERO).then_some(LightSample { wi, radiance, pdf, target: Target::Far })
    }

    /// Density in solid angle with which directions are drawn.
    #[inline]
    pub fn pdf(&self, w: Vec3) -> f32 {
        match &self.kind {
            Kind::Constant(_) => 0.25 / PI,
            Kind::LatLong { cells, .. } => {
                let uv = to_uv((self.to_light * w).normalize());
                let sin = sin_cos_turn(0.5 * uv[1]).0;
                if sin > 0.0 { cells.pdf(uv) / (2.0 * PI * PI * sin) } else { 0.0 }
            }
        }
    }

    /// Mean luminance over the sphere.
    pub(super) fn average_luminance(&self) -> f64 {
        match &self.kind {
            Kind::Constant(rgb) => f64::from(luminance(*rgb)),
            Kind::LatLong { average, .. } => *average,
        }
    }
}

/// Texture place of a unit direction in the light's frame, z up: in `[0, 1]^2`, row 0 at +z.
#[inline]
fn to_uv(w: Vec3) -> [f32; 2] {
    // The polar angle from both coordinates keeps its digits near the poles.
    [turn_of(w.y, w.x), 2.0 * turn_of((w.x * w.x + w.y * w.y).sqrt(), w.z)]
}

/// The rotation (and reflection) in a matrix that may scale uniformly.
fn normalized(m: DMat3) -> Mat3 {
    let scale = m.determinant().abs().cbrt();
    (m * (1.0 / scale)).as_mat3()
}
