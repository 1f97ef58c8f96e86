//! The camera and its film.

use super::{MediumId, Source};
use glam::DAffine3;

/// A camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// From camera space (x right, y up, z forward, as pbrt has it) to world space. May mirror.
    pub to_world: DAffine3,
    /// Its transform at the second of [`Scene::motion_times`](super::Scene::motion_times), if it moves.
    pub moves_to: Option<DAffine3>,
    /// The projection.
    pub projection: Projection,
    /// Width over height, where the file fixes it; else the resolution's.
    pub aspect: Option<f64>,
    /// Window on the screen plane (x0, x1, y0, y1), where the file fixes it.
    pub screen_window: Option<[f64; 4]>,
    /// Radius of the lens in units of camera space, as pbrt-v4 has it; 0 is a pinhole.
    pub lens_radius: f64,
    /// Distance of the plane in focus, in units of camera space.
    pub focal_distance: f64,
    /// The times at which the shutter opens and closes.
    pub shutter: [f64; 2],
    /// The medium around it; `None` is vacuum.
    pub medium: Option<MediumId>,
    /// File and line.
    pub source: Source,
}

/// The projection of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Through a point.
    Perspective {
        /// Full angle of view along the shorter side of the frame, degrees.
        fov: f64,
    },
    /// Along parallel lines. The screen window is in units of camera space.
    Orthographic,
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            to_world: DAffine3::IDENTITY,
            moves_to: None,
            projection: Projection::Perspective { fov: 90.0 },
            aspect: None,
            screen_window: None,
            lens_radius: 0.0,
            focal_distance: 1e6,
            shutter: [0.0, 1.0],
            medium: None,
            source: Source::default(),
        }
    }
}

/// The film: resolution, crop window and pixel filter.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmSettings {
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Window in pixels: x0, y0, x1, y1.
    pub crop: Option<[u32; 4]>,
    /// The pixel filter; importance-sampled, so each sample still belongs to one pixel.
    pub pixel_filter: PixelFilter,
    /// The file name that the scene suggests for its image.
    pub file_name: Option<String>,
    /// Samples per pixel that the scene suggests.
    pub spp: Option<u32>,
}

impl Default for FilmSettings {
    fn default() -> Self {
        Self { resolution: [1280, 720], crop: None, pixel_filter: PixelFilter::default(), file_name: None, spp: None }
    }
}

/// The shape of a pixel, radii in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelFilter {
    /// Constant over `2 rx x 2 ry`.
    Box {
        /// Half width and half height.
        radius: [f64; 2],
    },
    /// A tent.
    Triangle {
        /// Half width and half height.
        radius: [f64; 2],
    },
    /// A Gaussian, shifted to be 0 at the radius.
    Gaussian {
        /// Half width and half height.
        radius: [f64; 2],
        /// Standard deviation.
        sigma: f64,
    },
}

impl Default for PixelFilter {
    fn default() -> Self {
        Self::Box { radius: [0.5, 0.5] }
    }
}
